"""The fourth degree that round surfaces have, against their heights, and how much of it is found in samples."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from random_neighbourhoods import analyse_ring, as_sample, draw, fit_stars, terms_at

from bezier_filters.noise.noise_model import NoiseModel, ring_noise
from bezier_filters.patches.harmonics import harmonic_basis
from bezier_filters.surface_model.fit_spec import FitSpec
from bezier_filters.surface_model.quartic_mean import (
    MIN_QUARTIC_FACTOR,
    QUARTIC,
    learn_quartic_mean,
    round_quartics,
    zero_quartic_mean,
)

BASIS = harmonic_basis()
SECONDS, FOURTH = BASIS.degrees == 2, BASIS.degrees == QUARTIC
entries = st.floats(-1.0, 1.0)


def round_height(x, y, hessian):
    """(x' S x) (x' S^2 x) / 8."""
    points = np.stack([x, y], axis=-1)
    square = hessian @ hessian
    return np.einsum("pi,ij,pj->p", points, hessian, points) * np.einsum("pi,ij,pj->p", points, square, points) / 8.0


def hessian_of(seconds, radius=1.0):
    """Second derivatives of the terms x^2 - y^2, 2 x y and x^2 + y^2 of x / radius and y / radius."""
    c, s, h = seconds
    return 2.0 / radius**2 * np.array([[h + c, s], [s, h - c]])


def height_of(terms, xy, which):
    return terms_at(xy)[:, which] @ terms


@given(st.tuples(entries, entries, entries), st.floats(0.1, 10.0))
def test_they_are_the_product_of_both_forms(seconds, radius):
    xy = np.random.default_rng(0).uniform(-1.0, 1.0, (20, 2))
    quartic = round_quartics(np.array([seconds]), radius, np.array([1e-9]))[0]  # a small one, of any curvature
    expected = round_height(*(radius * xy).T, hessian_of(seconds, radius))
    np.testing.assert_allclose(height_of(quartic, xy, FOURTH), expected, atol=1e-12 * max(1.0, 1.0 / radius**2))


@pytest.mark.parametrize("direction", [None, 0.0, 0.7])
def test_they_go_on_from_the_curvature_like_a_sphere_or_a_cylinder(direction):
    """What is left of the heights is of the sixth order."""
    R, xy = 2.0, np.random.default_rng(0).uniform(-1.0, 1.0, (20, 2))
    if direction is None:
        across, seconds = np.hypot(*xy.T), np.array([[0.0, 0.0, 0.5 / R]])
    else:
        across = xy @ np.array([np.cos(direction), np.sin(direction)])
        seconds = 0.25 / R * np.array([[np.cos(2.0 * direction), np.sin(2.0 * direction), 1.0]])

    def left(scale):
        height = R - np.sqrt(R * R - (scale * across) ** 2)
        quartic = round_quartics(seconds, 1.0, np.full(1, scale))[0]
        return height - height_of(seconds[0], scale * xy, SECONDS) - height_of(quartic, scale * xy, FOURTH)

    assert np.linalg.norm(left(0.1)) / np.linalg.norm(left(0.05)) == pytest.approx(64.0, rel=0.01)


def test_no_surface_bends_more_than_a_sphere_through_its_farthest_point():
    seconds = np.array([[0.0, 0.0, 0.5]])  # of radius 1
    at_most, beyond = (round_quartics(factor * seconds, 1.0, np.ones(1)) for factor in (1.0, 3.0))
    np.testing.assert_allclose(beyond, at_most)


def quartic_neighbourhoods(factor, sigma, seed=0, own=0.0, count=300, size=61):
    """Neighbourhoods whose fourth degree is a factor of that of round surfaces, and random about that."""
    rng = np.random.default_rng(seed)
    drawn = draw(count, size, np.zeros(len(BASIS.degrees)), 0.0, seed=seed)
    xy = drawn.points[..., :2]
    seconds = rng.normal((0.0, 0.0, 0.15), 0.05, (count, 3))
    quartics = factor * round_quartics(seconds, 1.0, np.ones(count)) + own * rng.standard_normal((count, 5))
    z = np.einsum("npk,nk->np", terms_at(xy)[..., SECONDS], seconds)
    z += np.einsum("npk,nk->np", terms_at(xy)[..., FOURTH], quartics)
    return np.concatenate([xy, (z + sigma * rng.standard_normal(z.shape))[..., np.newaxis]], axis=2), seconds


def learned_from(points, sigma):
    analysis = analyse_ring(as_sample(points, 4), 4, points.shape[1])
    return learn_quartic_mean(ring_noise(NoiseModel(sigma**2), analysis))


@pytest.mark.parametrize("sigma", [1e-6, 1e-4, 1e-3])
@pytest.mark.parametrize("factor", [0.5, 1.0, 2.0])
def test_the_factor_of_a_sample_is_found(factor, sigma):
    points, _ = quartic_neighbourhoods(factor, sigma)
    assert learned_from(points, sigma).factor == pytest.approx(factor, abs=0.15)


def test_variances_are_those_about_the_mean():
    own = 3e-4
    points, seconds = quartic_neighbourhoods(1.0, 1e-5, own=own)
    mean = learned_from(points, 1e-5)
    assert mean.factor == pytest.approx(1.0, abs=0.1)
    np.testing.assert_allclose(mean.residual_variances[FOURTH], own**2, rtol=0.3)
    assert (mean.residual_variances[~FOURTH] == 0.0).all()
    squares = np.square(round_quartics(seconds, 1.0, np.ones(len(seconds)))).mean(axis=0)
    np.testing.assert_allclose(mean.squares[FOURTH][4], squares[4], rtol=0.3)  # the sixth power of a curvature
    about_zero = np.full(len(BASIS.degrees), 7.0)
    np.testing.assert_allclose(mean.variances(about_zero, 0.0)[~FOURTH], 7.0)
    wrong = mean.variances(about_zero, mean.factor + 2.0)
    np.testing.assert_allclose(wrong[FOURTH], mean.residual_variances[FOURTH] + 4.0 * mean.squares[FOURTH])


@pytest.mark.parametrize("seed", range(3))
def test_a_fourth_degree_that_has_nothing_to_do_with_curvature_has_no_mean(seed):
    points, _ = quartic_neighbourhoods(0.0, 1e-4, seed, own=3e-3)
    mean = learned_from(points, 1e-4)
    assert mean.factor == 0.0 or MIN_QUARTIC_FACTOR < mean.factor < 0.6, "0 but by chance"
    if mean.factor == 0.0:
        about_zero = np.ones(len(BASIS.degrees))
        np.testing.assert_array_equal(mean.variances(about_zero, 0.0), about_zero)


@pytest.mark.parametrize(("rings", "size"), [(2, 37), (3, 14)])
def test_narrow_rings_and_those_that_hold_no_fourth_degree_have_no_mean(rings, size):
    points, _ = quartic_neighbourhoods(1.0, 1e-4, size=size)
    analysis = analyse_ring(as_sample(points, rings), rings, size)
    assert learn_quartic_mean(ring_noise(NoiseModel(1e-8), analysis)).factor == zero_quartic_mean().factor == 0.0


@pytest.mark.parametrize("radius", [1.0, 0.1])
def test_the_kernel_solves_about_the_mean_that_its_own_second_derivatives_let_expect(radius):
    """The equations of the terms, solved with NumPy as often as the kernel does."""
    points, seconds = quartic_neighbourhoods(1.0, 1e-4, count=24)
    m, factor = BASIS.term_count(QUARTIC), 0.8
    prior = np.where(BASIS.degrees[:m] <= 2, 0.0, np.where(BASIS.degrees[:m] == 3, 1.0, 20.0))
    spec = FitSpec(1, QUARTIC, float(points.shape[1]), radius, prior, np.inf, 0.0, 0.0, quartic=factor)
    drawn = replace(draw(24, points.shape[1], np.zeros(len(BASIS.degrees)), 0.0), points=radius * points)
    _, hessians = fit_stars(drawn, spec)
    reaches = np.linalg.norm(points, axis=2).max(axis=1)
    for k, neighbourhood in enumerate(points):
        design = terms_at(neighbourhood[:, :2])[:, :m]
        left, right = design.T @ design + np.diag(prior), design.T @ neighbourhood[:, 2]
        found = np.linalg.solve(left, right)
        for _ in range(2):
            mean = np.zeros(m)
            mean[FOURTH[:m]] = factor * round_quartics(found[np.newaxis, SECONDS[:m]], 1.0, reaches[k : k + 1])[0]
            found = np.linalg.solve(left, right + prior * mean)
        np.testing.assert_allclose(radius * hessians[k], hessian_of(found[SECONDS[:m]]), rtol=1e-3, atol=1e-3)
    plain = fit_stars(drawn, replace(spec, quartic=0.0))[1]
    truth = np.array([hessian_of(row) for row in seconds]) / radius
    assert np.abs(hessians - truth).mean() < 0.5 * np.abs(plain - truth).mean()
