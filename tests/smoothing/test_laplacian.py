"""Laplacians of a mesh: their spectrum, what they leave, and their borders."""

import numpy as np
import pytest
from laplacian_cases import dense, small_ball, small_sheet

from bezier_filters.meshes.triangles import area_vectors
from bezier_filters.sampling.mesh_parts import whole_mesh
from bezier_filters.smoothing.laplacian import cotangent_laplacian, umbrella_laplacian


@pytest.fixture(scope="module")
def ball():
    return small_ball()


@pytest.fixture(scope="module")
def sheet():
    return small_sheet()


@pytest.mark.parametrize("power", [None, 0.0, 0.5, 1.0])
def test_eigenvalues_lie_within_the_bound(ball, power):
    mesh = ball
    unit = mesh.mean_edge
    one = umbrella_laplacian(whole_mesh(mesh), "curve")
    laplacian = one if power is None else cotangent_laplacian(whole_mesh(mesh), "curve", power, unit)
    eigenvalues = np.linalg.eigvals(dense(laplacian))
    assert np.abs(eigenvalues.imag).max() < 1e-5
    assert eigenvalues.real.min() > -1e-6
    assert eigenvalues.real.max() <= laplacian.bound + 1e-6


def test_cotangents_leave_linear_functions_on_a_plane(sheet):
    mesh = sheet
    unit = mesh.mean_edge
    laplacian = cotangent_laplacian(whole_mesh(mesh), "fixed", 1.0, unit)
    moved = np.linalg.norm(dense(laplacian) @ mesh.vertices, axis=1)[~mesh.adjacency.on_boundary]
    assert np.median(moved) < 1e-7  # all but the few at slivers, whose weights are kept within bounds


def test_cotangents_give_twice_the_curvature_of_a_sphere(ball):
    mesh = ball
    unit = mesh.mean_edge
    moved = dense(cotangent_laplacian(whole_mesh(mesh), "curve", 1.0, unit)) @ mesh.vertices
    # The rate 1 belongs to a Laplace-Beltrami operator times a squared edge over 4; that of the sphere is 2 x.
    assert np.linalg.norm(moved, axis=1).mean() == pytest.approx(2.0 * unit**2 / 4.0, rel=0.1)


@pytest.mark.parametrize("borders", ["curve", "fixed", "free"])
def test_border_vertices_follow_whom_they_should(sheet, borders):
    mesh = sheet
    laplacian = umbrella_laplacian(whole_mesh(mesh), borders)
    for i in np.flatnonzero(mesh.adjacency.on_boundary):
        row = slice(laplacian.indptr[i], laplacian.indptr[i + 1])
        followed = laplacian.indices[row][laplacian.weights[row] * laplacian.rates[i] > 0.0]
        if borders == "free":
            assert len(followed) == row.stop - row.start
        else:
            assert len(followed) == (2 if borders == "curve" else 0)
            assert mesh.adjacency.on_boundary[followed].all()


def laplacians(part, borders, unit):
    """An umbrella Laplacian, and cotangent ones with equal rates and with those of Laplace and Beltrami."""
    return [umbrella_laplacian(part, borders), *(cotangent_laplacian(part, borders, p, unit) for p in (0.0, 1.0))]


@pytest.mark.parametrize("borders", ["curve", "fixed", "free"])
def test_constants_vanish(sheet, borders):
    mesh = sheet
    unit = mesh.mean_edge
    for laplacian in laplacians(whole_mesh(mesh), borders, unit):
        assert np.abs(dense(laplacian).sum(axis=1)).max() < 1e-6


def test_the_laplace_beltrami_operator_is_symmetric_by_areas(ball):
    """And the umbrella operator by the numbers of neighbours."""
    mesh = ball
    unit = mesh.mean_edge
    part = whole_mesh(mesh)
    areas = 0.5 * np.linalg.norm(area_vectors(mesh.vertices, mesh.faces), axis=1)
    at_vertices = np.bincount(mesh.faces.ravel(), np.repeat(areas, 3)) / 3.0 / unit**2
    beltrami = cotangent_laplacian(part, "curve", 1.0, unit, max_rate=100.0)  # which none reaches
    for laplacian, weights in (
        (beltrami, at_vertices),
        (umbrella_laplacian(part, "curve"), mesh.adjacency.vertices.lengths),
    ):
        matrix = weights[:, np.newaxis] * dense(laplacian)
        assert np.abs(matrix - matrix.T).max() < 1e-5 * np.abs(matrix).max()
