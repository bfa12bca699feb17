"""Learns the fit of a mesh on disk from the same samples as in memory."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.errors import InvalidParameterError
from bezier_filters.fitting.fallbacks import FitAttempt, fit_with_fallbacks
from bezier_filters.fitting.noise_level import estimate_noise
from bezier_filters.fitting.outlier_removal import OUTLIER_REACH, move_outliers
from bezier_filters.fitting.region_fits import PROBE_COUNT, add_regions, first_features
from bezier_filters.fitting.surface_fit import SurfaceFit, choose_fit
from bezier_filters.fitting.vertex_geometry import empty_geometry
from bezier_filters.kernels.kernel_input import KernelMesh, prepare_kernel_mesh, use_smoothed_normals
from bezier_filters.meshes.frames import NORMAL_SMOOTHING_ROUNDS
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.meshes.prepared_mesh import prepare_mesh
from bezier_filters.noise.noise_model import NO_NOISE, NoiseModel
from bezier_filters.noise.rounded_coordinates import rounding_noise
from bezier_filters.sampling.mesh_parts import (
    PART_VERTICES,
    MeshPart,
    grow_component,
    mesh_part,
    next_unseen,
    sample_vertices,
)
from bezier_filters.sampling.neighbourhood_samples import (
    NeighbourhoodSample,
    SampleMode,
    draw_vertices,
    sample_by_mode,
)
from bezier_filters.scale.halo import Part, part_around, part_around_samples, restore_source_order, tile_part
from bezier_filters.scale.store import Store
from bezier_filters.surface_model.fit_options import FitOptions
from bezier_filters.surface_model.model_tree import leaves

NORMAL_RINGS = 2  # rings that determine the normal of a vertex, also where its faces have zero area
CREASE_RINGS = 2  # rings that determine the tangent plane and the sharp edges of a vertex
# additional rings that a sample mode depends on; the tolerant mode is used for learning alone
EXTRA_RINGS: dict[SampleMode, int] = {"plain": 0, "smoothed": NORMAL_SMOOTHING_ROUNDS, "tolerant": 1}

MAX_TILE_RINGS = 100  # largest neighbourhood of meshes in tiles, in rings
# rings read around the first seed of a sampled part, and around the seeds of further components; doubled as needed
INITIAL_RINGS, SEED_RINGS = 64, 4
SEEDS_PER_STEP = 2048  # seeds of further components that are read together


@dataclass(frozen=True)
class StoreNeighbourhoods:
    """The `Neighbourhoods` of a mesh in a store, the same as of the mesh in memory."""

    store: Store
    with_barriers: bool = True  # whether neighbourhoods end at sharp edges
    is_clean: bool = False  # whether the outliers are moved onto the surface around them
    rounding: NoiseModel = NO_NOISE  # noise of rounded coordinates, see `rounding_noise`

    @property
    def vertex_count(self) -> int:
        """Number of vertices."""
        return self.store.layout.vertex_count

    @property
    def clean(self) -> "StoreNeighbourhoods":
        """The same with the outliers moved onto the surface around them."""
        return replace(self, is_clean=True)

    def locate(self, vertices: IntArray) -> tuple[FloatArray, FloatArray]:
        """Coordinates and unit normals of some vertices, (k, 3) each."""
        part = part_around_samples(self.store, np.unique(vertices), NORMAL_RINGS)
        at = part.local(vertices)
        return part.mesh.vertices[at], prepare_mesh(part.mesh).planes.normals[at]

    def draw(self, count: int) -> IntArray:
        """Draw the vertices that are drawn in memory."""
        store = self.store

        def have_normals(ids: IntArray) -> BoolArray:
            part = part_around_samples(store, np.unique(ids), NORMAL_RINGS)
            return _have_normals(part)[part.local(ids)]

        return draw_vertices(
            self.vertex_count, partial(_ranks, store), have_normals, partial(_list_with_normals, store), count
        )

    def sample(self, vertices: IntArray, rings: int, mode: SampleMode) -> NeighbourhoodSample:
        """Sample the neighbourhoods of some vertices, out to a widest ring."""
        part = part_around_samples(self.store, vertices, _reach(rings, mode, self.is_clean))
        arrays = mesh_to_fit(part.mesh, self.with_barriers, self.is_clean, mode == "smoothed")
        keep = self.rounding.variance > 0.0
        found = sample_by_mode(arrays, part.local(vertices), rings, mode, keep_barriers=keep)
        return found._replace(centers=vertices)


def store_neighbourhoods(store: Store, options: FitOptions) -> StoreNeighbourhoods:
    """Neighbourhoods of a mesh in a store, as `mesh_neighbourhoods` makes them in memory."""
    if options.is_fixed:
        return StoreNeighbourhoods(store, with_barriers=False)
    rounding = rounding_noise(sample_store_parts(store).mesh)
    return StoreNeighbourhoods(store, with_barriers=rounding.variance == 0.0, rounding=rounding)


def check_tile_options(options: FitOptions) -> None:
    """Refuse options that are out of range, or not for meshes in tiles.

    Raises
    ------
    InvalidParameterError
        It names the parameter.
    """
    options.check()
    if options.radius is not None:
        raise InvalidParameterError(f"radius: got {options.radius!r}; meshes in tiles have rings only, give rings")
    if options.neighbours is not None:
        raise InvalidParameterError(f"neighbours: got {options.neighbours!r}; meshes in tiles have rings, give rings")
    if (options.ring_count or 0) > MAX_TILE_RINGS:
        raise InvalidParameterError(
            f"rings: got {options.rings!r}, expected {MAX_TILE_RINGS} at most for a mesh in tiles"
        )


def learn_fit(store: Store, options: FitOptions) -> SurfaceFit:
    """Choose the fit of a mesh as `estimate_vertex_geometry` does in memory."""
    source = store_neighbourhoods(store, options)
    fit, whole = choose_fit(source, options)
    fit = replace(fit, with_barriers=source.with_barriers)
    if whole is None:
        return fit
    probes = source.draw(PROBE_COUNT)
    sampled = np.union1d(whole.centers, probes).astype(np.int32)
    part = part_around_samples(store, sampled, rings_needed(fit))
    local = part.local(sampled)
    arrays = mesh_to_fit(part.mesh, source.with_barriers, fit.cleaned, fit.smooth_normals)
    geometry = empty_geometry(len(arrays.vertices))
    fit_with_fallbacks(arrays, local, fit.attempts, geometry, robust=fit.robust)
    return add_regions(fit, whole, source, options, probes, sampled, first_features(geometry, local))


def learn_store_noise(
    store: Store, mean_edge: float, sigma: float | None = None, robust: bool | None = None
) -> NoiseModel | None:
    """The noise of a mesh, as `noise_level.learn_mesh_noise` learns it in memory; `mean_edge` may be that of parts."""
    return estimate_noise(store_neighbourhoods(store, FitOptions()), sigma, robust, mean_edge)


def rings_needed(fit: SurfaceFit) -> int:
    """Number of rings around a vertex that its values depend on."""
    parts = [] if fit.regions is None else leaves(fit.regions)
    attempts = [*fit.attempts, *(attempt for part in parts for attempt in part.attempts)]
    is_smoothed = fit.smooth_normals or any(attempt.smooth_normals for attempt in attempts)
    return _reach(_widest(attempts), "smoothed" if is_smoothed else "plain", fit.cleaned)


def _reach(rings: int, mode: SampleMode, without: bool) -> int:
    """Number of rings that a sample of `rings` rings depends on, on request without outliers."""
    return rings + CREASE_RINGS + (OUTLIER_REACH if without else 0) + EXTRA_RINGS[mode]


def _widest(attempts: Sequence[FitAttempt]) -> int:
    return max(attempt.rings for attempt in attempts)


def mesh_to_fit(mesh: TriangleMesh, with_barriers: bool, clean: bool, smooth_normals: bool = False) -> KernelMesh:
    """Kernel input for a part of a mesh, on request without outliers and with smoothed normals; see `_reach`."""
    arrays = prepare_kernel_mesh(mesh, with_barriers=with_barriers)
    if clean:
        arrays = move_outliers(arrays)
    return use_smoothed_normals(arrays) if smooth_normals else arrays


def _have_normals(part: Part) -> BoolArray:
    """Whether vertices have a normal."""
    return np.asarray(prepare_mesh(part.mesh).planes.normals.any(axis=1))


def _list_with_normals(store: Store) -> IntArray:
    """All vertices with a normal, in the order of the source, found tile by tile, with 9 bytes per vertex."""
    marks = np.zeros(store.layout.vertex_count, dtype=np.bool_)
    for tile in range(store.layout.tile_count):
        part = tile_part(store, tile, NORMAL_RINGS)
        marks[store.sources(part.ids[part.own])] = _have_normals(part)[part.own]
    return _ranks(store, np.flatnonzero(marks).astype(np.int32))


def sample_store_parts(store: Store, around: Sequence[int] = ()) -> MeshPart:
    """The same parts as `sampling.mesh_parts` samples in memory, with the vertex numbers of the source."""
    n = store.layout.vertex_count
    samples = sample_vertices(n, around, partial(_grow_from_seed, store))
    ids, mesh = restore_source_order(store, part_around(store, np.sort(_ranks(store, samples[0])), 1))
    return mesh_part(prepare_mesh(mesh), store.sources(ids), samples, n)


def _grow_from_seed(store: Store, seed: int) -> IntArray:
    """Vertices of the source around a seed, nearest first; further components start at the next unseen vertex."""
    n, found = store.layout.vertex_count, np.zeros(0, dtype=np.int32)
    seeds, rings = np.array([seed], dtype=np.int32), INITIAL_RINGS
    while True:
        ids, mesh = restore_source_order(store, part_around(store, np.sort(_ranks(store, seeds)), rings))
        numbers, rows = store.sources(ids), prepare_mesh(mesh).adjacency.vertices
        seen = np.isin(numbers, found)
        for seed, place in zip(seeds.tolist(), np.searchsorted(numbers, seeds).tolist(), strict=True):
            if seen[place]:
                continue
            order, looked_at = grow_component(rows, place, seen, PART_VERTICES - len(found))
            if looked_at >= rings:  # the component extends beyond the rings that were read
                seeds, rings = np.array([seed], dtype=np.int32), 2 * rings
                break
            found = np.append(found, numbers[order])
            if len(found) == PART_VERTICES:
                return found
        else:
            met = np.zeros(n, dtype=np.bool_)
            met[found] = True
            following = next_unseen(met, seed)
            if following < 0:
                return found
            seeds, rings = np.arange(following, min(following + SEEDS_PER_STEP, n), dtype=np.int32), SEED_RINGS


def _ranks(store: Store, numbers: IntArray) -> IntArray:
    """Positions in the store of vertices of the source."""
    return store.rank.take(numbers)
