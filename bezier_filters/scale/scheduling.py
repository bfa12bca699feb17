"""Runs tasks, and whole command lines, on any of Dask's schedulers."""

import contextlib
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from functools import partial
from importlib import import_module
from typing import Any, TypeVar

from bezier_filters.errors import CancelledError
from bezier_filters.runtime.parallel import THREADS_VARIABLE, Progress, report
from bezier_filters.runtime.process_end import child_environment, end_with_parent
from bezier_filters.runtime.supervision import EXIT_INCOMPLETE
from bezier_filters.runtime.worker_processes import Outcome, describe_exit
from bezier_filters.scale.clients import (
    Scheduler,
    check_workers,
    import_distributed,
    make_portable,
    missing_module,
    start_workers,
)

Task = TypeVar("Task")
Result = TypeVar("Result")

TASKS_PER_THREAD = 4  # tasks per thread that are submitted ahead, so that no worker idles


class LostTaskError(RuntimeError):
    """A task ended several workers; the message names it and says what to do."""


def run_tasks(
    scheduler: Scheduler,
    function: Callable[[Task], Result],
    tasks: Sequence[Task],
    *,
    workers: int = 1,
    progress: Progress | None = None,
) -> Iterator[Result]:
    """Call a function for every task, on a scheduler from `start_workers`; results come in any order.

    Workers import the function by its name; its first arguments may be bound by `functools.partial`. `workers` is the
    number of concurrent tasks of local schedulers. Tasks of a worker that dies are repeated by another one;
    `LostTaskError` after several deaths.
    """
    report(progress, 0, len(tasks))
    found = (
        _run_local(scheduler, function, tasks, workers)
        if isinstance(scheduler, str)
        else _run_distributed(scheduler, function, tasks)
    )
    for done, result in enumerate(found, start=1):
        yield result
        report(progress, done, len(tasks))


def _run_local(name: str, function: Callable[[Task], Result], tasks: Sequence[Task], workers: int) -> Iterator[Result]:
    """Run tasks on Dask's schedulers for one machine, in batches, as these take a fixed list of tasks."""
    dask: Any = import_module("dask")
    step = workers * TASKS_PER_THREAD
    for first in range(0, len(tasks), step):
        calls = [dask.delayed(function, pure=False)(task) for task in tasks[first : first + step]]
        try:
            # Otherwise the processes of a pool would outlive their parent.
            given = {"initializer": partial(end_with_parent, os.getpid())} if name == "processes" else {}
            yield from dask.compute(*calls, scheduler=name, num_workers=workers, optimize_graph=False, **given)
        except Exception as error:
            if type(error).__name__ == "BrokenProcessPool":  # which task it was shows only in the missing results
                raise LostTaskError(
                    f"a process that worked on one of {list(tasks[first : first + step])} has died; resume to continue"
                ) from error
            raise


def _run_distributed(client: Scheduler, function: Callable[[Task], Result], tasks: Sequence[Task]) -> Iterator[Result]:
    distributed = import_distributed()
    futures = client.map(make_portable(function), tasks, pure=False, key="tile")
    named = {future.key: task for future, task in zip(futures, tasks, strict=True)}
    try:
        for future in distributed.as_completed(futures, loop=client.loop):
            try:
                result = future.result()
            except distributed.KilledWorker as error:
                raise LostTaskError(
                    f"task {named[future.key]} has ended {error.allowed_failures + 1} workers, probably for lack of "
                    "memory: choose smaller tiles, or a higher memory limit"
                ) from error
            except distributed.CancelledError as error:
                raise CancelledError(f"the scheduler gave up task {named[future.key]}: {error}") from error
            except ImportError as error:
                raise missing_module(error, "a worker") from error
            yield result
    finally:
        with contextlib.suppress(Exception):  # the cluster may be gone already
            client.cancel(futures)


def run_on_scheduler(
    jobs: Sequence[Sequence[str]], scheduler: Scheduler, *, workers: int
) -> Generator[tuple[int, Outcome], None, None]:
    """Run command lines on any of Dask's schedulers: `worker_processes.run_in_processes` for several machines.

    Jobs are arguments of ``bezier-filters``; workers must see the files under the same absolute paths. Local schedulers
    run `workers` jobs at a time. Yields the index and the outcome of each job as they finish.
    """
    with start_workers(scheduler, workers=workers, memory_limit=None) as cluster:
        check_workers(ready := cluster.ready())
        yield from run_tasks(ready, run_command_line, list(enumerate(jobs)), workers=workers)


def run_command_line(job: tuple[int, Sequence[str]]) -> tuple[int, Outcome]:
    """Run a command line in a child process of a worker, as libraries may abort on damaged files, or print."""
    index, arguments = job
    start = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-m", "bezier_filters", arguments[0], "--json", *arguments[1:]],
        capture_output=True,
        text=True,
        stdin=subprocess.DEVNULL,
        env={THREADS_VARIABLE: "1", **child_environment()},
        check=False,
    )
    seconds, messages = time.perf_counter() - start, done.stderr.strip().splitlines()
    if done.returncode in (0, EXIT_INCOMPLETE):
        return index, Outcome(json.loads(done.stdout), "", seconds)
    has_message = messages and done.returncode > 0
    error = messages[-1].removeprefix("bezier-filters: ") if has_message else describe_exit(done.returncode)
    return index, Outcome(None, error, seconds)
