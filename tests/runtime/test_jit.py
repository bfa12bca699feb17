"""Options of compiled functions."""

import numpy as np

from bezier_filters.runtime.jit import inner_jit, jit


@inner_jit()
def _sum(values: np.ndarray) -> float:
    total = 0.0
    for i in range(values.shape[0]):
        total += values[i]
    return total


@jit(fastmath={"contract", "reassoc", "nsz", "arcp"})
def _call_with_reordered_sums(values: np.ndarray) -> float:
    return _sum(values)


@jit()
def _call(values: np.ndarray) -> float:
    return _sum(values)


def test_a_function_keeps_the_order_of_its_sums_if_its_first_caller_reorders_them():
    values = np.ones(1000)
    values[0] = 2.0**53  # in order, each one is lost to rounding
    assert _call_with_reordered_sums(values) == 2.0**53  # compiles the sum
    assert _call(values) == 2.0**53
