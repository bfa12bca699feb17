import numpy as np
import pytest
from fundamental_forms import (
    fundamental_forms,
    gaussian_curvature,
    mean_curvature,
    principal_curvatures,
    unit_normals,
)
from graph_fits import geometry_of_graph
from hypothesis import given
from hypothesis import strategies as st

from bezier_filters import FitStatus, VertexGeometry, estimate_vertex_geometry
from bezier_filters.estimation.vertex_geometry import FitChoice
from bezier_filters.surfaces import cylinder

angles = st.floats(0, 2 * np.pi)


def torus_derivatives(theta, phi, major=2.0, minor=0.5):
    """First and second derivatives of a torus by (theta, phi), du x dv pointing outward."""
    c, s, C, S = np.cos(phi), np.sin(phi), np.cos(theta), np.sin(theta)
    r = major + minor * c
    du = np.array([[-r * S, r * C, 0]])
    dv = np.array([[-minor * s * C, -minor * s * S, minor * c]])
    duu = np.array([[-r * C, -r * S, 0]])
    duv = np.array([[minor * s * S, -minor * s * C, 0]])
    dvv = np.array([[-minor * c * C, -minor * c * S, -minor * s]])
    return du, dv, duu, duv, dvv


@given(angles, angles)
def test_torus(theta, phi):
    du, dv, duu, duv, dvv = torus_derivatives(theta, phi)
    forms = fundamental_forms(du, dv, duu, duv, dvv)
    parallel = np.cos(phi) / (2.0 + 0.5 * np.cos(phi))
    assert mean_curvature(forms)[0] == pytest.approx((parallel + 2.0) / 2, abs=1e-12)
    assert gaussian_curvature(forms)[0] == pytest.approx(2.0 * parallel, abs=1e-12)
    principal = principal_curvatures(du, dv, forms)
    assert (principal.k_min[0], principal.k_max[0]) == pytest.approx((parallel, 2.0))
    meridian = dv[0] / np.linalg.norm(dv)
    assert abs(principal.direction_max[0] @ meridian) == pytest.approx(1.0)
    swapped = np.cross(unit_normals(du, dv), principal.direction_max)
    np.testing.assert_allclose(principal.direction_min, swapped, atol=1e-12)


@given(st.tuples(*[st.floats(-3, 3)] * 5))
def test_graph_formulas_of_the_kernel_agree_with_the_fundamental_forms(jet):
    p, q, r, s, t = jet
    result = geometry_of_graph([[0, q, t, 0], [p, s, 0, 0], [r, 0, 0, 0], [0, 0, 0, 0]])
    du, dv, duu, duv, dvv = np.array([[1, 0, p], [0, 1, q], [0, 0, r], [0, 0, s], [0, 0, t]])[:, None]
    forms = fundamental_forms(du, dv, duu, duv, dvv)
    principal = principal_curvatures(du, dv, forms)
    np.testing.assert_allclose(result.normal, unit_normals(du, dv)[0], atol=1e-12)
    assert result.k_min == pytest.approx(principal.k_min[0], abs=1e-9)
    assert result.k_max == pytest.approx(principal.k_max[0], abs=1e-9)
    assert result.k_min + result.k_max == pytest.approx(2 * mean_curvature(forms)[0], abs=1e-9)
    assert result.k_min * result.k_max == pytest.approx(gaussian_curvature(forms)[0], abs=1e-9)
    if result.k_max - result.k_min > 1e-3:
        assert abs(result.direction_max @ principal.direction_max[0]) == pytest.approx(1.0, abs=1e-6)


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


@pytest.mark.parametrize(
    ("k_min", "k_max", "index"),
    [(1, 1, 1), (0, 2, 0.5), (-1, 1, 0), (-2, 0, -0.5), (-3, -3, -1), (0, 0, 0)],
    ids=["cap", "ridge", "saddle", "rut", "cup", "plane"],
)
def test_shape_index(k_min, k_max, index):
    assert vertex_geometry(float(k_min), float(k_max)).shape_index[0] == pytest.approx(index)


def test_curvedness_is_the_root_mean_square_of_the_principal_curvatures():
    assert vertex_geometry(3.0, 4.0).curvedness[0] == pytest.approx(np.sqrt(12.5))
