"""Takes noise off a mesh: as a smooth surface or as one with sharp edges, wherever it is which.

There are several estimates of the surface, from smooth to sharp (`surface_estimates`). Stein's estimate of the
risk tells what is best around each vertex, and which of them are worth their while at all.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from bezier_filters.arrays import FloatArray, SingleArray
from bezier_filters.meshes.adjacency import Adjacency
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.runtime.parallel import Progress, report
from bezier_filters.smoothing.clusters import Clusters, clusters_of
from bezier_filters.smoothing.laplacian import Borders
from bezier_filters.smoothing.low_pass import Choice, LowPass, choose_low_pass, fit_low_pass
from bezier_filters.smoothing.mesh_parts import sampled_parts
from bezier_filters.smoothing.noise_levels import noise_levels
from bezier_filters.smoothing.stein import WIDTH, Estimates, local_risks, local_shares
from bezier_filters.smoothing.surface_estimates import GENTLE, KINDS, Estimate, surface_estimates

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
class Denoised:
    """The result.

    Attributes
    ----------
    vertices : (n, 3) float64
        Coordinates.
    sharpness : (n,) float64
        0 where the surface was taken for smooth, 1 where edges were kept as sharp as can be.
    """

    vertices: FloatArray
    sharpness: FloatArray


def denoise(
    mesh: TriangleMesh,
    adjacency: Adjacency,
    sigma: float,
    unit: float,
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
    unit : float
        The mean edge, a length.
    borders : {"curve", "fixed"}
        Whether border vertices are smoothed along the border, or stay.
    threads : int
        Number of threads.
    progress : callable, optional
        Called after each of a few steps.
    """
    least = (DETAIL + SMALLEST_NOISE) * unit
    if not (sigma > least and unit > 0.0):
        return Denoised(mesh.vertices.copy(), np.zeros(mesh.vertex_count))
    measured, center = mesh.vertices, mesh.vertices.mean(axis=0)
    if np.abs(center).max() <= np.ptp(measured, axis=0).max():  # not so far from the origin that digits would be lost
        center = np.zeros(3)
    scale = float(2.0 ** -np.round(np.log2(unit)))  # single precision has few exponents
    mesh, sigma, unit = TriangleMesh((measured - center) * scale, mesh.faces), sigma * scale, unit * scale
    least *= scale
    clusters = clusters_of(mesh, adjacency)
    levels = np.maximum(noise_levels(mesh, adjacency, clusters, sigma, unit, threads=threads), least)
    levels = np.sqrt(levels**2 - (DETAIL * unit) ** 2)
    report(progress, 0, STEPS)
    parts = sampled_parts(mesh, adjacency, threads=threads)
    choice = choose_low_pass(parts, levels, borders, unit, threads=threads)
    report(progress, 1, STEPS)
    low_pass = fit_low_pass(mesh, adjacency, clusters, levels, choice, threads=threads)
    report(progress, 2, STEPS)
    kinds = frozenset(KINDS)
    if parts.mesh is not mesh:  # which estimates are worthwhile is found out on parts, among them the roughest
        roughest = _roughest(low_pass, clusters, threads)
        kinds = _kinds_on_parts(mesh, adjacency, levels, choice, roughest, threads)
    estimates = surface_estimates(mesh, adjacency, low_pass, levels, kinds, threads=threads)
    del low_pass, parts  # for large meshes, memory counts
    found, shares = _worthwhile(estimates, clusters, threads, progress)
    result = measured.copy()
    for k, estimate in enumerate(found):
        result += shares[:, [k]] * (estimate.moves / scale)
    report(progress, STEPS, STEPS)
    return Denoised(result, shares @ SHARPNESS[[estimate.kind for estimate in found]])


def _roughest(low_pass: LowPass, clusters: Clusters, threads: int) -> int:
    """The vertex around which the low-pass filter does worst, as at edges."""
    terms = np.square(low_pass.residuals) + 2.0 * low_pass.leverages
    risks = clusters.diffused(clusters.means(terms[:, np.newaxis]), WIDTH, threads=threads)
    return int(np.flatnonzero(clusters.of_vertex == risks.argmax())[0])


def _kinds_on_parts(
    mesh: TriangleMesh, adjacency: Adjacency, levels: FloatArray, choice: Choice, roughest: int, threads: int
) -> frozenset[int]:
    """Kinds of estimates that are worthwhile on parts of a mesh, one of them around a given vertex."""
    parts = sampled_parts(mesh, adjacency, (roughest,), threads=threads)
    clusters, of_parts = clusters_of(parts.mesh, parts.adjacency), levels[parts.vertices]
    low_pass = fit_low_pass(parts.mesh, parts.adjacency, clusters, of_parts, choice, threads=threads)
    estimates = surface_estimates(parts.mesh, parts.adjacency, low_pass, of_parts, frozenset(KINDS), threads=threads)
    found, _ = _worthwhile(estimates, clusters, threads, None)
    return frozenset(estimate.kind for estimate in found)


def _worthwhile(
    estimates: Iterator[Estimate], clusters: Clusters, threads: int, progress: Progress | None
) -> tuple[list[Estimate], SingleArray]:
    """The first estimate and those that lower the risk somewhere, and their shares at every vertex."""
    found = [next(estimates)]
    chosen = np.zeros((len(clusters.sizes), 1))
    for estimate in estimates:
        report(progress, min(2 + estimate.kind, STEPS - 1), STEPS)
        risks = local_risks(_together([*found, estimate]).rescaled(), clusters, threads=threads)
        gains = np.maximum(risks[:, :-1].min(axis=1) - risks[:, -1], 0.0)
        if float(clusters.mean_over_all(gains[:, np.newaxis])[0]) > GAIN:
            found.append(estimate)
            chosen = risks
        elif estimate.kind > GENTLE:
            break
    return found, local_shares(chosen, clusters, threads=threads)


def _together(estimates: list[Estimate]) -> Estimates:
    """Residuals and leverages of some estimates, side by side."""
    return Estimates(
        np.column_stack([estimate.residuals for estimate in estimates]),
        np.column_stack([estimate.leverages for estimate in estimates]),
    )
