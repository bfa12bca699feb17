import re
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from hole_cases import sheet, without_faces_near, without_squares
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse.csgraph import connected_components

from bezier_filters.cli.console import FILLS
from bezier_filters.holes import fill_methods
from bezier_filters.holes.fill_choice import (
    MAX_INTERSECTING_FACES,
    FaceSet,
    _flatten_intersections,
    _intersecting_faces,
)
from bezier_filters.holes.fill_methods import FILL_METHODS, FillingMethod, box_groups
from bezier_filters.holes.hole_filling import fill_holes
from bezier_filters.holes.hole_report import HoleReport
from bezier_filters.holes.smooth_fill import Attempt, initial_fill
from bezier_filters.surfaces import block_with_sharp_edges, sphere, torus


@given(st.integers(0, 10**6), st.integers(0, 40))
def test_groups_are_what_boxes_that_meet_connect(seed, count):
    rng = np.random.default_rng(seed)
    low = rng.integers(0, 12, (count, 3))
    boxes = np.stack([low, low + rng.integers(0, 4, (count, 3))], axis=1).astype(float)
    low, high = boxes[:, 0], boxes[:, 1]
    meet = ((low[:, np.newaxis] <= high) & (high[:, np.newaxis] >= low)).all(axis=2)
    groups = box_groups(boxes)
    if count:
        assert len(groups) == connected_components(meet)[0]
    for group in groups:
        np.testing.assert_array_equal(group, np.sort(group))
    np.testing.assert_array_equal(np.sort(np.concatenate(groups)), np.arange(count))
    number = np.empty(count, dtype=int)
    for k, group in enumerate(groups):
        number[group] = k
    assert (number[:, np.newaxis] == number)[meet].all()


@pytest.mark.parametrize("holes", [3, 25])
def test_threads_do_not_change_a_mesh_with_holes_apart_and_together(holes):
    ball = sphere(resolution=24)
    rng = np.random.default_rng(1)
    centers = ball.vertices[rng.choice(len(ball.vertices), holes, replace=False)]
    middles = ball.vertices[ball.faces].mean(axis=1)
    kept = (np.linalg.norm(middles[:, np.newaxis] - centers, axis=2) > 0.12).all(axis=1)
    used, faces = np.unique(ball.faces[kept], return_inverse=True)
    vertices, faces = ball.vertices[used], faces.reshape(-1, 3)
    one, three = (fill_holes(vertices, faces, threads=threads) for threads in (1, 3))
    np.testing.assert_array_equal(one.vertices, three.vertices)
    np.testing.assert_array_equal(one.faces, three.faces)
    assert one.filled == len(one.holes)
    rows = np.concatenate([np.array(hole.new_faces) for hole in one.holes])
    np.testing.assert_array_equal(np.sort(rows), np.arange(len(faces), len(one.faces)))
    for hole in one.holes:
        inside = one.faces[hole.new_faces.start : hole.new_faces.stop]
        assert np.isin(inside, np.concatenate([hole.rim, np.array(hole.new_vertices)])).all()
    np.testing.assert_allclose(np.linalg.norm(one.vertices[len(vertices) :], axis=1), 1.0, atol=2e-3)


def fill_over_a_floor(places, depth=-2.0):
    """A flat fill of 16 x 16 squares at the height 1, with some vertices moved through a floor at 0."""
    points, faces = sheet(16, 16)
    inside = ((points[:, :2] > 0.0) & (points[:, :2] < 16.0)).all(axis=1)
    order = np.argsort(inside, kind="stable")
    floor = FaceSet(np.arange(1000, 1000 + len(points)), points * [1.0, 1.0, 0.0] + [0.3, 0.1, 0.0], faces)
    points[:, 2] = 1.0
    for x, y in places:
        points[(points[:, :2] == [x, y]).all(axis=1), 2] = depth
    fill = FaceSet(np.arange(len(points)), points[order], np.argsort(order)[faces].astype(np.int32))
    return fill, np.count_nonzero(~inside), floor


@pytest.mark.parametrize("places", [[(5, 5)], [(5, 5), (6, 6)], [(1, 1)]])
def test_a_fill_that_cuts_others_at_a_few_faces_is_flattened_there(places):
    fill, rim_count, floor = fill_over_a_floor(places)
    assert _intersecting_faces(fill, [floor]).any()
    freed, cuts = _flatten_intersections(fill, rim_count, [floor])
    assert cuts == 0
    np.testing.assert_allclose(freed.points[:, 2], 1.0)
    np.testing.assert_array_equal(freed.points[:rim_count], fill.points[:rim_count])
    far = np.linalg.norm(fill.points[:, :2] - 5.0, axis=1) > 7.0
    np.testing.assert_array_equal(freed.points[far & (fill.points[:, 2] == 1.0)], fill.points[far])


def test_a_fill_that_cuts_others_at_many_faces_stays_as_it_is():
    fill, rim_count, floor = fill_over_a_floor([(4, 4), (8, 8), (12, 12), (4, 12)])
    count = np.count_nonzero(_intersecting_faces(fill, [floor]))
    assert count > MAX_INTERSECTING_FACES
    kept, cuts = _flatten_intersections(fill, rim_count, [floor])
    assert kept is fill
    assert cuts == count


def test_a_rim_that_cuts_others_cannot_be_flattened():
    fill, rim_count, floor = fill_over_a_floor([(0, 5)])
    kept, cuts = _flatten_intersections(fill, rim_count, [floor])
    assert kept is fill
    assert cuts > 0


def test_the_angle_along_the_rim_is_that_of_the_result():
    """Also where the fill that is taken was flattened, as it is here."""
    vertices, faces = block_with_sharp_edges(resolution=12)
    result = fill_holes(vertices, without_faces_near(vertices, faces, np.array([-1 / 6, 0.5, 0.25]), 0.2641))
    (hole,) = result.holes
    corners = result.vertices[result.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    face_at = {(face[k - 1], face[k]): f for f, face in enumerate(result.faces.tolist()) for k in range(3)}
    edges = list(zip(hole.rim.tolist(), np.roll(hole.rim, -1).tolist(), strict=True))
    cosines = [normals[face_at[a, b]] @ normals[face_at[b, a]] for a, b in edges]
    assert hole.rim_dihedral == pytest.approx(np.degrees(np.arccos(np.clip(cosines, -1.0, 1.0))).mean(), rel=1e-6)


def test_the_table_has_all_methods():
    assert tuple(FILL_METHODS) == get_args(FillingMethod)


def test_every_kind_of_fill_is_described():
    tried = "".join(path.read_text() for path in Path(fill_methods.__file__).parent.glob("*.py"))
    kinds = set(re.findall(r'(?:Attempt\(|attempt, kind=)"(\w+)"', tried))
    assert kinds == set(FILLS)
    assert all(f'``"{kind}"``' in HoleReport.__doc__ for kind in kinds)


def test_a_further_method_is_a_function_and_a_line_in_the_table(monkeypatch):
    monkeypatch.setitem(FILL_METHODS, "soap", lambda task: iter([Attempt("soap", initial_fill(task.region, 1))]))
    vertices, faces = sheet(10, 10)
    faces = without_squares(vertices, faces, lambda x, y: (abs(x - 5) < 2) & (abs(y - 5) < 3))
    result = fill_holes(vertices, faces, "soap")
    assert [hole.method for hole in result.holes if hole.filled] == ["soap"]
    assert np.abs(result.vertices[:, 2]).max() < 1e-9


def test_smooth_surfaces_have_no_creases_in_noise():
    ring = torus(resolution=60)
    edge = np.linalg.norm(ring.vertices[ring.faces[:, 0]] - ring.vertices[ring.faces[:, 1]], axis=1).mean()
    rng = np.random.default_rng(0)
    centers = ring.vertices[ring.faces].mean(axis=1)
    places = ring.vertices[rng.choice(len(ring.vertices), 12, replace=False)]
    near = np.linalg.norm(centers[:, np.newaxis] - places, axis=2) < rng.uniform(1.5, 3.5, 12) * edge
    noisy = ring.vertices + 0.2 * edge * rng.standard_normal((len(ring.vertices), 1)) * ring.normals
    result = fill_holes(noisy, ring.faces[~near.any(axis=1)])
    assert {hole.method for hole in result.holes} <= {"surface", "flat"}
    added = result.vertices[len(noisy) :]
    big, small = 1.0, float(np.abs(ring.vertices[:, 2]).max())
    heights = np.hypot(np.hypot(added[:, 0], added[:, 1]) - big, added[:, 2]) - small
    assert np.sqrt(np.square(heights).mean()) < 0.1 * edge


@pytest.mark.parametrize("noise", [0.0, 0.002, 0.005, 0.015, 0.03, 0.1])
def test_sharp_edges_are_continued_under_weak_noise_too(noise):
    vertices, faces = block_with_sharp_edges(resolution=16)
    edge = np.linalg.norm(vertices[faces[:, 0]] - vertices[faces[:, 1]], axis=1).mean()
    corner = vertices.max(axis=0)
    middle = vertices[np.argmin(np.linalg.norm(vertices - [corner[0], corner[1], 0.0], axis=1))]
    holed = without_faces_near(vertices, faces, middle, 2.5 * edge)
    noisy = vertices + np.random.default_rng(0).normal(scale=noise * edge, size=vertices.shape)
    assert [hole.method for hole in fill_holes(noisy, holed).holes] == ["creases"]
