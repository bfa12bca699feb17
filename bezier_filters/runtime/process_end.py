"""Termination of a process: orderly on a signal, forced after a grace period, and together with its parent.

Python handles signals between bytecodes, so that compiled code delays them, for minutes or forever. A watcher thread,
which the system notifies of each signal at once, ends the process if its main thread does not.
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

GRACE_SECONDS = 3.0  # for an orderly end
REPEAT_SECONDS = 0.3  # signals that follow sooner are repetitions: terminals signal all processes
PARENT_VARIABLE = "BEZIER_FILTERS_PARENT"  # id of the process with which the receiver of this variable ends
_POLL_SECONDS = 0.5  # between checks for the parent

_temporaries: dict[Path, None] = {}  # files and folders to remove, in order


@contextmanager
def remove_on_exit(path: Path) -> Iterator[None]:
    """Remove a file or folder and its content if the process ends before the block does."""
    _temporaries[path] = None
    try:
        yield
    finally:
        _temporaries.pop(path, None)


def end_on_signals(*numbers: int, grace: float = GRACE_SECONDS) -> None:
    """Let the first of these signals raise SystemExit, or KeyboardInterrupt, and end the process if it does not end.

    It is ended after the grace period or at the next signal: during long calls of a library Python cannot raise.
    Signals that are ignored, as by nohup, stay ignored.
    """
    from socket import socketpair  # not imported in processes that only wait

    asked = False

    def end(number: int, _frame: FrameType | None) -> None:
        nonlocal asked
        if asked:  # cleaning up is not interrupted
            return
        asked = True
        if number == signal.SIGINT:
            raise KeyboardInterrupt
        raise SystemExit(128 + number)

    handled = [number for number in numbers if signal.getsignal(number) != signal.SIG_IGN]
    reading, writing = socketpair()  # set_wakeup_fd accepts sockets on every system
    writing.setblocking(False)
    signal.set_wakeup_fd(writing.detach(), warn_on_full_buffer=False)
    threading.Thread(target=_end_after_signal, args=(reading, frozenset(handled), grace), daemon=True).start()
    for number in handled:
        signal.signal(number, end)


def _end_after_signal(signals: "socket", numbers: frozenset[int], grace: float) -> None:
    """Wait for one of the signals, then for the grace period or a second signal, and end the process."""
    first = 0
    while first not in numbers:
        first = signals.recv(1)[0]
    start = time.monotonic()
    while (rest := start + grace - time.monotonic()) > 0.0 and select.select([signals], [], [], rest)[0]:
        if signals.recv(1)[0] in numbers and time.monotonic() - start > REPEAT_SECONDS:
            break
    _remove_temporaries()
    os._exit(128 + first)


def _remove_temporaries() -> None:
    from shutil import rmtree

    for path in list(_temporaries):
        with suppress(OSError):
            path.unlink() if path.is_file() else rmtree(path)


def child_environment() -> dict[str, str]:
    """Environment of a command ``bezier-filters`` that ends with this process."""
    return {**os.environ, PARENT_VARIABLE: str(os.getpid())}


def end_with_parent(parent: int) -> None:
    """Send SIGTERM to this process when its parent, with this id, has ended for any reason."""
    threading.Thread(target=_end_after_parent, args=(parent,), daemon=True).start()


def _end_after_parent(parent: int) -> None:
    if sys.platform == "win32":
        import _winapi
        from multiprocessing.connection import wait

        wait([_winapi.OpenProcess(_winapi.SYNCHRONIZE, False, parent)])
        os.kill(os.getpid(), signal.SIGTERM)  # on Windows this ends the process at once
    else:
        while os.getppid() == parent:
            time.sleep(_POLL_SECONDS)
        main = threading.main_thread().ident
        if main is not None:
            signal.pthread_kill(main, signal.SIGTERM)  # only a signal to this thread interrupts its system calls
