"""A run in tiles from file to file: the store, the workers, rounds of tasks on all tiles, and the result file."""

import hashlib
import json
import os
import shutil
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TypeAlias

import numpy as np

from bezier_filters._version import __version__
from bezier_filters.arrays import FloatArray, Report
from bezier_filters.errors import InvalidParameterError, is_integer
from bezier_filters.runtime.parallel import Progress, report, thread_count, use_threads
from bezier_filters.scale.array_file import Values
from bezier_filters.scale.clients import Scheduler, Workers, check_workers, start_workers
from bezier_filters.scale.remote import Location, disk_of, locate, remove_folder
from bezier_filters.scale.scheduling import run_tasks
from bezier_filters.scale.source import MeshSource
from bezier_filters.scale.store import MANIFEST, Store, build_store, open_store
from bezier_filters.scale.tiles import (
    DamagedTileError,
    Tile,
    TileReport,
    open_tile,
    remove_tile,
    write_joined,
    write_tile,
)

MAX_TILE_VERTICES = 1 << 19  # vertices of a tile if memory allows; larger tiles hardly reduce the share of halos
MIN_TILE_VERTICES = 1 << 8
# most memory of a tile with its halo, and of a worker before its first tile
BYTES_PER_VERTEX, BYTES_PER_WORKER = 1200, 500_000_000
MARKER_FILE = "bezier_filters_store"
DASHBOARD = "dashboard "  # and its address: the name of a stage that reports it

# computes the rows and the report of a tile, given its number
TileTask: TypeAlias = Callable[[int], tuple[Values, TileReport]]

# ``progress(stage, done, total)``; it cancels by returning False
StageProgress: TypeAlias = Callable[[str, int, int], bool | None]


@dataclass(frozen=True)
class RunOptions:
    """Options of a run, see `estimate_file`; and the number of vertices of a tile if memory allows."""

    scheduler: Scheduler = None
    workers: int | None = None
    tile_vertices: int | None = None
    memory_limit: int | None = None
    store: str | os.PathLike[str] | None = None
    resume: bool = False
    keep_store: bool = False
    progress: StageProgress | None = None
    largest_tile: int = MAX_TILE_VERTICES


@dataclass
class Stages:
    """Seconds of the stages of a run, and the progress of each."""

    progress: StageProgress | None = None
    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def stage(self, name: str) -> Iterator[Progress | None]:
        """Time the block; yields a callback for its progress, or None."""
        start, progress = time.perf_counter(), self.progress
        yield None if progress is None else lambda done, total: progress(name, done, total)
        self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - start

    def announce(self, name: str) -> None:
        """Report a stage that takes no time."""
        with self.stage(name) as progress:
            report(progress, 1, 1)
        del self.seconds[name]


@use_threads(1)  # tasks share the cores; a scheduler may run them in this process
def run_tile(folder: Location, compute: TileTask, tile: int) -> int:
    """Compute the results of a tile in a worker and write them to a folder; returns the number of the tile."""
    start = time.perf_counter()
    rows, of_tile = compute(tile)
    seconds = time.perf_counter() - start
    write_tile(folder, replace(of_tile, seconds=seconds, peak_bytes=peak_bytes(), process=os.getpid()), rows)
    return tile


@dataclass(frozen=True)
class Round:
    """All tiles after a round of tasks, in order, the number computed in this run, and the damaged ones."""

    tiles: tuple[Tile, ...]
    computed: int
    damaged: tuple[int, ...]

    def sums(self, name: str) -> FloatArray:
        """Sums of a number over all tiles."""
        return np.asarray(np.sum([tile.report.sums[name] for tile in self.tiles], axis=0, dtype=np.float64))


@dataclass(frozen=True)
class Run:
    """A run in progress: source, store, workers and completed rounds."""

    source: MeshSource
    store: Store
    cluster: Workers
    stages: Stages
    workers: int
    rounds: list[Round] = field(default_factory=list)

    def results(self, parameters: Report) -> Location:
        """Folder for results with these parameters, separate from all others."""
        text = json.dumps({"version": __version__} | parameters, sort_keys=True)
        folder = self.store.folder / f"results-{hashlib.sha256(text.encode()).hexdigest()[:16]}"
        folder.mkdir(exist_ok=True)
        (folder / "parameters.json").write_text(text, encoding="utf-8")
        return folder

    def tiles(self, stage: str, folder: Location, compute: TileTask) -> Round:
        """Compute missing tiles and verify all of them; `LostTaskError` if one ends several workers."""
        count = self.store.layout.tile_count
        todo, damaged = [], []
        folder.mkdir(exist_ok=True)
        for tile in range(count):
            try:
                open_tile(folder, tile)
            except FileNotFoundError:
                todo.append(tile)
            except DamagedTileError:
                todo.append(tile)
                damaged.append(tile)
                remove_tile(folder, tile)
        with self.stages.stage("start"):
            check_workers(ready := self.cluster.ready(), self.store.folder / MARKER_FILE)
        if self.cluster.dashboard and not self.rounds:
            self.stages.announce(DASHBOARD + self.cluster.dashboard)
        with self.stages.stage(stage) as progress:
            work = partial(run_tile, folder, compute)
            for _ in run_tasks(ready, work, todo, workers=self.workers, progress=progress):
                pass
            with ThreadPoolExecutor(self.workers) as pool:
                tiles = tuple(pool.map(lambda tile: open_tile(folder, tile), range(count)))
        self.rounds.append(Round(tiles, len(todo), tuple(damaged)))
        return self.rounds[-1]


@dataclass(frozen=True, kw_only=True)
class FileRun(Run):
    """A run whose results are written to a file."""

    target: Location

    def write(self, tiles: Sequence[Tile]) -> None:
        """Join the results of all tiles in the target, and release the workers."""
        self.cluster.release()
        with self.stages.stage("write") as progress:
            write_joined(self.target, self.source, self.store, tiles, progress=progress)

    def report(self) -> Report:
        """Report on files, tiles, time and memory."""
        reports = [tile.report for done in self.rounds for tile in done.tiles]
        read = max(sum(tile.report.read for tile in done.tiles) for done in self.rounds)
        layout = self.store.layout
        return {
            "input": [str(path) for path in self.source.paths],
            "output": str(self.target),
            "vertices": layout.vertex_count,
            "tiles": layout.tile_count,
            "rounds": len(self.rounds),
            "computed_tiles": sum(done.computed for done in self.rounds),
            "damaged_tiles": [tile for done in self.rounds for tile in done.damaged],
            "tile_vertices": layout.tile_vertices,
            "halo": read / layout.vertex_count - 1.0,
            "tile_seconds": sum(report.seconds for report in reports),
            "peak_bytes": {"worker": max(report.peak_bytes for report in reports), "driver": peak_bytes()},
            "seconds": self.stages.seconds,
            "scheduler": self.cluster.address,
            "dashboard": self.cluster.dashboard or None,
        }


@contextmanager
def file_run(
    source: MeshSource, target: str | os.PathLike[str], options: RunOptions, *, row_size: int, in_store: int
) -> Iterator[FileRun]:
    """Sort a mesh on disk and start workers; at the end the store is removed, unless the run fails.

    `row_size` and `in_store` are the bytes per vertex of the results in the target and in the store. Options out of
    range, a store of another run, other folders, and disks without enough space are refused.
    """
    options = _check_options(options)
    place = locate(target, "target")
    _check_target(source, place)
    folder = _store_folder(options.store if options.store is not None else f"{target}.tiles")
    if not options.resume:
        check_room(source, folder, place, row_size, in_store)
    with store_run(source, folder, options) as run:
        yield FileRun(**vars(run), target=place)


@contextmanager
def store_run(source: MeshSource, store: str | os.PathLike[str] | Location, options: RunOptions) -> Iterator[Run]:
    """Sort a mesh on disk into a store and start workers; at the end the store is removed, unless the run fails."""
    options, folder = _check_options(options), _store_folder(store)
    stages = Stages(options.progress)
    with (
        use_threads(options.workers),
        start_workers(options.scheduler, workers=thread_count(), memory_limit=options.memory_limit) as cluster,
    ):
        with stages.stage("sort") as progress:
            prepared = _prepare_store(source, folder, options, progress)
        yield Run(source, prepared, cluster, stages, thread_count())
    if not options.keep_store and (folder / MARKER_FILE).is_file():
        remove_folder(folder)


def _store_folder(path: str | os.PathLike[str] | Location) -> Location:
    """The folder of the store, absolute for workers in other folders."""
    folder = locate(path, "store") if isinstance(path, (str, os.PathLike)) else path
    return folder.absolute() if isinstance(folder, Path) else folder


def _check_options(options: RunOptions) -> RunOptions:
    """The options with Python's integers; InvalidParameterError if one is out of range."""
    workers, tile_vertices, memory_limit = (
        _integer_or_none(name, getattr(options, name)) for name in ("workers", "tile_vertices", "memory_limit")
    )
    if not (options.progress is None or callable(options.progress)):
        raise InvalidParameterError(f"progress: got {options.progress!r}, expected a function, or None")
    options = replace(options, workers=workers, tile_vertices=tile_vertices, memory_limit=memory_limit)
    tile_size(options)  # refuse bad sizes at once
    return options


def _integer_or_none(name: str, value: object) -> int | None:
    if value is None:
        return None
    if not (is_integer(value) and 1 <= value <= np.iinfo(np.int64).max):
        raise InvalidParameterError(f"{name}: got {value!r}, expected an integer of 1 or more, or None")
    return int(value)


def _check_target(source: MeshSource, target: Location) -> None:
    """Refuse a target that is the source, or no PLY file by its name."""
    if target.suffix.lower() != ".ply":
        raise InvalidParameterError(f"target: got {target}, expected a file name that ends in .ply")
    if any(_are_same(path, target) for path in source.paths):
        raise InvalidParameterError(f"target: {target} is the source, which would be overwritten; give another name")


def _are_same(path: Location, other: Location) -> bool:
    if isinstance(path, Path) and isinstance(other, Path):
        return path.exists() and other.exists() and path.samefile(other)
    return str(path) == str(other)


def _prepare_store(source: MeshSource, folder: Location, options: RunOptions, progress: Progress | None) -> Store:
    """Open the complete store of an earlier run to resume it, or build a new one."""
    ours = (folder / MARKER_FILE).is_file()
    if folder.exists() and not (ours and options.resume) and (not folder.is_dir() or any(folder.iterdir())):
        hint = "resume the run, or remove the folder" if ours else "choose another folder"
        raise InvalidParameterError(f"store: {folder} exists already; {hint}")
    wanted = tile_size(options)
    if ours and (folder / MANIFEST).is_file():
        store = open_store(folder, source.fingerprint())
        there = store.layout.tile_vertices
        if options.tile_vertices is not None and there != store.layout.round_to_blocks(wanted):
            raise InvalidParameterError(
                f"tile_vertices: got {wanted}, but {folder} has tiles of {there}; give that number, or remove the "
                "folder to start over"
            )
        return store
    if ours:  # sorting was interrupted
        remove_folder(folder)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / MARKER_FILE).touch()
    return build_store(source, folder, wanted, progress=progress)


def tile_size(options: RunOptions) -> int:
    """Vertices per tile, as given or as the memory of a worker allows."""
    tile_vertices, memory_limit = options.tile_vertices, options.memory_limit
    if tile_vertices is not None:
        if tile_vertices < MIN_TILE_VERTICES:
            raise InvalidParameterError(f"tile_vertices: got {tile_vertices}, expected {MIN_TILE_VERTICES} or more")
        return tile_vertices
    if memory_limit is None:
        return options.largest_tile
    room = (memory_limit - BYTES_PER_WORKER) // BYTES_PER_VERTEX
    if room < 1 << 12:
        raise InvalidParameterError(
            f"memory_limit: got {memory_limit / 1e9:.2g} GB, expected {(BYTES_PER_WORKER + 1e8) / 1e9:.1f} GB or more"
        )
    return min(int(room), options.largest_tile)


def check_room(source: MeshSource, folder: Location, target: Location, row_size: int, in_store: int) -> None:
    """Refuse disks without enough space early, given the bytes per vertex in the target and in the store."""
    of_result = disk_of(target).parent if isinstance(target, Path) else disk_of(target)
    if not of_result.is_dir():
        raise FileNotFoundError(f"cannot write {target}: there is no directory {of_result}")
    n, m = source.vertex_count, source.face_count
    of_store = (3 * source.dtype.itemsize + 8 + in_store) * n + (16 + 2) * m
    of_target = row_size * n + 13 * m
    there = next(path for path in (disk_of(folder), *disk_of(folder).parents) if path.exists())
    same_disk = there.stat().st_dev == of_result.stat().st_dev
    for path, needed in ((there, of_store + of_target * same_disk), (of_result, of_target)):
        free = shutil.disk_usage(path).free
        if free < needed:
            raise InvalidParameterError(
                f"store: {needed / 1e9:.1f} GB are needed below {path}, {free / 1e9:.1f} GB are free; choose another "
                "folder, or fewer columns"
            )


def peak_bytes() -> int:
    """Peak memory of this process, 0 where unknown."""
    if sys.platform == "win32":
        return 0
    import resource

    unit = 1 if sys.platform == "darwin" else 1024
    return int(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss) * unit
