"""Monomials, their products and their order, by their values at points."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from reference import design

from bezier_filters.patches.polynomials import (
    elimination_order,
    lexicographic_places,
    monomials_from_bernstein,
    row_starts,
    tensor_space,
    total_degree_space,
)

SPACES = [*map(tensor_space, (2, 3, 4)), *map(total_degree_space, (2, 3, 5, 8))]
POINTS = np.random.default_rng(0).uniform(-1.0, 1.0, (200, 2))
each_space = pytest.mark.parametrize("space", SPACES, ids=lambda space: f"{space.dimension} terms")


def values(space):
    return np.prod(POINTS[:, np.newaxis] ** space.exponents, axis=2)


@given(st.integers(1, 5))
def test_spaces_have_all_pairs_of_their_degree(degree):
    pairs = [(a, b) for a in range(degree + 1) for b in range(degree + 1)]
    assert list(map(tuple, tensor_space(degree).exponents.tolist())) == pairs
    total = total_degree_space(degree)
    assert set(map(tuple, total.exponents.tolist())) == {pair for pair in pairs if sum(pair) <= degree}
    assert total.dimension == (degree + 1) * (degree + 2) // 2
    np.testing.assert_array_equal(total.total_degrees, np.sort(total.exponents[:, 0] + total.exponents[:, 1]))


@each_space
def test_moments_are_the_entries_of_the_normal_equations(space):
    powers, place = space.moments
    sums = np.prod(POINTS[:, np.newaxis] ** powers, axis=2).sum(axis=0)
    matrix = values(space).T @ values(space)
    np.testing.assert_allclose(sums[place], matrix[np.tril_indices(space.dimension)])
    assert len(np.unique(powers, axis=0)) == len(powers)


@each_space
def test_slopes_and_curvatures_are_eliminated_last(space):
    """A column of the inverse factor for each of them is all that their standard errors take."""
    ordered, order = elimination_order(space)
    np.testing.assert_array_equal(values(ordered), values(space)[:, order])
    assert sorted(order) == list(range(space.dimension))
    assert ordered.exponents[-5:].tolist() == [[1, 0], [0, 1], [2, 0], [1, 1], [0, 2]]
    assert ordered.exponents[:-5].sum(axis=1)[-1] == 0  # the height just before them


@each_space
def test_lexicographic_places_sort_the_exponents(space):
    ordered = elimination_order(space)[0].exponents
    places = lexicographic_places(ordered)
    in_order = np.empty_like(ordered)
    in_order[places] = ordered
    assert in_order.tolist() == sorted(ordered.tolist())
    starts = row_starts(ordered)
    assert in_order[starts[:-1]].tolist() == [[a, 0] for a in range(ordered[:, 0].max() + 1)]
    assert starts[-1] == len(ordered)


@pytest.mark.parametrize("degree", [1, 2, 3, 4])
def test_a_patch_and_its_monomials_are_the_same_polynomial(degree):
    """The patch runs over [0, 1]^2, the monomials over [-1, 1]^2."""
    heights = np.random.default_rng(degree).standard_normal((degree + 1) ** 2)
    u, v = (0.5 * (POINTS + 1.0)).T
    monomials = values(tensor_space(degree)) @ monomials_from_bernstein(degree) @ heights
    np.testing.assert_allclose(monomials, design(u, v, degree=degree) @ heights)
