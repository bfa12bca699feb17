"""Texture coordinates of fills: close to those of a known parametrisation, and where there is a seam, of neighbours."""

import numpy as np
import pytest
from hole_cases import sheet, without_faces_near, without_squares

from bezier_filters.holes.adjacent_rows import adjacent_faces
from bezier_filters.holes.hole_filling import fill_holes
from bezier_filters.holes.texture_continuation import Texture, continue_texture, wedge_coordinates
from bezier_filters.surfaces import sphere

FAR_AWAY = np.array([100.0, 0.0, 0.0])


def filled(vertices, faces, texture, **options):
    """Vertices and new faces of the mesh with filled holes, their texture, and that of the faces next to them."""
    result = fill_holes(vertices, faces, **options)
    new = result.faces[len(faces) :]
    like = adjacent_faces(result.vertices, faces, new)
    adjacent = wedge_coordinates(result.vertices[new], vertices[faces[like]], texture.coordinates[like])
    return result.vertices, new, continue_texture(result.vertices, faces, new, like, texture), adjacent


def one_image(coordinates):
    return Texture(coordinates, np.zeros(len(coordinates), np.int32))


def angles(points):
    """Longitude and latitude, as shares of their ranges."""
    x, y, z = points.T / np.linalg.norm(points, axis=1)
    return np.column_stack([0.5 + np.arctan2(y, x) / (2.0 * np.pi), np.arccos(z) / np.pi])


def punched_sheet():
    vertices, faces = sheet(12, 10)
    return vertices, without_squares(vertices, faces, lambda x, y: np.hypot(x - 6.0, y - 5.0) < 3.0)


def linear(points):
    return points[..., :2] @ np.array([[0.05, 0.01], [-0.02, 0.06]]) + [0.2, 0.1]


def test_linear_coordinates_are_continued_exactly():
    vertices, faces = punched_sheet()
    points, new, texture, _ = filled(vertices, faces, one_image(linear(vertices[faces])))
    assert len(points) > len(vertices)
    np.testing.assert_allclose(texture.coordinates, linear(points[new]), atol=1e-12)
    assert set(texture.images.tolist()) == {0}


@pytest.mark.parametrize(("radius", "error"), [(0.2, 0.0015), (0.4, 0.006), (0.6, 0.0125)])
def test_coordinates_are_close_to_those_of_the_parametrisation(radius, error):
    ball = sphere(resolution=24)
    faces = without_faces_near(ball.vertices, ball.faces, np.array([0.8, 0.2, 0.5]), radius)
    points, new, texture, adjacent = filled(ball.vertices, faces, one_image(angles(ball.vertices)[faces]))
    inner, truth = new >= len(ball.vertices), angles(points)[new]
    now, before = (
        np.sqrt((np.linalg.norm(found - truth, axis=2)[inner] ** 2).mean()) for found in (texture.coordinates, adjacent)
    )
    assert now < error
    assert before > 4.0 * now
    np.testing.assert_allclose(texture.coordinates[~inner], truth[~inner], atol=1e-12)


def test_every_vertex_of_a_fill_has_one_coordinate():
    ball = sphere(resolution=16)
    faces = without_faces_near(ball.vertices, ball.faces, np.array([0.8, 0.2, 0.5]), 0.4)
    _, new, texture, _ = filled(ball.vertices, faces, one_image(angles(ball.vertices)[faces]))
    first = np.unique(new, return_index=True)
    places = texture.coordinates.reshape(-1, 2)[first[1]]
    np.testing.assert_array_equal(texture.coordinates, places[np.searchsorted(first[0], new)])


def test_at_a_seam_faces_are_like_their_neighbours():
    """The hole on the seam is filled as before, the other one of the same mesh harmonically."""
    ball = sphere(resolution=16)
    faces = without_faces_near(ball.vertices, ball.faces, np.array([-0.9, 0.02, 0.3]), 0.4)
    faces = without_faces_near(ball.vertices, faces, np.array([0.8, 0.2, 0.5]), 0.4)
    coordinates = angles(ball.vertices)[faces]
    crosses = np.ptp(coordinates[..., 0], axis=1) > 0.5
    coordinates[crosses, :, 0] += coordinates[crosses, :, 0] < 0.5
    points, new, texture, adjacent = filled(ball.vertices, faces, one_image(coordinates))
    at_seam = points[new].mean(axis=1)[:, 0] < 0.0
    assert 0 < at_seam.sum() < len(new)
    np.testing.assert_array_equal(texture.coordinates[at_seam], adjacent[at_seam])
    np.testing.assert_allclose(texture.coordinates[~at_seam], angles(points)[new[~at_seam]], atol=0.02)


def test_where_images_meet_faces_show_that_of_their_neighbours():
    vertices, faces = punched_sheet()
    images = (vertices[faces].mean(axis=1)[:, 0] > 6.0).astype(np.int32)
    _, _, texture, adjacent = filled(vertices, faces, Texture(linear(vertices[faces]), images))
    np.testing.assert_array_equal(texture.coordinates, adjacent)
    assert set(texture.images.tolist()) == {0, 1}


def test_fills_with_islands_are_like_their_neighbours():
    """Charts of separate sheets lie anywhere in the texture."""
    vertices, faces = sheet(13, 13)
    faces = without_squares(
        vertices,
        faces,
        lambda x, y: (np.maximum(abs(x - 6.5), abs(y - 6.5)) < 4) & ~(np.maximum(abs(x - 6.5), abs(y - 6.5)) < 2),
    )
    coordinates = linear(vertices[faces])
    is_island = np.abs(vertices[faces].mean(axis=1)[:, :2] - 6.5).max(axis=1) < 2.0
    coordinates[is_island] += 3.0
    _, _, texture, adjacent = filled(vertices, faces, one_image(coordinates))
    np.testing.assert_array_equal(texture.coordinates, adjacent)


@pytest.fixture
def two_sheets():
    """A punched sheet, and a small one far away whose faces show the texture inside the hole."""
    vertices, faces = punched_sheet()
    small, small_faces = sheet(4, 4)
    where = linear(small + np.array([4.0, 3.0, 0.0]))[small_faces]
    both = np.vstack([vertices, small + FAR_AWAY])
    return both, np.vstack([faces, small_faces + len(vertices)]).astype(np.int32), linear(vertices[faces]), where


def test_texture_of_other_faces_is_not_shown(two_sheets):
    vertices, faces, coordinates, where = two_sheets
    texture = one_image(np.concatenate([coordinates, where]))
    _, _, found, adjacent = filled(vertices, faces, texture)
    np.testing.assert_array_equal(found.coordinates, adjacent)


def test_texture_of_other_images_does_not_matter(two_sheets):
    vertices, faces, coordinates, where = two_sheets
    images = np.repeat(np.array([0, 1], np.int32), [len(coordinates), len(where)])
    points, new, found, _ = filled(vertices, faces, Texture(np.concatenate([coordinates, where]), images))
    np.testing.assert_allclose(found.coordinates, linear(points[new]), atol=1e-12)
    assert set(found.images.tolist()) == {0}


def test_texture_that_is_shared_on_purpose_is_shown():
    """The two halves of a symmetric shape show one texture; a hole is in one of them."""
    vertices, faces = punched_sheet()
    whole, whole_faces = sheet(12, 10)
    both = np.vstack([vertices, whole + FAR_AWAY])
    coordinates = np.concatenate([linear(vertices[faces]), linear(whole[whole_faces])])
    every = np.vstack([faces, whole_faces + len(vertices)]).astype(np.int32)
    points, new, found, _ = filled(both, every, one_image(coordinates))
    np.testing.assert_allclose(found.coordinates, linear(points[new]), atol=1e-12)
