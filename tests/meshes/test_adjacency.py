"""Rows and components agree with slower ways to find them, on any number of threads."""

import numpy as np
from face_lists import random_faces
from hypothesis import given

from bezier_filters import triangle_mesh, vertex_adjacency
from bezier_filters.meshes.adjacency import closed_components, incoherent_vertices
from bezier_filters.runtime.parallel import MIN_CHUNK, use_threads
from bezier_filters.surfaces import punched_patch, sphere, torus


def adjacency_of(surface):
    return vertex_adjacency(triangle_mesh(surface.vertices, surface.faces))


def test_some_rows_come_one_after_the_other():
    rows = adjacency_of(punched_patch()).faces
    ids = np.array([5, 0, 5, 300], dtype=np.int32)
    np.testing.assert_array_equal(rows.of(ids), np.concatenate([rows.row(i) for i in ids]))
    assert rows.of(ids[:0]).size == 0


def test_components_are_closed_where_every_edge_has_two_faces():
    ball, ring, sheet = sphere(resolution=3), torus(resolution=8), punched_patch()
    shapes = (sheet, ball, ring)
    firsts = np.cumsum([0, *(len(shape.vertices) for shape in shapes)])
    vertices = np.vstack([shape.vertices for shape in shapes])
    faces = np.vstack([shape.faces + first for shape, first in zip(shapes, firsts, strict=False)])
    mesh = triangle_mesh(vertices, faces)
    number, first = closed_components(mesh, vertex_adjacency(mesh))
    np.testing.assert_array_equal(number, np.repeat([-1, 0, 1], np.diff(firsts)))
    np.testing.assert_array_equal(first, firsts[1:3])
    turned = triangle_mesh(vertices, np.vstack([faces[:-1], faces[-1:, ::-1]]))
    assert (closed_components(turned, vertex_adjacency(turned))[0] == -1).all()


@given(random_faces)
def test_faces_and_boundary_of_any_face_list(faces):
    adjacency = vertex_adjacency(triangle_mesh(np.zeros((15, 3)), faces))
    proper = [len(set(face)) == 3 for face in faces.tolist()]
    for vertex in range(15):
        expected = [f for f in range(len(faces)) if proper[f] and vertex in faces[f]]
        assert adjacency.faces.row(vertex).tolist() == expected
        met = [j for f in expected for j in faces[f].tolist() if j != vertex]
        assert adjacency.on_boundary[vertex] == any(met.count(j) == 1 for j in met)


def test_high_valence_neighbours_are_sorted_and_distinct():
    n = 500
    angle = np.linspace(0, 2 * np.pi, n, endpoint=False)
    vertices = np.vstack([np.zeros(3), np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])])
    rim = np.arange(1, n + 1)
    faces = np.column_stack([np.zeros(n, int), rim, np.roll(rim, -1)])[np.random.default_rng(0).permutation(n)]
    adjacency = vertex_adjacency(triangle_mesh(vertices, faces))
    np.testing.assert_array_equal(adjacency.vertices.row(0), rim)
    assert adjacency.on_boundary[1:].all()
    assert not adjacency.on_boundary[0]


def test_adjacency_is_the_same_on_any_number_of_threads():
    surface = punched_patch(resolution=100)
    mesh = triangle_mesh(surface.vertices, surface.faces[np.random.default_rng(0).permutation(len(surface.faces))])
    assert mesh.vertex_count > 2 * MIN_CHUNK
    one = vertex_adjacency(mesh)
    with use_threads(3):
        three = vertex_adjacency(mesh)
    for name in ("faces", "vertices"):
        for part in ("indptr", "indices"):
            np.testing.assert_array_equal(getattr(getattr(one, name), part), getattr(getattr(three, name), part))
    np.testing.assert_array_equal(one.on_boundary, three.on_boundary)


def test_faces_without_three_corners_and_edges_run_through_twice_are_incoherent():
    faces = [[0, 1, 2], [3, 4, 4], [5, 6, 7], [5, 6, 8]]
    mesh = triangle_mesh(np.random.default_rng(0).standard_normal((9, 3)), faces)
    found = incoherent_vertices(mesh.faces, vertex_adjacency(mesh))
    assert np.flatnonzero(found).tolist() == [3, 4, 5]
