import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from bezier_filters.runtime.dense import cholesky_solve, dot, powers


@given(st.integers(1, 45), st.integers(0, 100))
def test_cholesky_agrees_with_a_dense_solver(order, seed):
    rng = np.random.default_rng(seed)
    factor = rng.standard_normal((order + 3, order))
    matrix, rhs = factor.T @ factor, rng.standard_normal(order)
    solution = rhs.copy()
    regular = cholesky_solve(matrix[np.tril_indices(order)], solution, order, 1e-6)
    condition = np.linalg.cond(matrix)
    assert regular or condition > 1e5
    if regular:
        expected = np.linalg.solve(matrix, rhs)
        np.testing.assert_allclose(solution, expected, atol=1e-14 * condition * np.abs(expected).max())


def test_a_singular_matrix_is_refused():
    assert not cholesky_solve(np.array([1.0, 1.0, 1.0]), np.ones(2), 2, 1e-6)
    assert not cholesky_solve(np.array([0.0]), np.ones(1), 1, 1e-6)
    assert not cholesky_solve(np.array([np.nan]), np.ones(1), 1, 1e-6)


@given(st.lists(st.floats(-2, 2), min_size=1, max_size=30), st.integers(0, 6))
def test_powers_and_dot(values, highest):
    t = np.array(values)
    out = np.zeros((highest + 1, len(t)))
    powers(t, len(t), highest, out)
    np.testing.assert_allclose(out, t ** np.arange(highest + 1)[:, None], atol=1e-12)
    np.testing.assert_allclose(dot(t, out[highest], len(t)), t @ out[highest], atol=1e-9)
