"""Spikes and flaps at rims, which intersect the mesh: removed where the hole is filled without them, and only there."""

import numpy as np
import pytest
from hole_cases import ball_with_rim
from surface_cases import border_edges, directed_edges

from bezier_filters import fill_holes
from bezier_filters.meshes.intersecting_faces import intersecting_faces
from bezier_filters.meshes.mesh import triangle_mesh
from bezier_filters.meshes.prepared_mesh import prepare_mesh


def count_cuts(vertices, faces):
    return np.count_nonzero(intersecting_faces(prepare_mesh(triangle_mesh(vertices, faces))) >= 0)


@pytest.mark.parametrize(
    ("noise", "seed", "rows"),
    [(0.3, 1, "few"), pytest.param(0.4, 0, "few", marks=pytest.mark.slow), (0.4, 1, "ring"), (0.5, 3, "ring")],
)
def test_flaps_are_removed_and_the_ball_is_closed(noise, seed, rows):
    """Few faces where that is enough, else the first ring."""
    vertices, faces, step = ball_with_rim(noise, seed)
    assert count_cuts(vertices, faces) > 0
    before = fill_holes(vertices, faces)
    assert before.filled == 0
    assert "trim=True" in before.holes[0].reason
    result = fill_holes(vertices, faces, trim=True)
    assert result.filled == len(result.holes) >= 1
    n, m = len(result.old_vertices), len(result.old_faces)
    np.testing.assert_array_equal(result.vertices[:n], vertices[result.old_vertices])
    np.testing.assert_array_equal(result.old_vertices[result.faces[:m]], faces[result.old_faces])
    gone = np.setdiff1d(np.arange(len(faces)), result.old_faces)
    ring = np.flatnonzero(np.isin(faces, np.unique(border_edges(faces))).any(axis=1))
    if rows == "few":
        assert 0 < len(gone) < 20
        assert np.isin(gone, ring).all()
    else:
        np.testing.assert_array_equal(gone, ring)
    edges = directed_edges(result.faces)
    assert len(np.unique(edges, axis=0)) == len(edges)
    assert len(border_edges(result.faces)) == 0
    assert count_cuts(result.vertices, result.faces) == 0
    assert np.abs(np.linalg.norm(result.vertices[n:], axis=1) - 1.0).max() < 0.05 * step


def test_nothing_is_removed_where_holes_can_be_filled():
    vertices, faces, _ = ball_with_rim()
    plain, trimmed = fill_holes(vertices, faces), fill_holes(vertices, faces, trim=True)
    assert plain.filled == trimmed.filled == 1
    np.testing.assert_array_equal(plain.vertices, trimmed.vertices)
    np.testing.assert_array_equal(trimmed.faces, plain.faces)
    np.testing.assert_array_equal(trimmed.old_faces, np.arange(len(faces)))


def test_nothing_is_removed_where_that_would_not_help():
    """A rod through the hole, so that every fill would cut it: its faces are no flaps."""
    vertices, faces, _ = ball_with_rim(noise=0.5)
    rod = np.array(
        [[-0.1, -0.1, 0.0], [0.1, -0.1, 0.0], [0.0, 0.1, 0.0], [-0.1, -0.1, 3.0], [0.1, -0.1, 3.0], [0, 0.1, 3]]
    )
    sides = np.array([[0, 2, 1], [3, 4, 5], [0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4], [2, 0, 3], [2, 3, 5]])
    vertices, faces = np.vstack([vertices, rod]), np.vstack([faces, len(vertices) + sides]).astype(np.int32)
    plain, trimmed = fill_holes(vertices, faces), fill_holes(vertices, faces, trim=True)
    assert plain.filled == trimmed.filled == 0
    np.testing.assert_array_equal(trimmed.vertices, vertices)
    np.testing.assert_array_equal(trimmed.faces, faces)
