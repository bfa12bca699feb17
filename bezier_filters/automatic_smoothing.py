"""Takes noise off a mesh: as a smooth surface or as one with sharp edges, wherever it is which.

There are several estimates of the surface, from smooth to sharp (`surface_estimates`). Stein's estimate of the
risk tells what is best around each vertex, and which of them are worth their while at all.
"""

from dataclasses import dataclass

import numpy as np

from bezier_filters.adjacency import Adjacency
from bezier_filters.arrays import FloatArray, SingleArray
from bezier_filters.clusters import Clusters, clusters_of
from bezier_filters.laplacian import Borders
from bezier_filters.low_pass import LowPass, choose_low_pass, fit_low_pass
from bezier_filters.mesh import TriangleMesh
from bezier_filters.mesh_parts import sampled_parts
from bezier_filters.noise_levels import noise_levels
from bezier_filters.parallel import Progress, report
from bezier_filters.stein import WIDTH, Estimates, local_risks, local_shares
from bezier_filters.surface_estimates import GENTLE, KINDS, Estimate, sharper_estimates, smooth_estimate

DETAIL = 0.01
"""Times the mean edge: fine relief of clean scans, in which neighbours differ, too, and which is left alone."""
SMALLEST_NOISE = 1e-4
"""Times the mean edge: below that there is nothing to take off."""
GAIN = 3e-4
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
    if not sigma > least:
        return Denoised(mesh.vertices.copy(), np.zeros(mesh.vertex_count))
    center = mesh.vertices.mean(axis=0)  # far from the origin, digits would be lost
    mesh = TriangleMesh(mesh.vertices - center, mesh.faces)
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
        parts = sampled_parts(mesh, adjacency, (_roughest(low_pass, clusters, threads),), threads=threads)
        around = clusters_of(parts.mesh, parts.adjacency)
        of_parts = levels[parts.vertices]
        low = fit_low_pass(parts.mesh, parts.adjacency, around, of_parts, choice, threads=threads)
        found, _ = _worthwhile(parts.mesh, parts.adjacency, around, low, of_parts, kinds, threads, None)
        kinds = frozenset(estimate.kind for estimate in found)
    found, shares = _worthwhile(mesh, adjacency, clusters, low_pass, levels, kinds, threads, progress)
    result = mesh.vertices + center
    for k, estimate in enumerate(found):
        result += shares[:, [k]] * estimate.moves
    report(progress, STEPS, STEPS)
    return Denoised(result, shares @ SHARPNESS[[estimate.kind for estimate in found]])


def _roughest(low_pass: LowPass, clusters: Clusters, threads: int) -> int:
    """The vertex around which the low-pass filter does worst, as at edges."""
    terms = np.square(low_pass.residuals) + 2.0 * low_pass.leverages
    risks = clusters.diffused(clusters.means(terms[:, np.newaxis]), WIDTH, threads=threads)
    return int(np.flatnonzero(clusters.of_vertex == risks.argmax())[0])


def _worthwhile(
    mesh: TriangleMesh,
    adjacency: Adjacency,
    clusters: Clusters,
    low_pass: LowPass,
    levels: FloatArray,
    kinds: frozenset[int],
    threads: int,
    progress: Progress | None,
) -> tuple[list[Estimate], SingleArray]:
    """Estimates that lower the risk somewhere, out of some kinds, and their shares at every vertex."""
    found = [smooth_estimate(mesh, low_pass, threads=threads)]
    shares = np.ones((mesh.vertex_count, 1), dtype=np.float32)
    for estimate in sharper_estimates(mesh, adjacency, low_pass, levels, kinds, threads=threads):
        report(progress, min(2 + estimate.kind, STEPS - 1), STEPS)
        residuals = np.column_stack([e.residuals for e in [*found, estimate]])
        leverages = np.column_stack([e.leverages for e in [*found, estimate]])
        risks = local_risks(Estimates(residuals, leverages).rescaled(), clusters, threads=threads)
        gains = np.maximum(risks[:, :-1].min(axis=1) - risks[:, -1], 0.0)
        if float(clusters.mean_over_all(gains[:, np.newaxis])[0]) > GAIN:
            found.append(estimate)
            shares = local_shares(risks, clusters, threads=threads)
        elif estimate.kind > GENTLE:
            break
    return found, shares
