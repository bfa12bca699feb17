"""Parallel loops of compiled kernels over vertices, with progress and cancellation.

The kernels release the interpreter lock, so that Python threads run them in parallel, without numba's threading layers.
This is thread-safe and fork-safe, and results do not depend on the number of threads.
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

# ``progress(done, total)`` is called at intervals; returning False cancels
Progress = Callable[[int, int], bool | None]

RangeTask = Callable[[int, int], object]  # ``task(start, stop)`` computes a range of vertices

Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")

THREADS_VARIABLE = "BEZIER_FILTERS_THREADS"
# bounds on the number of vertices per chunk, and the number of chunks per thread within them
MIN_CHUNK, MAX_CHUNK, CHUNKS_PER_THREAD = 4096, 16384, 32
MAX_HELPER_THREADS = 256  # in addition to the calling one
_threads: ContextVar[int | None] = ContextVar("threads", default=None)  # of the current call
_lock, _limits = Lock(), list[Any]()  # of the current calls; the first one limits the threads of BLAS


def runs_on_threads(function: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
    """Decorate a public function: its loops run on `threads` threads, an argument of it, and BLAS on one."""

    @wraps(function)
    def run(*args: Parameters.args, **kwargs: Parameters.kwargs) -> Result:
        threads, progress = kwargs.get("threads"), kwargs.get("progress")  # type: Any, Any
        if not (progress is None or callable(progress)):
            raise InvalidParameterError(f"progress: got {progress!r}, expected a function of two numbers, or None")
        with use_threads(threads), single_threaded_blas():
            return function(*args, **kwargs)

    return run


@contextmanager
def use_threads(threads: int | None = None) -> Iterator[None]:
    """Set the number of threads of loops inside the block; by default that of the outer block, or `usable_threads`."""
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
    """Number of threads of loops: that of the innermost block of `use_threads`, else 1."""
    return _threads.get() or 1


def usable_threads() -> int:
    """Default number of threads: BEZIER_FILTERS_THREADS, else the number of usable cores."""
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
    """Cover range(total) with calls ``kernel(*arguments, start, stop)`` of a kernel without scratch arrays."""
    run_in_chunks(lambda: partial(kernel, *arguments), total, progress=progress, chunk=chunk)


def run_in_chunks(
    make_task: Callable[[], RangeTask], total: int, *, progress: Progress | None = None, chunk: int | None = None
) -> None:
    """Cover range(total) with chunks, long enough to hide the overhead, short enough to balance and to cancel.

    `make_task` is called once per thread, so that each task may own scratch arrays; the calling thread comes first.
    Loops inside a task run on one thread, unless it is the only task. Progress is reported in the calling thread after
    each of its chunks; on cancellation, current chunks are completed first.
    """
    threads = thread_count()
    chunk = chunk or max(MIN_CHUNK, min(total // (CHUNKS_PER_THREAD * threads), MAX_CHUNK))
    if 0 < total <= chunk:  # one chunk: for small meshes the code below would take as long as the loop
        make_task()(0, total)
        report(progress, total, total)
        return
    each = max(1, -(-total // (chunk * threads)))  # chunks per thread, all of equal size
    chunk = min(chunk, max(1, -(-total // (each * threads))))
    starts = iter(range(0, total, chunk))  # shared by the threads: next() on a range iterator is atomic
    threads = max(1, min(threads, -(-total // chunk)))
    done = [0] * threads

    def work(thread: int, task: RangeTask) -> None:
        try:
            if thread >= usable_threads():
                check_blas_memory()  # the first ones have reserved buffers
            for start in starts:
                stop = min(start + chunk, total)
                task(start, stop)
                done[thread] += stop - start
                if thread == 0:
                    report(progress, sum(done), total)
        except BaseException:
            for _ in starts:  # exhausted, so that no thread starts another chunk
                pass
            raise

    if threads == 1:
        work(0, make_task())
        return
    work_alone = use_threads(1)(work)
    helpers = list[Future[None]]()
    try:
        for thread in range(1, threads):
            helpers.append(_pool().submit(work_alone, thread, make_task()))
        work_alone(0, make_task())
    except BaseException:
        for _ in starts:  # an interrupt may come before all threads have work
            pass
        raise
    finally:
        # Helpers that have not started are cancelled: all threads of the pool may be busy.
        begun = [helper for helper in helpers if not helper.cancel()]
        wait(begun)
    for helper in begun:
        helper.result()
    report(progress, total, total)


@cache
def _pool() -> ThreadPoolExecutor:
    """Pool of helper threads, which are kept: starting one takes as long as a short loop."""
    return ThreadPoolExecutor(MAX_HELPER_THREADS, thread_name_prefix="bezier_filters")


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_pool.cache_clear)  # threads do not survive a fork
    os.register_at_fork(before=_lock.acquire, after_in_parent=_lock.release, after_in_child=_lock.release)


def report(progress: Progress | None, done: int, total: int) -> None:
    """Call the progress callback; raise `CancelledError` if it returns False."""
    if progress is not None and progress(done, total) is False:
        raise CancelledError("cancelled by the progress callback; nothing was changed")


@contextmanager
def single_threaded_blas() -> Iterator[None]:
    """Limit BLAS to one thread inside the block: for small matrices synchronisation takes longer than the work.

    The limit applies to the whole process until the last of several concurrent blocks ends.
    """
    with _lock:
        _limits.append(None if _limits else _change_blas_limit(lambda: _blas().limit(limits=1, user_api="blas")))
    try:
        yield
    finally:
        with _lock:
            limit = _limits.pop() if len(_limits) == 1 else _limits.pop(1)
            if limit is not None:
                _change_blas_limit(limit.restore_original_limits)


def _change_blas_limit(change: Callable[[], Result]) -> Result:
    """Change the limit of BLAS from any thread; threadpoolctl 3.7 accepts only the first thread that did so."""
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
    """Controller of the BLAS libraries of NumPy and SciPy; finding them takes some milliseconds."""
    import scipy.linalg  # noqa: F401  # loads its own BLAS
    from threadpoolctl import ThreadpoolController

    found = ThreadpoolController()
    libraries = [library["filepath"] for library in found.info() if library["internal_api"] == "openblas"]
    reserve_blas_memory(libraries, usable_threads())
    return found


@contextmanager
def single_threaded_openmp() -> Iterator[None]:
    """Limit OpenMP to one thread inside the block: a forked process would wait forever for threads it does not have."""
    from threadpoolctl import threadpool_limits

    with threadpool_limits(limits=1, user_api="openmp"):
        yield
