"""Where a surface ends in a plane the default fill is flat; elsewhere it continues the surface."""

import numpy as np
import pytest
from hole_cases import assert_filled, filled_hole
from scipy.spatial.transform import Rotation

from bezier_filters import fill_holes
from bezier_filters.surfaces import cylinder, sphere
from open_ends import BOLTS, bent_tube, edge_length, open_meshes, plate, revolved, sheet_with_holes

CASES = {case.name: case for case in open_meshes()}
CLOSED = [name for name, case in CASES.items() if case.expected == "flat"]


def volume(vertices, faces):
    return (
        np.einsum("ij,ij->i", vertices[faces[:, 0]], np.cross(vertices[faces[:, 1]], vertices[faces[:, 2]])).sum() / 6
    )


@pytest.mark.parametrize("name", CLOSED)
def test_flat_ends_get_exact_lids(name):
    case = CASES[name]
    result = fill_holes(case.vertices, case.faces)
    assert_filled(case.vertices, case.faces, result)
    assert {hole.method for hole in result.holes} == {"flat"}
    assert {hole.reason for hole in result.holes} == {""}
    new = result.vertices[len(case.vertices) :]
    assert case.distance(new).max(initial=0.0) < 1e-9


@pytest.mark.parametrize("name", CLOSED)
@pytest.mark.parametrize("noise", [pytest.param(0.05, marks=pytest.mark.slow), 0.1])
def test_lids_of_noisy_ends_are_flat(name, noise):
    """Their planes are estimated from the rim, so that they are nearer to the true ones than the rim."""
    case = CASES[name]
    edge = edge_length(case.vertices, case.faces)
    vertices = case.vertices + noise * edge * np.random.default_rng(1).standard_normal(case.vertices.shape)
    result = fill_holes(vertices, case.faces)
    assert {hole.method for hole in result.holes} == {"flat"}
    new = result.vertices[len(vertices) :]
    assert np.sqrt(np.square(case.distance(new)).mean()) <= 0.6 * noise * edge if len(new) else True


@pytest.mark.parametrize(
    "name", ["tube", "cup without its rim", "plate without its bottom", "sphere, cap of 30 degrees"]
)
@pytest.mark.parametrize("seed", range(2))
def test_numbering_and_pose_do_not_matter(name, seed):
    case, rng = CASES[name], np.random.default_rng(seed)
    order, turn = rng.permutation(len(case.vertices)), Rotation.random(random_state=seed).as_matrix()
    vertices = np.empty_like(case.vertices)
    vertices[order] = 1000.0 * case.vertices @ turn.T + 17.0
    faces = order[case.faces][rng.permutation(len(case.faces))].astype(np.int32)
    result = fill_holes(vertices, faces)
    assert {hole.method for hole in result.holes} == {case.expected}
    back = (result.vertices[len(vertices) :] - 17.0) @ turn / 1000.0
    assert case.distance(back).max(initial=0.0) < (1e-9 if case.expected == "flat" else 1e-2)


def test_caps_of_spheres_are_flat_from_sixty_degrees_on():
    """The faces at the rim are at 60 degrees to its plane then."""
    ring = np.linspace(0.0, np.pi, 61)
    for cap, method in [(45, "surface"), (54, "surface"), (66, "flat"), (90, "flat"), (105, "flat")]:
        kept = ring[: 61 - cap // 3]
        vertices, faces = revolved(np.sin(kept), -np.cos(kept), 60)
        assert filled_hole(fill_holes(vertices, faces)).method == method


def test_a_ragged_rim_is_no_flat_end():
    ball = sphere(resolution=16)
    kept = ball.faces[ball.vertices[ball.faces].mean(axis=1)[:, 2] < 0.1]
    assert filled_hole(fill_holes(ball.vertices, kept)).method == "surface"


def test_methods_are_chosen():
    tube = cylinder()
    lids = [fill_holes(tube.vertices, tube.faces, method).holes[0].method for method in ("auto", "flat", "surface")]
    assert lids == ["flat", "flat", "variational"]
    ball = sphere(resolution=16)
    kept = ball.faces[ball.vertices[ball.faces].mean(axis=1)[:, 2] < 0.8]
    rounded, flat = (fill_holes(ball.vertices, kept, method) for method in ("auto", "flat"))
    assert [filled_hole(rounded).method, filled_hole(flat).method] == ["surface", "flat"]
    heights = [filling.vertices[len(ball.vertices) :, 2].max() for filling in (rounded, flat)]
    rim = ball.vertices[filled_hole(flat).rim, 2]
    assert heights[0] > 0.98
    assert heights[1] <= rim.max()


def test_the_volume_of_a_vessel_is_that_between_planes():
    """By Pappus, between planes whose angle is `turn`, of circles of growing radius at a distance of 5."""
    vertices, faces = bent_tube()
    result = fill_holes(vertices, faces)
    along = np.linspace(0.0, 2.0, 2001)
    radii = 1.0 + 0.3 * along / 2.0
    polygon = 24 * np.sin(2.0 * np.pi / 24) / 2.0
    true = np.trapezoid(polygon * radii**2 * 5.0, along)
    assert abs(volume(result.vertices, result.faces)) == pytest.approx(true, rel=3e-3)


def test_walls_that_end_in_one_plane_bound_one_face():
    vertices, faces = plate(bottom=False, bolt_walls=True)
    (hole,) = fill_holes(vertices, faces).holes
    assert hole.islands == len(BOLTS)
    result = fill_holes(vertices, faces)
    area = 30.0 * 20.0 - sum(np.pi * r * r for _, _, r in BOLTS)
    corners = result.vertices[result.faces[len(faces) :]]
    lid = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum()
    assert lid == pytest.approx(area, rel=0.01)


def test_a_pin_in_a_bolt_hole_gets_its_own_lid():
    """Rims in one plane, one inside the other: a tube, its bore, and a pin in the bore."""
    parts = [cylinder(radius=r, length=2.0) for r in (3.0, 2.0, 1.0)]
    starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    faces = [
        (part.faces if k != 1 else part.faces[:, ::-1]) + start
        for k, (part, start) in enumerate(zip(parts, starts[:-1], strict=True))
    ]
    result = fill_holes(np.vstack([part.vertices for part in parts]), np.vstack(faces))
    assert sorted(hole.islands for hole in result.holes) == [0, 0, 1, 1]
    assert {hole.method for hole in result.holes} == {"flat"}


def test_circles_in_flat_sheets_stay_open():
    vertices, faces = sheet_with_holes()
    result = fill_holes(vertices, faces)
    assert result.filled == 0
    circles = [k for k, hole in enumerate(result.holes) if not hole.is_outer_rim]
    assert {result.holes[k].reason for k in circles} == {
        "a circle in an open sheet, as of a bolt hole; bolt_holes=True fills it, too"
    }
    assert fill_holes(vertices, faces, bolt_holes=True).filled == len(BOLTS)
    assert fill_holes(vertices, faces, holes=circles[:2]).filled == 2
    selected = np.zeros(len(vertices), dtype=bool)
    selected[result.holes[circles[0]].rim[0]] = True
    assert fill_holes(vertices, faces, selected=selected).filled == 1


def test_circles_in_closed_parts_are_filled():
    vertices, faces = plate(bottom=True, bolt_walls=False)
    assert fill_holes(vertices, faces).filled == 2 * len(BOLTS)


def test_circles_in_curved_sheets_are_filled():
    radii = np.linspace(0.2, 1.0, 17)
    vertices, faces = revolved(radii, 0.6 * radii**2, 32)
    assert fill_holes(vertices, faces).filled == 1
