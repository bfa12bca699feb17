"""A process of its own for code that may end it: the command line outlives the crashes of the libraries it calls.

Readers of mesh files follow what a damaged file says and may end the process with it. The process that the user
started therefore only forks before anything is loaded, waits, and says in plain words how the other one ended.
Where there is no fork (Windows) the work is done in the same process.
"""

import mmap
import os
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType

FAILED = 2
"""Exit status of work that failed, or whose process was ended by a signal that nobody sent."""
_FORWARDED = ("SIGINT", "SIGTERM", "SIGHUP")
_NOTE_SIZE = 4096
_note: mmap.mmap | None = None  # shared with the process that waits
_expendable = False  # whether another process waits for this one, and says how it ended


@contextmanager
def doing(activity: str) -> Iterator[None]:
    """Tell the process that waits what is being done in the block, such as ``reading scan.ply``."""
    _write_note(activity)
    try:
        yield
    finally:
        _write_note("")


@contextmanager
def processor_time_limited(seconds: float) -> Iterator[None]:
    """End this process, if another one waits for it, when the block takes more processor time than this.

    Compiled code that runs in circles cannot be stopped in any other way.
    """
    if not _expendable or not hasattr(signal, "setitimer"):
        yield
        return
    signal.setitimer(signal.ITIMER_PROF, seconds)  # SIGPROF ends a process that does not handle it
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)


def this_process_is_expendable() -> None:
    """Note that another process waits for this one, and says how it ended."""
    global _expendable
    _expendable = True


def run_supervised(work: Callable[[], str]) -> tuple[int, str]:
    """Call a function in a process of its own, where there is fork; return its exit status and why it failed.

    Interrupts and requests to end are passed on. The first one ends the work in order, so that temporary files go
    away; later ones do not disturb that. If this process is killed, the other one ends, too.

    Parameters
    ----------
    work : callable
        Returns why it failed, or "". It may end with SystemExit, too.

    Returns
    -------
    status : int
        0, or `FAILED` if there is a reason, or what SystemExit said.
    reason : str
        In one line; the caller prints it, because a process that a bad file was read in may not be able to.
    """
    global _note
    if not hasattr(os, "fork"):
        reason = work()
        return (FAILED if reason else 0), reason
    _note = mmap.mmap(-1, _NOTE_SIZE)
    lifeline, held = os.pipe()
    _flush()
    # Signals wait until both processes are ready for them: none must end the one that waits, and leave the other.
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, _forwarded_signals())
    child = os.fork()
    if child == 0:
        os.close(held)
        this_process_is_expendable()
        _end_in_order_on_signals()
        threading.Thread(target=_end_with_the_parent, args=(lifeline,), daemon=True).start()
        os._exit(_exit_status_of(work, mask))  # whatever called this function goes on in the other process alone
    os.close(lifeline)
    status = _wait(child, mask)
    os.close(held)
    code = os.waitstatus_to_exitcode(status)
    note = _read_note()
    if code >= 0:
        return code, note if code == FAILED else ""
    name = signal.Signals(-code).name
    if name in _FORWARDED:
        return 128 - code, ""
    return FAILED, crash_message(name, note)


def crash_message(signal_name: str, activity: str = "") -> str:
    """Say in plain words that a process was ended by a signal, and what may help.

    Examples
    --------
    >>> crash_message("SIGSEGV", "reading scan.obj")  # doctest: +ELLIPSIS
    'crashed (SIGSEGV) while reading scan.obj: the file is damaged in a way that its reader does not notice; ...'
    """
    where = f" while {activity}" if activity else ""
    if signal_name == "SIGKILL":
        return f"was killed (SIGKILL){where}, perhaps for want of memory; nothing was written"
    if signal_name == "SIGPROF":
        return f"took too long{where}: the file is damaged, and its reader runs in circles; nothing was written"
    place = f"crashed ({signal_name}){where}"
    if activity.startswith("reading"):
        return (
            f"{place}: the file is damaged in a way that its reader does not notice; nothing was written. Write the "
            "file again, or convert it to PLY with another program"
        )
    if activity.startswith("writing"):
        return f"{place}: see whether the disk is full; a file that was there before is as it was"
    return f"{place}; nothing was written. Please report it with the file"


def _forwarded_signals() -> list[signal.Signals]:
    return [signal.Signals[name] for name in _FORWARDED]


def _exit_status_of(work: Callable[[], str], mask: set[int | signal.Signals]) -> int:
    """Let signals in again, do the work and leave its reason; return the status to exit with."""
    try:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        reason = work()
        _write_note(reason)
        return FAILED if reason else 0
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else int(end.code is not None)
    except KeyboardInterrupt:
        return 128 + signal.SIGINT
    except BaseException:
        traceback.print_exc()
        return 1
    finally:
        _flush()


def _flush() -> None:
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):  # closed, or the reader of a pipe has gone away
            if stream is not None:
                stream.flush()


def _wait(child: int, mask: set[int | signal.Signals]) -> int:
    """Status of a process after its end; signals, which are let in again, are passed on to it."""

    def forward(number: int, _frame: FrameType | None) -> None:
        os.kill(child, number)

    before = {number: signal.getsignal(number) for number in _forwarded_signals()}
    try:
        for number in before:
            signal.signal(number, forward)
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        return os.waitpid(child, 0)[1]
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _end_in_order_on_signals() -> None:
    """Let the first interrupt or request to end raise an exception, and ignore the next: one may arrive twice.

    A terminal sends its signals to all processes, and the one that waits passes them on.
    """

    def end(number: int, _frame: FrameType | None) -> None:
        for name in _FORWARDED:
            signal.signal(getattr(signal, name), signal.SIG_IGN)
        if number == signal.SIGINT:
            raise KeyboardInterrupt
        raise SystemExit(128 + number)

    for name in _FORWARDED:
        if signal.getsignal(getattr(signal, name)) != signal.SIG_IGN:  # as nohup sets it
            signal.signal(getattr(signal, name), end)


def _end_with_the_parent(lifeline: int) -> None:
    """Ask this process to end in order when the other end of the pipe closes, as it does when the parent is killed."""
    os.read(lifeline, 1)
    main = threading.main_thread().ident
    if main is not None:
        signal.pthread_kill(main, signal.SIGTERM)  # only a signal to this thread ends what it waits for


def _write_note(text: str) -> None:
    if _note is not None:
        _note.seek(0)
        _note.write(text.encode("utf-8", "replace")[: _NOTE_SIZE - 1] + b"\0")


def _read_note() -> str:
    if _note is None:
        return ""
    return _note[:_NOTE_SIZE].split(b"\0", 1)[0].decode("utf-8", "replace")
