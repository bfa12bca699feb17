"""Renumbering keeps the mesh and brings neighbours together."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bezier_filters.estimation.estimate import estimate_vertex_geometry
from bezier_filters.meshes import spatial_order
from bezier_filters.meshes.mesh import triangle_mesh
from bezier_filters.meshes.prepared_mesh import prepare_mesh
from bezier_filters.meshes.spatial_order import ensure_locality, sort_spatially
from bezier_filters.runtime.parallel import use_threads
from bezier_filters.smoothing.smooth import smooth
from bezier_filters.surfaces import torus


def shuffled(vertices, faces, seed=0):
    """The same mesh with vertices and faces in random order, and the new number of every old vertex."""
    generator = np.random.default_rng(seed)
    order = generator.permutation(len(vertices))
    rank = np.argsort(order)
    return vertices[order], rank[faces][generator.permutation(len(faces))], rank


def as_set(vertices, faces):
    """Triangles by the coordinates of their corners."""
    return sorted(vertices[faces].reshape(len(faces), 9).tolist())


@given(st.integers(0, 60), st.floats(1e-30, 1e30), st.floats(-1e3, 1e3), st.integers(1, 3), st.integers(0, 2**32 - 1))
def test_it_is_the_same_mesh(n, scale, offset, threads, seed):
    generator = np.random.default_rng(seed)
    vertices = scale * (generator.standard_normal((n, 3)) + offset)
    faces = generator.integers(0, n, (2 * n, 3)) if n else []
    mesh = triangle_mesh(vertices, faces)
    with use_threads(threads):
        ordered = sort_spatially(mesh)
    assert sorted(ordered.order.tolist()) == list(range(n))
    assert (ordered.mesh.vertices == mesh.vertices[ordered.order]).all()
    assert as_set(ordered.mesh.vertices, ordered.mesh.faces) == as_set(mesh.vertices, mesh.faces)


@pytest.mark.parametrize("size", [1e39, 0.0])
def test_extents_of_any_size_and_of_nothing_are_no_obstacle(size):
    mesh = triangle_mesh(size * np.array([[-1.0, 0, 0], [1.0, 0, 0], [0, 1.0, 0]]), [[0, 1, 2]])
    assert sorted(sort_spatially(mesh).order.tolist()) == [0, 1, 2]


def test_neighbours_come_to_lie_close_together():
    surface = torus(resolution=60)
    vertices, faces, _ = shuffled(surface.vertices, surface.faces)
    mesh = sort_spatially(triangle_mesh(vertices, faces)).mesh
    distances = np.abs(mesh.faces[:, 0] - mesh.faces[:, 1])
    assert np.median(distances) < 0.02 * len(vertices)
    following = np.abs(np.diff(mesh.faces[:, 0]))
    assert np.median(following) < 0.02 * len(vertices)


@pytest.mark.parametrize("options", [{"rings": 2, "alpha": 0.8}, {"radius": 0.3, "alpha": 0.9}])
def test_results_come_in_the_order_of_the_input(options):
    surface = torus(resolution=24, jitter=0.3)
    vertices, faces, rank = shuffled(surface.vertices, surface.faces)
    plain = estimate_vertex_geometry(surface.vertices, surface.faces, **options)
    other = estimate_vertex_geometry(vertices, faces, **options)
    for name in ("mean_curvature", "gaussian_curvature", "residual", "status", "rings_used", "normals"):
        np.testing.assert_allclose(getattr(other, name)[rank], getattr(plain, name), rtol=1e-7, atol=1e-10)


def test_turning_a_mesh_changes_nothing_that_is_learned_from_it():
    surface = torus(resolution=30, jitter=0.3)
    heights = 0.01 * np.random.default_rng(0).standard_normal(len(surface.vertices))
    vertices = surface.vertices + heights[:, None] * surface.normals
    turn, _ = np.linalg.qr(np.random.default_rng(1).standard_normal((3, 3)))
    turn *= np.linalg.det(turn)
    plain, turned = (estimate_vertex_geometry(points, surface.faces) for points in (vertices, vertices @ turn.T))
    assert turned.fit.noise_sigma == pytest.approx(plain.fit.noise_sigma, rel=1e-9)
    np.testing.assert_allclose(turned.mean_curvature, plain.mean_curvature, rtol=1e-6, atol=1e-7)
    np.testing.assert_allclose(turned.normals, plain.normals @ turn.T, atol=1e-8)


def test_vertices_are_put_level_by_level_only_where_neighbours_are_far_apart(monkeypatch):
    monkeypatch.setattr(spatial_order, "MIN_REORDER_VERTICES", 200)
    surface = torus(resolution=30)
    vertices, faces, _ = shuffled(surface.vertices, surface.faces)
    for kept in (triangle_mesh(surface.vertices, surface.faces), triangle_mesh(vertices, [])):
        prepared = prepare_mesh(kept)
        assert ensure_locality(prepared).mesh is prepared
    mesh = prepare_mesh(triangle_mesh(vertices, faces))
    ordered = ensure_locality(mesh)
    assert as_set(ordered.mesh.vertices, ordered.mesh.faces) == as_set(mesh.vertices, mesh.faces)
    np.testing.assert_array_equal(ordered.restore_order(ordered.mesh.vertices), mesh.vertices)
    # no face is wider than two levels, each twice around the tube at most
    assert np.ptp(ordered.mesh.faces, axis=1).max() <= 4 * 2 * 30
    assert np.median(np.abs(np.diff(ordered.mesh.faces[:, 0]))) <= 1


def test_smoothing_does_not_depend_on_the_order(monkeypatch):
    monkeypatch.setattr(spatial_order, "MIN_REORDER_VERTICES", 200)
    surface = torus(resolution=30)
    noise = 0.01 * np.random.default_rng(0).standard_normal((len(surface.vertices), 1))
    noisy = surface.vertices + noise * surface.normals
    selected = surface.vertices[:, 0] > 0.0
    plain = smooth(noisy, surface.faces, selected=selected)
    vertices, faces, rank = shuffled(noisy, surface.faces)
    other = smooth(vertices, faces, selected=selected[np.argsort(rank)])
    for name in ("vertices", "displacement", "sharpness"):
        np.testing.assert_allclose(getattr(other, name)[rank], getattr(plain, name), atol=5e-4)
    assert np.linalg.norm(plain.displacement[selected]) > 0.1
    assert not other.displacement[rank][~selected].any()
