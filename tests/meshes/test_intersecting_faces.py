import numpy as np
import pytest

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.meshes.intersecting_faces import intersecting_faces
from bezier_filters.meshes.mesh import triangle_mesh
from bezier_filters.meshes.prepared_mesh import PreparedMesh, prepare_mesh
from bezier_filters.meshes.self_intersections import cut_faces
from bezier_filters.runtime.parallel import use_threads
from bezier_filters.smoothing.intersections import reduce_intersections
from bezier_filters.surfaces import sphere, torus


def mesh_of(*pieces: tuple[FloatArray, IntArray]) -> PreparedMesh:
    counts = np.cumsum([0] + [len(vertices) for vertices, _ in pieces])
    faces = [faces + first for (_, faces), first in zip(pieces, counts, strict=False)]
    return prepare_mesh(triangle_mesh(np.concatenate([vertices for vertices, _ in pieces]), np.concatenate(faces)))


def noisy_torus(sigma: float, seed: int) -> tuple[FloatArray, IntArray]:
    ring = torus(resolution=80)
    edge = np.linalg.norm(ring.vertices[ring.faces[:, 0]] - ring.vertices[ring.faces[:, 1]], axis=1).mean()
    return ring.vertices + sigma * edge * np.random.default_rng(seed).normal(size=ring.vertices.shape), ring.faces


@pytest.mark.parametrize("seed", range(3))
def test_pairs_are_those_of_the_test_of_all_pairs(seed: int):
    rng = np.random.default_rng(seed)
    ball = sphere(resolution=12)
    placed = [(ball.vertices @ np.linalg.qr(rng.normal(size=(3, 3)))[0] + rng.uniform(-1, 1, 3)) for _ in range(6)]
    mesh = mesh_of(*((vertices, ball.faces) for vertices in placed))
    other = intersecting_faces(mesh)
    assert np.array_equal(other >= 0, cut_faces(mesh.vertices, mesh.faces, mesh.face_count))
    for f in np.flatnonzero(other >= 0)[:50]:
        assert cut_faces(mesh.vertices, mesh.faces[[f, other[f]]], 1).all()


def test_folds_by_noise_are_found_but_for_a_few_within_a_leaf():
    mesh = mesh_of(noisy_torus(0.3, 0))
    found, true = intersecting_faces(mesh) >= 0, cut_faces(mesh.vertices, mesh.faces, mesh.face_count)
    assert true.sum() > 1000
    assert not (found & ~true).any()
    assert (true & ~found).sum() < 0.005 * true.sum()


def test_numbering_and_threads_do_not_matter():
    vertices, faces = noisy_torus(0.5, 1)
    rng = np.random.default_rng(2)
    order, moved = rng.permutation(len(vertices)), rng.permutation(len(faces))
    mesh, again = mesh_of((vertices, faces)), mesh_of((vertices[order], np.argsort(order)[faces][moved]))
    first = intersecting_faces(mesh)
    with use_threads(2):
        assert np.array_equal(intersecting_faces(mesh), first)
    differing = (intersecting_faces(again) >= 0) != (first >= 0)[moved]
    assert differing.mean() < 1e-3  # other leaves miss other folds


def test_meshes_without_two_faces_have_no_intersections():
    assert len(intersecting_faces(prepare_mesh(triangle_mesh(np.zeros((0, 3)), np.zeros((0, 3), dtype=int))))) == 0
    assert intersecting_faces(prepare_mesh(triangle_mesh(np.eye(3), [[0, 1, 2]]))).tolist() == [-1]


def test_moves_stop_before_sheets_intersect_and_are_whole_elsewhere():
    inner, outer = sphere(resolution=16), sphere(resolution=20)
    mesh = mesh_of((0.9 * inner.vertices, inner.faces), (outer.vertices, outer.faces))
    dent = np.where(mesh.vertices[:, 2] > 0.8, -0.3, -0.02)[:, np.newaxis] * mesh.vertices
    dent[: len(inner.vertices)] = 0.0  # the outer ball is pushed into the inner one at its top
    assert (intersecting_faces(mesh) < 0).all()
    assert (intersecting_faces(mesh.move(mesh.vertices + dent)) >= 0).any()
    points, new = reduce_intersections(mesh, mesh.vertices + dent)
    assert new == 0
    assert (intersecting_faces(mesh.move(points)) < 0).all()
    far = mesh.vertices[:, 2] < 0.5
    assert np.array_equal(points[far], (mesh.vertices + dent)[far])
    assert np.abs(points - mesh.vertices).max() > 0.05


def test_faces_that_intersected_before_do_not_count():
    ball = sphere(resolution=12)
    mesh = mesh_of((ball.vertices, ball.faces), (ball.vertices + np.array([1.0, 0.1, 0.2]), ball.faces))
    smaller = mesh.vertices - 0.001 * np.tile(ball.vertices, (2, 1))
    points, new = reduce_intersections(mesh, smaller)
    assert new == 0
    assert (intersecting_faces(mesh.move(points)) >= 0).sum() > 0
