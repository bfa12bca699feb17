"""Curves on surfaces whose curvature and torsion are known: helices, circles, tori's lines, random curves."""

import numpy as np
import pytest

from bezier_filters import InvalidParameterError, curve_geometry, find_creases, fit_surface, trace_lines
from bezier_filters.surfaces import cylinder, ellipsoid, torus


@pytest.fixture(scope="module")
def ring():
    body = torus(resolution=32, jitter=0.3)
    return fit_surface(body.vertices, body.faces)


@pytest.mark.parametrize("flipped", [False, True])
@pytest.mark.parametrize("slope", [0.5, -1.0])
def test_a_helix_has_its_curvature_and_torsion(slope, flipped):
    """Radius 1, pitch 2 pi c: both over 1 + c^2, and no geodesic curvature."""
    tube = cylinder(radius=1.0, length=4.0, resolution=36, jitter=0.2)
    surface = fit_surface(tube.vertices, tube.faces[:, ::-1] if flipped else tube.faces)
    turn = np.sort(np.random.default_rng(0).uniform(-1.5, 1.5, 80))
    found = curve_geometry(surface, np.column_stack([np.cos(turn), np.sin(turn), slope * turn]))
    side = -1.0 if flipped else 1.0
    inner = slice(5, -5)
    np.testing.assert_allclose(found.curvature[inner], 1.0 / (1.0 + slope**2), atol=0.01)
    np.testing.assert_allclose(found.torsion[inner], slope / (1.0 + slope**2), atol=0.02)
    np.testing.assert_allclose(found.geodesic_torsion[inner], slope / (1.0 + slope**2), atol=0.01)
    np.testing.assert_allclose(found.normal_curvature[inner], side / (1.0 + slope**2), atol=0.01)
    np.testing.assert_allclose(found.geodesic_curvature[inner], 0.0, atol=0.01)
    assert found.has_torsion.all()


def knot(angles):
    """A closed curve on the torus with its first three derivatives, by differences of high order."""

    def place(t):
        a, b = 2.0 * t + 0.2 * np.sin(t), 3.0 * t
        radius = 1.0 + 0.4 * np.cos(b)
        return np.column_stack([radius * np.cos(a), radius * np.sin(a), 0.4 * np.sin(b)])

    step = 1e-2
    stencil = np.arange(-4, 5)
    values = np.stack([place(angles + k * step) for k in stencil], axis=1)
    inverse = np.linalg.inv((stencil * step)[:, np.newaxis] ** np.arange(9.0))
    return place(angles), *(np.einsum("c,kcd->kd", inverse[p] * f, values) for p, f in ((1, 1.0), (2, 2.0), (3, 6.0)))


def test_a_knot_on_a_torus_has_the_frenet_torsion_of_its_derivatives(ring):
    angles = np.linspace(0.0, 2.0 * np.pi, 600)
    points, first, second, third = knot(angles)
    points[-1] = points[0]
    found = curve_geometry(ring, points)
    binormal = np.cross(first, second)
    square = np.square(binormal).sum(axis=1)
    curvature = np.sqrt(square) / np.linalg.norm(first, axis=1) ** 3
    torsion = np.einsum("ij,ij->i", binormal, third) / square
    np.testing.assert_allclose(found.curvature, curvature, rtol=0.01)
    np.testing.assert_allclose(found.torsion, torsion, atol=0.02 * np.abs(torsion).max())
    turned = np.hypot(found.normal_curvature, found.geodesic_curvature)
    np.testing.assert_allclose(found.curvature, turned)


def test_lines_of_curvature_have_no_geodesic_torsion_and_circles_no_torsion(ring):
    (line,) = trace_lines(ring, "max", seeds=[[1.4, 0.0, 0.0]]).lines
    found = curve_geometry(ring, line.points)
    np.testing.assert_allclose(found.normal_curvature, line.normal_curvature, atol=1e-3)
    np.testing.assert_allclose(found.curvature, 2.5, rtol=0.02)
    assert np.abs(found.torsion).max() < 0.1
    np.testing.assert_array_less(np.abs(found.geodesic_torsion), 0.02)


def test_a_crease_has_a_geometry():
    """The ridge of an ellipsoid in its plane of symmetry is an ellipse, of curvature 1 / b^2 at its ends a = 1."""
    shape = ellipsoid(semi_axes=(1.0, 0.8, 0.5), resolution=24, jitter=0.2)
    ridge = find_creases(shape.vertices, shape.faces).lines[0]
    found = curve_geometry(fit_surface(shape.vertices, shape.faces), ridge.points, neighbours=12)
    at_end = np.abs(found.points[:, 0]).argmax()
    assert found.curvature[at_end] == pytest.approx(1.0 / 0.8**2, rel=0.05)
    assert np.abs(found.geodesic_torsion).mean() < 0.05


@pytest.mark.parametrize("scale", [1e-30, 1e30])
def test_it_follows_the_scale(scale):
    body, angles = torus(resolution=16), np.linspace(0.0, 2.0, 20)
    points = 1.4 * np.column_stack([np.cos(angles), np.sin(angles), 0.0 * angles])
    plain = curve_geometry(fit_surface(body.vertices, body.faces), points)
    found = curve_geometry(fit_surface(scale * body.vertices, body.faces), scale * points)
    np.testing.assert_allclose(found.curvature * scale, plain.curvature, rtol=1e-4)
    np.testing.assert_allclose(found.arc_lengths, scale * plain.arc_lengths, rtol=1e-6)


@pytest.mark.parametrize(
    ("points", "options", "name"),
    [
        (np.zeros((3, 3)), {}, "points"),
        (np.zeros((20, 3)), {}, "points"),
        (np.zeros((20, 2)), {}, "points"),
        ("line", {}, "points"),
        (np.zeros((20, 3)), {"neighbours": 1}, "neighbours"),
        (np.zeros((20, 3)), {"neighbours": 4.0}, "neighbours: got 4.0, expected an integer"),
    ],
)
def test_wrong_arguments_are_refused(ring, points, options, name):
    with pytest.raises(InvalidParameterError, match=name):
        curve_geometry(ring, points, **options)
