"""Curvature, torsion and terrain along directions, from the curvatures at a vertex."""

import numpy as np
import pytest
from graph_fits import geometry_of_graph
from hypothesis import given
from hypothesis import strategies as st

from bezier_filters import FitStatus, InvalidParameterError, VertexGeometry, estimate_vertex_geometry
from bezier_filters.fitting.vertex_geometry import FitChoice, empty_geometry
from bezier_filters.surfaces import cylinder, height_field, sphere, torus

angles = st.floats(0, 2 * np.pi)


def vertex_geometry(k_min, k_max):
    """One vertex with the given curvatures, normal z and direction_max x."""
    return VertexGeometry(
        normals=np.array([[0.0, 0.0, 1.0]]),
        k_min=np.array([k_min]),
        k_max=np.array([k_max]),
        direction_min=np.array([[0.0, 1.0, 0.0]]),
        direction_max=np.array([[1.0, 0.0, 0.0]]),
        extremality_min=np.zeros(1),
        extremality_max=np.zeros(1),
        displacements=np.zeros((1, 3)),
        residual=np.zeros(1),
        normal_std=np.zeros(1),
        mean_curvature_std=np.zeros(1),
        gaussian_curvature_std=np.zeros(1),
        rings_used=np.array([2], dtype=np.int32),
        status=np.array([FitStatus.OK], dtype=np.int32),
        fit=FitChoice(2, 3, 0.8, None),
    )


def test_torsion_of_a_right_handed_helix_is_its_frenet_torsion():
    """Geodesics of a cylinder are helices (cos t, sin t, c t) of torsion c / (1 + c^2)."""
    tube = cylinder(radius=1.0, resolution=90)
    geometry = estimate_vertex_geometry(tube.vertices, tube.faces)
    inner = (np.abs(tube.vertices[:, 2]) < 1.0) & (geometry.status == FitStatus.OK)
    x, y, _ = tube.vertices.T
    for c in (0.5, 1.0, -2.0):
        directions = np.column_stack([-y, x, np.full_like(x, c)])
        np.testing.assert_allclose(geometry.torsion_along(directions)[inner], c / (1 + c * c), atol=5e-3)


@given(st.floats(-5, 5), st.floats(0, 5), angles, st.floats(0.1, 10))
def test_torsion_is_t_max_sin_two_theta_from_the_direction_of_k_max(k_min, spread, theta, length):
    geometry = vertex_geometry(k_min, k_min + spread)
    direction = length * np.array([np.cos(theta), np.sin(theta), 0.3])
    expected = geometry.geodesic_torsion[0] * np.sin(2 * theta)
    assert geometry.torsion_along(direction)[0] == pytest.approx(expected, abs=1e-9)


def test_torsion_directions_have_the_extreme_torsions():
    geometry = vertex_geometry(-1.0, 3.0)
    plus, minus = geometry.torsion_directions()
    assert geometry.torsion_along(plus)[0] == pytest.approx(2.0)
    assert geometry.torsion_along(minus)[0] == pytest.approx(-2.0)
    assert geometry.torsion_along(np.array([0.0, 0.0, 1.0]))[0] == 0.0  # no tangential part


# --- curvature along a direction ------------------------------------------------------------------


@given(st.floats(-5, 5), st.floats(0, 5), angles, st.floats(1e-200, 1e200))
def test_curvature_along_a_direction_is_that_of_euler(k_min, spread, theta, length):
    geometry = vertex_geometry(k_min, k_min + spread)
    direction = length * np.array([np.cos(theta), np.sin(theta), 0.3])
    expected = (k_min + spread) * np.cos(theta) ** 2 + k_min * np.sin(theta) ** 2
    assert geometry.curvature_along(direction)[0] == pytest.approx(expected, abs=1e-12)
    assert geometry.curvature_along(-direction)[0] == geometry.curvature_along(direction)[0]


@given(st.tuples(*[st.floats(-3, 3)] * 5), angles)
def test_curvature_along_a_direction_is_the_second_form_over_the_first(jet, theta):
    """II(t, t) / I(t, t) of a graph at a point, from its derivatives p, q, r, s, t, with the sign of a hill."""
    p, q, r, s, t = jet
    x, y = np.cos(theta), np.sin(theta)
    found = geometry_of_graph([[0, q, t, 0], [p, s, 0, 0], [r, 0, 0, 0], [0, 0, 0, 0]])
    geometry = vertex_geometry(found.k_min, found.k_max)
    for name in ("normals", "direction_min", "direction_max"):
        getattr(geometry, name)[0] = getattr(found, name.removesuffix("s"))
    second = (r * x * x + 2 * s * x * y + t * y * y) / np.sqrt(1 + p * p + q * q)
    expected = -second / (1 + (p * x + q * y) ** 2)
    assert geometry.curvature_along([x, y, p * x + q * y])[0] == pytest.approx(expected, abs=1e-9)


def test_curvature_along_helices_of_a_tube():
    """A helix at the angle a to the circles of a cylinder has the normal curvature cos^2 a / r."""
    tube = cylinder(radius=2.0, length=6.0, resolution=90)
    geometry = estimate_vertex_geometry(tube.vertices, tube.faces)
    inner = np.abs(tube.vertices[:, 2]) < 2.0
    x, y, _ = tube.vertices.T
    for slope in (0.0, 0.5, -2.0):
        directions = np.column_stack([-y, x, np.full_like(x, 2.0 * slope)])
        np.testing.assert_allclose(geometry.curvature_along(directions)[inner], 0.5 / (1 + slope**2), atol=1e-5)
    np.testing.assert_allclose(geometry.curvature_along([0.0, 0.0, 1.0])[inner], 0.0, atol=1e-5)


def test_curvature_of_a_sphere_is_the_same_in_all_directions():
    ball = sphere(radius=2.0, resolution=24)
    geometry = estimate_vertex_geometry(ball.vertices, ball.faces)
    for direction in np.random.default_rng(0).standard_normal((5, 3)):
        np.testing.assert_allclose(geometry.curvature_along(direction), 0.5, atol=1e-6)


def test_curvature_turns_with_the_mesh_shrinks_with_its_size_and_changes_its_sign_with_its_faces():
    ring = torus(resolution=40)
    direction = np.array([1.0, -2.0, 0.5])
    options = {"rings": 2, "alpha": 1.0, "degree": 3}
    geometry = estimate_vertex_geometry(ring.vertices, ring.faces, **options)
    expected, terrain = geometry.curvature_along(direction), geometry.terrain_curvature(direction)
    turn = np.linalg.qr(np.random.default_rng(1).standard_normal((3, 3)))[0]
    turn *= np.linalg.det(turn)
    moved = 1e3 * ring.vertices @ turn.T + [3.0, -2.0, 5.0]
    found = estimate_vertex_geometry(moved, ring.faces, **options)
    np.testing.assert_allclose(1e3 * found.curvature_along(turn @ direction), expected, atol=1e-8)
    np.testing.assert_allclose(1e3 * found.terrain_curvature(turn @ direction).profile, terrain.profile, atol=1e-8)
    np.testing.assert_allclose(found.terrain_curvature(turn @ direction).slope, terrain.slope, atol=1e-9)
    flipped = estimate_vertex_geometry(ring.vertices, ring.faces[:, ::-1], **options)
    np.testing.assert_allclose(flipped.curvature_along(direction), -expected, atol=1e-9)


def hills(x, y):
    """A hill, waves and a slope: the height and its first and second derivatives."""
    hill, phase = 0.3 * np.exp(-x * x - 0.5 * y * y), 2.0 * x + y
    return (
        hill + 0.2 * np.sin(phase) + 0.15 * x,
        -2.0 * x * hill + 0.4 * np.cos(phase) + 0.15,
        -y * hill + 0.2 * np.cos(phase),
        (4.0 * x * x - 2.0) * hill - 0.8 * np.sin(phase),
        2.0 * x * y * hill - 0.4 * np.sin(phase),
        (y * y - 1.0) * hill - 0.2 * np.sin(phase),
    )


def saddle(x, y):
    return 0.5 * (x * x - y * y), x, -y, np.ones_like(x), np.zeros_like(x), -np.ones_like(x)


@pytest.mark.parametrize("heights", [hills, saddle])
def test_terrain_has_the_curvatures_of_geomorphometry(heights):
    """The closed formulas of Florinsky (2017) for z(x, y)."""
    land = height_field(heights, resolution=40, jitter=0.2)
    geometry = estimate_vertex_geometry(land.vertices, land.faces)
    terrain = geometry.terrain_curvature()
    _, p, q, r, s, t = heights(*land.vertices[:, :2].T)
    g = p * p + q * q
    inner = (np.abs(land.vertices[:, :2]).max(axis=1) < 0.9) & (g > 1e-4)
    across = -(q * q * r - 2 * p * q * s + p * p * t)
    expected = {
        "slope": np.arctan(np.sqrt(g)),
        "profile": -(p * p * r + 2 * p * q * s + q * q * t) / (g * (1 + g) ** 1.5),
        "tangential": across / (g * np.sqrt(1 + g)),
        "plan": across / g**1.5,
    }
    assert inner.sum() > 1000
    for name, values in expected.items():
        np.testing.assert_allclose(getattr(terrain, name)[inner], values[inner], rtol=1e-4, atol=1e-4, err_msg=name)
    np.testing.assert_allclose(terrain.profile, geometry.curvature_along([0.0, 0.0, -9.81]), atol=1e-12)
    np.testing.assert_allclose(terrain.profile + terrain.tangential, 2.0 * geometry.mean_curvature, atol=1e-12)


def test_contour_lines_of_a_torus_are_circles():
    """About a vertical axis slope lines are its meridians; seen from the hole, contour lines are hollow."""
    ring = torus(resolution=60)
    minor = 1.0 / ring.k_max[0]
    terrain = estimate_vertex_geometry(ring.vertices, ring.faces).terrain_curvature()
    axis = np.hypot(*ring.vertices[:, :2].T)
    outward = np.einsum("ij,ij->i", ring.normals[:, :2], ring.vertices[:, :2]) / axis
    steep = np.abs(outward) > 0.1
    np.testing.assert_allclose(terrain.profile[steep], 1.0 / minor, rtol=1e-3)
    np.testing.assert_allclose(terrain.tangential[steep], (outward / axis)[steep], atol=1e-3)
    np.testing.assert_allclose(terrain.plan[steep], (np.sign(outward) / axis)[steep], rtol=1e-2)
    np.testing.assert_allclose(terrain.slope, np.arccos(np.clip(ring.normals[:, 2], -1, 1)), atol=1e-3)


def test_gravity_may_point_to_a_centre():
    """A planet without relief is level everywhere."""
    ball = sphere(resolution=12)
    exact = {"normals": ball.normals, "direction_max": ball.direction_max, "direction_min": ball.direction_min}
    terrain = VertexGeometry(**vars(empty_geometry(len(ball.normals))) | exact).terrain_curvature(-ball.vertices)
    assert not terrain.is_defined.any()
    np.testing.assert_allclose(terrain.slope, 0.0, atol=1e-12)


def test_a_direction_that_does_not_exist_gives_zero():
    """Along the normal, where nothing was estimated, and on level land, also where rounding tilts it."""
    geometry = vertex_geometry(-1.0, 3.0)
    for direction in ([0.0, 0.0, 1.0], [0.0, 0.0, 0.0], [1e-14, 0.0, -1.0]):
        assert geometry.curvature_along(direction)[0] == geometry.torsion_along(direction)[0] == 0.0
        terrain = geometry.terrain_curvature(direction)
        assert terrain.profile[0] == terrain.tangential[0] == terrain.plan[0] == 0.0
        assert not terrain.is_defined[0]
    nothing = empty_geometry(2)
    terrain = nothing.terrain_curvature()
    assert not any(values.any() for values in vars(terrain).values())
    assert not nothing.curvature_along([1.0, 0.0, 0.0]).any()
    turn = np.linalg.qr(np.random.default_rng(0).standard_normal((3, 3)))[0]
    turn *= np.linalg.det(turn)
    level = height_field(lambda x, y: (0.0 * x, 0, 0, 0, 0, 0))
    geometry = estimate_vertex_geometry(level.vertices @ turn.T, level.faces)
    terrain = geometry.terrain_curvature(-turn[:, 2])
    assert not terrain.is_defined.any()
    assert terrain.slope.max() < 1e-12


@pytest.mark.parametrize(
    ("directions", "message"),
    [
        ([0.0, np.nan, 1.0], r"directions: got nan, expected finite numbers of the shape \(3,\) or \(1, 3\)"),
        ([1.0, 0.0], r"directions: got the shape \(2,\)"),
        (np.ones((2, 3)), r"directions: got the shape \(2, 3\)"),
        ("down", r"directions: expected finite numbers"),
        ([1j, 0, 0], r"directions: expected finite numbers"),
    ],
)
@pytest.mark.parametrize("method", ["curvature_along", "torsion_along", "terrain_curvature"])
def test_directions_that_are_none_are_refused(method, directions, message):
    with pytest.raises(InvalidParameterError, match=message):
        getattr(vertex_geometry(0.0, 1.0), method)(directions)


@pytest.mark.parametrize(
    ("k_min", "k_max", "index"),
    [(1, 1, 1), (0, 2, 0.5), (-1, 1, 0), (-2, 0, -0.5), (-3, -3, -1), (0, 0, 0)],
    ids=["cap", "ridge", "saddle", "rut", "cup", "plane"],
)
def test_shape_index(k_min, k_max, index):
    assert vertex_geometry(float(k_min), float(k_max)).shape_index[0] == pytest.approx(index)


def test_curvedness_is_the_root_mean_square_of_the_principal_curvatures():
    assert vertex_geometry(3.0, 4.0).curvedness[0] == pytest.approx(np.sqrt(12.5))
