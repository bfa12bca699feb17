"""The QR factors of neighbourhoods, and the sums of their fits, against the dense algebra of numpy."""

import numpy as np
import pytest
from random_neighbourhoods import analyse_ring, as_sample, draw, terms_at, variances_by_degree

from bezier_filters.patches.harmonics import harmonic_basis
from bezier_filters.sampling.ring_analysis import MIN_SAMPLES

BASIS = harmonic_basis()


ROUGH = variances_by_degree(1.0, 0.5)


def analysed(points):
    return analyse_ring(as_sample(points), 3, len(points))


def free_values(basis_values, heights, degree, seen):
    """Least squares in the seen terms up to a degree: coefficients, (A^T A)^-1 and squared residual."""
    terms = np.flatnonzero(seen & (BASIS.degrees <= degree))
    design = basis_values[:, terms]
    coefficients = np.linalg.lstsq(design, heights, rcond=None)[0]
    upper = np.linalg.inv(np.linalg.qr(design, mode="r"))
    return terms, coefficients, (upper**2).sum(axis=1), np.sum((design @ coefficients - heights) ** 2)


def assert_fits_of_every_degree(analysis, row, points, seen):
    values, heights = terms_at(points[:, :2] / analysis.radius), points[:, 2]
    for degree in range(analysis.degree + 1):
        terms, coefficients, variances, residual = free_values(values, heights, degree, seen)
        assert analysis.sums.residuals[row, degree] == pytest.approx(residual, rel=1e-6, abs=1e-12)
        assert analysis.sums.freedom[row, degree] == len(points) - len(terms)
        groups = BASIS.groups[terms]
        for got, summands in (
            (analysis.sums.term_squares, coefficients**2 / variances),
            (analysis.sums.term_weights, 1.0 / variances),
            (analysis.sums.term_counts, np.ones(len(terms))),
        ):
            expected = np.bincount(groups, summands, minlength=got.shape[2])
            np.testing.assert_allclose(got[row, degree], expected, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize(("size", "degree"), [(9, 2), (25, 4), (60, 8)])
def test_factors_and_parts_are_those_of_a_qr_factorisation(size, degree):
    points = draw(MIN_SAMPLES, size, ROUGH, 0.1, radius=0.3).points
    analysis = analysed(points)
    assert analysis.degree == degree
    assert analysis.radius == pytest.approx(0.3)
    m = BASIS.term_count(degree)
    for row in range(MIN_SAMPLES):
        design = terms_at(points[row, :, :2] / analysis.radius)
        q, _ = np.linalg.qr(design[:, :m])
        q *= np.sign(np.einsum("pk,pk->k", q, design[:, :m]))  # the diagonal of the factor is positive
        np.testing.assert_allclose(analysis.factors[row], q.T @ design, atol=1e-10)
        np.testing.assert_allclose(analysis.sums.scores[row], q.T @ points[row, :, 2], atol=1e-10)
        beyond = np.square(design - q @ (q.T @ design)).sum(axis=0)
        np.testing.assert_allclose(
            analysis.sums.unexplained[row], np.where(BASIS.degrees > degree, beyond, 0.0), atol=1e-10
        )


@pytest.mark.parametrize("size", [9, 25, 60])
def test_residuals_and_coefficients_are_those_of_least_squares_fits_of_every_degree(size):
    points = draw(MIN_SAMPLES, size, ROUGH, 0.1, radius=20.0).points
    analysis = analysed(points)
    for row in range(MIN_SAMPLES):
        assert_fits_of_every_degree(analysis, row, points[row], np.ones(len(BASIS.degrees), dtype=bool))


@pytest.mark.parametrize("sizes", [(30, 19), (60, 45)])
def test_neighbourhoods_of_a_block_may_have_different_sizes(sizes):
    sample = as_sample(draw(MIN_SAMPLES + 1, sizes[0], ROUGH, 0.1, radius=2.0).points)
    sample.sizes[::2] = sizes[1]
    analysis = analyse_ring(sample, 3, len(sample.points))
    for row, size in enumerate(analysis.sizes):
        assert_fits_of_every_degree(analysis, row, sample.points[row, :size], np.ones(len(BASIS.degrees), dtype=bool))


def test_terms_that_the_points_do_not_see_count_for_nothing():
    """Heights over two straight lines: of each degree only two combinations of terms are seen."""
    points = draw(MIN_SAMPLES, 60, ROUGH, 0.1).points
    along = np.linalg.norm(points[..., :2], axis=2) * np.where(np.arange(60) % 4 < 2, 1.0, -1.0)
    lines = np.array([[1.0, 0.0], [0.6, 0.8]])[np.arange(60) % 2]
    points[..., :2] = along[..., np.newaxis] * lines
    analysis = analysed(points)
    m = BASIS.term_count(analysis.degree)
    for row in range(MIN_SAMPLES):
        diagonal = np.diag(analysis.factors[row][:, :m])
        seen = np.zeros(len(BASIS.degrees), dtype=bool)
        seen[:m] = diagonal > 0.0
        assert np.bincount(BASIS.degrees[seen]).tolist() == [1] + [2] * analysis.degree
        assert not analysis.factors[row][~seen[:m]].any()
        assert not analysis.sums.scores[row][~seen[:m]].any()
        assert_fits_of_every_degree(analysis, row, points[row], seen)
