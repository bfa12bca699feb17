"""Neighbourhoods of a fixed radius: one scale on every sampling."""

import numpy as np
import pytest
from compiled import from_python

from bezier_filters import estimate_vertex_geometry
from bezier_filters.meshes.neighbourhoods import collect_ball
from bezier_filters.surfaces import ellipsoid, sphere, waves


def graded_sphere():
    """A unit sphere whose edges are 3.2 times as long at one pole as at the other, and z.

    Stereographic projection, dilation and the way back keep the triangles in shape.
    """
    ball = sphere(resolution=24, jitter=0.3)
    dilation = 1.8
    x, y, z = ball.vertices.T
    plane = dilation / (1 + z) * np.array([x, y])
    scale = 2 / (1 + (plane**2).sum(axis=0))
    return np.column_stack([*(scale * plane), scale - 1]), ball.faces, scale - 1


def wavy_lattice(size=30):
    """Regular triangles with unit edges, slightly waved, and which vertices are well inside.

    A 2-ring reaches as far as 2 edges, and the third ring starts at 2.6.
    """
    i, j = np.indices((size, size)).reshape(2, -1)
    first = np.flatnonzero((i < size - 1) & (j < size - 1))
    right, up = first + size, first + 1
    faces = np.concatenate([np.column_stack([first, right, up]), np.column_stack([right, right + 1, up])])
    x, y = i + 0.5 * j, np.sqrt(0.75) * j
    vertices = np.column_stack([x, y, np.sin(0.3 * x) * np.cos(0.2 * y)])
    return vertices, faces, (np.minimum(i, j) > 4) & (np.maximum(i, j) < size - 5)


def test_the_deviation_depends_on_the_radius_and_not_on_the_density():
    """A quadratic in a disc of radius a fits 1/2 + a^2/8 to the profile rho^2/2 + rho^4/8 of a sphere."""
    vertices, faces, z = graded_sphere()
    radius = 0.45
    geometry = estimate_vertex_geometry(vertices, faces, radius=radius, degree=2, alpha=1.0)
    of_rings = estimate_vertex_geometry(vertices, faces, rings=4, degree=2, alpha=1.0)
    assert geometry.status_counts() == {"OK": len(vertices)}
    deviation, deviation_of_rings = geometry.mean_curvature - 1.0, of_rings.mean_curvature - 1.0
    dense, coarse = z < -0.9, z > 0.9
    for part in (dense, coarse):
        assert np.median(deviation[part]) == pytest.approx(radius**2 / 4, rel=0.1)
    assert np.median(deviation_of_rings[coarse]) > 7 * np.median(deviation_of_rings[dense])
    assert np.median(geometry.rings_used[dense]) > 2 * np.median(geometry.rings_used[coarse])


def test_the_automatic_fit_of_a_ball_is_accurate_at_every_density():
    vertices, faces, z = graded_sphere()
    geometry = estimate_vertex_geometry(vertices, faces, radius=0.45)
    assert (geometry.fit.radius, geometry.fit.alpha) == (0.45, None)
    assert geometry.status_counts() == {"OK": len(vertices)}
    for part in (z < -0.9, z > 0.9):
        assert np.sqrt(np.mean((geometry.mean_curvature - 1.0)[part] ** 2)) < 1e-3


@pytest.mark.parametrize("options", [{}, {"alpha": 0.8}, {"smoothness": "paper"}], ids=["automatic", "fixed", "paper"])
def test_balls_that_are_rings_give_what_rings_give(options):
    vertices, faces, inside = wavy_lattice()
    vertices = vertices + [0, 0, 0.1] * np.random.default_rng(0).standard_normal((len(vertices), 1))
    of_rings = estimate_vertex_geometry(vertices, faces, rings=2, **options)
    of_balls = estimate_vertex_geometry(vertices, faces, radius=2.3, **options)
    assert not of_rings.fit.parts
    for name in ("normals", "k_min", "k_max", "residual", "normal_std", "rings_used", "status"):
        np.testing.assert_array_equal(getattr(of_balls, name)[inside], getattr(of_rings, name)[inside], err_msg=name)
    assert (of_balls.rings_used[inside] == 2).all()
    assert (of_balls.fit.degree, of_balls.fit.noise_sigma) == (of_rings.fit.degree, of_rings.fit.noise_sigma)


def test_a_ball_holds_what_is_reached_inside_it():
    """A path around the corner of a U leads to vertices that are near, but not within the ball."""
    vertices = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [2, 1, 0], [1, 1, 0], [0, 1, 0]], dtype=float)
    indptr, indices = np.array([0, 1, 3, 5, 7, 9, 10]), np.array([1, 0, 2, 1, 3, 2, 4, 3, 5, 4])

    def ball(center, radius, stops=()):
        stop_here = np.isin(np.arange(6), stops)
        visited, members = np.zeros(6, dtype=bool), np.full(7, -1)
        count, *rest = from_python(collect_ball)(vertices, indptr, indices, stop_here, center, radius, visited, members)
        assert not visited.any()
        return members[:count].tolist(), *rest

    assert ball(0, 1.5) == ([0, 1], 1, 1, 1)
    assert ball(0, 2.5) == ([0, 1, 2, 3, 4, 5], 5, 1, 5)
    assert ball(0, 2.0) == ([0, 1, 2], 2, 1, 2)
    assert ball(2, 1.0) == ([2, 1, 3], 1, 2, 1)
    assert ball(0, 0.5) == ([0], 0, 0, 0)
    assert ball(0, 2.5, stops=[2]) == ([0, 1, 2], 2, 1, 2)
    assert ball(2, 2.5, stops=[2]) == ([2, 1, 3, 0, 4, 5], 5, 2, 3)


@pytest.mark.parametrize("options", [{}, {"alpha": 0.8}])
def test_balls_with_too_few_points_take_rings_and_say_so(options):
    surface = ellipsoid(resolution=10, jitter=0.3)
    geometry = estimate_vertex_geometry(surface.vertices, surface.faces, radius=1e-3, **options)
    assert geometry.status_counts() == {"WIDER_RING": len(surface.vertices)}
    assert (geometry.rings_used == 2).mean() > 0.9
    np.testing.assert_allclose(geometry.mean_curvature, surface.mean_curvature, rtol=0.15)


def test_balls_that_fold_take_narrower_rings():
    surface = sphere(resolution=12, jitter=0.2)
    geometry = estimate_vertex_geometry(surface.vertices, surface.faces, radius=1.7)
    assert geometry.status_counts() == {"NARROWER_RING": len(surface.vertices)}
    np.testing.assert_allclose(geometry.mean_curvature, 1.0, atol=0.01)


@pytest.mark.parametrize("options", [{}, {"alpha": 0.8}])
def test_the_radius_is_a_length(options):
    surface = waves(resolution=30, jitter=0.3)
    one = estimate_vertex_geometry(surface.vertices, surface.faces, radius=0.25, **options)
    ten = estimate_vertex_geometry(10 * surface.vertices, surface.faces, radius=2.5, **options)
    np.testing.assert_allclose(10 * ten.mean_curvature, one.mean_curvature, rtol=1e-6, atol=1e-6)
    np.testing.assert_array_equal(ten.status, one.status)


def test_noise_asks_for_a_larger_radius():
    surface = sphere(resolution=24, jitter=0.3)
    noise = 0.005 * np.random.default_rng(0).standard_normal(len(surface.vertices))
    vertices = surface.vertices * (1 + noise[:, None])
    errors = []
    for radius in (0.15, 0.3):
        geometry = estimate_vertex_geometry(vertices, surface.faces, radius=radius)
        assert geometry.noise_sigma == pytest.approx(0.005, rel=0.1)
        errors.append(np.sqrt(np.mean((geometry.mean_curvature - 1.0) ** 2)))
        assert np.sqrt(np.mean(geometry.mean_curvature_std**2)) == pytest.approx(errors[-1], rel=0.2)
    assert errors[0] > 5 * errors[1]


def test_point_clouds_have_balls_too():
    surface = sphere(resolution=12, jitter=0.3)
    geometry = estimate_vertex_geometry(surface.vertices, None, radius=0.4)
    assert geometry.status_counts() == {"OK": len(surface.vertices)}
    np.testing.assert_allclose(geometry.mean_curvature, 1.0, atol=1e-3)


def test_meshes_too_small_to_learn_from_take_the_fixed_fit():
    surface = sphere(resolution=1)
    geometry = estimate_vertex_geometry(surface.vertices, surface.faces, radius=1.2)
    assert (geometry.fit.radius, geometry.fit.alpha, geometry.noise_sigma) == (1.2, 0.8, None)
    assert np.isfinite(geometry.k_max).all()
