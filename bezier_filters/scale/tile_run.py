"""Runs a job on all tiles that are not done yet."""

import hashlib
import json
import shutil
import time
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from bezier_filters._version import __version__
from bezier_filters.errors import InvalidParameterError
from bezier_filters.runtime.parallel import Progress
from bezier_filters.scale.mesh_source import MeshSource
from bezier_filters.scale.partition import build_store
from bezier_filters.scale.scheduling import Scheduler, core_count, run_tasks
from bezier_filters.scale.store import Layout, Store, is_store, open_store
from bezier_filters.scale.tile_results import DamagedTileError, TileResult, open_tile, tile_path
from bezier_filters.scale.tile_tasks import TileJob, run_tile

TILE_VERTICES = 1 << 19
"""Of a tile, if there is memory for it: larger ones have hardly less around them."""
SMALLEST_TILE = 1 << 8
BYTES_PER_VERTEX, BYTES_PER_WORKER = 1200, 500_000_000
"""What a tile takes at most with what surrounds it, and a worker before it has one."""
MARK = "bezier_filters_store"

StageProgress = Callable[[str, int, int], bool | None]
"""``progress(stage, done, total)``; returning False cancels."""


@dataclass(frozen=True)
class Finished:
    """All tiles of a job.

    Attributes
    ----------
    tiles : tuple of TileResult
        In order.
    computed : int
        How many were computed now; the others were there already.
    damaged : tuple of int
        Tiles that were there, but not what was written, and were computed again.
    """

    tiles: tuple[TileResult, ...]
    computed: int
    damaged: tuple[int, ...]

    @property
    def peak_bytes(self) -> int:
        """The most memory that a worker has had."""
        return max(int(tile.report["peak_bytes"]) for tile in self.tiles)

    @property
    def halo(self) -> float:
        """Vertices that were read beyond those of the tiles, per vertex."""
        counts: Counter[str] = Counter()
        for tile in self.tiles:
            counts.update({name: tile.report[name] for name in ("vertices", "read")})
        return counts["read"] / counts["vertices"] - 1.0


@dataclass
class Stages:
    """Seconds of the stages of a run, and the progress of each."""

    progress: StageProgress | None = None
    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def stage(self, name: str, remark: str = "") -> Any:
        """Time the block; yields the callback that its progress goes to, or None. A remark is shown with the name."""
        start, progress = time.perf_counter(), self.progress
        shown = f"{name} {remark}".strip()
        yield None if progress is None else lambda done, total: progress(shown, done, total)
        self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - start


def tile_size(tile_vertices: int | None, memory_limit: int | None) -> int:
    """Vertices per tile, as given or as the memory of a worker allows.

    Raises
    ------
    InvalidParameterError
        If they are too few, or the memory too small.
    """
    if tile_vertices is not None:
        if tile_vertices < SMALLEST_TILE:
            raise InvalidParameterError(f"tile_vertices: got {tile_vertices}, expected {SMALLEST_TILE} or more")
        return tile_vertices
    if memory_limit is None:
        return TILE_VERTICES
    room = (memory_limit - BYTES_PER_WORKER) // BYTES_PER_VERTEX
    if room < 1 << 12:
        raise InvalidParameterError(
            f"memory_limit: got {memory_limit / 1e9:.2g} GB, expected {(BYTES_PER_WORKER + 1e8) / 1e9:.1f} GB or more"
        )
    return min(int(room), TILE_VERTICES)


def worker_count(workers: int | None) -> int:
    """Processes or threads on this machine.

    Raises
    ------
    InvalidParameterError
        If the argument is not positive.
    """
    if workers is not None and workers < 1:
        raise InvalidParameterError(f"workers: got {workers}, expected 1 or more, or None for all cores")
    return workers or core_count()


def prepared_store(
    source: MeshSource,
    folder: Path,
    tile_vertices: int | None,
    memory_limit: int | None,
    *,
    resume: bool,
    threads: int,
    progress: Progress | None,
) -> Store:
    """The store of an earlier run, if it is to be resumed and is complete, or else a new one.

    Tiles of an earlier run stay as they are, and tiles of another size may not be asked for.

    Raises
    ------
    InvalidParameterError
        If there is something in the folder that is not to be resumed.
    FieldFileError
        If the store was made from something else.
    """
    ours = (folder / MARK).is_file()
    if folder.exists() and not (ours and resume) and (not folder.is_dir() or any(folder.iterdir())):
        hint = "resume to go on with it, or remove it" if ours else "choose another folder"
        raise InvalidParameterError(f"store: {folder} is there already; {hint}")
    if ours and is_store(folder):
        store = open_store(folder, source.fingerprint())
        if tile_vertices is not None:
            _check_layout(store.layout, tile_vertices, folder)
        return store
    if ours:  # the mesh was not sorted to the end
        shutil.rmtree(folder)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / MARK).touch()
    return build_store(source, folder, tile_size(tile_vertices, memory_limit), threads=threads, progress=progress)


def _check_layout(layout: Layout, tile_vertices: int, folder: Path) -> None:
    whole_blocks = -(-tile_vertices >> layout.block_bits) << layout.block_bits
    if layout.tile_vertices != whole_blocks:
        raise InvalidParameterError(
            f"tile_vertices: got {tile_vertices}, but {folder} has tiles of {layout.tile_vertices}; give that number, "
            "or remove the folder to start anew"
        )


def check_room(source: MeshSource, folder: Path, target: Path, row_size: int, in_store: int) -> None:
    """Refuse early what would fail in the end.

    Parameters
    ----------
    source : MeshSource
    folder, target : Path
        Of the store and of the file that is written.
    row_size, in_store : int
        Bytes of a vertex in that, and in the store.

    Raises
    ------
    InvalidParameterError
        If there is less room than the store and the file will take.
    OSError
        If the file cannot be written where it should be.
    """
    if not target.resolve().parent.is_dir():
        raise FileNotFoundError(f"cannot write {target}: there is no directory {target.resolve().parent}")
    n, m = source.vertex_count, source.face_count
    of_store = (3 * source.dtype.itemsize + 8 + in_store) * n + (16 + 2) * m
    of_target = row_size * n + 13 * m
    there = next(path for path in (folder.resolve(), *folder.resolve().parents) if path.exists())
    same_disk = there.stat().st_dev == target.resolve().parent.stat().st_dev
    for path, needed in ((there, of_store + of_target * same_disk), (target.resolve().parent, of_target)):
        free = shutil.disk_usage(path).free
        if free < needed:
            raise InvalidParameterError(
                f"store: {needed / 1e9:.1f} GB are needed below {path}, {free / 1e9:.1f} GB are free; choose another "
                "folder, or fewer columns"
            )


def remove_store(folder: Path) -> None:
    """Remove a store, and nothing else."""
    if (folder / MARK).is_file():
        shutil.rmtree(folder)


def results_folder(store: Store, parameters: dict[str, Any]) -> Path:
    """Where results with some parameters belong: others do not get mixed up with them."""
    text = json.dumps({"version": __version__} | parameters, sort_keys=True)
    folder = store.folder / f"results-{hashlib.sha256(text.encode()).hexdigest()[:16]}"
    folder.mkdir(exist_ok=True)
    (folder / "parameters.json").write_text(text, encoding="utf-8")
    return folder


def run_job(
    scheduler: Scheduler, store: Store, job: TileJob, *, workers: int, progress: Progress | None = None
) -> Finished:
    """Compute the tiles of a job that are not there yet.

    Raises
    ------
    DamagedTileError
        If a tile was damaged since it was computed.
    LostTaskError
        If workers die again and again of the same tile.
    """
    todo, damaged = [], []
    for tile in range(store.layout.tile_count):
        try:
            open_tile(job.results, tile)
        except FileNotFoundError:
            todo.append(tile)
        except DamagedTileError:
            todo.append(tile)
            damaged.append(tile)
            tile_path(job.results, tile).unlink()
    for _ in run_tasks(scheduler, run_tile, job, todo, workers=workers, progress=progress):
        pass
    with ThreadPoolExecutor(workers) as pool:
        tiles = tuple(pool.map(lambda tile: open_tile(job.results, tile), range(store.layout.tile_count)))
    return Finished(tiles, len(todo), tuple(damaged))
