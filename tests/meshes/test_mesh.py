import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bezier_filters import InvalidMeshError, boundary_loops, inspect_mesh, k_rings, triangle_mesh, vertex_adjacency
from bezier_filters.runtime.parallel import CHUNK
from bezier_filters.surfaces import punched_patch, sphere, torus

TETRAHEDRON = ([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


@pytest.mark.parametrize(
    ("vertices", "faces", "message"),
    [
        ([[0, 0]], [[0, 0, 0]], r"vertices: got shape \(1, 2\), expected \(n, 3\)"),
        ([[0, 0, np.nan]], np.empty((0, 3)), "1 of 1 have a coordinate that is NaN"),
        ([[0, 0, np.inf]], np.empty((0, 3)), "NaN or infinite"),
        ([["a", 0, 1]], np.empty((0, 3)), "vertices: expected real numbers"),
        (np.zeros((3, 3)), [[0, 1, 3]], "faces: indices run from 0 to 3, expected 0 to 2"),
        (np.zeros((3, 3)), [[0, 1, -1]], "faces: indices run from -1 to 1"),
        (np.zeros((4, 3)), [[0, 1, 2, 3]], r"faces: got shape \(1, 4\).*triangulate"),
        (np.zeros((3, 3)), [[0.0, 1.0, 2.0]], "faces: got dtype float64, expected integers"),
        (np.zeros((3, 3)), [[0, 1, 2], [0, 1]], "faces: expected integers"),
    ],
)
def test_bad_arrays_are_refused_by_name(vertices, faces, message):
    with pytest.raises(InvalidMeshError, match=message):
        triangle_mesh(vertices, faces)


def test_empty_meshes_are_meshes():
    assert triangle_mesh(np.empty((0, 3)), np.empty((0, 3))).vertex_count == 0
    assert inspect_mesh(triangle_mesh(np.zeros((2, 3)), [])).unreferenced_vertices == 2


def test_report_counts_every_fault():
    vertices = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [2, 0, 0], [9, 9, 9]]
    faces = [[0, 1, 2], [1, 2, 3], [2, 0, 1], [0, 1, 4], [3, 3, 1]]
    report = inspect_mesh(triangle_mesh(vertices, faces))
    assert report.unreferenced_vertices == 1
    assert report.degenerate_faces == 2  # (0, 1, 4) has no area, (3, 3, 1) names 3 twice
    assert report.duplicate_faces == 1
    assert report.non_manifold_edges == 2  # 0-1 and 1-2 have three faces
    assert report.boundary_edges == 4
    assert report.incoherent_edges == 1  # 0-2 twice in the same direction


def test_incoherent_orientation_is_seen():
    flipped = inspect_mesh(triangle_mesh([*np.eye(3).tolist(), [0, 0, 0]], [[0, 1, 2], [1, 2, 3]]))
    assert flipped.incoherent_edges == 1
    assert not flipped.is_coherently_oriented
    assert inspect_mesh(triangle_mesh(*TETRAHEDRON)).is_coherently_oriented


def test_mean_edge_length_counts_each_edge_once():
    assert inspect_mesh(triangle_mesh(*TETRAHEDRON)).mean_edge_length == pytest.approx((3 + 3 * np.sqrt(2)) / 6)


def reference_rings(faces, start, rings):
    """Breadth-first search with sets."""
    neighbours = {}
    for face in faces.tolist():
        for vertex in face:
            neighbours.setdefault(vertex, set()).update(set(face) - {vertex})
    ring = {start}
    for _ in range(rings):
        ring = ring.union(*(neighbours.get(vertex, set()) for vertex in ring))
    return ring


random_faces = st.lists(st.tuples(*[st.integers(0, 14)] * 3), min_size=1, max_size=40).map(np.array)


@given(random_faces, st.integers(0, 4))
def test_rings_of_any_face_list_agree_with_sets(faces, rings):
    mesh = triangle_mesh(np.zeros((15, 3)), faces)
    proper = faces[[len(set(face)) == 3 for face in faces.tolist()]]
    rows = k_rings(vertex_adjacency(mesh), rings)
    assert len(rows) == 15
    for vertex in range(15):
        row = rows.row(vertex).tolist()
        assert row[0] == vertex
        assert len(set(row)) == len(row)
        assert set(row) == reference_rings(proper, vertex, rings)


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
    assert mesh.vertex_count > 2 * CHUNK
    one, three = vertex_adjacency(mesh), vertex_adjacency(mesh, threads=3)
    for name in ("faces", "vertices"):
        for part in ("indptr", "indices"):
            np.testing.assert_array_equal(getattr(getattr(one, name), part), getattr(getattr(three, name), part))
    np.testing.assert_array_equal(one.on_boundary, three.on_boundary)


def test_closed_surfaces_have_no_boundary():
    for surface in (sphere(), torus()):
        mesh = triangle_mesh(surface.vertices, surface.faces)
        assert boundary_loops(mesh) == []
        assert not vertex_adjacency(mesh).on_boundary.any()


def test_loops_run_with_the_faces_around_rim_and_against_them_around_holes():
    surface = punched_patch()
    loops = boundary_loops(triangle_mesh(surface.vertices, surface.faces))
    areas = []
    for loop in loops:
        x, y, _ = surface.vertices[loop].T
        areas.append(0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))
    assert sorted(np.sign(areas)) == [-1, -1, -1, 1]
    boundary = vertex_adjacency(triangle_mesh(surface.vertices, surface.faces)).on_boundary
    np.testing.assert_array_equal(np.sort(np.concatenate(loops)), np.flatnonzero(boundary))


def test_loops_that_touch_at_a_vertex_stay_apart():
    # two triangles that share vertex 0 only
    mesh = triangle_mesh(np.random.default_rng(0).random((5, 3)), [[0, 1, 2], [0, 3, 4]])
    assert [loop.tolist() for loop in boundary_loops(mesh)] == [[0, 1, 2], [0, 3, 4]]


def test_loops_of_a_non_manifold_edge_are_refused_with_a_remedy():
    mesh = triangle_mesh(np.random.default_rng(0).random((5, 3)), [[0, 1, 2], [0, 1, 3], [0, 1, 4]])
    with pytest.raises(InvalidMeshError, match="meshing_repair_non_manifold_edges"):
        boundary_loops(mesh)
