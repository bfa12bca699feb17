"""What is learned from the data, against data whose noise and shape are known."""

import numpy as np
import pytest

from bezier_filters import estimate_vertex_geometry
from bezier_filters.harmonics import harmonic_basis
from bezier_filters.polynomials import total_degree_space
from bezier_filters.surfaces import bumpy_star, ellipsoid, height_field, monkey_saddle, sphere, torus, waves

SURFACES = {
    "sphere": lambda r: sphere(resolution=r, jitter=0.3),
    "ellipsoid": lambda r: ellipsoid(resolution=r, jitter=0.3),
    "bumpy_star": lambda r: bumpy_star(resolution=r, jitter=0.3),
    "torus": lambda r: torus(resolution=2 * r, jitter=0.3),
    "waves": lambda r: waves(resolution=3 * r, jitter=0.3),
    "monkey_saddle": lambda r: monkey_saddle(resolution=3 * r, jitter=0.3),
}


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


@pytest.mark.parametrize("level", [0.01, 0.05, 0.2])
@pytest.mark.parametrize("name", SURFACES)
def test_noise_is_found_within_ten_percent(name, level):
    surface = SURFACES[name](18)
    sigma = estimate_vertex_geometry(with_noise(surface, level), surface.faces).noise_sigma
    assert sigma == pytest.approx(level * mean_edge(surface), rel=0.1)


@pytest.mark.parametrize("name", SURFACES)
def test_clean_meshes_have_no_noise_and_an_accurate_curvature(name):
    surface = SURFACES[name](18)
    geometry = estimate_vertex_geometry(surface.vertices, surface.faces)
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
            geometry = estimate_vertex_geometry(vertices, surface.faces, **options)
            normal = np.sqrt(np.mean(np.sum((geometry.normals - surface.normals)[mask] ** 2, axis=1)))
            mean = relative_rms((geometry.mean_curvature - surface.mean_curvature)[mask], surface.mean_curvature[mask])
            logs[k] += np.log(normal * mean) / (2 * len(cases))
    assert logs[0] < logs[1:].min() + np.log(0.5)


def test_wide_rings_are_taken_for_noise_and_narrow_ones_without():
    surface = SURFACES["waves"](18)
    clean = estimate_vertex_geometry(surface.vertices, surface.faces).fit
    noisy = estimate_vertex_geometry(with_noise(surface, 0.1), surface.faces).fit
    assert clean.rings <= 4 < noisy.rings
    assert clean.alpha is None


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
    assert part.fit == whole.fit
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


def test_a_sharp_edge_keeps_its_curvature_to_itself():
    """Where wide rings would reach around the corner, the faces of a block stay flat."""
    from bezier_filters.surfaces import block_with_sharp_edges

    vertices, faces = block_with_sharp_edges(resolution=20)
    geometry = estimate_vertex_geometry(vertices, faces)
    distance = np.sort(0.5 - np.abs(vertices), axis=1)[:, 1]  # to the nearest outer edge
    notch = (vertices > -0.25).all(axis=1)
    flat = (distance > 0.21) & ~notch
    assert flat.sum() > 100
    assert np.abs(geometry.mean_curvature[flat]).max() < 0.05


@pytest.mark.parametrize("name", ["sphere", "torus", "waves"])
@pytest.mark.parametrize("level", [0.02, 0.1])
def test_standard_errors_have_the_size_of_the_errors(name, level):
    """Within a factor of two; they are too small where a few places vary more than the rest."""
    surface = SURFACES[name](24)
    geometry = estimate_vertex_geometry(with_noise(surface, level), surface.faces)
    mask = inner(surface)
    error = (geometry.mean_curvature - surface.mean_curvature)[mask]
    assert 0.5 < np.sqrt(np.mean(error**2) / np.mean(geometry.mean_curvature_std[mask] ** 2)) < 2.0


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
    for k, (j, frequency) in enumerate(zip(basis.degrees, basis.frequencies, strict=True)):
        cosine, sine = 0.7**j * np.cos(frequency * phi), 0.7**j * np.sin(frequency * phi)
        assert min(np.abs(values[:, k] - cosine).max(), np.abs(values[:, k] - sine).max()) < 1e-12
