"""Smooths meshes that do not fit into memory, file to file."""

import os
import shutil
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bezier_filters.errors import InvalidParameterError
from bezier_filters.fields import PREFIX
from bezier_filters.runtime.atomic import atomic_write
from bezier_filters.scale.disk_estimation import tile_report
from bezier_filters.scale.file_run import FileRun, RunOptions, file_run
from bezier_filters.scale.mesh_source import SourcePath, open_source
from bezier_filters.scale.sampling import FitOptions, learn_fit, learn_noise, rings_needed
from bezier_filters.scale.scheduling import Scheduler
from bezier_filters.scale.stage_runs import Rounds, ValuesGoneError
from bezier_filters.scale.stage_tasks import Where
from bezier_filters.scale.tile_results import open_tile
from bezier_filters.scale.tile_run import Finished, StageProgress, results_folder, run_job
from bezier_filters.scale.tile_tasks import DISPLACEMENT, QUALITY, SMOOTHING, TileJob, peak_bytes
from bezier_filters.scale.tiled_mesh import TiledMesh
from bezier_filters.smoothing.pieces import Arrays, Outcome, Piece
from bezier_filters.smoothing.smoothing_options import SmoothedBorders, SmoothingMethod, check_smoothing
from bezier_filters.smoothing.smoothing_run import Movable, finished, smoothed

PAPER = FitOptions(rings=2, alpha=0.8, smoothness="paper")
"""As ``bezier_filters.smooth(..., method="paper")``."""
SHARPNESS = PREFIX + "sharpness"
"""Column of how sharp edges were kept."""
IN_STORE = {"auto": 700, "paper": 40}
"""Bytes per vertex in the store, at the most, for each iteration."""


def smooth_file(
    source: SourcePath,
    target: str | os.PathLike[str],
    method: SmoothingMethod = "auto",
    *,
    iterations: int = 1,
    noise: float | None = None,
    borders: SmoothedBorders = "curve",
    keep_volume: bool | None = None,
    options: FitOptions | None = None,
    scheduler: Scheduler = None,
    workers: int | None = None,
    tile_vertices: int | None = None,
    memory_limit: int | None = None,
    store: str | os.PathLike[str] | None = None,
    resume: bool = False,
    keep_store: bool = False,
    progress: StageProgress | None = None,
) -> dict[str, Any]:
    """Take the noise off a mesh of any size and keep its shape, its volume and its edges: `smooth` in tiles.

    The automatic smoothing runs as rounds of tasks, one for each of its stages, between which tiles see each other's
    values through the store. What holds for the mesh as a whole are sums over all tiles, which are carried with
    twice the digits, so that the vertices are those of ``smooth`` to the last bit, whatever the tiles and the
    scheduler.

    ``method="paper"`` moves every vertex onto its patch, all from the old mesh. After the first time that is the same
    up to rounding, as the tiles keep the order of the mesh before: 1e-12, more where faces join what is far apart.

    Parameters
    ----------
    source, target, scheduler, workers, tile_vertices, memory_limit, store, resume, keep_store, progress
        As in `estimate_file`. The quality of the target is ``bz_displacement``: how far each vertex moved in all. The
        automatic smoothing writes ``bz_sharpness``, too.
    method : {"auto", "paper"}
        How to smooth.
    iterations : int
        How many times, at least 1; once is enough for ``"auto"``.
    noise, borders, keep_volume
        As in `smooth`, for ``"auto"`` only.
    options : FitOptions, optional
        How patches are fitted, for ``"paper"`` only, which by default fits them as the paper does. With others
        vertices move onto the patches of `estimate_vertex_geometry`; what is left open is learned anew every time.

    Returns
    -------
    dict
        Report, as of `estimate_file`; tiles are those of all stages.

    Raises
    ------
    FieldFileError, InvalidMeshError, InvalidParameterError, ImportError, LostTaskError, CancelledError
        As `estimate_file`.

    Examples
    --------
    >>> import tempfile
    >>> from bezier_filters import smooth
    >>> from bezier_filters.surfaces import sphere
    >>> folder, ball = Path(tempfile.mkdtemp()), sphere(resolution=20)
    >>> vertices = ball.vertices * (1.0 + 0.01 * np.random.default_rng(0).normal(size=(len(ball.vertices), 1)))
    >>> np.save(folder / "v.npy", vertices)
    >>> np.save(folder / "f.npy", ball.faces)
    >>> files = folder / "v.npy", folder / "f.npy"
    >>> report = smooth_file(files, folder / "out.ply", tile_vertices=1024, scheduler="synchronous")
    >>> moved = open_source(folder / "out.ply").vertices(0, len(vertices))
    >>> bool((moved == smooth(vertices, ball.faces).vertices).all())
    True
    """
    check_smoothing(method, iterations, noise, borders)
    if method == "auto" and options is not None:
        raise InvalidParameterError("options: only method='paper' fits patches; leave it out")
    if method == "paper" and (borders != "curve" or keep_volume):
        raise InvalidParameterError("borders, keep_volume: method='paper' in tiles has no such options; leave them out")
    fit_options = options or PAPER
    fit_options.checked()
    opened = open_source(source)
    how = RunOptions(scheduler, workers, tile_vertices, memory_limit, store, resume, keep_store, progress)
    with file_run(opened, target, how, row_size=48, in_store=48 + IN_STORE[method] * iterations) as run:
        if method == "paper":
            return run.files | _onto_patches(run, iterations, fit_options)
        return run.files | _automatic(run, iterations, noise, borders, keep_volume is not False)


def _automatic(
    run: FileRun, iterations: int, noise: float | None, borders: SmoothedBorders, keep_volume: bool
) -> dict[str, Any]:
    """The automatic smoothing; its report. It begins anew if a tile is damaged that cannot be computed again alone."""
    damaged: list[str] = []
    while True:
        rounds = _rounds(run, iterations, noise, borders, keep_volume)
        rounds.damaged += damaged
        try:
            return _smoothed(run, rounds, iterations, noise, borders, keep_volume)
        except ValuesGoneError:
            damaged = rounds.damaged
            shutil.rmtree(rounds.folder)


def _rounds(run: FileRun, iterations: int, noise: float | None, borders: SmoothedBorders, keep_volume: bool) -> Rounds:
    """The rounds of a run with some options, none of which was run yet."""
    parameters = {"iterations": iterations, "noise": noise, "borders": borders, "keep_volume": keep_volume}
    folder = results_folder(run.mesh, {"quantity": "automatic smoothing"} | parameters)
    return Rounds(run.cluster, run.mesh, folder.resolve(), run.stages, run.workers)


def _smoothed(
    run: FileRun, rounds: Rounds, iterations: int, noise: float | None, borders: SmoothedBorders, keep_volume: bool
) -> dict[str, Any]:
    """The automatic smoothing in rounds; its report."""
    domain = TiledMesh(rounds, Where(run.mesh.folder.resolve()))

    def noise_of(domain: TiledMesh) -> float | None:
        with run.stages.stage("learn"):
            return learn_noise(domain.store, threads=run.workers)

    movable = domain.run(Movable(borders == "fixed")).vertices
    noise_before = noise if noise is not None else noise_of(domain)
    found = smoothed(domain, movable, noise_before, noise_of, borders, iterations=iterations, threads=run.workers)
    end = finished(domain, found, movable, keep_volume=keep_volume, keep_faces=True)
    columns = domain.run(Columns(), points=end.points, found=found).vertices
    noise_after = noise_of(domain.with_points(end.points))
    run.write([open_tile(columns.folder, tile) for tile in range(run.mesh.layout.tile_count)])
    volumes = [float(sums) for sums in end.volumes.sum(axis=1)] if end.volumes.size else [None, None]
    return {
        "iterations": iterations,
        "quality": DISPLACEMENT,
        "attributes": [DISPLACEMENT, SHARPNESS],
        "noise": {"before": noise_before, "after": noise_after},
        "volume": {"before": volumes[0], "after": volumes[1]},
        "faces": end.faces,
        "vertices": run.mesh.layout.vertex_count,
        "tiles": rounds.tiles,
        "computed_tiles": rounds.computed,
        "damaged_tiles": rounds.damaged,
        "tile_vertices": run.mesh.layout.tile_vertices,
        "stages": rounds.number,
        "halo": rounds.halo,
        "tile_seconds": rounds.seconds,
        "peak_bytes": {"worker": rounds.peak_bytes, "driver": peak_bytes()},
        "seconds": run.stages.seconds,
    }


@dataclass(frozen=True)
class Columns:
    """Columns of the file that is written."""

    rings: int = 0

    def __call__(self, piece: Piece, inputs: Mapping[str, Arrays]) -> Outcome:
        """Coordinates, the quality and what it is."""
        points = inputs["points"]["points"]
        moved = np.linalg.norm(points - piece.mesh.vertices, axis=1)
        columns = {axis: points[:, k] for k, axis in enumerate("xyz")} | {QUALITY: moved, DISPLACEMENT: moved}
        return Outcome(vertices=columns | {SHARPNESS: inputs["found"]["sharpness"]})


def _onto_patches(run: FileRun, iterations: int, options: FitOptions) -> dict[str, Any]:
    """Every vertex moves to its patch, some times; the report."""
    computed, damaged, mesh = 0, list[int](), run.mesh
    current = mesh
    for step in range(iterations):
        results = results_folder(mesh, {"quantity": SMOOTHING, "options": asdict(options), "step": step})
        with run.stages.stage("learn"):
            fit = learn_fit(current, options, threads=run.workers)
        job = TileJob(
            mesh.folder.resolve(),
            results.resolve(),
            fit,
            options.creases,
            options.robust,
            SMOOTHING,
            DISPLACEMENT,
            (DISPLACEMENT,),
            vertices=current.vertices.path.resolve() if step else None,
        )
        with run.stages.stage(f"step {step + 1}") as report:
            done = run_job(run.cluster.ready(), mesh, job, workers=run.workers, progress=report)
        computed += done.computed
        damaged += done.damaged
        current = mesh.with_vertices(_joined_vertices(results, done))
    run.write(done.tiles)
    in_all = Finished(done.tiles, computed, tuple(damaged))
    return {
        "iterations": iterations,
        "quality": DISPLACEMENT,
        "attributes": [DISPLACEMENT],
        "fit": asdict(fit.choice),
    } | tile_report(in_all, mesh.layout.tile_vertices, rings_needed(fit), run.stages)


def _joined_vertices(results: Path, finished: Finished) -> Path:
    """One file with the coordinates of all tiles, in the order of the store."""
    path = results / "vertices.bin"
    with atomic_write(path) as temporary, open(temporary, "wb") as stream:
        for tile in finished.tiles:
            rows = tile.rows.read(0, tile.rows.rows)
            np.column_stack([rows[axis] for axis in "xyz"]).tofile(stream)
    return path
