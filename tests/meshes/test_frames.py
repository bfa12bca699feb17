import numpy as np
from compiled import from_python
from hypothesis import given
from hypothesis import strategies as st
from scanner_noise import in_all_directions

from bezier_filters import triangle_mesh, vertex_adjacency
from bezier_filters.kernels.fit_frames import folds
from bezier_filters.kernels.kernel_input import kernel_mesh, prepare_kernel_mesh, use_smoothed_normals
from bezier_filters.meshes.frames import (
    MAX_FACE_TILT,
    NO_SAFE_COSINE,
    NORMAL_SMOOTHING_ROUNDS,
    face_normal,
    farthest_direction,
    mean_normal,
    smooth_normals,
    tangent_planes,
)
from bezier_filters.runtime.parallel import use_threads
from bezier_filters.surfaces import block_with_sharp_edges, bumpy_star, sphere, waves

directions = st.tuples(*[st.floats(-1, 1)] * 3).map(np.array).filter(lambda d: np.linalg.norm(d) > 0.1)


def test_normals_are_the_normalised_means_of_the_unit_face_normals():
    surface = waves(jitter=0.3, resolution=10)
    mesh = triangle_mesh(surface.vertices, surface.faces)
    a, b, c = mesh.vertices[mesh.faces].transpose(1, 0, 2)
    unit = np.cross(b - a, c - a)
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    expected = np.zeros_like(mesh.vertices)
    for corner in range(3):
        np.add.at(expected, mesh.faces[:, corner], unit)
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    np.testing.assert_allclose(tangent_planes(mesh, vertex_adjacency(mesh)).normals, expected, atol=1e-12)


def test_cones_of_face_normals_bound_the_safe_directions():
    surface = waves(jitter=0.3, resolution=60)
    mesh = triangle_mesh(surface.vertices, surface.faces)
    adjacency = vertex_adjacency(mesh)
    with use_threads(2):
        planes = tangent_planes(mesh, adjacency)
    a, b, c = mesh.vertices[mesh.faces].transpose(1, 0, 2)
    unit = np.cross(b - a, c - a)
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    for vertex in range(0, mesh.vertex_count, 7):
        cone = np.arccos(min(1.0, (unit[adjacency.faces.row(vertex)] @ planes.normals[vertex]).min()))
        exact = np.cos(MAX_FACE_TILT - cone)
        assert exact < planes.safe_cosine[vertex] < exact + 5e-7


@given(directions, st.integers(0, 20))
def test_fold_test_finds_exactly_the_faces_that_turn_away(direction, seed):
    """The bound that skips faces must not hide a fold."""
    vertices, faces = block_with_sharp_edges(resolution=4)
    rng = np.random.default_rng(seed)
    mesh = triangle_mesh(vertices + 0.05 * rng.standard_normal(vertices.shape), faces)
    adjacency = vertex_adjacency(mesh)
    planes = tangent_planes(mesh, adjacency)
    direction = direction / np.linalg.norm(direction)
    rows = adjacency.faces
    for vertex in range(0, mesh.vertex_count, 5):
        cosines = []
        for f in rows.row(vertex):
            normal = np.array(from_python(face_normal)(mesh.vertices, mesh.faces, f))
            cosines.append(normal @ direction / np.linalg.norm(normal))
        members = np.array([vertex], dtype=np.int32)
        found = from_python(folds)(kernel_mesh(mesh, adjacency, planes), members, 1, *direction)
        assert found == (min(cosines) <= np.sin(np.radians(1.0)))


def test_x_axis_points_to_the_farthest_projection_in_any_numbering():
    surface = sphere(resolution=3, jitter=0.2)
    members = np.array([0, 5, 9, 11, 20], dtype=np.int32)
    normal = surface.normals[0]
    expected = None
    for order in (members, members[[0, 4, 2, 3, 1]]):
        axis = np.array(farthest_direction(surface.vertices, order, 4, 5, *normal))
        assert abs(axis @ normal) < 1e-12
        assert abs(np.linalg.norm(axis) - 1) < 1e-12
        expected = axis if expected is None else expected
        np.testing.assert_array_equal(axis, expected)
    edges = surface.vertices[members[1:]] - surface.vertices[0]
    tangential = edges - np.outer(edges @ normal, normal)
    longest = tangential[np.argmax(np.linalg.norm(tangential, axis=1))]
    np.testing.assert_allclose(expected, longest / np.linalg.norm(longest), atol=1e-12)


def test_normals_that_cancel_out_have_no_mean():
    normals = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
    assert from_python(mean_normal)(normals, np.array([0, 1], dtype=np.int32), 2) == (0.0, 0.0, 0.0)


def test_x_axis_among_equally_far_neighbours_follows_from_the_neighbourhood():
    """On a square lattice four neighbours are equally far; an extra point breaks the symmetry."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0], [0.2, 1.5, 0.0]], dtype=np.float64)
    rng = np.random.default_rng(0)
    for _ in range(10):
        turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
        order = np.r_[0, 1 + rng.permutation(4), 5].astype(np.int32)
        members = np.arange(6, dtype=np.int32)
        axis = np.array(farthest_direction(points[order] @ turn.T, members, 4, 6, *(turn @ [0.0, 0.0, 1.0])))
        np.testing.assert_allclose(axis, turn @ [0.0, 1.0, 0.0], atol=1e-12)


def averaged(normals, adjacency, stops, rounds):
    """The same as `smooth_normals`, vertex by vertex."""
    for _ in range(rounds):
        sums = normals.copy()
        for i in np.flatnonzero(~stops):
            row = adjacency.vertices.row(i)
            sums[i] += normals[row[~stops[row]]].sum(axis=0)
        normals = sums / np.linalg.norm(sums, axis=1, keepdims=True)
    return normals


def test_steady_normals_are_means_over_neighbours_taken_again_and_again():
    surface = bumpy_star(resolution=8, jitter=0.2)
    mesh = triangle_mesh(in_all_directions(surface.vertices, surface.faces, 0.4), surface.faces)
    adjacency = vertex_adjacency(mesh)
    stops = np.random.default_rng(0).random(mesh.vertex_count) < 0.1
    normals, rows = tangent_planes(mesh, adjacency).normals, adjacency.vertices
    before = normals.copy()
    one = smooth_normals(normals, rows.indptr, rows.indices, stops)
    with use_threads(2):
        found = [one, smooth_normals(normals, rows.indptr, rows.indices, stops)]
    np.testing.assert_array_equal(*found)
    np.testing.assert_array_equal(normals, before)
    np.testing.assert_allclose(found[0], averaged(normals, adjacency, stops, NORMAL_SMOOTHING_ROUNDS), atol=1e-12)


def test_steady_normals_are_nearer_to_the_truth_under_noise_that_turns_single_ones():
    surface = sphere(resolution=16, jitter=0.2)
    mesh = prepare_kernel_mesh(
        triangle_mesh(in_all_directions(surface.vertices, surface.faces, 0.5), surface.faces), with_barriers=True
    )
    steady = use_smoothed_normals(mesh)
    before, after = (np.einsum("ij,ij->i", one.normals, surface.normals) for one in (mesh, steady))
    assert before.min() < 0.0
    assert after.min() > 0.8
    assert (steady.safe_cosine == NO_SAFE_COSINE).all()


def test_steady_normals_do_not_cross_stops():
    """What happens on one side of the edges of a block leaves the other sides as they are."""
    vertices, faces = block_with_sharp_edges(resolution=10)
    mesh = prepare_kernel_mesh(triangle_mesh(vertices, faces), with_barriers=True)
    on_top = (vertices[:, 2] > vertices[:, 2].max() - 1e-9) & ~mesh.barriers
    inside = ~on_top & ~mesh.barriers
    assert mesh.barriers.any()
    assert on_top.sum() > 20
    found = use_smoothed_normals(mesh).normals
    np.testing.assert_allclose(found[on_top], np.tile([0.0, 0.0, 1.0], (on_top.sum(), 1)), atol=1e-12)
    tilted = mesh.normals.copy()
    tilted[on_top] = [0.6, 0.0, 0.8]
    others = use_smoothed_normals(mesh._replace(normals=tilted)).normals
    np.testing.assert_array_equal(others[inside], found[inside])
    np.testing.assert_array_equal(others[mesh.barriers], found[mesh.barriers])
    np.testing.assert_allclose(others[mesh.barriers], mesh.normals[mesh.barriers], atol=1e-12)
    every = smooth_normals(tilted, mesh.ring_ptr, mesh.ring_indices, np.zeros(len(vertices), dtype=np.bool_))
    assert np.abs(every[inside] - found[inside]).max() > 0.01, "it is the stops that hold it back"


def test_normals_that_cancel_out_stay():
    """Two triangles back to back, and a vertex without faces."""
    vertices = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [5.0, 5.0, 5.0]])
    adjacency = vertex_adjacency(triangle_mesh(vertices, [[0, 1, 2]]))
    normals = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    rows = adjacency.vertices
    found = smooth_normals(normals, rows.indptr, rows.indices, np.zeros(4, dtype=np.bool_))
    np.testing.assert_array_equal(found, normals)
