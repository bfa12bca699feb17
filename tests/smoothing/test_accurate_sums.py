"""Sums that do not depend on the order of what is added up."""

import math
from fractions import Fraction

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from bezier_filters.smoothing.accurate_sums import column_sums, sums_by_part, total

values = st.lists(st.floats(-1e100, 1e100), min_size=1, max_size=60)


@given(values=values, cuts=st.lists(st.integers(0, 60), max_size=4), seed=st.integers(0, 99))
def test_sums_of_tiles_have_twice_the_digits(values, cuts, seed):
    """In any order; only where the exact sum lies between two numbers may rounding still go either way."""
    column = np.array(values)
    tiles = np.split(
        np.random.default_rng(seed).permutation(len(values)), sorted(min(cut, len(values)) for cut in cuts)
    )
    found = np.array([column_sums(column[:, np.newaxis], rows.astype(np.int32)) for rows in tiles])
    exact, size = sum(map(Fraction, values)), sum(map(abs, map(Fraction, values)))
    assert abs(sum(map(Fraction, found.ravel().tolist())) - exact) <= size * Fraction(2) ** -95
    assert total(found)[0] == math.fsum(found.ravel())


@given(seed=st.integers(0, 10**6))
def test_columns_squares_and_parts(seed):
    rng = np.random.default_rng(seed)
    table = rng.standard_normal((50, 3)).astype(np.float32)
    exact = table.astype(np.float64)
    assert [math.fsum(exact[:, k]) for k in range(3)] == total(column_sums(table)[np.newaxis]).tolist()
    squares = [math.fsum(np.square(exact[:, k])) for k in range(3)]
    assert squares == total(column_sums(table, squared=True)[np.newaxis]).tolist()
    parts = rng.integers(-1, 4, 50).astype(np.int32)
    expected = [math.fsum(exact[parts == k, 0]) for k in range(4)]
    assert expected == total(sums_by_part(parts, exact[:, 0], 4)[np.newaxis]).tolist()
