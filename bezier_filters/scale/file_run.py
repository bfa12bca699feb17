"""From a file to a file: how every run in tiles begins and ends."""

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bezier_filters.scale.joined_file import write_joined
from bezier_filters.scale.mesh_source import MeshSource
from bezier_filters.scale.scheduling import Scheduler, Workers, running
from bezier_filters.scale.store import Store
from bezier_filters.scale.tile_results import TileResult
from bezier_filters.scale.tile_run import (
    StageProgress,
    Stages,
    check_room,
    prepared_store,
    remove_store,
    tile_size,
    worker_count,
)


@dataclass(frozen=True)
class RunOptions:
    """How a run goes, see `estimate_file`."""

    scheduler: Scheduler = None
    workers: int | None = None
    tile_vertices: int | None = None
    memory_limit: int | None = None
    store: str | os.PathLike[str] | None = None
    resume: bool = False
    keep_store: bool = False
    progress: StageProgress | None = None


@dataclass(frozen=True)
class FileRun:
    """A run that is under way.

    Attributes
    ----------
    source : MeshSource
    target : path
        File to write.
    mesh : Store
        The mesh, ready for tiles.
    cluster : Workers
        Where tasks run.
    stages : Stages
        Seconds and progress.
    workers : int
        Processes or threads on this machine.
    """

    source: MeshSource
    target: str | os.PathLike[str]
    mesh: Store
    cluster: Workers
    stages: Stages
    workers: int

    def write(self, tiles: Sequence[TileResult]) -> None:
        """Join the results of all tiles in the target; the workers may end."""
        self.cluster.release()
        with self.stages.stage("write") as report:
            write_joined(self.target, self.source, self.mesh, tiles, threads=self.workers, progress=report)

    @property
    def files(self) -> dict[str, Any]:
        """What is told of the files."""
        return {"input": [str(path) for path in self.source.paths], "output": os.fspath(self.target)}


@contextmanager
def file_run(
    source: MeshSource, target: str | os.PathLike[str], options: RunOptions, *, row_size: int, in_store: int
) -> Iterator[FileRun]:
    """Sort a mesh on disk and start workers; in the end the store is removed, unless anything went wrong.

    Parameters
    ----------
    source : MeshSource
    target : path
        File to write.
    options : RunOptions
    row_size, in_store : int
        Bytes per vertex that the results take in the target, and in the store.
    """
    tile_size(options.tile_vertices, options.memory_limit)  # refused at once if there cannot be any
    workers, stages = worker_count(options.workers), Stages(options.progress)
    folder = Path(options.store) if options.store is not None else Path(f"{os.fspath(target)}.tiles")
    if not options.resume:
        check_room(source, folder, Path(target), row_size, in_store)
    with running(options.scheduler, workers=workers, memory_limit=options.memory_limit) as cluster:
        with stages.stage("sort") as report:
            mesh = prepared_store(
                source,
                folder,
                options.tile_vertices,
                options.memory_limit,
                resume=options.resume,
                threads=workers,
                progress=report,
            )
        yield FileRun(source, target, mesh, cluster, stages, workers)
    if not options.keep_store:
        remove_store(folder)
