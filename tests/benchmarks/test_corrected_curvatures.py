"""The strongest peer of the benchmarks: its closed formulas, its ball, and what it converges to."""

import doctest

import numpy as np
import pytest
from numpy.polynomial.legendre import leggauss

import corrected_curvatures as module
from bezier_filters import InvalidMeshError, InvalidParameterError
from bezier_filters.surfaces import cylinder, ellipsoid, sphere, torus
from corrected_curvatures import AREA, GAUSSIAN, MEAN, TENSOR, corrected_curvatures, face_measures
from strongest_peer import mean_edge


def relative(found, truth):
    return np.sqrt(np.mean((found - truth) ** 2) / np.mean(truth**2))


def order(make, radius_of, quantity, *, exact, jitter=0.0):
    """Order of convergence of a quantity in the mean edge, with exact normals or means of those of the faces."""
    edges, errors = [], []
    for resolution in (16, 24, 36, 54):
        surface = make(resolution=resolution, jitter=jitter)
        edges.append(mean_edge(surface.vertices, surface.faces))
        normals = surface.normals if exact else None
        found = corrected_curvatures(surface.vertices, surface.faces, radius_of(edges[-1]), normals=normals)
        errors.append(relative(getattr(found, quantity), getattr(surface, quantity)))
    return np.polyfit(np.log(edges), np.log(errors), 1)[0]


def test_examples():
    failed, attempted = doctest.testmod(module)
    assert attempted > failed == 0


# --- measures -------------------------------------------------------------------------------------


def test_closed_formulas_are_the_integrals_of_the_forms():
    """Of u . x_s x x_t, u . (u_s x x_t + x_s x u_t), u . u_s x u_t and u . (<Y, u_t> X x x_s - <Y, u_s> X x x_t).

    Positions x and normals u are linear in (s, t) over the triangle s, t > 0, s + t < 1.
    """
    rng = np.random.default_rng(0)
    x, u = rng.standard_normal((2, 3, 3))
    (xs, xt), (us, ut) = ((corners[1:] - corners[0]) for corners in (x, u))
    nodes, weights = leggauss(4)
    expected = np.zeros(12)
    for node, weight in zip(0.5 + 0.5 * nodes, 0.5 * weights, strict=True):
        for inner, share in zip(0.5 + 0.5 * nodes, 0.5 * weights, strict=True):
            s, t, w = node, (1.0 - node) * inner, weight * share * (1.0 - node)
            normal = u[0] + s * us + t * ut
            forms = np.zeros(12)
            forms[AREA] = normal @ np.cross(xs, xt)
            forms[MEAN] = normal @ (np.cross(us, xt) + np.cross(xs, ut))
            forms[GAUSSIAN] = normal @ np.cross(us, ut)
            forms[TENSOR] = [
                normal @ (ut[j] * np.cross(axis, xs) - us[j] * np.cross(axis, xt))
                for axis in np.eye(3)
                for j in range(3)
            ]
            expected += w * forms
    (found,) = face_measures(x, np.array([[0, 1, 2]]), u)
    np.testing.assert_allclose(found, expected, atol=1e-14)


@pytest.mark.parametrize("radius", [0.05, 0.3, 1.0, 5.0])
def test_curvatures_of_a_sphere_with_its_normals_are_exact(radius):
    ball = sphere(radius=2.0, resolution=8, jitter=0.3)
    found = corrected_curvatures(ball.vertices, ball.faces, radius, normals=ball.normals)
    np.testing.assert_allclose(found.mean_curvature, 0.5, atol=1e-13)
    np.testing.assert_allclose(found.gaussian_curvature, 0.25, atol=1e-13)


@pytest.mark.parametrize("make", [torus, ellipsoid])
@pytest.mark.parametrize("quantity", ["mean_curvature", "gaussian_curvature", "k_min", "k_max"])
def test_curvatures_converge_by_the_second_order_with_exact_normals(make, quantity):
    """A ball's mean differs from the value at its middle by the square of its radius."""
    assert order(make, lambda edge: 2.0 * edge, quantity, exact=True) > 1.8


@pytest.mark.parametrize("make", [sphere, torus, ellipsoid])
@pytest.mark.parametrize("quantity", ["mean_curvature", "gaussian_curvature"])
def test_curvatures_converge_on_irregular_meshes_if_balls_shrink_slower_than_edges(make, quantity):
    """As the article proves: normals of the faces are off by the edge, their differences by that over the radius."""
    assert order(make, lambda edge: 0.6 * np.sqrt(edge), quantity, exact=False, jitter=0.3) > 0.7


def test_principal_curvatures_and_directions_of_a_tube():
    tube = cylinder(radius=2.0, length=6.0, resolution=60)
    found = corrected_curvatures(tube.vertices, tube.faces, 0.5)
    inner = np.abs(tube.vertices[:, 2]) < 2.0
    np.testing.assert_allclose(found.k_max[inner], 0.5, rtol=0.02)
    np.testing.assert_allclose(found.k_min[inner], 0.0, atol=0.005)
    np.testing.assert_allclose(np.abs(found.direction_min[inner, 2]), 1.0, atol=1e-3)


# --- the ball -------------------------------------------------------------------------------------


def test_sums_are_those_of_the_faces_in_the_ball():
    """Once more, vertex by vertex: on a sphere every face that a ball meets is connected with its middle."""
    ball = sphere(resolution=6, jitter=0.3)
    radius = 0.4
    found = corrected_curvatures(ball.vertices, ball.faces, radius, normals=ball.normals)
    measures = face_measures(ball.vertices, ball.faces, ball.normals * [1.0, 1.0, 0.5])
    skewed = corrected_curvatures(ball.vertices, ball.faces, radius, normals=ball.normals * [1.0, 1.0, 0.5])
    corners = ball.vertices[ball.faces]
    places = np.concatenate([corners, corners.mean(axis=1, keepdims=True)], axis=1)
    for vertex in range(0, len(ball.vertices), 11):
        distances = np.linalg.norm(places - ball.vertices[vertex], axis=2)
        low, high = distances.min(axis=1), distances.max(axis=1)
        shares = np.clip((radius - low) / (high - low), 0.0, 1.0)
        sums = shares @ measures
        assert 10 < (shares > 0.0).sum() < len(shares)
        assert skewed.mean_curvature[vertex] == pytest.approx(0.5 * sums[MEAN] / sums[AREA], abs=1e-12)
        assert skewed.gaussian_curvature[vertex] == pytest.approx(sums[GAUSSIAN] / sums[AREA], abs=1e-12)
    assert found.mean_curvature == pytest.approx(1.0)


def test_another_sheet_within_the_ball_does_not_count():
    inner, outer = sphere(radius=1.0, resolution=8), sphere(radius=1.05, resolution=8)
    vertices = np.vstack([inner.vertices, outer.vertices])
    faces = np.vstack([inner.faces[:, ::-1], outer.faces + len(inner.vertices)])
    found = corrected_curvatures(vertices, faces, 0.4).mean_curvature
    alone = corrected_curvatures(inner.vertices, inner.faces, 0.4).mean_curvature
    np.testing.assert_allclose(found[: len(alone)], -alone, atol=1e-12)


def test_curvatures_turn_with_the_mesh_and_shrink_with_its_size():
    ring = torus(resolution=20, jitter=0.3)
    turn = np.linalg.qr(np.random.default_rng(0).standard_normal((3, 3)))[0]
    turn *= np.linalg.det(turn)
    first = corrected_curvatures(ring.vertices, ring.faces, 0.3)
    second = corrected_curvatures(10.0 * ring.vertices @ turn.T + [5.0, 0.0, -3.0], ring.faces, 3.0)
    np.testing.assert_allclose(10.0 * second.mean_curvature, first.mean_curvature, atol=1e-9)
    np.testing.assert_allclose(100.0 * second.gaussian_curvature, first.gaussian_curvature, atol=1e-9)
    np.testing.assert_allclose(10.0 * second.k_max, first.k_max, atol=1e-9)


def test_vertices_without_a_face_get_zero():
    ball = sphere(resolution=4)
    vertices = np.vstack([ball.vertices, [[9.0, 9.0, 9.0]]])
    found = corrected_curvatures(vertices, ball.faces, 0.5)
    assert all(not values[-1].any() for values in (found.mean_curvature, found.gaussian_curvature, found.k_min))


def test_what_is_no_mesh_and_no_radius_is_refused():
    ball = sphere(resolution=2)
    for radius in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(InvalidParameterError, match="radius: got"):
            corrected_curvatures(ball.vertices, ball.faces, radius)
    with pytest.raises(InvalidMeshError):
        corrected_curvatures([[0.0, 0.0, np.nan]], np.zeros((0, 3), dtype=int), 1.0)
