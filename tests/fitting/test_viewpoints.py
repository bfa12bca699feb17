"""Normals of point clouds are oriented by the places from which the points were seen."""

import numpy as np
import pytest
from clouds import dots, points_on_sphere

from bezier_filters import estimate_vertex_geometry, smooth
from bezier_filters.errors import InvalidParameterError
from bezier_filters.meshes import orientation
from bezier_filters.surfaces import sphere, waves


def by_point(normals, points, viewpoint):
    """Normals that face a viewpoint each for itself, as PCL and Open3D turn them."""
    return normals * np.where(dots(normals, viewpoint - points) < 0.0, -1.0, 1.0)[:, np.newaxis]


def change_evidence(monkeypatch, factor):
    """Multiply what separates the signs of neighbours, in the kernel as Python, which reads the constant."""
    monkeypatch.setattr(orientation, "SEPARATING_EVIDENCE", factor * orientation.SEPARATING_EVIDENCE)
    monkeypatch.setattr(orientation, "_signs_of_views", orientation._signs_of_views.py_func)


def plate(gap, noise, n=1000):
    """Two sheets of random points so many spacings apart, seen from above and below, and the true normals."""
    rng, spacing = np.random.default_rng(0), 2.0 / np.sqrt(n)
    side = np.repeat([1.0, -1.0], n)
    points = np.column_stack([rng.uniform(-1.0, 1.0, (2 * n, 2)), 0.5 * gap * spacing * side])
    return points + noise * spacing * rng.normal(size=points.shape), 3.0 * np.outer(side, [0.2, 0.0, 1.0]), side


@pytest.mark.parametrize("place", [(0.0, 0.0, 0.0), (0.6, 0.0, 0.3)])
def test_a_sphere_seen_from_inside(place):
    ball = sphere(resolution=16, jitter=0.3)
    inward = estimate_vertex_geometry(ball.vertices, viewpoint=place)
    assert (dots(inward.normals, ball.normals) < 0.0).all()
    np.testing.assert_allclose(inward.mean_curvature, -1.0, atol=1e-4)
    away = estimate_vertex_geometry(ball.vertices, viewpoint=place, viewpoint_side="away")
    np.testing.assert_allclose(away.normals, -inward.normals, atol=1e-9)
    assert inward.flipped == away.flipped == 0


def test_a_sphere_seen_from_outside_and_its_visible_side():
    points = points_on_sphere(4000)
    place = np.array([0.0, -3.0, 0.0])
    cap = points[points @ place > 1.0]  # up to the tangent cone
    seen = estimate_vertex_geometry(cap, viewpoint=place)
    assert (dots(seen.normals, cap) > 0.0).all()
    assert (seen.k_min > 0.5).mean() > 0.99
    assert estimate_vertex_geometry(points).flipped is None


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_terrain_seen_from_above_and_below(sign):
    land = waves(resolution=30, jitter=0.3)
    found = estimate_vertex_geometry(land.vertices, viewpoint=(0.3, 0.2, 5.0 * sign))
    assert (sign * dots(found.normals, land.normals) > 0.99).all()
    assert found.flipped == 0


@pytest.mark.parametrize("factor", [0.5, 1.0, 2.0])
def test_points_at_grazing_angle_turn_with_the_others(factor, monkeypatch):
    change_evidence(monkeypatch, factor)
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-1.0, 1.0, (3000, 2)), 0.005 * rng.normal(size=3000)])
    place = np.array([-1.0, 0.0, 0.1])  # low over the border of a floor: at the far one the angle is 3 degrees
    found = estimate_vertex_geometry(points, viewpoint=place, rings=1)
    assert (found.normals[:, 2] > 0.0).all()
    turned = by_point(found.normals, points, place)[:, 2] < 0.0
    assert found.flipped == turned.sum() > 500


def test_two_scans_of_a_body():
    points = points_on_sphere(4000)
    points = points[np.abs(points[:, 0]) > 0.02]
    places = np.where(points[:, :1] > 0.0, 1.0, -1.0) * [50.0, 0.0, 0.0]
    found = estimate_vertex_geometry(points, viewpoint=places)
    assert (dots(found.normals, points) > 0.0).all()
    assert found.flipped == 0


def test_a_floor_seen_from_both_sides_of_a_room_is_one_sheet():
    """Directions to the scanners are opposite, normals are not."""
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-1.0, 1.0, (3000, 2)), np.zeros(3000)])
    places = np.where(rng.random((3000, 1)) < 0.5, [[-3.0, 0.0, 0.5]], [[3.0, 0.0, 0.5]])
    found, one = (estimate_vertex_geometry(points, viewpoint=place) for place in (places, (0.0, 0.0, 9.0)))
    np.testing.assert_array_equal(found.normals, one.normals)


def test_wrong_places_of_single_points_turn_nothing_and_are_counted():
    """More of them, side by side, would be another sheet, seen from the other side."""
    points = points_on_sphere(1500)
    is_wrong = np.isin(np.arange(len(points)), np.abs(points).argmax(axis=0))
    found = estimate_vertex_geometry(points, viewpoint=np.where(is_wrong[:, np.newaxis], 0.5, 2.0) * points)
    assert (dots(found.normals, points) > 0.0).all()
    assert found.flipped == is_wrong.sum() == 3


@pytest.mark.parametrize("factor", [0.5, 2.0])
@pytest.mark.parametrize(("gap", "noise"), [(0.3, 0.1), (1.0, 0.0), (1.0, 0.3), (2.0, 0.1), (4.0, 0.3)])
def test_both_sides_of_a_thin_plate(gap, noise, factor, monkeypatch):
    change_evidence(monkeypatch, factor)
    points, places, side = plate(gap, noise)
    found = estimate_vertex_geometry(points, viewpoint=places, rings=2, alpha=0.8)
    assert (side * found.normals[:, 2] > 0.0).mean() > 0.999
    assert np.median(side * found.normals[:, 2]) > np.cos(np.radians(15.0))


def test_smoothing_keeps_both_sides_of_a_plate_apart():
    points, places, side = plate(1.0, 0.1)
    alone = [smooth(points[side == s]).vertices for s in (1.0, -1.0)]
    both = smooth(points, normals=places).vertices
    spacing = 2.0 / np.sqrt(1000)
    truth = 0.5 * spacing * side
    error = np.sqrt(np.mean((both[:, 2] - truth) ** 2))
    assert error < 1.2 * np.sqrt(np.mean((np.concatenate(alone)[:, 2] - truth) ** 2)) < 0.1 * spacing
    assert error < 0.5 * np.sqrt(np.mean((smooth(points).vertices[:, 2] - truth) ** 2))


def test_size_and_order_do_not_matter():
    points = points_on_sphere(500)
    places = np.where(points[:, :1] > 0.0, 0.5, 2.0) * points
    order = np.random.default_rng(2).permutation(len(points))
    options = {"rings": 2, "alpha": 0.8}
    one = estimate_vertex_geometry(points, viewpoint=places, **options)
    large = estimate_vertex_geometry(2.0**60 * points, viewpoint=2.0**60 * places, **options)
    np.testing.assert_array_equal(large.normals, one.normals)
    other = estimate_vertex_geometry(points[order], viewpoint=places[order], **options)
    np.testing.assert_allclose(other.normals, one.normals[order], atol=1e-9)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"viewpoint": (0, 0)}, r"viewpoint: got shape \(2,\)"),
        ({"viewpoint": (0, 0, np.nan)}, "expected finite numbers"),
        ({"viewpoint": "up"}, "viewpoint: expected three numbers"),
        ({"viewpoint": (0, 0, 1), "viewpoint_side": "up"}, "viewpoint_side: got 'up', expected 'toward' or 'away'"),
        ({"viewpoint_side": "away"}, "viewpoint_side: got 'away' without a viewpoint"),
        ({"viewpoint": (0, 0, 1), "normals": np.ones((50, 3))}, "viewpoint: there are normals"),
        ({"viewpoint": (0, 0, 1), "faces": [[0, 1, 2]]}, "viewpoint: not allowed for a mesh with faces"),
    ],
)
def test_bad_viewpoints_are_refused(given, message):
    with pytest.raises(InvalidParameterError, match=message):
        estimate_vertex_geometry(points_on_sphere(50), **given)


@pytest.mark.parametrize("n", [0, 1, 2, 3, 8, 30])
def test_few_points(n):
    found = estimate_vertex_geometry(np.random.default_rng(n).normal(size=(n, 3)), viewpoint=(0, 0, 0))
    assert len(found.status) == n
    assert np.isfinite(found.normals).all()
