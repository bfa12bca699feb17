"""Smooths meshes that do not fit into memory, file to file."""

import os
from collections.abc import Sequence
from dataclasses import asdict, replace
from functools import partial

import numpy as np

from bezier_filters.arguments import checks_arguments
from bezier_filters.arrays import FloatArray, Report
from bezier_filters.errors import InvalidParameterError
from bezier_filters.fields import PREFIX, QUALITY
from bezier_filters.fitting.noise_level import explain_no_noise
from bezier_filters.fitting.surface_fit import SurfaceFit
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.meshes.prepared_mesh import prepare_mesh
from bezier_filters.runtime.parallel import single_threaded_blas
from bezier_filters.scale.array_file import ArrayFile, Values, save_array
from bezier_filters.scale.clients import Scheduler
from bezier_filters.scale.components import StoredComponents
from bezier_filters.scale.estimate import fit_tile
from bezier_filters.scale.halo import tile_part
from bezier_filters.scale.learn import (
    check_tile_options,
    learn_fit,
    rings_needed,
    store_neighbourhoods,
)
from bezier_filters.scale.remote import Location
from bezier_filters.scale.run import FileRun, RunOptions, StageProgress, file_run
from bezier_filters.scale.source import SourcePath, open_source
from bezier_filters.scale.store import Store
from bezier_filters.scale.stored_surface import (
    ERROR,
    FINISH_RINGS,
    NOISE,
    SHARPNESS,
    SmoothingRun,
    StoredSurface,
    movable_vertices,
    run_round,
)
from bezier_filters.scale.tiles import Tile, TileReport, open_tile, table_of
from bezier_filters.smoothing.denoise import SmoothingOptions
from bezier_filters.smoothing.flipped_faces import bad_faces, repair_flipped_faces
from bezier_filters.smoothing.intersections import reduce_intersections
from bezier_filters.smoothing.rounds import denoise_surface, join_errors
from bezier_filters.smoothing.smooth import (
    SmoothedBorders,
    SmoothingMethod,
    admissible_displacements,
    check_smoothing,
    unknown_noise,
)
from bezier_filters.smoothing.volume import (
    VOLUME_STEPS,
    apply_moves,
    component_volumes,
    local_movement,
    omit_outliers,
    outward_moves,
    volume_steps,
)
from bezier_filters.surface_model.fit_options import FitOptions

DISPLACEMENT = PREFIX + "displacement"  # column of the displacement
PAPER_OPTIONS = FitOptions(rings=2, alpha=0.8, smoothness="paper")  # as ``bezier_filters.smooth(..., method="paper")``
STORE_BYTES = {"auto": (90, 72), "paper": (0, 64)}  # bytes per vertex in the store, once and per iteration
SMOOTHING_TILE_VERTICES = 5 << 18  # vertices; larger tiles, as the halos of the automatic smoothing are wide
# counts of faces in the report
FACE_COUNTS = ("flipped before", "flipped after", "degenerate before", "degenerate after", "new")


@checks_arguments
@single_threaded_blas()
def smooth_file(
    source: SourcePath,
    target: str | os.PathLike[str],
    method: SmoothingMethod = "auto",
    *,
    iterations: int = 1,
    noise: float | None = None,
    borders: SmoothedBorders = "curve",
    keep_volume: bool | None = None,
    detail: float | None = None,
    relax: bool = False,
    options: FitOptions | None = None,
    scheduler: Scheduler = None,
    workers: int | None = None,
    tile_vertices: int | None = None,
    memory_limit: int | None = None,
    store: str | os.PathLike[str] | None = None,
    resume: bool = False,
    keep_store: bool = False,
    progress: StageProgress | None = None,
) -> Report:
    """Remove the noise of a mesh of any size and keep its shape, its volume and its edges: `smooth` in tiles.

    Global parameters are learned once, from the same parts as in memory. Then every tile is a task that smooths it
    by the same function as a mesh in memory, with a halo as wide as the filters. The vertices differ from those of
    ``smooth`` by at most a hundredth of the noise, and by a thousandth in the root mean square, whatever the tiles
    and the scheduler. A last round restores the volumes of closed components (to 1e-6).

    ``method="paper"`` moves every vertex onto its patch, all from the old mesh. From the second iteration on the
    result differs by rounding, as tiles keep the order of the first mesh: 1e-12, more where faces are very long.

    Parameters
    ----------
    source, target, scheduler, workers, tile_vertices, memory_limit, store, resume, keep_store, progress
        As in `estimate_file`. The quality of the target is ``bz_displacement``: how far each vertex moved in all. The
        automatic smoothing writes ``bz_sharpness``, too.
    method : {"auto", "paper"}
        Smoothing method.
    iterations : int
        Number of iterations, at least 1; one is enough for ``"auto"``.
    noise, borders, keep_volume, detail, relax
        As in `smooth`, for ``"auto"`` only.
    options : FitOptions, optional
        Options of the fit, for ``"paper"`` only; by default those of the paper. With other options vertices move onto
        the patches of `estimate_vertex_geometry`, and automatic options are learned again in every iteration.

    Returns
    -------
    dict
        Report, as of `estimate_file`; computed and damaged tiles are those of all rounds. ``warnings`` say why
        the automatic smoothing moved nothing.

    Raises
    ------
    FieldFileError, InvalidMeshError, InvalidParameterError, ImportError, LostTaskError, CancelledError
        As `estimate_file`.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from bezier_filters import smooth
    >>> from bezier_filters.surfaces import sphere
    >>> folder, ball = Path(tempfile.mkdtemp()), sphere(resolution=20)
    >>> vertices = ball.vertices * (1.0 + 0.01 * np.random.default_rng(0).normal(size=(len(ball.vertices), 1)))
    >>> np.save(folder / "v.npy", vertices)
    >>> np.save(folder / "f.npy", ball.faces)
    >>> files = folder / "v.npy", folder / "f.npy"
    >>> report = smooth_file(files, folder / "out.ply", tile_vertices=1024, scheduler="synchronous")
    >>> moved = open_source(folder / "out.ply").vertices(0, len(vertices))
    >>> bool(np.abs(moved - smooth(vertices, ball.faces).vertices).max() < 0.01 * report["noise"]["before"])
    True
    """
    check_smoothing(method, iterations, noise, borders, detail, relax)
    iterations, relax = int(iterations), bool(relax)
    if method == "auto" and options is not None:
        raise InvalidParameterError("options: only method='paper' fits patches; leave it out")
    if method == "paper" and (borders != "curve" or keep_volume):
        raise InvalidParameterError("borders, keep_volume: method='paper' in tiles has no such options; leave them out")
    fit_options = options or PAPER_OPTIONS
    check_tile_options(fit_options)
    opened = open_source(source)
    how = RunOptions(scheduler, workers, tile_vertices, memory_limit, store, resume, keep_store, progress)
    if method == "auto":
        how = replace(how, largest_tile=SMOOTHING_TILE_VERTICES)
    once, each = STORE_BYTES[method]
    with file_run(opened, target, how, row_size=48, in_store=once + each * iterations) as run:
        if method == "paper":
            return _smooth_onto_patches(run, iterations, fit_options)
        return _smooth_automatically(
            run, iterations, SmoothingOptions(borders, detail, relax, noise), keep_volume is not False
        )


def _smooth_automatically(run: FileRun, iterations: int, options: SmoothingOptions, keep_volume: bool) -> Report:
    """Automatic smoothing: the rounds of every iteration, and a final one."""
    how = {"quantity": "automatic smoothing", "iterations": iterations, "keep_volume": keep_volume}
    results, mesh, fixed = run.results(how | asdict(options)), run.store, options.borders == "fixed"
    common, folders = SmoothingRun(run, results), list[Location]()
    surface = StoredSurface(common, mesh)
    known = surface.learn_noise(options.sigma)
    for step in range(iterations):
        common.step, common.rounds, common.is_last = step + 1, 0, step + 1 == iterations
        here = known if step == 0 else surface.learn_noise()
        surface = denoise_surface(StoredSurface(common, surface.store), here, options)
        options = replace(options, sigma=None)
        folders.extend(surface.folders)
    components, steps, volume_before = common.components, None, None
    if components is not None and surface.done is not None:
        sums = _component_sums(surface.done.tiles, components.count)
        volume_before = float(sums[:, 0].sum())
        if keep_volume:
            steps = volume_steps(sums[:, 0], sums[:, 1:])
    of_steps = None if steps is None else save_array(results / "steps.bin", steps)
    finish = partial(finish_tile, mesh, surface.store, folders, fixed, components, of_steps)
    _, done = run_round(run, "finish", results / "finish", finish)
    run.write(done.tiles)
    warnings = []
    if known is None and not any(tile.rows()[DISPLACEMENT].any() for tile in done.tiles):
        warnings = [unknown_noise(explain_no_noise(store_neighbourhoods(mesh, FitOptions())))]
    return run.report() | {
        "iterations": iterations,
        "quality": DISPLACEMENT,
        "attributes": [DISPLACEMENT, SHARPNESS],
        "warnings": warnings,
        "noise": {
            "before": None if known is None else known.sigma,
            "after": None
            if known is None
            else float(np.sqrt(done.sums("squared_error")[0] / mesh.layout.vertex_count)),
            "length": None if known is None else known.length,
            "heavy": known is not None and known.heavy,
        },
        "volume": {"before": volume_before, "after": None if volume_before is None else float(done.sums("volume")[0])},
        "faces": dict(zip(FACE_COUNTS, done.sums("faces").astype(int).tolist(), strict=True)),
        "halo_rings": surface.reach,
    }


def _component_sums(tiles: Sequence[Tile], count: int) -> FloatArray:
    """Volumes of components before and along their moves, (c, 5), summed over the faces of all tiles."""
    result = np.zeros((count, 1 + len(VOLUME_STEPS)))
    for sums in (tile.report.sums for tile in tiles):
        result[np.array(sums["components"], dtype=np.int64)] += np.reshape(sums["volumes"], (-1, 1 + len(VOLUME_STEPS)))
    return result


def finish_tile(
    before: Store,
    smoothed: Store,
    folders: Sequence[Location],
    fixed: bool,
    stored: StoredComponents | None,
    steps: ArrayFile | None,
    tile: int,
) -> tuple[Values, TileReport]:
    """Final vertices of a tile, from the mesh before and after the iterations.

    `folders` has the results of the iterations. Fixed borders stay. Closed components are given if the mesh is
    oriented; each moves outwards by its step times the movement of its vertices.
    """
    part = tile_part(before, tile, FINISH_RINGS)
    mesh, own = prepare_mesh(part.mesh), part.own
    points = smoothed.coordinates_of(part.ids)
    components, numbers = (None, None) if stored is None else stored.select(part.ids)
    if components is not None and numbers is not None and len(numbers) and steps is not None:
        amounts = local_movement(omit_outliers(mesh, points), points) * movable_vertices(mesh, fixed)
        of_components = steps.take(numbers)
        points = apply_moves(components, points, of_components, outward_moves(mesh.move(points), amounts))
    points, _ = reduce_intersections(mesh, repair_flipped_faces(mesh, points))
    of_tile = part.faces_of_tile()
    volume = 0.0
    if components is not None:
        volume = float(component_volumes(components, TriangleMesh(points, mesh.faces[of_tile])).sum())
    was, now = (bad_faces(one) for one in (mesh, mesh.move(points)))
    bad = (was.flipped, now.flipped, was.degenerate, now.degenerate, now.new_since(was))
    moved = np.linalg.norm(points[own] - mesh.vertices[own], axis=1)
    sharpness, error = np.zeros((2, len(moved)))
    for folder in folders:
        of_round = open_tile(folder, tile).rows()
        sharpness = np.maximum(sharpness, of_round[SHARPNESS])
        error = join_errors(error, of_round[NOISE], of_round[ERROR])
    rows = table_of(points[own], {QUALITY: moved, DISPLACEMENT: moved, SHARPNESS: sharpness})
    sums = {
        "squared_error": [float(error @ error)],
        "volume": [volume],
        "faces": [float(faces[of_tile].sum()) for faces in bad],
    }
    return rows, TileReport(tile, len(part.ids), sums)


def move_tile(first: Store, current: Store, fit: SurfaceFit, tile: int) -> tuple[Values, TileReport]:
    """Vertices of a tile on their patches, and their distances from the first mesh."""
    geometry, part = fit_tile(current, fit, tile)
    displacements = np.zeros_like(part.mesh.vertices)
    displacements[part.own] = geometry.displacements
    points = part.mesh.vertices + admissible_displacements(prepare_mesh(part.mesh), displacements)
    moved = np.linalg.norm(points[part.own] - first.coordinates(*first.layout.tile(tile)), axis=1)
    rows = table_of(points[part.own], {QUALITY: moved, DISPLACEMENT: moved})
    return rows, TileReport(tile, len(part.ids), {})


def _smooth_onto_patches(run: FileRun, iterations: int, options: FitOptions) -> Report:
    """Move every vertex onto its patch, `iterations` times; returns the report."""
    current = run.store
    for step in range(iterations):
        results = run.results({"quantity": "patches", "options": asdict(options), "step": step})
        with run.stages.stage("learn"):
            fit = learn_fit(current, options)
        move = partial(move_tile, run.store, current, fit)
        current, done = run_round(run, f"step {step + 1}", results, move)
    run.write(done.tiles)
    return run.report() | {
        "iterations": iterations,
        "quality": DISPLACEMENT,
        "attributes": [DISPLACEMENT],
        "fit": asdict(fit.choice),
        "halo_rings": rings_needed(fit),
    }
