import numpy as np
import pytest
from hole_cases import assert_filled, cube, filled_hole, off_the_cube, sheet, without_faces_near

from bezier_filters import fill_holes
from bezier_filters.holes.crease_ends import CreaseEnd
from bezier_filters.holes.crease_fill import (
    FAR_CORNER,
    bending_energy,
    crease_partitions,
    hermite_curve,
    nearest_corner,
    resample_polyline,
)
from bezier_filters.surfaces import block_with_sharp_edges


@pytest.mark.parametrize(
    ("center", "radius", "parts"),
    [((-0.5, -0.5, 0.0), 0.2, 2), ((-0.5, -0.5, -0.5), 0.2, 3), ((-0.5, 0.0, 0.0), 0.2, 1)],
)
def test_edges_and_corners_of_a_block_are_continued(center, radius, parts):
    vertices, faces = cube()
    faces = without_faces_near(vertices, faces, np.array(center), radius)
    result = fill_holes(vertices, faces)
    assert_filled(vertices, faces, result)
    hole = filled_hole(result)
    assert hole.parts == parts
    assert hole.method == ("creases" if parts > 1 else "surface")
    assert off_the_cube(result.vertices[len(vertices) :]).max() < 1e-6
    on_crease = result.vertices[np.unique(hole.creases)] if parts > 1 else np.empty((0, 3))
    assert (np.count_nonzero(np.abs(np.abs(on_crease) - 0.5) < 1e-6, axis=1) >= 2).all()
    if parts == 3:
        assert np.linalg.norm(result.vertices + 0.5, axis=1)[len(vertices) :].min() < 1e-6


@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_a_crease_of_one_edge_that_ends_at_a_corner_is_continued(noise):
    vertices, faces = cube(resolution=12)
    faces = without_faces_near(vertices, faces, np.array([-0.5, -0.5, -0.2]), 0.21)
    on_edge = (np.abs(vertices[:, :2] + 0.5) < 1e-9).all(axis=1)
    left = np.sort(vertices[np.unique(faces[on_edge[faces]]), 2])
    np.testing.assert_allclose(left[:2], [-0.5, -0.5 + 1 / 12], atol=1e-9)  # one edge, and then the hole
    assert left[2] - left[1] > 2.5 / 12
    vertices = vertices + np.random.default_rng(3).normal(0.0, noise / 12, vertices.shape)
    hole = filled_hole(fill_holes(vertices, faces))
    assert (hole.method, hole.parts) == ("creases", 2)


def test_a_part_with_few_faces_of_its_own_is_spanned_between_creases():
    u, v = np.meshgrid(np.arange(-9, 11), np.arange(-9, 10), indexing="ij")
    below = u > 0  # a step as high as one edge: its wall has one row of faces
    vertices = np.stack([u - below, v, -1.0 * below], axis=-1).reshape(-1, 3).astype(np.float64)
    corner = np.arange(u.size, dtype=np.int32).reshape(u.shape)
    a, b, c, d = corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]
    faces = np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)
    faces = without_faces_near(vertices, faces, np.array([0.0, 0.0, -0.5]), 2.4)
    result = fill_holes(vertices, faces)
    assert_filled(vertices, faces, result)
    hole = filled_hole(result)
    assert (hole.method, hole.parts) == ("creases", 3)
    x, _, z = result.vertices[len(vertices) :].T
    on_step = np.minimum(np.minimum(np.hypot(np.maximum(x, 0), z), np.hypot(np.minimum(x, 0), z + 1)), np.abs(x))
    assert on_step.max() < 1e-3


def test_creases_are_edges_of_the_new_mesh():
    vertices, faces = cube()
    faces = without_faces_near(vertices, faces, np.array([-0.5, -0.5, -0.5]), 0.25)
    result = fill_holes(vertices, faces)
    new = np.sort(result.faces[len(faces) :][:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    edges, count = np.unique(new, axis=0, return_counts=True)
    inner = {tuple(edge) for edge in edges[count == 2].tolist()}
    creases = {tuple(edge) for edge in np.sort(filled_hole(result).creases, axis=1).tolist()}
    assert len(creases) >= 6
    assert creases <= inner


def test_creases_can_be_left_alone():
    vertices, faces = cube()
    faces = without_faces_near(vertices, faces, np.array([-0.5, -0.5, 0.0]), 0.2)
    result = fill_holes(vertices, faces, creases=False)
    assert_filled(vertices, faces, result)
    assert filled_hole(result).method != "creases"
    assert len(filled_hole(result).creases) == 0


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_ridges_and_valleys_are_continued(sign):
    vertices, faces = sheet(24, 24)
    vertices = (vertices - 12.0) / 12.0
    vertices[:, 2] = -sign * np.abs(vertices[:, 0])
    faces = without_faces_near(vertices, faces, np.zeros(3), 0.4)
    result = fill_holes(vertices, faces)
    assert_filled(vertices, faces, result)
    x, _, z = result.vertices[len(vertices) :].T
    assert filled_hole(result).method == "creases"
    np.testing.assert_allclose(z, -sign * np.abs(x), atol=1e-6)


@pytest.mark.parametrize("center", [(-0.5, -0.5, 0.0), (-0.5, -0.5, -0.5), (0.0, 0.0, 0.25)])
@pytest.mark.parametrize("seed", [0, 1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (2, 3))])
def test_rounding_decides_nothing(center, seed):
    """Points of the edges that are continued lie on straight lines, where areas are zero but for rounding."""
    vertices, faces = block_with_sharp_edges(resolution=24)
    faces = without_faces_near(vertices, faces, np.array(center), 0.14)
    turn = np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))[0]
    turn *= np.linalg.det(turn)
    result = fill_holes(vertices @ turn.T, faces)
    assert_filled(vertices @ turn.T, faces, result)
    assert filled_hole(result).method == "creases"
    new = result.vertices[len(vertices) :] @ turn
    x, y, z = new.T
    in_notch = (x > -1e-6) & (y > -1e-6) & (z > -1e-6)
    off = np.where(in_notch, np.abs(new).min(axis=1), off_the_cube(new))
    assert off.max() < 1e-6


def rounded_cube(radius, resolution, seed):
    """The cube [-1/2, 1/2]^3 with rounded edges, but for what is near the notch of the block."""
    vertices, faces = block_with_sharp_edges(resolution=resolution, jitter=0.2, seed=seed)
    inner = np.clip(vertices, radius - 0.5, 0.5 - radius)
    offsets = vertices - inner
    lengths = np.linalg.norm(offsets, axis=1, keepdims=True)
    rounded = np.where(lengths > 0.0, inner + radius * offsets / np.maximum(lengths, 1e-300), vertices)
    return np.where((vertices < 0.2).all(axis=1, keepdims=True), rounded, vertices), faces


@pytest.mark.parametrize(("radius", "worst"), [(0.3, 0.01), (0.5, 0.01), (1.0, 0.025)])
@pytest.mark.parametrize("seed", [0, 1])
def test_edges_rounded_by_less_than_an_edge_of_the_mesh_are_continued(radius, worst, seed):
    """Also where the rim runs along the edge for a while. A smooth fill is some 4 % of the hole's diameter off."""
    radius /= 24.0
    vertices, faces = rounded_cube(radius, 24, seed)
    faces = without_faces_near(vertices, faces, np.array([-0.5, -0.5, -0.15]), 0.12)
    result = fill_holes(vertices, faces)
    assert_filled(vertices, faces, result)
    hole = filled_hole(result)
    assert hole.method == "creases"
    new = result.vertices[len(vertices) :]
    inner = np.clip(new, radius - 0.5, 0.5 - radius)
    off = np.abs(np.linalg.norm(new - inner, axis=1) - radius)
    assert off.max() < worst * hole.diameter


def test_a_rim_along_a_crease_belongs_to_it():
    """A hole beside an edge of a cube: its rim follows the edge, of which hardly anything is in the hole."""
    vertices, faces = cube()
    x, y, z = vertices[faces].mean(axis=1).T
    removed = (np.abs(z) < 0.17) & (x < -0.49) & (y < -0.3)
    removed |= (z > 0.13) & (z < 0.17) & (y < -0.49) & (x < -0.45)  # and a bit beyond the edge at one end
    result = fill_holes(vertices, faces[~removed])
    assert_filled(vertices, faces[~removed], result)
    np.testing.assert_allclose(off_the_cube(result.vertices[len(vertices) :]), 0.0, atol=2e-3)


def test_a_curved_crease_is_continued_on_both_surfaces():
    """A cone on a plane: the crease is a circle of radius 1."""
    vertices, faces = sheet(40, 40)
    vertices = (vertices - 20.0) / 10.0
    radius = np.linalg.norm(vertices[:, :2], axis=1)
    near = np.abs(radius - 1.0) < 0.06
    vertices[near, :2] /= radius[near, np.newaxis]  # a ring of edges near the circle
    from scipy.spatial import Delaunay

    angle = 2 * np.pi * np.arange(63) / 63
    circle = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(63)])
    points = np.vstack([circle, vertices[np.abs(radius - 1.0) > 0.06]])
    faces = Delaunay(points[:, :2]).simplices.astype(np.int32)
    a, b, c = points[faces].transpose(1, 0, 2)
    turned = np.cross(b - a, c - a)[:, 2] < 0
    faces[turned] = faces[turned][:, ::-1]
    points[:, 2] = np.maximum(1.0 - np.linalg.norm(points[:, :2], axis=1), 0.0) * 2.0
    faces = without_faces_near(points, faces, np.array([1.0, 0.0, 0.0]), 0.3)
    result = fill_holes(points, faces)
    assert_filled(points, faces, result)
    hole = filled_hole(result)
    assert hole.method == "creases"
    on_crease = result.vertices[np.unique(hole.creases)]
    np.testing.assert_allclose(np.linalg.norm(on_crease, axis=1), 1.0, atol=5e-3)
    new = result.vertices[len(points) :]
    heights = np.maximum(1.0 - np.linalg.norm(new[:, :2], axis=1), 0.0) * 2.0
    assert np.abs(new[:, 2] - heights).max() < 0.02


def folded_sheet(lines, height):
    """A sheet over [-1, 1]^2 with vertices along lines (n, 2), and heights of a function of x and y."""
    from scipy.spatial import Delaunay

    x, y = sheet(40, 40)[0][:, :2].T / 20.0 - 1.0
    others = np.stack([x, y], axis=1)
    off = np.linalg.norm(others[:, np.newaxis] - lines, axis=2).min(axis=1)
    flat = np.vstack([lines, others[off > 0.03]])
    faces = Delaunay(flat).simplices.astype(np.int32)
    a, b, c = flat[faces].swapaxes(0, 1)
    doubled = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    faces[doubled < 0] = faces[doubled < 0][:, ::-1]
    return np.column_stack([flat, height(*flat.T)]), faces[np.abs(doubled) > 1e-5]


def test_a_crease_that_fades_at_the_other_side_of_the_hole_goes_on_to_it():
    """A fold of 55 degrees on the left, of 25 on the right: there it is no sharp edge by itself."""

    def height(x, y):
        return -np.abs(y) * np.tan(np.radians(20.0 - 7.5 * x))

    x = np.linspace(-1.0, 1.0, 41)
    vertices, faces = folded_sheet(np.stack([x, 0.0 * x], axis=1), height)
    faces = without_faces_near(vertices, faces, np.array([0.3, 0.0, 0.0]), 0.4)
    result = fill_holes(vertices, faces)
    assert_filled(vertices, faces, result)
    hole = filled_hole(result)
    assert hole.method == "creases"
    np.testing.assert_allclose(result.vertices[np.unique(hole.creases), 1], 0.0, atol=2e-3)
    new = result.vertices[len(vertices) :]
    assert np.abs(new[:, 2] - height(*new[:, :2].T)).max() < 2e-3


def test_a_ridge_and_a_valley_end_where_they_meet_in_the_hole():
    """A step that becomes narrower and lower to nothing, as the tip of a dart: the surface around it is smooth."""

    def half_width(x):
        return 0.6 * np.maximum(-x, 0.0) ** 1.5

    def height(x, y):
        return np.clip(y, -half_width(x), half_width(x))

    x = np.linspace(-1.0, 0.0, 21)
    upper, lower = (np.stack([x, sign * half_width(x)], axis=1) for sign in (1.0, -1.0))
    vertices, faces = folded_sheet(np.vstack([upper, lower[:-1]]), height)
    faces = without_faces_near(vertices, faces, np.zeros(3), 0.3)
    off = {}
    for creases in (True, False):
        result = fill_holes(vertices, faces, creases=creases)
        assert_filled(vertices, faces, result)
        hole = filled_hole(result)
        assert (hole.method == "creases") == creases
        new = result.vertices[len(vertices) :]
        off[creases] = np.sqrt(np.square(new[:, 2] - height(*new[:, :2].T)).mean())
        if creases:
            tip = result.vertices[np.unique(hole.creases), 0].max()
            assert -0.2 < tip < 0.1
    assert off[True] < 0.5 * off[False]


def ends_at(points, tangents, convex):
    return [
        CreaseEnd(k, np.array(t) / np.linalg.norm(t), c) for k, (t, c) in enumerate(zip(tangents, convex, strict=True))
    ]


def test_ends_are_joined_where_curves_bend_least_and_do_not_cross():
    """Four ends around a square, two parallel creases: the short way is across, by straight lines."""
    points = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    tangents = [[1, 0, 0], [-1, 0, 0], [-1, 0, 0], [1, 0, 0]]
    assert crease_partitions(ends_at(points, tangents, [True] * 4), points) == [[(0, 1), (2, 3)]]
    turned = [[0, 1, 0], [0, 1, 0], [0, -1, 0], [0, -1, 0]]
    assert crease_partitions(ends_at(points, turned, [True] * 4), points) == [[(0, 3), (1, 2)]]
    assert crease_partitions(ends_at(points[:2], tangents[:2], [True, False]), points[:2]) == []
    assert crease_partitions(ends_at(points[:1], tangents[:1], [True]), points[:1]) == []
    assert crease_partitions([], np.empty((0, 3))) == []


def test_a_ridge_and_a_valley_are_joined_at_a_tip_if_nothing_else_is_left():
    points = np.array([[-1.0, 0.3, 0], [-1, -0.3, 0]])
    assert crease_partitions(ends_at(points, -points, [True, False]), points) == [[(0, 1)]]
    assert crease_partitions(ends_at(points, points, [True, False]), points) == []  # they lead out of the hole


def test_three_ends_meet_in_a_corner_or_two_are_joined():
    points = np.array([[-1.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    assert crease_partitions(ends_at(points, -points, [True, True, True]), points) == [[(0, 1, 2)], [(0, 1)]]


def test_more_ends_meet_where_their_lines_do():
    angles = 2.0 * np.pi * np.arange(6) / 6
    points = np.stack([np.cos(angles), np.sin(angles), np.zeros(6)], axis=1)
    up = -points + [0.0, 0.0, 1.0]
    assert crease_partitions(ends_at(points, up, [True] * 6), points)[0] == [(0, 1, 2, 3, 4, 5)]
    mixed = [True, False] * 3
    assert crease_partitions(ends_at(points, -points, mixed), points)[0] == [(0, 1, 2, 3, 4, 5)]
    assert crease_partitions(ends_at(points[:4], points[:4], [True] * 4), points[:4]) == []  # they lead out of the hole


def test_a_corner_and_a_pair_share_a_hole():
    """Three edges meet on the left, one passes on the right."""
    points = np.array([[-4.0, 0, 0], [-3, -1, 0], [3, -1, 0], [3, 1, 0], [-3, 1, 0]])
    corner = np.array([-3.0, 0.0, 0.0])
    tangents = np.where([[1], [1], [0], [0], [1]], corner - points, np.array([0.0, 1.0, 0.0]))
    tangents[3] *= -1.0
    assert crease_partitions(ends_at(points, tangents, [True] * 5), points)[0] == [(0, 1, 4), (2, 3)]


def pointed_roof(spokes, heights):
    """A roof over the unit disk that is flat between spokes, without its top; its edges follow the spokes.

    `heights` are those of the ends of the spokes; the top is at 0.
    """
    from scipy.spatial import Delaunay

    tips = np.stack([np.cos(spokes), np.sin(spokes)], axis=1)
    radii = np.arange(21)[1:, np.newaxis, np.newaxis] / 20.0
    along = (radii * tips).reshape(-1, 2)
    x, y = sheet(40, 40)[0][:, :2].T / 20.0 - 1.0
    jitter = np.random.default_rng(0).uniform(-0.01, 0.01, (len(x), 2))
    others = np.stack([x, y], axis=1) + jitter
    ahead, aside = others @ tips.T, others @ np.stack([-tips[:, 1], tips[:, 0]])
    beside = ((np.abs(aside) < 0.035) & (ahead > 0.0)).any(axis=1)
    flat = np.vstack([along, others[~beside & (np.linalg.norm(others, axis=1) < 1.0)]])
    faces = Delaunay(flat).simplices.astype(np.int32)
    a, b, c = flat[faces].swapaxes(0, 1)
    doubled = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    faces[doubled < 0] = faces[doubled < 0][:, ::-1]
    faces = faces[np.abs(doubled) > 1e-5]

    def height(points):
        sector = np.searchsorted(spokes, np.arctan2(points[:, 1], points[:, 0]) % (2.0 * np.pi)) - 1
        following = (sector + 1) % len(spokes)
        shares = np.linalg.solve(np.stack([tips[sector], tips[following]], axis=2), points[:, :2, np.newaxis])[..., 0]
        return shares[:, 0] * heights[sector] + shares[:, 1] * heights[following]

    vertices = np.column_stack([flat, height(flat)])
    return vertices, without_faces_near(np.column_stack([flat, 0.0 * flat[:, 0]]), faces, np.zeros(3), 0.35), height


@pytest.mark.parametrize("sides", [4, pytest.param(5, marks=pytest.mark.slow), 6])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_top_of_a_pyramid_is_a_point_again(sides, sign):
    spokes = 0.1 + 2.0 * np.pi * np.arange(sides) / sides
    vertices, faces, height = pointed_roof(spokes, np.full(sides, -sign))
    assert_roof(vertices, faces, height, sides)


def test_ridges_and_valleys_meet_in_a_saddle():
    vertices, faces, height = pointed_roof(0.1 + 0.5 * np.pi * np.arange(4), np.array([1.0, -1.0, 1.0, -1.0]))
    assert_roof(vertices, faces, height, 4)


def assert_roof(vertices, faces, height, sides):
    result = fill_holes(vertices, faces)
    assert_filled(vertices, faces, result)
    hole = filled_hole(result)
    assert hole.method == "creases"
    assert hole.parts == sides
    new = result.vertices[len(vertices) :]
    np.testing.assert_allclose(new[:, 2], height(new), atol=1e-4)
    assert np.linalg.norm(new, axis=1).min() < 1e-4  # the top itself


def test_a_corner_is_where_most_lines_meet():
    corner, tangents = np.array([1.0, 2.0, 3.0]), np.eye(3)
    points = corner - 2.0 * tangents
    np.testing.assert_allclose(nearest_corner(points, tangents, [], 1e-6), corner, atol=1e-5)
    bent = points + np.array([[0.0, 0, 0], [0, 0, 0], [0.5, 0.3, 0]])
    np.testing.assert_allclose(nearest_corner(bent, tangents, [], 1e-6), corner, atol=1e-3)


def test_hermite_curves_leave_along_their_tangents():
    start, stop = np.zeros(3), np.array([2.0, 0.0, 0.0])
    up, down = np.array([1.0, 1.0, 0.0]) / np.sqrt(2), np.array([1.0, -1.0, 0.0]) / np.sqrt(2)
    curve = hermite_curve(start, up, stop, down, 0.01)
    np.testing.assert_allclose(curve[0] / np.linalg.norm(curve[0]), up, atol=0.02)
    np.testing.assert_allclose((stop - curve[-1]) / np.linalg.norm(stop - curve[-1]), down, atol=0.02)
    spaces = np.linalg.norm(np.diff(np.vstack([start, curve, stop]), axis=0), axis=1)
    assert spaces.max() < 1.05 * spaces.min()
    assert len(resample_polyline(np.array([start, stop]), 0.5)) == 3


@pytest.mark.parametrize("angle", [0.05, 0.2, 0.4])
def test_bending_energy_of_an_arc_is_the_squared_angle(angle):
    """A circular arc of unit length that turns by an angle has the curvature, and the energy, angle and angle^2."""
    start, stop = np.zeros(3), np.array([1.0, 0.0, 0.0])
    leaves, arrives = (np.array([np.cos(angle / 2), s * np.sin(angle / 2), 0.0]) for s in (1.0, -1.0))
    assert bending_energy(start, leaves, stop, arrives) == pytest.approx(angle**2, rel=0.05)


def test_no_curves_to_a_corner_far_away():
    """The edges of an obelisk meet high above it: curves to there would have as many points as its height has edges."""
    n, apex, side = 8, 100.0, np.linspace(-0.5, 0.5, 9)[:-1]
    quarter = np.column_stack([side, np.full(n, -0.5)])
    ring = np.vstack([quarter @ np.array([[c, s], [-s, c]]) for c, s in ((1, 0), (0, 1), (-1, 0), (0, -1))])
    layers = [np.column_stack([ring * (1.0 - z / apex), np.full(4 * n, z)]) for z in np.linspace(0.0, 1.0, n + 1)]
    a = np.arange(4 * n * n)
    b = a - a % (4 * n) + (a + 1) % (4 * n)
    faces = np.vstack([np.column_stack([a, b, b + 4 * n]), np.column_stack([a, b + 4 * n, a + 4 * n])])
    result = fill_holes(np.vstack(layers), faces, "surface", outer_rims=True)
    assert all(hole.filled for hole in result.holes)
    assert any(FAR_CORNER in hole.reason for hole in result.holes)
    assert result.vertices[:, 2].max() < 2.0
