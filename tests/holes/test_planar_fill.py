import numpy as np
import pytest
from hole_cases import assert_filled, sheet, without_faces_near, without_squares

from bezier_filters import fill_holes
from bezier_filters.holes.hole_detection import find_holes
from bezier_filters.holes.influence_region import influence_region
from bezier_filters.holes.planar_fill import _frame, paper_fill
from bezier_filters.meshes.adjacency import vertex_adjacency
from bezier_filters.meshes.mesh import triangle_mesh
from bezier_filters.patches.fitting import PatchFit, fit_patch
from bezier_filters.surfaces import cylinder, sphere, torus, waves


def hole_around(vertices, faces, rings=2):
    mesh = triangle_mesh(vertices, faces)
    adjacency = vertex_adjacency(mesh)
    hole = next(h for h in find_holes(mesh, adjacency) if not h.is_outer_rim)
    return influence_region(mesh, adjacency, hole.loops, rings)


def test_a_plane_is_filled_with_its_delaunay_triangulation():
    vertices, faces = sheet(10, 10)
    faces = without_squares(vertices, faces, lambda x, y: (abs(x - 5) < 2) & (abs(y - 5) < 3))
    result = fill_holes(vertices, faces, "paper")
    assert_filled(vertices, faces, result)
    assert result.holes[1].method == "paper"
    assert np.abs(result.vertices[len(vertices) :, 2]).max() < 1e-9


def test_the_fill_is_the_patch_plus_what_the_rim_asks_for():
    """A saddle, which the patch reproduces with alpha = 1: no residual, so no correction."""
    vertices, faces = sheet(12, 12)
    vertices = (vertices - 6.0) / 6.0
    x, y, _ = vertices.T
    vertices[:, 2] = x * x - y * y + x * y
    faces = without_faces_near(vertices, faces, np.zeros(3), 0.6)
    fill = paper_fill(hole_around(vertices, faces), 1.0)
    x, y, z = fill.points[fill.rim_count :].T
    assert len(z) > 5
    np.testing.assert_allclose(z, x * x - y * y + x * y, atol=1e-9)


def test_corrections_are_no_larger_than_the_residuals():
    ball = sphere(resolution=16)
    faces = without_faces_near(ball.vertices, ball.faces, np.array([0.0, 0.0, 1.0]), 0.6)
    around = hole_around(ball.vertices, faces)
    fill = paper_fill(around, 0.8)
    origin, axes = _frame(around)
    patch = fit_patch(around.vertices, origin, axes, PatchFit(3, 0.8, "paper"))

    def height(points):
        local = (points - origin) @ axes.T
        lifted = patch.evaluate(*patch.rectangle.parameters(local[:, 0], local[:, 1]))
        return local[:, 2] - (lifted - origin) @ axes[2]

    residuals, corrections = height(around.vertices[: around.rim_count]), height(fill.points[fill.rim_count :])
    assert np.abs(residuals).max() > 1e-4
    assert np.abs(corrections).max() <= 1.1 * np.abs(residuals).max()


@pytest.mark.parametrize(
    ("shape", "center", "radius", "error"),
    [
        (sphere(resolution=16), (0, 0, 1), 0.5, 0.02),
        (torus(resolution=24), (1.4, 0, 0), 0.25, 0.02),
        (waves(resolution=40), (0, 0, 0), 0.4, 0.05),
    ],
)
def test_smooth_surfaces_are_continued_roughly(shape, center, radius, error):
    center = shape.vertices[np.argmin(np.linalg.norm(shape.vertices - np.array(center), axis=1))]
    faces = without_faces_near(shape.vertices, shape.faces, center, radius)
    result = fill_holes(shape.vertices, faces, "paper")
    assert_filled(shape.vertices, faces, result)
    filled = [hole for hole in result.holes if hole.filled]
    assert [hole.method for hole in filled] == ["paper"]
    new = result.vertices[len(shape.vertices) :]
    removed = np.setdiff1d(np.arange(len(shape.vertices)), np.unique(faces))
    nearest = np.linalg.norm(new[:, np.newaxis] - shape.vertices[removed], axis=2)
    edge = np.linalg.norm(np.diff(shape.vertices[shape.faces[:, :2]], axis=1), axis=2).mean()
    assert nearest.min(axis=1).max() < edge + error


def test_rims_that_do_not_project_take_another_way_and_say_so():
    tube = cylinder()
    result = fill_holes(tube.vertices, tube.faces, "paper")
    assert_filled(tube.vertices, tube.faces, result)
    assert all(hole.method != "paper" and hole.reason.startswith("paper: ") for hole in result.holes)
