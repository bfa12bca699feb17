"""What compiled code does with rows is what the bodies of the functions say."""

import numpy as np
import pytest
from numba import config

from bezier_filters.runtime.jit import jit
from bezier_filters.runtime.lanes import LANES, broadcast, load, store, where_greater
from bezier_filters.runtime.rows import (
    ROW_LENGTH,
    add_scaled_row,
    duplicate_low,
    inner_products,
    load_row,
    scale_row,
    store_row,
    zero_row,
    zero_w,
)


def mixed(array, weights, places, result):
    """A sum of weighted rows into every row, some of them scaled once more, in the order of the places."""
    for i in range(len(places)):
        total = zero_row()
        for q in range(i + 1):
            total = add_scaled_row(weights[q], load_row(array, places[q]), total)
        store_row(result, i, scale_row(weights[i], total))


@pytest.mark.skipif(config.DISABLE_JIT, reason="there is nothing to compare without the compiler")
def test_compiled_rows_are_those_of_python():
    rng = np.random.default_rng(0)
    array, weights = (
        rng.standard_normal((50, ROW_LENGTH)).astype(np.float32),
        rng.standard_normal(20).astype(np.float32),
    )
    places = rng.integers(0, 50, 20).astype(np.int32)
    compiled, plain = np.full((2, 20, ROW_LENGTH), np.nan, dtype=np.float32)
    jit()(mixed)(array, weights, places, compiled)
    mixed(array, weights, places, plain)
    expected = [weights[i] * (weights[: i + 1, np.newaxis] * array[places[: i + 1]]).sum(axis=0) for i in range(20)]
    np.testing.assert_allclose(compiled, expected, rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(plain, expected, rtol=1e-5, atol=1e-5)


def of_pairs(array, places, result):
    """Products of rows, two at a time."""
    for i in range(len(places)):
        a, b = load(array, i), load(array, places[i])
        store(result, 3 * i, inner_products(a, b))
        store(result, 3 * i + 1, duplicate_low(a) * broadcast(array[i]))
        store(result, 3 * i + 2, where_greater(a, b, zero_w(a - b), b / a))


@pytest.mark.skipif(config.DISABLE_JIT, reason="there is nothing to compare without the compiler")
def test_compiled_pairs_of_rows_are_those_of_python():
    rng = np.random.default_rng(0)
    array, places = rng.standard_normal(LANES * 50).astype(np.float32), rng.integers(0, 50, 20).astype(np.int32)
    compiled, plain = np.full((2, LANES * 60), np.nan, dtype=np.float32)
    jit()(of_pairs)(array, places, compiled)
    of_pairs(array, places, plain)
    np.testing.assert_array_equal(compiled, plain)
    a, b = array.reshape(50, 2, ROW_LENGTH)[:20], array.reshape(50, 2, ROW_LENGTH)[places]
    products = plain.reshape(20, 3, 2, ROW_LENGTH)[:, 0]
    expected = np.einsum("kij,kij->ki", a[..., :3], b[..., :3])
    np.testing.assert_allclose(products, np.repeat(expected[..., np.newaxis], ROW_LENGTH, axis=2), rtol=1e-4, atol=1e-6)
