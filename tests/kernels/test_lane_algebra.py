"""Algebra in lanes, against numpy on each of the eight systems."""

import numpy as np
import pytest
from compiled import from_python

from bezier_filters.kernels.lane_algebra import (
    UNROLL_FACTOR,
    add_moments,
    add_squared_residuals,
    condition_numbers,
    differentiate,
    factorise_lanes,
    raise_powers,
    sort_lanes,
    substitute_back,
)
from bezier_filters.patches.polynomials import lexicographic_places, row_starts, tensor_space, total_degree_space
from bezier_filters.runtime.lanes import LANES, lane_array

RANDOM = np.random.default_rng(0)
SPACES = [total_degree_space(2), tensor_space(3), total_degree_space(6)]
COUNTS = [1, 6, 19, 32]


def lanes_of(array):
    """A flat array of lanes; the eight systems come last in `array`."""
    flat = lane_array(array.size // LANES)
    flat[:] = array.reshape(-1)
    return flat


def table(rows, stride):
    return RANDOM.standard_normal((rows, stride, LANES))


def test_arrays_start_on_a_cache_line():
    for count in range(1, 9):
        array = lane_array(count)
        assert array.shape == (LANES * count,)
        assert array.ctypes.data % 64 == 0


def test_powers():
    values = table(5, 32)
    flat = lanes_of(values)
    from_python(raise_powers)(flat, 32, 7, 4)
    result = flat.reshape(values.shape)
    for k in range(1, 5):
        np.testing.assert_allclose(result[k, :7], values[0, :7] * values[1, :7] ** k, rtol=1e-14)
    np.testing.assert_array_equal(result[:, 7:], values[:, 7:])


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize(
    "lengths", [[3, 2, 1], [4, 4, 4, 4], [7, 6, 5, 4, 3, 2, 1], [1, 2, 3, 4, 5, 6], [1, 9, 2, 5, 0, 6, 8]], ids=str
)
def test_moments_are_added(lengths, count):
    starts = np.append(0, np.cumsum(lengths)).astype(np.int32)
    left, right = table(len(lengths), 32), table(max(lengths) + UNROLL_FACTOR, 32)
    before = RANDOM.standard_normal((starts[-1] + UNROLL_FACTOR, LANES))
    sums = lanes_of(before)
    from_python(add_moments)(lanes_of(left), lanes_of(right), 32, count, starts, sums)
    result = sums.reshape(before.shape)
    for a, length in enumerate(lengths):
        for b in range(length):
            expected = before[starts[a] + b] + (left[a, :count] * right[b, :count]).sum(axis=0)
            np.testing.assert_allclose(result[starts[a] + b], expected, atol=1e-12)
    np.testing.assert_array_equal(result[starts[-1] :], before[starts[-1] :])


def solve(matrix, order, smallest_pivot, solution, is_full_rank):
    """Eight systems, whose right-hand sides are a last row of the matrix, which becomes the factor."""
    from_python(factorise_lanes)(matrix, order + 1, order, smallest_pivot, is_full_rank)
    from_python(substitute_back)(matrix, order, order, solution)


@pytest.mark.parametrize("order", [1, 2, 5, 16, 28])
def test_solutions_and_factors(order):
    factors = RANDOM.standard_normal((LANES, order + 3, order))
    matrices = factors.transpose(0, 2, 1) @ factors
    sides = RANDOM.standard_normal((LANES, order))
    padded = np.zeros((LANES, order + 1 + UNROLL_FACTOR, order + 1 + UNROLL_FACTOR))
    padded[:, :order, :order], padded[:, order, :order] = matrices, sides
    lower = np.tril_indices(order + 1 + UNROLL_FACTOR)
    flat, solution, is_full_rank = lanes_of(padded[:, lower[0], lower[1]].T), lane_array(order), lane_array(1)
    solve(flat, order, 1e-13, solution, is_full_rank)
    assert is_full_rank.tolist() == [1.0] * LANES
    for lane in range(LANES):
        expected = np.linalg.solve(matrices[lane], sides[lane])
        np.testing.assert_allclose(solution[lane::LANES], expected, rtol=1e-7, atol=1e-9)
        inner = np.tril_indices(order)
        factor = np.zeros((order, order))
        factor[inner] = flat[lane::LANES][: len(inner[0])]
        np.fill_diagonal(factor, 1.0 / np.diag(factor))
        np.testing.assert_allclose(factor @ factor.T, matrices[lane], atol=1e-10)


@pytest.mark.parametrize("order", [1, 2, 5, 16, 28])
def test_condition_numbers_of_columns_of_unit_length(order):
    """In the Frobenius norm, of the factor whose rows are scaled so that the normal equations have a diagonal of 1."""
    factors = np.tril(RANDOM.standard_normal((LANES, order, order))) + 2.0 * np.eye(order)
    stored, lower = factors.copy(), np.tril_indices(order)
    stored[:, np.arange(order), np.arange(order)] = 1.0 / np.diagonal(factors, axis1=1, axis2=2)
    result = lane_array(1)
    from_python(condition_numbers)(lanes_of(stored[:, lower[0], lower[1]].T), order, lane_array(order), result)
    scaled = factors / np.linalg.norm(factors, axis=2, keepdims=True)
    expected = np.linalg.norm(scaled, axis=(1, 2)) * np.linalg.norm(np.linalg.inv(scaled), axis=(1, 2))
    np.testing.assert_allclose(result, expected, rtol=1e-8)


def test_a_rank_deficient_system_does_not_disturb_the_others():
    matrices = np.tile(np.eye(3), (LANES, 1, 1))
    matrices[2] = 1.0
    matrices[5] = np.nan
    padded = np.zeros((LANES, 4 + UNROLL_FACTOR, 4 + UNROLL_FACTOR))
    padded[:, :3, :3], padded[:, 3, :3] = matrices, [1.0, 2.0, 3.0]
    lower = np.tril_indices(4 + UNROLL_FACTOR)
    solution, is_full_rank = lane_array(3), lane_array(1)
    solve(lanes_of(padded[:, lower[0], lower[1]].T), 3, 1e-6, solution, is_full_rank)
    assert is_full_rank.tolist() == [1.0, 1.0, 0.0, 1.0, 1.0, 0.0, 1.0, 1.0]
    for lane in np.flatnonzero(is_full_rank):
        assert solution[lane::LANES].tolist() == [1.0, 2.0, 3.0]


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("space", SPACES, ids=lambda space: str(space.dimension))
def test_residuals_of_points_that_are_there(space, count):
    stride = 40
    points = table(4, stride)
    points[3] = RANDOM.integers(0, 2, (stride, LANES))
    points[:, count : count + UNROLL_FACTOR] = 0.0
    coefficients = RANDOM.standard_normal((space.dimension, LANES))
    total, residuals = lanes_of(np.full((1, LANES), 0.5)), lane_array(count + UNROLL_FACTOR)
    from_python(add_squared_residuals)(
        lanes_of(coefficients), row_starts(space.exponents), lanes_of(points), stride, count, total, residuals
    )
    a, b = space.exponents.T
    terms = points[0, :count, None] ** a[:, None] * points[1, :count, None] ** b[:, None]
    values = (terms * coefficients[lexicographic_places(space.exponents)]).sum(axis=1)
    differences = points[3, :count] * (values - points[2, :count])
    np.testing.assert_allclose(residuals.reshape(-1, LANES)[:count], differences, atol=1e-12 * np.abs(values).max())
    np.testing.assert_allclose(total, 0.5 + np.square(differences).sum(axis=0), rtol=1e-12)


@pytest.mark.parametrize("space", SPACES, ids=lambda space: str(space.dimension))
def test_derivatives(space):
    coefficients = RANDOM.standard_normal((space.dimension, LANES))
    s, t = RANDOM.standard_normal((2, LANES))
    jets = lane_array(16)
    places = lexicographic_places(space.exponents)
    in_order = np.empty_like(coefficients)
    in_order[places] = coefficients
    from_python(differentiate)(lanes_of(in_order), row_starts(space.exponents), lanes_of(np.array([s, t])), jets)
    side = space.exponents.max() + 1
    for lane in range(LANES):
        grid = np.zeros((side, side))
        grid[tuple(space.exponents.T)] = coefficients[:, lane]
        for r in range(4):
            for q in range(4 - r):
                derivative = np.polynomial.polynomial.polyder(np.polynomial.polynomial.polyder(grid, r), q, axis=1)
                expected = np.polynomial.polynomial.polyval2d(s[lane], t[lane], derivative)
                np.testing.assert_allclose(jets[LANES * (4 * r + q) + lane], expected, rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("count", [*range(10), 16, 17, 37, 91])
def test_every_lane_is_sorted(count):
    values = np.concatenate([RANDOM.standard_normal((count, 4)), RANDOM.integers(0, 3, (count, 4))], axis=1)
    flat = lanes_of(np.vstack([values, np.full((2, LANES), -9.0)]))
    from_python(sort_lanes)(flat, count)
    np.testing.assert_array_equal(flat.reshape(-1, LANES)[:count], np.sort(values, axis=0))
    np.testing.assert_array_equal(flat.reshape(-1, LANES)[count:], -9.0)
