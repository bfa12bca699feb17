from pathlib import Path

import numpy as np
import pytest
from hole_cases import assert_filled, hole_around, sheet, without_faces_near, without_squares
from plyfile import PlyData
from scipy.spatial import Delaunay

from bezier_filters import fill_holes
from bezier_filters.errors import InvalidParameterError
from bezier_filters.holes.planar_fill import _frames, lagrange_displacement, paper_fill
from bezier_filters.patches.patch_fit import PatchFit, fit_patch
from bezier_filters.surfaces import cylinder, sphere, torus, waves


def test_a_plane_is_filled_with_its_delaunay_triangulation():
    vertices, faces = sheet(10, 10)
    faces = without_squares(vertices, faces, lambda x, y: (abs(x - 5) < 2) & (abs(y - 5) < 3))
    result = fill_holes(vertices, faces, "paper")
    assert_filled(vertices, faces, result)
    assert result.holes[1].method == "paper"
    assert np.abs(result.vertices[len(vertices) :, 2]).max() < 1e-9


@pytest.mark.parametrize("seed", range(5))
def test_without_new_vertices_a_fill_is_the_delaunay_triangulation_of_the_rim(seed):
    """Of a convex rim, which has only one."""
    rng = np.random.default_rng(seed)
    n = 30
    angles = 2.0 * np.pi * (np.arange(n) + rng.uniform(-0.4, 0.4, n)) / n
    rings = [(1.0 + 0.3 * k) * np.column_stack([2.0 * np.cos(angles), np.sin(angles), 0.0 * angles]) for k in range(5)]
    i = np.arange(4 * n)
    after = i - i % n + (i + 1) % n
    faces = np.vstack([np.column_stack([i, i + n, after]), np.column_stack([after, i + n, after + n])])
    vertices = np.vstack(rings)
    result = fill_holes(vertices, faces, "paper", refine=False)
    assert_filled(vertices, faces, result)
    hole = next(hole for hole in result.holes if hole.filled)
    assert (hole.method, len(hole.new_vertices)) == ("paper", 0)
    expected = Delaunay(vertices[:n, :2]).simplices
    new = result.faces[hole.new_faces.start :]
    assert sorted(np.sort(new, axis=1).tolist()) == sorted(np.sort(expected, axis=1).tolist())


def test_without_new_vertices_only_curves_through_the_hole_have_some():
    """The two of the fan, whose hole three patches fill."""
    vertices, faces = fan_with_hole()
    result = fill_holes(vertices, faces, "paper", refine=False)
    assert_filled(vertices, faces, result)
    (hole,) = result.holes
    assert (hole.method, hole.parts) == ("paper", 3)
    assert np.isin(hole.new_vertices, hole.creases).all()


def test_only_the_papers_method_does_without_new_vertices():
    ball = sphere(resolution=4)
    with pytest.raises(InvalidParameterError, match="refine: method='auto' always refines"):
        fill_holes(ball.vertices, ball.faces, refine=False)


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
    origin, axes = next(_frames(around))
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
    x, y, z = tube.vertices[tube.faces].mean(axis=1).T
    faces = tube.faces[~((np.abs(np.arctan2(y, x)) < 2.5) & (np.abs(z) < 0.5))]  # most of the way around
    result = fill_holes(tube.vertices, faces, "paper", holes=[1])
    assert_filled(tube.vertices, faces, result)
    assert all(hole.method != "paper" and hole.reason.startswith("paper: ") for hole in result.holes if hole.filled)


def fan_with_hole():
    """The sample mesh whose hole reaches across both curved edges of a wall."""
    data = PlyData.read(Path(__file__).parents[2] / "sample_meshes" / "fan.ply")
    vertices = np.stack([data["vertex"][axis] for axis in "xyz"], axis=1)
    return vertices, np.stack(data["face"]["vertex_indices"]).astype(np.int32)


def test_curves_cut_a_hole_into_parts_with_a_patch_each():
    vertices, faces = fan_with_hole()
    result = fill_holes(vertices, faces, "paper")
    assert_filled(vertices, faces, result)
    (hole,) = result.holes
    assert (hole.method, hole.parts) == ("paper", 3)
    edge = np.linalg.norm(vertices[faces[:, 0]] - vertices[faces[:, 1]], axis=1).mean()
    x, y, z = result.vertices[len(vertices) :].T
    off = np.abs([np.hypot(x, y) - 1.0, z, z - 0.4])
    assert off.min(axis=0).max() < 0.2 * edge
    # the curves are the edges of the wall: near it and near its top or bottom
    wall, *ends = np.abs([np.hypot(*result.vertices.T[:2]) - 1.0, result.vertices[:, 2], result.vertices[:, 2] - 0.4])
    on_curves = np.unique(hole.creases)
    assert len(on_curves) > 12
    assert max(wall[on_curves].max(), np.min(ends, axis=0)[on_curves].max()) < 0.05 * edge
    (alone,) = fill_holes(vertices, faces, "paper", creases=False).holes
    assert alone.parts == 1


def test_each_part_is_the_patch_of_its_own_side():
    """Two planes meet at a right angle; patches reproduce planes, and the curve between them is straight."""
    vertices, faces = sheet(12, 12)
    vertices = vertices.astype(np.float64)
    upright = vertices[:, 0] > 6.0
    vertices[upright] = np.column_stack([np.full(upright.sum(), 6.0), vertices[upright, 1], 6.0 - vertices[upright, 0]])
    faces = without_faces_near(vertices, faces, np.array([6.0, 6.0, 0.0]), 2.5)
    result = fill_holes(vertices, faces, "paper")
    (hole,) = [hole for hole in result.holes if hole.filled]
    assert (hole.method, hole.parts) == ("paper", 2)
    x, _, z = result.vertices[len(vertices) :].T
    assert np.minimum(np.abs(x - 6.0), np.abs(z)).max() < 1e-9


def lagrange(flat, first, place, shift):
    """The paper's formula at one place, as it is printed."""
    total = np.zeros(3)
    for i in range(first):
        weight = 1.0
        for j in range(first):
            if j != i:
                weight *= (place[0] - flat[j, 0]) * (place[1] - flat[j, 1])
                weight /= (flat[i, 0] - flat[j, 0]) * (flat[i, 1] - flat[j, 1])
        total += weight * shift[i]
    return total


def test_lagranges_correction_is_the_printed_formula():
    rng = np.random.default_rng(0)
    flat, shift = rng.uniform(size=(20, 2)), rng.standard_normal((6, 3))
    found = lagrange_displacement(flat, shift, 6)
    np.testing.assert_allclose(found[:6], shift, atol=1e-12)
    np.testing.assert_allclose(found, [lagrange(flat, 6, place, shift) for place in flat], rtol=1e-9)


def test_in_pieces_it_is_that_formula_with_the_points_of_each_piece():
    rng = np.random.default_rng(1)
    flat, shift = rng.uniform(size=(30, 2)) * [10.0, 1.0], rng.standard_normal((8, 3))
    found = lagrange_displacement(flat, shift, 4)
    middle = np.median(flat[:8, 0])
    for left in (True, False):
        own = np.flatnonzero((flat[:8, 0] < middle) == left)
        places = np.flatnonzero((flat[:, 0] < middle) == left)
        expected = [lagrange(flat[own], 4, flat[place], shift[own]) for place in places]
        np.testing.assert_allclose(found[places], expected, rtol=1e-9)


def test_points_that_share_a_parameter_make_it_infinite_and_many_are_cut_apart():
    shared = np.array([[0.0, 0.0], [0.0, 1.0], [0.5, 0.5]])
    assert not np.isfinite(lagrange_displacement(shared, np.ones((2, 3)), 2)[2]).any()
    same = np.zeros((6, 2))  # cannot be cut
    assert not np.isfinite(lagrange_displacement(same, np.ones((6, 3)), 4)).any()


@pytest.mark.parametrize("correction", ["lagrange", "lagrange_pieces"])
def test_small_uneven_holes_can_be_corrected_as_printed(correction):
    """A triangle's rim has no parameter twice; where it explodes another fill is taken, and said."""
    ball = sphere(resolution=12, jitter=0.3)
    faces = np.delete(ball.faces, 100, axis=0)
    result = fill_holes(ball.vertices, faces, "paper", correction=correction)
    assert_filled(ball.vertices, faces, result)
    assert result.holes[0].method == "paper"
    vertices, faces = fan_with_hole()
    (hole,) = fill_holes(vertices, faces, "paper", correction=correction).holes
    assert hole.method != "paper"
    assert hole.reason.startswith("paper: ")


def test_unknown_corrections_are_refused():
    ball = sphere(resolution=4)
    with pytest.raises(InvalidParameterError, match="correction: got 'soap'"):
        fill_holes(ball.vertices, ball.faces, "paper", correction="soap")
