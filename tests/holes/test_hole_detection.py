from dataclasses import replace

import numpy as np
import pytest
from hole_cases import sheet, without_faces_near, without_squares
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from bezier_filters import boundary_loops, fill_holes, triangle_mesh, vertex_adjacency
from bezier_filters.holes.hole import Hole
from bezier_filters.holes.hole_detection import find_holes
from bezier_filters.holes.loops import simple_loops
from bezier_filters.meshes.half_edges import border_edges
from bezier_filters.meshes.prepared_mesh import prepare_mesh
from bezier_filters.surfaces import bumpy_star, cylinder, punched_patch, sphere


def holes_of(vertices, faces):
    mesh = triangle_mesh(vertices, faces)
    return find_holes(prepare_mesh(mesh))


def as_cycles(loops):
    """Loops as sets of directed edges, which do not depend on where a loop begins."""
    return {frozenset(zip(loop.tolist(), np.roll(loop, -1).tolist(), strict=True)) for loop in loops}


@pytest.mark.parametrize("make", [punched_patch, cylinder])
def test_borders_found_near_the_boundary_are_all(make):
    surface = make()
    mesh = triangle_mesh(surface.vertices, surface.faces)
    border = border_edges(mesh, vertex_adjacency(mesh).on_boundary)
    pairs = set(zip(border.start.tolist(), border.end.tolist(), strict=True))
    assert not border.non_manifold.any()
    assert pairs == frozenset().union(*as_cycles(boundary_loops(mesh)))


def test_turning_of_flat_loops_is_a_full_turn():
    vertices, faces = sheet(9, 9)
    faces = without_squares(vertices, faces, lambda x, y: (x > 3) & (x < 6) & (y > 3) & (y < 6))
    outer, hole = holes_of(vertices, faces)
    np.testing.assert_allclose([outer.turning, hole.turning], [2 * np.pi, -2 * np.pi], atol=1e-12)
    assert (outer.is_outer_rim, hole.is_outer_rim) == (True, False)
    assert (hole.edge_count, hole.perimeter, round(hole.diameter, 12)) == (12, 12.0, round(np.sqrt(18), 12))


@pytest.mark.parametrize(("height", "outer"), [(0.9, True), (0.3, False), (-0.5, False), (-0.9, False)])
def test_a_dome_has_a_rim_and_a_ball_has_a_hole(height, outer):
    """The total geodesic curvature of a parallel of the sphere at height z, seen from the cap above, is 2 pi z."""
    ball = sphere(resolution=20)
    faces = ball.faces[ball.vertices[ball.faces].mean(axis=1)[:, 2] > height]
    (loop,) = holes_of(ball.vertices, faces)
    assert loop.is_outer_rim == outer
    assert loop.turning == pytest.approx(2 * np.pi * height, abs=0.7)


def test_ends_of_a_tube_are_holes():
    tube = cylinder()
    ends = holes_of(tube.vertices, tube.faces)
    np.testing.assert_allclose([end.turning for end in ends], 0.0, atol=1e-9)
    assert not any(end.is_outer_rim for end in ends)


@pytest.mark.parametrize("seed", range(3))
def test_turning_is_what_gauss_and_bonnet_say(seed):
    """2 pi less the angle defects of the vertices inside, exactly, on any disk; flat or curved, rough or not."""
    rng = np.random.default_rng(seed)
    ball = bumpy_star(resolution=6, jitter=0.3)
    faces = without_faces_near(ball.vertices, ball.faces, rng.standard_normal(3), 0.7)
    vertices = ball.vertices + 0.02 * rng.standard_normal(ball.vertices.shape)
    (hole,) = holes_of(vertices, faces)
    angles = np.zeros(len(vertices))
    for k in range(3):
        tip, left, right = (vertices[faces[:, (k + j) % 3]] for j in range(3))
        u, v = left - tip, right - tip
        cosine = (u * v).sum(axis=1) / np.linalg.norm(u, axis=1) / np.linalg.norm(v, axis=1)
        np.add.at(angles, faces[:, k], np.arccos(cosine))
    inside = np.setdiff1d(faces, hole.rim)
    assert hole.turning == pytest.approx(2 * np.pi - (2 * np.pi - angles[inside]).sum(), abs=1e-9)


def test_rims_that_turn_by_half_a_turn_are_no_outer_rims_yet():
    rim = Hole((np.arange(3, dtype=np.int32),), np.pi, 1.0, 1.0)
    assert not rim.is_outer_rim
    assert replace(rim, turning=np.nextafter(np.pi, 4.0)).is_outer_rim


def test_rims_run_as_their_fill_does():
    vertices, faces = sheet(5, 5)
    faces = without_squares(vertices, faces, lambda x, y: (x > 2) & (x < 3) & (y > 2) & (y < 3))
    hole = holes_of(vertices, faces)[1]
    a, b, c = vertices[hole.rim[:3]]
    assert np.cross(b - a, c - b)[2] > 0.0


def test_holes_that_meet_at_a_vertex_are_apart():
    vertices, faces = sheet(6, 6)
    faces = without_squares(
        vertices, faces, lambda x, y: ((x > 2) & (x < 3) & (y > 2) & (y < 3)) | ((x > 3) & (x < 4) & (y > 3) & (y < 4))
    )
    rims = [set(hole.rim.tolist()) for hole in holes_of(vertices, faces)[1:]]
    assert [len(rim) for rim in rims] == [4, 4]
    assert len(rims[0] & rims[1]) == 1


def test_sheets_that_touch_at_a_vertex_keep_their_rims():
    vertices = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]]
    assert sorted(len(h.rim) for h in holes_of(vertices, [[0, 1, 2], [0, 3, 4]])) == [3, 3]


def test_a_loop_that_crosses_itself_twice_is_cut_twice():
    parts = simple_loops(np.array([0, 1, 2, 3, 4, 2, 5, 0, 6, 7], dtype=np.int32))
    assert sorted(part.tolist() for part in parts) == [[0, 1, 2, 5], [0, 6, 7], [2, 3, 4]]


def test_an_island_that_touches_is_one_loop_with_the_rim():
    vertices, faces = sheet(9, 9)
    touching = without_squares(vertices, faces, lambda x, y: (abs(x - 4) < 2) & (abs(y - 4) < 2) & ((x != y) | (x > 4)))
    outer, hole = holes_of(vertices, touching)
    assert outer.is_outer_rim
    assert len(hole.rim) == len(set(hole.rim.tolist())) + 1


def test_an_island_belongs_to_the_smallest_hole_around_it():
    vertices, faces = sheet(12, 12)
    faces = without_squares(vertices, faces, lambda x, y: (np.maximum(abs(x - 6), abs(y - 6)) - 3) ** 2 < 1)
    outer, hole = holes_of(vertices, faces)
    assert outer.is_outer_rim
    assert [len(loop) for loop in hole.loops] == [32, 16]
    assert hole.perimeter == 48.0
    lifted = vertices.copy()
    lifted[np.abs(vertices[:, :2] - 6).max(axis=1) <= 2, 2] = 9.0
    assert [len(h.loops) for h in holes_of(lifted, faces)] == [1, 1, 1]
    upside_down = faces.copy()
    island = (np.abs(vertices[faces].mean(axis=1)[:, :2] - 6) < 2).all(axis=1)
    upside_down[island] = upside_down[island][:, ::-1]
    assert [len(h.loops) for h in holes_of(vertices, upside_down)] == [1, 1, 1]


def test_holes_do_not_depend_on_the_order_of_faces():
    ball = sphere(resolution=10)
    faces = without_faces_near(ball.vertices, ball.faces, np.array([0.0, 0.0, 1.0]), 0.5)
    shuffled = np.random.default_rng(0).permutation(faces)
    (one,), (other,) = holes_of(ball.vertices, faces), holes_of(ball.vertices, shuffled)
    assert as_cycles(one.loops) == as_cycles(other.loops)


def test_borders_that_meet_a_non_manifold_edge_are_told_apart():
    vertices, faces = sheet(8, 8)
    vertices = np.vstack([vertices, [[0.5, 0.5, 1.0], [4.5, 4.5, 1.0]]])
    rim_and_fin, hole = holes_of(vertices, np.vstack([np.delete(faces, 36, axis=0), [[0, 1, 81]]]))
    assert (rim_and_fin.edge_count, hole.edge_count, hole.obstacle) == (31 + 2, 3, "")
    assert "at vertex" in rim_and_fin.obstacle
    assert set(rim_and_fin.rim.tolist()) == {81, *(k for k in range(81) if k % 9 in (0, 8) or k // 9 in (0, 8))}
    # A double-sided fin inside the sheet has no border but its own three edges' worth of faces.
    inside = np.vstack([faces, [[40, 41, 82], [41, 40, 82]]])
    assert len(boundary_loops(triangle_mesh(vertices, inside))) == 1
    assert [hole.is_outer_rim for hole in holes_of(vertices, inside)] == [True]


def test_faces_that_disagree_leave_the_other_borders_clear():
    ball = sphere(resolution=16)
    height = ball.vertices[ball.faces].mean(axis=1)[:, 2]
    open_faces = ball.faces[np.abs(height) < 0.9]
    top = np.argmax(ball.vertices[open_faces].mean(axis=1)[:, 2])
    open_faces[top] = open_faces[top][::-1]
    whole = holes_of(ball.vertices, ball.faces[np.abs(height) < 0.9])
    assert sorted(bool(hole.obstacle) for hole in holes_of(ball.vertices, open_faces)) == [False, True]
    assert as_cycles(boundary_loops(triangle_mesh(ball.vertices, open_faces))) < as_cycles(
        [hole.rim[::-1] for hole in whole]
    )
    result = fill_holes(ball.vertices, open_faces)
    assert [hole.filled for hole in result.holes] == [not hole.obstacle for hole in holes_of(ball.vertices, open_faces)]
    lower = next(hole for hole in result.holes if hole.filled)
    new = result.faces[lower.new_faces.start : lower.new_faces.stop]
    assert (result.vertices[new][:, :, 2] < 0).all()


def ring(gap):
    """A watertight ring whose inner rim is written twice, a distance apart."""
    n = 24
    angle = 2.0 * np.pi * np.arange(n) / n
    circle, k = np.column_stack([np.cos(angle), np.sin(angle)]), np.arange(n)
    vertices = np.vstack(
        [np.column_stack([r * circle, np.full(n, z)]) for r, z in ((2, 0), (2, 1), (1, 1), (1, 0), (1, gap))]
    )

    def band(p, q):
        after = np.roll(k, -1)
        return np.vstack(
            [
                np.column_stack([p * n + k, p * n + after, q * n + k]),
                np.column_stack([p * n + after, q * n + after, q * n + k]),
            ]
        )

    return vertices, np.vstack([band(0, 1), band(1, 2), band(2, 4), band(3, 0)]).astype(np.int32)


@pytest.mark.parametrize("gap", [0.0, -2.7e-16, 1e-6])
def test_a_crack_of_no_width_is_no_hole(gap):
    """The hole through the ring is not plugged, whatever is asked for."""
    vertices, faces = ring(gap)
    for options in ({}, {"outer_rims": True}, {"holes": [0, 1]}, {"method": "paper"}):
        result = fill_holes(vertices, faces, **options)
        assert [(hole.edge_count, hole.filled) for hole in result.holes] == [(24, False), (24, False)]
        assert all(hole.reason.startswith("24 of its 24 edges lie on those of another border") for hole in result.holes)
        assert len(result.faces) == len(faces)


def test_a_gap_with_a_width_is_two_holes():
    result = fill_holes(*ring(0.01))
    assert [hole.filled for hole in result.holes] == [True, True]


def test_the_seam_of_an_exported_sphere_is_no_hole():
    """Seam and poles are written twice, as for textures: one rim that goes down and up the same vertices."""
    n, m = 24, 12
    t, p = np.meshgrid(2.0 * np.pi * np.arange(n + 1) / n, np.pi * np.arange(m + 1) / m, indexing="ij")
    grid = np.stack([np.sin(p) * np.cos(t), np.sin(p) * np.sin(t), np.cos(p)], axis=-1)
    grid[:, [0, m], :2], grid[n] = 0.0, grid[0]
    a = (np.arange(n)[:, np.newaxis] * (m + 1) + np.arange(m)).ravel()
    faces = np.vstack([np.column_stack([a, a + m + 2, a + m + 1]), np.column_stack([a, a + 1, a + m + 2])])
    result = fill_holes(grid.reshape(-1, 3), faces, outer_rims=True)
    assert [(hole.edge_count, hole.filled) for hole in result.holes] == [(2 * m + 2 * n, False)]
    # A hole beside the seam is one all the same.
    result = fill_holes(grid.reshape(-1, 3), np.delete(faces, [m * n // 2, m * n // 2 + 1], axis=0))
    assert sorted(hole.filled for hole in result.holes) == [False, True]


def test_sheets_of_two_sides_have_holes_on_both():
    """As models of leaves and flags do: their faces lie on each other, too, and no crack is between them."""
    vertices, faces = sheet(9, 9)
    faces = without_squares(vertices, faces, lambda x, y: (x > 3) & (x < 6) & (y > 3) & (y < 6))
    both = np.vstack([faces, faces[:, ::-1] + len(vertices)])
    holes = holes_of(np.vstack([vertices, vertices]), both)
    assert [(hole.edge_count, hole.obstacle) for hole in holes] == [(36, ""), (12, "")] * 2


def add_noise_to_borders(vertices, faces, sigma, seed):
    border = border_edges(triangle_mesh(vertices, faces), vertex_adjacency(triangle_mesh(vertices, faces)).on_boundary)
    edge = np.linalg.norm(vertices[faces[:, 0]] - vertices[faces[:, 1]], axis=1).mean()
    noisy, rim = vertices.copy(), np.unique(border.start)
    noisy[rim] += np.random.default_rng(seed).normal(scale=sigma * edge, size=(len(rim), 3))
    return noisy


@pytest.mark.parametrize("degrees", [15, 25, 40, 60])
@pytest.mark.parametrize("ragged", [0, 4])
@pytest.mark.parametrize("sigma", [pytest.param(0.3, marks=pytest.mark.slow), 0.5])
def test_noisy_and_ragged_holes_are_no_outer_rims(degrees, ragged, sigma):
    ball = sphere(resolution=48)
    heights = ball.vertices[ball.faces].mean(axis=1)[:, 2]
    for seed in range(3):
        angles = np.degrees(np.arccos(heights)) + np.random.default_rng(seed).uniform(-ragged, ragged, len(heights))
        faces = largest_component(ball.faces[angles > degrees], len(ball.vertices))
        noisy = add_noise_to_borders(ball.vertices, faces, sigma, seed)
        largest = max(holes_of(noisy, faces), key=lambda hole: hole.edge_count)
        assert not largest.is_outer_rim


@pytest.mark.parametrize("sigma", [0.0, 0.3, 0.5])
@pytest.mark.parametrize("bend", [0.0, 0.5, 1.0])
def test_noisy_rims_of_sheets_with_windows_are_outer_rims(sigma, bend):
    vertices, faces = sheet(24, 24)
    vertices = vertices / 12.0 - [1.0, 1.0, 0.0]
    vertices = np.column_stack([vertices[:, :2], -0.5 * bend * np.square(vertices[:, :2]).sum(axis=1)])
    windows = without_faces_near(vertices, faces, vertices[len(vertices) // 3], 0.2)
    for seed in range(3):
        found = holes_of(add_noise_to_borders(vertices, windows, sigma, seed), windows)
        outer = max(found, key=lambda hole: hole.perimeter)
        assert [hole.is_outer_rim for hole in found] == [hole is outer for hole in found]


def largest_component(faces, count):
    graph = coo_array((np.ones(3 * len(faces)), (faces.ravel(), np.roll(faces, 1, axis=1).ravel())), (count, count))
    label = connected_components(graph, directed=False)[1][faces[:, 0]]
    return faces[label == np.bincount(label).argmax()]
