"""The analytic surfaces against second formulas, finite differences and theorems."""

from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from bezier_filters import surfaces
from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.errors import InvalidParameterError
from bezier_filters.surfaces import SampledSurface, sampling
from bezier_filters.surfaces.checks import MAX_JITTER

IRREGULAR = 0.3


@dataclass(frozen=True)
class Case:
    """A surface with what topology says about its mesh."""

    make: Callable[..., SampledSurface]
    resolution: int
    euler_characteristic: int
    rims: int


CASES = {
    "sphere": Case(surfaces.sphere, 8, 2, 0),
    "ellipsoid": Case(surfaces.ellipsoid, 8, 2, 0),
    "bumpy_star": Case(surfaces.bumpy_star, 10, 2, 0),
    "red_blood_cell": Case(surfaces.red_blood_cell, 12, 2, 0),
    "torus": Case(surfaces.torus, 16, 0, 0),
    "cylinder": Case(surfaces.cylinder, 24, 0, 2),
    "monkey_saddle": Case(surfaces.monkey_saddle, 20, 1, 1),
    "waves": Case(surfaces.waves, 28, 1, 1),
    "punched_patch": Case(surfaces.punched_patch, 28, -2, 4),
}
CLOSED = ["sphere", "ellipsoid", "bumpy_star", "red_blood_cell", "torus"]

each_surface = pytest.mark.parametrize("name", CASES)
each_jitter = pytest.mark.parametrize("jitter", [0.0, IRREGULAR])


def make(name: str, jitter: float, refinement: int = 1) -> SampledSurface:
    case = CASES[name]
    return case.make(resolution=case.resolution * refinement, jitter=jitter, seed=3)


def directed_edges(faces: IntArray) -> IntArray:
    return np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])


def border_edges(faces: IntArray) -> IntArray:
    edges = directed_edges(faces)
    there = edges[:, 0].astype(np.int64) * (faces.max() + 1) + edges[:, 1]
    back = edges[:, 1].astype(np.int64) * (faces.max() + 1) + edges[:, 0]
    return edges[~np.isin(there, back)]


def rim_count(faces: IntArray) -> int:
    """Number of closed loops that the border edges form."""
    following = dict(border_edges(faces).tolist())
    count = 0
    while following:
        vertex = next(iter(following))
        while vertex in following:
            vertex = following.pop(vertex)
        count += 1
    return count


def area_vectors(vertices: FloatArray, faces: IntArray) -> FloatArray:
    a, b, c = vertices[faces].transpose(1, 0, 2)
    return 0.5 * np.cross(b - a, c - a)


def volume(vertices: FloatArray, faces: IntArray) -> float:
    return float(np.linalg.det(vertices[faces]).sum() / 6)


def corner_angles(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Angles in degrees, shape (m, 3)."""
    corners = vertices[faces]
    ahead, behind = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    sine = np.linalg.norm(np.cross(ahead, behind), axis=2)
    return np.degrees(np.arctan2(sine, (ahead * behind).sum(axis=2)))


def integrated_gaussian_curvature(surface: SampledSurface) -> float:
    face_areas = np.linalg.norm(area_vectors(surface.vertices, surface.faces), axis=1)
    return float((face_areas * surface.gaussian_curvature[surface.faces].mean(axis=1)).sum())


def assert_valid_mesh(vertices: FloatArray, faces: IntArray, euler_characteristic: int, rims: int) -> None:
    """Edge-manifold, consistently oriented, no unused vertex, right topology."""
    assert vertices.dtype == np.float64
    assert faces.dtype == np.int32
    np.testing.assert_array_equal(np.unique(faces), np.arange(len(vertices)))
    edges = directed_edges(faces)
    assert len(np.unique(edges, axis=0)) == len(edges), "an edge is passed twice in the same direction"
    edge_count = len(np.unique(np.sort(edges, axis=1), axis=0))
    assert len(vertices) - edge_count + len(faces) == euler_characteristic
    border_starts = border_edges(faces)[:, 0]
    assert len(np.unique(border_starts)) == len(border_starts), "rims touch"
    assert rim_count(faces) == rims


# --- Meshes --------------------------------------------------------------------------------------


@each_surface
@each_jitter
def test_mesh_is_manifold_with_the_right_topology(name: str, jitter: float) -> None:
    surface = make(name, jitter)
    assert_valid_mesh(surface.vertices, surface.faces, CASES[name].euler_characteristic, CASES[name].rims)


@each_surface
@each_jitter
def test_no_triangle_is_thin_or_folded(name: str, jitter: float) -> None:
    surface = make(name, jitter)
    assert corner_angles(surface.vertices, surface.faces).min() > (8.0 if jitter else 20.0)
    face_normals = area_vectors(surface.vertices, surface.faces)
    face_normals /= np.linalg.norm(face_normals, axis=1, keepdims=True)
    assert np.einsum("mi,mki->mk", face_normals, surface.normals[surface.faces]).min() > 0.85


@each_surface
def test_jitter_makes_the_mesh_irregular(name: str) -> None:
    surface = make(name, IRREGULAR)
    valences = np.bincount(surface.faces.ravel())
    inner = np.setdiff1d(np.arange(len(valences)), border_edges(surface.faces))
    assert np.mean(valences[inner] != 6) > 0.25
    lengths = np.linalg.norm(np.diff(surface.vertices[directed_edges(surface.faces)], axis=1), axis=2)
    assert lengths.max() / lengths.min() > 3.5


@each_surface
def test_seed_decides_the_samples(name: str) -> None:
    first, again, other = (CASES[name].make(jitter=IRREGULAR, seed=seed) for seed in (1, 1, 2))
    for field in fields(SampledSurface):
        np.testing.assert_array_equal(getattr(first, field.name), getattr(again, field.name))
    assert first.vertices.shape != other.vertices.shape or not np.allclose(first.vertices, other.vertices)


@pytest.mark.parametrize("resolution", [1, 2, 7])
def test_icosphere_counts(resolution: int) -> None:
    ball = surfaces.sphere(resolution=resolution)
    assert len(ball.vertices) == 10 * resolution**2 + 2
    assert len(ball.faces) == 20 * resolution**2
    np.testing.assert_array_equal(np.unique(np.bincount(ball.faces.ravel())), [5] if resolution == 1 else [5, 6])


def test_regular_sphere_has_nearly_equal_edges() -> None:
    ball = surfaces.sphere(resolution=16)
    lengths = np.linalg.norm(np.diff(ball.vertices[directed_edges(ball.faces)], axis=1), axis=2)
    assert lengths.max() / lengths.min() < 1.2


@given(
    name=st.sampled_from(["sphere", "torus", "cylinder", "waves"]),
    resolution=st.integers(6, 14),
    jitter=st.floats(0.0, MAX_JITTER, exclude_max=True),
    seed=st.integers(0, 2**32),
)
@example(name="torus", resolution=6, jitter=1e-20, seed=0)
@example(name="torus", resolution=6, jitter=2e-6, seed=0)
@settings(max_examples=40, deadline=None)
def test_every_size_and_jitter_gives_a_valid_mesh(name: str, resolution: int, jitter: float, seed: int) -> None:
    surface = CASES[name].make(resolution=resolution, jitter=jitter, seed=seed)
    assert_valid_mesh(surface.vertices, surface.faces, CASES[name].euler_characteristic, CASES[name].rims)


@given(x=st.floats(-0.3, 0.3), y=st.floats(-0.3, 0.3), radius=st.floats(0.11, 0.35), jitter=st.floats(0.0, 0.34))
@settings(max_examples=25, deadline=None)
def test_every_hole_is_round_and_clean(x: float, y: float, radius: float, jitter: float) -> None:
    patch = surfaces.punched_patch(holes=[(x, y, radius)], resolution=20, jitter=jitter)
    assert_valid_mesh(patch.vertices, patch.faces, euler_characteristic=0, rims=2)
    rim = patch.vertices[np.unique(border_edges(patch.faces))]
    to_centre = np.hypot(rim[:, 0] - x, rim[:, 1] - y)
    on_square = np.isclose(np.abs(rim[:, :2]).max(axis=1), 1.0)
    np.testing.assert_allclose(to_centre[~on_square], radius)
    assert np.count_nonzero(on_square) == 4 * 20


def test_holes_of_the_punched_patch_differ_and_do_not_touch() -> None:
    patch = surfaces.punched_patch()
    open_area = 4 - np.abs(area_vectors(patch.vertices, patch.faces)[:, 2]).sum()
    # The rims are inscribed polygons, slightly smaller than the circles.
    assert open_area == pytest.approx(np.pi * (0.22**2 + 0.32**2 + 0.15**2), rel=0.01)


# --- Truth ---------------------------------------------------------------------------------------


@each_surface
@each_jitter
def test_frame_is_orthonormal_and_right_handed(name: str, jitter: float) -> None:
    surface = make(name, jitter)
    frames = np.stack([surface.direction_min, surface.normals, surface.direction_max], axis=1)
    np.testing.assert_allclose(frames @ frames.transpose(0, 2, 1), np.broadcast_to(np.eye(3), frames.shape), atol=1e-13)
    np.testing.assert_allclose(surface.direction_min, np.cross(surface.normals, surface.direction_max), atol=1e-13)


@each_surface
def test_mean_gauss_and_torsion_belong_together(name: str) -> None:
    surface = make(name, IRREGULAR)
    h, k, t = surface.mean_curvature, surface.gaussian_curvature, surface.geodesic_torsion
    assert (t >= 0).all()
    np.testing.assert_allclose(t**2, h**2 - k, atol=1e-12 * (1 + np.abs(k).max()))
    np.testing.assert_allclose(surface.k_max - h, t, atol=1e-12)


@each_surface
@each_jitter
def test_normals_turn_along_edges_as_the_shape_operator_says(name: str, jitter: float) -> None:
    """Dn = S dx: the trapezoidal rule along edges has an error of third order in their length."""
    errors, edge_lengths = [], []
    for refinement in (1, 2, 4):
        surface = make(name, jitter, refinement)
        start, end = directed_edges(surface.faces).T
        step = surface.vertices[end] - surface.vertices[start]
        length = np.linalg.norm(step, axis=1)
        along_max = surface.k_max[:, None, None] * surface.direction_max[:, :, None] * surface.direction_max[:, None]
        along_min = surface.k_min[:, None, None] * surface.direction_min[:, :, None] * surface.direction_min[:, None]
        operator = along_max + along_min
        predicted = np.einsum("nij,nj->ni", 0.5 * (operator[start] + operator[end]), step)
        miss = np.linalg.norm(surface.normals[end] - surface.normals[start] - predicted, axis=1)
        errors.append(np.sqrt(np.mean((miss / length) ** 2)))
        edge_lengths.append(length.mean())
    rate = np.polyfit(np.log(edge_lengths), np.log(errors), 1)[0]
    assert rate > 1.8
    assert errors[-1] < 0.02


Position = Callable[[FloatArray, FloatArray], FloatArray]


def geometry_by_differences(position: Position, size: int, step: float = 2e-3) -> tuple[FloatArray, ...]:
    """Tangents, normal, H and K at (0, 0) of a parametrised surface: E, F, G, L, M, N by central differences.

    Fourth-order differences: truncation and rounding errors are both about 1e-9.
    """
    first = np.array([1, -8, 0, 8, -1]) / (12 * step)
    second = np.array([-1, 16, -30, 16, -1]) / (12 * step**2)
    grid = np.array(
        [[position(np.full(size, i * step), np.full(size, j * step)) for j in range(-2, 3)] for i in range(-2, 3)]
    )
    x_u, x_v = np.tensordot(first, grid[:, 2], 1), np.tensordot(first, grid[2, :], 1)
    x_uu, x_vv = np.tensordot(second, grid[:, 2], 1), np.tensordot(second, grid[2, :], 1)
    x_uv = np.einsum("i,j,ijnk->nk", first, first, grid)
    normal = np.cross(x_u, x_v)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)

    def dot(a: FloatArray, b: FloatArray) -> FloatArray:
        return np.einsum("ni,ni->n", a, b)

    e, f, g = dot(x_u, x_u), dot(x_u, x_v), dot(x_v, x_v)
    l, m, n = dot(x_uu, normal), dot(x_uv, normal), dot(x_vv, normal)  # noqa: E741
    # The textbook's mean curvature is negative on convex bodies.
    mean = -(e * n - 2 * f * m + g * l) / (2 * (e * g - f**2))
    return x_u, x_v, normal, mean, (l * n - m**2) / (e * g - f**2)


def moved_direction(point: FloatArray) -> Position:
    """Unit vectors near the directions of points, for two parameters."""
    direction = point / np.linalg.norm(point, axis=1, keepdims=True)
    first = np.cross(direction, [0.3, -0.5, 0.8])
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(direction, first)

    def position(u: FloatArray, v: FloatArray) -> FloatArray:
        moved = direction + u[:, None] * first + v[:, None] * second
        return moved / np.linalg.norm(moved, axis=1, keepdims=True)

    return position


def star_position(point: FloatArray) -> Position:
    moved = moved_direction(point)

    def position(u: FloatArray, v: FloatArray) -> FloatArray:
        d = moved(u, v)
        return d * (1 + 0.08 * (np.sin(4 * d[:, 0]) + np.sin(5 * d[:, 1]) + np.sin(6 * d[:, 2])))[:, None]

    return position


def ellipsoid_position(point: FloatArray) -> Position:
    moved = moved_direction(point / (1, 0.7, 0.5))
    return lambda u, v: moved(u, v) * (1, 0.7, 0.5)


def cell_thickness(square: FloatArray) -> FloatArray:
    return 0.2072 + 2.0026 * square - 1.1228 * square**2


def cell_position(point: FloatArray) -> Position:
    x, y, z = point.T
    moved = moved_direction(np.stack([x, y, 2 * z / cell_thickness(x**2 + y**2)], axis=1))

    def position(u: FloatArray, v: FloatArray) -> FloatArray:
        x, y, z = moved(u, v).T
        return np.stack([x, y, 0.5 * z * cell_thickness(x**2 + y**2)], axis=1)

    return position


def torus_position(point: FloatArray) -> Position:
    x, y, z = point.T
    around, tube = np.arctan2(y, x), np.arctan2(z, np.hypot(x, y) - 1)

    def position(u: FloatArray, v: FloatArray) -> FloatArray:
        distance = 1 + 0.4 * np.cos(tube + v)
        return np.stack([distance * np.cos(around + u), distance * np.sin(around + u), 0.4 * np.sin(tube + v)], axis=1)

    return position


def cylinder_position(point: FloatArray) -> Position:
    angle = np.arctan2(point[:, 1], point[:, 0])
    return lambda u, v: np.stack([np.cos(angle + u), np.sin(angle + u), point[:, 2] + v], axis=1)


def graph_position(height: Callable[[FloatArray, FloatArray], FloatArray]) -> Callable[[FloatArray], Position]:
    def at(point: FloatArray) -> Position:
        x, y = point[:, 0], point[:, 1]
        return lambda u, v: np.stack([x + u, y + v, height(x + u, y + v)], axis=1)

    return at


def egg_carton(x: FloatArray, y: FloatArray) -> FloatArray:
    return 0.1 * np.sin(2 * np.pi * x) * np.cos(2 * np.pi * y)


PARAMETRISATIONS = {
    "sphere": moved_direction,
    "ellipsoid": ellipsoid_position,
    "bumpy_star": star_position,
    "red_blood_cell": cell_position,
    "torus": torus_position,
    "cylinder": cylinder_position,
    "monkey_saddle": graph_position(lambda x, y: 0.3 * (x**3 - 3 * x * y**2)),
    "waves": graph_position(egg_carton),
    "punched_patch": graph_position(egg_carton),
}


@each_surface
@each_jitter
def test_truth_equals_the_fundamental_forms_of_a_parametrisation(name: str, jitter: float) -> None:
    surface = make(name, jitter)
    position = PARAMETRISATIONS[name](surface.vertices)
    size = len(surface.vertices)
    np.testing.assert_allclose(position(np.zeros(size), np.zeros(size)), surface.vertices, atol=1e-14)
    x_u, x_v, normal, mean, gaussian = geometry_by_differences(position, size)
    for tangent in (x_u, x_v):
        np.testing.assert_allclose(np.einsum("ni,ni->n", tangent, surface.normals), 0, atol=1e-7)
    np.testing.assert_allclose(surface.normals, normal, atol=1e-7)
    scale = np.abs(surface.k_max).max() + np.abs(surface.k_min).max()
    np.testing.assert_allclose(surface.mean_curvature, mean, atol=1e-6 * scale)
    np.testing.assert_allclose(surface.gaussian_curvature, gaussian, atol=1e-6 * scale**2)


@each_jitter
def test_torus_has_the_textbook_curvatures_and_directions(jitter: float) -> None:
    ring = surfaces.torus(major_radius=2.0, minor_radius=0.5, resolution=14, jitter=jitter)
    axis_distance = np.hypot(ring.vertices[:, 0], ring.vertices[:, 1])
    cosine = (axis_distance - 2.0) / 0.5
    np.testing.assert_allclose((axis_distance - 2.0) ** 2 + ring.vertices[:, 2] ** 2, 0.25, atol=1e-14)
    np.testing.assert_allclose(ring.k_max, 2.0, rtol=1e-12)
    np.testing.assert_allclose(ring.k_min, cosine / axis_distance, atol=1e-12)
    np.testing.assert_allclose(ring.mean_curvature, (2.0 + 2 * 0.5 * cosine) / (2 * 0.5 * axis_distance), rtol=1e-12)
    parallel = np.stack([-ring.vertices[:, 1], ring.vertices[:, 0], np.zeros_like(cosine)], axis=1)
    along = np.einsum("ni,ni->n", ring.direction_min, parallel / axis_distance[:, None])
    np.testing.assert_allclose(np.abs(along), 1, atol=1e-13)


@each_jitter
def test_ellipsoid_has_the_textbook_curvatures(jitter: float) -> None:
    axes = np.array([1.3, 0.6, 0.9])
    egg = surfaces.ellipsoid(semi_axes=(1.3, 0.6, 0.9), resolution=6, jitter=jitter)
    squares = egg.vertices**2
    np.testing.assert_allclose((squares / axes**2).sum(axis=1), 1, atol=1e-14)
    support = (squares / axes**4).sum(axis=1)
    gaussian = 1 / (axes.prod() ** 2 * support**2)
    mean = np.abs(squares.sum(axis=1) - (axes**2).sum()) / (2 * axes.prod() ** 2 * support**1.5)
    np.testing.assert_allclose(egg.gaussian_curvature, gaussian, rtol=1e-12)
    np.testing.assert_allclose(egg.mean_curvature, mean, rtol=1e-12)


@each_jitter
def test_monkey_saddle_has_the_textbook_curvatures(jitter: float) -> None:
    saddle = surfaces.monkey_saddle(strength=1.0, resolution=16, jitter=jitter)
    x, y, z = saddle.vertices.T
    np.testing.assert_allclose(z, x**3 - 3 * x * y**2, atol=1e-14)
    stretch = 1 + 9 * (x**2 + y**2) ** 2
    np.testing.assert_allclose(saddle.gaussian_curvature, -36 * (x**2 + y**2) / stretch**2, atol=1e-12)
    upward_textbook_mean = 27 * x * (-(x**4) + 2 * x**2 * y**2 + 3 * y**4) / stretch**1.5
    np.testing.assert_allclose(saddle.mean_curvature, -upward_textbook_mean, atol=1e-12)


def test_hills_are_positive_and_bowls_negative() -> None:
    carton = surfaces.waves(amplitude=0.1, wavelength=1.0, size=2.0, resolution=8)
    top, bottom = carton.vertices[:, 2].argmax(), carton.vertices[:, 2].argmin()
    assert carton.mean_curvature[top] == pytest.approx(0.1 * (2 * np.pi) ** 2)
    assert carton.mean_curvature[bottom] == pytest.approx(-0.1 * (2 * np.pi) ** 2)
    assert (carton.normals[:, 2] > 0).all()


def test_height_field_takes_numbers_for_constant_derivatives() -> None:
    slope = surfaces.height_field(lambda x, y: (x + y, 1, 1, 0, 0, 0), resolution=4)
    np.testing.assert_allclose(slope.normals, np.broadcast_to(np.array([-1, -1, 1]) / np.sqrt(3), (25, 3)))
    np.testing.assert_array_equal(slope.k_min, 0)
    np.testing.assert_array_equal(slope.k_max, 0)


# --- Theorems that tie truth and mesh together -----------------------------------------------------


@pytest.mark.parametrize("name", CLOSED)
@each_jitter
def test_gauss_bonnet(name: str, jitter: float) -> None:
    """The integral of K tends to 2 pi chi; the error of the vertex rule is of second order."""
    expected = 2 * np.pi * CASES[name].euler_characteristic
    errors = [abs(integrated_gaussian_curvature(make(name, jitter, refinement)) - expected) for refinement in (1, 2, 4)]
    assert errors[-1] < 0.05
    # On the regular torus the rule is exact by symmetry, up to rounding.
    assert errors[2] < 1e-9 or np.log2(errors[0] / errors[2]) / 2 > 1.6


def star_volume() -> float:
    """One third of the integral of r^3 over the unit sphere: Gauss rule in z, equal angles around it."""
    z, weights = np.polynomial.legendre.leggauss(60)
    angle = 2 * np.pi * np.arange(120) / 120
    x, y = np.sqrt(1 - z**2)[:, None] * np.cos(angle), np.sqrt(1 - z**2)[:, None] * np.sin(angle)
    radius = 1 + 0.08 * (np.sin(4 * x) + np.sin(5 * y) + np.sin(6 * z)[:, None])
    return float((weights[:, None] * radius**3).sum() * (2 * np.pi / 120) / 3)


VOLUMES = {
    "sphere": 4 / 3 * np.pi,
    "ellipsoid": 4 / 3 * np.pi * 1.0 * 0.7 * 0.5,
    "bumpy_star": star_volume(),
    # pi times the integral of sqrt(1 - t) (0.2072 + 2.0026 t - 1.1228 t^2) over [0, 1]
    "red_blood_cell": np.pi * (0.2072 * 2 / 3 + 2.0026 * 4 / 15 - 1.1228 * 16 / 105),
    "torus": 2 * np.pi**2 * 1.0 * 0.4**2,
}


@pytest.mark.parametrize("name", CLOSED)
@each_jitter
def test_enclosed_volume_converges_from_an_outward_mesh(name: str, jitter: float) -> None:
    volumes = []
    for refinement in (1, 2, 4):
        surface = make(name, jitter, refinement)
        volumes.append(volume(surface.vertices, surface.faces))
    errors = np.abs(np.array(volumes) - VOLUMES[name])
    assert volumes[-1] == pytest.approx(VOLUMES[name], rel=5e-3)
    assert np.log2(errors[0] / errors[2]) / 2 > 1.8


# --- Scale ---------------------------------------------------------------------------------------


@given(radius=st.floats(1e-6, 1e6), jitter=st.floats(0.0, 0.34), seed=st.integers(0, 10**6))
@settings(max_examples=30, deadline=None)
def test_sphere_of_any_radius(radius: float, jitter: float, seed: int) -> None:
    ball = surfaces.sphere(radius=radius, resolution=3, jitter=jitter, seed=seed)
    np.testing.assert_allclose(np.linalg.norm(ball.vertices, axis=1), radius, rtol=1e-14)
    np.testing.assert_allclose(ball.normals, ball.vertices / radius, atol=1e-14)
    np.testing.assert_allclose(ball.mean_curvature, 1 / radius, rtol=1e-12)
    np.testing.assert_allclose(ball.gaussian_curvature, 1 / radius**2, rtol=1e-12)
    np.testing.assert_allclose(ball.geodesic_torsion, 0, atol=1e-12 / radius)


@given(scale=st.floats(1e-4, 1e4), minor=st.floats(0.1, 0.9))
@settings(max_examples=25, deadline=None)
def test_curvatures_scale_inversely_with_length(scale: float, minor: float) -> None:
    unit = surfaces.torus(minor_radius=minor, resolution=8, jitter=0.2)
    scaled = surfaces.torus(major_radius=scale, minor_radius=scale * minor, resolution=8, jitter=0.2)
    if unit.vertices.shape != scaled.vertices.shape:
        return  # the number of samples around the axis was rounded the other way
    np.testing.assert_allclose(scaled.vertices, scale * unit.vertices, rtol=1e-9, atol=1e-9 * scale)
    np.testing.assert_allclose(scaled.mean_curvature * scale, unit.mean_curvature, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(scaled.gaussian_curvature * scale**2, unit.gaussian_curvature, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(scaled.geodesic_torsion * scale, unit.geodesic_torsion, rtol=1e-9, atol=1e-9)


@given(axes=st.tuples(*[st.floats(0.2, 3.0)] * 3))
@settings(max_examples=25, deadline=None)
def test_ellipsoids_are_convex_and_outward(axes: tuple[float, float, float]) -> None:
    egg = surfaces.ellipsoid(semi_axes=axes, resolution=6, jitter=0.2)
    assert (egg.k_min > 0).all()
    assert (np.einsum("ni,ni->n", egg.normals, egg.vertices) > 0).all()
    assert 0 < volume(egg.vertices, egg.faces) < 4 / 3 * np.pi * np.prod(axes)


# --- Block ---------------------------------------------------------------------------------------


@each_jitter
def test_block_is_a_closed_cube_without_an_octant(jitter: float) -> None:
    vertices, faces = surfaces.block_with_sharp_edges(size=2.0, resolution=8, jitter=jitter)
    assert_valid_mesh(vertices, faces, euler_characteristic=2, rims=0)
    assert volume(vertices, faces) == pytest.approx(7.0)
    areas = area_vectors(vertices, faces)
    assert np.linalg.norm(areas, axis=1).sum() == pytest.approx(24.0)
    assert corner_angles(vertices, faces).min() > (5.0 if jitter else 44.9)


@each_jitter
def test_block_has_exactly_sharp_edges(jitter: float) -> None:
    vertices, faces = surfaces.block_with_sharp_edges(size=2.0, resolution=8, jitter=jitter)
    areas = area_vectors(vertices, faces)
    normals = areas / np.linalg.norm(areas, axis=1, keepdims=True)
    np.testing.assert_allclose(np.sort(np.abs(normals), axis=1), np.broadcast_to([0, 0, 1], normals.shape), atol=1e-12)
    edges = directed_edges(faces)
    owner = np.tile(np.arange(len(faces)), 3)
    order = np.lexsort(np.sort(edges, axis=1).T)
    pairs = owner[order].reshape(-1, 2)
    sharp = np.abs(np.einsum("mi,mi->m", normals[pairs[:, 0]], normals[pairs[:, 1]])) < 0.5
    sharp_edges = edges[order].reshape(-1, 2, 2)[sharp, 0]
    length = np.linalg.norm(vertices[sharp_edges[:, 0]] - vertices[sharp_edges[:, 1]], axis=1).sum()
    # Twelve edges of length 2; the notch shortens three of them to 1 and adds nine of length 1.
    assert length == pytest.approx(12 * 2 - 3 + 9)


# --- Wrong arguments -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: surfaces.sphere(radius=0), "radius is 0"),
        (lambda: surfaces.sphere(radius=float("nan")), "radius is nan"),
        (lambda: surfaces.sphere(resolution=0), "resolution is 0"),
        (lambda: surfaces.sphere(resolution=2.5), "must be an int"),
        (lambda: surfaces.sphere(jitter=0.5), "jitter is 0.5"),
        (lambda: surfaces.sphere(jitter=-0.1), "jitter is -0.1"),
        (lambda: surfaces.ellipsoid(semi_axes=(1, 2)), "three lengths"),
        (lambda: surfaces.ellipsoid(semi_axes=(1, 2, -3)), "semi_axes is -3"),
        (lambda: surfaces.bumpy_star(amplitude=0.4), "less than 1/3"),
        (lambda: surfaces.bumpy_star(frequencies=(1, 2, np.inf)), "three finite numbers"),
        (lambda: surfaces.red_blood_cell_at(np.eye(3), np.arange(3)[None]), "off by up to 0.99, expected"),
        (lambda: surfaces.torus(minor_radius=1.0), "less than major_radius"),
        (lambda: surfaces.torus(resolution=5), "at least 6"),
        (lambda: surfaces.cylinder(length=-1), "length is -1"),
        (lambda: surfaces.waves(wavelength=0), "wavelength is 0"),
        (lambda: surfaces.waves(amplitude=np.inf), "amplitude is inf"),
        (lambda: surfaces.monkey_saddle(strength=np.nan), "strength is nan"),
        (lambda: surfaces.height_field(lambda x, y: (x, 1, 0)), "returned 3 values"),
        (lambda: surfaces.height_field(lambda x, y: (x * np.nan, 1, 0, 0, 0, 0)), "not finite"),
        (lambda: surfaces.punched_patch(holes=[(0, 0, 0.01)]), "raise resolution or radius"),
        (lambda: surfaces.punched_patch(holes=[(0, 0, 0.95)]), "raise resolution or move"),
        (lambda: surfaces.punched_patch(holes=[(0, 0, 0.3), (0.5, 0, 0.2)]), "raise resolution or move"),
        (lambda: surfaces.punched_patch(holes=[(0, np.nan, 0.3)]), "finite triples"),
        (lambda: sampling.rectangle((9, 9), wrapped=(True, False), holes=[(4, 4, 1)]), "wrapped rectangle"),
        (lambda: surfaces.block_with_sharp_edges(resolution=7), "must be even"),
        (lambda: surfaces.block_with_sharp_edges(size=0), "size is 0"),
    ],
)
def test_nonsense_is_refused_with_the_reason(call: Callable[[], object], message: str) -> None:
    with pytest.raises(InvalidParameterError, match=message):
        call()
