"""The command line in a child process, which code that ends it, or never ends, costs nothing but itself.

Readers of mesh files follow what a damaged file says and may end the process with it. The process that the user
started therefore only starts another interpreter, waits for it, and says in plain words how it ended. Signals end the
work in order, wait while a step has to be done whole, or end the process at once where a library has its own loop.
"""

import os
import signal
import subprocess
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType

from bezier_filters.runtime.process_end import (
    GRACE,
    PARENT,
    REPEAT,
    end_on_signals,
    end_with_parent,
    variables_of_child,
)

try:
    import resource
except ImportError:  # Windows
    resource = None  # type: ignore[assignment]

NEEDS_A_LOOK = 3  # exit status of work that was done, but whose result is not what was asked for
FAILED = 2  # exit status of work that failed, or whose process was ended by a signal that nobody sent
ALLOWANCE = 1 << 30  # bytes that reading a file of any size may take,
# and for each byte of the file: a vertex of ten characters takes some five hundred as part of a mesh with everything,
# and compressed files unfold ten times
PER_BYTE = 500
# variable with the end of the pipe of the process that waits, where that is not the standard input; a child takes it
# out of its environment at once
_NOTES = "BEZIER_FILTERS_NOTES"
_MARGIN = 0.5  # seconds after which a child that should have ended is killed
WAITING = 5.0  # time by the clock that reading may take, for the processor time that it may take
_FORWARDED = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
_WINDOWS_ERRORS = 0xC0000000  # and above: what Windows ends processes with

_notes: int | None = None  # file descriptor that tells the process that waits what is being done
_expendable = False  # whether another process waits for this one, and says how it ended


@contextmanager
def interrupts_held() -> Iterator[None]:
    """Let signals with handlers in Python, such as that of Ctrl-C, wait until the block is done.

    In other threads than the main one nothing has to be done: handlers do not run there.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    pending: list[int] = []
    handlers: dict[int, Callable[[int, FrameType | None], object]] = {}
    try:
        for number in signal.valid_signals():
            handler = signal.getsignal(number)
            if callable(handler) and not isinstance(handler, signal.Handlers):
                handlers[number] = handler
                signal.signal(number, lambda number, _frame: pending.append(number))
        yield
    finally:
        for held, handler in handlers.items():
            signal.signal(held, handler)
        for arrived in dict.fromkeys(pending):
            signal.raise_signal(arrived)


def let_interrupts_end_the_process() -> None:
    """Let Ctrl-C and requests to end do so at once from now on.

    The loop of a window runs in a library, where handlers in Python would wait until the window is closed.
    """
    for number in _FORWARDED:
        signal.signal(number, signal.SIG_DFL)


@contextmanager
def doing(activity: str) -> Iterator[None]:
    """Tell the process that waits what is being done in the block, such as ``reading scan.ply``."""
    _write_note(activity)
    try:
        yield
    finally:
        _write_note("")


@contextmanager
def time_limited(seconds: float) -> Iterator[None]:
    """End this process, if another one waits for it, when the block takes more processor time than this.

    So it does after `WAITING` times as long by the clock: compiled code may also wait, for a pipe that nobody writes
    to. Neither can be stopped in any other way.
    """
    if not _expendable or not hasattr(signal, "setitimer"):
        yield
        return
    # SIGPROF and SIGALRM end a process that does not handle them
    limits = {signal.ITIMER_PROF: seconds, signal.ITIMER_REAL: WAITING * seconds}
    for timer, limit in limits.items():
        signal.setitimer(timer, limit)
    try:
        yield
    finally:
        for timer in limits:
            signal.setitimer(timer, 0.0)


@contextmanager
def memory_limited(file_size: int) -> Iterator[None]:
    """Let allocations fail, with MemoryError, that no file of this size can need; only on Linux, else no limit.

    The limit is that of the whole process, so nothing else should be going on in it.
    """
    used = _data_size()
    if resource is None or used is None:
        yield
        return
    before = resource.getrlimit(resource.RLIMIT_DATA)
    limit = used + ALLOWANCE + PER_BYTE * file_size
    ceilings = [value for value in before if value != resource.RLIM_INFINITY]
    resource.setrlimit(resource.RLIMIT_DATA, (min([limit, *ceilings]), before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, before)


def _data_size() -> int | None:
    """Bytes of writable memory of this process that RLIMIT_DATA counts, or None if the system does not tell."""
    try:
        lines = Path("/proc/self/status").read_text(encoding="ascii", errors="replace").splitlines()
    except OSError:
        return None
    return next((1024 * int(line.split()[1]) for line in lines if line.startswith("VmData:")), None)


def this_process_is_expendable() -> None:
    """Note that another process waits for this one, and says how it ended."""
    global _expendable
    _expendable = True


def python_command(code: str) -> list[str]:
    """Command of another interpreter that runs code, with the modules of this one and not those of the folder."""
    return [sys.executable, "-c", f"import sys; sys.path[:] = {sys.path!r}; {code}"]


def run_supervised(code: str, *arguments: str) -> tuple[int, str]:
    """Run code, which calls `serve`, in a child process; return its exit status and why it failed.

    Interrupts and requests to end are passed on. The first one ends the work in order, so that temporary files go
    away; a second one, or `GRACE` seconds, end it at once. If this process is killed, the child ends, too. The caller
    prints the reason, a line, because a process that a bad file was read in may not be able to; the status is `FAILED`
    then.
    """
    reading, writing = os.pipe()
    # Signals wait until both processes are ready for them; the child begins with this mask.
    masks = hasattr(signal, "pthread_sigmask")
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, _FORWARDED) if masks else set()
    if PARENT in os.environ:  # one of our own processes has started this one
        end_with_parent(int(os.environ[PARENT]))
    variables = variables_of_child()
    with open(reading, "rb") as notes:
        # The standard input carries the notes on every system, unless a mesh comes through it.
        if pipe := "-" in arguments and os.name == "posix":
            variables[_NOTES] = str(writing)
        try:
            child = subprocess.Popen(
                [*python_command(code), *arguments],
                stdin=None if pipe else writing,
                pass_fds=(writing,) if pipe else (),
                env=variables,
            )
        finally:
            os.close(writing)

        asked: list[tuple[int, float]] = []  # signals and their times
        timers: list[threading.Timer] = []
        killed = threading.Event()

        def kill() -> None:
            killed.set()
            child.kill()

        def forward(number: int, _frame: FrameType | None) -> None:
            now = time.monotonic()
            if os.name == "posix":  # elsewhere the console tells all its processes
                child.send_signal(number)
            asked.append((number, now))
            # The child ends itself in time, unless what it runs stops all of its threads.
            if len(asked) == 1 or now - asked[0][1] > REPEAT:
                timers.append(threading.Timer(_MARGIN if timers else GRACE + _MARGIN, kill))
                timers[-1].start()

        handled = [number for number in _FORWARDED if signal.getsignal(number) != signal.SIG_IGN]  # as nohup sets it
        before = {number: signal.signal(number, forward) for number in handled}
        try:
            if masks:
                signal.pthread_sigmask(signal.SIG_SETMASK, mask)
            said = notes.read()  # until the child ends
            status = child.wait()
            return (128 + asked[0][0], "") if killed.is_set() else end_of(status, said)
        finally:
            for timer in timers:
                timer.cancel()
            for number, handler in before.items():
                signal.signal(number, handler)


def end_of(status: int, notes: bytes) -> tuple[int, str]:
    """Exit status for the user, and why it failed, of a child that ended with a status and has sent notes."""
    *_, note, _ = [b"", *notes.split(b"\0")]  # the last whole one
    text = note.decode("utf-8", "replace")
    if 0 <= status < _WINDOWS_ERRORS:
        return status, text if status == FAILED else ""
    if -status in _FORWARDED:
        return 128 - status, ""
    return FAILED, crash_message(status, text)


def crash_message(status: int, activity: str = "") -> str:
    """Say in plain words that a process was ended, with this exit status, and what may help.

    >>> crash_message(-signal.SIGSEGV, "reading scan.obj")  # doctest: +ELLIPSIS
    'crashed (SIGSEGV) while reading scan.obj: the file is damaged in a way that its reader does not notice; ...'
    """
    name = signal.Signals(-status).name if status < 0 else f"exit status {status:#x}"
    where = f" while {activity}" if activity else ""
    if name == "SIGKILL":
        return f"was killed (SIGKILL){where}, perhaps for want of memory; nothing was written"
    if name == "SIGPROF":
        return f"took too long{where}: the file is damaged, and its reader runs in circles; nothing was written"
    if name == "SIGALRM":
        return f"took too long{where}: its reader waits, perhaps for another file that it names; nothing was written"
    place = f"crashed ({name}){where}"
    if activity.startswith("reading"):
        return (
            f"{place}: the file is damaged in a way that its reader does not notice; nothing was written. Write the "
            "file again, or convert it to PLY with another program"
        )
    if activity.startswith("writing"):
        return f"{place}: see whether the disk is full; a file that was there before is as it was"
    return f"{place}; nothing was written. Please report it with the file"


def serve(work: Callable[[], str]) -> None:
    """Do the work of a child process, which returns why it failed, or "", and end that process."""
    global _notes
    given = int(os.environ.pop(_NOTES, 0))
    _notes = os.dup(given)  # which processes that this one starts do not get
    os.dup2(os.open(os.devnull, os.O_RDONLY), given)
    this_process_is_expendable()
    end_on_signals(*_FORWARDED)
    end_with_parent(int(os.environ.pop(PARENT, os.getppid())))
    os._exit(_exit_status_of(work))  # without the ends of libraries, which may crash after a damaged file


def _exit_status_of(work: Callable[[], str]) -> int:
    """Let signals in again, do the work and leave its reason; return the status to exit with."""
    try:
        if hasattr(signal, "pthread_sigmask"):
            signal.pthread_sigmask(signal.SIG_UNBLOCK, _FORWARDED)
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
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError, ValueError):  # closed, or the reader of a pipe has gone away
                if stream is not None:
                    stream.flush()


def _write_note(text: str) -> None:
    if _notes is not None:
        with suppress(OSError):  # nobody waits any more
            os.write(_notes, text.encode("utf-8", "backslashreplace") + b"\0")
