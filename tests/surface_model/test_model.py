"""What is learned from the data, against data whose noise and shape are known."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from random_neighbourhoods import analyse_ring, as_sample, draw, variances_by_degree

from bezier_filters import estimate_vertex_geometry
from bezier_filters.noise.noise_model import NoiseModel, ring_noise
from bezier_filters.patches.harmonics import harmonic_basis
from bezier_filters.patches.polynomials import total_degree_space
from bezier_filters.surface_model.model import (
    SIGNIFICANT_STANDARD_ERRORS,
    _enforce_decay,
    _term_variances,
    learn_surface_model,
)
from bezier_filters.surfaces import bumpy_star, ellipsoid, height_field, monkey_saddle, sphere, torus, waves

SURFACES = {
    "sphere": cache(lambda r: sphere(resolution=r, jitter=0.3)),
    "ellipsoid": cache(lambda r: ellipsoid(resolution=r, jitter=0.3)),
    "bumpy_star": cache(lambda r: bumpy_star(resolution=r, jitter=0.3)),
    "torus": cache(lambda r: torus(resolution=2 * r, jitter=0.3)),
    "waves": cache(lambda r: waves(resolution=3 * r, jitter=0.3)),
    "monkey_saddle": cache(lambda r: monkey_saddle(resolution=3 * r, jitter=0.3)),
}


@cache
def estimated(name, level):
    """A surface, and the estimate of its mesh with noise; which several tests look at from different sides."""
    surface = SURFACES[name](18)
    return surface, estimate_vertex_geometry(with_noise(surface, level), surface.faces)


def clean(name):
    return estimated(name, 0.0)


def mean_edge(surface):
    a, b, c = surface.vertices[surface.faces].transpose(1, 0, 2)
    return np.mean([np.linalg.norm(p - q, axis=1).mean() for p, q in ((a, b), (b, c), (c, a))])


def with_noise(surface, level, seed=1):
    """Vertices displaced along their normals by Gaussian noise, a fraction of the mean edge."""
    noise = np.random.default_rng(seed).standard_normal(len(surface.vertices))
    return surface.vertices + (level * mean_edge(surface) * noise)[:, None] * surface.normals


def inner(surface):
    """Vertices well away from a boundary, if there is one."""
    x, y, _ = surface.vertices.T
    open_patch = np.ptp(surface.vertices[:, :2]) < 2.1 and surface.normals[:, 2].min() > 0
    return (np.maximum(np.abs(x), np.abs(y)) < 0.75) if open_patch else np.ones(len(x), dtype=bool)


def relative_rms(error, truth):
    return np.sqrt(np.mean(error**2) / np.mean(truth**2))


@pytest.mark.parametrize("level", [0.01, pytest.param(0.05, marks=pytest.mark.slow), 0.2])
@pytest.mark.parametrize("name", SURFACES)
def test_noise_is_found_within_ten_percent(name, level):
    surface, geometry = estimated(name, level)
    assert geometry.noise_sigma == pytest.approx(level * mean_edge(surface), rel=0.1)


@pytest.mark.parametrize("options", [{}, {"radius": 0.3}, {"rings": 4}], ids=["automatic", "radius", "rings"])
def test_standard_errors_are_those_of_the_noise_that_is_given(options):
    """A clean surface shows none of it, and yet its standard errors are the errors that such noise causes."""
    surface = torus(resolution=30, jitter=0.3)
    sigma = 0.1 * mean_edge(surface)
    clean, noisy = (
        estimate_vertex_geometry(vertices, surface.faces, noise=sigma, **options)
        for vertices in (surface.vertices, with_noise(surface, 0.1))
    )
    cosines = np.clip(np.einsum("ij,ij->i", noisy.normals, surface.normals), -1.0, 1.0)
    error = np.sqrt(np.square(np.arccos(cosines)).mean())
    for geometry in (clean, noisy):
        assert geometry.noise_sigma == pytest.approx(sigma)
        assert geometry.fit.noise_length == 0.0
        assert 0.5 * error < np.sqrt(np.square(geometry.normal_std).mean()) < 1.6 * error


def test_noise_that_is_given_as_none_at_all_leaves_the_shape_alone():
    """Relief of one vertex each passes for noise, unless it is known that there is none."""
    sheet = waves(resolution=40, amplitude=0.0)
    edge = mean_edge(sheet)
    vertices = sheet.vertices.copy()
    vertices[:, 2] = 0.05 * edge * np.random.default_rng(0).standard_normal(len(vertices))
    learned, given = (estimate_vertex_geometry(vertices, sheet.faces, noise=noise) for noise in (None, 0.0))
    assert given.noise_sigma == 0.0
    distances = [np.sqrt(np.square(g.displacements).sum(axis=1).mean()) for g in (learned, given)]
    assert distances[1] < 0.5 * distances[0]


def test_neighbourhoods_are_no_wider_than_the_detail():
    """On a noisy sphere wide rings are best, but bumps may hide in the noise that are as small as is said."""
    ball = sphere(resolution=30, jitter=0.3)
    vertices, edge = with_noise(ball, 0.2), mean_edge(ball)
    free = estimate_vertex_geometry(vertices, ball.faces)
    assert free.fit.rings >= 8
    for size in (12.0, 6.0, 1.0):
        bounded = estimate_vertex_geometry(vertices, ball.faces, detail=size * edge)
        assert bounded.fit.rings <= max(size / 2.0, 1.0)
        assert bounded.fit.rings >= max(0.3 * size - 1.0, 1.0)
        assert np.median(bounded.rings_used) <= max(size / 2.0, 2.0)
        fixed = estimate_vertex_geometry(vertices, ball.faces, detail=size * edge, alpha=0.8)
        assert fixed.fit.rings == bounded.fit.rings


@pytest.mark.parametrize("name", SURFACES)
def test_clean_meshes_have_no_noise_and_an_accurate_curvature(name):
    surface, geometry = clean(name)
    assert geometry.noise_sigma < 1e-4 * mean_edge(surface)
    mask = inner(surface)
    error = relative_rms((geometry.mean_curvature - surface.mean_curvature)[mask], surface.mean_curvature[mask])
    fixed = estimate_vertex_geometry(surface.vertices, surface.faces, rings=2, alpha=0.8)
    before = relative_rms((fixed.mean_curvature - surface.mean_curvature)[mask], surface.mean_curvature[mask])
    assert error < 0.2 * before


def test_the_automatic_choice_beats_every_single_setting_over_clean_and_noisy_meshes():
    settings = [{}, *({"rings": rings, "alpha": alpha} for rings in (2, 3, 5, 7) for alpha in (0.1, 0.8))]
    logs = np.zeros(len(settings))
    cases = [(name, level) for name in ("ellipsoid", "bumpy_star", "waves") for level in (0.0, 0.01, 0.1)]
    for name, level in cases:
        surface = SURFACES[name](18)
        vertices, mask = with_noise(surface, level), inner(surface)
        for k, options in enumerate(settings):
            geometry = (
                estimate_vertex_geometry(vertices, surface.faces, **options) if options else estimated(name, level)[1]
            )
            normal = np.sqrt(np.mean(np.sum((geometry.normals - surface.normals)[mask] ** 2, axis=1)))
            mean = relative_rms((geometry.mean_curvature - surface.mean_curvature)[mask], surface.mean_curvature[mask])
            logs[k] += np.log(normal * mean) / (2 * len(cases))
    assert logs[0] < logs[1:].min() + np.log(0.5)


def test_wide_rings_are_taken_for_noise_and_narrow_ones_without():
    (_, geometry), noisy = clean("waves"), estimated("waves", 0.1)[1].fit
    assert geometry.fit.rings <= 4 < noisy.rings
    assert geometry.fit.alpha is None


def test_each_choice_can_be_fixed():
    surface = SURFACES["torus"](12)
    fit = estimate_vertex_geometry(surface.vertices, surface.faces, rings=4).fit
    assert (fit.rings, fit.alpha) == (4, None)
    fit = estimate_vertex_geometry(surface.vertices, surface.faces, degree=4).fit
    assert (fit.degree, fit.alpha) == (4, None)
    fit = estimate_vertex_geometry(surface.vertices, surface.faces, alpha=0.5).fit
    assert (fit.degree, fit.alpha) == (3, 0.5)
    assert fit.noise_sigma is not None
    fit = estimate_vertex_geometry(surface.vertices, surface.faces, smoothness="paper").fit
    assert (fit.rings, fit.degree, fit.alpha, fit.noise_sigma) == (2, 3, 0.8, None)


def test_the_choice_is_deterministic_and_does_not_depend_on_what_is_selected():
    surface = SURFACES["bumpy_star"](12)
    whole = estimate_vertex_geometry(surface.vertices, surface.faces, threads=1)
    selected = np.zeros(len(surface.vertices), dtype=bool)
    selected[::7] = True
    part = estimate_vertex_geometry(surface.vertices, surface.faces, selected=selected, threads=2)
    assert replace(part.fit, parts=()) == replace(whole.fit, parts=())
    assert [replace(p, vertices=0) for p in part.fit.parts] == [replace(p, vertices=0) for p in whole.fit.parts]
    np.testing.assert_array_equal(part.k_max[selected], whole.k_max[selected])


@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_scale_does_not_change_the_choice(scale):
    surface = SURFACES["ellipsoid"](14)
    vertices = with_noise(surface, 0.05)
    one = estimate_vertex_geometry(vertices, surface.faces)
    other = estimate_vertex_geometry(scale * vertices, surface.faces)
    assert (one.fit.rings, one.fit.degree) == (other.fit.rings, other.fit.degree)
    assert other.noise_sigma == pytest.approx(scale * one.noise_sigma)
    np.testing.assert_allclose(other.mean_curvature * scale, one.mean_curvature, rtol=1e-6, atol=1e-6)


def test_a_plane_is_flat_and_a_quadratic_is_exact():
    plane = height_field(lambda x, y: [0 * x + 0.3 * y, 0, 0.3, 0, 0, 0], resolution=20, jitter=0.2)
    geometry = estimate_vertex_geometry(plane.vertices, plane.faces)
    assert set(geometry.status_counts()) == {"OK", "WIDER_RING"}  # the latter at the rim
    assert np.abs(geometry.k_max).max() < 1e-9
    np.testing.assert_allclose(geometry.normals, plane.normals, atol=1e-12)


def test_meshes_too_small_to_learn_from_take_the_fixed_fit():
    surface = sphere(resolution=1)
    geometry = estimate_vertex_geometry(surface.vertices, surface.faces)
    assert (geometry.fit.rings, geometry.fit.alpha, geometry.noise_sigma) == (2, 0.8, None)
    assert np.isfinite(geometry.k_max).all()


MEASURED = {  # relative error of H and error of the normal in degrees, on clean meshes of resolution 18
    "sphere": (2.1e-7, 3.9e-7),
    "ellipsoid": (1.1e-5, 8.9e-5),
    "bumpy_star": (2.0e-3, 8.7e-3),
    "torus": (8.3e-4, 3.6e-3),
    "waves": (6.0e-5, 3.5e-4),
    "monkey_saddle": (6.5e-7, 2.1e-7),
}


@pytest.mark.parametrize("name", MEASURED)
def test_clean_irregular_meshes_are_as_accurate_as_they_were(name):
    """Up to a factor of three, and to what is near rounding."""
    surface, geometry = clean(name)
    mask = inner(surface)
    mean = relative_rms((geometry.mean_curvature - surface.mean_curvature)[mask], surface.mean_curvature[mask])
    turned = np.linalg.norm((geometry.normals - surface.normals)[mask], axis=1)
    assert mean < max(3.0 * MEASURED[name][0], 2e-6)
    assert np.degrees(np.sqrt(np.mean(turned**2))) < max(3.0 * MEASURED[name][1], 2e-6)


@pytest.mark.parametrize("level", [0.02, pytest.param(0.05, marks=pytest.mark.slow), 0.1])
def test_intervals_of_95_percent_cover_about_that_much(level):
    """Each surface by itself as well, and errors that are said to be large are no more than twice as large."""
    coverage = []
    for make in SURFACES.values():
        surface = make(24)
        geometry = estimate_vertex_geometry(with_noise(surface, level), surface.faces)
        mask = inner(surface)
        error = np.abs(geometry.mean_curvature - surface.mean_curvature)[mask]
        claimed = geometry.mean_curvature_std[mask]
        coverage.append(np.mean(error < 1.96 * claimed))
        assert 0.5 < np.sqrt(np.mean(claimed**2) / np.mean(error**2)) < 2.0
    assert 0.85 < np.mean(coverage) < 0.99
    assert min(coverage) > 0.8


def test_standard_errors_are_those_of_repeated_measurements():
    """On a plane without a prior, the spread over many draws of the noise is all there is."""
    plane = height_field(lambda x, y: [0 * x, 0, 0, 0, 0, 0], resolution=16, jitter=0.2)
    draws = [
        estimate_vertex_geometry(with_noise(plane, 0.05, seed), plane.faces, rings=4, degree=2) for seed in range(30)
    ]
    middle = np.flatnonzero(np.abs(plane.vertices[:, :2]).max(axis=1) < 0.3)
    spread = np.sqrt(np.mean([geometry.mean_curvature[middle] ** 2 for geometry in draws]))
    claimed = np.sqrt(np.mean([geometry.mean_curvature_std[middle] ** 2 for geometry in draws]))
    assert claimed == pytest.approx(spread, rel=0.15)


def test_standard_errors_scale_like_what_they_belong_to():
    surface = SURFACES["ellipsoid"](12)
    vertices = with_noise(surface, 0.05)
    one = estimate_vertex_geometry(vertices, surface.faces)
    ten = estimate_vertex_geometry(10.0 * vertices, surface.faces)
    np.testing.assert_allclose(ten.normal_std, one.normal_std, rtol=1e-6)
    np.testing.assert_allclose(10.0 * ten.mean_curvature_std, one.mean_curvature_std, rtol=1e-6)
    np.testing.assert_allclose(100.0 * ten.gaussian_curvature_std, one.gaussian_curvature_std, rtol=1e-6)


def test_there_are_no_standard_errors_without_a_learned_noise():
    surface = SURFACES["torus"](8)
    assert not estimate_vertex_geometry(surface.vertices, surface.faces, rings=2, alpha=0.8).mean_curvature_std.any()


def test_the_terms_of_the_model_are_the_harmonics():
    basis = harmonic_basis()
    phi = np.linspace(0, 2 * np.pi, 50, endpoint=False)
    xy = 0.7 * np.column_stack([np.cos(phi), np.sin(phi)])
    a, b = total_degree_space(8).exponents.T
    values = (xy[:, :1] ** a * xy[:, 1:] ** b) @ basis.monomials
    terms = [(j, f) for j in range(9) for f in range(j, -1, -2) for _ in range(2 if f else 1)]
    assert basis.degrees.tolist() == [j for j, _ in terms]
    for k, (j, frequency) in enumerate(terms):
        cosine, sine = 0.7**j * np.cos(frequency * phi), 0.7**j * np.sin(frequency * phi)
        assert min(np.abs(values[:, k] - cosine).max(), np.abs(values[:, k] - sine).max()) < 1e-12


def analysed(drawn, rings=3):
    points = drawn.points
    return analyse_ring(as_sample(points, rings), rings, len(points))


@pytest.mark.parametrize("seed", range(3))
def test_known_noise_and_variances_are_learned(seed):
    """Within four standard errors, where a low degree hides little of the later terms; elsewhere they may be larger."""
    basis = harmonic_basis()
    count, truth, sigma = 600, variances_by_degree(1.0, 0.1), 1e-3
    model = learn_surface_model([analysed(draw(count, 60, truth, sigma, seed=seed))])
    assert model.sigma == pytest.approx(sigma, rel=0.05)
    learned = model.by_rings[0].variances
    assert not learned[basis.degrees <= 2].any()
    shares = learned / np.where(truth > 0.0, truth, np.inf)
    sure = (basis.degrees >= 3) & (basis.degrees <= 5)
    error = np.sqrt(2.0 / (count * np.bincount(basis.groups)[basis.groups]))
    assert (shares > 1.0 - 4.0 * error)[sure].all()
    assert shares[sure].max() < 3.0
    assert shares[basis.degrees == 3] == pytest.approx(1.0, abs=0.3)


def test_the_terms_of_the_highest_degree_are_learned_without_bias():
    """Nothing that comes later can be taken for them. The surface is nearly flat, as slopes make more of noise."""
    basis = harmonic_basis()
    truth = 1e-6 * variances_by_degree(1.0, 0.3)
    shares = [
        learn_surface_model([analysed(draw(300, 60, truth, 1e-6, seed=seed))]).by_rings[0].variances
        / np.maximum(truth, 1e-300)
        for seed in range(4)
    ]
    assert np.mean(shares, axis=0)[basis.degrees == 8] == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / 1200))


@pytest.mark.parametrize("scale", [1.0, 1e-2, 1e-3])
def test_a_wider_ring_helps_a_narrow_one_where_noise_hides_the_terms(scale):
    """Mean error of the logarithms of the cubic terms' variances; terms beyond a narrow ring's degree decay."""
    basis = harmonic_basis()
    truth, sigma = scale * variances_by_degree(1.0, 0.2), 0.3
    cubic, beyond = basis.degrees == 3, basis.degrees > 5
    alone, helped = [], []
    for seed in range(6):
        narrow = analysed(draw(300, 25, truth, sigma, seed=seed))
        wide = analysed(draw(300, 80, truth * 4.0**basis.degrees, sigma, radius=2.0, seed=100 + seed), rings=6)
        by_itself, with_wide = (
            learn_surface_model([narrow]).by_rings[0],
            learn_surface_model([narrow, wide]).by_rings[0],
        )
        alone.append(np.abs(np.log(by_itself.variances[cubic] / truth[cubic])).mean())
        helped.append(np.abs(np.log(with_wide.variances[cubic] / truth[cubic])).mean())
        means = [by_itself.variances[basis.degrees == degree].mean() for degree in range(4, 9)]
        assert (np.array(means[2:]) <= np.array(means[:-2]) * (1.0 + 1e-12)).all()  # extrapolated
        assert with_wide.variances[beyond].all()
    assert np.mean(helped) < 1.05 * np.mean(alone)
    if scale < 1.0:
        assert np.mean(helped) < 0.9 * np.mean(alone)


@given(st.integers(0, 10**6))
def test_terms_are_no_larger_than_lower_ones_suggest_unless_that_is_sure(seed):
    """The largest one degree lower, or a quarter of the largest two degrees lower: of sizes, not of squares."""
    rng = np.random.default_rng(seed)
    basis = harmonic_basis()
    values, errors, variances = np.exp(rng.normal(0.0, 2.0, (3, len(basis.groups))))
    result, sure = _enforce_decay(variances, values, errors), values >= SIGNIFICANT_STANDARD_ERRORS * errors
    np.testing.assert_array_equal(result[sure], variances[sure])
    np.testing.assert_array_equal(result[basis.degrees <= 2], variances[basis.degrees <= 2])
    # as large as it may be
    curvature = np.sqrt((values + SIGNIFICANT_STANDARD_ERRORS * errors)[basis.degrees == 2].max())
    largest = [0.0, 0.0, curvature, *(np.sqrt(result[basis.degrees == k].max()) for k in range(3, 9))]
    for degree in range(3, 9):
        doubtful = (basis.degrees == degree) & ~sure
        most = max(largest[degree - 1], largest[degree - 2] / 4.0)
        np.testing.assert_allclose(result[doubtful], np.minimum(variances[doubtful], most**2), rtol=1e-12)


def test_variances_of_terms_scatter_by_their_standard_errors():
    """Of noise alone, over many samples: terms of the highest degree, which only one fit estimates."""
    scores, basis = [], harmonic_basis()
    for seed in range(150):
        points = draw(40, 25, np.zeros(len(basis.degrees)), 0.5, seed=seed).points
        analysis = analyse_ring(as_sample(points), 3, len(points))
        noise = np.full(analysis.sums.term_squares.shape[1:], 0.25)
        values, errors = _term_variances(analysis, replace(ring_noise(NoiseModel(0.25), analysis), coefficients=noise))
        # both terms of a frequency have the same value
        scores.append((values / errors)[basis.degrees == analysis.degree][::2])
    assert np.mean(scores) == pytest.approx(0.0, abs=0.15)
    assert np.std(scores) == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("sides", [8, 9, 11, 12])
def test_terms_beyond_every_fit_keep_high_degrees_from_neighbourhoods_that_turn_far(sides):
    """On a tube of few sides a sextic passes through all positions around, and says nothing of what is between."""
    angles = np.arange(sides) * 2.0 * np.pi / sides
    rows, edge = 25, 2.0 * np.pi / sides
    vertices = np.array([(np.cos(t), np.sin(t), k * edge) for k in range(rows) for t in angles])
    first = np.arange((rows - 1) * sides)
    second = first - first % sides + (first + 1) % sides
    faces = np.concatenate(
        [np.column_stack([first, second, second + sides]), np.column_stack([first, second + sides, first + sides])]
    )
    geometry = estimate_vertex_geometry(vertices, faces)
    inner = slice(8 * sides, -8 * sides)
    assert np.abs(geometry.mean_curvature[inner] - 0.5).mean() < 0.07  # a sextic has .24 to .91
    assert geometry.mean_curvature_std[inner].min() > 0.004
