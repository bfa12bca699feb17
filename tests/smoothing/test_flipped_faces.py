"""Faces that are turned over."""

import numpy as np
import pytest
from numba import config
from smoothing_cases import edge_of, part_around

from bezier_filters.meshes.mesh import TriangleMesh, triangle_mesh
from bezier_filters.meshes.prepared_mesh import prepare_mesh
from bezier_filters.smoothing.flipped_faces import bad_faces, repair_flipped_faces
from bezier_filters.surfaces import bumpy_star, waves


def test_moves_that_turn_faces_over_are_taken_back():
    sheet = waves(resolution=12, amplitude=0.0)
    mesh = prepare_mesh(triangle_mesh(sheet.vertices, sheet.faces))
    before = bad_faces(mesh)
    assert not before.flipped.any()
    assert not before.degenerate.any()
    moved = mesh.vertices + np.array([0.0, 0.0, 0.01])
    middle = np.linalg.norm(mesh.vertices, axis=1).argmin()
    moved[middle] += [0.5, 0.1, 0.0]  # over its neighbours
    assert bad_faces(prepare_mesh(TriangleMesh(moved, mesh.faces))).flipped.any()
    result = repair_flipped_faces(mesh, moved)
    assert not bad_faces(prepare_mesh(TriangleMesh(result, mesh.faces))).new_since(before).any()
    far = np.linalg.norm(mesh.vertices, axis=1) > 0.8
    assert np.array_equal(result[far], moved[far])


def test_faces_without_area_are_degenerate_not_flipped():
    mesh = triangle_mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [2, 0, 0]], [[0, 1, 2], [0, 1, 3]])
    bad = bad_faces(prepare_mesh(mesh))
    assert bad.degenerate.tolist() == [False, True]
    assert not bad.flipped.any()


@pytest.mark.skipif(config.DISABLE_JIT, reason="takes too long without the compiler")
def test_faces_are_repaired_alike_in_a_part():
    star = bumpy_star(resolution=24, jitter=0.2)
    mesh, rng = prepare_mesh(triangle_mesh(star.vertices, star.faces)), np.random.default_rng(0)
    moved = mesh.vertices + 0.6 * edge_of(mesh.vertices, mesh.faces) * rng.standard_normal(mesh.vertices.shape)
    whole = repair_flipped_faces(mesh, moved)
    assert not np.array_equal(whole, moved)
    inner = mesh.vertices[:, 0] > 0.4
    part = part_around(mesh, inner, 20)
    rows = inner[part.ids]
    found = repair_flipped_faces(part.mesh, moved[part.ids])
    assert np.mean(np.abs(found[rows] - whole[part.ids[rows]]).max(axis=1) > 1e-12) < 1e-3
