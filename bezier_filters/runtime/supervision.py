"""Supervision: the command line runs in a child process, so that crashes and endless loops end only the child.

Readers of damaged mesh files may crash. The process that the user started therefore only starts another interpreter,
waits for it, and reports in plain words how it ended. Signals end the work in an orderly way, wait during steps that
must be completed, or end the process at once during the event loop of a library.
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
    GRACE_SECONDS,
    PARENT_VARIABLE,
    REPEAT_SECONDS,
    child_environment,
    end_on_signals,
    end_with_parent,
)

try:
    import resource
except ImportError:  # Windows
    resource = None  # type: ignore[assignment]

EXIT_INCOMPLETE = 3  # exit status of completed work whose result needs attention
EXIT_FAILED = 2  # exit status of failed work, and of a process that crashed
# Memory that reading a file may take: a constant plus a multiple of the file size. A vertex of ten characters takes
# some five hundred bytes in a mesh with all attributes, and compressed files expand tenfold.
MIN_READ_BYTES = 1 << 30
READ_BYTES_PER_FILE_BYTE = 500
# file descriptor of the pipe to the supervisor, if that is not the standard input; a child removes the variable from
# its environment at once
_NOTES_VARIABLE = "BEZIER_FILTERS_NOTES"
_KILL_DELAY_SECONDS = 0.5  # after the grace period
WALL_TIME_FACTOR = 5.0  # limit on the wall time of reading over that on its processor time
_FORWARDED = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
_WINDOWS_ERRORS = 0xC0000000  # smallest exit status of a crash on Windows

_notes: int | None = None  # file descriptor for notes on the current activity to the supervisor
_expendable = False  # whether a supervisor waits for this process and reports how it ended


@contextmanager
def hold_interrupts() -> Iterator[None]:
    """Defer signals with Python handlers, such as that of Ctrl-C, until the block ends.

    Only in the main thread: handlers do not run in others.
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
        for deferred, handler in handlers.items():
            signal.signal(deferred, handler)
        for arrived in dict.fromkeys(pending):
            signal.raise_signal(arrived)


def restore_default_interrupts() -> None:
    """Restore the default handlers of Ctrl-C and termination signals, which end the process at once.

    The event loop of a window runs in a library, where Python handlers would wait until the window is closed.
    """
    for number in _FORWARDED:
        signal.signal(number, signal.SIG_DFL)


@contextmanager
def note_activity(activity: str) -> Iterator[None]:
    """Report the activity of the block, such as ``reading scan.ply``, to the supervisor."""
    _write_note(activity)
    try:
        yield
    finally:
        _write_note("")


@contextmanager
def limit_time(seconds: float) -> Iterator[None]:
    """End this process, if it is supervised, when the block exceeds a limit on its processor time.

    The limit on the wall time is `WALL_TIME_FACTOR` times as long: compiled code may also wait, for a pipe without a
    writer. Neither can be stopped in another way.
    """
    if not _expendable or not hasattr(signal, "setitimer"):
        yield
        return
    # SIGPROF and SIGALRM end a process without handlers for them
    limits = {signal.ITIMER_PROF: seconds, signal.ITIMER_REAL: WALL_TIME_FACTOR * seconds}
    for timer, limit in limits.items():
        signal.setitimer(timer, limit)
    try:
        yield
    finally:
        for timer in limits:
            signal.setitimer(timer, 0.0)


@contextmanager
def limit_memory(file_size: int) -> Iterator[None]:
    """Let allocations beyond the needs of a file of this size fail with MemoryError; only on Linux.

    The limit applies to the whole process, so that nothing else should run in it.
    """
    used = _data_size()
    if resource is None or used is None:
        yield
        return
    before = resource.getrlimit(resource.RLIMIT_DATA)
    limit = used + MIN_READ_BYTES + READ_BYTES_PER_FILE_BYTE * file_size
    ceilings = [value for value in before if value != resource.RLIM_INFINITY]
    resource.setrlimit(resource.RLIMIT_DATA, (min([limit, *ceilings]), before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, before)


def _data_size() -> int | None:
    """Bytes of writable memory of this process that RLIMIT_DATA counts, or None if it is unknown."""
    try:
        lines = Path("/proc/self/status").read_text(encoding="ascii", errors="replace").splitlines()
    except OSError:
        return None
    return next((1024 * int(line.split()[1]) for line in lines if line.startswith("VmData:")), None)


def mark_expendable() -> None:
    """Mark this process as supervised: another process waits for it and reports how it ended."""
    global _expendable
    _expendable = True


def python_command(code: str) -> list[str]:
    """Command of another interpreter that runs code with the module path of this one."""
    return [sys.executable, "-c", f"import sys; sys.path[:] = {sys.path!r}; {code}"]


def run_supervised(code: str, *arguments: str) -> tuple[int, str]:
    """Run code, which calls `serve`, in a child process; return its exit status and the reason of a failure.

    Interrupts and termination signals are forwarded. The first one ends the work in an orderly way, so that temporary
    files are removed; a second one, or `GRACE_SECONDS`, end it at once. If this process is killed, the child ends, too.
    The caller prints the reason, one line, as a process that has read a bad file may be unable to; the status is
    `EXIT_FAILED` then.
    """
    reading, writing = os.pipe()
    # Signals are blocked until both processes can handle them; the child inherits this mask.
    masks = hasattr(signal, "pthread_sigmask")
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, _FORWARDED) if masks else set()
    if PARENT_VARIABLE in os.environ:  # this process was started by one of ours
        end_with_parent(int(os.environ[PARENT_VARIABLE]))
    variables = child_environment()
    with open(reading, "rb") as notes:
        # The standard input carries the notes on every system, unless it carries a mesh.
        if pipe := "-" in arguments and os.name == "posix":
            variables[_NOTES_VARIABLE] = str(writing)
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
            if os.name == "posix":  # elsewhere the console signals all its processes
                child.send_signal(number)
            asked.append((number, now))
            # The child ends itself in time, unless a library blocks all its threads.
            if len(asked) == 1 or now - asked[0][1] > REPEAT_SECONDS:
                timers.append(
                    threading.Timer(_KILL_DELAY_SECONDS if timers else GRACE_SECONDS + _KILL_DELAY_SECONDS, kill)
                )
                timers[-1].start()

        handled = [number for number in _FORWARDED if signal.getsignal(number) != signal.SIG_IGN]  # ignored by nohup
        before = {number: signal.signal(number, forward) for number in handled}
        try:
            if masks:
                signal.pthread_sigmask(signal.SIG_SETMASK, mask)
            received = notes.read()  # until the child ends
            status = child.wait()
            return (128 + asked[0][0], "") if killed.is_set() else child_exit(status, received)
        finally:
            for timer in timers:
                timer.cancel()
            for number, handler in before.items():
                signal.signal(number, handler)


def child_exit(status: int, notes: bytes) -> tuple[int, str]:
    """Exit status for the user, and the reason of a failure, from the status and the notes of a child."""
    *_, note, _ = [b"", *notes.split(b"\0")]  # the last complete one
    text = note.decode("utf-8", "replace")
    if 0 <= status < _WINDOWS_ERRORS:
        return status, text if status == EXIT_FAILED else ""
    if -status in _FORWARDED:
        return 128 - status, ""
    return EXIT_FAILED, crash_message(status, text)


def crash_message(status: int, activity: str = "") -> str:
    """Message in plain words for a process that crashed with an exit status, with advice.

    >>> crash_message(-signal.SIGSEGV, "reading scan.obj")  # doctest: +ELLIPSIS
    'crashed (SIGSEGV) while reading scan.obj: the file is damaged in a way that its reader does not notice; ...'
    """
    name = signal.Signals(-status).name if status < 0 else f"exit status {status:#x}"
    during = f" while {activity}" if activity else ""
    if name == "SIGKILL":
        return f"was killed (SIGKILL){during}, perhaps for want of memory; nothing was written"
    if name == "SIGPROF":
        return f"took too long{during}: the file is damaged, and its reader runs in circles; nothing was written"
    if name == "SIGALRM":
        return f"took too long{during}: its reader waits, perhaps for another file that it names; nothing was written"
    place = f"crashed ({name}){during}"
    if activity.startswith("reading"):
        return (
            f"{place}: the file is damaged in a way that its reader does not notice; nothing was written. Write the "
            "file again, or convert it to PLY with another program"
        )
    if activity.startswith("writing"):
        return f"{place}: see whether the disk is full; a file that was there before is as it was"
    return f"{place}; nothing was written. Please report it with the file"


def serve(work: Callable[[], str]) -> None:
    """Do the work of a child process, a function that returns the reason of a failure or "", and end the process."""
    global _notes
    given = int(os.environ.pop(_NOTES_VARIABLE, 0))
    _notes = os.dup(given)  # not inherited by processes that this one starts
    os.dup2(os.open(os.devnull, os.O_RDONLY), given)
    mark_expendable()
    end_on_signals(*_FORWARDED)
    end_with_parent(int(os.environ.pop(PARENT_VARIABLE, os.getppid())))
    os._exit(_exit_status_of(work))  # without exit handlers of libraries, which may crash after a damaged file


def _exit_status_of(work: Callable[[], str]) -> int:
    """Unblock signals, do the work and send its reason; return the exit status."""
    try:
        if hasattr(signal, "pthread_sigmask"):
            signal.pthread_sigmask(signal.SIG_UNBLOCK, _FORWARDED)
        reason = work()
        _write_note(reason)
        return EXIT_FAILED if reason else 0
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else int(end.code is not None)
    except KeyboardInterrupt:
        return 128 + signal.SIGINT
    except BaseException:
        traceback.print_exc()
        return 1
    finally:
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError, ValueError):  # closed, or a pipe without a reader
                if stream is not None:
                    stream.flush()


def _write_note(text: str) -> None:
    if _notes is not None:
        with suppress(OSError):  # the supervisor has ended
            os.write(_notes, text.encode("utf-8", "backslashreplace") + b"\0")
