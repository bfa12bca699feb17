"""Takes noise off a mesh: as a smooth surface or as one with sharp edges, wherever it is which.

There are several estimates of the surface, from smooth to sharp (`candidates`). Stein's estimate of the
risk tells what is best around each vertex, and which of them are worth their while at all.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from bezier_filters.arrays import FloatArray, IntArray, SingleArray
from bezier_filters.meshes.adjacency import Adjacency
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.runtime.lean import lean_njit
from bezier_filters.runtime.parallel import Progress, RangeTask, report, run_in_chunks
from bezier_filters.smoothing.candidates import GENTLE, KINDS, Candidate, candidates
from bezier_filters.smoothing.clusters import Clusters, clusters_of
from bezier_filters.smoothing.laplacian import Borders
from bezier_filters.smoothing.low_pass import Choice, choose_low_pass, fit_low_pass
from bezier_filters.smoothing.noise import local_sigma
from bezier_filters.smoothing.risk import (
    WIDTH,
    Estimates,
    last_gain,
    local_risks,
    local_shares,
    mean_terms,
    noise_factor,
)
from bezier_filters.smoothing.sampled_parts import sampled_parts

DETAIL = 0.01
"""Times the mean edge: fine relief of clean scans, in which neighbours differ, too, and which is left alone."""
SMALLEST_NOISE = 1e-4
"""Times the mean edge: below that there is nothing to take off."""
GAIN = 1e-3
"""Times sigma^2: mean decrease of the risk around a vertex below which a further estimate is left out."""
SHARPNESS = np.array([0.0, 0.0, 0.33, 0.67, 1.0])
"""Of the kinds of estimates, as reported."""
STEPS = 6
"""Of the progress."""


@dataclass(frozen=True)
class MeshScale:
    """Where a mesh is, and how large its triangles are.

    Attributes
    ----------
    mean_edge : float
        Mean length of the edges; 0 if there are none.
    far_center : (3,) float64
        Mean of the vertices, if they are so far from the origin that digits would be lost; zeros if not.
    """

    mean_edge: float
    far_center: FloatArray


def mesh_scale(mesh: TriangleMesh, adjacency: Adjacency, *, threads: int = 1) -> MeshScale:
    """Measure a mesh.

    Examples
    --------
    >>> from bezier_filters.meshes.adjacency import vertex_adjacency
    >>> from bezier_filters.meshes.mesh import triangle_mesh
    >>> triangle = triangle_mesh([[0, 0, 0], [3, 0, 0], [0, 4, 0]], [[0, 1, 2]])
    >>> mesh_scale(triangle, vertex_adjacency(triangle)).mean_edge
    4.0
    """
    vertices, rows = mesh.vertices, adjacency.vertices
    if not len(rows.indices):
        return MeshScale(0.0, np.zeros(3))
    lengths = np.zeros(len(vertices))

    def make_task() -> RangeTask:
        return lambda start, stop: _sum_lengths(vertices, rows.indptr, rows.indices, start, stop, lengths)

    run_in_chunks(make_task, len(vertices), threads=threads)
    center = vertices.mean(axis=0)
    near = bool(np.abs(center).max() <= np.ptp(vertices, axis=0).max())
    return MeshScale(float(lengths.sum()) / len(rows.indices), np.zeros(3) if near else center)


@dataclass(frozen=True)
class Denoised:
    """A mesh without its noise.

    Attributes
    ----------
    points : (n, 3) float64
        Coordinates.
    sharpness : (n,) float64
        0 where the surface was taken for smooth, 1 where edges were kept as sharp as can be.
    """

    points: FloatArray
    sharpness: FloatArray


def denoise(
    mesh: TriangleMesh,
    adjacency: Adjacency,
    sigma: float,
    borders: Borders,
    *,
    threads: int = 1,
    progress: Progress | None = None,
) -> Denoised:
    """Take the noise off.

    Parameters
    ----------
    mesh : TriangleMesh
    adjacency : Adjacency
        Of the same mesh.
    sigma : float
        Standard deviation of the noise along the normal, a length.
    borders : {"curve", "fixed"}
        Whether border vertices are smoothed along the border, or stay.
    threads : int
        Number of threads.
    progress : callable, optional
        Called after each of a few steps.
    """
    extent = mesh_scale(mesh, adjacency, threads=threads)
    unit = extent.mean_edge
    least = (DETAIL + SMALLEST_NOISE) * unit
    if not (sigma > least and unit > 0.0):
        return Denoised(mesh.vertices.copy(), np.zeros(mesh.vertex_count))
    measured = mesh
    scale = float(2.0 ** -np.round(np.log2(unit)))  # single precision has few exponents
    sigma, unit, least = sigma * scale, unit * scale, least * scale
    mesh = TriangleMesh((mesh.vertices - extent.far_center) * scale, mesh.faces)
    clusters = clusters_of(mesh, adjacency)
    levels = local_sigma(mesh, adjacency, clusters, sigma, unit, least, DETAIL * unit, threads=threads)
    report(progress, 0, STEPS)
    parts = sampled_parts(mesh, adjacency, threads=threads)
    choice = choose_low_pass(parts, levels[parts.vertices], borders, unit, threads=threads)
    report(progress, 1, STEPS)
    fitted = fit_low_pass(mesh, adjacency, clusters, levels, choice, threads=threads)
    report(progress, 2, STEPS)
    kinds = frozenset(KINDS)
    if parts.mesh.vertex_count < mesh.vertex_count:
        # Which estimates are worthwhile is found out on parts, among them the roughest.
        terms = mean_terms(clusters, Estimates(fitted.residuals[:, np.newaxis], fitted.leverages[:, np.newaxis]))
        roughest = int(clusters.centers[clusters.diffuse(terms, WIDTH, threads=threads)[:, 0].argmax()])
        parts = sampled_parts(mesh, adjacency, (roughest,), threads=threads)
        kinds = _kinds_on_parts(parts.mesh, parts.adjacency, levels[parts.vertices], choice, threads)
    del parts  # for large meshes, memory counts
    estimates = candidates(mesh, adjacency, fitted, levels, kinds, threads=threads)
    del fitted
    found, shares = _worthwhile(clusters, estimates, progress, threads)
    points = measured.vertices.copy()
    length = np.float64(scale)  # which may be beyond the single precision of the moves
    for k, estimate in enumerate(found):
        points += shares[:, [k]] * (estimate.moves / length)
    report(progress, STEPS, STEPS)
    return Denoised(points, np.einsum("ns,s->n", shares, SHARPNESS[[estimate.kind for estimate in found]]))


def _kinds_on_parts(
    mesh: TriangleMesh, adjacency: Adjacency, sigma: FloatArray, choice: Choice, threads: int
) -> frozenset[int]:
    """Kinds of estimates that are worthwhile on parts of a mesh."""
    clusters = clusters_of(mesh, adjacency)
    fitted = fit_low_pass(mesh, adjacency, clusters, sigma, choice, threads=threads)
    estimates = candidates(mesh, adjacency, fitted, sigma, frozenset(KINDS), threads=threads)
    found, _ = _worthwhile(clusters, estimates, None, threads)
    return frozenset(estimate.kind for estimate in found)


def _worthwhile(
    clusters: Clusters, estimates: Iterator[Candidate], progress: Progress | None, threads: int
) -> tuple[list[Candidate], SingleArray]:
    """The first estimate and those that lower the risk somewhere, and their shares at every vertex."""
    n = len(clusters.of_vertex)
    found, chosen = [next(estimates)], None
    means = [_means(found[0])]
    for estimate in estimates:
        report(progress, min(2 + estimate.kind, STEPS - 1), STEPS)
        these, those = [*found, estimate], [*means, _means(estimate)]
        factor = noise_factor(*np.array(those).T)
        risks = local_risks(clusters, _side_by_side(these, factor), threads=threads)
        if last_gain(clusters, risks) > GAIN:
            found, means, chosen = these, those, risks
        elif estimate.kind > GENTLE:
            break
    if chosen is None:
        return found, np.ones((n, 1), np.float32)
    return found, local_shares(clusters, chosen, n, threads=threads)


def _side_by_side(estimates: list[Candidate], factor: float) -> Estimates:
    """Residuals and leverages of all estimates, with less noise by a factor."""
    residuals = np.column_stack([estimate.residuals for estimate in estimates])
    leverages = np.column_stack([estimate.leverages for estimate in estimates])
    return Estimates(residuals if factor == 1.0 else residuals / np.float32(factor), leverages)


def _means(estimate: Candidate) -> FloatArray:
    """Mean squared residual and mean leverage."""
    squares = np.square(estimate.residuals, dtype=np.float64).mean()
    return np.array([squares, estimate.leverages.mean(dtype=np.float64)])


@lean_njit()
def _sum_lengths(
    vertices: FloatArray, ptr: IntArray, indices: IntArray, start: int, stop: int, lengths: FloatArray
) -> None:
    """Write the sum of the lengths of the edges at vertices start .. stop-1."""
    for i in range(start, stop):
        for q in range(ptr[i], ptr[i + 1]):
            j = indices[q]
            x, y, z = vertices[j, 0] - vertices[i, 0], vertices[j, 1] - vertices[i, 1], vertices[j, 2] - vertices[i, 2]
            lengths[i] += np.sqrt(x * x + y * y + z * z)
