"""Which neighbourhood, degree and weight to fit with: predicted errors of all the choices."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bezier_filters.adjacency import Adjacency
from bezier_filters.arrays import FloatArray
from bezier_filters.fit_kernel import KernelMesh
from bezier_filters.neighbourhood_samples import sample_neighbourhoods
from bezier_filters.polynomials import PolynomialSpace, total_degree_space
from bezier_filters.surface_model import (
    FREE_DEGREE,
    RingAnalysis,
    RingModel,
    SurfaceModel,
    analyse_ring,
    harmonic_basis,
    learn_noise,
)

CANDIDATE_RINGS = (2, 3, 4, 5, 6, 8, 10)
CANDIDATE_DEGREES = (2, 3, 4, 5, 6)
PRIOR_STRENGTHS = (1.0, 0.03, 0.001)
"""The prior takes what a degree leaves out for noise; on regular meshes it cancels out, and less is better."""
STRONGEST_PRIOR = 1e5
"""Times what the points say of a term: leaves nothing of it, and the normal equations well conditioned."""
NEAR_RINGS = 5
"""Most meshes need no wider rings than these, of which many neighbourhoods can be afforded."""
SAMPLES = {2: 300, 3: 300, 4: 200, 5: 150, 6: 120, 8: 80, 10: 60}
"""Neighbourhoods analysed per ring: the wider, the more points each has."""
MOST_TURNED = 0.02
"""Share of the vertices of a neighbourhood whose normals noise may turn away from its plane."""
USABLE_SHARE = 0.8
"""A ring that folds at more than the rest of the sampled vertices is too wide."""
GOOD_ENOUGH = 1.05
"""Of the choices whose predicted error is within this factor of the smallest, the fastest is taken."""
HOPELESS = 4.0
"""Wider rings are not tried once the predicted error has grown by this factor."""


@dataclass(frozen=True)
class FitPlan:
    """A polynomial fit of given degree with a prior for its higher terms.

    Attributes
    ----------
    rings : int
        Size of the neighbourhood.
    degree : int
        Total degree of the polynomial.
    prior : (m, m) float64
        sigma^2 times the inverse covariance of the monomials' coefficients, for coordinates in
        units of length; it couples only monomials of the same degree.
    noise : float
        Standard deviation of the heights over the fit: noise and what the degree leaves out, a length.
    normal_error : float
        Predicted standard error of the normal, radians.
    curvature_error : float
        Predicted standard error of the second derivatives, 1/length.
    """

    rings: int
    degree: int
    prior: FloatArray
    noise: float
    normal_error: float
    curvature_error: float

    @property
    def space(self) -> PolynomialSpace:
        """The polynomials."""
        return total_degree_space(self.degree)

    @property
    def error(self) -> float:
        """What is minimised: the geometric mean of both errors, as each has a unit of its own."""
        return float(np.sqrt(self.normal_error * self.curvature_error))

    @property
    def cost(self) -> float:
        """Operations per vertex, up to a factor: points times moments."""
        return self.rings**2 * (self.degree + 1.0) * (2.0 * self.degree + 1.0)


def learn_surface(
    mesh: KernelMesh, adjacency: Adjacency, *, rings: Sequence[int] = CANDIDATE_RINGS, seed: int = 0
) -> SurfaceModel | None:
    """Learn noise and smoothness from rings of ascending width, as long as they promise something.

    Returns None for meshes with too few usable neighbourhoods.
    """
    analyses: list[RingAnalysis] = []
    best = np.inf
    sample = sample_neighbourhoods(
        mesh, adjacency, rings=min(NEAR_RINGS, max(rings)), count=SAMPLES[2], most_turned=MOST_TURNED, seed=seed
    )
    for k in rings:
        if k >= sample.sizes.shape[1]:
            sample = sample_neighbourhoods(
                mesh, adjacency, rings=max(rings), count=SAMPLES[6], most_turned=MOST_TURNED, seed=seed
            )
        if analyses and sample.usable[:, k].sum() < USABLE_SHARE * sample.clear[:, k].sum():
            break
        analysis = analyse_ring(sample, k, SAMPLES.get(k, SAMPLES[10]))
        if analysis is None:
            continue
        analyses.append(analysis)
        surface = learn_noise(analyses)
        error = min(plan.error for plan in ring_plans(surface, surface.by_rings[-1]))
        if k > NEAR_RINGS and error > HOPELESS * best:
            break
        best = min(best, error)
    return learn_noise(analyses) if analyses else None


def ring_plans(surface: SurfaceModel, ring: RingModel, degrees: Sequence[int] = CANDIDATE_DEGREES) -> list[FitPlan]:
    """Plans for one ring, one per degree that it determines."""
    return [
        _plan(surface, ring, degree, strength)
        for degree in degrees
        if degree <= ring.analysis.degree
        for strength in PRIOR_STRENGTHS
    ]


def best_plan(plans: Sequence[FitPlan]) -> FitPlan:
    """The fastest of the plans whose predicted error is practically the smallest."""
    smallest = min(plan.error for plan in plans)
    return min((plan for plan in plans if plan.error <= GOOD_ENOUGH * smallest), key=lambda plan: plan.cost)


def _plan(surface: SurfaceModel, ring: RingModel, degree: int, strength: float) -> FitPlan:
    """Optimal prior of one degree over one ring, and the errors that it predicts.

    The estimate is linear in the heights, so its mean squared error is the noise that passes
    through plus, for each random term, what is lost of it or mistaken for slope and curvature.
    """
    analysis, basis = ring.analysis, harmonic_basis()
    m = int((basis.degrees <= degree).sum())
    # What the degree leaves out acts on the fit much like noise.
    noise = strength * analysis.mean_squares[degree]
    strongest = STRONGEST_PRIOR * analysis.energies[:m]
    prior = np.where(basis.degrees[:m] <= FREE_DEGREE, 0.0, noise / np.maximum(ring.variances[:m], noise / strongest))
    triangles = analysis.factors[:, :m, :m]
    normal_matrices = triangles.transpose(0, 2, 1) @ triangles
    normal_matrices[:, np.arange(m), np.arange(m)] += prior
    wanted = np.arange(1, 6)  # two slopes, x^2 - y^2, 2 x y and x^2 + y^2
    solver = np.linalg.solve(normal_matrices, triangles.transpose(0, 2, 1))[:, wanted]
    transfer = solver @ analysis.factors[:, :m]
    transfer[:, np.arange(5), wanted] -= 1.0
    squares = surface.sigma**2 * np.square(solver).sum(axis=2) + np.square(transfer) @ ring.variances
    mean = squares.mean(axis=0)
    to_terms = np.linalg.inv(basis.monomials[:m, :m])
    with np.errstate(over="ignore", invalid="ignore"):  # beyond 1e25 lengths; the fit is then refused
        powers = analysis.radius ** basis.degrees[:m].astype(np.float64)
        prior_per_length = (to_terms.T * prior) @ to_terms * np.outer(powers, powers)
    return FitPlan(
        rings=analysis.rings,
        degree=degree,
        prior=prior_per_length,
        noise=float(np.sqrt(analysis.mean_squares[degree])),
        normal_error=float(np.sqrt(mean[:2].sum()) / analysis.radius),
        curvature_error=float(np.sqrt(8.0 * mean[2:].sum()) / analysis.radius**2),
    )
