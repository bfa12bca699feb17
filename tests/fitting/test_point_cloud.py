"""Estimates on points alone: their neighbours, their outside, and the accuracy next to the same points' mesh."""

import numpy as np
import pytest
from clouds import CLOSED, cloud_of, dots, noisy, points_on_sphere
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import Delaunay

from bezier_filters import (
    FitStatus,
    InvalidParameterError,
    estimate_vertex_geometry,
    triangle_mesh,
    vertex_adjacency,
)
from bezier_filters.surfaces import bumpy_star, ellipsoid, torus, waves


class TestNeighbours:
    @given(st.integers(0, 50))
    def test_points_of_a_plane_have_their_delaunay_neighbours(self, seed):
        lattice = np.array(np.meshgrid(np.arange(16.0), np.arange(16.0))).reshape(2, -1).T
        xy = lattice + np.random.default_rng(seed).uniform(-0.4, 0.4, lattice.shape)
        rows = cloud_of(np.column_stack([xy, np.zeros(len(xy))])).adjacency.vertices
        expected = vertex_adjacency(triangle_mesh(np.column_stack([xy, xy[:, 0]]), Delaunay(xy).simplices)).vertices
        for i in np.flatnonzero(np.abs(lattice - 7.5).max(axis=1) < 5):
            np.testing.assert_array_equal(rows.row(i), expected.row(i))

    @pytest.mark.parametrize("surface", CLOSED.values(), ids=CLOSED)
    def test_rows_are_symmetric_and_without_the_point_itself(self, surface):
        rows = cloud_of(surface.vertices).adjacency.vertices
        pairs = {(i, int(j)) for i in range(len(rows)) for j in rows.row(i)}
        assert all((j, i) in pairs and i != j for i, j in pairs)

    @pytest.mark.parametrize("jitter", [0.0, 0.3])
    def test_a_point_at_a_straight_border_has_the_nearest_ones_there_only(self, jitter):
        """Not those behind them, which touch the same straight line."""
        sheet = waves(resolution=30, jitter=jitter)
        cloud = cloud_of(sheet.vertices).adjacency
        expected = vertex_adjacency(triangle_mesh(sheet.vertices, sheet.faces))
        for i in np.flatnonzero(expected.on_boundary):
            edges = sheet.vertices[cloud.vertices.row(i)] - sheet.vertices[i]
            directions = edges / np.linalg.norm(edges, axis=1, keepdims=True)
            assert ((directions @ directions.T) > np.cos(np.radians(10.0))).sum() == len(edges), i
            assert 2 <= len(edges) <= len(expected.vertices.row(i)) + 3

    def test_closed_bodies_have_no_boundary(self):
        for surface in CLOSED.values():
            assert not cloud_of(surface.vertices).adjacency.on_boundary.any()

    def test_the_boundary_of_a_sheet_is_that_of_its_mesh(self):
        sheet = waves(resolution=40, jitter=0.3)
        expected = vertex_adjacency(triangle_mesh(sheet.vertices, sheet.faces)).on_boundary
        np.testing.assert_array_equal(cloud_of(sheet.vertices).adjacency.on_boundary, expected)


ACCURACY = {
    "torus": torus(resolution=20, jitter=0.3),
    "bumpy_star": bumpy_star(resolution=16, jitter=0.3),
    "ellipsoid": ellipsoid(resolution=16, jitter=0.3),
    "waves": waves(resolution=30, jitter=0.3),
}


@pytest.mark.parametrize("options", [{}, {"rings": 2, "alpha": 0.9}], ids=["auto", "fixed"])
@pytest.mark.parametrize("edges", [0.0, pytest.param(0.1, marks=pytest.mark.slow), 0.3])
@pytest.mark.parametrize("surface", ACCURACY.values(), ids=ACCURACY)
def test_points_alone_are_estimated_about_as_well_as_their_mesh(surface, edges, options):
    points = noisy(surface, edges)
    inner = np.abs(points[:, :2]).max(axis=1) < (0.7 if surface is ACCURACY["waves"] else np.inf)

    def errors(faces):
        geometry = estimate_vertex_geometry(points, faces, **options)
        assert sum(geometry.status_counts().values()) == len(points)
        normal = np.linalg.norm(geometry.normals - surface.normals, axis=1)[inner]
        mean = (geometry.mean_curvature - surface.mean_curvature)[inner]
        return np.sqrt([np.mean(normal**2), np.mean(mean**2)])

    assert (errors(None) < 2.2 * errors(surface.faces)).all()


@pytest.mark.parametrize("resolution", [30, 40, 60])
def test_no_point_at_a_border_is_flung_off(resolution):
    """Nor does its standard error say less than a sixth: parts are learned from neighbourhoods without a border."""
    surface = waves(resolution=resolution)
    geometry = estimate_vertex_geometry(surface.vertices, None)
    angles = np.arccos(np.clip(np.abs(dots(geometry.normals, surface.normals)), 0.0, 1.0))
    assert np.degrees(angles).max() < 0.5
    at_border = np.abs(surface.vertices[:, :2]).max(axis=1) == 1.0
    assert (angles < 6.0 * geometry.normal_std + 1e-6)[at_border].mean() > 0.99


@pytest.mark.parametrize("spacing", [1, 3, 6])
def test_scan_lines(spacing):
    """Points so many times denser along the lines than the lines are apart."""
    rng, latitudes = np.random.default_rng(0), np.linspace(-1.4, 1.4, 40)
    lines = []
    for latitude in latitudes:
        count = max(int(2 * np.pi * np.cos(latitude) / (latitudes[1] - latitudes[0]) * spacing), 6)
        turn = 2 * np.pi * (np.arange(count) / count + rng.random())
        lines.append(np.column_stack([np.cos(latitude) * np.cos(turn), np.cos(latitude) * np.sin(turn)]))
        lines[-1] = np.column_stack([lines[-1], np.full(count, np.sin(latitude))])
    points = np.vstack(lines)
    geometry = estimate_vertex_geometry(points, None)
    inner = np.abs(points[:, 2]) < 0.9
    np.testing.assert_allclose(geometry.normals[inner], points[inner], atol=1e-4)
    np.testing.assert_allclose(geometry.mean_curvature[inner], 1.0, atol=1e-3)


def test_lines_twenty_steps_apart():
    """The twenty nearest of a point lie on its own line."""
    rng = np.random.default_rng(4)
    x, y = np.meshgrid(np.linspace(-1.0, 1.0, 401), np.linspace(-1.0, 1.0, 21))
    x = x + 0.005 * rng.random((21, 1))
    points = np.stack([x, y, 0.1 * np.sin(2.0 * x) * np.cos(2.0 * y)], axis=-1).reshape(-1, 3)
    slopes = -0.2 * np.stack([np.cos(2 * x) * np.cos(2 * y), -np.sin(2 * x) * np.sin(2 * y), -5.0 + 0.0 * x], axis=-1)
    truth = slopes.reshape(-1, 3) / np.linalg.norm(slopes, axis=2).reshape(-1, 1)
    geometry = estimate_vertex_geometry(points, None)
    inner = np.abs(points[:, :2]).max(axis=1) < 0.7
    cosines = dots(geometry.normals, truth)
    assert (cosines > 0.0).mean() > 0.999
    assert np.degrees(np.arccos(np.clip(cosines[inner], -1.0, 1.0))).max() < 1.0


def test_sheets_one_spacing_apart_with_normals_are_as_exact_as_each_alone():
    sheet = waves(resolution=30, jitter=0.3)
    points = np.vstack([sheet.vertices, sheet.vertices - [0.0, 0.0, 2.0 / 30.0]])
    normals = np.vstack([sheet.normals, -sheet.normals])
    both = estimate_vertex_geometry(points, None, normals=normals, rings=3)
    alone = estimate_vertex_geometry(sheet.vertices, None, normals=sheet.normals, rings=3)
    apart = np.linalg.norm(both.normals[: len(sheet.vertices)] - alone.normals, axis=1)
    assert np.median(apart) < 1e-4
    assert (dots(both.normals, normals) > 0.99).all()


def test_a_curve_has_no_normals():
    t = np.linspace(0.0, 1.0, 2000)
    geometry = estimate_vertex_geometry(np.column_stack([t, 0.01 * t**2, 0.0 * t]), None)
    assert (geometry.status == FitStatus.ISOLATED).all()


def test_random_points():
    points = points_on_sphere(3000)
    geometry = estimate_vertex_geometry(points, None)
    np.testing.assert_allclose(geometry.normals, points, atol=1e-3)
    np.testing.assert_allclose(geometry.mean_curvature, 1.0, atol=1e-2)


def test_order_of_the_points_does_not_matter():
    points = points_on_sphere(1500)
    order = np.random.default_rng(1).permutation(len(points))
    options = {"rings": 2, "alpha": 0.9}
    before, after = (estimate_vertex_geometry(p, None, **options) for p in (points, points[order]))
    np.testing.assert_allclose(after.normals, before.normals[order], atol=1e-9)
    np.testing.assert_allclose(after.k_max, before.k_max[order], atol=1e-9)
    np.testing.assert_array_equal(after.status, before.status[order])


def test_thread_count_changes_nothing(monkeypatch):
    monkeypatch.setattr("bezier_filters.runtime.parallel.MIN_CHUNK", 100)
    points = noisy(CLOSED["torus"], 0.1)
    one, two = (estimate_vertex_geometry(points, np.empty((0, 3), int), threads=threads) for threads in (1, 2))
    np.testing.assert_array_equal(one.normals, two.normals)
    np.testing.assert_array_equal(one.k_max, two.k_max)


class TestDegenerateClouds:
    def test_points_at_the_same_place_count_as_one_neighbour(self):
        points = points_on_sphere(1000)
        twice = estimate_vertex_geometry(np.vstack([points, points, points[:300]]), None)
        np.testing.assert_allclose(twice.mean_curvature, 1.0, atol=2e-2)
        rows = cloud_of(np.vstack([points, points])).adjacency.vertices
        np.testing.assert_array_equal(rows.row(7), rows.row(1007))
        once = cloud_of(points).adjacency.vertices
        np.testing.assert_array_equal(rows.row(7), once.row(7))

    @pytest.mark.parametrize("n", [1, 2, 3, 5, 6, 8, 20, 21, 22])
    def test_fewer_points_than_are_asked_for(self, n):
        geometry = estimate_vertex_geometry(np.random.default_rng(n).normal(size=(n, 3)), None)
        assert sum(geometry.status_counts().values()) == n
        assert np.isfinite(geometry.k_max).all()
        if n < 3:
            assert geometry.status_counts() == {"ISOLATED": n}
        elif n < 6:
            assert geometry.status_counts() == {"NORMAL_ONLY": n}

    def test_no_points(self):
        assert estimate_vertex_geometry(np.empty((0, 3)), None).status_counts() == {}

    @pytest.mark.parametrize("points", [np.zeros((50, 3)), np.outer(np.arange(50.0), [1, 2, 3])], ids=["place", "line"])
    def test_points_at_one_place_or_on_a_line_have_no_plane(self, points):
        geometry = estimate_vertex_geometry(points, None)
        assert (geometry.status == FitStatus.ISOLATED).all()
        assert not geometry.normals.any()

    def test_a_far_point_spoils_nothing(self):
        points = np.vstack([points_on_sphere(1000), [[100.0, 0.0, 0.0]]])
        geometry = estimate_vertex_geometry(points, None)
        assert np.median(np.abs(geometry.mean_curvature[:-1] - 1.0)) < 1e-3
        assert (dots(geometry.normals, points)[:-1] > 0).mean() > 0.95


@pytest.mark.parametrize(
    ("faces", "normals", "message"),
    [
        ([[0, 1, 2]], np.ones((4, 3)), "normals: not allowed for a mesh with faces"),
        (None, np.ones((3, 3)), r"normals: got shape \(3, 3\), expected finite numbers of shape \(4, 3\)"),
        (None, np.full((4, 3), np.nan), "expected finite numbers"),
        (None, "up", "normals: expected real numbers"),
    ],
)
def test_bad_normals_are_refused(faces, normals, message):
    with pytest.raises(InvalidParameterError, match=message):
        estimate_vertex_geometry(np.random.default_rng(0).normal(size=(4, 3)), faces, normals=normals)
