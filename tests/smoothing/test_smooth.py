"""Smoothing, from known truth: analytic surfaces and a block with sharp edges."""

import re

import numpy as np
import pytest
from numba import config
from scipy.sparse import csr_array
from smoothing_cases import edge_of, mean_angle, noisy_block, with_noise

from bezier_filters import CancelledError, InvalidParameterError, estimate_vertex_geometry, smooth
from bezier_filters.meshes.adjacency import vertex_adjacency
from bezier_filters.meshes.mesh import triangle_mesh
from bezier_filters.surfaces import block_with_sharp_edges, bumpy_star, sphere, torus, waves

pytestmark = pytest.mark.skipif(config.DISABLE_JIT, reason="takes too long without the compiler")


def vertex_normals(vertices, faces):
    return estimate_vertex_geometry(vertices, faces, rings=1, alpha=1.0, degree=2).normals


@pytest.fixture(scope="module")
def block():
    return noisy_block(24)


@pytest.fixture(scope="module")
def coarse_block():
    return noisy_block(12)


@pytest.fixture(scope="module")
def smoothed(block):
    """The noisy block smoothed, on one thread."""
    _, noisy, faces = block
    return smooth(noisy, faces, threads=1)


@pytest.mark.parametrize(
    ("surface", "most"),
    [
        (sphere(resolution=18, jitter=0.2), 0.5),
        (sphere(resolution=40, jitter=0.2), 0.2),  # with filters of strength 1e6, .25 was left
        (torus(resolution=26, jitter=0.2), 1.5),
        (bumpy_star(resolution=20, jitter=0.2), 2.0),
    ],
    ids=["sphere", "large sphere", "torus", "bumpy star"],
)
def test_noise_on_smooth_surfaces_goes(surface, most):
    noisy = with_noise(surface.vertices, surface.faces, surface.normals, 0.2)
    result = smooth(noisy, surface.faces)
    assert mean_angle(noisy, surface.vertices, surface.faces) > 15.0
    assert mean_angle(result.vertices, surface.vertices, surface.faces) < most
    assert result.sharpness.mean() < 0.3
    assert result.volume_ratio == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (1, 2))])
def test_what_is_smooth_already_is_left_alone(seed):
    ball = bumpy_star(resolution=12, jitter=0.2)
    once = smooth(with_noise(ball.vertices, ball.faces, ball.normals, 0.2, seed), ball.faces)
    assert once.max_displacement > 0.0
    assert smooth(once.vertices, ball.faces).max_displacement == 0.0


def test_sharp_edges_stay_sharp(block, smoothed):
    (clean, noisy, faces), result = block, smoothed
    assert mean_angle(noisy, clean, faces) > 15.0
    assert mean_angle(result.vertices, clean, faces) < 1.8
    assert result.sharpness.mean() > 0.8
    on_edge = (np.abs(clean[:, :2]) > 0.5 - 1e-9).all(axis=1)
    distance = np.linalg.norm((result.vertices - clean)[on_edge, :2], axis=1)
    assert np.sqrt(np.square(distance).mean()) < 0.1 * edge_of(clean, faces)


def test_noise_before_and_bad_faces_are_stated(block, smoothed):
    (_, noisy, faces), result = block, smoothed
    assert result.noise_before == pytest.approx(0.2 * edge_of(noisy, faces), rel=0.3)
    assert result.flipped_after <= result.flipped_before
    assert result.new_bad_faces == 0


@pytest.mark.parametrize("level", [0.05, 0.2, 0.5])
@pytest.mark.parametrize("body", [bumpy_star(resolution=16, jitter=0.3, seed=3), sphere(resolution=20, jitter=0.2)])
def test_noise_after_is_the_error_of_the_smoothed_vertices(body, level):
    result = smooth(with_noise(body.vertices, body.faces, body.normals, level, seed=8), body.faces)
    error = np.einsum("ij,ij->i", result.vertices - body.vertices, body.normals)
    assert result.noise_after == pytest.approx(np.sqrt(np.square(error).mean()), rel=0.5)


def test_noise_stays_where_nothing_moves(block):
    _, noisy, faces = block
    result = smooth(noisy, faces, selected=np.zeros(len(noisy), dtype=bool))
    assert result.noise_after == pytest.approx(result.noise_before, rel=0.1)


def test_a_body_of_two_kinds_is_treated_as_such(block):
    clean, noisy, faces = block
    ball = sphere(resolution=16, jitter=0.2)
    scale = edge_of(clean, faces) / edge_of(ball.vertices, ball.faces)
    other = with_noise(ball.vertices, ball.faces, ball.normals, 0.2, seed=1) * scale + [5.0, 0.0, 0.0]
    result = smooth(np.vstack([noisy, other]), np.vstack([faces, ball.faces + len(noisy)]))
    assert result.sharpness[: len(noisy)].mean() > result.sharpness[len(noisy) :].mean() + 0.3


@pytest.mark.parametrize("surface", [sphere(), torus(jitter=0.2), waves(), bumpy_star()], ids=lambda _: "surface")
def test_clean_surfaces_stay_as_they_are(surface):
    result = smooth(surface.vertices, surface.faces)
    assert result.max_displacement < 1e-3 * edge_of(surface.vertices, surface.faces)


def test_clean_blocks_stay_as_they_are():
    vertices, faces = block_with_sharp_edges(resolution=16, jitter=0.2)
    assert smooth(vertices, faces).max_displacement < 1e-3 * edge_of(vertices, faces)


def test_noise_that_varies_goes_everywhere():
    ring = torus(resolution=30, jitter=0.2)
    level = np.where(ring.vertices[:, 0] > 0.0, 0.3, 0.05)
    noise = np.random.default_rng(0).standard_normal(len(level)) * level * edge_of(ring.vertices, ring.faces)
    noisy = ring.vertices + ring.normals * noise[:, np.newaxis]
    assert mean_angle(smooth(noisy, ring.faces).vertices, ring.vertices, ring.faces) < 2.0


def test_a_plane_keeps_its_border_curve_and_becomes_flat():
    sheet = waves(resolution=24, amplitude=0.0)
    noisy = with_noise(sheet.vertices, sheet.faces, sheet.normals, 0.2)
    free, fixed = smooth(noisy, sheet.faces), smooth(noisy, sheet.faces, borders="fixed")
    on_border = vertex_adjacency(triangle_mesh(sheet.vertices, sheet.faces)).on_boundary
    inside = ~on_border
    assert free.vertices[inside, 2].std() < 0.2 * noisy[inside, 2].std()
    assert free.vertices[on_border, 2].std() < 0.6 * noisy[on_border, 2].std()
    assert np.array_equal(fixed.vertices[on_border], noisy[on_border])
    assert free.volume_before is None
    assert free.volume_ratio is None


def test_results_move_with_the_mesh(block, smoothed):
    (_, noisy, faces), one = block, smoothed
    rotation, _ = np.linalg.qr(np.random.default_rng(0).standard_normal((3, 3)))
    rotation *= np.linalg.det(rotation)
    moved = 50.0 * noisy @ rotation.T + [1e3, -2e3, 5e2]
    other = smooth(moved, faces, threads=2)
    back = (other.vertices - [1e3, -2e3, 5e2]) @ rotation / 50.0
    assert np.allclose(back, one.vertices, atol=1e-7 * np.ptp(noisy))
    assert other.noise_before == pytest.approx(50.0 * one.noise_before, rel=1e-6)


def test_threads_do_not_matter(block, smoothed):
    _, noisy, faces = block
    assert np.array_equal(smoothed.vertices, smooth(noisy, faces, threads=3).vertices)


def test_only_selected_vertices_move(coarse_block):
    _, noisy, faces = coarse_block
    selected = noisy[:, 0] > 0.0
    result = smooth(noisy, faces, selected=selected)
    assert np.array_equal(result.vertices[~selected], noisy[~selected])
    assert result.displacement[selected].mean() > 0.0


def test_known_noise_takes_the_place_of_the_learned_one(coarse_block):
    _, noisy, faces = coarse_block
    result = smooth(noisy, faces, noise=0.0)
    assert np.array_equal(result.vertices, noisy)
    assert result.noise_before == 0.0


@pytest.mark.parametrize(
    ("sigma", "blurred", "in_all_directions", "words"),
    [
        (0.2, False, False, r"noise 0\.\d+ edges, independent from vertex to vertex"),
        (0.2, True, False, r"noise 0\.\d+ edges, correlated over [\d.]+ edges"),
        (0.5, False, True, r"noise 0\.\d+ edges in all directions, independent from vertex to vertex"),
        (0.0, False, False, "noise too small to be learned"),
    ],
)
def test_the_result_says_what_the_noise_was_in_words(sigma, blurred, in_all_directions, words):
    ball = sphere(resolution=14, jitter=0.2)
    unit, n = edge_of(ball.vertices, ball.faces), len(ball.vertices)
    noise = np.random.default_rng(0).standard_normal((n, 3 if in_all_directions else 1))
    if blurred:
        rows = vertex_adjacency(triangle_mesh(ball.vertices, ball.faces)).vertices
        links = csr_array((np.ones(len(rows.indices)), rows.indices, rows.indptr), shape=(n, n))
        means = noise + links @ noise
        noise = means / means.std()
    moved = sigma * unit * noise * (1.0 if in_all_directions else ball.normals)
    result = smooth(ball.vertices + moved, ball.faces)
    assert re.fullmatch(words, result.noise)
    assert result.noise_heavy == in_all_directions
    assert (result.noise_length > 0.5 * unit) == blurred
    assert result.noise in repr(result)
    assert result.noise in result._repr_html_()
    if sigma:
        assert result.noise_before == pytest.approx(sigma * unit, rel=0.3)


def test_waves_as_long_as_the_detail_keep_half_of_their_height():
    """Waves of 8 edges that are hidden in noise: the difference between the mesh with them and with their opposite."""
    sheet = waves(resolution=36, amplitude=0.0)
    unit, n = edge_of(sheet.vertices, sheet.faces), len(sheet.vertices)
    wave, noise = np.sin(2.0 * np.pi * sheet.vertices[:, 0] / (8.0 * unit)), np.random.default_rng(0).standard_normal(n)
    inside = np.abs(sheet.vertices[:, :2]).max(axis=1) < 0.7
    kept = []
    for detail in (None, 8.0 * unit, 3.0 * unit):
        heights = []
        for sign in (-1.0, 1.0):
            vertices = sheet.vertices.copy()
            vertices[:, 2] = unit * (0.02 * sign * wave + 0.2 * noise)
            heights.append(smooth(vertices, sheet.faces, noise=0.2 * unit, detail=detail).vertices[:, 2])
        change = (heights[1] - heights[0]) / (0.04 * unit)
        kept.append(float((change * wave)[inside].sum() / np.square(wave[inside]).sum()))
    assert kept[0] < 0.1
    assert kept[1] > 0.5
    assert kept[2] > 0.95


@pytest.mark.parametrize("detail", [0.0, -1.0, np.inf, "2%", True])
def test_detail_that_is_no_length_is_refused(coarse_block, detail):
    _, noisy, faces = coarse_block
    with pytest.raises(InvalidParameterError, match=r"detail: got .*, expected a positive length, or None"):
        smooth(noisy, faces, detail=detail)
    with pytest.raises(InvalidParameterError, match="detail: method='paper' does not use it"):
        smooth(noisy, faces, "paper", detail=1.0)


def test_the_papers_method_moves_every_vertex_onto_its_patch():
    ball = sphere(resolution=12, jitter=0.2)
    noisy = with_noise(ball.vertices, ball.faces, ball.normals, 0.1)
    geometry = estimate_vertex_geometry(noisy, ball.faces, rings=2, alpha=0.8, smoothness="paper")
    result = smooth(noisy, ball.faces, "paper")
    assert np.array_equal(result.vertices, noisy + geometry.displacements)
    assert smooth(noisy, ball.faces, "paper", keep_volume=True).volume_ratio == pytest.approx(1.0, abs=1e-9)


def test_displacements_end_on_the_patch_of_a_polynomial():
    sheet = waves(resolution=20, amplitude=0.0)
    vertices = sheet.vertices.copy()
    vertices[:, 2] = 0.3 * vertices[:, 0] ** 2 - 0.2 * vertices[:, 0] * vertices[:, 1]
    geometry = estimate_vertex_geometry(vertices, sheet.faces, rings=2, alpha=0.5)
    assert np.abs(geometry.displacements).max() < 0.05 * edge_of(vertices, sheet.faces)


def test_meshes_that_are_hardly_any():
    nothing = smooth(np.zeros((0, 3)), np.zeros((0, 3), dtype=int))
    assert nothing.vertices.shape == (0, 3)
    assert nothing.volume_ratio is None
    triangle = smooth([[0, 0, 0], [1, 0, 0], [0, 1, 0], [5, 5, 5]], [[0, 1, 2]])
    assert triangle.noise_before is None
    assert triangle.max_displacement == 0.0


def with_fins(vertices, faces):
    """Some edges with a third face."""
    tips = vertices[faces[:40, 0]] + [0.0, 0.0, edge_of(vertices, faces)]
    fins = np.column_stack([faces[:40, :2], len(vertices) + np.arange(40)])
    return np.vstack([vertices, tips]), np.vstack([faces, fins])


def with_coincident_vertices(vertices, faces):
    result = vertices.copy()
    result[faces[:30, 0]] = result[faces[:30, 1]]
    return result, faces


@pytest.mark.parametrize(
    "spoil",
    [
        with_fins,
        with_coincident_vertices,
        lambda v, f: (np.vstack([v, np.ones((20, 3))]), f),
        lambda v, f: (v, np.vstack([f, f[:100], f[100:150, ::-1], [[0, 0, 1]]])),
        lambda v, f: (v, f[np.random.default_rng(0).random(len(f)) > 0.1]),
        lambda v, f: (v, np.where((np.arange(len(f)) % 2 == 0)[:, np.newaxis], f, f[:, ::-1])),
        lambda v, f: (v, f[:, ::-1]),
    ],
    ids=["fins", "coincident", "isolated", "repeated", "full of holes", "half turned", "inside out"],
)
@pytest.mark.parametrize("seed", [pytest.param(0, marks=pytest.mark.slow), 5])
def test_dirty_meshes_come_to_no_harm(spoil, seed):
    ring = torus(resolution=18, jitter=0.2)
    vertices, faces = spoil(with_noise(ring.vertices, ring.faces, ring.normals, 0.2, seed), ring.faces)
    result = smooth(vertices, faces)
    assert np.isfinite(result.vertices).all()
    assert np.isfinite(result.sharpness).all()
    assert result.new_bad_faces == 0


@pytest.mark.parametrize("count", [4, 5, 8, 20, 50])
def test_tiny_meshes_come_to_no_harm(count):
    rng = np.random.default_rng(count)
    points, faces = rng.standard_normal((count, 3)), rng.integers(0, count, (2 * count, 3))
    result = smooth(points, faces, noise=0.1)
    assert np.isfinite(result.vertices).all()
    assert result.new_bad_faces == 0


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"method": "taubin"}, "method: got 'taubin'"),
        ({"iterations": 0}, "iterations: got 0"),
        ({"noise": -1.0}, "noise: got -1.0"),
        ({"noise": 0.1, "method": "paper"}, "noise: method='paper'"),
        ({"borders": "free"}, "borders: got 'free'"),
        ({"selected": np.zeros(3, dtype=bool)}, "selected: got bool of shape"),
    ],
)
def test_bad_parameters_are_named(parameters, message):
    ball = sphere(resolution=4)
    with pytest.raises(InvalidParameterError, match=message):
        smooth(ball.vertices, ball.faces, **parameters)


def test_the_paper_s_smoothing_holds_what_has_no_patch():
    """A fin on a sphere: both ends of its edge stay, all others come as near as without it."""
    ball = sphere(resolution=12)
    noisy = ball.vertices * (1.0 + np.random.default_rng(0).normal(scale=0.01, size=len(ball.vertices)))[:, np.newaxis]
    a, b = ball.faces[100][:2]
    with_fin = np.vstack([noisy, 1.5 * noisy[a]]), np.vstack([ball.faces, [[a, b, len(noisy)]]])
    result = smooth(*with_fin, "paper")
    np.testing.assert_array_equal(result.vertices[[a, b]], noisy[[a, b]])
    far = np.linalg.norm(ball.vertices - ball.vertices[a], axis=1) > 0.5
    np.testing.assert_allclose(result.vertices[:-1][far], smooth(noisy, ball.faces, "paper").vertices[far], atol=1e-12)


def test_the_paper_s_smoothing_goes_no_farther_than_neighbours():
    """A corner of a coarse, deep dish, whose patch is two edges off."""
    rng = np.random.default_rng(1)
    ball = sphere(resolution=3)
    crumpled = ball.vertices * rng.uniform(0.05, 1.0, (len(ball.vertices), 1)) ** 2
    edges = np.linalg.norm(crumpled[ball.faces] - crumpled[np.roll(ball.faces, 1, axis=1)], axis=2)
    longest = np.zeros(len(crumpled))
    for k in range(3):
        np.maximum.at(longest, ball.faces[:, k], np.maximum(edges[:, k], edges[:, (k + 1) % 3]))
    patches = estimate_vertex_geometry(crumpled, ball.faces, rings=2, alpha=0.8, smoothness="paper")
    far = np.linalg.norm(patches.displacements, axis=1) > longest
    moved = smooth(crumpled, ball.faces, "paper").displacement
    assert far.any()
    assert not moved[far].any()
    assert (moved <= longest).all()


def test_progress_ends_and_cancels(coarse_block):
    _, noisy, faces = coarse_block
    seen = []
    smooth(noisy, faces, progress=lambda done, total: seen.append(done / total))
    assert seen == sorted(seen)
    assert seen[-1] == 1.0
    with pytest.raises(CancelledError):
        smooth(noisy, faces, progress=lambda done, total: False)


def test_impulses_at_a_fifth_of_the_vertices_go():
    """Among so many some look sound at first, so they are taken off more than once."""
    shape = bumpy_star(resolution=14, jitter=0.2)
    random, edge = np.random.default_rng(0), edge_of(shape.vertices, shape.faces)
    heights = 0.5 * edge * random.standard_normal(len(shape.vertices)) * (random.random(len(shape.vertices)) < 0.2)
    noisy = shape.vertices + heights[:, np.newaxis] * shape.normals
    left = np.einsum("ij,ij->i", smooth(noisy, shape.faces).vertices - shape.vertices, shape.normals)
    assert np.sqrt(np.square(left).mean()) < 0.3 * np.sqrt(np.square(heights).mean())


def test_a_given_strength_matters_where_the_noise_varies():
    """Ten times as strong on one side as on the other: who says how strong it is gets it off."""
    shape = torus(resolution=24, jitter=0.2)
    place = shape.vertices[:, 0] - shape.vertices[:, 0].min()
    edge = edge_of(shape.vertices, shape.faces)
    sigma = 0.05 * edge * 10.0 ** (place / place.max() - 0.5)
    noisy = (
        shape.vertices + (sigma * np.random.default_rng(0).standard_normal(len(place)))[:, np.newaxis] * shape.normals
    )
    strength = np.sqrt(np.square(sigma).mean())
    left = [
        np.linalg.norm(smooth(noisy, shape.faces, noise=share * strength).vertices - shape.vertices, axis=1)
        for share in (0.2, 1.0)
    ]
    assert np.sqrt(np.square(left[1]).mean()) < 0.7 * np.sqrt(np.square(left[0]).mean())


def test_a_coarse_part_is_not_taken_for_noise():
    """A pot of 24 corners: noise as high as what its edges bridge would make them longer than they are."""
    angles = np.linspace(0.0, 2.0 * np.pi, 6, endpoint=False)
    circle = np.column_stack([np.cos(angles), np.sin(angles)])
    rings = ((1.0, 0.0), (1.0, 3.0), (0.8, 3.0), (0.8, 0.2))
    pot = np.vstack([np.column_stack([radius * circle, np.full(6, height)]) for radius, height in rings])
    i, j = np.arange(6), np.roll(np.arange(6), -1)
    walls = [np.column_stack(face) + 6 * k for k in range(3) for face in ((i, j, j + 6), (i, j + 6, i + 6))]
    fan = np.array([[0, k, k + 1] for k in range(1, 5)])
    result = smooth(pot, np.vstack([*walls, fan[:, ::-1], fan + 18]))
    assert result.noise_before is None
    np.testing.assert_array_equal(result.vertices, pot)


def test_a_model_of_few_triangles_stays_as_it_is():
    """Its detail is as large as its edges: wider neighbourhoods fold, and noise cannot be distinguished from shape."""
    ring = torus(resolution=8)
    noisy = with_noise(ring.vertices, ring.faces, ring.normals, 0.2)
    result = smooth(noisy, ring.faces)
    np.testing.assert_array_equal(result.vertices, noisy)
    assert result.noise_before is None
    assert "too coarse to distinguish noise from shape" in result.noise


def test_noise_that_turns_faces_over_is_removed_twice():
    ball = sphere(resolution=16, jitter=0.2)
    edge = edge_of(ball.vertices, ball.faces)
    noisy = ball.vertices + 0.6 * edge * np.random.default_rng(0).standard_normal(ball.vertices.shape)
    result = smooth(noisy, ball.faces)
    assert result.noise_heavy
    errors = (np.linalg.norm(result.vertices, axis=1) - 1.0) / edge
    assert np.sqrt(np.square(errors - errors.mean()).mean()) < 0.15
    assert result.flipped_after < 0.01 * len(ball.faces)
