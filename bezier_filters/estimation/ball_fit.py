"""Fits every vertex over the ball of one radius: a scale that does not depend on the sampling."""

import numpy as np

from bezier_filters.arrays import IntArray
from bezier_filters.estimation.fallbacks import fallback_chain, fit_with_fallbacks, planned_chain
from bezier_filters.estimation.vertex_geometry import FitChoice, VertexGeometry
from bezier_filters.kernels.kernel_input import KernelMesh
from bezier_filters.learning.learn import CANDIDATE_RINGS, MOST_TURNED, learn_surface
from bezier_filters.learning.model_tree import Leaf, leaf_of
from bezier_filters.learning.neighbourhood_samples import draw_from_mesh, sample_neighbourhoods
from bezier_filters.learning.plans import Choices
from bezier_filters.learning.ring_analysis import FEWEST_SAMPLES
from bezier_filters.meshes.adjacency import Adjacency
from bezier_filters.patches.fitting import PatchFit
from bezier_filters.runtime.parallel import Progress

SAMPLES = 150
"""Neighbourhoods whose radius is measured."""


def fit_in_balls(
    mesh: KernelMesh,
    adjacency: Adjacency,
    ids: IntArray,
    radius: float,
    fit: PatchFit | None,
    degrees: tuple[int, ...],
    geometry: VertexGeometry,
    *,
    robust: bool = False,
    threads: int = 1,
    progress: Progress | None = None,
) -> FitChoice:
    """Fit the vertices `ids` to what lies within a distance of each.

    Parameters
    ----------
    mesh : KernelMesh
    adjacency : Adjacency
        Of the same mesh.
    ids : (k,) int32
        Vertices to fit.
    radius : float
        The distance, a length.
    fit : PatchFit or None
        The patch; None for what suits the rings of about this radius, the same everywhere.
    degrees : tuple of int
        Degrees that may be chosen.
    geometry : VertexGeometry
        Receives the results.
    robust : bool
        Whether points far off a fit lose their weight.
    threads : int
        Number of threads.
    progress : callable, optional
        Called with the number of vertices done.
    """
    leaf = None if fit else _learn(mesh, adjacency, radius, degrees, threads)
    if leaf is None:
        fit = fit or PatchFit()
        attempts = fallback_chain(1, fit, radius)
        choice = FitChoice(0, fit.degree, fit.alpha, None, radius=radius)
    else:
        attempts = planned_chain(leaf.plans, leaf.chosen, radius)
        choice = FitChoice(0, leaf.chosen.degree, None, leaf.surface.sigma, radius=radius)
    fit_with_fallbacks(mesh, ids, list(attempts), geometry, robust=robust, threads=threads, progress=progress)
    return choice


def _learn(
    mesh: KernelMesh, adjacency: Adjacency, radius: float, degrees: tuple[int, ...], threads: int
) -> Leaf | None:
    """Learn the surface; the chosen plan is that of the rings whose radius is nearest to the one given."""
    wanted = nearest_rings(mesh, adjacency, radius, threads=threads)
    analyses, _ = learn_surface(mesh, adjacency, Choices(wanted, degrees), threads=threads)
    if not analyses:
        return None
    nearest = min(analyses, key=lambda analysis: abs(analysis.radius - radius))
    return leaf_of(analyses, Choices(nearest.rings, degrees))


def nearest_rings(mesh: KernelMesh, adjacency: Adjacency, radius: float, *, seed: int = 0, threads: int = 1) -> int:
    """Number of rings, as many as can be analysed at most, whose median radius is nearest to a length."""
    ids = draw_from_mesh(mesh, SAMPLES, seed)
    sample = sample_neighbourhoods(
        mesh, adjacency, ids, rings=max(CANDIDATE_RINGS), most_turned=MOST_TURNED, threads=threads
    )
    distances = np.sqrt(np.square(sample.points[..., :2]).sum(axis=2))
    best, smallest = 1, np.inf
    for rings in range(1, sample.sizes.shape[1]):
        usable = sample.usable[:, rings]
        if usable.sum() < FEWEST_SAMPLES:
            break
        within = np.arange(distances.shape[1]) < sample.sizes[usable, rings, np.newaxis]
        difference = abs(float(np.median((distances[usable] * within).max(axis=1))) - radius)
        if difference < smallest:
            best, smallest = rings, difference
    return best
