import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bezier_filters.patches.bernstein import bernstein_basis, design_matrix, monomial_matrix

parameters = st.floats(-0.5, 1.5)
degrees = st.integers(0, 8)


@given(parameters, degrees)
def test_basis_sums_to_one(t, degree):
    assert bernstein_basis(np.array(t), degree).sum() == pytest.approx(1.0)


@given(parameters, st.integers(1, 8))
def test_greville_points_reproduce_the_parameter(t, degree):
    greville = np.arange(degree + 1) / degree
    assert bernstein_basis(np.array(t), degree) @ greville == pytest.approx(t)


@given(st.floats(0, 1), st.integers(1, 6), st.integers(1, 3))
def test_derivatives_equal_those_of_the_polynomial(t, degree, order):
    for i in range(degree + 1):
        # B_i = C(d, i) t^i (1 - t)^(d - i) as a NumPy polynomial: a second formula
        roots_at_one = np.polynomial.Polynomial([1.0, -1.0]) ** (degree - i)
        power = np.polynomial.Polynomial([0.0, 1.0]) ** i
        from math import comb

        expected = (comb(degree, i) * power * roots_at_one).deriv(order)(t)
        assert bernstein_basis(np.array(t), degree, order)[i] == pytest.approx(expected, abs=1e-9)


def test_derivative_above_the_degree_is_zero():
    assert bernstein_basis(np.array([0.3, 0.7]), 2, order=3).tolist() == [[0.0] * 3] * 2


@given(parameters, st.integers(0, 5))
def test_monomial_coefficients_give_the_same_polynomial(t, degree):
    bernstein = np.random.default_rng(degree).standard_normal(degree + 1)
    monomial = monomial_matrix(degree) @ bernstein
    value = np.polynomial.polynomial.polyval(2.0 * t - 1.0, monomial)
    assert value == pytest.approx(bernstein_basis(np.array(t), degree) @ bernstein)


def test_design_matrix_is_the_tensor_product_with_v_running_fastest():
    u, v = np.array([0.2, 0.9]), np.array([0.5, 0.1])
    rows = design_matrix(u, v, 3, order=(1, 2))
    for k in range(2):
        expected = np.outer(bernstein_basis(u[k], 3, 1), bernstein_basis(v[k], 3, 2))
        np.testing.assert_allclose(rows[k].reshape(4, 4), expected)
