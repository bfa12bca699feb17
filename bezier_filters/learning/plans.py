"""Which neighbourhood, degree and weight to fit with: predicted errors of all the choices.

A fit is linear in the heights. Its mean squared error is the noise that passes through plus, for each
random term of the surface, what is lost of it or mistaken for slope and curvature. It is predicted over a
few neighbourhoods from what is known of the surface.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from bezier_filters.arrays import FloatArray
from bezier_filters.learning.quartic_mean import QUARTIC
from bezier_filters.learning.ring_analysis import FREE_DEGREE
from bezier_filters.learning.surface_model import RingModel, SurfaceModel
from bezier_filters.patches.harmonics import harmonic_basis
from bezier_filters.patches.polynomials import PolynomialSpace, total_degree_space

CANDIDATE_DEGREES = (2, 3, 4, 5, 6)
THIRD_ORDER = 3
# the prior takes what a degree leaves out for noise; on regular meshes it cancels out, and less is better
WEAKER_PRIORS = (0.03, 0.001)
# times what the points say of a term: leaves nothing of it, and the normal equations well conditioned
STRONGEST_PRIOR = 1e5
LEAST_WEIGHT_RADIUS = 0.3  # of the radius of the neighbourhood, lest a fit have too few points
# power of the time that the predicted error is multiplied by: twice the time must take a fifth off the error
THRIFT = 0.35
PROMISED = 1.03  # per degree, by which the predicted error is multiplied: what is known of higher terms is less certain
# time, in the same units (about nanoseconds), of finding the plans: on small meshes that of the fit hardly matters;
# of a vertex, and of each of its points beside their moments
LEARNING, PER_VERTEX, PER_POINT = 1e8, 700.0, 85.0
# correlated noise counts as so many times its variance in standard errors: long waves of it are taken for shape
LONG_WAVES = 1.2
# once a lower degree, or another ring, has raised the predicted error by this factor, none beyond it is tried
MUCH_WORSE = 1.3
# narrower rings hold few points more than a fit of the fourth degree has coefficients: it follows correlated noise, and
# a small change of the data decides for or against it
WIDE_ENOUGH = 3
RISE, FAR_LOWER = 1.05, 1.5  # factors of predicted errors between which a valley of theirs ends, and is not good enough
# distance weights are looked at up to here: where narrow rings are best because the surface varies fast
WEIGHTED_RINGS = 4
RIDGE = 1e-14  # of the largest entry of the normal equations: makes singular ones solvable, whose errors are then huge
WANTED = np.arange(1, 6)  # places of the two slopes, x^2 - y^2, 2 x y and x^2 + y^2 among the terms
Candidate = TypeVar("Candidate")


@dataclass(frozen=True)
class FitPlan:
    """A polynomial fit of given degree with a prior for its higher terms."""

    rings: int  # size of the neighbourhood
    degree: int  # total degree of the polynomial
    points: float  # of a neighbourhood on average
    radius: float  # unit of x and y for `term_prior`, a length
    term_prior: FloatArray  # (m,): sigma^2 over the variance of each term of `harmonic_basis`, 0 for the free degrees
    # distance beyond which points weigh less, a length: at r they weigh 1 / (1 + (r / radius)^(2 degree + 2)), the
    # reciprocal of noise and what the degree leaves out; infinite for equal weights
    weight_radius: float
    normal_error: float  # predicted standard error of the normal, radians
    curvature_error: float  # predicted standard error of the second derivatives, 1/length
    # standard deviations of the heights, lengths, with which the covariance of the coefficients gives these errors,
    # cautiously, on average
    normal_noise: float = 0.0
    curvature_noise: float = 0.0
    overhead: float = 0.0  # time per vertex of what is done whatever the plan
    quartic: float = 0.0  # factor of a `QuarticMean` about which the terms of degree 4 vary

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
        """Time per vertex, up to a factor."""
        return (
            self.overhead + PER_VERTEX + self.rings**2 * (PER_POINT + (self.degree + 1.0) * (2.0 * self.degree + 1.0))
        )


@dataclass(frozen=True)
class FitEquations:
    """Normal equations of a fit of m terms over the first neighbourhoods of a ring, T of them."""

    normal_matrices: FloatArray  # (T, m, m): design^T W design plus prior, W being the weights
    products: FloatArray  # (T, m, M): the same without prior and for all terms on the right
    # (T, m, m): covariance of the right-hand sides that noise and what no term follows cause, length^2
    noise: FloatArray


def fit_equations(ring: RingModel, plan: FitPlan) -> FitEquations:
    """Set up the equations of a fit."""
    analysis, m = ring.analysis, len(plan.term_prior)
    if np.isinf(plan.weight_radius) and plan.degree <= analysis.degree:
        products = analysis.first_grams[:, :m]
        rest = analysis.rest_grams if analysis.rings <= WEIGHTED_RINGS else products
        noise = ring.noise.grams[:, :m, :m] + ring.unmodelled * rest[:, :m, :m]
    else:
        design = analysis.first_designs
        ratio = np.square(analysis.first_points).sum(axis=2) / (plan.weight_radius / analysis.radius) ** 2
        weighted = design[..., :m] / (1.0 + ratio ** (plan.degree + 1))[..., np.newaxis]
        products = weighted.transpose(0, 2, 1) @ design
        rest = weighted.transpose(0, 2, 1) @ (weighted * analysis.rest_profile[..., np.newaxis])
        noise = ring.noise.through(weighted) + ring.unmodelled * rest
    normal_matrices = products[..., :m].copy()
    diagonal = normal_matrices[:, np.arange(m), np.arange(m)]
    normal_matrices[:, np.arange(m), np.arange(m)] += plan.term_prior + RIDGE * diagonal.max(axis=1, keepdims=True)
    return FitEquations(normal_matrices, products, noise)


def squared_errors(equations: FitEquations, variances: FloatArray) -> tuple[float, float]:
    """Mean squared errors of the slopes and of the second-degree coefficients, in units of the radius, length^2.

    `variances` are those of the terms, (M,), length^2.
    """
    wanted = np.eye(equations.normal_matrices.shape[1])[:, WANTED]  # the matrices are symmetric
    inverse_rows = np.linalg.solve(equations.normal_matrices, wanted).transpose(0, 2, 1)
    transfer = inverse_rows @ equations.products
    transfer[:, np.arange(len(WANTED)), WANTED] -= 1.0
    passed = ((inverse_rows @ equations.noise) * inverse_rows).sum(axis=2)
    mean = (passed + np.square(transfer) @ variances).mean(axis=0)
    return float(mean[:2].sum()), float(mean[2:].sum())


def claimed_variances(equations: FitEquations) -> tuple[float, float]:
    """What the covariance matrices say of the same errors for heights of unit noise."""
    covariance = np.linalg.inv(equations.normal_matrices)[:, WANTED, WANTED].mean(axis=0)
    return float(covariance[:2].sum()), float(covariance[2:].sum())


@dataclass(frozen=True)
class Choices:
    """What may be chosen."""

    rings: int | None = None  # the one size of neighbourhood that is allowed; None for all
    degrees: tuple[int, ...] = CANDIDATE_DEGREES
    noise: float | None = None  # its standard deviation, if that is known
    widest: float = np.inf  # radius of neighbourhoods, a length, but for the narrowest
    only_noise: bool = False  # whether nothing but the noise is wanted: then no plan is for all rings

    def among(self, plans: Sequence[FitPlan]) -> list[FitPlan]:
        """Those of the plans that may be chosen."""
        narrowest = min((plan.radius for plan in plans), default=0.0)
        narrow = [plan for plan in plans if plan.radius <= max(self.widest, narrowest)]
        return narrow if self.rings is None else [plan for plan in plans if plan.rings == self.rings]


def all_plans(surface: SurfaceModel, degrees: Sequence[int] = CANDIDATE_DEGREES) -> list[FitPlan]:
    """The best plan of every ring, in ascending order of rings."""
    plans = (_ring_plan(surface, ring, degrees) for ring in surface.by_rings)
    return [plan for plan in plans if plan is not None]


def plans_around(surface: SurfaceModel, degrees: Sequence[int], rings: int) -> list[FitPlan]:
    """The best plans of this and of ever wider and narrower rings, as long as they are not much worse."""
    plans: list[FitPlan] = []
    wider = [ring for ring in surface.by_rings if ring.analysis.rings >= rings]
    narrower = [ring for ring in reversed(surface.by_rings) if ring.analysis.rings < rings]
    for side in (wider, narrower):
        _add_until_much_worse(plans, side, lambda ring: _ring_plan(surface, ring, degrees))
    return sorted(plans, key=lambda plan: plan.rings)


def _ring_plan(surface: SurfaceModel, ring: RingModel, degrees: Sequence[int]) -> FitPlan | None:
    """The best plan of one ring; None if it determines no degree, or is too small to compute variances."""
    if not np.isfinite(ring.variances).all():
        return None
    plans = ring_plans(surface, ring, degrees)
    return _calibrated(ring, best_plan(plans)) if plans else None


def ring_plans(surface: SurfaceModel, ring: RingModel, degrees: Sequence[int] = CANDIDATE_DEGREES) -> list[FitPlan]:
    """Plans for one ring: distance weights and every degree that it determines, and weaker priors for the best.

    A single degree is taken as it is: the prior determines what the points do not. Of several, those below the third
    are for rings that determine no more: third derivatives, which the prior holds back, cost no accuracy.
    """
    if len(degrees) > 1:
        lowest = min(THIRD_ORDER, ring.analysis.degree)
        degrees = [degree for degree in degrees if lowest <= degree <= ring.analysis.degree]
    from_the_highest = sorted(degrees, reverse=True)
    plans: list[FitPlan] = []
    if ring.analysis.rings <= WEIGHTED_RINGS:
        _add_until_much_worse(plans, from_the_highest, lambda degree: _weighted_plan(surface, ring, degree))
    _add_until_much_worse(plans, from_the_highest, lambda degree: _plan(ring, degree))
    if plans:
        best = best_plan(plans)
        if np.isinf(best.weight_radius):
            plans += [_plan(ring, best.degree, strength) for strength in WEAKER_PRIORS]
    return plans


def _add_until_much_worse(
    plans: list[FitPlan], candidates: Iterable[Candidate], plan_of: Callable[[Candidate], FitPlan | None]
) -> None:
    """Append plans of one candidate after the other, up to the first that is much worse than the best."""
    for candidate in candidates:
        plan = plan_of(candidate)
        if plan is not None:
            plans.append(plan)
            if plan.error > MUCH_WORSE * min(other.error for other in plans):
                break


def best_plan(plans: Sequence[FitPlan]) -> FitPlan:
    """The plan with the smallest predicted error, as far as that is worth its cost; of third order, if there is one."""
    return min(_of_third_order(plans), key=lambda plan: plan.error * PROMISED**plan.degree * plan.cost**THRIFT)


def first_valley(plans: Sequence[FitPlan]) -> Sequence[FitPlan]:
    """Plans of ascending rings up to the first rise of the predicted error, unless it falls far lower beyond.

    Where shape ends a neighbourhood the error rises, and in a second valley, of still wider rings, that shape is
    smoothed as if it were correlated noise: if both promise about the same, detail is kept.
    """
    plans = _of_third_order(plans)
    lowest = min(plan.error for plan in plans)
    least = np.inf
    for k, plan in enumerate(plans):
        if plan.error > RISE * least and least <= FAR_LOWER * lowest:
            return plans[:k]
        least = min(least, plan.error)
    return plans


def steady_plan(surface: SurfaceModel, plan: FitPlan) -> FitPlan:
    """The plan, or that of third order on the same narrow ring, if that is nearly as good under correlated noise."""
    if not surface.noise.sills or plan.rings >= WIDE_ENOUGH or plan.degree <= THIRD_ORDER:
        return plan
    (ring,) = (ring for ring in surface.by_rings if ring.analysis.rings == plan.rings)
    third = _ring_plan(surface, ring, (THIRD_ORDER,))
    return plan if third is None or third.error > FAR_LOWER * plan.error else third


def _of_third_order(plans: Sequence[FitPlan]) -> Sequence[FitPlan]:
    return [plan for plan in plans if plan.degree >= THIRD_ORDER] or plans


def plan_for(plan: FitPlan, surface: SurfaceModel) -> FitPlan | None:
    """The same fit with the errors that another model predicts; None if that has no such ring."""
    for ring in surface.by_rings:
        if ring.analysis.rings == plan.rings:
            return _calibrated(ring, _predicted(ring, plan))
    return None


def _plan(ring: RingModel, degree: int, strength: float = 1.0) -> FitPlan:
    """The optimal prior of one degree over one ring, times a factor."""
    # What the degree leaves out acts on the fit much like noise.
    noise = float(ring.analysis.mean_squares[min(degree, ring.analysis.degree)])
    return _plan_for_noise(ring, degree, strength * noise)


def _weighted_plan(surface: SurfaceModel, ring: RingModel, degree: int) -> FitPlan | None:
    """The optimal prior and distance weights of one degree over one ring; None if the weights are practically equal."""
    basis, noise = harmonic_basis(), surface.sigma**2
    # What the degree leaves out, from its variance at the radius downwards like its first term.
    left_out = ring.variances[basis.degrees > degree].sum()
    if left_out <= 0.0:
        return None
    power = 2 * degree + 2
    near = max(LEAST_WEIGHT_RADIUS, (noise / left_out) ** (1.0 / power))  # where noise = left_out r^power
    if near >= 1.0:
        return None
    return _plan_for_noise(ring, degree, max(noise, left_out * near**power), near * ring.analysis.radius)


def _plan_for_noise(ring: RingModel, degree: int, noise: float, weight_radius: float = np.inf) -> FitPlan:
    """The fit that would be best if heights had this noise, length^2, with the errors that are predicted for it.

    The fourth degree is expected to be what second derivatives let expect, if that is better.
    """
    points, radius = float(ring.analysis.sizes.mean()), ring.analysis.radius
    overhead = LEARNING / ring.analysis.vertex_count

    def plan(quartic: float) -> FitPlan:
        prior = _term_prior(ring, degree, noise, quartic)
        ends = weight_radius, 0.0, 0.0
        return _predicted(
            ring, FitPlan(ring.analysis.rings, degree, points, radius, prior, *ends, overhead=overhead, quartic=quartic)
        )

    # fits of higher degrees see the fourth degree themselves, and in a sample it is not told from the sixth
    factors = {0.0, ring.quartic.factor if degree == QUARTIC else 0.0}
    return min(map(plan, factors), key=lambda plan: plan.error)


def _term_prior(ring: RingModel, degree: int, noise: float, quartic: float) -> FloatArray:
    """Noise / variance of the terms up to a degree; 0 for the free ones."""
    basis = harmonic_basis()
    m = basis.term_count(degree)
    said = np.ones(m)
    said[: len(ring.analysis.energies)] = ring.analysis.energies[:m]
    # Correlated noise looks more like terms of low degree than like what fits leave over.
    likeness = ring.noise.parts / max(float(ring.noise.residuals[min(degree, ring.analysis.degree)]), 1e-300)
    of_terms = np.full(m, noise)
    groups = basis.groups[: min(m, len(likeness))]  # both terms of a frequency alike: no direction is preferred
    of_groups = np.bincount(groups, weights=likeness[: len(groups)]) / np.bincount(groups)
    of_terms[: len(groups)] *= of_groups[groups]
    least = np.maximum(of_terms / (STRONGEST_PRIOR * np.maximum(said, 1e-300)), 1e-300)
    variances = ring.quartic.variances(ring.variances, quartic)[:m]
    return np.where(basis.degrees[:m] <= FREE_DEGREE, 0.0, of_terms / np.maximum(variances, least))


def _predicted(ring: RingModel, plan: FitPlan) -> FitPlan:
    """A fit with the errors that a model predicts."""
    slopes, curvatures = squared_errors(fit_equations(ring, plan), ring.quartic.variances(ring.variances, plan.quartic))
    return replace(
        plan,
        normal_error=_root(slopes) / ring.analysis.radius,
        curvature_error=_root(8.0 * curvatures) / ring.analysis.radius**2,
    )


def _root(squared_error: float) -> float:
    """Square root, or infinity where rounding has won, in nearly singular equations, as of points that coincide."""
    return float(np.sqrt(squared_error)) if squared_error >= 0.0 else np.inf


def _calibrated(ring: RingModel, plan: FitPlan) -> FitPlan:
    """The plan with the noise that makes its standard errors those that are predicted cautiously."""
    equations = fit_equations(ring, plan)
    if ring.noise.model.sills:
        equations = replace(equations, noise=LONG_WAVES * equations.noise)
    variances = ring.quartic.variances(ring.cautious, plan.quartic, cautious=True)
    expected, claimed = squared_errors(equations, variances), claimed_variances(equations)
    with np.errstate(invalid="ignore", divide="ignore"):
        normal, curvature = (float(np.nan_to_num(np.sqrt(e / c))) for e, c in zip(expected, claimed, strict=True))
    return replace(plan, normal_noise=normal, curvature_noise=curvature)
