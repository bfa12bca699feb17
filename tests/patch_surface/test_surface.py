"""The blended surface: exact where patches are, tangent-continuous, and as accurate between vertices as at them."""

import numpy as np
import pytest

from bezier_filters import InvalidMeshError, InvalidParameterError, estimate_vertex_geometry, fit_surface, surface_at
from bezier_filters.kernels.kernel_input import PATCH_DEGREE, PATCH_HEAD, PATCH_ORIGIN, PATCH_SQUARE
from bezier_filters.surfaces import block_with_sharp_edges, bumpy_star, ellipsoid, height_field, sphere, torus

ON_SURFACE, AT_BORDER = 0, 1


def rms(values):
    return np.sqrt(np.mean(np.square(values)))


def random_places(faces, count, seed=0):
    rng = np.random.default_rng(seed)
    return rng.integers(0, len(faces), count), rng.dirichlet([1.0, 1.0, 1.0], count)[:, 1:]


def add_noise(body, level, seed=0):
    """Vertices with noise along the true normals, in mean edges."""
    ends = body.vertices[body.faces]
    edge = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).mean()
    heights = level * edge * np.random.default_rng(seed).standard_normal((len(body.vertices), 1))
    return body.vertices + heights * body.normals


def torus_truth(points, major=1.0, minor=0.4):
    """Distance from a torus, its normal and mean curvature."""
    radius = np.hypot(points[:, 0], points[:, 1])
    distance = np.hypot(radius - major, points[:, 2])
    cosine = (radius - major) / distance
    normals = np.column_stack([points[:, :2] * (cosine / radius)[:, np.newaxis], points[:, 2] / distance])
    return distance - minor, normals, 0.5 * (1.0 / minor + cosine / (major + minor * cosine))


@pytest.fixture(scope="module")
def ring():
    return torus(resolution=24, jitter=0.3)


@pytest.fixture(scope="module")
def ring_surface(ring):
    return fit_surface(ring.vertices, ring.faces)


def test_without_noise_it_passes_through_the_vertices_of_a_regular_mesh():
    """Lattices make the error of patches smooth, which looks like a little noise."""
    ring = torus(resolution=24)
    edge = np.linalg.norm(np.diff(ring.vertices[ring.faces[:, :2]], axis=1), axis=2).mean()
    surface = fit_surface(ring.vertices, ring.faces)
    at_vertices = surface.evaluate(np.arange(len(ring.faces)), np.zeros((len(ring.faces), 2)))
    np.testing.assert_allclose(at_vertices.points, ring.vertices[ring.faces[:, 0]], atol=1e-5 * edge)
    between = surface.evaluate(*random_places(ring.faces, 4000))
    assert rms(torus_truth(between.points)[0]) < 5e-5 * edge


@pytest.mark.parametrize("level", [3e-4, 0.1])
def test_noise_is_not_interpolated(level):
    ring = torus(resolution=40)
    surface = fit_surface(add_noise(ring, level), ring.faces)
    assert surface.geometry.noise_sigma > 0.0


def test_between_vertices_it_is_as_accurate_as_at_them(ring, ring_surface):
    geometry = estimate_vertex_geometry(ring.vertices, ring.faces)
    there = ring_surface.evaluate(*random_places(ring.faces, 4000))
    distance, normals, mean = torus_truth(there.points)
    _, own_normals, own_mean = torus_truth(ring.vertices)
    assert rms(there.mean_curvature - mean) < 1.5 * rms(geometry.mean_curvature - own_mean)
    assert rms(there.normals - normals) < 2.0 * rms(geometry.normals - own_normals)
    assert rms(distance) < 1.5 * rms(np.linalg.norm(geometry.displacements, axis=1))


@pytest.mark.parametrize("level", [0.0, 0.1])
def test_normals_agree_from_both_sides_of_every_edge(ring, level):
    surface = fit_surface(add_noise(ring, level), ring.faces)
    faces, neighbours = surface.arrays.faces, surface.arrays.neighbours
    near, corner = np.arange(len(faces)), np.random.default_rng(1).integers(0, 3, len(faces))
    far = neighbours[near, corner]
    ends = np.column_stack([faces[near, corner], faces[near, (corner + 1) % 3]])
    part = np.random.default_rng(2).uniform(0.01, 0.99, len(faces))

    def coordinates(of):
        at_start, at_end = faces[of] == ends[:, :1], faces[of] == ends[:, 1:]
        return (at_start * (1.0 - part)[:, np.newaxis] + at_end * part[:, np.newaxis])[:, 1:]

    one, other = surface.evaluate(near, coordinates(near)), surface.evaluate(far, coordinates(far))
    assert (one.outcome == ON_SURFACE).all()
    np.testing.assert_allclose(one.points, other.points, atol=1e-10)
    np.testing.assert_allclose(one.normals, other.normals, atol=1e-9)
    np.testing.assert_allclose(one.mean_curvature, other.mean_curvature, atol=1e-6)


def test_normals_are_those_of_the_positions(ring, ring_surface):
    """Differences of positions within a face are orthogonal to the normals, to the order of the step."""
    faces, places = random_places(ring.faces, 500, seed=4)
    places, step = 0.1 + 0.7 * places, 1e-6
    here = ring_surface.evaluate(faces, places)
    for shift in ([step, 0.0], [0.0, step]):
        there = ring_surface.evaluate(faces, places + shift)
        slopes = np.einsum("ij,ij->i", there.points - here.points, here.normals)
        assert np.abs(slopes).max() < 1e-3 * step


def test_at_a_vertex_it_is_the_patch_of_that_vertex(ring, ring_surface):
    geometry = estimate_vertex_geometry(ring.vertices, ring.faces, noise=0.0)
    there = ring_surface.evaluate(np.arange(len(ring.faces)), np.zeros((len(ring.faces), 2)))
    rows = ring.faces[:, 0]
    np.testing.assert_allclose(there.points, (ring.vertices + geometry.displacements)[rows], atol=1e-4)
    np.testing.assert_allclose(there.mean_curvature, geometry.mean_curvature[rows], atol=1e-3)
    assert (np.sort(there.direction_max @ [0.0, 0.0, 1.0]) <= 1.0).all()


def test_polynomials_of_degree_three_are_exact():
    """Patches that all are one cubic blend to that cubic, whose derivatives are known."""
    field = height_field(
        lambda x, y: (
            0.1 * x**3 - 0.2 * x * y**2 + 0.3 * x * y,
            0.3 * x**2 - 0.2 * y**2 + 0.3 * y,
            -0.4 * x * y + 0.3 * x,
            0.6 * x,
            -0.4 * y + 0.3,
            -0.4 * x,
        ),
        resolution=9,
        jitter=0.2,
    )
    surface = fit_surface(field.vertices, field.faces, noise=0.0)
    rows = surface.geometry.patch_rows
    rows[:] = 0.0
    rows[:, :PATCH_ORIGIN] = np.eye(3).ravel()
    rows[:, PATCH_SQUARE + 1] = rows[:, PATCH_SQUARE + 3] = 1.0
    rows[:, PATCH_DEGREE] = 3
    # origins at 0: the same polynomial for all vertices, x y, x^3 and x y^2 in rows of powers of y
    for a, b, value in ((1, 1, 0.3), (3, 0, 0.1), (1, 2, -0.2)):
        rows[:, PATCH_HEAD + a * 7 - a * (a - 1) // 2 + b] = value
    there = surface.evaluate(*random_places(field.faces, 500))
    x, y, z = there.points.T
    np.testing.assert_allclose(z, 0.1 * x**3 - 0.2 * x * y**2 + 0.3 * x * y, atol=1e-12)
    slopes = np.column_stack([0.3 * x**2 - 0.2 * y**2 + 0.3 * y, -0.4 * x * y + 0.3 * x])
    normals = np.column_stack([-slopes, np.ones(len(x))])
    np.testing.assert_allclose(there.normals, normals / np.linalg.norm(normals, axis=1, keepdims=True), atol=1e-12)
    p, q = slopes.T
    r, s, t = 0.6 * x, -0.4 * y + 0.3, -0.4 * x
    gaussian = (r * t - s * s) / (1.0 + p * p + q * q) ** 2
    np.testing.assert_allclose(there.gaussian_curvature, gaussian, atol=1e-10)


def test_nearest_places_are_those_of_the_torus(ring_surface):
    rng = np.random.default_rng(3)
    angles = rng.uniform(0.0, 2.0 * np.pi, (2, 3000))
    height = rng.uniform(-0.2, 0.3, 3000)
    radius = 1.0 + (0.4 + height) * np.cos(angles[1])
    points = np.column_stack(
        [radius * np.cos(angles[0]), radius * np.sin(angles[0]), (0.4 + height) * np.sin(angles[1])]
    )
    found = ring_surface.query(points)
    assert (found.outcome == ON_SURFACE).mean() > 0.999
    np.testing.assert_allclose(found.distances, height, atol=3e-4)
    offsets = points - found.points
    along = np.einsum("ij,ij->i", offsets, found.normals)[:, np.newaxis] * found.normals
    assert np.abs(offsets - along).max() < 1e-5


@pytest.mark.parametrize("body", [ellipsoid(resolution=16, jitter=0.3), bumpy_star(resolution=24, jitter=0.3)])
def test_errors_between_vertices_are_those_at_vertices_under_noise(body):
    vertices = add_noise(body, 0.1)
    surface = fit_surface(vertices, body.faces)
    fine = fit_surface(body.vertices, body.faces)
    truth = fine.query(surface.evaluate(*random_places(body.faces, 3000)).points)
    there = surface.query(truth.points)
    at_vertices = rms(
        surface.geometry.mean_curvature - estimate_vertex_geometry(body.vertices, body.faces).mean_curvature
    )
    assert rms(there.mean_curvature - truth.mean_curvature) < 1.5 * at_vertices
    scores = truth.distances / there.position_std
    assert 0.5 < rms(scores) < 1.6


def test_sharp_edges_stay_sharp():
    block, faces = block_with_sharp_edges(resolution=12)
    surface = fit_surface(block, faces)
    assert len(surface.cut.vertices) > len(block)
    there = surface.evaluate(*random_places(faces, 2000))
    places, rows = there.coordinates, there.faces
    weights = np.column_stack([1.0 - places.sum(axis=1), places])
    np.testing.assert_allclose(there.points, np.einsum("qk,qkd->qd", weights, block[faces[rows]]), atol=1e-9)


def test_next_to_an_open_surface_the_nearest_place_is_on_the_border():
    field = height_field(lambda x, y: [0.0 * x] * 6, resolution=8)
    edge = field.vertices[:, 0].max()
    found = surface_at(field.vertices, field.faces, [[edge + 1.0, 0.1, 0.5], [0.1, 0.1, 0.5]])
    assert found.outcome.tolist() == [AT_BORDER, ON_SURFACE]
    np.testing.assert_allclose(found.points, [[edge, 0.1, 0.0], [0.1, 0.1, 0.0]], atol=1e-9)


@pytest.mark.parametrize("scale", [1e-30, 1e30])
def test_it_follows_the_scale(scale):
    ball = sphere(resolution=8)
    plain = surface_at(ball.vertices, ball.faces, [[1.5, 0.2, 0.1]])
    found = surface_at(scale * ball.vertices, ball.faces, scale * np.array([[1.5, 0.2, 0.1]]))
    np.testing.assert_allclose(found.points, scale * plain.points, rtol=1e-6)
    np.testing.assert_allclose(found.mean_curvature, plain.mean_curvature / scale, rtol=1e-5)


@pytest.mark.parametrize("points", [np.zeros((2, 2)), [[np.nan, 0.0, 0.0]], "many"])
def test_wrong_points_are_refused(ring_surface, points):
    with pytest.raises(InvalidParameterError, match="points"):
        ring_surface.query(points)


def test_wrong_places_are_refused(ring_surface):
    with pytest.raises(InvalidParameterError, match="coordinates"):
        ring_surface.evaluate([0], [[0.7, 0.7]])
    with pytest.raises(InvalidParameterError, match="faces"):
        ring_surface.evaluate([-1], [[0.2, 0.2]])


def test_places_are_found_where_noise_turns_faces_over():
    """Noise of half an edge in all directions turns a quarter of the faces; their edges are no nearest places."""
    ring, rng = torus(resolution=30), np.random.default_rng(0)
    edge = np.linalg.norm(np.diff(ring.vertices[ring.faces[:, :2]], axis=1), axis=2).mean()
    surface = fit_surface(ring.vertices + 0.5 * edge * rng.standard_normal(ring.vertices.shape), ring.faces)
    points = ring.vertices[ring.faces].mean(axis=1)
    there = surface.query(points)
    assert (there.outcome == ON_SURFACE).mean() > 0.98
    offsets = points - there.points
    along = np.einsum("ij,ij->i", offsets, there.normals)[:, np.newaxis] * there.normals
    assert np.abs((offsets - along)[there.outcome == ON_SURFACE]).max() < 1e-4 * edge


def test_coordinates_outside_by_rounding_are_on_the_edge(ring_surface):
    found = ring_surface.evaluate([0, 0, 0], [[-1e-17, 0.5], [0.5, 0.5 + 1e-13], [0.0, 0.5]])
    assert found.coordinates.min() == 0.0
    assert found.coordinates.sum(axis=1).max() <= 1.0
    np.testing.assert_array_equal(found.points[0], found.points[2])
    with pytest.raises(InvalidParameterError, match="row 1"):
        ring_surface.evaluate([0, 0], [[0.0, 0.5], [-1e-6, 0.5]])


def test_a_pair_is_refused_with_the_remedy(ring):
    with pytest.raises(InvalidMeshError, match=r"f\(vertices, faces\)"):
        fit_surface((ring.vertices, ring.faces))


def test_the_row_of_a_missing_point_is_named(ring, ring_surface):
    points = ring.vertices.copy()
    points[7, 1] = np.nan
    with pytest.raises(InvalidParameterError, match=r"points: 1 of .* row 7"):
        ring_surface.query(points)


@pytest.mark.parametrize("turn", [1, -1])
def test_doubled_faces_are_counted(turn):
    ball = sphere(resolution=6)
    with pytest.raises(InvalidMeshError, match="40 lie on others"):
        fit_surface(ball.vertices, np.vstack([ball.faces, ball.faces[:40, ::turn]]))


def test_points_on_a_line_are_no_surface():
    with pytest.raises(InvalidMeshError, match="too few, or on a line"):
        fit_surface(np.arange(50.0)[:, np.newaxis] * [1.0, 2.0, 3.0])


def test_no_points_give_no_places(ring_surface):
    assert len(ring_surface.query(np.zeros((0, 3))).points) == len(ring_surface.query([]).points) == 0
    assert ring_surface.evaluate([], []).points.shape == (0, 3)


@pytest.mark.parametrize("offset", [1e4, 5e6])
def test_places_far_from_the_origin_are_as_near_it(offset):
    """Coordinates of surveys have offsets; rounding of theirs is no failure."""
    ball = sphere(resolution=8)
    surface = fit_surface(ball.vertices + offset, ball.faces)
    there = surface.evaluate(*random_places(ball.faces, 300))
    assert (there.outcome == ON_SURFACE).all()
    np.testing.assert_allclose(surface.query(1.1 * ball.vertices + offset).distances, 0.1, atol=1e-5)


def test_distances_from_a_border_are_lengths():
    field = height_field(lambda x, y: [0.0 * x] * 6, resolution=8)
    found = surface_at(field.vertices, field.faces, [[4.0, 0.1, 0.0], [-4.0, 0.1, -4.0]])
    np.testing.assert_allclose(found.distances, [3.0, -5.0], atol=1e-9)


def test_sheets_that_meet_in_one_edge_stay_flat():
    field = height_field(lambda x, y: [0.0 * x] * 6, resolution=8)
    middle = np.flatnonzero(np.abs(field.vertices[:, 0]) < 1e-9)
    middle = middle[np.argsort(field.vertices[middle, 1])]
    above = len(field.vertices) + np.arange(len(middle))
    wall = [[middle[:-1], middle[1:], above[1:]], [middle[:-1], above[1:], above[:-1]]]
    faces = np.vstack([field.faces, *(np.column_stack(corners) for corners in wall)])
    vertices = np.vstack([field.vertices, field.vertices[middle] + [0.0, 0.0, 0.25]])
    there = fit_surface(vertices, faces).evaluate(*random_places(faces, 2000))
    assert np.minimum(np.abs(there.points[:, 2]), np.abs(there.points[:, 0])).max() < 1e-9


def test_points_beyond_all_coordinates_are_refused(ring_surface):
    with pytest.raises(InvalidParameterError, match="up to 1e"):
        ring_surface.query([[1e160, 0.0, 0.0]])


@pytest.mark.parametrize("level", [pytest.param(0.1, marks=pytest.mark.slow), 0.2])
@pytest.mark.parametrize("make", [torus, ellipsoid], ids=lambda make: make.__name__)
def test_standard_errors_of_positions_are_those_of_the_errors(make, level):
    """With the scale of the errors of normals, they would be .73 of what is stated on the ellipsoid."""
    body = make(resolution=20, jitter=0.3)
    exact = fit_surface(body.vertices, body.faces, noise=0.0)
    scores = []
    for seed in range(4):
        geometry = fit_surface(add_noise(body, level, seed), body.faces).geometry
        positions = add_noise(body, level, seed) + geometry.displacements
        scores.append(exact.query(positions).distances / geometry.height_std)
    assert 0.8 < rms(scores) < 1.1
