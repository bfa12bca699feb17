"""Runs compiled loops over vertices on several threads, with progress and cancellation.

The kernels release the interpreter lock, so plain Python threads run them side by side. That
needs none of numba's threading layers: it is safe to call from several threads at once and
safe to fork, and each vertex is computed by the same operations whatever the thread count.
"""

import os
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache, partial, wraps
from threading import Lock
from typing import Any, ParamSpec, TypeVar

from bezier_filters.errors import CancelledError, InvalidParameterError, is_integer
from bezier_filters.runtime.blas_memory import check_blas_memory, reserve_blas_memory

# ``progress(done, total)`` is called now and then; returning False cancels
Progress = Callable[[int, int], bool | None]

RangeTask = Callable[[int, int], object]  # ``task(start, stop)`` computes a range of vertices

Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")

THREADS_VARIABLE = "BEZIER_FILTERS_THREADS"
# vertices per chunk, at least and at most; in between so that each thread has about so many chunks
CHUNK, LONGEST, PER_THREAD = 4096, 16384, 32
MOST_THREADS = 256  # beside the calling one
_threads: ContextVar[int | None] = ContextVar("threads", default=None)  # of the call under way
_lock, _limits = Lock(), list[Any]()  # of the calls under way, the first of which limits the threads of BLAS


def on_threads(function: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
    """Let the loops of a public function run on as many threads as its argument `threads` says, matrices on one."""

    @wraps(function)
    def run(*args: Parameters.args, **kwargs: Parameters.kwargs) -> Result:
        threads, progress = kwargs.get("threads"), kwargs.get("progress")  # type: Any, Any
        if not (progress is None or callable(progress)):
            raise InvalidParameterError(f"progress: got {progress!r}, expected a function of two numbers, or None")
        with use_threads(threads), one_thread_for_matrices():
            return function(*args, **kwargs)

    return run


@contextmanager
def use_threads(threads: int | None = None) -> Iterator[None]:
    """Let loops inside the block run on so many threads, by default on those of a block around, or `usable_threads`."""
    if threads is None:
        threads = _threads.get() or usable_threads()
    elif not is_integer(threads) or threads < 1:
        raise InvalidParameterError(f"threads: got {threads!r}, expected 1 or more, or None for all cores")
    token = _threads.set(threads)
    try:
        yield
    finally:
        _threads.reset(token)


def thread_count() -> int:
    """Threads that loops run on: those of the innermost block of `use_threads`, and 1 without any."""
    return _threads.get() or 1


def usable_threads() -> int:
    """BEZIER_FILTERS_THREADS, else all usable cores."""
    text = os.environ.get(THREADS_VARIABLE)
    if text is None:
        return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    if not text.isdecimal() or int(text) < 1:
        raise InvalidParameterError(f"{THREADS_VARIABLE}: got {text!r}, expected a positive integer")
    return int(text)


def run_kernel(
    kernel: Callable[..., object],
    total: int,
    *arguments: object,
    progress: Progress | None = None,
    chunk: int | None = None,
) -> None:
    """Cover range(total) with calls ``kernel(*arguments, start, stop)``, for what needs no work space of its own."""
    run_in_chunks(lambda: partial(kernel, *arguments), total, progress=progress, chunk=chunk)


def run_in_chunks(
    make_task: Callable[[], RangeTask], total: int, *, progress: Progress | None = None, chunk: int | None = None
) -> None:
    """Cover range(total) with chunks, long enough to hide the call, short enough to share and to cancel.

    `make_task` is called once per thread, the calling one being the first: a task may own work space. Loops of a task
    run on one thread, unless it is the only one. The progress is told in the calling thread after each of its chunks;
    if that cancels, chunks under way are finished first.
    """
    threads = thread_count()
    chunk = chunk or max(CHUNK, min(total // (PER_THREAD * threads), LONGEST))
    if 0 < total <= chunk:  # nothing to share: many loops over small meshes take no longer than all that is below
        make_task()(0, total)
        report(progress, total, total)
        return
    each = max(1, -(-total // (chunk * threads)))  # chunks for every thread, lest it wait for the last one of another
    chunk = min(chunk, max(1, -(-total // (each * threads))))
    starts = iter(range(0, total, chunk))  # next() on an iterator of ints is atomic: the threads share it
    threads = max(1, min(threads, -(-total // chunk)))
    done = [0] * threads

    def work(thread: int, task: RangeTask) -> None:
        try:
            if thread >= usable_threads():
                check_blas_memory()  # for others there is room
            for start in starts:
                stop = min(start + chunk, total)
                task(start, stop)
                done[thread] += stop - start
                if thread == 0:
                    report(progress, sum(done), total)
        except BaseException:
            for _ in starts:  # no thread begins another chunk
                pass
            raise

    if threads == 1:
        work(0, make_task())
        return
    work_beside = use_threads(1)(work)
    helpers = list[Future[None]]()
    try:
        for thread in range(1, threads):
            helpers.append(_pool().submit(work_beside, thread, make_task()))
        work_beside(0, make_task())
    except BaseException:
        for _ in starts:  # an interrupt may come before all threads have work
            pass
        raise
    finally:
        # those that have not begun are not needed any more: threads may all be at work for others, or for the caller
        begun = [helper for helper in helpers if not helper.cancel()]
        wait(begun)
    for helper in begun:
        helper.result()
    report(progress, total, total)


@cache
def _pool() -> ThreadPoolExecutor:
    """Threads that wait for work, as many as were ever needed: to start new ones takes as long as a short loop."""
    return ThreadPoolExecutor(MOST_THREADS, thread_name_prefix="bezier_filters")


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_pool.cache_clear)  # threads do not survive a fork
    os.register_at_fork(before=_lock.acquire, after_in_parent=_lock.release, after_in_child=_lock.release)


def report(progress: Progress | None, done: int, total: int) -> None:
    """Tell how far the work has come; raise `CancelledError` if that is answered by False."""
    if progress is not None and progress(done, total) is False:
        raise CancelledError("cancelled by the progress callback; nothing was changed")


@contextmanager
def one_thread_for_matrices() -> Iterator[None]:
    """Around work with small matrices: the threads of BLAS would spend most of their time on waiting for each other.

    The limit holds for the process until the last of several calls at a time has ended, in whatever threads they are.
    """
    with _lock:
        _limits.append(None if _limits else _from_this_thread(lambda: _blas().limit(limits=1, user_api="blas")))
    try:
        yield
    finally:
        with _lock:
            limit = _limits.pop() if len(_limits) == 1 else _limits.pop(1)
            if limit is not None:
                _from_this_thread(limit.restore_original_limits)


def _from_this_thread(change: Callable[[], Result]) -> Result:
    """Change the limit of BLAS; since version 3.7, threadpoolctl ignores all threads but the first that did so."""
    libraries = [library for library in _blas().lib_controllers if hasattr(library, "clear_controlling_thread")]
    for library in libraries:
        library.clear_controlling_thread(force=True)
    try:
        return change()
    finally:
        for library in libraries:
            library.clear_controlling_thread(force=True)


@cache
def _blas() -> Any:
    """The libraries of NumPy and SciPy, which take some milliseconds to find."""
    import scipy.linalg  # noqa: F401  # has one of its own
    from threadpoolctl import ThreadpoolController

    found = ThreadpoolController()
    libraries = [library["filepath"] for library in found.info() if library["internal_api"] == "openblas"]
    reserve_blas_memory(libraries, usable_threads())
    return found


@contextmanager
def one_thread_of_openmp() -> Iterator[None]:
    """Around calls of libraries that share loops among threads of OpenMP: a fork waits for ever for those it lacks."""
    from threadpoolctl import threadpool_limits

    with threadpool_limits(limits=1, user_api="openmp"):
        yield
