"""Learns the fit of a mesh on disk from the same samples as in memory."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

import numpy as np

from bezier_filters.arrays import BoolArray, IntArray
from bezier_filters.errors import InvalidParameterError
from bezier_filters.fitting.adaptive_fit import (
    PROBE_COUNT,
    ProbeVertices,
    SurfaceFit,
    add_regions,
    choose_fit,
    first_features,
)
from bezier_filters.fitting.fallbacks import FitAttempt, fit_with_fallbacks
from bezier_filters.fitting.fit_options import check_detail, check_fit_noise, fit_options
from bezier_filters.fitting.noise_level import estimate_noise
from bezier_filters.fitting.outlier_removal import OUTLIER_REACH, move_outliers
from bezier_filters.fitting.vertex_geometry import empty_geometry
from bezier_filters.kernels.kernel_input import KernelMesh, prepare_kernel_mesh, use_smoothed_normals
from bezier_filters.meshes.frames import NORMAL_SMOOTHING_ROUNDS
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.meshes.prepared_mesh import prepare_mesh
from bezier_filters.patches.patch_fit import PatchFit
from bezier_filters.patches.smoothness import Smoothness
from bezier_filters.scale.halo import Part, part_around, part_around_samples, restore_source_order, tile_part
from bezier_filters.scale.store import Store
from bezier_filters.smoothing.mesh_parts import (
    PART_VERTICES,
    MeshPart,
    grow_component,
    mesh_part,
    next_unseen,
    sample_vertices,
)
from bezier_filters.surface_model.fit_spec import FitConstraints
from bezier_filters.surface_model.learn import SAMPLES_PER_RING, SampleMode, learn_from_samples, sample_by_mode
from bezier_filters.surface_model.model_tree import Leaf, leaves
from bezier_filters.surface_model.neighbourhood_samples import (
    NORMAL_CHECK_RINGS,
    NeighbourhoodSample,
    Population,
    draw_vertices,
)
from bezier_filters.surface_model.noise_model import NoiseModel
from bezier_filters.surface_model.ring_analysis import RingAnalysis
from bezier_filters.surface_model.sample_check import explain_unusable_sample

NORMAL_RINGS = 2  # rings that determine the normal of a vertex, also where its faces have zero area
CREASE_RINGS = 2  # rings that determine the tangent plane and the sharp edges of a vertex
# additional rings that a sample mode depends on; the tolerant mode is used for learning alone
EXTRA_RINGS: dict[SampleMode, int] = {"plain": 0, "steady": NORMAL_SMOOTHING_ROUNDS, "tolerant": 1}

MAX_TILE_RINGS = 100  # largest neighbourhood of meshes in tiles, in rings
# rings read around the first seed of a sampled part, and around the seeds of further components; doubled as needed
INITIAL_RINGS, SEED_RINGS = 64, 4
SEEDS_PER_STEP = 2048  # seeds of further components that are read together


@dataclass(frozen=True)
class FitOptions:
    """Options of `estimate_vertex_geometry` that apply to meshes on disk, too."""

    rings: int | Literal["auto"] = "auto"
    alpha: float | Literal["auto"] = "auto"
    degree: int | Literal["auto"] = "auto"
    smoothness: Smoothness = "third_order"
    robust: bool | None = None
    noise: float | None = None
    detail: float | None = None

    def check(self) -> tuple[int | Literal["auto"], PatchFit | None, tuple[int, ...]]:
        """Check the options and return the rings, the patch fit and the degrees to choose from, see `fit_options`."""
        rings, fixed, degrees = fit_options(self.rings, self.alpha, self.degree, self.smoothness)
        check_fit_noise(self.noise, fixed, rings)
        check_detail(self.detail, rings)
        if rings != "auto" and rings > MAX_TILE_RINGS:
            raise InvalidParameterError(f"rings: got {rings}, expected {MAX_TILE_RINGS} at most for a mesh in tiles")
        return rings, fixed, degrees

    @property
    def creases(self) -> bool:
        """Whether neighbourhoods end at creases."""
        return self.check()[1] is None


def learn_fit(store: Store, options: FitOptions) -> SurfaceFit:
    """Choose the fit of a mesh as `estimate_vertex_geometry` does in memory."""
    rings, fixed, degrees = options.check()
    learn = partial(_learn_surface, store, options)
    fit, learned = choose_fit(learn, rings, fixed, degrees, options.robust, options.noise, options.detail)
    if learned is None:
        if fit.choice.noise_sigma is None and (fixed is None or rings == "auto"):
            fit = replace(fit, choice=replace(fit.choice, noise_reason=_explain_unusable_store(store, options)))
        return fit
    drawn = _draw(store, PROBE_COUNT)
    known = np.union1d(learned.centers, drawn)
    mode: SampleMode = "steady" if fit.steady else "plain"
    reach = _reach(_widest(fit.attempts), mode, fit.cleaned)
    part = part_around_samples(store, known, reach)
    local = part.local(known)
    arrays = mesh_to_fit(part.mesh, options.creases, fit.cleaned, fit.steady)
    geometry = empty_geometry(len(arrays.vertices))
    fit_with_fallbacks(arrays, local, fit.attempts, geometry, robust=fit.robust)
    features = first_features(geometry, local)

    def sample(centers: IntArray, rings: int) -> NeighbourhoodSample:
        return _sample_at(store, options, centers, rings, mode)

    places = ProbeVertices(drawn, lambda centers: features[np.searchsorted(known, centers)], sample)
    return add_regions(fit, learned, places)


def _explain_unusable_store(store: Store, options: FitOptions) -> str:
    """Why nothing could be learned of a mesh, as in memory."""
    return explain_unusable_sample(
        _sample_at(store, options, _draw(store, SAMPLES_PER_RING[NORMAL_CHECK_RINGS]), NORMAL_CHECK_RINGS, "plain")
    )


def learn_store_noise(store: Store, sigma: float | None = None, robust: bool | None = None) -> NoiseModel | None:
    """The noise of a mesh, as `noise_level.learn_mesh_noise` learns it in memory."""
    return estimate_noise(partial(_learn_surface, store, FitOptions()), sigma, robust)


def _learn_surface(
    store: Store, options: FitOptions, choices: FitConstraints, without: bool
) -> tuple[list[RingAnalysis], Leaf | None]:
    """Learn the surface model of a mesh as in memory, on request without its outliers."""

    def sample(rings: int, count: int, mode: SampleMode) -> NeighbourhoodSample:
        return _sample_at(store, options, _draw(store, count), rings, mode, without)

    return learn_from_samples(sample, store.layout.vertex_count, choices)


def rings_needed(fit: SurfaceFit) -> int:
    """Number of rings around a vertex that its values depend on."""
    parts = [] if fit.regions is None else leaves(fit.regions)
    attempts = [*fit.attempts, *(attempt for part in parts for attempt in part.attempts)]
    return _reach(_widest(attempts), "steady" if fit.steady else "plain", fit.cleaned)


def _reach(rings: int, mode: SampleMode, without: bool) -> int:
    """Number of rings that a sample of `rings` rings depends on, on request without outliers."""
    return rings + CREASE_RINGS + (OUTLIER_REACH if without else 0) + EXTRA_RINGS[mode]


def _widest(attempts: Sequence[FitAttempt]) -> int:
    return max(attempt.rings for attempt in attempts)


def _draw(store: Store, count: int) -> IntArray:
    """The sample of vertices that is drawn in memory."""

    def have_normals(ids: IntArray) -> BoolArray:
        part = part_around_samples(store, np.unique(ids), NORMAL_RINGS)
        return _have_normals(part)[part.local(ids)]

    every = Population(store.layout.vertex_count, partial(_ranks, store))
    return draw_vertices(every, have_normals, partial(_normal_population, store), count)


def _sample_at(
    store: Store, options: FitOptions, centers: IntArray, rings: int, mode: SampleMode, without: bool = False
) -> NeighbourhoodSample:
    """Sample the neighbourhoods of some vertices."""
    part = part_around_samples(store, centers, _reach(rings, mode, without))
    arrays = mesh_to_fit(part.mesh, options.creases, without)
    return sample_by_mode(arrays, part.local(centers), rings, mode)._replace(centers=centers)


def mesh_to_fit(mesh: TriangleMesh, creases: bool, without: bool, steady: bool = False) -> KernelMesh:
    """Kernel input for a part of a mesh, on request without outliers and with smoothed normals; see `_reach`."""
    arrays = prepare_kernel_mesh(mesh, creases=creases)
    if without:
        arrays = move_outliers(arrays)
    return use_smoothed_normals(arrays) if steady else arrays


def _have_normals(part: Part) -> BoolArray:
    """Whether vertices have a normal."""
    return np.asarray(prepare_mesh(part.mesh).planes.normals.any(axis=1))


def _normal_population(store: Store) -> Population:
    """All vertices with a normal, in the order of the source, found tile by tile, with 9 bytes per vertex."""
    marks = np.zeros(store.layout.vertex_count, dtype=np.bool_)
    for tile in range(store.layout.tile_count):
        part = tile_part(store, tile, NORMAL_RINGS)
        marks[store.sources(part.ids[part.own])] = _have_normals(part)[part.own]
    numbers = np.flatnonzero(marks).astype(np.int32)
    return Population(len(numbers), lambda chosen: _ranks(store, numbers[chosen]))


def sample_store_parts(store: Store, around: Sequence[int] = ()) -> MeshPart:
    """The same parts as `smoothing.mesh_parts` samples in memory, with the vertex numbers of the source."""
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
    return np.array(store.rank.memory_map()[numbers], dtype=np.int32)
