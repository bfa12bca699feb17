"""The filter of face normals, and vertices that follow them."""

import numpy as np
import pytest
from hole_cases import sheet
from smoothing_cases import face_normals, with_noise

from bezier_filters.meshes.mesh import triangle_mesh
from bezier_filters.meshes.prepared_mesh import prepare_mesh
from bezier_filters.smoothing.normal_filter import UPDATE_ROUNDS, filter_normals, move_to_normals, noisy_normals
from bezier_filters.surfaces import sphere


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
    moves = move_to_normals(prepare_mesh(mesh), normals.astype(np.float32), movable)
    assert np.abs(noisy + moves - expected).max() < 0.01 * np.abs(expected - noisy).max()
    assert not moves[~movable].any()


def folded_sheet(angle, size=24):
    """A sheet of unit squares, folded along its middle by an angle, and its unit face normals."""
    vertices, faces = sheet(size, size)
    x = vertices[:, 0] - size // 2
    vertices[:, 0] = np.where(x > 0.0, np.cos(angle) * x, x)
    vertices[:, 2] = np.where(x > 0.0, -np.sin(angle) * x, 0.0)
    return vertices, faces, face_normals(vertices, faces)


def filtered(vertices, faces, noise, rounds, tolerance=2.0):
    """Normals of noisy vertices (n, 3) after some rounds, where samples of the noise have the same strength."""
    mesh = triangle_mesh(vertices + noise, faces)
    samples = noise.std() * np.random.default_rng(7).standard_normal((len(vertices), 6, 3))
    state = noisy_normals(prepare_mesh(mesh), mesh, samples.astype(np.float32))
    return filter_normals(state, rounds, tolerance).normals


def mean_angle_between(normals, others):
    """Degrees."""
    return np.degrees(np.arccos(np.clip(np.einsum("ij,ij->i", normals, others), -1.0, 1.0))).mean()


def test_a_plane_becomes_flat_again():
    vertices, faces, normals = folded_sheet(0.0)
    noise = 0.1 * np.random.default_rng(0).standard_normal(vertices.shape)
    before, after = (mean_angle_between(filtered(vertices, faces, noise, k), normals) for k in (0, 16))
    assert before > 8.0
    assert after < 0.15 * before
    np.testing.assert_allclose(filtered(vertices, faces, 0.0 * noise, 16), normals, atol=1e-6)


@pytest.mark.parametrize("degrees", [60.0, 90.0])
def test_an_edge_survives_the_noise_of_its_sides(degrees):
    """Faces beside it keep the normals of their side, of which noise is removed as elsewhere."""
    vertices, faces, normals = folded_sheet(np.radians(degrees))
    noise = 0.1 * np.random.default_rng(0).standard_normal(vertices.shape)
    is_beside = np.abs(np.linalg.norm(vertices[faces].mean(axis=1)[:, [0, 2]], axis=1)) < 1.0
    for chosen in (is_beside, ~is_beside):
        before, after = (
            mean_angle_between(filtered(vertices, faces, noise, k)[chosen], normals[chosen]) for k in (0, 16)
        )
        assert before > 8.0
        assert after < 0.3 * before


def test_planes_through_the_centres_of_faces_are_reached():
    """Vertices off a plane come back to it where they follow its normal, and stay where they may not move."""
    vertices, faces, normals = folded_sheet(0.0)
    noise = np.array([0.0, 0.0, 0.1]) * np.random.default_rng(0).standard_normal((len(vertices), 1))
    mesh = triangle_mesh(vertices + noise, faces)
    movable = np.random.default_rng(1).random(len(vertices)) < 0.9
    moves = move_to_normals(prepare_mesh(mesh), normals.astype(np.float32), movable)
    assert not moves[~movable].any()
    assert not moves[:, :2].any()
    turned = face_normals(mesh.vertices + moves, faces)
    assert mean_angle_between(turned, normals) < 0.3 * mean_angle_between(face_normals(mesh.vertices, faces), normals)
