"""Turns what the user has - a client, a cluster, an address, a scheduler file or nothing - into a scheduler for tasks.

A client or a cluster of the user is never closed; what is started or opened here ends with the run.
"""

import asyncio
import contextlib
import json
import logging
import os
import re
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

from bezier_filters._version import __version__
from bezier_filters.errors import InvalidParameterError
from bezier_filters.scale.remote import Location

# None, "threads", "processes", "synchronous", an address such as "tcp://host:8786", the path of a scheduler file, a
# cluster, or a `distributed.Client`
Scheduler: TypeAlias = Any

Result = TypeVar("Result")

LOCAL_SCHEDULERS = ("threads", "processes", "synchronous")
# other names of these in Dask's configuration
_ALIASES = {
    "threading": "threads",
    "multiprocessing": "processes",
    "sync": "synchronous",
    "single-threaded": "synchronous",
}
INSTALL_COMMAND = 'pip install "bezier-filters[scale]"'
CONNECT_SECONDS = 5.0  # for a scheduler to respond, and for its file to appear


@dataclass
class Workers:
    """The workers of a run: `ready` waits for them and returns the scheduler for `run_tasks`; `release` ends ours."""

    start: Callable[[], Scheduler]
    release: Callable[[], object] = lambda: None
    are_ours: bool = False  # whether they were started for this run
    address: str = ""  # of the scheduler, or its name; known when they are ready, like the next
    dashboard: str = ""  # address of Dask's dashboard; empty if there is none

    def ready(self) -> Scheduler:
        """Wait for the workers."""
        scheduler = self.start()
        self.address = scheduler if isinstance(scheduler, str) else scheduler.scheduler.address
        # Without bokeh here, our own scheduler has no dashboard; others may run elsewhere.
        if not isinstance(scheduler, str) and not (self.are_ours and find_spec("bokeh") is None):
            with contextlib.suppress(KeyError):  # it may run without
                self.dashboard = str(scheduler.dashboard_link or "")
        return scheduler


@contextlib.contextmanager
def start_workers(scheduler: Scheduler, *, workers: int, memory_limit: int | None) -> Iterator[Workers]:
    """Connect to a scheduler, that of Dask's defaults if none is given; without any, start workers on this machine.

    They are started in the background, and ended after the block; one that exceeds the memory limit is replaced.
    Anything but a scheduler is refused, and so is an address without a response.
    """
    import_distributed()
    found = default_scheduler() if scheduler is None else nullcontext(scheduler)
    with found as known:
        if known is None:
            with contextlib.ExitStack() as stack, ThreadPoolExecutor(1) as pool:  # waits for the pool first
                starting = pool.submit(_start, stack, workers, memory_limit)
                yield Workers(starting.result, lambda: pool.submit(stack.close), are_ours=True)
        elif isinstance(known, str) and known in LOCAL_SCHEDULERS:
            yield Workers(lambda: known)
        else:
            with _connect(known) as client:
                yield Workers(lambda: client)


def default_scheduler() -> AbstractContextManager[Scheduler]:
    """The scheduler that Dask would use here, or None.

    In this order: a local scheduler of Dask's configuration, the client of the task that runs here, the current client
    of this process, and the ``scheduler-address`` of the configuration (DASK_SCHEDULER_ADDRESS).
    """
    config, distributed = import_module("dask").config, import_distributed()
    name = config.get("scheduler", None)
    name = _ALIASES.get(name, name) if isinstance(name, str) else None
    if name in LOCAL_SCHEDULERS:
        return nullcontext(name)
    with contextlib.suppress(ValueError):
        distributed.get_worker()
        client: AbstractContextManager[Scheduler] = distributed.worker_client()  # leaves its thread to other tasks
        return client
    with contextlib.suppress(ValueError):
        return nullcontext(distributed.get_client())
    return nullcontext(config.get("scheduler-address", None))


def _start(stack: contextlib.ExitStack, workers: int, memory_limit: int | None) -> Scheduler:
    """Client of new processes on this machine, which end with the stack."""
    distributed = import_distributed()
    cluster = distributed.LocalCluster(
        host="127.0.0.1",
        n_workers=workers,
        threads_per_worker=1,
        memory_limit=memory_limit or 0,
        dashboard_address=":0",  # any free port
        silence_logs=logging.CRITICAL,
    )
    stack.enter_context(cluster)
    return stack.enter_context(distributed.Client(cluster, set_as_default=False))


def _connect(scheduler: Scheduler) -> AbstractContextManager[Scheduler]:
    """The client of a user, or a new one, which is closed in the end."""
    distributed = import_distributed()
    if getattr(scheduler, "asynchronous", False):
        raise InvalidParameterError(
            f"scheduler: got an asynchronous {type(scheduler).__name__}; expected one made without asynchronous=True"
        )
    if isinstance(scheduler, distributed.Client):
        if scheduler.status != "running":
            raise InvalidParameterError(f"scheduler: got a Client that is {scheduler.status}; make a new one")
        return nullcontext(scheduler)
    if isinstance(scheduler, os.PathLike) or (isinstance(scheduler, str) and scheduler.endswith(".json")):
        scheduler = read_scheduler_file(Path(scheduler))
    if isinstance(scheduler, str) and ("://" in scheduler or re.fullmatch(r".+:\d+", scheduler)):
        name = scheduler
        with ThreadPoolExecutor(1) as pool:  # this thread may run an event loop, as in notebooks
            error = pool.submit(asyncio.run, _probe_address(scheduler)).result()
        if error is not None:  # the constructor of a client would leave threads
            raise InvalidParameterError(f"scheduler: no Dask scheduler responds at {scheduler}; {error}") from error
    elif isinstance(getattr(scheduler, "scheduler_address", None), str):
        name = f"{type(scheduler).__name__} {scheduler.scheduler_address}"
    else:
        raise InvalidParameterError(
            f"scheduler: got {scheduler!r}, expected {', '.join(LOCAL_SCHEDULERS)}, an address such as "
            "tcp://host:8786, a scheduler file, a cluster, or a Client"
        )
    try:
        client: AbstractContextManager[Scheduler] = distributed.Client(
            scheduler, timeout=CONNECT_SECONDS, set_as_default=False
        )
    except (OSError, ValueError, RuntimeError) as failure:
        raise InvalidParameterError(f"scheduler: no response from {name}; {failure}") from failure
    return client


async def _probe_address(address: str) -> Exception | None:
    """Connect to a scheduler and disconnect again; returns the error of an address without one."""
    distributed = import_distributed()
    try:
        distributed.comm.resolve_address(address)
        arguments = distributed.Security().get_connection_args("client")
        comm = await distributed.comm.connect(address, timeout=CONNECT_SECONDS, **arguments)
        await comm.close()
    except Exception as error:  # what other servers respond may be taken for anything
        return error
    return None


def read_scheduler_file(path: Path) -> str:
    """Address in the file of a scheduler, which may be about to start."""
    end = time.monotonic() + CONNECT_SECONDS
    while True:
        try:
            return str(json.loads(path.read_text(encoding="utf-8"))["address"])
        except FileNotFoundError:
            reason = "there is no such file"
        except (OSError, ValueError, TypeError, KeyError) as error:  # maybe half written
            reason = f"it is no scheduler file: {error}"
        if time.monotonic() > end:
            raise InvalidParameterError(f"scheduler: cannot read {path}: {reason}")
        time.sleep(0.05)


def check_workers(scheduler: Scheduler, marker: Location | None = None) -> None:
    """Refuse workers without this version of the package, or that do not see a file of the store."""
    if isinstance(scheduler, str):
        return
    found = scheduler.run(make_portable(probe_worker), marker, on_error="return")
    for worker, result in found.items():
        if isinstance(result, ImportError):
            raise missing_module(result, f"worker {worker}") from result
        if isinstance(result, Exception):
            raise result
        version, sees_marker = result
        if version != __version__:
            raise InvalidParameterError(
                f"scheduler: worker {worker} has bezier_filters {version}, expected {__version__}, as here"
            )
        if not sees_marker:
            raise InvalidParameterError(
                f"store: worker {worker} does not see {marker}; choose a folder that all machines share, or a URL (s3://...)"
            )


def probe_worker(marker: Location | None) -> tuple[str, bool]:
    """Version of the package in this process, and whether a file is visible."""
    return __version__, marker is None or marker.is_file()


def make_portable(function: Callable[..., Result]) -> Callable[..., Result]:
    """Wrap a function so that workers and schedulers without this package can unpickle it, and fail at the call alone.

    Dask sends functions together with messages of its own: a worker that cannot read them neither works nor says why.
    """
    data = import_module("cloudpickle").dumps(function)
    # A lambda is pickled by value; as there are no annotations, it refers to nothing in this module.
    return lambda *arguments: __import__("pickle").loads(data)(*arguments)


def missing_module(error: ImportError, worker: str) -> InvalidParameterError:
    """The error to report if a worker has not all modules."""
    name = (error.name or str(error)).partition(".")[0]
    return InvalidParameterError(
        f"scheduler: {worker} has no module {name!r}; install the packages of this environment "
        f"there (bezier-filters {__version__})"
    )


def import_distributed() -> Any:
    """The package `distributed`; ImportError with the command that installs it."""
    try:
        import dask  # noqa: F401
        import distributed
    except ImportError as error:
        raise ImportError(f"meshes in tiles need Dask: {INSTALL_COMMAND} ({error})") from error
    return distributed
