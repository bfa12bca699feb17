import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bezier_filters.runtime.cholesky import factorise


@given(st.integers(1, 40), st.integers(0, 10**6))
def test_the_factor_is_that_of_numpy_and_what_is_above_stays(size, seed):
    columns = np.random.default_rng(seed).normal(size=(size, size + 3))
    matrix = columns @ columns.T + np.eye(size)
    expected = np.tril(np.linalg.cholesky(matrix)) + np.triu(matrix, 1)
    assert factorise(matrix)
    np.testing.assert_allclose(matrix, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("matrix", [np.diag([1.0, -1.0]), np.zeros((3, 3)), np.array([[1.0, 2.0], [2.0, 1.0]])])
def test_a_matrix_that_is_not_positive_definite_has_none(matrix):
    assert not factorise(matrix.copy())
