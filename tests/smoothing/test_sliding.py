"""Vertices move along the normals, and slide only where they have to."""

import numpy as np
import pytest
from numba import config

from bezier_filters import InvalidParameterError, smooth
from bezier_filters.meshes.mesh import triangle_mesh
from bezier_filters.meshes.prepared_mesh import prepare_mesh
from bezier_filters.scale import FitOptions, smooth_file
from bezier_filters.smoothing.sliding import MAX_MOVE_EDGES, TangentialMotion, restrict_to_normals
from bezier_filters.surfaces import block_with_sharp_edges, bumpy_star, torus

pytestmark = pytest.mark.skipif(config.DISABLE_JIT, reason="takes too long without the compiler")
NOISE = 0.2  # mean edges


def mean_edge(vertices, faces):
    return np.linalg.norm(vertices[faces[:, 0]] - vertices[faces[:, 1]], axis=1).mean()


def parts_of_errors(points, vertices, faces, normals):
    """Root mean squares along the normals and along the surface, mean edges."""
    errors = (points - vertices) / mean_edge(vertices, faces)
    heights = np.einsum("ij,ij->i", errors, normals)
    along = errors - heights[:, np.newaxis] * normals
    return np.sqrt(np.square(heights).mean()), np.sqrt(np.square(along).sum(axis=1).mean())


@pytest.mark.parametrize("surface", [bumpy_star(resolution=18, jitter=0.3), torus(resolution=30, jitter=0.3)])
def test_noise_along_the_normals_goes_and_vertices_do_not_slide(surface):
    vertices, faces, normals = surface.vertices, surface.faces, surface.normals
    heights = NOISE * mean_edge(vertices, faces) * np.random.default_rng(1).standard_normal((len(vertices), 1))
    noisy = vertices + heights * normals
    height, slid = parts_of_errors(smooth(noisy, faces).vertices, vertices, faces, normals)
    relaxed, slid_by_request = parts_of_errors(smooth(noisy, faces, relax=True).vertices, vertices, faces, normals)
    assert height < 0.35 * NOISE
    assert height < 1.1 * relaxed
    assert slid < 0.05
    assert slid < slid_by_request


def test_vertices_of_edges_move_along_both_sides():
    vertices, faces = block_with_sharp_edges(resolution=24)
    rng, edge = np.random.default_rng(2), mean_edge(*block_with_sharp_edges(resolution=24))
    noisy = vertices + 0.1 * edge * rng.standard_normal(vertices.shape)
    moves = smooth(noisy, faces).vertices - noisy
    size, inside = np.abs(vertices).max(), np.abs(vertices) < 0.4
    on_edge = (np.isclose(vertices, -size).sum(axis=1) == 2) & (inside.sum(axis=1) == 1)
    errors = noisy + moves - vertices
    across = np.where(np.isclose(vertices, -size), errors, 0.0)[on_edge]
    assert np.sqrt(np.square(across).mean()) < 0.5 * np.sqrt(np.square((noisy - vertices)[on_edge]).mean())
    along = np.where(inside, moves, 0.0)[on_edge]
    assert np.sqrt(np.square(along).sum(axis=1).mean()) < 0.02 * edge


@pytest.mark.parametrize("sliding", TangentialMotion)
def test_no_vertex_is_flung(sliding):
    """A vertex ends within two of its longest edges, wherever the filters would take it; short moves stay."""
    surface, rng = torus(resolution=12, jitter=0.3), np.random.default_rng(4)
    mesh = triangle_mesh(surface.vertices, surface.faces)
    corners = mesh.vertices[mesh.faces]
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    longest = np.zeros(mesh.vertex_count)
    for ends in (mesh.faces, np.roll(mesh.faces, 1, axis=1)):
        np.maximum.at(longest, ends, edges)
    lengths = np.where(np.arange(mesh.vertex_count) % 7 == 0, 10.0, 0.02)[:, np.newaxis] * longest[:, np.newaxis]
    points = mesh.vertices + rng.choice([-1.0, 1.0], lengths.shape) * lengths * surface.normals
    held = restrict_to_normals(prepare_mesh(mesh), points, sliding)
    moved = np.linalg.norm(held - mesh.vertices, axis=1)
    assert (moved <= MAX_MOVE_EDGES * longest * (1 + 1e-12)).all()
    if sliding == TangentialMotion.ALL:
        assert np.allclose(moved, np.minimum(lengths[:, 0], MAX_MOVE_EDGES * longest))


def test_vertices_slide_where_noise_in_all_directions_turns_faces_over():
    surface = torus(resolution=28)
    vertices, faces, normals = surface.vertices, surface.faces, surface.normals
    noisy = vertices + 0.3 * mean_edge(vertices, faces) * np.random.default_rng(3).standard_normal(vertices.shape)
    result = smooth(noisy, faces)
    _, slid_before = parts_of_errors(noisy, vertices, faces, normals)
    _, slid = parts_of_errors(result.vertices, vertices, faces, normals)
    assert slid < 0.5 * slid_before
    assert result.flipped_after < 0.01 * result.flipped_before


@pytest.mark.parametrize("options", [{"rings": 3}, {"alpha": 0.5}, {"method": "paper", "relax": True}])
def test_options_of_the_other_method_are_refused(options):
    block = block_with_sharp_edges(resolution=4)
    name, method = next(name for name in options if name != "method"), options.get("method", "auto")
    with pytest.raises(InvalidParameterError, match=f"{name}: method='{method}' does not use it"):
        smooth(*block, **options)


@pytest.mark.parametrize(("options", "message"), [({"rings": 0}, "rings: got 0"), ({"alpha": 0.0}, "alpha: got 0.0")])
def test_options_of_the_paper_are_checked_where_they_are_used(options, message):
    with pytest.raises(InvalidParameterError, match=message):
        smooth(*block_with_sharp_edges(resolution=4), method="paper", **options)


def test_fits_are_refused_by_automatic_smoothing_in_tiles(tmp_path):
    with pytest.raises(InvalidParameterError, match="options: only method='paper' fits patches"):
        smooth_file("scan.ply", tmp_path / "out.ply", options=FitOptions(rings=3))
