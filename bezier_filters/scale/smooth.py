"""Smooths meshes that do not fit into memory, file to file."""

import os
from collections.abc import Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, Report
from bezier_filters.errors import InvalidParameterError
from bezier_filters.fields import PREFIX, QUALITY
from bezier_filters.fitting.outlier_removal import OUTLIER_REACH
from bezier_filters.fitting.surface_fit import SurfaceFit
from bezier_filters.meshes.adjacency import incoherent_vertices
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.meshes.prepared_mesh import PreparedMesh, prepare_mesh
from bezier_filters.meshes.spatial_order import cuthill_mckee_order
from bezier_filters.noise.noise_model import NoiseModel
from bezier_filters.runtime.atomic import atomic_write
from bezier_filters.runtime.parallel import single_threaded_blas
from bezier_filters.scale.array_file import ArrayFile, Values, save_array
from bezier_filters.scale.components import StoredComponents, label_vertices, merge_components
from bezier_filters.scale.estimate import fit_tile
from bezier_filters.scale.halo import TilePart, tile_part
from bezier_filters.scale.learn import (
    check_tile_options,
    learn_fit,
    learn_store_noise,
    rings_needed,
    sample_store_parts,
)
from bezier_filters.scale.run import Round, Run, RunOptions, StageProgress, TileTask, file_run
from bezier_filters.scale.scheduling import Scheduler
from bezier_filters.scale.source import SourcePath, open_source
from bezier_filters.scale.store import Store
from bezier_filters.scale.tiles import Tile, TileReport, open_tile, table_of
from bezier_filters.smoothing.denoise import SmoothingOptions, SmoothingPlan, denoise, halo_rings, learn_plan
from bezier_filters.smoothing.denoise_with_outliers import (
    choose_outliers_or_noise,
    move_mesh_outliers,
    needs_outlier_removal,
    unfold_surface,
)
from bezier_filters.smoothing.flipped_faces import bad_faces, repair_flipped_faces
from bezier_filters.smoothing.impulses import (
    MAX_IMPULSE_ROUNDS,
    Impulses,
    has_settled,
    learn_impulses,
    remove_impulses,
)
from bezier_filters.smoothing.mesh_parts import MAX_WHOLE_VERTICES, MeshPart, reorder_part
from bezier_filters.smoothing.noise import ROUGHNESS_RINGS, roughest_vertices, roughness
from bezier_filters.smoothing.sliding import SLIDING_RINGS
from bezier_filters.smoothing.smooth import SmoothedBorders, SmoothingMethod, admissible_displacements, check_smoothing
from bezier_filters.smoothing.volume import (
    VOLUME_STEPS,
    apply_moves,
    component_volumes,
    local_movement,
    outward_moves,
    volume_steps,
    volumes_along,
)
from bezier_filters.surface_model.fit_options import FitOptions

# columns of the displacement and of the weight of sharp estimates
DISPLACEMENT, SHARPNESS = PREFIX + "displacement", PREFIX + "sharpness"
PAPER_OPTIONS = FitOptions(rings=2, alpha=0.8, smoothness="paper")  # as ``bezier_filters.smooth(..., method="paper")``
STORE_BYTES = {"auto": (90, 56), "paper": (0, 64)}  # bytes per vertex in the store, once and per iteration
# halo for the repair of flipped faces: a few times `REPAIR_RINGS` of `smoothing.flipped_faces`
FINISH_RINGS = 8
SMOOTHING_TILE_VERTICES = 5 << 18  # vertices; larger tiles, as the halos of the automatic smoothing are wide
# counts of faces in the report
FACE_COUNTS = ("flipped before", "flipped after", "degenerate before", "degenerate after", "new")


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
        Report, as of `estimate_file`; computed and damaged tiles are those of all rounds.

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
    >>> bool(np.abs(moved - smooth(vertices, ball.faces).vertices).max() < 0.01 * report["noise"]["before"])
    True
    """
    check_smoothing(method, iterations, noise, borders, detail, relax)
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


def _smooth_automatically(run: Run, iterations: int, options: SmoothingOptions, keep_volume: bool) -> Report:
    """Automatic smoothing: a round that measures the mesh, one for every iteration, and a final one."""
    how = {"quantity": "automatic smoothing", "iterations": iterations, "keep_volume": keep_volume}
    results, mesh, fixed = run.results(how | asdict(options)), run.store, options.borders == "fixed"
    known = _noise_of(run, mesh, options.sigma)
    components: StoredComponents | None = None
    current, here, folders = mesh, known, list[Path]()
    for step in range(iterations):
        measured = current
        if step > 0:
            options, here = replace(options, sigma=None), _noise_of(run, current)
        current, here = _remove_outliers(run, current, here, results / f"clean-{step + 1}", options)
        impulses: Impulses | None = None
        before = np.zeros((0, 3))
        for k in range(1 + MAX_IMPULSE_ROUNDS):
            here, name, around = here or NoiseModel(0.0), f"{step + 1}-{k + 1}", tuple[int, ...]()
            is_first = step == k == 0
            if is_first or mesh.layout.vertex_count > MAX_WHOLE_VERTICES:
                look = partial(measure_tile, current, here.sigma)
                done = run.tiles("measure", results / f"measure-{name}", look)
                around = (_roughest(done.tiles),)
            if is_first and mesh.layout.face_count > 0 and not done.sums("incoherent")[0]:
                components = merge_components(mesh, done.tiles)
            with run.stages.stage("learn"):
                parts = sample_store_parts(current, around)
                learned = learn_plan(parts, here, options)
                plan = None if learned is None else learned[0]
            is_last = step + 1 == iterations
            is_cleaned = current is not measured
            reach = halo_rings(plan) + (FINISH_RINGS if is_cleaned else 0)
            last = components if is_last else None
            job = partial(smooth_tile, mesh, current, plan, reach, fixed, is_cleaned, last)
            folder = results / f"smooth-{name}"
            current, done = _run_round(run, "smooth", folder, job)
            if options.sigma is None:
                with run.stages.stage("learn"):
                    impulses, before = _learn_impulses(measured, current, impulses, before)
            if impulses is None or k == MAX_IMPULSE_ROUNDS:
                break
            corrected = partial(correct_tile, measured, current, impulses)
            current, _ = _run_round(run, "correct", results / f"correct-{name}", corrected)
            here = _noise_of(run, current, robust=False)
        folders.append(folder)
    steps, volume_before = None, None
    if components is not None:
        sums = _component_sums(done.tiles, components.count)
        volume_before = float(sums[:, 0].sum())
        if keep_volume:
            steps = volume_steps(sums[:, 0], sums[:, 1:])
    of_steps = None if steps is None else save_array(results / "steps.bin", steps)
    finish = partial(finish_tile, mesh, current, folders, fixed, components, of_steps)
    current, done = _run_round(run, "finish", results / "finish", finish)
    left = _noise_of(run, current)
    run.write(done.tiles)
    return run.report() | {
        "iterations": iterations,
        "quality": DISPLACEMENT,
        "attributes": [DISPLACEMENT, SHARPNESS],
        "noise": {
            "before": None if known is None else known.sigma,
            "after": None if left is None else left.sigma,
            "length": None if known is None else known.length,
            "heavy": known is not None and known.heavy,
        },
        "volume": {"before": volume_before, "after": None if volume_before is None else float(done.sums("volume")[0])},
        "faces": dict(zip(FACE_COUNTS, done.sums("faces").astype(int).tolist(), strict=True)),
        "halo_rings": reach,
    }


def _noise_of(run: Run, store: Store, sigma: float | None = None, robust: bool | None = None) -> NoiseModel | None:
    """Noise of a mesh, with a given standard deviation if known; includes the outliers if not `robust`."""
    with run.stages.stage("learn"):
        return learn_store_noise(store, sigma, robust)


def _remove_outliers(
    run: Run, store: Store, noise: NoiseModel | None, folder: Path, options: SmoothingOptions
) -> tuple[Store, NoiseModel | None]:
    """Remove the outliers of a mesh where `denoise_mesh` does; returns the mesh and its remaining noise.

    The folder of each round has this name with a number.
    """
    if noise is not None and noise.outliers:
        with run.stages.stage("learn"):
            are_noise, _ = choose_outliers_or_noise(sample_store_parts(store), noise, options)
        if are_noise:
            return store, _noise_of(run, store, options.sigma, robust=False)
    rounds = 0
    while needs_outlier_removal(noise, rounds):
        rounds += 1
        of_round = folder.with_name(f"{folder.name}-{rounds}")
        store, _ = _run_round(run, "clean", of_round, partial(clean_tile, store))
        noise = _noise_of(run, store, options.sigma)
    return store, noise


def _learn_impulses(
    measured: Store, smoothed: Store, impulses: Impulses | None, before: FloatArray
) -> tuple[Impulses | None, FloatArray]:
    """Learn impulses after a round as `denoise_mesh` does, None if it has converged; also returns the points.

    `impulses` and `before` are the impulses and the points of the previous round.
    """
    parts = sample_store_parts(smoothed)
    points = parts.mesh.vertices
    if impulses is not None and has_settled(before, points, impulses):
        return None, points
    return learn_impulses(sample_store_parts(measured).mesh.vertices, parts), points


def _run_round(run: Run, stage: str, folder: Path, move: TileTask) -> tuple[Store, Round]:
    """Run a round that moves vertices; returns the mesh, with float64 coordinates in one file, and the round."""
    done, path = run.tiles(stage, folder, move), folder / "vertices.bin"
    with atomic_write(path) as temporary, open(temporary, "wb") as stream:
        for tile in done.tiles:
            rows = tile.rows()
            np.column_stack([rows[axis] for axis in "xyz"]).tofile(stream)
    n = run.store.layout.vertex_count
    return replace(run.store, vertices=ArrayFile(path, np.dtype(("f8", 3)), n)), done


def _component_sums(tiles: Sequence[Tile], count: int) -> FloatArray:
    """Volumes of components before and along their moves, (c, 5), summed over the faces of all tiles."""
    result = np.zeros((count, 1 + len(VOLUME_STEPS)))
    for sums in (tile.report.sums for tile in tiles):
        result[np.array(sums["components"], dtype=np.int64)] += np.reshape(sums["volumes"], (-1, 1 + len(VOLUME_STEPS)))
    return result


def _roughest(tiles: Sequence[Tile]) -> int:
    """The roughest vertex, by its number in the source."""
    values, ids = (np.concatenate([tile.report.sums[name] for tile in tiles]) for name in ("roughness", "roughest"))
    return int(ids[roughest_vertices(values, ids.astype(np.int32))[0]])


def measure_tile(store: Store, sigma: float, tile: int) -> tuple[Values, TileReport]:
    """Component labels of a tile, and the roughest vertex if the mesh is large."""
    is_large = store.layout.vertex_count > MAX_WHOLE_VERTICES and sigma > 0.0
    part = tile_part(store, tile, ROUGHNESS_RINGS if is_large else 1)
    mesh = prepare_mesh(part.mesh)
    values, ids = np.zeros(1), np.zeros(1, dtype=np.int32)
    if is_large:
        piece = _mesh_part(store, part, mesh)
        values, ids = roughness(piece, sigma)[part.own], piece.ids[part.own]
    places = roughest_vertices(values, ids)
    incoherent = incoherent_vertices(mesh.faces, mesh.adjacency)[part.own].any()
    sums = {"roughness": values[places].tolist(), "roughest": ids[places].tolist(), "incoherent": [float(incoherent)]}
    return label_vertices(part, mesh.adjacency), TileReport(tile, len(part.ids), sums)


def clean_tile(store: Store, tile: int) -> tuple[Values, TileReport]:
    """Vertices of a tile after the removal of outliers."""
    part = tile_part(store, tile, OUTLIER_REACH)
    points = move_mesh_outliers(prepare_mesh(part.mesh)).vertices
    return table_of(points[part.own], {}), TileReport(tile, len(part.ids), {})


def correct_tile(measured: Store, smoothed: Store, impulses: Impulses, tile: int) -> tuple[Values, TileReport]:
    """Measured vertices of a tile, without those hit by impulses."""
    part = tile_part(smoothed, tile, SLIDING_RINGS)
    points = remove_impulses(measured.coordinates_of(part.ids), prepare_mesh(part.mesh), impulses)
    return table_of(points[part.own], {}), TileReport(tile, len(part.ids), {})


def _mesh_part(store: Store, part: TilePart, mesh: PreparedMesh) -> MeshPart:
    core = np.zeros(len(part.ids), dtype=np.bool_)
    core[part.own] = True
    return MeshPart(mesh, store.sources(part.ids), part.cut, core, store.layout.vertex_count)


def _denoise_part(store: Store, part: TilePart, plan: SmoothingPlan) -> tuple[FloatArray, FloatArray]:
    """Denoised vertices of a part, (k, 3), and weights of sharp estimates, (k,)."""
    mesh = prepare_mesh(part.mesh)
    ordered = cuthill_mckee_order(mesh)  # faster than the Morton order for repeated filters
    piece = reorder_part(_mesh_part(store, part, mesh), ordered)
    del mesh  # saves memory
    found = denoise(piece, plan)
    return ordered.restore_order(found.points), ordered.restore_order(found.sharpness)


def smooth_tile(
    first: Store,
    current: Store,
    plan: SmoothingPlan | None,
    reach: int,
    fixed: bool,
    is_cleaned: bool,
    stored: StoredComponents | None,
    tile: int,
) -> tuple[Values, TileReport]:
    """Smoothed vertices of a tile after an iteration, and weights of sharp estimates.

    `first` and `current` are the mesh before all iterations and before this one, the latter possibly without outliers.
    There is no plan without significant noise. `reach` is the width of the halo in rings. Fixed borders stay. The
    volumes of closed components are reported if `stored` is given.
    """
    part = tile_part(current, tile, reach)
    mesh, own = prepare_mesh(part.mesh), part.own
    points, sharpness = mesh.vertices, np.zeros(len(part.ids))
    if plan is not None:
        points, sharpness = _denoise_part(current, part, plan)
    movable = _movable(mesh, fixed)
    if is_cleaned:
        points = unfold_surface(mesh, points)
    points = np.where(movable[:, np.newaxis], points, mesh.vertices)
    rows = table_of(points[own], {SHARPNESS: sharpness[own]})
    sums: dict[str, list[float]] = {}
    if stored is not None:
        before = mesh.move(first.coordinates_of(part.ids))
        components, numbers = stored.select(part.ids)
        moves = outward_moves(mesh.move(points), local_movement(before, points) * movable)
        of_tile = mesh.faces[part.faces_of_tile()]
        volumes = component_volumes(components, TriangleMesh(before.vertices, of_tile))
        along = volumes_along(components, TriangleMesh(points, of_tile), moves)
        sums |= {"components": numbers.tolist(), "volumes": np.column_stack([volumes, along]).ravel().tolist()}
    return rows, TileReport(tile, len(part.ids), sums)


def _movable(mesh: PreparedMesh, fixed: bool) -> BoolArray:
    """Vertices that may move."""
    return ~mesh.adjacency.on_boundary if fixed else np.ones(mesh.vertex_count, dtype=np.bool_)


def finish_tile(
    before: Store,
    smoothed: Store,
    folders: Sequence[Path],
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
    if components is not None and steps is not None and components.count:
        amounts = local_movement(mesh, points) * _movable(mesh, fixed)
        of_components = np.array(steps.memory_map()[numbers])
        points = apply_moves(components, points, of_components, outward_moves(mesh.move(points), amounts))
    points = repair_flipped_faces(mesh, points)
    of_tile = part.faces_of_tile()
    volume = 0.0
    if components is not None:
        volume = float(component_volumes(components, TriangleMesh(points, mesh.faces[of_tile])).sum())
    was, now = (bad_faces(one) for one in (mesh, mesh.move(points)))
    bad = (was.flipped, now.flipped, was.degenerate, now.degenerate, now.new_since(was))
    moved = np.linalg.norm(points[own] - mesh.vertices[own], axis=1)
    sharpness = np.max([open_tile(folder, tile).rows()[SHARPNESS] for folder in folders], axis=0)
    rows = table_of(points[own], {QUALITY: moved, DISPLACEMENT: moved, SHARPNESS: sharpness})
    sums = {"volume": [volume], "faces": [float(faces[of_tile].sum()) for faces in bad]}
    return rows, TileReport(tile, len(part.ids), sums)


def move_tile(first: Store, current: Store, fit: SurfaceFit, creases: bool, tile: int) -> tuple[Values, TileReport]:
    """Vertices of a tile on their patches, and their distances from the first mesh."""
    geometry, part = fit_tile(current, fit, creases, tile)
    displacements = np.zeros_like(part.mesh.vertices)
    displacements[part.own] = geometry.displacements
    points = part.mesh.vertices + admissible_displacements(prepare_mesh(part.mesh), displacements)
    moved = np.linalg.norm(points[part.own] - first.coordinates(*first.layout.tile(tile)), axis=1)
    rows = table_of(points[part.own], {QUALITY: moved, DISPLACEMENT: moved})
    return rows, TileReport(tile, len(part.ids), {})


def _smooth_onto_patches(run: Run, iterations: int, options: FitOptions) -> Report:
    """Move every vertex onto its patch, `iterations` times; returns the report."""
    current = run.store
    for step in range(iterations):
        results = run.results({"quantity": "patches", "options": asdict(options), "step": step})
        with run.stages.stage("learn"):
            fit = learn_fit(current, options)
        move = partial(move_tile, run.store, current, fit, not options.is_fixed)
        current, done = _run_round(run, f"step {step + 1}", results, move)
    run.write(done.tiles)
    return run.report() | {
        "iterations": iterations,
        "quality": DISPLACEMENT,
        "attributes": [DISPLACEMENT],
        "fit": asdict(fit.choice),
        "halo_rings": rings_needed(fit),
    }
