"""Command lines on a Dask cluster, each in a process of its own: for collections of files."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Generator, Sequence

from bezier_filters.runtime.parallel import THREADS_VARIABLE
from bezier_filters.runtime.worker_processes import Outcome, last_words
from bezier_filters.scale.scheduling import Scheduler, run_tasks, running


def run_on_scheduler(
    jobs: Sequence[Sequence[str]], scheduler: Scheduler, *, workers: int
) -> Generator[tuple[int, Outcome], None, None]:
    """Run command lines on any of Dask's schedulers; `worker_processes.run_in_processes` for many machines.

    Jobs are arguments of ``bezier-filters``; workers must see the files under the same, absolute, paths. `workers` jobs
    run at a time if the scheduler is "threads" or "processes". Outcomes come as they finish, after the job's index.
    """
    with running(scheduler, workers=workers, memory_limit=None) as cluster:
        yield from run_tasks(cluster.ready(), run_command_line, list(enumerate(jobs)), workers=workers)


def run_command_line(job: tuple[int, Sequence[str]]) -> tuple[int, Outcome]:
    """What a worker does: a library that aborts on a damaged file, or prints, does it elsewhere."""
    index, arguments = job
    start = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-m", "bezier_filters", *arguments, "--json"],
        capture_output=True,
        text=True,
        stdin=subprocess.DEVNULL,
        env={THREADS_VARIABLE: "1", **os.environ},
        check=False,
    )
    error, result = "", None
    if done.returncode:
        said = done.stderr.strip().splitlines()
        error = (
            said[-1].removeprefix("bezier-filters: ") if said and done.returncode > 0 else last_words(done.returncode)
        )
    else:
        result = json.loads(done.stdout)
    return index, Outcome(result, error, time.perf_counter() - start)
