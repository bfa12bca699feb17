"""What correlated noise does to fits, against dense algebra, noise that was drawn, and white noise."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from random_neighbourhoods import (
    analyse_ring,
    as_sample,
    draw,
    fit_stars,
    terms_at,
    variances_by_degree,
    with_correlated_noise,
)
from scipy.linalg import sqrtm

from bezier_filters.noise.noise_model import (
    HIDDEN_RANGE_FACTOR,
    MAX_UNDERESTIMATION,
    NoiseModel,
    pairwise_squared_distances,
    rescale_noise,
    ring_noise,
)
from bezier_filters.patches.harmonics import harmonic_basis
from bezier_filters.sampling.ring_analysis import COMPARISON_SAMPLE_SIZE, NOISE_SAMPLE_SIZE
from bezier_filters.surface_model.fit_spec import candidate_specs
from bezier_filters.surface_model.model import RingModel, SurfaceModel
from bezier_filters.surface_model.quartic_mean import zero_quartic_mean

BASIS = harmonic_basis()
SIZE = 40  # points of a 3-ring
EDGE = 1.0 / 3.0
NOISES = {
    "short": NoiseModel(0.3, (0.7,), (0.7 * EDGE,)),
    "long": NoiseModel(0.05, (0.95,), (1.4 * EDGE,)),
    "two parts": NoiseModel(0.2, (0.5, 0.3), (0.5 * EDGE, 2.0 * EDGE)),
}
each_noise = pytest.mark.parametrize("noise", NOISES.values(), ids=NOISES)


def analysed(drawn):
    return analyse_ring(as_sample(drawn.points), 3, len(drawn.points))


def bent(steep):
    """Neighbourhoods whose slopes and curvatures are of the order of `mean_square_steepness`."""
    variances = np.where((BASIS.degrees == 1) | (BASIS.degrees == 2), steep**2, 0.0)
    return draw(30, SIZE, variances, 1e-9)


def dense_covariance(noise, points):
    """For points (n, 3) whose slopes are those of the quadratic through them.

    Distances are those after a stretch that makes the neighbourhood as wide in all directions.
    """
    values = terms_at(points[:, :2])
    fit = np.linalg.lstsq(values[:, :6], points[:, 2], rcond=None)[0]
    step = 1e-5
    slopes = [
        (terms_at(points[:, :2] + h) - terms_at(points[:, :2] - h))[:, :6] @ fit / (2.0 * step)
        for h in (np.array([step, 0.0]), np.array([0.0, step]))
    ]
    normals = np.column_stack([-slopes[0], -slopes[1], np.ones(len(points))])
    heights = np.linalg.norm(normals, axis=1)  # of a unit of length along the normal, over the plane
    moments = points[:, :2].T @ points[:, :2]
    stretch = np.sqrt(0.5 * np.trace(moments)) * np.linalg.inv(sqrtm(moments))
    stretched = np.column_stack([points[:, :2] @ stretch, points[:, 2]])
    squares = np.square(stretched[:, np.newaxis] - stretched).sum(axis=2)
    alike = sum(sill * np.exp(-squares / (2.0 * length**2)) for sill, length in parts_of(noise))
    return np.outer(heights, heights) * (alike + noise.white * np.eye(len(points)))


def parts_of(noise):
    return zip(noise.sills, noise.lengths, strict=True)


@pytest.mark.parametrize("noise", [*NOISES.values(), NoiseModel(0.7)], ids=[*NOISES, "white"])
@pytest.mark.parametrize(
    ("steep", "size", "narrow"), [(0.0, SIZE, 1.0), (0.3, SIZE, 1.0), (0.3, SIZE - 1, 1.0), (0.0, SIZE, 0.5)]
)
def test_variances_of_fits_are_those_of_explicit_linear_estimators(noise, steep, size, narrow):
    """L Sigma L^T for the least squares estimator L of every degree, and what I - A L leaves."""
    points = bent(steep).points
    points[..., 1] *= narrow
    points[:-1, size:] = 0.0
    sizes = np.append(np.full(len(points) - 1, size), SIZE).astype(np.int32)
    sample = as_sample(points)._replace(sizes=np.repeat(sizes[:, np.newaxis], 4, axis=1))
    analysis = analyse_ring(sample, 3, len(points))
    m = BASIS.term_count(analysis.degree)
    found = ring_noise(noise, analysis)
    parts, residuals, ratios = [], [], []
    for points in analysis.points[analysis.rows[:NOISE_SAMPLE_SIZE], :size] / analysis.radius:
        sigma = dense_covariance(replace(noise, lengths=tuple(x / analysis.radius for x in noise.lengths)), points)
        design = terms_at(points[:, :2])[:, :m]
        orthonormal = np.linalg.qr(design)[0]
        parts.append(np.diag(orthonormal.T @ sigma @ orthonormal))
        left, over = [], np.zeros((analysis.degree + 1, m))
        for degree in range(analysis.degree + 1):
            count = BASIS.term_count(degree)
            estimator = np.linalg.pinv(design[:, :count])
            over[degree, :count] = np.diag(estimator @ sigma @ estimator.T) / np.square(estimator).sum(axis=1)
            remover = np.eye(size) - design[:, :count] @ estimator
            left.append(np.trace(remover @ sigma @ remover.T) / (size - count))
        residuals.append(left)
        ratios.append(over)
    np.testing.assert_allclose(found.score_variances, np.mean(parts, axis=0), rtol=1e-5)
    np.testing.assert_allclose(found.residuals, np.mean(residuals, axis=0), rtol=1e-5)
    ratios = np.mean(ratios, axis=0)
    for degree in range(analysis.degree + 1):
        for group in range(BASIS.groups[BASIS.term_count(degree) - 1] + 1):
            expected = ratios[degree, : BASIS.term_count(degree)][
                BASIS.groups[: BASIS.term_count(degree)] == group
            ].mean()
            assert found.coefficients[degree, group] == pytest.approx(expected, rel=1e-5)
    assert found.model.variance == noise.variance
    propagate_covariance = found.propagate_covariance(
        np.broadcast_to(np.eye(SIZE), (COMPARISON_SAMPLE_SIZE, SIZE, SIZE))
    )
    expected = [dense_covariance(noise, points) for points in analysis.points[analysis.rows[analysis.first], :size]]
    np.testing.assert_allclose(propagate_covariance[:, :size, :size], expected, rtol=1e-5)
    assert found.is_flat == (steep == 0.0)


@pytest.mark.parametrize("noise", [NOISES["short"], NoiseModel(0.7)], ids=["short", "white"])
def test_places_beyond_the_points_of_a_neighbourhood_count_for_nothing(noise):
    points = bent(0.3).points
    sizes = np.random.default_rng(0).integers(SIZE - 8, SIZE + 1, len(points), dtype=np.int32)
    found = []
    for far in (0.0, 0.7):
        padded = np.where((np.arange(SIZE) < sizes[:, np.newaxis])[..., np.newaxis], points, far)
        sample = as_sample(padded)._replace(sizes=np.repeat(sizes[:, np.newaxis], 4, axis=1))
        found.append(ring_noise(noise, analyse_ring(sample, 3, len(points))))
    zeros, others = found
    for name in ("score_variances", "residuals", "coefficients", "grams"):
        np.testing.assert_array_equal(getattr(others, name), getattr(zeros, name))


@each_noise
def test_noise_that_was_drawn_is_found_by_the_analysis_as_was_foreseen(noise):
    """Means of squares over many neighbourhoods, by the kernel; within four standard errors."""
    count, small = 1000, 1e-6
    drawn = with_correlated_noise(draw(count, SIZE, np.zeros(len(BASIS.degrees)), 0.0), noise.scale_variance(small**2))
    analysis = analysed(drawn)
    found, sums = ring_noise(noise.scale_variance(small**2), analysis), analysis.sums
    assert np.square(sums.scores).mean(axis=0) / found.score_variances == pytest.approx(
        1.0, abs=4.0 * np.sqrt(2.0 / count)
    )
    assert analysis.mean_squares / found.residuals == pytest.approx(1.0, abs=0.05)
    for degree in range(analysis.degree + 1):
        groups = BASIS.groups[BASIS.term_count(degree) - 1] + 1
        squares = sums.term_squares[:, degree, :groups].sum(axis=0) / sums.term_counts[:, degree, :groups].sum(axis=0)
        assert squares / found.coefficients[degree, :groups] == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / count))
    spread = found.coefficients[analysis.degree].max() / found.coefficients[analysis.degree][:groups].min()
    assert spread > 2.0, "white noise would give 1"


def models_of(noise, analysis, variances):
    ring = RingModel(analysis, ring_noise(noise, analysis), variances, variances, 0.0, zero_quartic_mean())
    return SurfaceModel(noise, (ring,))


def test_noise_that_reaches_no_neighbour_is_white():
    """All that is known of it, and the errors that plans predict."""
    small = 1e-5
    variances, sigma = small**2 * variances_by_degree(0.3, 0.2), 0.3 * small
    analysis = analysed(draw(50, SIZE, variances, sigma))
    white = models_of(NoiseModel(sigma**2), analysis, variances)
    other = models_of(NoiseModel(0.25 * sigma**2, (0.75 * sigma**2,), (1e-3 * EDGE,)), analysis, variances)
    plain, found = white.by_rings[0].noise, other.by_rings[0].noise
    assert plain.covariances is None
    assert found.model.variance == pytest.approx(plain.model.variance)
    np.testing.assert_allclose(found.score_variances, plain.score_variances, rtol=1e-5)
    np.testing.assert_allclose(found.residuals, plain.residuals, rtol=1e-5)
    filled = found.coefficients > 0.0
    np.testing.assert_allclose(found.coefficients[filled], plain.coefficients[filled], rtol=1e-5)
    m = analysis.first_grams.shape[1]
    expected = sigma**2 * analysis.first_grams[..., :m]
    for grams in (found.grams, plain.grams):
        np.testing.assert_allclose(grams, expected, rtol=1e-6, atol=1e-8 * sigma**2)
    np.testing.assert_allclose(found.covariances, np.broadcast_to(sigma**2 * np.eye(SIZE), found.covariances.shape))
    ours, theirs = (candidate_specs(model, model.by_rings[0]) for model in (other, white))
    assert any(np.isfinite(spec.weight_radius) for spec in ours)
    assert [(p.degree, p.weight_radius) for p in ours] == [(p.degree, p.weight_radius) for p in theirs]
    for one, two in zip(ours, theirs, strict=True):
        assert one.normal_error == pytest.approx(two.normal_error, rel=1e-5)
        assert one.curvature_error == pytest.approx(two.curvature_error, rel=1e-5)


@each_noise
def test_errors_that_plans_predict_are_those_of_the_kernel(noise):
    """For every degree, prior and weight that is tried; that white noise of this strength would do otherwise shows."""
    small = 1e-5
    variances, noise = small**2 * variances_by_degree(0.3, 0.2), noise.scale_variance(0.09 * small**2)
    drawn = with_correlated_noise(draw(600, SIZE, variances, 0.0, seed=4), noise)
    analysis = analysed(drawn)
    model, white = (models_of(one, analysis, variances) for one in (noise, NoiseModel(noise.variance)))
    x, y, c, s, r = drawn.coefficients[:, 1:6].T  # slopes; x^2 - y^2, 2 x y and x^2 + y^2
    slope = np.column_stack([x, y])
    second = 2.0 * np.array([[r + c, s], [s, r - c]]).transpose(2, 0, 1)
    for spec in candidate_specs(model, model.by_rings[0]):
        gradients, hessians = fit_stars(drawn, replace(spec, rings=1))
        assert spec.normal_error == pytest.approx(np.sqrt(np.square(gradients - slope).sum(axis=1).mean()), rel=0.15)
        assert spec.curvature_error == pytest.approx(
            np.sqrt(np.square(hessians - second).sum(axis=(1, 2)).mean()), rel=0.15
        )
    unaware = min(spec.normal_error for spec in candidate_specs(white, white.by_rings[0]))
    assert min(spec.normal_error for spec in candidate_specs(model, model.by_rings[0])) > 1.2 * unaware


models = st.builds(
    lambda white, parts: NoiseModel(white, tuple(p[0] for p in parts), tuple(p[1] for p in parts)),
    st.floats(1e-3, 10.0),
    st.lists(st.tuples(st.floats(0.0, 10.0), st.floats(0.01, 10.0)), max_size=3),
)
points_of = arrays(np.float64, (2, 7, 3), elements=st.floats(-5.0, 5.0))
slopes_of = arrays(np.float64, (2, 7), elements=st.floats(1.0, 3.0))


@given(noise=models, points=points_of, steepness=slopes_of)
def test_covariances_are_positive_definite_and_no_correlation_is_above_one(noise, points, steepness):
    covariances = noise.covariances(points, steepness)
    np.testing.assert_allclose(covariances, covariances.transpose(0, 2, 1), rtol=1e-9)
    assert (np.linalg.eigvalsh(covariances) > 0.99 * noise.white - 1e-12 * noise.variance).all()
    variances = np.diagonal(covariances, axis1=1, axis2=2)
    np.testing.assert_allclose(variances, noise.variance * steepness**2, rtol=1e-9)
    bound = np.sqrt(variances[:, :, np.newaxis] * variances[:, np.newaxis])
    assert (np.abs(covariances) <= bound * (1.0 + 1e-9)).all()


@given(noise=models, points=points_of, factor=st.floats(1e-3, 1e3))
def test_covariances_scale_and_neither_turning_nor_moving_matters(noise, points, factor):
    level = np.ones(points.shape[:2])
    expected = noise.covariances(points, level)
    # The smallest numbers that there are have fewer digits than others.
    times = noise.scale_variance(factor).covariances(points, level)
    np.testing.assert_allclose(times, factor * expected, rtol=1e-9, atol=1e-300)
    larger = replace(noise, lengths=tuple(factor * length for length in noise.lengths))
    np.testing.assert_allclose(larger.covariances(factor * points, level), expected, rtol=1e-6, atol=1e-9)
    turn = np.linalg.qr(np.random.default_rng(0).standard_normal((3, 3)))[0]
    moved = points @ turn + np.array([1.0, -2.0, 3.0])
    least = min(noise.lengths, default=1.0)
    np.testing.assert_allclose(noise.covariances(moved, level), expected, atol=1e-12 * noise.variance / least**2)


@given(noise=models, factor=st.floats(0.0, 1e6))
def test_noise_times_a_factor_has_so_much_more_variance_and_the_same_length(noise, factor):
    noise = replace(noise, heavy=True)
    more = noise.scale_variance(factor)
    assert more.variance == pytest.approx(factor * noise.variance)
    assert more.sigma**2 == pytest.approx(more.variance)
    assert more.lengths == noise.lengths
    assert more.heavy
    if sum(noise.sills) > 1e-9 and factor > 1e-3:
        assert more.length == pytest.approx(noise.length)
        assert min(noise.lengths) * (1.0 - 1e-9) <= noise.length <= max(noise.lengths) * (1.0 + 1e-9)


def test_distances_are_those_of_all_pairs():
    points = np.random.default_rng(0).standard_normal((3, 6, 3))
    expected = [[[np.sum((p - q) ** 2) for q in one] for p in one] for one in points]
    np.testing.assert_allclose(pairwise_squared_distances(points), expected, atol=1e-12)


def test_noise_of_known_strength_is_as_alike_as_was_learned():
    """Up to what may be a mistake; beyond it the shape of what was seen stays, and the rest is longer."""
    learned = NoiseModel(0.2, (0.5, 0.3), (0.7, 2.0))
    for strength in (0.1, 1.0, MAX_UNDERESTIMATION, 2.0 * MAX_UNDERESTIMATION):
        found = rescale_noise(learned, strength * learned.sigma)
        assert found.sigma == pytest.approx(strength * learned.sigma)
        assert found.lengths[:2] == learned.lengths
        seen = replace(found, sills=found.sills[:2], lengths=found.lengths[:2])
        assert seen.white / seen.variance == pytest.approx(learned.white / learned.variance)
        assert seen.sigma == pytest.approx(min(strength, MAX_UNDERESTIMATION) * learned.sigma)
        assert found.lengths[2:] == (
            (HIDDEN_RANGE_FACTOR * max(learned.lengths),) if strength > MAX_UNDERESTIMATION else ()
        )
    assert rescale_noise(NoiseModel(2.0), 3.0) == rescale_noise(None, 3.0) == NoiseModel(9.0, given=True)
