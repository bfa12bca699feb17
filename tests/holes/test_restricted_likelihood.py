"""Reflectors, the restricted likelihood and the best linear prediction, against dense algebra of numpy."""

import numpy as np
import pytest

from bezier_filters.holes.restricted_likelihood import (
    QUADRATIC_TERMS,
    apply_on_both_sides,
    householder_reflectors,
    reml_criterion,
    solve_trend,
)

COUNT = 40


def quadratics(points):
    """Values of all quadratic polynomials at points, (n, 10)."""
    x, y, z = points.T
    return np.column_stack([np.ones_like(x), x, y, z, x * x, x * y, x * z, y * y, y * z, z * z])


def kernel(points):
    """The generalised covariance |x - x'|^3."""
    return np.linalg.norm(points[:, np.newaxis] - points, axis=2) ** 3


@pytest.fixture
def case():
    """The trend, a kernel, values, and the covariance of their errors at some points."""
    random = np.random.default_rng(0)
    points = random.uniform(-1.0, 1.0, (COUNT, 3))
    factor = random.standard_normal((COUNT, COUNT))
    return quadratics(points), kernel(points), random.standard_normal(COUNT), np.eye(COUNT) + factor @ factor.T / COUNT


def matrix_of(reflectors):
    return np.column_stack([reflectors.apply(column) for column in np.eye(COUNT)])


def lower(matrix):
    """The lower triangle; what is above is never read."""
    result = matrix.copy()
    result[np.triu_indices(len(matrix), 1)] = np.nan
    return result


def test_reflectors_are_orthogonal_and_leave_a_triangle(case):
    trend, *_ = case
    reflectors = householder_reflectors(trend.T.copy())
    q = matrix_of(reflectors)
    np.testing.assert_allclose(q @ q.T, np.eye(COUNT), atol=1e-12)
    np.testing.assert_allclose(q @ trend, np.vstack([reflectors.triangle, np.zeros((COUNT - 10, 10))]), atol=1e-12)
    transposed = np.column_stack([reflectors.apply_transpose(column) for column in np.eye(COUNT)])
    np.testing.assert_allclose(transposed, q.T, atol=1e-12)


def test_reflectors_are_applied_on_both_sides(case):
    trend, covariance, *_ = case
    reflectors = householder_reflectors(trend.T.copy())
    q, found = matrix_of(reflectors), lower(covariance)
    size = apply_on_both_sides(found, reflectors)
    expected = q @ covariance @ q.T
    np.testing.assert_allclose(np.tril(found), np.tril(expected), atol=1e-10)
    assert size == pytest.approx(np.linalg.norm(expected[10:, 10:]))


@pytest.mark.parametrize("independent", [True, False])
@pytest.mark.parametrize("variance", [0.5, 20.0])
def test_the_criterion_is_that_of_the_contrasts(case, variance, independent):
    """Those are all values without any trend; also, whichever basis of them is taken."""
    trend, covariance, values, errors = case
    errors = np.eye(COUNT) if independent else errors
    reflectors = householder_reflectors(trend.T.copy())
    transformed, noise = lower(covariance), np.empty((0, 0)) if independent else lower(errors)
    apply_on_both_sides(transformed, reflectors)
    if not independent:
        apply_on_both_sides(noise, reflectors)
    contrasts = reflectors.apply(values)[QUADRATIC_TERMS:]
    found, weights = reml_criterion(transformed, contrasts, noise, variance, np.empty((COUNT - 10, COUNT - 10)))
    basis = np.linalg.svd(trend)[0][:, 10:]  # another one
    of_contrasts = basis.T @ (covariance + variance * errors) @ basis
    energy = basis.T @ values @ np.linalg.solve(of_contrasts, basis.T @ values)
    expected = np.linalg.slogdet(of_contrasts)[1] + (COUNT - 10) * np.log(energy)
    assert found == pytest.approx(expected, rel=1e-10)
    assert contrasts @ weights == pytest.approx(energy)


def test_the_prediction_is_that_of_universal_kriging(case):
    """Weights c and coefficients b of K c + A b = z, A^T c = 0, by Lagrange's multipliers."""
    trend, covariance, values, errors = case
    variance = 2.0
    reflectors = householder_reflectors(trend.T.copy())
    transformed, noise = lower(covariance), lower(errors)
    for matrix in (transformed, noise):
        apply_on_both_sides(matrix, reflectors)
    target = reflectors.apply(values)
    _, contrasts = reml_criterion(
        transformed, target[QUADRATIC_TERMS:], noise, variance, np.empty((COUNT - 10, COUNT - 10))
    )
    quadratic = target[:QUADRATIC_TERMS].copy()
    solve_trend(transformed, noise, variance, contrasts, reflectors.triangle, quadratic)
    weights = reflectors.apply_transpose(np.concatenate([np.zeros(QUADRATIC_TERMS), contrasts]))
    system = np.block([[covariance + variance * errors, trend], [trend.T, np.zeros((10, 10))]])
    expected = np.linalg.solve(system, np.concatenate([values, np.zeros(10)]))
    np.testing.assert_allclose(weights, expected[:COUNT], atol=1e-9)
    np.testing.assert_allclose(quadratic, expected[COUNT:], atol=1e-8)


def test_a_matrix_that_is_not_positive_definite_has_an_infinite_criterion(case):
    trend, covariance, values, _ = case
    reflectors = householder_reflectors(trend.T.copy())
    transformed = lower(-covariance)  # whose contrasts have negative variances
    apply_on_both_sides(transformed, reflectors)
    contrasts = reflectors.apply(values)[QUADRATIC_TERMS:]
    found, _ = reml_criterion(transformed, contrasts, np.empty((0, 0)), 1e-9, np.empty((COUNT - 10, COUNT - 10)))
    assert found == np.inf
