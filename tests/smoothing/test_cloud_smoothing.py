"""Clouds without their noise: how far from the true surface, and how even."""

import numpy as np
import pytest
from command_line import run
from scipy.spatial import cKDTree

import bezier_filters as bf
from bezier_filters.errors import InvalidParameterError
from bezier_filters.surfaces import sphere


def cloud_of_sphere(count, seed=0):
    """Random points on the unit sphere, and their spacing."""
    points = np.random.default_rng(seed).normal(size=(count, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    return points, np.sqrt(8.0 * np.pi / (np.sqrt(3.0) * count))


def cloud_of_cube(count):
    """Random points on the cube of edge 2, their normals and their spacing."""
    random = np.random.default_rng(1)
    points = random.uniform(-1.0, 1.0, (count, 3))
    rows, axes = np.arange(count), random.integers(3, size=count)
    normals = np.zeros((count, 3))
    normals[rows, axes] = random.choice([-1.0, 1.0], count)
    points[rows, axes] = normals[rows, axes]
    return points, normals, np.sqrt(48.0 / (np.sqrt(3.0) * count))


def root_mean_square(values):
    return float(np.sqrt(np.square(values).mean()))


@pytest.mark.parametrize(("noise", "most"), [(0.1, 0.4), (0.4, 0.35)])
def test_noise_of_a_sphere_is_removed(noise, most):
    points, spacing = cloud_of_sphere(1500)
    noisy = points * (1.0 + noise * spacing * np.random.default_rng(2).normal(size=(1500, 1)))
    result = bf.smooth(noisy)
    left = root_mean_square(np.linalg.norm(result.vertices, axis=1) - 1.0)
    assert left < most * noise * spacing
    assert result.noise_before == pytest.approx(noise * spacing, rel=0.15)
    assert result.volume_ratio is None
    assert result.flipped_before == result.flipped_after == 0
    # along the normals: the directions from the centre stay
    turned = np.linalg.norm(np.cross(result.vertices, points), axis=1) / np.linalg.norm(result.vertices, axis=1)
    assert root_mean_square(turned) < 0.2 * noise * spacing


def test_clean_clouds_stay():
    points, _ = cloud_of_sphere(800)
    np.testing.assert_array_equal(bf.smooth(points, []).vertices, points)


def test_edges_of_a_cube_stay_sharp():
    """Points come nearer to the cube, also at its edges, where averaging would move them by a third of a spacing."""
    points, normals, spacing = cloud_of_cube(3000)
    noisy = points + 0.1 * spacing * normals * np.random.default_rng(2).normal(size=(3000, 1))
    moved = bf.smooth(noisy).vertices
    distance = np.abs(np.abs(moved).max(axis=1) - 1.0)
    assert root_mean_square(distance) < 0.6 * 0.1 * spacing
    at_edge = np.sort(np.abs(points), axis=1)[:, 1] > 1.0 - spacing
    assert root_mean_square(distance[at_edge]) < 0.1 * spacing


def test_borders_do_not_shrink():
    """A flat square keeps its sides."""
    flat = np.random.default_rng(3).uniform(-1.0, 1.0, (1200, 2))
    spacing = np.sqrt(8.0 / (np.sqrt(3.0) * 1200))
    noisy = np.column_stack([flat, 0.2 * spacing * np.random.default_rng(4).normal(size=1200)])
    moved = bf.smooth(noisy).vertices
    assert root_mean_square(moved[:, :2] - flat) < 0.02 * spacing
    assert root_mean_square(moved[:, 2]) < 0.3 * 0.2 * spacing


def test_relaxing_evens_the_gaps():
    """The nearest neighbours of random points are at distances that differ; sliding makes these more equal."""
    points, spacing = cloud_of_sphere(1500)
    noisy = points * (1.0 + 0.1 * spacing * np.random.default_rng(2).normal(size=(1500, 1)))

    def unevenness(cloud):
        gaps = cKDTree(cloud).query(cloud, k=2)[0][:, 1]
        return gaps.std() / gaps.mean()

    relaxed = bf.smooth(noisy, None, relax=True).vertices
    assert unevenness(relaxed) < 0.85 * unevenness(bf.smooth(noisy).vertices)
    assert root_mean_square(np.linalg.norm(relaxed, axis=1) - 1.0) < 0.5 * 0.1 * spacing


def test_points_project_onto_patches():
    points, spacing = cloud_of_sphere(1500)
    noisy = points * (1.0 + 0.2 * spacing * np.random.default_rng(2).normal(size=(1500, 1)))
    of_cloud, of_others = bf.project(noisy), bf.project(noisy, None, 1.2 * points[:100])
    assert root_mean_square(np.linalg.norm(of_cloud.points, axis=1) - 1.0) < 0.4 * 0.2 * spacing
    np.testing.assert_allclose(of_others.distances, 0.2, atol=0.4 * spacing)


def test_a_cloud_has_no_volume_to_keep():
    with pytest.raises(InvalidParameterError, match="keep_volume"):
        bf.smooth(cloud_of_sphere(100)[0], keep_volume=True)


def test_the_command_smooths_a_cloud(tmp_path):
    ball = sphere(resolution=12)
    noisy = ball.vertices * (1.0 + 0.01 * np.random.default_rng(0).normal(size=(len(ball.vertices), 1)))
    np.savetxt(tmp_path / "in.csv", noisy, delimiter=",", header="x,y,z", comments="")
    done = run("smooth", tmp_path / "in.csv", tmp_path / "out.csv")
    assert done.returncode == 0
    assert "noise" in done.stdout
    assert "flipped" not in done.stdout
    moved = np.loadtxt(tmp_path / "out.csv", delimiter=",", skiprows=1)[:, :3]
    assert root_mean_square(np.linalg.norm(moved, axis=1) - 1.0) < 0.5 * 0.01
