"""Sharp edges are found where they are, and keep what lies behind them away."""

from dataclasses import replace

import numpy as np
import pytest
from surface_cases import CASES, make

from bezier_filters import estimate_vertex_geometry, triangle_mesh, vertex_adjacency
from bezier_filters.meshes.frames import tangent_planes
from bezier_filters.meshes.half_edges import mesh_edges
from bezier_filters.meshes.sharp_edges import (
    CONTINUATION_RATIO,
    FIT_SHARP_ANGLE,
    SHARP_ANGLE,
    certainties,
    sharp_edge_vertices,
    sharp_edges,
)
from bezier_filters.runtime.parallel import use_threads
from bezier_filters.surfaces import block_with_sharp_edges

each_block = pytest.mark.parametrize(("resolution", "jitter"), [(8, 0.0), (10, 0.2), (20, 0.2)])


def creases_of(vertices, faces):
    mesh = triangle_mesh(vertices, faces)
    adjacency = vertex_adjacency(mesh)
    return sharp_edge_vertices(mesh, adjacency, tangent_planes(mesh, adjacency))


def on_several_planes(vertices, faces):
    """Vertices of a block whose faces point along more than one axis or direction."""
    a, b, c = vertices[faces].transpose(1, 0, 2)
    normals = np.cross(b - a, c - a)
    directions = np.round(normals / np.linalg.norm(normals, axis=1, keepdims=True)) @ [1, 2, 3]
    met = np.zeros((len(vertices), 7), dtype=bool)
    met[faces, (directions.astype(int) + 3)[:, np.newaxis]] = True
    return met.sum(axis=1) > 1


@each_block
def test_the_creases_of_a_block_are_its_edges_and_corners(resolution, jitter):
    vertices, faces = block_with_sharp_edges(resolution=resolution, jitter=jitter)
    np.testing.assert_array_equal(creases_of(vertices, faces), on_several_planes(vertices, faces))


@each_block
def test_the_faces_of_a_block_are_flat_up_to_its_edges(resolution, jitter):
    vertices, faces = block_with_sharp_edges(resolution=resolution, jitter=jitter)
    geometry = estimate_vertex_geometry(vertices, faces)
    flat = ~on_several_planes(vertices, faces)
    assert np.abs(geometry.k_min[flat]).max() < 1e-10
    assert np.abs(geometry.k_max[flat]).max() < 1e-10
    assert np.abs(np.abs(geometry.normals[flat]).max(axis=1) - 1.0).max() < 1e-12


def mean_edge_length(vertices, faces):
    return np.linalg.norm(vertices[faces] - vertices[np.roll(faces, 1, axis=1)], axis=2).mean()


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("seed", [1, 2])
def test_smooth_surfaces_have_none_even_with_much_noise(name, seed):
    surface = make(name, 0.3, refinement=2)
    noise = 0.2 * mean_edge_length(surface.vertices, surface.faces)
    heights = noise * np.random.default_rng(seed).standard_normal((len(surface.vertices), 1))
    assert not creases_of(surface.vertices, surface.faces).any()
    assert not creases_of(surface.vertices + heights * surface.normals, surface.faces).any()


def fold(angle, columns=8, rows=8):
    """A lattice in two planes that meet at x = 0, the second turned by an angle in degrees; triangles of two kinds."""
    x, y = np.meshgrid(np.arange(-columns, columns + 1.0), np.arange(rows + 1.0), indexing="ij")
    turn = np.radians(angle)
    right = np.maximum(x, 0.0)
    vertices = np.stack([np.minimum(x, 0.0) + right * np.cos(turn), y, right * np.sin(turn)], axis=2).reshape(-1, 3)
    number = np.arange(x.size).reshape(x.shape)
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    faces = np.concatenate([np.stack([a, b, c], axis=2).reshape(-1, 3), np.stack([a, c, d], axis=2).reshape(-1, 3)])
    return vertices, faces, x.ravel(), y.ravel()


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_edge_is_a_crease_beyond_the_limit_whichever_way_it_turns(sign):
    vertices, faces, x, y = fold(sign * (np.degrees(FIT_SHARP_ANGLE) + 1.0))
    inside = (y > 0) & (y < y.max())
    np.testing.assert_array_equal(creases_of(vertices, faces), (x == 0) & inside)  # the ends have one crease each
    vertices, faces, *_ = fold(sign * (np.degrees(FIT_SHARP_ANGLE) - 1.0))
    assert not creases_of(vertices, faces).any()


def test_a_single_sharp_edge_is_no_crease():
    """A crease of one edge, and one of two: only the vertex in the middle of the latter is inside a crease."""
    vertices, faces, *_ = fold(90.0, rows=1)
    assert not creases_of(vertices, faces).any()
    vertices, faces, x, y = fold(90.0, rows=2)
    np.testing.assert_array_equal(creases_of(vertices, faces), (x == 0) & (y == 1))


def test_where_every_edge_is_sharp_none_is_a_crease():
    """The faces of an octahedron meet at 71 degrees."""
    octahedron = np.concatenate([np.eye(3), -np.eye(3)])
    faces = [[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]]
    assert not creases_of(octahedron, faces).any()


def test_threads_size_and_orientation_change_nothing():
    vertices, faces = block_with_sharp_edges(resolution=30, jitter=0.2)
    expected = creases_of(vertices, faces)
    with use_threads(2):
        np.testing.assert_array_equal(creases_of(vertices, faces), expected)
    np.testing.assert_array_equal(creases_of(1e6 * vertices, faces), expected)
    np.testing.assert_array_equal(creases_of(vertices, faces[:, ::-1]), expected)


def test_faces_without_area_and_point_clouds_have_no_creases():
    vertices, faces, x, _ = fold(0.0)
    vertices[x == 1] = vertices[x == 0]
    assert not creases_of(vertices, faces).any()
    assert not creases_of(vertices, np.zeros((0, 3), dtype=np.int32)).any()


@pytest.mark.parametrize("size", [1.0, 1e-4])
@pytest.mark.parametrize(("turn", "goes_on"), [(0.0, True), (24.0, True), (36.0, False), (-24.0, True), (-36.0, False)])
def test_a_line_goes_straight_on_along_edges_that_are_less_sharp(size, turn, goes_on):
    """A fold that flattens out from row to row, to the share of the angle where lines end and on.

    It turns by some degrees where all further edges are less sharp than others must be, though the turn sharpens them.
    """
    _, faces, x, y = fold(0.0, rows=24)
    share = 1.3 - 0.8 * y / 24.0
    right = np.maximum(x, 0.0)
    angle = SHARP_ANGLE * share
    bent = np.stack([np.minimum(x, 0.0) + right * np.cos(angle), y, right * np.sin(angle)], axis=1)
    bent[:, 0] += np.tan(np.radians(turn)) * np.maximum(y - 14.0, 0.0)
    mesh = triangle_mesh(size * bent, faces)
    edges = mesh_edges(mesh)
    sharp = edges.vertices[sharp_edges(mesh, edges, vertex_adjacency(mesh))]
    assert (x[sharp] == 0).all()
    assert y[sharp].min() == 0
    if goes_on:
        assert share[sharp].min() == pytest.approx(CONTINUATION_RATIO, abs=0.1)
    else:
        assert y[sharp].max() == 14.0


def test_certainty_is_a_half_at_the_limit_and_falls_with_the_noise():
    mesh = triangle_mesh(*fold(np.degrees(SHARP_ANGLE), rows=2)[:2])
    edges = mesh_edges(mesh)
    at_fold = edges.angles > 0.5 * SHARP_ANGLE
    np.testing.assert_allclose(certainties(edges, 0.1)[at_fold], 0.5, atol=1e-6)
    for limit, order in ((0.8 * SHARP_ANGLE, -1), (1.2 * SHARP_ANGLE, 1)):
        by_noise = [certainties(edges, noise, limit)[at_fold][0] for noise in (0.05, 0.1, 0.2)]
        assert by_noise == sorted(by_noise)[::order]
        assert min(by_noise) > 0.5 if order < 0 else max(by_noise) < 0.5
        tiny = replace(edges, widths=1e-9 * edges.widths)
        np.testing.assert_allclose(certainties(tiny, 0.1e-9, limit), certainties(edges, 0.1, limit), rtol=1e-9)


def test_hubs_take_no_quadratic_time():
    """All vertices of the rim of a double cone look at the edges of both tips; squares of these take days."""
    n = 20_000
    angle = 2.0 * np.pi * np.arange(n) / n
    rim = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(n)])
    vertices = np.vstack([rim, [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]])
    k, after = np.arange(n), np.roll(np.arange(n), -1)
    faces = np.vstack([np.column_stack([k, after, np.full(n, n)]), np.column_stack([after, k, np.full(n, n + 1)])])
    np.testing.assert_array_equal(creases_of(vertices, faces), np.arange(n + 2) < n)
