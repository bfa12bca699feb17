"""How a process ends: when it is asked to, in order if it can, at once if it cannot, and with its parent.

Python handles a signal between two steps of its own, so compiled code makes it wait, for minutes or for ever. A thread
that the system tells of each signal at once therefore ends the process if its main thread does not.
"""

import os
import select
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from socket import socket

GRACE = 3.0  # seconds that a process has to end in order
REPEAT = 0.3  # seconds: signals that follow the first one sooner belong to it, as terminals tell all processes
PARENT = "BEZIER_FILTERS_PARENT"  # variable with the id of the process that the one that gets it shall end with
_POLL = 0.5  # seconds between looks for the parent

_temporaries: dict[Path, None] = {}  # files and folders of this process that are to go away, in order


@contextmanager
def removed_at_last(path: Path) -> Iterator[None]:
    """Remove a file or folder with what is in it, should the process be ended before the block is."""
    _temporaries[path] = None
    try:
        yield
    finally:
        _temporaries.pop(path, None)


def end_on_signals(*numbers: int, grace: float = GRACE) -> None:
    """Let the first of these signals raise SystemExit, or KeyboardInterrupt, and end the process if that is no use.

    That is so many seconds later, or when one comes again: long work of a library does not let Python raise anything.
    Signals that are ignored, as nohup has it, stay so.
    """
    from socket import socketpair  # which the process that only waits does without

    asked = False

    def end(number: int, _frame: FrameType | None) -> None:
        nonlocal asked
        if asked:  # what is being cleaned up is not disturbed
            return
        asked = True
        if number == signal.SIGINT:
            raise KeyboardInterrupt
        raise SystemExit(128 + number)

    handled = [number for number in numbers if signal.getsignal(number) != signal.SIG_IGN]
    reading, writing = socketpair()  # which set_wakeup_fd takes on every system
    writing.setblocking(False)
    signal.set_wakeup_fd(writing.detach(), warn_on_full_buffer=False)
    threading.Thread(target=_end_at_last, args=(reading, frozenset(handled), grace), daemon=True).start()
    for number in handled:
        signal.signal(number, end)


def _end_at_last(signals: "socket", numbers: frozenset[int], grace: float) -> None:
    """Wait for one of some signals, give the process time to end in order, and end it."""
    first = 0
    while first not in numbers:
        first = signals.recv(1)[0]
    start = time.monotonic()
    while (left := start + grace - time.monotonic()) > 0.0 and select.select([signals], [], [], left)[0]:
        if signals.recv(1)[0] in numbers and time.monotonic() - start > REPEAT:
            break
    _remove_temporaries()
    os._exit(128 + first)


def _remove_temporaries() -> None:
    from shutil import rmtree

    for path in list(_temporaries):
        with suppress(OSError):
            path.unlink() if path.is_file() else rmtree(path)


def variables_of_child() -> dict[str, str]:
    """Environment of a command ``bezier-filters`` that shall end with this process."""
    return {**os.environ, PARENT: str(os.getpid())}


def end_with_parent(parent: int) -> None:
    """Send SIGTERM to this process when the one with this id, which started it, is gone, however that ended."""
    threading.Thread(target=_end_after, args=(parent,), daemon=True).start()


def _end_after(parent: int) -> None:
    if sys.platform == "win32":
        import _winapi
        from multiprocessing.connection import wait

        wait([_winapi.OpenProcess(_winapi.SYNCHRONIZE, False, parent)])
        os.kill(os.getpid(), signal.SIGTERM)  # there, an end without any order
    else:
        while os.getppid() == parent:
            time.sleep(_POLL)
        main = threading.main_thread().ident
        if main is not None:
            signal.pthread_kill(main, signal.SIGTERM)  # only a signal to this thread ends what it waits for
