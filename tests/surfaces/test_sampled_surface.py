"""The exact geometry against finite differences of parametrisations and theorems."""

from collections.abc import Callable

import numpy as np
import pytest
from surface_cases import (
    CASES,
    CLOSED,
    IRREGULAR,
    directed_edges,
    each_jitter,
    each_surface,
    integrated_gaussian_curvature,
    make,
)

from bezier_filters.arrays import FloatArray


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


@pytest.mark.parametrize("name", CLOSED)
@each_jitter
def test_gauss_bonnet(name: str, jitter: float) -> None:
    """The integral of K tends to 2 pi chi; the error of the vertex rule is of second order."""
    expected = 2 * np.pi * CASES[name].euler_characteristic
    errors = [abs(integrated_gaussian_curvature(make(name, jitter, refinement)) - expected) for refinement in (1, 2, 4)]
    assert errors[-1] < 0.05
    # On the regular torus the rule is exact by symmetry, up to rounding.
    assert errors[2] < 1e-9 or np.log2(errors[0] / errors[2]) / 2 > 1.6
