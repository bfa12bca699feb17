"""Fit specifications and their predicted errors: which ring, degree, prior and distance weights to fit with.

A fit is linear in the heights z: the coefficients are b = H z with H = (A^T W A + P)^-1 A^T W, where A is the design
matrix, W the distance weights and P = sigma^2 times the inverse covariance of the terms (the prior). Its mean squared
error is the variance H C H^T of the noise with covariance C plus, for each random term of variance v, the squared bias
v (H A - 1)^2. Both are averaged over a few neighbourhoods of a `SurfaceModel`. The specification with the smallest
geometric mean of the errors of normal and curvature, weighted by its computing time, is selected.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.patches.harmonics import harmonic_basis
from bezier_filters.patches.polynomials import PolynomialSpace, total_degree_space
from bezier_filters.sampling.ring_analysis import FREE_DEGREE
from bezier_filters.surface_model.fit_options import CANDIDATE_DEGREES, FitOptions
from bezier_filters.surface_model.model import RingModel, SurfaceModel
from bezier_filters.surface_model.quartic_mean import QUARTIC

THIRD_ORDER = 3
# times the information of the points on a term: suppresses the term and keeps the normal equations well conditioned
MAX_PRIOR = 1e5
MIN_WEIGHT_RADIUS = 0.3  # lower bound over the radius of the neighbourhood: a smaller one leaves too few points
# exponent of the computing time, by which the predicted error is multiplied: a fit that takes twice as long must reduce
# the error by a fifth
COST_EXPONENT = 0.35
# factor per degree on the predicted error: the variances of higher terms are less certain
DEGREE_PENALTY = 1.03
# computing times in about nanoseconds: of learning, which dominates on small meshes; of a vertex; and of each of its
# points, in addition to their moments
LEARNING_TIME, VERTEX_TIME, POINT_TIME = 1e8, 700.0, 85.0
# factor on the variance of correlated noise in standard errors: its long waves are mistaken for shape
LONG_WAVE_INFLATION = 1.2
# ratio to the smallest predicted error at which the search over degrees or rings stops
MAX_ERROR_RATIO = 1.3
# Narrower rings have hardly more points than a quartic fit has coefficients. Such a fit follows correlated noise, and
# small changes of the data decide for or against it.
MIN_QUARTIC_FIT_RINGS = 3
# ratios of predicted errors: a rise that ends the search for a minimum, and the improvement that a wider ring beyond it
# must promise
MIN_ERROR_RISE, MIN_ERROR_DROP = 1.05, 1.5
# widest ring with distance weights: they pay where the surface varies fast, and narrow rings are best there
WEIGHTED_RINGS = 4
# of the largest entry of the normal equations: makes singular ones solvable, whose errors are then huge
NORMAL_EQUATION_RIDGE = 1e-14
HEIGHT_TERM = np.arange(1, dtype=np.int32)  # place of the constant among the terms
DERIVATIVE_TERMS = np.arange(1, 6, dtype=np.int32)  # those of the two slopes, x^2 - y^2, 2 x y and x^2 + y^2
Candidate = TypeVar("Candidate")


@dataclass(frozen=True)
class FitSpec:
    """A polynomial fit of given degree with a prior for its higher terms."""

    rings: int  # size of the neighbourhood
    degree: int  # total degree of the polynomial
    points: float  # of a neighbourhood on average
    radius: float  # unit of x and y for `term_prior`, a length
    term_prior: FloatArray  # (m,): sigma^2 over the variance of each term of `harmonic_basis`, 0 for the free degrees
    # distance beyond which weights fall, a length: points at r weigh 1 / (1 + (r / radius)^(2 degree + 2)), the
    # reciprocal of the variances of noise and of the terms beyond the degree; infinite for equal weights
    weight_radius: float
    normal_error: float  # predicted standard error of the normal, radians
    curvature_error: float  # predicted standard error of the second derivatives, 1/length
    # standard deviations of the heights, lengths, for which the covariance of the coefficients gives the upper bounds
    # of these errors on average
    normal_noise: float = 0.0
    curvature_noise: float = 0.0
    height_noise: float = 0.0  # the same for the height of the patch
    overhead: float = 0.0  # time per vertex that does not depend on the specification
    quartic: float = 0.0  # factor of a `QuarticMean` about which the terms of degree 4 vary

    @property
    def space(self) -> PolynomialSpace:
        """Space of the fitted polynomials."""
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
        """Objective: the geometric mean of both errors, which have different units."""
        return float(np.sqrt(self.normal_error * self.curvature_error))

    @property
    def cost(self) -> float:
        """Time per vertex, up to a factor."""
        return (
            self.overhead + VERTEX_TIME + self.rings**2 * (POINT_TIME + (self.degree + 1.0) * (2.0 * self.degree + 1.0))
        )


@dataclass(frozen=True)
class FitEquations:
    """Normal equations of a fit of m terms over the first neighbourhoods of a ring, T of them."""

    normal_matrices: FloatArray  # (T, m, m): design^T W design plus prior, W being the weights
    products: FloatArray  # (T, m, M): the same without prior and for all terms on the right
    # (T, m, m): covariance of the right-hand sides under noise and the variation beyond all terms, length^2
    noise: FloatArray


def fit_equations(ring: RingModel, spec: FitSpec) -> FitEquations:
    """Set up the equations of a fit."""
    analysis, m = ring.analysis, len(spec.term_prior)
    if np.isinf(spec.weight_radius) and spec.degree <= analysis.degree:
        products = analysis.first_grams[:, :m]
        rest = analysis.rest_grams if analysis.rings <= WEIGHTED_RINGS else products
        noise = ring.noise.grams[:, :m, :m] + ring.unmodelled * rest[:, :m, :m]
    else:
        design = analysis.first_designs
        ratio = np.square(analysis.first_points).sum(axis=2) / (spec.weight_radius / analysis.radius) ** 2
        weighted = design[..., :m] / (1.0 + ratio ** (spec.degree + 1))[..., np.newaxis]
        products = weighted.transpose(0, 2, 1) @ design
        rest = weighted.transpose(0, 2, 1) @ (weighted * analysis.rest_profile[..., np.newaxis])
        noise = ring.noise.propagate_covariance(weighted) + ring.unmodelled * rest
    normal_matrices = products[..., :m].copy()
    diagonal = normal_matrices[:, np.arange(m), np.arange(m)]
    normal_matrices[:, np.arange(m), np.arange(m)] += spec.term_prior + NORMAL_EQUATION_RIDGE * diagonal.max(
        axis=1, keepdims=True
    )
    return FitEquations(normal_matrices, products, noise)


def mean_squared_errors(equations: FitEquations, variances: FloatArray) -> tuple[float, float]:
    """Mean squared errors of the slopes and of the second-degree coefficients, in units of the radius, length^2.

    `variances` (M,) are the variances of the terms, length^2.
    """
    mean = _term_errors(equations, variances, DERIVATIVE_TERMS)
    return float(mean[:2].sum()), float(mean[2:].sum())


def _term_errors(equations: FitEquations, variances: FloatArray, terms: IntArray) -> FloatArray:
    """Mean squared errors of some terms, (k,), as in `mean_squared_errors`."""
    wanted = np.eye(equations.normal_matrices.shape[1])[:, terms]  # the matrices are symmetric
    inverse_rows = np.linalg.solve(equations.normal_matrices, wanted).transpose(0, 2, 1)
    transfer = inverse_rows @ equations.products
    transfer[:, np.arange(len(terms)), terms] -= 1.0
    passed = ((inverse_rows @ equations.noise) * inverse_rows).sum(axis=2)
    result: FloatArray = (passed + np.square(transfer) @ variances).mean(axis=0)
    return result


def posterior_variances(equations: FitEquations) -> tuple[float, float, float]:
    """Posterior variances of slopes, second-degree coefficients and height, for heights of unit noise."""
    covariance = np.linalg.inv(equations.normal_matrices).mean(axis=0)
    derivatives = covariance[DERIVATIVE_TERMS, DERIVATIVE_TERMS]
    return float(derivatives[:2].sum()), float(derivatives[2:].sum()), float(covariance[0, 0])


def select_specs(specs: Sequence[FitSpec], options: FitOptions) -> list[FitSpec]:
    """Specifications with the given rings or, if none are given, without too large a radius."""
    narrowest = min((spec.radius for spec in specs), default=0.0)
    narrow = [spec for spec in specs if spec.radius <= max(options.max_radius, narrowest)]
    rings = options.ring_count
    return narrow if rings is None else [spec for spec in specs if spec.rings == rings]


def best_specs(surface: SurfaceModel, degrees: Sequence[int] = CANDIDATE_DEGREES) -> list[FitSpec]:
    """Best specification of every ring, in ascending order of rings."""
    specs = (_best_ring_spec(surface, ring, degrees) for ring in surface.by_rings)
    return [spec for spec in specs if spec is not None]


def specs_around(surface: SurfaceModel, degrees: Sequence[int], rings: int) -> list[FitSpec]:
    """Best specifications of a ring and of ever wider and narrower ones, until they are much worse."""
    specs: list[FitSpec] = []
    wider = [ring for ring in surface.by_rings if ring.analysis.rings >= rings]
    narrower = [ring for ring in reversed(surface.by_rings) if ring.analysis.rings < rings]
    for side in (wider, narrower):
        _add_until_much_worse(specs, side, lambda ring: _best_ring_spec(surface, ring, degrees))
    return sorted(specs, key=lambda spec: spec.rings)


def _best_ring_spec(surface: SurfaceModel, ring: RingModel, degrees: Sequence[int]) -> FitSpec | None:
    """Best specification of one ring; None if it determines no degree, or its variances are not finite."""
    if not np.isfinite(ring.variances).all():
        return None
    specs = candidate_specs(surface, ring, degrees)
    return _calibrate_noise(ring, best_spec(specs)) if specs else None


def candidate_specs(
    surface: SurfaceModel, ring: RingModel, degrees: Sequence[int] = CANDIDATE_DEGREES
) -> list[FitSpec]:
    """Candidates for one ring: every degree that it determines, with and without distance weights.

    A single allowed degree is used in any case: the prior determines the terms that the points do not. Otherwise
    degrees below 3 are for rings that determine no more: third derivatives cost no accuracy, because the prior shrinks
    them.
    """
    if len(degrees) > 1:
        lowest = min(THIRD_ORDER, ring.analysis.degree)
        degrees = [degree for degree in degrees if lowest <= degree <= ring.analysis.degree]
    from_the_highest = sorted(degrees, reverse=True)
    specs: list[FitSpec] = []
    if ring.analysis.rings <= WEIGHTED_RINGS:
        _add_until_much_worse(specs, from_the_highest, lambda degree: _distance_weight_spec(surface, ring, degree))
    _add_until_much_worse(specs, from_the_highest, lambda degree: _prior_spec(ring, degree))
    return specs


def _add_until_much_worse(
    specs: list[FitSpec], candidates: Iterable[Candidate], spec_of: Callable[[Candidate], FitSpec | None]
) -> None:
    """Append the specifications of the candidates in order, up to the first that is much worse than the best."""
    for candidate in candidates:
        spec = spec_of(candidate)
        if spec is not None:
            specs.append(spec)
            if spec.error > MAX_ERROR_RATIO * min(other.error for other in specs):
                break


def best_spec(specs: Sequence[FitSpec]) -> FitSpec:
    """Specification with the smallest product of error, degree penalty and cost; of degree 3 or more, if there is one.

    It minimises error * `DEGREE_PENALTY` ^ degree * cost ^ `COST_EXPONENT`.
    """
    return min(
        _prefer_third_order(specs), key=lambda spec: spec.error * DEGREE_PENALTY**spec.degree * spec.cost**COST_EXPONENT
    )


def specs_to_first_minimum(specs: Sequence[FitSpec]) -> Sequence[FitSpec]:
    """Specifications of ascending rings up to the first local minimum of the error, unless the global one is far lower.

    The error rises where the ring reaches detail. In a second minimum, at wider rings, that detail would be smoothed as
    if it were correlated noise. If both minima are about equal, the first one keeps the detail.
    """
    specs = _prefer_third_order(specs)
    lowest = min(spec.error for spec in specs)
    least = np.inf
    for k, spec in enumerate(specs):
        if spec.error > MIN_ERROR_RISE * least and least <= MIN_ERROR_DROP * lowest:
            return specs[:k]
        least = min(least, spec.error)
    return specs


def prefer_cubic(surface: SurfaceModel, spec: FitSpec) -> FitSpec:
    """The cubic fit on the same narrow ring, if its error is nearly as small under correlated noise; else `spec`."""
    if not surface.noise.sills or spec.rings >= MIN_QUARTIC_FIT_RINGS or spec.degree <= THIRD_ORDER:
        return spec
    (ring,) = (ring for ring in surface.by_rings if ring.analysis.rings == spec.rings)
    third = _best_ring_spec(surface, ring, (THIRD_ORDER,))
    return spec if third is None or third.error > MIN_ERROR_DROP * spec.error else third


def _prefer_third_order(specs: Sequence[FitSpec]) -> Sequence[FitSpec]:
    return [spec for spec in specs if spec.degree >= THIRD_ORDER] or specs


def predict_under_model(spec: FitSpec, surface: SurfaceModel) -> FitSpec | None:
    """The same fit with the errors that another model predicts; None if the model has no such ring."""
    for ring in surface.by_rings:
        if ring.analysis.rings == spec.rings:
            return _calibrate_noise(ring, _predict_errors(ring, spec))
    return None


def _prior_spec(ring: RingModel, degree: int) -> FitSpec:
    """Specification of one degree over one ring with its optimal prior."""
    # The terms beyond the degree act on the fit much like noise.
    noise = float(ring.analysis.mean_squares[min(degree, ring.analysis.degree)])
    return _optimal_spec(ring, degree, noise)


def _distance_weight_spec(surface: SurfaceModel, ring: RingModel, degree: int) -> FitSpec | None:
    """Specification with optimal prior and distance weights; None if the weights are practically equal."""
    basis, noise = harmonic_basis(), surface.sigma**2
    # The terms beyond the degree: their variance at the radius, which falls inwards like the first of them.
    left_out = ring.variances[basis.degrees > degree].sum()
    if left_out <= 0.0:
        return None
    power = 2 * degree + 2
    near = max(MIN_WEIGHT_RADIUS, (noise / left_out) ** (1.0 / power))  # where noise = left_out r^power
    if near >= 1.0:
        return None
    return _optimal_spec(ring, degree, max(noise, left_out * near**power), near * ring.analysis.radius)


def _optimal_spec(ring: RingModel, degree: int, noise: float, weight_radius: float = np.inf) -> FitSpec:
    """The fit with the optimal prior for heights of this noise variance, length^2, and its predicted errors.

    The terms of degree 4 vary about zero or about their `QuarticMean`, whichever predicts the smaller error.
    """
    points, radius = float(ring.analysis.sizes.mean()), ring.analysis.radius
    overhead = LEARNING_TIME / ring.analysis.vertex_count

    def spec(quartic: float) -> FitSpec:
        prior = _term_prior(ring, degree, noise, quartic)
        ends = weight_radius, 0.0, 0.0
        return _predict_errors(
            ring, FitSpec(ring.analysis.rings, degree, points, radius, prior, *ends, overhead=overhead, quartic=quartic)
        )

    # fits of higher degrees estimate the fourth degree themselves, and a sample does not separate it from the sixth
    factors = {0.0, ring.quartic.factor if degree == QUARTIC else 0.0}
    return min(map(spec, factors), key=lambda spec: spec.error)


def _term_prior(ring: RingModel, degree: int, noise: float, quartic: float) -> FloatArray:
    """Noise variance over the variance of each term up to a degree, (m,); 0 for the free terms."""
    basis = harmonic_basis()
    m = basis.term_count(degree)
    information = np.ones(m)
    information[: len(ring.analysis.energies)] = ring.analysis.energies[:m]
    # Correlated noise resembles terms of low degree more than residuals.
    residual_noise = float(ring.noise.residuals[min(degree, ring.analysis.degree)])
    noise_ratios = ring.noise.score_variances / max(residual_noise, 1e-300)
    term_noise = np.full(m, noise)
    groups = basis.groups[: min(m, len(noise_ratios))]  # equal for both terms of a frequency: no direction is preferred
    group_ratios = np.bincount(groups, weights=noise_ratios[: len(groups)]) / np.bincount(groups)
    term_noise[: len(groups)] *= group_ratios[groups]
    least = np.maximum(term_noise / (MAX_PRIOR * np.maximum(information, 1e-300)), 1e-300)
    variances = ring.quartic.variances(ring.variances, quartic)[:m]
    return np.where(basis.degrees[:m] <= FREE_DEGREE, 0.0, term_noise / np.maximum(variances, least))


def _predict_errors(ring: RingModel, spec: FitSpec) -> FitSpec:
    """The specification with the errors that a model predicts."""
    slopes, curvatures = mean_squared_errors(
        fit_equations(ring, spec), ring.quartic.variances(ring.variances, spec.quartic)
    )
    return replace(
        spec,
        normal_error=_root_or_infinity(slopes) / ring.analysis.radius,
        curvature_error=_root_or_infinity(8.0 * curvatures) / ring.analysis.radius**2,
    )


def _root_or_infinity(squared_error: float) -> float:
    """Square root; infinity for negative values, which rounding gives in nearly singular equations."""
    return float(np.sqrt(squared_error)) if squared_error >= 0.0 else np.inf


def _calibrate_noise(ring: RingModel, spec: FitSpec) -> FitSpec:
    """The specification with the noise for which its standard errors are the predicted upper bounds."""
    equations = fit_equations(ring, spec)
    if ring.noise.model.sills:
        equations = replace(equations, noise=LONG_WAVE_INFLATION * equations.noise)
    variances = ring.quartic.variances(ring.upper_variances, spec.quartic, upper=True)
    (height,) = _term_errors(equations, variances, HEIGHT_TERM)
    expected, stated = (*mean_squared_errors(equations, variances), height), posterior_variances(equations)
    with np.errstate(invalid="ignore", divide="ignore"):
        normal, curvature, height = (
            float(np.nan_to_num(np.sqrt(e / s))) for e, s in zip(expected, stated, strict=True)
        )
    return replace(spec, normal_noise=normal, curvature_noise=curvature, height_noise=height)
