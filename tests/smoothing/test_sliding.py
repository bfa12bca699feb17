"""Vertices move along the normals, and slide only where they have to."""

import numpy as np
import pytest
from numba import config

from bezier_filters import InvalidParameterError, smooth
from bezier_filters.scale import FitOptions, smooth_file
from bezier_filters.smoothing.move_limits import limit_moves
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


@pytest.mark.parametrize(
    "surface",
    [
        bumpy_star(resolution=18, jitter=0.3),
        pytest.param(torus(resolution=30, jitter=0.3), marks=pytest.mark.slow),
    ],
)
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


def test_moves_are_limited_in_their_direction():
    random = np.random.default_rng(4)
    vertices, moves, most = random.random((50, 3)), random.standard_normal((50, 3)), random.random(50)
    points = limit_moves(vertices, vertices + moves, most)
    lengths = np.linalg.norm(moves, axis=1)
    shares = np.minimum(most / lengths, 1.0)
    np.testing.assert_allclose(points - vertices, shares[:, np.newaxis] * moves, atol=1e-14)


@pytest.mark.parametrize("seed", [0, 1, pytest.param(2, marks=pytest.mark.slow)])
def test_no_vertex_moves_by_more_than_five_times_its_noise(seed):
    """Outliers do, and say so; a plane of two triangles near a noisy ball has none and stays."""
    ball, random = bumpy_star(resolution=16, jitter=0.2), np.random.default_rng(seed)
    edge = mean_edge(ball.vertices, ball.faces)
    heights = (0.1 + 0.1 * (ball.vertices[:, 2] > 0)) * edge * random.standard_normal(len(ball.vertices))
    is_hit = random.random(len(heights)) < 0.02 * (seed > 0)
    noisy = ball.vertices + (heights + 4.0 * edge * is_hit)[:, np.newaxis] * ball.normals
    plane = np.array([[-9.0, -9.0, -3.0], [9.0, -9.0, -3.0], [9.0, 9.0, -3.0], [-9.0, 9.0, -3.0]])
    n = len(noisy)
    faces = np.vstack([ball.faces, [[n, n + 1, n + 2], [n, n + 2, n + 3]]])
    result = smooth(np.vstack([noisy, plane]), faces, keep_volume=False)
    np.testing.assert_array_equal(result.vertices[n:], plane)
    bounded = ~result.outliers
    assert (result.displacement <= 5.0 * (1 + 1e-9) * result.vertex_noise)[bounded].all()
    assert result.outliers[:n][is_hit].all()
    assert result.outliers.mean() < 0.03


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
