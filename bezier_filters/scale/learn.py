"""Learns how to fit a mesh on disk from the same samples as in memory."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import chain
from typing import Literal

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.errors import InvalidParameterError
from bezier_filters.estimation.adaptive_fit import (
    LOOKED_AT,
    OUTLIER_REACH,
    Places,
    SurfaceFit,
    choose_fit,
    first_features,
    learn_without_outliers,
    with_parts,
    without_outliers,
)
from bezier_filters.estimation.fallbacks import FitAttempt, fit_with_fallbacks
from bezier_filters.estimation.fit_options import check_detail, check_fit_noise, fit_options
from bezier_filters.estimation.vertex_geometry import empty_geometry
from bezier_filters.kernels.kernel_input import fitted_mesh, with_steady_normals
from bezier_filters.learning.learn import MOST_TURNED, learn_from_samples
from bezier_filters.learning.model_tree import Leaf, leaves
from bezier_filters.learning.neighbourhood_samples import (
    NeighbourhoodSample,
    Population,
    draw_vertices,
    sample_neighbourhoods,
)
from bezier_filters.learning.noise_model import NoiseModel
from bezier_filters.learning.plans import Choices
from bezier_filters.learning.ring_analysis import RingAnalysis
from bezier_filters.meshes.adjacency import vertex_adjacency
from bezier_filters.meshes.frames import STEADY_ROUNDS, tangent_planes
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.patches.fitting import PatchFit
from bezier_filters.patches.smoothness import Smoothness
from bezier_filters.scale.halo import in_source_order, part_around, part_around_samples, tile_part
from bezier_filters.scale.store import Store
from bezier_filters.smoothing.mesh_parts import LARGEST_WHOLE, PART, Growth, MeshPart, SampledParts, core_of, part_seeds

CREASE_RINGS = 2  # around a vertex, within which faces decide about its plane and its creases

MOST_RINGS = 100  # that tiles may be asked to have around them
# that are read around a vertex, and around those where there was nothing more to grow to; more if that is too few
FIRST_RINGS, NEXT_RINGS = 64, 4
NEXT = 2048  # vertices whose surroundings are read together then


@dataclass(frozen=True)
class FitOptions:
    """Options of `estimate_vertex_geometry` that hold for meshes on disk, too."""

    rings: int | Literal["auto"] = "auto"
    alpha: float | Literal["auto"] = "auto"
    degree: int | Literal["auto"] = "auto"
    smoothness: Smoothness = "third_order"
    robust: bool | None = None
    noise: float | None = None
    detail: float | None = None

    def checked(self) -> tuple[int | Literal["auto"], PatchFit | None, tuple[int, ...]]:
        """What they leave open, see `fit_options`; refused if one is out of range."""
        rings, fixed, degrees = fit_options(self.rings, self.alpha, self.degree, self.smoothness)
        check_fit_noise(self.noise, fixed, rings)
        check_detail(self.detail, rings)
        if rings != "auto" and rings > MOST_RINGS:
            raise InvalidParameterError(f"rings: got {rings}, expected {MOST_RINGS} at most for a mesh in tiles")
        return rings, fixed, degrees

    @property
    def creases(self) -> bool:
        """Whether neighbourhoods end at creases."""
        return self.checked()[1] is None


def learn_fit(store: Store, options: FitOptions, *, threads: int = 1) -> SurfaceFit:
    """Choose how to fit a mesh: what `estimate_vertex_geometry` chooses for it in memory."""
    rings, fixed, degrees = options.checked()
    learn = partial(_learn_surface, store, options, threads)
    fit, learned = choose_fit(learn, rings, fixed, degrees, options.robust, options.noise, options.detail)
    if learned is None:
        return fit
    drawn = _draw(store, LOOKED_AT)
    known = np.union1d(learned.centers, drawn)
    features = _first_features(store, known, fit, options, threads)

    def sample(centers: IntArray, rings: int) -> NeighbourhoodSample:
        return _sample_at(store, options, threads, False, rings, fit.steady, centers)

    places = Places(drawn, lambda centers: features[np.searchsorted(known, centers)], sample)
    return with_parts(fit, learned, places, threads=threads)


def learn_noise(store: Store, *, threads: int = 1) -> NoiseModel | None:
    """The noise of a mesh along the normal; None if it is too small to learn it."""
    _, leaf = learn_without_outliers(partial(_learn_surface, store, FitOptions(), threads), Choices())
    return None if leaf is None else leaf.surface.noise


def _learn_surface(
    store: Store, options: FitOptions, threads: int, choices: Choices, without: bool
) -> tuple[list[RingAnalysis], Leaf | None]:
    """What is learned of a mesh in memory, as it is or without its outliers."""
    sample = partial(_sample, store, options, threads, without)
    return learn_from_samples(sample, store.layout.vertex_count, choices, threads=threads)


def rings_needed(fit: SurfaceFit) -> int:
    """How many rings around a vertex its values depend on."""
    chains = [fit.attempts] + ([] if fit.parts is None else [part.attempts for part in leaves(fit.parts)])
    steady = STEADY_ROUNDS if fit.steady else 0
    return _widest([attempt for chain in chains for attempt in chain]) + CREASE_RINGS + steady


def _widest(attempts: list[FitAttempt]) -> int:
    return max(attempt.rings for attempt in attempts)


def _sample(
    store: Store, options: FitOptions, threads: int, without: bool, rings: int, count: int, steady: bool
) -> NeighbourhoodSample:
    """The neighbourhoods that would be sampled in memory."""
    return _sample_at(store, options, threads, without, rings, steady, _draw(store, count))


def _draw(store: Store, count: int) -> IntArray:
    """The vertices that would be drawn in memory."""
    every = Population(store.layout.vertex_count, partial(_ranks, store))
    return draw_vertices(every, partial(_have_normals, store), partial(_with_normals, store), count)


def _sample_at(
    store: Store, options: FitOptions, threads: int, without: bool, rings: int, steady: bool, centers: IntArray
) -> NeighbourhoodSample:
    """The neighbourhoods of some vertices."""
    reach = rings + CREASE_RINGS + (OUTLIER_REACH if without else 0) + (STEADY_ROUNDS if steady else 0)
    part = part_around_samples(store, centers, reach, threads=threads)
    arrays, adjacency = fitted_mesh(part.mesh, creases=options.creases, threads=threads)
    if without:
        arrays = without_outliers(arrays, threads=threads)
    if steady:
        arrays = with_steady_normals(arrays, threads=threads)
    local = part.local(centers)
    sample = sample_neighbourhoods(arrays, adjacency, local, rings=rings, most_turned=MOST_TURNED, threads=threads)
    return sample._replace(centers=centers)


def _first_features(store: Store, centers: IntArray, fit: SurfaceFit, options: FitOptions, threads: int) -> FloatArray:
    """What the first fit shows at some vertices, (k, 2)."""
    reach = _widest(list(fit.attempts)) + CREASE_RINGS + (STEADY_ROUNDS if fit.steady else 0)
    part = part_around_samples(store, centers, reach, threads=threads)
    arrays, _ = fitted_mesh(part.mesh, creases=options.creases, threads=threads)
    if fit.steady:
        arrays = with_steady_normals(arrays, threads=threads)
    geometry, local = empty_geometry(part.mesh.vertex_count), part.local(centers)
    fit_with_fallbacks(arrays, local, fit.attempts, geometry, robust=fit.robust, threads=threads)
    return first_features(geometry, local)


def _have_normals(store: Store, ids: IntArray) -> BoolArray:
    """Whether vertices have a normal."""
    part = part_around_samples(store, np.unique(ids), 1)
    normals = tangent_planes(part.mesh, vertex_adjacency(part.mesh)).normals
    return np.asarray(normals[part.local(ids)].any(axis=1))


def _with_normals(store: Store) -> Population:
    """All vertices that have a normal, in the order of the source: found out tile by tile, 9 bytes per vertex."""
    marks = np.zeros(store.layout.vertex_count, dtype=np.bool_)
    for tile in range(store.layout.tile_count):
        part = tile_part(store, tile, 1)
        normals = tangent_planes(part.mesh, vertex_adjacency(part.mesh)).normals
        marks[store.sources(part.ids[part.own])] = normals[part.own].any(axis=1)
    numbers = np.flatnonzero(marks).astype(np.int32)
    return Population(len(numbers), lambda chosen: _ranks(store, numbers[chosen]))


def sampled_parts_of(store: Store, around: Sequence[int] = (), *, threads: int = 1) -> SampledParts:
    """The same parts as `smoothing.mesh_parts` finds in memory; vertices are those of the source."""
    n = store.layout.vertex_count
    if n <= LARGEST_WHOLE:
        taken = core = np.arange(n, dtype=np.int32)
    else:
        orders = [_grown(store, seed) for seed in part_seeds(n)]
        core = np.unique(np.concatenate([core_of(order) for order in orders]))
        taken = np.unique(np.concatenate([*orders, *(_grown(store, seed) for seed in around)]))
    ids, mesh = in_source_order(store, part_around(store, np.sort(_ranks(store, taken)), 1))
    is_taken = np.isin(store.sources(ids), taken)
    number = np.cumsum(is_taken, dtype=np.int32) - np.int32(1)
    faces = number[mesh.faces[is_taken[mesh.faces].all(axis=1)]]
    part = TriangleMesh(mesh.vertices[is_taken], faces)
    adjacency, whole = vertex_adjacency(part, threads=threads), vertex_adjacency(mesh, threads=threads)
    cut = adjacency.faces.lengths != whole.faces.lengths[is_taken]
    return SampledParts(MeshPart(part, adjacency, taken, cut, n), np.isin(taken, core))


def _grown(store: Store, seed: int) -> IntArray:
    """Vertices of the source around one, nearest first, and then around the next one that is not among them."""
    n, found = store.layout.vertex_count, np.zeros(0, dtype=np.int32)
    seeds, rings = np.array([seed], dtype=np.int32), FIRST_RINGS
    while True:
        ids, mesh = in_source_order(store, part_around(store, np.sort(_ranks(store, seeds)), rings))
        numbers, rows = store.sources(ids), vertex_adjacency(mesh).vertices
        seen = np.isin(numbers, found)
        for seed, place in zip(seeds.tolist(), np.searchsorted(numbers, seeds).tolist(), strict=True):
            if seen[place]:
                continue
            growth = Growth.of(PART - len(found)).around(rows.indptr, rows.indices, place, seen)
            if growth.looked_at >= rings:  # it goes on further than was read
                seeds, rings = np.array([seed], dtype=np.int32), 2 * rings
                break
            found = np.concatenate([found, numbers[growth.order[: growth.count]]])
            if len(found) == PART:
                return found
        else:
            following = _next_unseen(found, seed, n)
            if following < 0:
                return found
            seeds, rings = np.arange(following, min(following + NEXT, n), dtype=np.int32), NEXT_RINGS


def _next_unseen(found: IntArray, after: int, n: int) -> int:
    """The next vertex, beginning anew after the last one; -1 if all were found."""
    met = set(found.tolist())
    return next((k for k in chain(range(after + 1, n), range(after)) if k not in met), -1)


def _ranks(store: Store, numbers: IntArray) -> IntArray:
    """Where some vertices of the source are in the store."""
    return np.array(store.rank.mapped()[numbers], dtype=np.int32)
