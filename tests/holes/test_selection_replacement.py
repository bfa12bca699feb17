"""Replaced selections, from truth: bumps of known volume on surfaces of known shape."""

import numpy as np
import pytest
from hole_cases import sheet, without_faces_near
from surface_cases import border_edges, directed_edges

from bezier_filters import InvalidMeshError, InvalidParameterError, fill_holes, replace_selection
from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.holes.selection_replacement import ReplacementResult
from bezier_filters.surfaces import cylinder, sphere, torus
from hole_jobs import HEIGHT, RADIUS, add_noise, bump, bumps, off_the_cube
from open_ends import edge_length


def moved_faces(before: FloatArray, after: FloatArray, faces: IntArray) -> BoolArray:
    """Faces with a vertex that differs."""
    return (before != after).any(axis=1)[faces].any(axis=1)


def assert_replaced(vertices: FloatArray, faces: IntArray, selected: BoolArray, result: ReplacementResult) -> None:
    """What is not selected stays bit for bit, no edge is open that was not, and no vertex is left without faces."""
    n, m = len(result.old_vertices), len(result.old_faces)
    np.testing.assert_array_equal(result.vertices[:n], vertices[result.old_vertices])
    np.testing.assert_array_equal(result.old_vertices[result.faces[:m]], faces[result.old_faces])
    gone = np.setdiff1d(np.arange(len(faces)), result.old_faces)
    replaced = [patch.old_faces for patch in result.patches if patch.replaced]
    np.testing.assert_array_equal(gone, np.sort(np.concatenate([*replaced, []])))
    np.testing.assert_array_equal(
        np.sort(np.concatenate([patch.old_faces for patch in result.patches])), np.flatnonzero(selected)
    )
    edges = directed_edges(result.faces)
    assert len(np.unique(edges, axis=0)) == len(edges)
    assert len(border_edges(result.faces)) == len(border_edges(faces))
    assert set(range(n, len(result.vertices))) <= set(result.faces.ravel().tolist())


@pytest.mark.parametrize("noise", [0.0, 0.1])
@pytest.mark.parametrize("name", ["sphere", "torus", "cylinder"])
def test_a_bump_is_removed_with_its_volume(name, noise):
    case = bumps()[name]
    faces, selected, edge = case.faces, case.selected, edge_length(case.vertices, case.faces)
    assert np.abs(case.distance(case.vertices)).max() < 1e-12
    noisy = add_noise(case.vertices + case.moves, faces, noise)
    result = replace_selection(noisy, faces, selected)
    assert_replaced(noisy, faces, selected, result)
    (patch,) = result.patches
    assert patch.hole.method == "surface"
    assert patch.removed_volume == pytest.approx(case.volume, rel=0.1 if noise else 0.01)
    assert patch.removed_height == pytest.approx(HEIGHT, abs=0.005 + 3.0 * noise * edge)
    assert patch.area == pytest.approx(np.pi * RADIUS**2, rel=0.3)  # and the faces at the rim
    errors = case.distance(result.vertices[len(result.old_vertices) :]) / edge
    assert np.abs(errors).max() < (0.3 if noise else 0.01)
    assert np.sqrt(np.square(errors).mean()) < (noise if noise else 0.005)
    assert edge_length(result.vertices, result.faces[len(result.old_faces) :]) == pytest.approx(edge, rel=0.2)


def test_the_volume_of_a_bump_on_a_sphere_is_that_of_the_integral():
    ball = sphere(resolution=64)
    heights = bump(ball.vertices, ball.normals, np.array([0.0, 0.0, 1.0]))
    result = replace_selection(
        ball.vertices + heights, ball.faces, moved_faces(ball.vertices, ball.vertices + heights, ball.faces)
    )
    angle = np.linspace(0.0, np.arccos(1.0 - RADIUS**2 / 2.0), 20_001)
    height = HEIGHT * np.square(1.0 - (2.0 - 2.0 * np.cos(angle)) / RADIUS**2)
    truth = np.trapezoid(2.0 * np.pi * np.sin(angle) * ((1.0 + height) ** 3 - 1.0) / 3.0, angle)
    assert result.patches[0].removed_volume == pytest.approx(truth, rel=0.01)
    (patch,) = result.patches
    assert patch.removed_height == pytest.approx(HEIGHT, rel=0.002)


def test_a_pit_and_a_bump_in_a_plane_are_measured_exactly():
    vertices, faces = sheet(24, 12)
    raised = vertices.copy()
    raised[(vertices[:, :2] == [6.0, 6.0]).all(axis=1), 2] = 0.75
    raised[(vertices[:, :2] == [18.0, 6.0]).all(axis=1), 2] = -0.5
    selected = moved_faces(vertices, raised, faces)
    result = replace_selection(raised, faces, selected)
    assert_replaced(raised, faces, selected, result)
    bump_, pit = sorted(result.patches, key=lambda patch: -patch.removed_volume)
    assert bump_.removed_volume == pytest.approx(0.75)  # six triangles of area 1/2 and a third of the height
    assert pit.removed_volume == pytest.approx(-0.5)
    assert (bump_.removed_height, pit.removed_height) == pytest.approx((0.75, -0.5))
    assert bump_.area == pit.area == pytest.approx(3.0)
    np.testing.assert_allclose(result.vertices[:, 2], 0.0, atol=1e-12)
    assert result.replaced == 2


@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_a_sharp_edge_goes_on_through_the_selection(noise):
    case = bumps()["edge of a block"]
    faces, selected, edge = case.faces, case.selected, edge_length(case.vertices, case.faces)
    noisy = add_noise(case.vertices + case.moves, faces, noise)
    result = replace_selection(noisy, faces, selected)
    assert_replaced(noisy, faces, selected, result)
    (patch,) = result.patches
    assert patch.hole.method == "creases"
    new = result.vertices[len(result.old_vertices) :]
    assert np.abs(off_the_cube(new)).max() < (0.5 * edge if noise else 1e-9)
    if not noise:
        assert patch.removed_volume == pytest.approx(case.volume, rel=1e-6)
    smooth = replace_selection(noisy, faces, selected, creases=False)
    assert np.abs(off_the_cube(smooth.vertices[len(smooth.old_vertices) :])).max() > 0.2 * edge


def test_the_result_does_not_depend_on_the_numbering():
    """Up to the triangulation of the fill, which begins at the first vertex of its rim."""
    surface = torus(resolution=48, jitter=0.2)
    bumpy = surface.vertices + bump(surface.vertices, surface.normals, np.array([1.4, 0.0, 0.0]))
    selected = moved_faces(surface.vertices, bumpy, surface.faces)
    result = replace_selection(bumpy, surface.faces, selected)
    rng = np.random.default_rng(0)
    order, face_order = rng.permutation(len(bumpy)), rng.permutation(len(surface.faces))
    other = replace_selection(bumpy[order], np.argsort(order)[surface.faces][face_order], selected[face_order])
    (one,), (two,) = result.patches, other.patches
    assert two.removed_volume == pytest.approx(one.removed_volume, rel=5e-3)
    assert two.removed_height == pytest.approx(one.removed_height, rel=0.01)
    assert len(two.hole.new_vertices) == pytest.approx(len(one.hole.new_vertices), rel=0.05)
    np.testing.assert_array_equal(np.sort(face_order[two.old_faces]), one.old_faces)


def test_the_fill_is_that_of_the_hole():
    """Noise and sharp edges of the selection itself do not count."""
    ball = sphere(resolution=24, jitter=0.2)
    bumpy = ball.vertices + bump(ball.vertices, ball.normals, np.array([0.0, 0.0, 1.0]))
    selected = moved_faces(ball.vertices, bumpy, ball.faces)
    rough = bumpy.copy()
    inside = np.setdiff1d(ball.faces[selected], ball.faces[~selected])
    rough[inside] += 0.05 * np.random.default_rng(1).standard_normal((len(inside), 3))
    one, other = (replace_selection(points, ball.faces, selected) for points in (bumpy, rough))
    np.testing.assert_array_equal(one.vertices, other.vertices)
    np.testing.assert_array_equal(one.faces, other.faces)
    filled = fill_holes(one.vertices[: len(one.old_vertices)], one.faces[: len(one.old_faces)])
    np.testing.assert_array_equal(filled.vertices, one.vertices)
    np.testing.assert_array_equal(filled.faces, one.faces)


def test_rings_add_the_foot_of_a_bump():
    ball = sphere(resolution=32)
    bumpy = ball.vertices + bump(ball.vertices, ball.normals, np.array([0.0, 0.0, 1.0]))
    selected = (np.linalg.norm(bumpy, axis=1)[ball.faces] > 1.05).all(axis=1)
    narrow, wide = (replace_selection(bumpy, ball.faces, selected, rings=rings) for rings in (0, 5))
    worst = [np.abs(np.linalg.norm(result.vertices, axis=1) - 1.0).max() for result in (narrow, wide)]
    assert worst[0] > 0.05
    assert worst[1] < 1e-3
    assert len(wide.patches[0].old_faces) > len(narrow.patches[0].old_faces)


def test_parts_that_cannot_be_replaced_stay_and_say_why():
    """A part at the border, a whole component, and a part that can be replaced."""
    vertices, faces = sheet(16, 8)
    block = np.array([[0.0, 0, 5], [1, 0, 5], [0, 1, 5], [0, 0, 6]])
    whole = len(vertices) + np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]], dtype=np.int32)
    vertices, faces = np.vstack([vertices, block]), np.vstack([faces, whole])
    x, y, z = vertices[faces].mean(axis=1).T
    selected = (z > 4.0) | (x < 2.0) | ((np.abs(x - 8.0) < 2.0) & (np.abs(y - 4.0) < 2.0))
    result = replace_selection(vertices, faces, selected)
    assert_replaced(vertices, faces, selected, result)
    reasons = {patch.hole.reason.partition(":")[0] for patch in result.patches if not patch.replaced}
    assert reasons == {
        "meets the border of the mesh",
        "every face of its component is selected, so nothing around it can be continued",
    }
    assert repr(result).endswith("1 of 3 patches replaced)")
    assert "meets the border" in result._repr_html_()


def test_a_part_whose_fills_all_intersect_stays_with_its_faces():
    """A wall through the plane of the hole, which a pyramid over the selection avoids."""
    vertices, faces = sheet(12, 12)
    vertices = vertices.copy()
    d = np.abs(vertices[:, :2] - 6.0).max(axis=1)
    vertices[:, 2] = np.maximum(3.0 - d, 0.0)
    pin = np.array([[5.9, 6.0, -1.0], [6.1, 6.0, -1.0], [6.0, 6.1, 1.0]])
    n = len(vertices)
    vertices, faces = np.vstack([vertices, pin]), np.vstack([faces, [[n, n + 1, n + 2], [n + 1, n, n + 2]]])
    selected = (vertices[faces][:, :, 2] > 0.0).any(axis=1) & (faces < n).all(axis=1)
    result = replace_selection(vertices, faces, selected)
    assert_replaced(vertices, faces, selected, result)
    (patch,) = result.patches
    assert not patch.replaced
    assert "every fill would cut other faces" in patch.hole.reason
    np.testing.assert_array_equal(result.vertices, vertices)
    np.testing.assert_array_equal(result.faces, faces)
    taken = replace_selection(vertices, faces, selected, intersecting=True)
    assert taken.patches[0].hole.self_intersections > 0


def test_a_ring_around_a_tube_becomes_a_band_and_not_two_lids():
    tube = cylinder(resolution=48, jitter=0.2)
    z = tube.vertices[:, 2] - tube.vertices[:, 2].mean()
    swollen = tube.vertices + tube.normals * 0.1 * np.square(np.maximum(1.0 - np.square(z / 0.3), 0.0))[:, np.newaxis]
    selected = moved_faces(tube.vertices, swollen, tube.faces)
    result = replace_selection(swollen, tube.faces, selected)
    assert_replaced(swollen, tube.faces, selected, result)
    (patch,) = result.patches
    assert patch.hole.islands == 1
    new = result.vertices[len(result.old_vertices) :]
    assert np.abs(np.hypot(new[:, 0], new[:, 1]) - 1.0).max() < 0.05 * edge_length(tube.vertices, tube.faces)


def test_non_manifold_edges_are_refused():
    vertices, faces = sheet(8, 8)
    fin = np.array([[4.0, 4.0, 1.0]])
    (first,) = np.flatnonzero((vertices[:, :2] == [4.0, 4.0]).all(axis=1))
    (second,) = np.flatnonzero((vertices[:, :2] == [5.0, 4.0]).all(axis=1))
    vertices, faces = np.vstack([vertices, fin]), np.vstack([faces, [[first, second, len(vertices)]]])
    selected = (np.abs(vertices[faces].mean(axis=1)[:, :2] - 4.0) < 1.2).all(axis=1)
    selected[-1] = False
    result = replace_selection(vertices, faces, selected)
    assert "meets edges of several faces" in result.patches[0].hole.reason
    np.testing.assert_array_equal(result.faces, faces)


def test_bad_input_is_refused_by_name():
    ball = sphere(resolution=4)
    none, some = np.zeros(len(ball.faces), dtype=bool), np.arange(len(ball.faces)) < 3
    for options, message in [
        ({"selected": none}, "no face is selected; select the faces"),
        ({"selected": some[1:]}, "selected: got bool of shape"),
        ({"selected": some.astype(int)}, "selected: got int64 of shape"),
        ({"rings": -1}, "rings: got -1, expected an integer from 0 to 100"),
        ({"method": "round"}, "method: got 'round'"),
        ({"noise": -1.0}, "noise: got -1.0"),
    ]:
        with pytest.raises(InvalidParameterError, match=message):
            replace_selection(ball.vertices, ball.faces, **{"selected": some} | options)
    with pytest.raises(InvalidMeshError, match="faces: got None"):
        replace_selection(ball.vertices, None, some)


def test_sizes_of_any_magnitude():
    ball = sphere(resolution=12)
    bumpy = ball.vertices + bump(ball.vertices, ball.normals, np.array([0.0, 0.0, 1.0]))
    selected = moved_faces(ball.vertices, bumpy, ball.faces)
    scale = 2.0**80
    small, large = (replace_selection(factor * bumpy, ball.faces, selected).patches[0] for factor in (1.0, scale))
    assert large.removed_volume == small.removed_volume * scale**3
    assert (large.removed_height, large.area) == (small.removed_height * scale, small.area * scale**2)


def test_holes_that_were_there_stay():
    ball = sphere(resolution=24)
    faces = without_faces_near(ball.vertices, ball.faces, np.array([0.0, 0.0, -1.0]), 0.3)
    bumpy = ball.vertices + bump(ball.vertices, ball.normals, np.array([0.0, 0.0, 1.0]))
    selected = moved_faces(ball.vertices, bumpy, faces)
    result = replace_selection(bumpy, faces, selected)
    assert result.replaced == 1
    assert len(border_edges(result.faces)) == len(border_edges(faces)) > 0
    assert len(result.old_vertices) == len(bumpy) - len(np.setdiff1d(faces[selected], faces[~selected]))
