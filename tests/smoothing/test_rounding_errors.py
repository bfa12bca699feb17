"""Errors of rounding as probes, and as bounds of the surfaces that a mask allows."""

import numpy as np
import pytest
from scale_cases import save_arrays

from bezier_filters import smooth, triangle_mesh
from bezier_filters.meshes.prepared_mesh import prepare_mesh
from bezier_filters.noise.rounded_coordinates import rounding_noise
from bezier_filters.noise.rounding import Rounding
from bezier_filters.sampling.mesh_parts import whole_mesh
from bezier_filters.scale import smooth_file
from bezier_filters.scale.source import open_source
from bezier_filters.smoothing.laplacian import umbrella_laplacian
from bezier_filters.smoothing.rounding_errors import limit_to_steps, project_on_rounding, rounding_errors
from bezier_filters.surfaces import sphere
from stairs import ball_mask, mask_boundary, terrain


def rms(values):
    return float(np.sqrt(np.square(values).mean()))


def errors_of(vertices, faces, rounding=None):
    mesh = prepare_mesh(triangle_mesh(vertices, faces))
    part = whole_mesh(mesh)
    found = rounding or rounding_noise(mesh).rounding
    return mesh, rounding_errors(part, found, umbrella_laplacian(part, "free"), mesh.mean_edge)


def test_drawn_errors_of_heights_have_the_size_of_the_true_ones():
    vertices, faces, _, _ = terrain(1.0)
    exact, _, _, _ = terrain(0.0)
    _, errors = errors_of(vertices, faces)
    drawn = errors.draw(20) * errors.sigma[:, np.newaxis]
    normals = prepare_mesh(triangle_mesh(exact, faces)).planes.normals
    assert rms(drawn) == pytest.approx(rms((vertices - exact)[:, 2] * normals[:, 2]), rel=0.05)


@pytest.mark.parametrize("spacing", [(1.0, 1.0, 1.0), (1.0, 1.0, 3.0)])
def test_standard_deviations_of_a_mask_are_those_of_its_errors(spacing):
    vertices, faces = ball_mask(12, spacing)
    mesh, errors = errors_of(vertices, faces)
    assert rms(errors.sigma) == pytest.approx(rms(np.linalg.norm(vertices, axis=1) - 12.0), rel=0.05)
    gain, inflation = errors.calibrate(mesh.adjacency.vertices)
    assert 0.3 < gain < 1.0
    assert 1.0 < inflation < 4.0
    np.testing.assert_array_equal(errors.draw(2, first=1), errors.draw(3)[:, 1:])


def test_points_are_limited_to_what_rounding_allows():
    ball = sphere(resolution=16)
    step = 0.05
    vertices = np.round(ball.vertices / step) * step
    mesh, rounding = prepare_mesh(triangle_mesh(vertices, ball.faces)), Rounding(np.full(3, step))
    inside = limit_to_steps(mesh, ball.vertices, rounding)
    assert np.abs(inside - ball.vertices).max() < 0.1 * step  # normals of a mesh are not those of the ball
    outside = limit_to_steps(mesh, 1.2 * ball.vertices, rounding)
    assert np.linalg.norm(outside - vertices, axis=1).max() < 2.0 * step
    same = project_on_rounding(mesh, inside, rounding, lambda points: points)
    np.testing.assert_allclose(same, inside, atol=0.01 * step)


@pytest.mark.parametrize(
    ("spacing", "most"),
    [((1.0, 1.0, 1.0), 0.2), ((1.0, 1.0, 3.0), 0.3), ((1.0, 1.0, 5.0), 0.5), ((1.0, 2.0, 1.0), 0.3)],
)
def test_masks_of_any_spacing_are_smoothed(spacing, most):
    vertices, faces = ball_mask(12, spacing)
    result = smooth(vertices, faces)
    assert rms(np.linalg.norm(result.vertices, axis=1) - 12.0) < most * rms(np.linalg.norm(vertices, axis=1) - 12.0)
    assert result.volume_ratio == pytest.approx(1.0, rel=1e-6)
    assert result.new_bad_faces == 0


@pytest.mark.parametrize("spacing", [(1.0, 1.0, 1.0), (1.0, 1.0, 3.0)])
def test_a_vertex_without_faces_changes_nothing(spacing):
    vertices, faces = ball_mask(12, spacing)
    more = smooth(np.vstack([vertices, [[0.1, 0.2, 0.3]]]), faces).vertices
    assert rms(np.linalg.norm(more[:-1], axis=1) - 12.0) < 0.5 * rms(np.linalg.norm(vertices, axis=1) - 12.0)
    np.testing.assert_array_equal(more[-1], [0.1, 0.2, 0.3])


def test_edges_of_a_turned_box_are_kept():
    axes = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    half = np.array([12.0, 9.0, 6.0])

    def outside(points):
        return (np.abs(points @ axes) - half).max(axis=-1)

    vertices, faces = mask_boundary(lambda x: outside(x) <= 0.0, (17, 17, 17))
    assert rms(outside(smooth(vertices, faces).vertices)) < 0.5 * rms(outside(vertices))


def test_a_turned_mask_is_smoothed_as_well():
    vertices, faces = ball_mask(10, (1.0, 1.0, 3.0))
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    found = (smooth(0.37 * vertices @ turn + 5.0, faces).vertices - 5.0) @ turn.T / 0.37
    for points in (found, smooth(vertices, faces).vertices):  # axes in another order have other random shifts
        assert rms(np.linalg.norm(points, axis=1) - 10.0) < 0.4 * rms(np.linalg.norm(vertices, axis=1) - 10.0)


def test_a_vessel_of_three_voxels_is_smoothed_and_does_not_shrink():
    axis = np.array([0.3, 0.5, 0.8]) / np.linalg.norm([0.3, 0.5, 0.8])

    def distance(points):
        along = np.clip(points @ axis, -12.0, 12.0)
        return np.linalg.norm(points - along[..., np.newaxis] * axis, axis=-1)

    vertices, faces = mask_boundary(lambda x: distance(x) <= 1.5, (10, 10, 14))
    result = smooth(vertices, faces)
    assert rms(distance(result.vertices) - 1.5) < 0.75 * rms(distance(vertices) - 1.5)
    assert distance(result.vertices).min() > 0.8
    assert result.volume_ratio == pytest.approx(1.0, rel=1e-6)


def test_tiles_smooth_a_mask_as_memory(tmp_path):
    vertices, faces = ball_mask(15, (1.0, 1.0, 3.0))
    report = smooth_file(
        save_arrays(tmp_path, vertices, faces), tmp_path / "out.ply", tile_vertices=768, scheduler="synchronous"
    )
    assert report["tiles"] > 1
    expected = smooth(vertices, faces)
    found = open_source(tmp_path / "out.ply").vertices(0, len(vertices))
    apart = np.linalg.norm(found - expected.vertices, axis=1) / expected.noise_before
    assert apart.max() <= 0.01
    assert rms(apart) <= 0.001
