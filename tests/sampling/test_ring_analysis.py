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
