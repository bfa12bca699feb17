"""Smooth fills continue the surface around them."""

import numpy as np
import pytest
from hole_cases import assert_filled, sheet, without_faces_near, without_squares
from surface_cases import area_vectors, corner_angles

from bezier_filters import fill_holes
from bezier_filters.estimation.estimate import estimate_vertex_geometry
from bezier_filters.holes.hole_detection import find_holes
from bezier_filters.holes.influence_region import influence_regions
from bezier_filters.holes.smooth_fill import fit_surrounding_surface
from bezier_filters.meshes.mesh import triangle_mesh
from bezier_filters.meshes.prepared_mesh import prepare_mesh
from bezier_filters.surfaces import cylinder, sphere, torus, waves

TOP = np.array([0.0, 0.0, 1.0])


def new_points(result, vertices):
    return result.vertices[len(vertices) :]


def new_faces(result, faces):
    return result.faces[len(faces) :]


@pytest.mark.parametrize(("radius", "error"), [(0.3, 5e-5), (0.8, 5e-4), (1.3, 2e-2)])
def test_a_sphere_is_continued(radius, error):
    ball = sphere(resolution=24)
    faces = without_faces_near(ball.vertices, ball.faces, TOP, radius)
    result = fill_holes(ball.vertices, faces)
    assert_filled(ball.vertices, faces, result)
    assert [hole.method for hole in result.holes] == ["surface"]
    assert np.abs(np.linalg.norm(new_points(result, ball.vertices), axis=1) - 1.0).max() < error
    assert result.holes[0].rim_dihedral < 4.0


@pytest.mark.parametrize("center", [(1.4, 0, 0), (0.6, 0, 0), (1.0, 0, 0.4)])
def test_a_torus_is_continued(center):
    shape = torus(resolution=24)
    faces = without_faces_near(shape.vertices, shape.faces, np.array(center), 0.3)
    result = fill_holes(shape.vertices, faces)
    assert_filled(shape.vertices, faces, result)
    x, y, z = new_points(result, shape.vertices).T
    assert np.abs(np.hypot(np.hypot(x, y) - 1.0, z) - 0.4).max() < 5e-3


def surface_around_hole(vertices, faces, noisy):
    mesh = prepare_mesh(triangle_mesh(vertices, faces))
    (hole,) = (hole for hole in find_holes(mesh) if not hole.is_outer_rim)
    (region,) = influence_regions(mesh, [hole.loops])
    normals = estimate_vertex_geometry(vertices, faces).normals[region.ids]
    return fit_surrounding_surface(region, normals, noisy=noisy)


@pytest.mark.parametrize("noisy", [False, True])
def test_the_surface_does_not_depend_on_the_numbering(noisy):
    rng = np.random.default_rng(1)
    sampled = waves(resolution=40, jitter=0.3)
    vertices, size = sampled.vertices, 0.6
    faces = without_faces_near(vertices, sampled.faces, vertices.mean(axis=0), size)
    number = rng.permutation(len(vertices))
    shuffled = np.empty_like(vertices)
    shuffled[number] = vertices
    inside = vertices[np.linalg.norm(vertices - vertices.mean(axis=0), axis=1) < size]
    first = surface_around_hole(vertices, faces, noisy)
    second = surface_around_hole(shuffled, rng.permutation(number[faces]), noisy)
    for ours, other in zip(first.values_and_gradients(inside), second.values_and_gradients(inside), strict=True):
        np.testing.assert_allclose(ours, other, rtol=0, atol=5e-5)


def test_new_triangles_are_like_those_around():
    surface = waves(resolution=50)
    faces = without_faces_near(surface.vertices, surface.faces, surface.vertices.mean(axis=0), 0.4)
    result = fill_holes(surface.vertices, faces)
    assert_filled(surface.vertices, faces, result)
    old = np.linalg.norm(area_vectors(surface.vertices, surface.faces), axis=1).mean()
    areas = np.linalg.norm(area_vectors(result.vertices, new_faces(result, faces)), axis=1)
    assert 0.7 < areas.mean() / old < 1.6
    assert corner_angles(result.vertices, new_faces(result, faces)).min() > 12.0


def test_plane_and_tube_are_continued_exactly():
    vertices, faces = sheet(12, 12)
    open_sheet = without_squares(vertices, faces, lambda x, y: np.hypot(x - 6, y - 6) < 3)
    result = fill_holes(vertices, open_sheet)
    assert_filled(vertices, open_sheet, result)
    assert np.abs(new_points(result, vertices)[:, 2]).max() < 1e-9
    assert (area_vectors(result.vertices, new_faces(result, open_sheet))[:, 2] > 0.0).all()
    tube = cylinder(resolution=48)
    open_tube = without_faces_near(tube.vertices, tube.faces, np.array([1.0, 0.0, 0.0]), 0.4)
    result = fill_holes(tube.vertices, open_tube, max_diameter=1.0)
    assert_filled(tube.vertices, open_tube, result)
    assert np.abs(np.hypot(*new_points(result, tube.vertices)[:, :2].T) - 1.0).max() < 1e-3


@pytest.mark.parametrize("noise", [0.02, 0.1, 0.3])
def test_noise_is_not_followed_into_the_hole(noise):
    ball = sphere(resolution=30)
    edge = np.linalg.norm(ball.vertices[ball.faces[:, 0]] - ball.vertices[ball.faces[:, 1]], axis=1).mean()
    shift = np.random.default_rng(4).normal(scale=noise * edge, size=len(ball.vertices))
    noisy = ball.vertices * (1.0 + shift[:, np.newaxis])
    faces = without_faces_near(ball.vertices, ball.faces, TOP, 0.3)
    result = fill_holes(noisy, faces)
    assert_filled(noisy, faces, result)
    error = np.linalg.norm(new_points(result, noisy), axis=1) - 1.0
    assert np.sqrt(np.square(error).mean()) < 0.8 * noise * edge
    assert result.noise == pytest.approx(noise * edge, rel=0.1)
