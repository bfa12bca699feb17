"""The orthogonalised neighbourhoods, against the dense algebra of numpy."""

import numpy as np
import pytest
from random_neighbourhoods import analyse_ring, as_sample, draw, terms_at, variances_by_degree

from bezier_filters.patches.harmonics import harmonic_basis
from bezier_filters.runtime.parallel import use_threads
from bezier_filters.sampling.ring_analysis import COMPARISON_SAMPLE_SIZE, MIN_SAMPLES

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


@pytest.mark.parametrize("size", [9, 25, 60])
def test_the_typical_square_is_an_unbiased_estimate_of_the_variance_of_the_noise(size):
    count, sigma = 400, 3.0
    flat = variances_by_degree(0.0, 1.0)
    squares = [analysed(draw(count, size, flat, sigma, seed=seed).points).median_square for seed in range(10)]
    freedom = size - BASIS.term_count({9: 2, 25: 4, 60: 8}[size])
    # The median has pi / 2 times the variance of the mean.
    error = sigma**2 * np.sqrt(np.pi / 2 * 2.0 / (freedom * count * len(squares)))
    assert abs(np.mean(squares) - sigma**2) < 3.0 * error


def test_rough_places_do_not_count_as_noise():
    drawn = draw(100, 60, variances_by_degree(0.0, 1.0), 1.0)
    calm = analysed(drawn.points).median_square
    drawn.points[:20, :, 2] *= 1000.0
    rough = analysed(drawn.points)
    assert rough.median_square < 1.5 * calm
    assert rough.mean_squares[-1] > 1e5 * calm


def test_designs_and_energies_are_those_of_the_points():
    points = draw(20, 30, ROUGH, 0.1, radius=5.0).points
    analysis = analysed(points)
    values = terms_at(points[..., :2] / 5.0)
    np.testing.assert_allclose(analysis.first_designs[:7], values[:7], atol=1e-12)
    m = BASIS.term_count(analysis.degree)
    diagonals = [np.abs(np.diag(np.linalg.qr(design[:, :m], mode="r"))) for design in values]
    np.testing.assert_allclose(
        analysis.energies, np.mean(np.square(diagonals[:COMPARISON_SAMPLE_SIZE]), axis=0), rtol=1e-9
    )


def test_threads_change_nothing():
    points = draw(100, 40, ROUGH, 0.1).points
    one = analysed(points)
    with use_threads(2):
        two = analysed(points)
    np.testing.assert_array_equal(one.factors, two.factors)
    for sums, others in zip(one.sums, two.sums, strict=True):
        np.testing.assert_array_equal(sums, others)


def test_a_part_keeps_the_rows_that_are_marked_unless_they_are_too_few():
    analysis = analysed(draw(40, 25, ROUGH, 0.1).points)
    kept = np.arange(40) % 2 == 0
    part = analysis.subset(kept)
    np.testing.assert_array_equal(part.centers, np.arange(0, 40, 2))
    np.testing.assert_array_equal(part.sums.scores, analysis.sums.scores[kept])
    assert part.median_square != analysis.median_square
    assert analysis.subset(np.arange(40) < MIN_SAMPLES - 1) is None


def test_too_few_neighbourhoods_or_points_give_none():
    assert analysed(draw(MIN_SAMPLES - 1, 25, ROUGH, 0.1).points) is None
    assert analysed(draw(MIN_SAMPLES, 6, ROUGH, 0.1).points) is None
    assert analysed(np.zeros((MIN_SAMPLES, 25, 3))) is None


def test_what_no_term_follows_grows_like_the_first_terms_that_are_left_out():
    """By the power of the distance of one degree more, squared; its mean over each neighbourhood is 1."""
    points = draw(2 * MIN_SAMPLES, 25, ROUGH, 0.1, radius=0.3).points
    sizes = np.random.default_rng(0).integers(20, 26, len(points), dtype=np.int32)
    points[np.arange(25) >= sizes[:, np.newaxis]] = 0.0
    analysis = analyse_ring(as_sample(points)._replace(sizes=np.repeat(sizes[:, None], 4, axis=1)), 3, len(points))
    assert len(analysis.rest_profile) == COMPARISON_SAMPLE_SIZE
    for size, near, profile in zip(sizes, points, analysis.rest_profile, strict=False):
        expected = np.linalg.norm(near[:size, :2], axis=1) ** (2 * (analysis.degree + 1))
        np.testing.assert_allclose(profile[:size], expected / expected.mean(), atol=1e-12)
