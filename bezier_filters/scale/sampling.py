"""Learns how to fit a mesh on disk from the same samples as in memory."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.errors import InvalidParameterError
from bezier_filters.estimation.adaptive_fit import OUTLIER_REACH as OUTLIER_RINGS
from bezier_filters.estimation.adaptive_fit import SurfaceFit, choose_fit, first_features, with_parts, without_outliers
from bezier_filters.estimation.fallbacks import Attempt, fit_with_fallbacks
from bezier_filters.estimation.fit_options import fit_options
from bezier_filters.estimation.vertex_geometry import empty_geometry
from bezier_filters.kernels.kernel_input import fitted_mesh
from bezier_filters.learning.learn import MOST_TURNED, learn_from_samples
from bezier_filters.learning.model_tree import Leaf, leaves
from bezier_filters.learning.neighbourhood_samples import (
    NeighbourhoodSample,
    Population,
    draw_vertices,
    sample_neighbourhoods,
)
from bezier_filters.learning.plans import Choices
from bezier_filters.learning.ring_analysis import RingAnalysis
from bezier_filters.meshes.adjacency import vertex_adjacency
from bezier_filters.meshes.frames import tangent_planes
from bezier_filters.patches.fitting import PatchFit
from bezier_filters.patches.smoothness import Smoothness
from bezier_filters.scale.array_file import new_array_file
from bezier_filters.scale.halo import part_around, part_around_samples
from bezier_filters.scale.store import Store
from bezier_filters.scale.tile_pieces import in_source_order

CREASE_RINGS = 2
"""Around a vertex, within which faces decide about its plane and its creases."""

MOST_RINGS = 100
"""That tiles may be asked to have around them."""


@dataclass(frozen=True)
class FitOptions:
    """Options of `estimate_vertex_geometry` that hold for meshes on disk, too."""

    rings: int | Literal["auto"] = "auto"
    alpha: float | Literal["auto"] = "auto"
    degree: int | Literal["auto"] = "auto"
    smoothness: Smoothness = "third_order"
    robust: bool = False

    def checked(self) -> tuple[int | Literal["auto"], PatchFit | None, tuple[int, ...]]:
        """What they leave open, see `fit_options`.

        Raises
        ------
        InvalidParameterError
            If one is out of range.
        """
        rings, fixed, degrees = fit_options(self.rings, self.alpha, self.degree, self.smoothness)
        if rings != "auto" and rings > MOST_RINGS:
            raise InvalidParameterError(f"rings: got {rings}, expected {MOST_RINGS} at most for a mesh in tiles")
        return rings, fixed, degrees

    @property
    def creases(self) -> bool:
        """Whether neighbourhoods end at creases."""
        return self.checked()[1] is None


def learn_fit(store: Store, options: FitOptions, *, threads: int = 1) -> SurfaceFit:
    """Choose how to fit a mesh: what `estimate_vertex_geometry` chooses for it in memory.

    Raises
    ------
    InvalidParameterError
        If an option is out of range.
    """
    rings, fixed, degrees = options.checked()

    def learn(choices: Choices) -> tuple[list[RingAnalysis], Leaf | None]:
        def sample(rings: int, count: int) -> NeighbourhoodSample:
            return _sample(store, rings, count, options, threads)

        return learn_from_samples(sample, store.layout.vertex_count, choices, threads=threads)

    fit, learned = choose_fit(learn, rings, fixed, degrees)
    if learned is None:
        return fit
    features = _first_features(store, learned.centers, fit, options, threads)
    return with_parts(fit, learned, lambda centers: features[np.searchsorted(learned.centers, centers)])


def learn_noise(store: Store, *, threads: int = 1) -> float | None:
    """Standard deviation of the noise of a mesh along the normal, a length: what `smooth` learns in memory."""

    def sample(rings: int, count: int) -> NeighbourhoodSample:
        centers = _draw(store, count)
        part = part_around_samples(store, centers, rings + CREASE_RINGS, threads=threads)
        ids, mesh = in_source_order(store, part)
        arrays, adjacency = fitted_mesh(mesh, creases=True, threads=threads)
        order = np.argsort(ids)
        local = order[np.searchsorted(ids[order], centers)].astype(np.int32)
        return sample_neighbourhoods(arrays, adjacency, local, rings=rings, most_turned=MOST_TURNED, threads=threads)

    _, leaf = learn_from_samples(sample, store.layout.vertex_count, Choices(), threads=threads)
    return None if leaf is None else leaf.surface.sigma


def rings_needed(fit: SurfaceFit) -> int:
    """How many rings around a vertex its values depend on."""
    chains = [fit.attempts] + ([] if fit.parts is None else [part.attempts for part in leaves(fit.parts)])
    return _widest([attempt for chain in chains for attempt in chain]) + CREASE_RINGS


def _widest(attempts: list[Attempt]) -> int:
    return max(attempt.rings for attempt in attempts)


def _sample(store: Store, rings: int, count: int, options: FitOptions, threads: int) -> NeighbourhoodSample:
    """The neighbourhoods that would be sampled in memory."""
    centers = _draw(store, count)
    reach = rings + CREASE_RINGS + (OUTLIER_RINGS if options.robust else 0)
    part = part_around_samples(store, centers, reach, threads=threads)
    arrays, adjacency = fitted_mesh(part.mesh, creases=options.creases, threads=threads)
    if options.robust:
        arrays = without_outliers(arrays, threads=threads)
    local = part.local(centers)
    sample = sample_neighbourhoods(arrays, adjacency, local, rings=rings, most_turned=MOST_TURNED, threads=threads)
    return sample._replace(centers=centers)


def _first_features(store: Store, centers: IntArray, fit: SurfaceFit, options: FitOptions, threads: int) -> FloatArray:
    """What the first fit shows at some vertices, (k, 2)."""
    part = part_around_samples(store, centers, _widest(list(fit.attempts)) + CREASE_RINGS, threads=threads)
    arrays, _ = fitted_mesh(part.mesh, creases=options.creases, threads=threads)
    geometry, local = empty_geometry(part.mesh.vertex_count), part.local(centers)
    fit_with_fallbacks(arrays, local, fit.attempts, geometry, robust=options.robust, threads=threads)
    return first_features(geometry, local)


def _draw(store: Store, count: int) -> IntArray:
    """The vertices that would be drawn in memory."""

    def members(numbers: IntArray) -> IntArray:
        result: IntArray = np.array(store.rank.mapped()[numbers])
        return result

    every = Population(store.layout.vertex_count, members)
    return draw_vertices(every, lambda ids: _have_normals(store, ids), lambda: _with_normals(store), count)


def _have_normals(store: Store, ids: IntArray) -> BoolArray:
    """Whether vertices have a normal."""
    part = part_around_samples(store, np.unique(ids), 1)
    normals = tangent_planes(part.mesh, vertex_adjacency(part.mesh)).normals
    result: BoolArray = np.asarray(normals[part.local(ids)].any(axis=1))
    return result


def _with_normals(store: Store) -> Population:
    """All vertices that have a normal, in the order of the source: found out tile by tile, and kept in a file."""
    layout = store.layout
    marks = new_array_file(store.folder / "normals.tmp", np.bool_, 1, layout.vertex_count)
    for tile in range(layout.tile_count):
        start, stop = layout.tile(tile)
        part = part_around(store, np.arange(start, stop, dtype=np.int32), 1)
        normals = tangent_planes(part.mesh, vertex_adjacency(part.mesh)).normals
        first = int(np.searchsorted(part.ids, start))
        marks.mapped("r+")[start:stop] = normals[first : first + stop - start].any(axis=1)
    chunk = layout.tile_vertices
    starts = range(0, layout.vertex_count, chunk)

    def marked(start: int) -> IntArray:
        """Those of a stretch of the source."""
        ranks = store.rank.read(start, min(start + chunk, layout.vertex_count))
        result: IntArray = ranks[marks.mapped()[ranks]]
        return result

    ends = np.cumsum([len(marked(start)) for start in starts])

    def members(numbers: IntArray) -> IntArray:
        result = np.empty(len(numbers), dtype=np.int32)
        stretches = np.searchsorted(ends, numbers, side="right")
        for k in np.unique(stretches):
            before = int(ends[k - 1]) if k else 0
            result[stretches == k] = marked(starts[k])[numbers[stretches == k] - before]
        return result

    return Population(int(ends[-1]), members)
