"""Steps that have to be done whole, where Ctrl-C waits, and loops in libraries, which it has to end."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType


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


@contextmanager
def interrupts_end_the_process() -> Iterator[None]:
    """Let Ctrl-C and requests to end do so at once, in the main thread.

    The loop of a window runs in a library, where handlers in Python would wait until the window is closed.
    """
    numbers = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
    before = {number: signal.signal(number, signal.SIG_DFL) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
