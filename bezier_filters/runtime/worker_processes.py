"""Runs jobs in a few processes; a job that fails, or ends its process, costs nothing but itself."""

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
from bezier_filters.runtime.process_end import GRACE, end_on_signals, end_with_parent
from bezier_filters.runtime.supervision import crash_message, this_process_is_expendable

Job = TypeVar("Job")

_SPAWN = multiprocessing.get_context("spawn")  # a forked copy of threads and compiled kernels may hang
# seconds that workers have to end in order, and after which they are killed: all within those of this process
_OF_WORKERS, _PATIENCE = GRACE / 2.0, GRACE * 0.75


@dataclass(frozen=True)
class Outcome:
    """What became of a job: what the function returned or, in one line, why it failed."""

    result: Any
    error: str
    seconds: float


def run_in_processes(
    function: Callable[[Job], object], jobs: Sequence[Job], *, processes: int, threads: int = 1
) -> Generator[tuple[int, Outcome], None, None]:
    """Call a function for every job, each in one of a few processes.

    It is found by its name in a module, and jobs and results go through pipes. BEZIER_FILTERS_THREADS comes before the
    threads of each worker. Outcomes come as they finish, after the index of the job.

    A worker that dies, for example because a library aborts on a damaged file, is replaced. When the iterator is
    closed or an exception such as KeyboardInterrupt goes through it, the workers are ended.

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
                    result, error = None, last_words(worker.process.exitcode or 0)
                yield index, Outcome(result, error, time.perf_counter() - start)
    finally:
        workers = [*idle, *(worker for worker, _, _ in busy.values())]
        for worker in workers:
            worker.process.terminate()
        end = time.monotonic() + _PATIENCE
        for worker in workers:
            worker.process.join(max(0.0, end - time.monotonic()))
            worker.process.kill()  # hung in a library
            worker.process.join()


@dataclass(frozen=True)
class _Worker:
    process: SpawnProcess
    connection: Connection  # of its own: pools with one pipe for all are lost with an idle worker that is killed


def last_words(status: int) -> str:
    """How a process ended that had this exit status."""
    if status < 0:
        return f"the process that worked on it {crash_message(status, 'reading it')}"
    return f"the process that worked on it was ended with exit status {status}"


def _start(function: Callable[[Job], object], threads: int) -> _Worker:
    ours, theirs = _SPAWN.Pipe()
    process = _SPAWN.Process(target=_serve, args=(function, theirs, threads, os.getpid()), daemon=True)
    process.start()
    theirs.close()  # only the worker holds this end now, so that its death is noticed
    return _Worker(process, ours)


def _serve(function: Callable[[Job], object], connection: Connection, threads: int, parent: int) -> None:
    """What a worker does: answer every job with a result and an error."""
    this_process_is_expendable()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent ends its workers itself,
    end_on_signals(signal.SIGTERM, grace=_OF_WORKERS)  # in order: nothing is left half written
    end_with_parent(parent)
    os.environ.setdefault(THREADS_VARIABLE, str(threads))
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # libraries print there, and the parent's output may be JSON
    while True:
        try:
            job = connection.recv()
        except EOFError:  # the parent is gone
            return
        try:
            connection.send((function(job), ""))
        except Exception as error:
            connection.send((None, " ".join(str(error).split()) or type(error).__name__))
