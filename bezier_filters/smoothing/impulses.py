"""Impulse noise: a mixture model of the residuals of a smoothed surface, and the removal of its impulses.

If some vertices have impulses, the heights of the vertices over the smoothed surface follow a mixture of two normal
distributions, one of the impulses and one of the inliers. The mixture is fitted by expectation maximisation (EM;
Dempster, Laird and Rubin, 1977). Vertices move towards the smoothed surface with their posterior probability of being
an impulse, and the surface is estimated again.

Noise of different strengths, and edges that were smoothed, also give two distributions. But their large residuals are
clustered, while impulses are scattered: so the probabilities of neighbours must be nearly uncorrelated.
"""

from dataclasses import dataclass

import numpy as np

from bezier_filters.arrays import FloatArray
from bezier_filters.meshes.adjacency import umbrella_vectors
from bezier_filters.meshes.prepared_mesh import PreparedMesh
from bezier_filters.sampling.mesh_parts import MeshPart
from bezier_filters.smoothing.noise import RELIEF_PER_EDGE
from bezier_filters.smoothing.sliding import TangentialMotion, restrict_to_normals

MIN_KURTOSIS = 3.5  # fourth moment over the squared second one of a mixture; a normal distribution has 3
EM_STEPS = 60  # iterations of expectation maximisation
MIN_LIKELIHOOD_GAIN = 0.05  # mean gain of the log likelihood by a mixture over one distribution
MAX_NEIGHBOUR_CORRELATION = 0.18  # correlation of the probabilities of neighbours up to which impulses are scattered
# Ratio of tangential to normal standard deviation up to which impulses count as normal to the surface: such impulses
# measure .00 to .14, other ones .49 and more.
MAX_TANGENTIAL_RATIO = 0.3
MAX_IMPULSE_ROUNDS = 4  # rounds of finding impulses and surface
CONVERGENCE_SIGMAS = 0.1  # rms move of the surface in a round, over the standard deviation of the inliers, to stop


@dataclass(frozen=True)
class Impulses:
    """Heights over a smoothed surface as a mixture of two normal distributions of mean 0."""

    share: float  # share of the vertices with an impulse
    impulse_sigma: float  # standard deviation of their heights, a length
    inlier_sigma: float  # standard deviation of the heights of the other vertices, a length
    # standard deviation of the impulses per tangential direction, a length
    tangential_sigma: float = 0.0

    def inlier_probability(self, heights: FloatArray) -> FloatArray:
        """Posterior probability of being an inlier, by the heights of the vertices, (n,)."""
        ratio = self.inlier_sigma / self.impulse_sigma
        exponents = 0.5 * (1.0 - ratio**2) * np.square(heights / self.inlier_sigma)
        result: FloatArray = 1.0 / (
            1.0 + self.share / (1.0 - self.share) * ratio * np.exp(np.minimum(exponents, 700.0))
        )
        return result


def learn_impulses(measured: FloatArray, smoothed: MeshPart) -> Impulses | None:
    """Fit the mixture to measured vertices (k, 3) over smoothed parts of a mesh, or all of it.

    None if there are no impulses.
    """
    mesh, rows = smoothed.mesh, smoothed.mesh.adjacency.vertices
    unit = mesh.mean_edge
    smallest = np.finfo(np.float64).tiny
    every, normals = _heights(measured, mesh)
    every /= max(unit, smallest)
    heights = every[smoothed.core & (rows.lengths > 0)]
    square = float(np.square(heights).mean()) if len(heights) else 0.0
    if not square > RELIEF_PER_EDGE**2 or not np.mean(heights**4) > MIN_KURTOSIS * square**2:
        return None
    found = Impulses(0.5, 1.3 * square**0.5, max(float(np.median(np.abs(heights))), RELIEF_PER_EDGE))
    for _ in range(EM_STEPS):
        inliers = found.inlier_probability(heights)
        share = float(1.0 - inliers.mean())
        if not 0.0 < share < 1.0:
            return None
        inlier_sigma, impulse_sigma = (
            np.sqrt(np.average(heights**2, weights=weights)) for weights in (inliers, 1.0 - inliers)
        )
        found = Impulses(share, float(impulse_sigma), max(float(inlier_sigma), RELIEF_PER_EDGE))
    densities = sum(
        weight / deviation * np.exp(-0.5 * np.square(heights / deviation))
        for weight, deviation in ((found.share, found.impulse_sigma), (1.0 - found.share, found.inlier_sigma))
    )
    gain = float(np.log(np.maximum(densities, smallest)).mean()) + 0.5 + 0.5 * np.log(square)
    inliers = found.inlier_probability(every)
    neighbours = inliers[rows.indices]
    if not (len(neighbours) and np.var(neighbours) > 0.0):  # no vertex stands out among its neighbours
        return None
    correlation = np.corrcoef(np.repeat(inliers, rows.lengths), neighbours)[0, 1]
    if not (
        found.impulse_sigma > found.inlier_sigma
        and gain > MIN_LIKELIHOOD_GAIN
        and correlation < MAX_NEIGHBOUR_CORRELATION
    ):
        return None
    # Tangential residuals refer to the mean of the neighbours; uneven triangles of inliers are offset from it, too.
    away = (measured - mesh.vertices + umbrella_vectors(rows, mesh.vertices)) / unit
    away -= np.einsum("ij,ij->i", away, normals)[:, np.newaxis] * normals
    inside = smoothed.core & ~mesh.adjacency.on_boundary & (rows.lengths > 0)
    squares, inliers = 0.5 * np.square(away[inside]).sum(axis=1), inliers[inside]
    of_hit, of_others = (
        squares @ weights / max(float(weights.sum()), smallest) for weights in (1.0 - inliers, inliers)
    )
    tangential_sigma = float(max(of_hit - of_others, 0.0)) ** 0.5
    return Impulses(found.share, found.impulse_sigma * unit, found.inlier_sigma * unit, tangential_sigma * unit)


def remove_impulses(measured: FloatArray, smooth: PreparedMesh, impulses: Impulses) -> FloatArray:
    """Move the measured vertices to the smoothed surface by their probability of being an impulse, (n, 3).

    If the impulses are normal to the surface, vertices move along the normals, which improve with the surface.
    Otherwise impulses have tangential components, too, and the vertices go to their smoothed positions.
    """
    heights, normals = _heights(measured, smooth)
    inliers, surface = impulses.inlier_probability(heights)[:, np.newaxis], smooth.vertices
    if impulses.tangential_sigma < MAX_TANGENTIAL_RATIO * impulses.impulse_sigma:
        surface = restrict_to_normals(smooth.move(measured), surface, TangentialMotion.NARROW)
        return np.asarray(surface + inliers * (measured - surface))
    return np.asarray(surface + inliers * heights[:, np.newaxis] * normals)


def _heights(measured: FloatArray, smooth: PreparedMesh) -> tuple[FloatArray, FloatArray]:
    """Heights of the measured vertices over a smoothed mesh along its normals, (n,), and the normals, (n, 3)."""
    normals = smooth.planes.normals
    return np.einsum("ij,ij->i", measured - smooth.vertices, normals), normals


def has_settled(before: FloatArray, after: FloatArray, impulses: Impulses) -> bool:
    """Whether another round moved the vertices (n, 3) so little that it was the last."""
    return bool(np.square(after - before).sum(axis=1).mean() <= (CONVERGENCE_SIGMAS * impulses.inlier_sigma) ** 2)
