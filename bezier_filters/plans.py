"""Which neighbourhood, degree and weight to fit with: predicted errors of all the choices."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bezier_filters.arrays import FloatArray
from bezier_filters.harmonics import harmonic_basis
from bezier_filters.polynomials import PolynomialSpace, total_degree_space
from bezier_filters.ring_analysis import FREE_DEGREE
from bezier_filters.surface_model import RingModel, SurfaceModel

CANDIDATE_DEGREES = (2, 3, 4, 5, 6)
WEAKER_PRIORS = (0.03, 0.001)
"""The prior takes what a degree leaves out for noise; on regular meshes it cancels out, and less is better."""
STRONGEST_PRIOR = 1e5
"""Times what the points say of a term: leaves nothing of it, and the normal equations well conditioned."""
TRIED = 24
"""Neighbourhoods over which the errors are averaged."""
GOOD_ENOUGH = 1.05
"""Of the choices whose predicted error is within this factor of the smallest, the fastest is taken."""


@dataclass(frozen=True)
class FitPlan:
    """A polynomial fit of given degree with a prior for its higher terms.

    Attributes
    ----------
    rings : int
        Size of the neighbourhood.
    degree : int
        Total degree of the polynomial.
    radius : float
        Unit of x and y for `term_prior`, a length.
    term_prior : (m,) float64
        sigma^2 over the variance of each term of `harmonic_basis`, 0 for the free degrees.
    noise : float
        Standard deviation of the heights over the fit: noise and what the degree leaves out, a length.
    normal_error : float
        Predicted standard error of the normal, radians.
    curvature_error : float
        Predicted standard error of the second derivatives, 1/length.
    """

    rings: int
    degree: int
    radius: float
    term_prior: FloatArray
    noise: float
    normal_error: float
    curvature_error: float

    @property
    def space(self) -> PolynomialSpace:
        """The polynomials."""
        return total_degree_space(self.degree)

    @property
    def prior(self) -> FloatArray:
        """sigma^2 times the inverse covariance of the monomials' coefficients, (m, m), for lengths.

        It couples only monomials of the same degree.
        """
        basis, m = harmonic_basis(), len(self.term_prior)
        to_terms = np.linalg.inv(basis.monomials[:m, :m])
        with np.errstate(over="ignore", invalid="ignore"):  # beyond 1e25 lengths; the fit is then refused
            powers = self.radius ** basis.degrees[:m].astype(np.float64)
            result: FloatArray = (to_terms.T * self.term_prior) @ to_terms * np.outer(powers, powers)
        return result

    @property
    def error(self) -> float:
        """What is minimised: the geometric mean of both errors, as each has a unit of its own."""
        return float(np.sqrt(self.normal_error * self.curvature_error))

    @property
    def cost(self) -> float:
        """Operations per vertex, up to a factor: points times moments."""
        return self.rings**2 * (self.degree + 1.0) * (2.0 * self.degree + 1.0)


def all_plans(surface: SurfaceModel, degrees: Sequence[int] = CANDIDATE_DEGREES) -> list[FitPlan]:
    """The best plan of every ring, in ascending order of rings."""
    of_rings = [ring_plans(surface, ring, degrees) for ring in surface.by_rings]
    return [best_plan(plans) for plans in of_rings if plans]


def ring_plans(surface: SurfaceModel, ring: RingModel, degrees: Sequence[int] = CANDIDATE_DEGREES) -> list[FitPlan]:
    """Plans for one ring: every degree that it determines, and weaker priors for the best."""
    plans = [_plan(surface, ring, degree, 1.0) for degree in degrees if degree <= ring.analysis.degree]
    if plans:
        degree = best_plan(plans).degree
        plans += [_plan(surface, ring, degree, strength) for strength in WEAKER_PRIORS]
    return plans


def best_plan(plans: Sequence[FitPlan]) -> FitPlan:
    """The fastest of the plans whose predicted error is practically the smallest."""
    smallest = min(plan.error for plan in plans)
    return min((plan for plan in plans if plan.error <= GOOD_ENOUGH * smallest), key=lambda plan: plan.cost)


def plan_for(plan: FitPlan, surface: SurfaceModel) -> FitPlan | None:
    """The same fit with the noise and the errors that another model predicts; None if it has no such ring."""
    for ring in surface.by_rings:
        if ring.analysis.rings == plan.rings and ring.analysis.degree >= plan.degree:
            return _predicted(surface, ring, plan.degree, plan.term_prior)
    return None


def _plan(surface: SurfaceModel, ring: RingModel, degree: int, strength: float) -> FitPlan:
    """The optimal prior of one degree over one ring, times a factor."""
    analysis, basis = ring.analysis, harmonic_basis()
    m = basis.up_to(degree)
    # What the degree leaves out acts on the fit much like noise.
    noise = strength * analysis.mean_squares[degree]
    weakest = noise / (STRONGEST_PRIOR * np.maximum(analysis.energies[:m], 1e-300))
    prior = np.where(basis.degrees[:m] <= FREE_DEGREE, 0.0, noise / np.maximum(ring.variances[:m], weakest))
    return _predicted(surface, ring, degree, prior)


def _predicted(surface: SurfaceModel, ring: RingModel, degree: int, prior: FloatArray) -> FitPlan:
    """A fit with the errors that a model predicts.

    The estimate is linear in the heights, so its mean squared error is the noise that passes
    through plus, for each random term, what is lost of it or mistaken for slope and curvature.
    """
    analysis = ring.analysis
    m = len(prior)
    triangles = analysis.factors[:TRIED, :m, :m]
    normal_matrices = triangles.transpose(0, 2, 1) @ triangles
    normal_matrices[:, np.arange(m), np.arange(m)] += prior
    wanted = np.arange(1, 6)  # two slopes, x^2 - y^2, 2 x y and x^2 + y^2
    solver = np.linalg.solve(normal_matrices, triangles.transpose(0, 2, 1))[:, wanted]
    transfer = solver @ analysis.factors[:TRIED, :m]
    transfer[:, np.arange(5), wanted] -= 1.0
    squares = surface.sigma**2 * np.square(solver).sum(axis=2) + np.square(transfer) @ ring.variances
    mean = squares.mean(axis=0)
    return FitPlan(
        rings=analysis.rings,
        degree=degree,
        radius=analysis.radius,
        term_prior=prior,
        noise=float(np.sqrt(analysis.mean_squares[degree])),
        normal_error=float(np.sqrt(mean[:2].sum()) / analysis.radius),
        curvature_error=float(np.sqrt(8.0 * mean[2:].sum()) / analysis.radius**2),
    )
