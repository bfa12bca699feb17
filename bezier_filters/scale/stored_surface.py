"""Noise removal on a mesh in a store: the steps of `smoothing.rounds`, each a round of tasks on all tiles."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.fields import PREFIX
from bezier_filters.fitting.outlier_removal import OUTLIER_REACH
from bezier_filters.meshes.adjacency import incoherent_vertices
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.meshes.prepared_mesh import PreparedMesh, prepare_mesh
from bezier_filters.meshes.spatial_order import cuthill_mckee_order
from bezier_filters.noise.noise_model import NoiseModel
from bezier_filters.runtime.cached_property import cached_property
from bezier_filters.runtime.parallel import Progress
from bezier_filters.sampling.mesh_parts import MAX_WHOLE_VERTICES, MeshPart, reorder_part
from bezier_filters.scale.array_file import ArrayFile, Values
from bezier_filters.scale.components import StoredComponents, label_vertices, merge_components
from bezier_filters.scale.halo import TilePart, tile_part
from bezier_filters.scale.learn import learn_store_noise, sample_store_parts
from bezier_filters.scale.remote import Location, write_file
from bezier_filters.scale.run import Round, Run, TileTask
from bezier_filters.scale.store import Store
from bezier_filters.scale.tiles import Tile, TileReport, table_of
from bezier_filters.smoothing.denoise import (
    DenoisedMesh,
    SmoothingOptions,
    SmoothingPlan,
    denoise,
    halo_rings,
    learn_and_denoise,
)
from bezier_filters.smoothing.impulses import Impulses, remove_impulses
from bezier_filters.smoothing.noise import ROUGHNESS_RINGS, roughest_vertices, roughness
from bezier_filters.smoothing.rounds import move_mesh_outliers, unfold_surface
from bezier_filters.smoothing.sliding import SLIDING_RINGS
from bezier_filters.smoothing.volume import (
    component_volumes,
    local_movement,
    omit_outliers,
    outward_moves,
    volumes_along,
)

SHARPNESS = PREFIX + "sharpness"  # column of the weight of sharp estimates
NOISE, ERROR = "noise", "error"  # columns of `DenoisedMesh`
# halo for the repair of flipped faces: a few times `REPAIR_RINGS` of `smoothing.flipped_faces`
FINISH_RINGS = 8


@dataclass
class SmoothingRun:
    """State that the rounds of smoothing a mesh in a store share."""

    run: Run
    results: Location  # folder of the results
    step: int = 0  # number of the iteration, from 1
    is_last: bool = False  # whether it is the last iteration, which reports the volumes
    rounds: int = 0  # number of rounds of noise removal in this iteration
    components: StoredComponents | None = None  # closed components, from the first round


@dataclass(frozen=True)
class StoredSurface:
    """A `NoisySurface` in a store."""

    common: SmoothingRun
    store: Store  # with the coordinates of this surface
    outlier_rounds: int = 0
    done: Round | None = None  # the round that removed its noise
    folders: tuple[Location, ...] = ()  # results of the rounds that removed it
    reach: int = 0  # rings of its halo

    def learn_noise(self, sigma: float | None = None, robust: bool | None = None) -> NoiseModel | None:
        """Learn the noise from samples."""
        mean_edge = self.parts.mesh.mean_edge
        with self.common.run.stages.stage("learn"):
            return learn_store_noise(self.store, mean_edge, sigma, robust)

    @cached_property
    def parts(self) -> MeshPart:
        """The parts that are sampled in memory."""
        with self.common.run.stages.stage("learn"):
            return sample_store_parts(self.store)

    def points_of(self, ids: IntArray) -> FloatArray:
        """Coordinates (k, 3) of vertices of the sampled parts, whose ids are the same for all surfaces."""
        return np.asarray(self.parts.mesh.vertices[np.searchsorted(self.parts.ids, ids)])

    def move_outliers(self) -> "StoredSurface":
        """The surface with its outliers moved onto the surface around them."""
        rounds = self.outlier_rounds + 1
        folder = self.common.results / f"clean-{self.common.step}-{rounds}"
        store, _ = run_round(self.common.run, "clean", folder, partial(clean_tile, self.store))
        return replace(self, store=store, outlier_rounds=rounds)

    def remove_noise(
        self, noise: NoiseModel, options: SmoothingOptions, *, unfold: bool, progress: Progress | None
    ) -> "StoredSurface":
        """The surface without its noise; on request without the folds that outliers have left."""
        common, run, store = self.common, self.common.run, self.store
        common.rounds += 1
        name, around = f"{common.step}-{common.rounds}", tuple[int, ...]()
        is_first = common.step == common.rounds == 1
        if is_first or store.layout.vertex_count > MAX_WHOLE_VERTICES:
            look = partial(measure_tile, store, noise.sigma)
            measured = run.tiles("measure", common.results / f"measure-{name}", look)
            around = (_roughest(measured.tiles),)
            if is_first and store.layout.face_count > 0 and not measured.sums("incoherent")[0]:
                common.components = merge_components(run.store, measured.tiles)
        with run.stages.stage("learn"):
            learned = learn_and_denoise(sample_store_parts(store, around), noise, options)
        plan = None if learned is None else learned[0]
        reach, folder = halo_rings(plan) + (FINISH_RINGS if unfold else 0), common.results / f"smooth-{name}"
        components, fixed = common.components if common.is_last else None, options.borders == "fixed"
        job = partial(smooth_tile, run.store, store, plan, noise.sigma, reach, fixed, unfold, components)
        smooth, done = run_round(run, "smooth", folder, job)
        return replace(self, store=smooth, done=done, folders=(*self.folders, folder), reach=reach)

    def remove_impulses(self, smooth: "StoredSurface", impulses: Impulses) -> "StoredSurface":
        """The measured surface without the impulses that a smooth one shows."""
        folder = self.common.results / f"correct-{self.common.step}-{self.common.rounds}"
        job = partial(correct_tile, self.store, smooth.store, impulses)
        store, _ = run_round(self.common.run, "correct", folder, job)
        return replace(self, store=store)

    def reuse_if_whole(self, parts: MeshPart, denoised: DenoisedMesh) -> "StoredSurface | None":
        """None: parts are denoised in memory, and the surface in its store."""
        return None


def run_round(run: Run, stage: str, folder: Location, move: TileTask) -> tuple[Store, Round]:
    """Run a round that moves vertices; returns the mesh, with float64 coordinates in one file, and the round."""
    done, path = run.tiles(stage, folder, move), folder / "vertices.bin"
    with write_file(path) as temporary, open(temporary, "wb") as stream:
        for tile in done.tiles:
            rows = tile.rows()
            np.column_stack([rows[axis] for axis in "xyz"]).tofile(stream)
    n = run.store.layout.vertex_count
    return replace(run.store, vertices=ArrayFile(path, np.dtype(("f8", 3)), n)), done


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


def _denoise_part(store: Store, part: TilePart, plan: SmoothingPlan) -> DenoisedMesh:
    """A part without its noise."""
    mesh = prepare_mesh(part.mesh)
    ordered = cuthill_mckee_order(mesh)  # faster than the Morton order for repeated filters
    piece = reorder_part(_mesh_part(store, part, mesh), ordered)
    del mesh  # saves memory
    found = denoise(piece, plan)
    return DenoisedMesh(**{name: ordered.restore_order(values) for name, values in vars(found).items()})


def smooth_tile(
    first: Store,
    current: Store,
    plan: SmoothingPlan | None,
    sigma: float,
    reach: int,
    fixed: bool,
    unfold: bool,
    stored: StoredComponents | None,
    tile: int,
) -> tuple[Values, TileReport]:
    """Smoothed vertices of a tile after a round, and weights of sharp estimates.

    `first` and `current` are the mesh before all rounds and before this one, the latter possibly without outliers.
    There is no plan without significant noise, of the standard deviation `sigma`. `reach` is the width of the halo in
    rings. Fixed borders stay. `unfold` removes folds that outliers have left. The volumes of closed components are
    reported if `stored` is given.
    """
    part = tile_part(current, tile, reach)
    mesh, own = prepare_mesh(part.mesh), part.own
    n = len(part.ids)
    found = DenoisedMesh(mesh.vertices, np.zeros(n), *np.full((2, n), sigma))
    if plan is not None:
        found = _denoise_part(current, part, plan)
    points = found.points
    movable = movable_vertices(mesh, fixed)
    if unfold:
        points = unfold_surface(mesh, points)
    if fixed:
        points = np.where(movable[:, np.newaxis], points, first.coordinates_of(part.ids))
    columns = {SHARPNESS: found.sharpness, NOISE: found.noise, ERROR: found.error}
    rows = table_of(points[own], {name: values[own] for name, values in columns.items()})
    sums: dict[str, list[float]] = {}
    if stored is not None:
        before = omit_outliers(mesh.move(first.coordinates_of(part.ids)), points)
        components, numbers = stored.select(part.ids)
        moves = outward_moves(mesh.move(points), local_movement(before, points) * movable)
        of_tile = mesh.faces[part.faces_of_tile()]
        volumes = component_volumes(components, TriangleMesh(before.vertices, of_tile))
        along = volumes_along(components, TriangleMesh(points, of_tile), moves)
        sums |= {"components": numbers.tolist(), "volumes": np.column_stack([volumes, along]).ravel().tolist()}
    return rows, TileReport(tile, len(part.ids), sums)


def movable_vertices(mesh: PreparedMesh, fixed: bool) -> BoolArray:
    """Vertices that may move."""
    return ~mesh.adjacency.on_boundary if fixed else np.ones(mesh.vertex_count, dtype=np.bool_)
