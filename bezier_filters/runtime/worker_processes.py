"""Pool of worker processes in which a job that fails, or crashes its process, affects no other job."""

import multiprocessing
import os
import signal
import time
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from typing import Any, TypeVar

from bezier_filters.runtime.parallel import THREADS_VARIABLE
from bezier_filters.runtime.process_end import GRACE_SECONDS, end_on_signals, end_with_parent
from bezier_filters.runtime.supervision import crash_message, mark_expendable

Job = TypeVar("Job")

_SPAWN = multiprocessing.get_context("spawn")  # a fork with threads may deadlock
# time for an orderly end of workers, and time after which they are killed: both within the grace period of this process
_WORKER_GRACE_SECONDS, _WORKER_KILL_SECONDS = GRACE_SECONDS / 2.0, GRACE_SECONDS * 0.75


@dataclass(frozen=True)
class Outcome:
    """Result of a job, or the reason of its failure in one line."""

    result: Any
    error: str
    seconds: float


def run_in_processes(
    function: Callable[[Job], object], jobs: Sequence[Job], *, processes: int, threads: int = 1
) -> Generator[tuple[int, Outcome], None, None]:
    """Call a function for every job, each in one of a few processes.

    The function must be importable by name; jobs and results are pickled. BEZIER_FILTERS_THREADS overrides `threads`,
    the number of threads per worker. Yields the index and the outcome of each job, in order of completion.

    A worker that dies, for example because a library aborts on a damaged file, is replaced. Closing the iterator, or an
    exception such as KeyboardInterrupt inside it, ends the workers.

    >>> outcomes = dict(run_in_processes(abs, [-1, "x"], processes=1))
    >>> outcomes[0].result, outcomes[1].error
    (1, "bad operand type for abs(): 'str'")
    """
    waiting = list(enumerate(jobs))[::-1]
    idle: list[_Worker] = []
    busy: dict[object, tuple[_Worker, int, float]] = {}  # by the connection
    try:
        while waiting or busy:
            idle = [worker for worker in idle if worker.process.is_alive()]
            while waiting and len(busy) < processes:
                worker = idle.pop() if idle else _start(function, threads)
                index, job = waiting.pop()
                worker.connection.send(job)
                busy[worker.connection] = (worker, index, time.perf_counter())
            for connection in wait([worker.connection for worker, _, _ in busy.values()]):
                worker, index, start = busy.pop(connection)
                try:
                    result, error = worker.connection.recv()
                    idle.append(worker)
                except (EOFError, OSError):
                    worker.process.join()
                    result, error = None, describe_exit(worker.process.exitcode or 0)
                yield index, Outcome(result, error, time.perf_counter() - start)
    finally:
        workers = [*idle, *(worker for worker, _, _ in busy.values())]
        for worker in workers:
            worker.process.terminate()
        end = time.monotonic() + _WORKER_KILL_SECONDS
        for worker in workers:
            worker.process.join(max(0.0, end - time.monotonic()))
            worker.process.kill()  # if it hangs in a library
            worker.process.join()


@dataclass(frozen=True)
class _Worker:
    process: SpawnProcess
    connection: Connection  # one per worker: a pipe shared by all breaks when an idle worker is killed


def describe_exit(status: int) -> str:
    """Message for a worker that ended with an exit status."""
    if status < 0:
        return f"the process that worked on it {crash_message(status, 'reading it')}"
    return f"the process that worked on it was ended with exit status {status}"


def _start(function: Callable[[Job], object], threads: int) -> _Worker:
    ours, theirs = _SPAWN.Pipe()
    process = _SPAWN.Process(target=_serve, args=(function, theirs, threads, os.getpid()), daemon=True)
    process.start()
    theirs.close()  # only the worker holds this end, so that its death closes the pipe
    return _Worker(process, ours)


def _serve(function: Callable[[Job], object], connection: Connection, threads: int, parent: int) -> None:
    """Loop of a worker: answer each job with a result and an error."""
    mark_expendable()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent ends its workers itself
    end_on_signals(signal.SIGTERM, grace=_WORKER_GRACE_SECONDS)  # orderly, so that no file is half written
    end_with_parent(parent)
    os.environ.setdefault(THREADS_VARIABLE, str(threads))
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # libraries print there, and the parent's output may be JSON
    while True:
        try:
            job = connection.recv()
        except EOFError:  # the parent has ended
            return
        try:
            connection.send((function(job), ""))
        except Exception as error:
            connection.send((None, " ".join(str(error).split()) or type(error).__name__))
