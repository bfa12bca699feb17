"""Smoothing of meshes so large that what holds for the whole is learned from parts; and its shortcuts."""

import numpy as np
import pytest
from numba import config
from test_smoothing import edge_of, face_normals, mean_angle, with_noise

from bezier_filters import smooth
from bezier_filters.meshes.adjacency import vertex_adjacency
from bezier_filters.meshes.mesh import triangle_mesh
from bezier_filters.runtime.parallel import MIN_CHUNK
from bezier_filters.smoothing import denoise, mesh_parts
from bezier_filters.smoothing.mesh_parts import MAX_WHOLE_VERTICES, PART_CORE_VERTICES, PART_VERTICES, sample_parts
from bezier_filters.smoothing.normal_filter import UPDATE_ROUNDS, move_to_normals
from bezier_filters.surfaces import block_with_sharp_edges, bumpy_star, sphere

compiled = pytest.mark.skipif(config.DISABLE_JIT, reason="takes too long without the compiler")


@pytest.fixture(scope="module", params=[4, pytest.param(1, marks=pytest.mark.slow)])
def star(request):
    """A surface with more vertices than are looked at as a whole, or a fourth of that, and parts as much smaller."""
    share = request.param
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(mesh_parts, "PART_VERTICES", PART_VERTICES // share)
        patch.setattr(mesh_parts, "PART_CORE_VERTICES", PART_CORE_VERTICES // share)
        for module in (mesh_parts, denoise):
            patch.setattr(module, "MAX_WHOLE_VERTICES", MAX_WHOLE_VERTICES // share)
        surface = bumpy_star(resolution=80 if share == 1 else 42, jitter=0.2)
        assert len(surface.vertices) > max(MAX_WHOLE_VERTICES // share, 2 * MIN_CHUNK)
        yield surface


@compiled
def test_parts_are_of_one_piece_with_a_margin(star):
    mesh = triangle_mesh(star.vertices, star.faces)
    adjacency = vertex_adjacency(mesh)
    parts = sample_parts(mesh, adjacency)
    assert mesh_parts.PART_VERTICES < parts.mesh.vertex_count < mesh.vertex_count
    assert parts.core.sum() > mesh_parts.PART_CORE_VERTICES
    assert np.array_equal(parts.mesh.vertices, star.vertices[parts.ids])
    # Nothing is missing around the vertices that count.
    inside = parts.adjacency.vertices.lengths[parts.core]
    assert np.array_equal(inside, adjacency.vertices.lengths[parts.ids[parts.core]])
    assert not parts.cut[parts.core].any()


def test_small_meshes_are_their_own_sample():
    ball = sphere(resolution=6)
    mesh = triangle_mesh(ball.vertices, ball.faces)
    parts = sample_parts(mesh, vertex_adjacency(mesh))
    assert parts.mesh is mesh
    assert parts.core.all()


@pytest.fixture(scope="module")
def smoothed(star):
    """The star and a block beside it, as they were, with noise, and with that taken off."""
    block, faces = block_with_sharp_edges(resolution=16, jitter=0.2)
    scale = edge_of(star.vertices, star.faces) / edge_of(block, faces)
    clean = np.vstack([star.vertices, block * scale + [5.0, 0.0, 0.0]])
    both = np.vstack([star.faces, faces + len(star.vertices)])
    normals = np.zeros_like(clean)
    for k in range(3):
        np.add.at(normals, both[:, k], face_normals(clean, both))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    noisy = with_noise(clean, both, normals, 0.2)
    return clean, faces, (noisy, both), smooth(noisy, both, threads=2)


@compiled
def test_large_meshes_become_smooth(star, smoothed):
    *_, result = smoothed
    assert mean_angle(result.vertices[: len(star.vertices)], star.vertices, star.faces) < 1.0
    assert result.volume_ratio == pytest.approx(1.0, abs=1e-9)


@compiled
def test_the_number_of_threads_does_not_matter(smoothed):
    """On a mesh of several chunks of vertices."""
    *_, noisy, two = smoothed
    one = smooth(*noisy, threads=1)
    assert np.array_equal(one.vertices, two.vertices)
    assert np.array_equal(one.sharpness, two.sharpness)


@compiled
def test_edges_that_no_part_need_have_met_stay_sharp(star, smoothed):
    clean, faces, _, result = smoothed
    rest = slice(len(star.vertices), None)
    assert result.sharpness[rest].mean() > 0.5
    assert mean_angle(result.vertices[rest], clean[rest], faces) < 3.0


def test_the_polynomial_does_what_all_the_rounds_would():
    ball = sphere(resolution=6, jitter=0.2)
    noisy = with_noise(ball.vertices, ball.faces, ball.normals, 0.2)
    mesh = triangle_mesh(noisy, ball.faces)
    normals = face_normals(ball.vertices, ball.faces)
    movable = noisy[:, 2] > -0.5
    expected, counts = noisy.copy(), np.bincount(mesh.faces.ravel())[:, np.newaxis]
    for _ in range(UPDATE_ROUNDS):
        centers = expected[mesh.faces].mean(axis=1)
        steps = np.zeros_like(expected)
        for k in range(3):
            heights = np.einsum("ij,ij->i", centers - expected[mesh.faces[:, k]], normals)
            np.add.at(steps, mesh.faces[:, k], heights[:, np.newaxis] * normals)
        expected[movable] += (steps / counts)[movable]
    moves = move_to_normals(mesh, vertex_adjacency(mesh), normals.astype(np.float32), movable)
    assert np.abs(noisy + moves - expected).max() < 0.01 * np.abs(expected - noisy).max()
    assert not moves[~movable].any()
