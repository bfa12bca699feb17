"""Lines on surfaces whose lines are known: quadrics, tori, cylinders, a saddle; their spacing, ends and errors."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from bezier_filters import CancelledError, InvalidParameterError, LineEnd, fit_surface, trace_lines
from bezier_filters.status import FitStatus
from bezier_filters.surface_lines import lines as lines_module
from bezier_filters.surface_lines.umbilics import face_indices
from bezier_filters.surfaces import bumpy_star, cylinder, ellipsoid, height_field, torus, waves
from lines import AXES, deviation, exact_umbilics


def rms(values):
    return np.sqrt(np.mean(np.square(values)))


def add_noise(body, level, seed=0):
    """Vertices with noise along the true normals, in mean edges."""
    ends = body.vertices[body.faces]
    edge = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).mean()
    heights = level * edge * np.random.default_rng(seed).standard_normal((len(body.vertices), 1))
    return body.vertices + heights * body.normals


@pytest.fixture(scope="module")
def ellipsoid_lines():
    shape = ellipsoid(semi_axes=tuple(AXES), resolution=16, jitter=0.3)
    return trace_lines(fit_surface(shape.vertices, shape.faces), spacing=0.1)


def test_lines_of_curvature_of_an_ellipsoid_are_its_intersections_with_confocal_quadrics(ellipsoid_lines):
    for line in ellipsoid_lines.lines:
        assert deviation(line.points, of_max=line.kind == "max") < 1e-3
    assert sum(line.is_closed for line in ellipsoid_lines.lines) > 0.6 * len(ellipsoid_lines.lines)
    for line in ellipsoid_lines.lines:
        np.testing.assert_allclose(line.points[0], line.points[-1] if line.is_closed else line.points[0])


def test_an_ellipsoid_has_four_umbilics_of_index_one_half(ellipsoid_lines):
    found = np.array([umbilic.point for umbilic in ellipsoid_lines.umbilics])
    assert [umbilic.index for umbilic in ellipsoid_lines.umbilics] == [0.5] * 4
    distances, rows = cKDTree(exact_umbilics()).query(found)
    assert sorted(rows) == [0, 1, 2, 3]
    assert distances.max() < 5e-3


def test_lines_are_evenly_spaced(ellipsoid_lines):
    rows = np.random.default_rng(0).dirichlet([1.0, 1.0, 1.0], 4000)
    shape = ellipsoid(semi_axes=tuple(AXES), resolution=16, jitter=0.3)
    places = np.einsum("qk,qkd->qd", rows, shape.vertices[shape.faces[np.arange(4000) % len(shape.faces)]])
    for kind in ("max", "min"):
        lines = ellipsoid_lines.of_kind(kind)
        trees = [cKDTree(line.points) for line in lines]
        distance = np.min([tree.query(places)[0] for tree in trees], axis=0)
        assert np.mean(distance < 0.11) > 0.97
        for k, tree in enumerate(trees):
            nearest = min(tree.query(line.points)[0].min() for line in lines[:k] + lines[k + 1 :])
            assert nearest > 0.049


@pytest.mark.parametrize(("kind", "axis"), [("max", 1), ("min", 0)])
def test_lines_of_curvature_of_a_torus_are_its_circles(kind, axis):
    """On the outside k_max is that of the meridians, of radius 0.4."""
    ring = torus(resolution=24, jitter=0.3)
    seed = [1.4 * np.cos(0.3), 1.4 * np.sin(0.3), 0.0]
    (line,) = trace_lines(fit_surface(ring.vertices, ring.faces), kind, seeds=[seed]).lines
    assert line.is_closed
    assert line.length == pytest.approx(2.0 * np.pi * (0.4 if kind == "max" else 1.4), rel=2e-3)
    x, y, z = line.points.T
    angles = np.arctan2(y, x) - 0.3, np.arctan2(z, np.hypot(x, y) - 1.0)
    assert np.abs(angles[1 - axis]).max() < 0.01
    assert np.abs(line.geodesic_torsion).max() < 1e-9
    np.testing.assert_allclose(np.einsum("ij,ij->i", line.tangents, line.normals), 0.0, atol=1e-8)


@pytest.mark.parametrize("flipped", [False, True])
def test_torsion_lines_of_a_cylinder_are_helices(flipped):
    """Of 45 degrees; the plus one is right-handed from either side."""
    tube = cylinder(radius=1.0, length=4.0, resolution=36, jitter=0.2)
    surface = fit_surface(tube.vertices, tube.faces[:, ::-1] if flipped else tube.faces)
    plus, minus = trace_lines(surface, "torsion", seeds=[[1.0, 0.0, 0.1]]).lines
    for line, hand in ((plus, 1.0), (minus, -1.0)):
        turn = np.unwrap(np.arctan2(line.points[:, 1], line.points[:, 0]))
        slope = np.polyfit(turn, line.points[:, 2], 1)
        np.testing.assert_allclose(line.points[:, 2], np.polyval(slope, turn), atol=5e-3)
        assert slope[0] == pytest.approx(hand, abs=5e-3)
        np.testing.assert_allclose(line.geodesic_torsion, 0.5 * hand, atol=1e-2)
        assert line.ends == (LineEnd.BORDER, LineEnd.BORDER)
        assert np.ptp(line.points[:, 2]) == pytest.approx(np.ptp(tube.vertices[:, 2]), abs=0.01)


def test_lines_of_given_normal_curvature_have_it():
    """On a cylinder of radius 1 k = cos^2 theta, 1/4 at 60 degrees."""
    tube = cylinder(radius=1.0, length=4.0, resolution=36, jitter=0.2)
    surface = fit_surface(tube.vertices, tube.faces)
    found = trace_lines(surface, "normal", normal_curvature=0.25, seeds=[[1.0, 0.0, 0.1]])
    for line, hand in zip(found.lines, (1.0, -1.0), strict=True):
        np.testing.assert_allclose(line.normal_curvature, 0.25, atol=1e-12)
        turn = np.unwrap(np.arctan2(line.points[:, 1], line.points[:, 0]))
        assert np.polyfit(turn, line.points[:, 2], 1)[0] == pytest.approx(hand * np.sqrt(3.0), rel=1e-2)
    assert trace_lines(surface, "normal", normal_curvature=2.0, seeds=[[1.0, 0.0, 0.1]]).lines == ()


def test_asymptotic_lines_of_a_saddle_are_straight():
    """Those of z = x y are its rulings."""
    saddle = height_field(lambda x, y: [x * y, y, x, 0.0 * x, 1.0 + 0.0 * x, 0.0 * x], resolution=16, jitter=0.3)
    seed = np.array([[0.11, 0.07, 0.11 * 0.07]])
    lines = trace_lines(fit_surface(saddle.vertices, saddle.faces), "asymptotic", seeds=seed).lines
    spread = np.sort([np.ptp(line.points[:, :2], axis=0) for line in lines], axis=1)
    assert len(lines) == 2
    assert spread[:, 0].max() < 1e-3
    assert spread[:, 1].min() > 0.9 * np.ptp(saddle.vertices[:, 0])


def test_the_standard_error_of_the_direction_is_that_of_the_noise():
    ring = torus(resolution=32, jitter=0.3)
    found = trace_lines(fit_surface(add_noise(ring, 0.1), ring.faces), "min", spacing=0.1)
    scores = []
    for line in found.lines:
        around = np.cross([0.0, 0.0, 1.0], line.points)
        around /= np.linalg.norm(around, axis=1, keepdims=True)
        sine = np.linalg.norm(np.cross(line.tangents, around), axis=1)
        scores.append(np.arcsin(np.clip(sine, 0.0, 1.0)) / line.direction_std)
    assert 0.5 < rms(np.concatenate(scores)) < 1.6


@pytest.mark.parametrize("body", [bumpy_star(resolution=16, jitter=0.3), torus(resolution=16, jitter=0.3)])
@pytest.mark.parametrize("level", [0.0, 0.2])
def test_indices_add_up_to_the_euler_characteristic(body, level):
    surface = fit_surface(add_noise(body, level), body.faces)
    euler = len(body.vertices) - len(body.faces) // 2
    assert face_indices(surface.cut.faces, surface.geometry)[0].sum() == euler


@pytest.mark.parametrize("scale", [1e-30, 1e30])
def test_they_follow_the_scale(scale):
    shape, seed = ellipsoid(semi_axes=tuple(AXES), resolution=8), np.array([[0.5, 0.4, 0.5]])
    plain = trace_lines(fit_surface(shape.vertices, shape.faces), spacing=0.25, seeds=seed)
    found = trace_lines(fit_surface(scale * shape.vertices, shape.faces), spacing=0.25 * scale, seeds=scale * seed)
    assert len(found.lines) == len(plain.lines) == 2
    assert found.spacing == 0.25 * scale
    for one, other in zip(found.lines, plain.lines, strict=True):
        np.testing.assert_allclose(one.points, scale * other.points, rtol=0.0, atol=1e-5 * scale)
    assert found.umbilics[0].radius == pytest.approx(scale * plain.umbilics[0].radius)


def test_tangents_run_along_the_line(ellipsoid_lines):
    """From its first point to its last, on both sides of the seed."""
    for line in ellipsoid_lines.lines:
        steps = np.diff(line.points, axis=0)
        along = np.einsum("ij,ij->i", steps, line.tangents[:-1]) / np.linalg.norm(steps, axis=1)
        assert along.min() > 0.7


def test_closed_lines_have_no_short_last_step(ellipsoid_lines):
    """It would turn aside by the gap that is closed, to any angle."""
    for line in ellipsoid_lines.lines:
        steps = np.linalg.norm(np.diff(line.points, axis=0), axis=1)
        assert steps[-1] > 0.4 * np.median(steps) or not line.is_closed


@pytest.mark.parametrize("precision", [np.float32, np.float64])
@pytest.mark.parametrize("resolution", [6, 12, 30])
def test_turned_planes_have_no_lines(resolution, precision):
    """What rounding bends a regular mesh by is no curvature."""
    plane = height_field(lambda x, y: [0.0 * x] * 6, resolution=resolution)
    for seed in range(3):
        turn = np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))[0]
        vertices = (plane.vertices @ turn.T).astype(precision)
        assert trace_lines(fit_surface(vertices, plane.faces)).lines == ()


def test_lines_end_at_folds_where_no_surface_is_over_their_faces():
    """The patches at the corners of this mesh fold: tangents were tangent to another sheet."""
    hills, order = waves(), np.random.default_rng(0).permutation(1369)
    faces = np.argsort(order)[hills.faces][np.random.default_rng(0).permutation(len(hills.faces))]
    surface = fit_surface(hills.vertices[order], faces)
    assert surface.geometry.status.max() >= FitStatus.LOWER_DEGREE
    for line in trace_lines(surface).lines:
        np.testing.assert_allclose(np.einsum("ij,ij->i", line.tangents, line.normals), 0.0, atol=1e-6)


def test_wide_spacings_end():
    """Each face is on a line that is too short, and the same for many."""
    shape = ellipsoid(semi_axes=tuple(AXES), resolution=16)
    surface = fit_surface(shape.vertices, shape.faces)
    with pytest.raises(InvalidParameterError, match=r"spacing: got 1000000\.0, expected"):
        trace_lines(surface, spacing=1e6)
    calls = []
    found = trace_lines(surface, spacing=2.0, progress=lambda done, total: calls.append(done) or True)
    assert len(found.lines) < 10
    assert len(calls) < 200


def test_it_can_be_cancelled_while_no_line_is_long_enough():
    shape = ellipsoid(semi_axes=tuple(AXES), resolution=16)
    surface = fit_surface(shape.vertices, shape.faces)
    calls = []
    trace_lines(surface, "max", max_error=1e-6, progress=lambda done, total: calls.append(done) or True)
    assert len(calls) > 2


def test_the_number_of_points_is_bounded(monkeypatch):
    monkeypatch.setattr(lines_module, "MAX_POINTS", 4096)
    shape = ellipsoid(semi_axes=tuple(AXES), resolution=8)
    with pytest.raises(InvalidParameterError, match="seeds: the lines have more than 4,096 points; give fewer"):
        trace_lines(fit_surface(shape.vertices, shape.faces), seeds=np.tile(shape.vertices, (4, 1)))


def test_tables_and_dicts(ellipsoid_lines):
    assert "near_line" in str(ellipsoid_lines)
    assert ellipsoid_lines.to_dict()["lines"][0]["length"] > 0.2


@pytest.mark.parametrize(
    "options",
    [
        {"family": "geodesic"},
        {"spacing": 0.0},
        {"spacing": 1e-6},
        {"normal_curvature": 1.0},
        {"family": "normal"},
        {"family": "normal", "normal_curvature": np.nan},
        {"max_error": 50.0},
        {"seeds": [[0.0, 1.0]]},
        {"seeds": [[np.nan, 0.0, 1.0]]},
    ],
)
def test_wrong_arguments_are_refused(options):
    shape = ellipsoid(resolution=6)
    name = list(options)[-1]
    with pytest.raises(InvalidParameterError, match=name):
        trace_lines(fit_surface(shape.vertices, shape.faces), **options)


def test_lines_need_a_surface():
    shape = ellipsoid(resolution=6)
    with pytest.raises(InvalidParameterError, match="surface: got tuple"):
        trace_lines((shape.vertices, shape.faces))


def test_it_can_be_cancelled():
    shape = ellipsoid(resolution=6)
    surface = fit_surface(shape.vertices, shape.faces)
    with pytest.raises(CancelledError):
        trace_lines(surface, progress=lambda done, total: False)
