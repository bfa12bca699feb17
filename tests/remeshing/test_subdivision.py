"""Subdivision: new vertices on the true surface, sharp edges where they were, and meshes without gaps."""

import numpy as np
import pytest

from bezier_filters import CancelledError, InvalidMeshError, InvalidParameterError, inspect_mesh, subdivide
from bezier_filters.remeshing.subdivision import MAX_FACES, check_tolerance, predict_faces
from bezier_filters.remeshing.surface_places import meeting_points
from bezier_filters.surfaces import block_with_sharp_edges, cylinder, height_field, sphere, torus


def rms(values):
    return np.sqrt(np.mean(np.square(values)))


def heights(points, major=1.0, minor=0.4):
    """Distances of points from a torus."""
    return np.hypot(np.hypot(points[:, 0], points[:, 1]) - major, points[:, 2]) - minor


def mean_edge(vertices, faces):
    return np.linalg.norm(vertices[faces] - vertices[np.roll(faces, 1, axis=1)], axis=2).mean()


def noisy_torus(level, *, jitter=0.3):
    ring = torus(resolution=24, jitter=jitter)
    noise = np.random.default_rng(0).standard_normal((len(ring.vertices), 1))
    return ring.vertices + level * mean_edge(ring.vertices, ring.faces) * noise * ring.normals, ring.faces


def smallest_angle(vertices, faces):
    sides = np.roll(vertices[faces], -1, axis=1) - vertices[faces]
    sides /= np.linalg.norm(sides, axis=2, keepdims=True)
    return np.degrees(np.arccos(np.clip(-np.einsum("fkd,fkd->fk", sides, np.roll(sides, 1, axis=1)), -1, 1)).min())


def closed_cylinder(count, rings=6):
    """A cylinder of radius 1 and height 2 with lids of rings of triangles."""
    turn = np.arange(count) * 2.0 * np.pi / count
    circle = np.column_stack([np.cos(turn), np.sin(turn)])
    profile = [(r, -1.0) for r in np.arange(1, rings) / rings]
    profile += [(1.0, z) for z in np.linspace(-1.0, 1.0, 2 * rings + 1)]
    profile += [(r, 1.0) for r in np.arange(rings - 1, 0, -1) / rings]
    points = np.vstack([np.column_stack([r * circle, np.full(count, z)]) for r, z in profile])
    points = np.vstack([points, [[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]]])
    here = np.arange(count)
    beside, faces = (here + 1) % count, []
    for k in range(len(profile) - 1):
        low, high = k * count, (k + 1) * count
        faces += [np.column_stack([low + here, low + beside, high + beside])]
        faces += [np.column_stack([low + here, high + beside, high + here])]
    last = (len(profile) - 1) * count
    faces += [np.column_stack([beside, here, np.full(count, len(points) - 2)])]
    faces += [np.column_stack([last + here, last + beside, np.full(count, len(points) - 1)])]
    return points, np.vstack(faces).astype(np.int32)


@pytest.mark.parametrize("jitter", [0.0, 0.3])
def test_new_vertices_lie_on_the_torus_and_old_ones_stay(jitter):
    vertices, faces = noisy_torus(0.0, jitter=jitter)
    finer = subdivide(vertices, faces)
    n = len(vertices)
    np.testing.assert_array_equal(finer.vertices[:n], vertices)
    assert not finer.moved
    assert len(finer.faces) == 4 * len(faces)
    assert rms(heights(finer.vertices[n:])) < 1e-4 * mean_edge(vertices, faces)
    assert len(finer.flat_vertices) == 0


def test_noise_stays_behind():
    vertices, faces = noisy_torus(0.1)
    finer = subdivide(vertices, faces)
    assert finer.moved
    edge = mean_edge(vertices, faces)
    assert rms(heights(finer.vertices[: len(vertices)])) < 0.5 * rms(heights(vertices))
    assert rms(heights(finer.vertices[len(vertices) :])) < 0.05 * edge


def test_noisy_vertices_stay_if_they_shall():
    vertices, faces = noisy_torus(0.1)
    finer = subdivide(vertices, faces, move=False, tolerance=1e-3)
    np.testing.assert_array_equal(finer.vertices[: len(vertices)], vertices)
    assert finer.chord_error <= 1e-3


def test_edges_are_split_to_a_tolerance():
    vertices, faces = noisy_torus(0.0)
    finer = subdivide(vertices, faces, tolerance=1e-3)
    assert 0.0 < finer.chord_error <= 1e-3
    ends = finer.vertices[np.vstack([finer.faces[:, [0, 1]], finer.faces[:, [1, 2]], finer.faces[:, [2, 0]]])]
    assert np.abs(heights(ends.mean(axis=1))).max() < 1.05e-3
    report = inspect_mesh(finer.vertices, finer.faces)
    assert (report.boundary_edges, report.non_manifold_edges, report.incoherent_edges) == (0, 0, 0)
    assert smallest_angle(finer.vertices, finer.faces) > 0.45 * smallest_angle(vertices, faces)
    # fewer faces than without a choice, which needs two iterations for the same tolerance
    assert len(finer.faces) < 0.8 * 16 * len(faces)


def test_sharp_edges_stay_sharp_and_planes_flat():
    block, faces = block_with_sharp_edges(resolution=12)
    finer = subdivide(block, faces)
    corners = block[faces[finer.old_faces]]
    weights = np.dstack([1.0 - finer.coordinates.sum(axis=2), finer.coordinates])
    np.testing.assert_allclose(finer.vertices[finer.faces], weights @ corners, atol=1e-9)
    assert len(subdivide(block, faces, tolerance=1e-6).faces) == len(faces)


def test_a_round_sharp_edge_becomes_rounder():
    """The edge of a cylinder lies on its lid, which has chords, and on the cylinder, which has arcs."""
    vertices, faces = closed_cylinder(32)
    finer = subdivide(vertices, faces).vertices
    rim = finer[(np.abs(np.abs(finer[:, 2]) - 1.0) < 1e-6) & (np.hypot(finer[:, 0], finer[:, 1]) > 0.99)]
    assert len(rim) == 128
    assert np.abs(np.hypot(rim[:, 0], rim[:, 1]) - 1.0).max() < 2e-4  # the sagitta of a chord is 4.8e-3


def test_the_border_of_a_tube_becomes_rounder():
    tube = cylinder(radius=1.0)
    finer = subdivide(tube.vertices, tube.faces)
    assert np.abs(np.hypot(finer.vertices[:, 0], finer.vertices[:, 1]) - 1.0).max() < 2e-4
    before, after = (inspect_mesh(mesh.vertices, mesh.faces).boundary_edges for mesh in (tube, finer))
    assert after == 2 * before


def test_only_selected_faces_become_four():
    ball = sphere(resolution=8)
    selected = ball.vertices[ball.faces][..., 2].min(axis=1) > 0.2
    finer = subdivide(ball.vertices, ball.faces, selected=selected, iterations=2)
    counts = np.bincount(finer.old_faces, minlength=len(ball.faces))
    assert (counts[selected] >= 16).all()
    far = ball.vertices[ball.faces][..., 2].max(axis=1) < 0.0
    assert (counts[far] == 1).all()
    report = inspect_mesh(finer.vertices, finer.faces)
    assert (report.boundary_edges, report.non_manifold_edges) == (0, 0)
    assert np.abs(np.linalg.norm(finer.vertices, axis=1) - 1.0).max() < 1e-3


def test_planes_meet_nearest_to_their_points():
    normals = np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, 1], [0, 0.1, 1]])
    points = np.array([[1.0, 5, 5], [5, 2, 5], [5, 5, 3], [0, 0, 1], [0, 0, 3]])
    normals[4] /= np.linalg.norm(normals[4])
    found = meeting_points(points, normals, np.array([0, 0, 0, 1, 1]), 3)
    np.testing.assert_allclose(found, [[1, 2, 3], [0, 0, 2], [0, 0, 0]], atol=1e-12)


@pytest.mark.parametrize("scale", [1e-30, 1e30])
def test_it_follows_the_scale(scale):
    ball = sphere(resolution=6)
    plain = subdivide(ball.vertices, ball.faces, tolerance=0.004)
    scaled = subdivide(scale * ball.vertices, ball.faces, tolerance=0.004 * scale)
    np.testing.assert_array_equal(scaled.faces, plain.faces)
    np.testing.assert_allclose(scaled.vertices, scale * plain.vertices, atol=1e-5 * scale)
    np.testing.assert_allclose(scaled.chord_error, scale * plain.chord_error, rtol=1e-2)


def test_vertices_without_faces_stay():
    ball = sphere(resolution=6)
    vertices = np.vstack([[5.0, 0, 0], ball.vertices])
    finer = subdivide(vertices, ball.faces + 1)
    np.testing.assert_array_equal(finer.vertices[: len(vertices)], vertices)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"iterations": 0}, "iterations"),
        ({"iterations": 11}, "iterations"),
        ({"tolerance": 0.0}, "tolerance"),
        ({"tolerance": np.inf}, "tolerance"),
        ({"selected": np.zeros(3, np.bool_)}, "selected"),
        ({"iterations": 10}, "50,000,000"),
        ({"tolerance": 1e-12}, "50,000,000; the smallest tolerance that fits is about [1-9]"),
    ],
)
def test_wrong_parameters_are_refused(options, message):
    ball = sphere(resolution=8)
    with pytest.raises(InvalidParameterError, match=message):
        subdivide(ball.vertices, ball.faces, **options)


def test_the_number_of_faces_is_predicted_before_the_work():
    """The tolerance of the message fits, and the prediction is right within a factor of two."""
    ball = sphere(resolution=8)
    with pytest.raises(InvalidParameterError) as refusal:
        subdivide(ball.vertices, ball.faces, tolerance=1e-13)
    least = float(str(refusal.value).split()[-1])
    middles = 0.5 * (ball.vertices[ball.faces] + ball.vertices[np.roll(ball.faces, 1, axis=1)])
    distances = 1.0 - np.linalg.norm(middles, axis=2).min(axis=1)
    assert 0.8 < predict_faces(least, distances) / MAX_FACES < 1.2
    with pytest.raises(InvalidParameterError):
        check_tolerance(0.7 * least, distances)
    assert 0.5 < len(subdivide(ball.vertices, ball.faces, tolerance=1e-4).faces) / predict_faces(1e-4, distances) < 2.0


def test_a_tolerance_below_rounding_ends_on_planes():
    block, faces = block_with_sharp_edges(resolution=4)
    assert len(subdivide(block, faces, tolerance=1e-300).faces) == len(faces)


def test_splits_end_where_they_do_not_help():
    """A fin on an edge of a ball, where the surface has a step: only the faces there are finer than without it."""
    ball = sphere(resolution=8)
    a, b, _ = ball.faces[0]
    vertices = np.vstack([ball.vertices, 1.5 * ball.vertices[[a, b]].mean(axis=0)])
    found = subdivide(vertices, np.vstack([ball.faces, [[a, b, len(ball.vertices)]]]), tolerance=1e-3)
    assert len(found.unresolved_faces) >= 1
    assert found.chord_error > 1e-3
    clean = subdivide(ball.vertices, ball.faces, tolerance=1e-3)
    assert not len(clean.unresolved_faces)
    assert len(found.faces) < 1.1 * len(clean.faces)


@pytest.mark.parametrize("options", [{"iterations": 3}, {"tolerance": 1e-4}])
def test_splits_report_their_progress_and_can_be_cancelled(options):
    ball, seen = sphere(resolution=8), []
    subdivide(ball.vertices, ball.faces, progress=lambda done, total: seen.append((done, total)), **options)
    assert seen[-1][0] == seen[-1][1]
    fits = max(k for k, (_, total) in enumerate(seen) if total >= len(ball.vertices))
    rounds = [done for done, _ in seen[fits + 1 :]]
    assert rounds == sorted(rounds)
    assert len(set(rounds)) >= 3
    calls = iter(range(len(seen)))
    with pytest.raises(CancelledError):
        subdivide(ball.vertices, ball.faces, progress=lambda *_: next(calls) < fits + 2, **options)


def test_a_cloud_is_refused():
    with pytest.raises(InvalidMeshError, match="needs a surface"):
        subdivide(height_field(lambda x, y: [0.0 * x] * 6, resolution=4).vertices)
