"""Runs compiled loops over vertices on several threads, with progress and cancellation.

The kernels release the interpreter lock, so plain Python threads run them side by side. That
needs none of numba's threading layers: it is safe to call from several threads at once and
safe to fork, and each vertex is computed by the same operations whatever the thread count.
"""

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from numbers import Integral
from queue import SimpleQueue

from bezier_filters.errors import CancelledError, InvalidParameterError

Progress = Callable[[int, int], bool | None]
"""``progress(done, total)`` is called now and then; returning False cancels."""

RangeTask = Callable[[int, int], None]
"""``task(start, stop)`` computes a range of vertices."""

THREADS_VARIABLE = "BEZIER_FILTERS_THREADS"
CHUNK = 4096


def thread_count(threads: int | None) -> int:
    """Threads to use: the argument, else BEZIER_FILTERS_THREADS, else all usable cores.

    Raises
    ------
    InvalidParameterError
        If the argument or the variable is not a positive integer.
    """
    if threads is None:
        text = os.environ.get(THREADS_VARIABLE)
        if text is None:
            return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
        if not text.isdecimal() or int(text) < 1:
            raise InvalidParameterError(f"{THREADS_VARIABLE}: got {text!r}, expected a positive integer")
        return int(text)
    if not isinstance(threads, Integral) or threads < 1:
        raise InvalidParameterError(f"threads: got {threads!r}, expected 1 or more, or None for all cores")
    return threads


def run_in_chunks(
    make_task: Callable[[], RangeTask],
    total: int,
    *,
    threads: int,
    progress: Progress | None = None,
    chunk: int = CHUNK,
) -> None:
    """Cover range(total) with chunks.

    Parameters
    ----------
    make_task : callable
        Called once per thread; the task it returns may own work space.
    total : int
        Length of the range.
    threads : int
        Number of threads; 1 runs in the calling thread.
    progress : callable, optional
        Called in the calling thread after every few chunks.
    chunk : int
        Length of a chunk: long enough to hide the call, short enough to share and to cancel.

    Raises
    ------
    CancelledError
        If `progress` returned False. Chunks under way are finished first.
    """
    starts = iter(range(0, total, chunk))  # next() on an iterator of ints is atomic: the threads share it
    threads = min(threads, -(-total // chunk))
    if threads <= 1:
        task = make_task()
        for start in starts:
            task(start, min(start + chunk, total))
            _report(progress, min(start + chunk, total), total)
        return

    finished: SimpleQueue[int] = SimpleQueue()  # lengths of chunks; 0 for a thread

    def work_through(task: RangeTask) -> None:
        try:
            for start in starts:
                stop = min(start + chunk, total)
                task(start, stop)
                finished.put(stop - start)
        finally:
            _exhaust(starts)  # after an error
            finished.put(0)

    with ThreadPoolExecutor(threads) as pool:
        futures = [pool.submit(work_through, make_task()) for _ in range(threads)]
        working, done = threads, 0
        try:
            while working:
                length = finished.get()
                working -= length == 0
                done += length
                if length:
                    _report(progress, done, total)
        finally:
            _exhaust(starts)  # after cancelling
        for future in futures:
            future.result()


def _exhaust(starts: Iterator[int]) -> None:
    """Leave nothing to begin with."""
    for _ in starts:
        pass


def _report(progress: Progress | None, done: int, total: int) -> None:
    if progress is not None and progress(done, total) is False:
        raise CancelledError("cancelled by the progress callback; nothing was changed")
