"""Volumes of closed components."""

import numpy as np
import pytest

from bezier_filters.meshes.mesh import TriangleMesh, triangle_mesh
from bezier_filters.meshes.prepared_mesh import prepare_mesh
from bezier_filters.smoothing.volume import (
    ClosedComponents,
    component_volumes,
    local_movement,
    restore_volumes,
    volume_not_restored,
)
from bezier_filters.surfaces import block_with_sharp_edges, sphere, waves


def components_of(mesh):
    return ClosedComponents.locate(prepare_mesh(mesh))


def volumes_of(mesh):
    return component_volumes(components_of(mesh), mesh)


@pytest.fixture
def two_bodies_and_a_sheet():
    """A block, a ball far away, a sheet, and a vertex without a face."""
    block, faces = block_with_sharp_edges(resolution=4)
    ball, sheet = sphere(resolution=6), waves(resolution=4)
    vertices = np.vstack([block, ball.vertices + 1e3, sheet.vertices, [[7.0, 7.0, 7.0]]])
    n = len(block), len(block) + len(ball.vertices)
    return triangle_mesh(vertices, np.vstack([faces, ball.faces + n[0], sheet.faces + n[1]])), n


def test_closed_components_are_found(two_bodies_and_a_sheet):
    mesh, (end_of_block, end_of_ball) = two_bodies_and_a_sheet
    components = components_of(mesh)
    assert components.count == 2
    of_vertex = components.of_vertex
    assert set(of_vertex[:end_of_block]) == {0}
    assert set(of_vertex[end_of_block:end_of_ball]) == {1}
    assert (of_vertex[end_of_ball:] == -1).all()
    assert np.array_equal(components.origins, mesh.vertices[[0, end_of_block]])


def test_volumes_do_not_depend_on_the_place(two_bodies_and_a_sheet):
    mesh, _ = two_bodies_and_a_sheet
    volumes = volumes_of(mesh)
    moved = TriangleMesh(mesh.vertices + np.array([1e3, 0.0, -1e3]), mesh.faces)
    assert np.allclose(volumes_of(moved), volumes, rtol=1e-9)
    turned = TriangleMesh(mesh.vertices, np.ascontiguousarray(mesh.faces[:, ::-1]))
    assert np.allclose(volumes_of(turned), -volumes)


def test_volumes_are_reached_where_amounts_allow(two_bodies_and_a_sheet):
    mesh, (end_of_block, _) = two_bodies_and_a_sheet
    components = components_of(mesh)
    amounts = np.zeros(mesh.vertex_count)
    amounts[end_of_block:] = 1.0
    before = component_volumes(components, mesh)
    result = restore_volumes(components, mesh, 1.01 * before, amounts)
    after = component_volumes(components, TriangleMesh(result, mesh.faces))
    assert np.allclose(after / before, [1.0, 1.01], rtol=1e-12)
    assert np.array_equal(result[:end_of_block], mesh.vertices[:end_of_block])
    outside = components.of_vertex < 0
    assert np.array_equal(result[outside], mesh.vertices[outside])


def test_double_sheets_have_no_volume_to_restore():
    """Faces of both sides cancel, so what is left of a volume or of a direction outwards is rounding."""
    sheet, rng = waves(resolution=6), np.random.default_rng(0)
    triangle = triangle_mesh(rng.normal(size=(3, 3)), [[0, 1, 2], [0, 2, 1]])
    double = triangle_mesh(sheet.vertices[:, [2, 0, 1]], np.vstack([sheet.faces, sheet.faces[:, ::-1]]))
    for mesh in (triangle, double):
        of_vertex = np.zeros(mesh.vertex_count, dtype=np.int64)
        components = ClosedComponents(of_vertex, mesh.vertices[:1])
        moved = mesh.vertices + 0.01 * rng.normal(size=mesh.vertices.shape)
        volumes = component_volumes(components, mesh)
        result = restore_volumes(components, TriangleMesh(moved, mesh.faces), volumes, np.full(len(moved), 0.01))
        assert np.array_equal(result, moved)


def test_no_vertex_moves_farther_than_its_amount():
    mesh = triangle_mesh(*block_with_sharp_edges(resolution=4))
    amounts = np.full(mesh.vertex_count, 1e-3)
    result = restore_volumes(components_of(mesh), mesh, 2.0 * volumes_of(mesh), amounts)
    assert 0.0 < np.linalg.norm(result - mesh.vertices, axis=1).max() <= 1e-3 * (1 + 1e-9)


def test_meshes_that_enclose_nothing():
    sheet = waves(resolution=4)
    ball = sphere(resolution=4)
    twice = np.vstack([ball.faces, ball.faces[:1]])
    named_twice = np.vstack([ball.faces, [[0, 0, 1]]])
    turned = np.vstack([ball.faces[:1, ::-1], ball.faces[1:]])
    for faces in (twice, named_twice, turned, ball.faces[1:], np.zeros((0, 3), dtype=int)):
        mesh = triangle_mesh(ball.vertices, faces)
        assert components_of(mesh).count == 0
    mesh = triangle_mesh(sheet.vertices, sheet.faces)
    assert components_of(mesh).count == 0


@pytest.mark.parametrize(("shrunk", "sigma", "is_unlike"), [(0.9, 0.0, True), (0.999, 0.0, False), (0.9, 1.0, False)])
def test_what_has_lost_its_volume_is_told(two_bodies_and_a_sheet, shrunk, sigma, is_unlike):
    """But for what is thinner than the noise: the volume of the block is some 0.15 times its area."""
    mesh, (end_of_block, _) = two_bodies_and_a_sheet
    points = mesh.vertices.copy()
    points[:end_of_block] *= shrunk
    unlike = volume_not_restored(components_of(mesh), mesh, TriangleMesh(points, mesh.faces), sigma)
    assert (unlike == (is_unlike & (np.arange(mesh.vertex_count) < end_of_block))).all()


def test_vertices_follow_their_surroundings_by_an_edge_at_most():
    """A fan with long edges on one side: its short side does not follow what the tip of the long one does."""
    vertices = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-100.0, 0.0, 0.0], [-100.0, 1.0, 0.0]]
    mesh = triangle_mesh(vertices, [[0, 1, 2], [0, 2, 3], [2, 4, 3]])
    amounts = local_movement(prepare_mesh(mesh), mesh.vertices + np.array([0.0, 0.0, 50.0]))
    assert amounts == pytest.approx([50.0, np.sqrt(2.0), 50.0, 50.0, 50.0])
