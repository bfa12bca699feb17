"""Random numbers at the vertices of a mesh, by which leverages and what filters leave of noise are found."""

import numpy as np

from bezier_filters.arrays import FloatArray, SingleArray


def random_signs(n: int, columns: int, *, skipped: int = 0) -> SingleArray:
    """Random signs, (n, columns), after some columns that were drawn before."""
    rng = np.random.default_rng(0)
    drawn = [rng.integers(0, 2, n, dtype=np.int8) for _ in range(skipped + columns)]
    return np.column_stack([(2.0 * signs - 1.0).astype(np.float32) for signs in drawn[skipped:]])


def other_signs(n: int) -> SingleArray:
    """Other random signs, (n,)."""
    return np.random.default_rng(1).choice(np.array([-1.0, 1.0]), n).astype(np.float32)


def white_noise(n: int, columns: int) -> SingleArray:
    """Numbers of the standard normal distribution, (n, columns)."""
    return np.random.default_rng(2).standard_normal((n, columns), dtype=np.float32)


def other_white_noise(n: int) -> FloatArray:
    """Others, (n, 1)."""
    return np.random.default_rng(3).standard_normal((n, 1))
