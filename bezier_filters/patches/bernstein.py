"""Bernstein polynomials on [0, 1] and their tensor products.

A patch of bi-degree d has (d+1)^2 coefficients b_ij in row-major order, index (d+1) i + j:
i counts along u, j along v.
"""

from math import comb, perm

import numpy as np

from bezier_filters.arrays import FloatArray
from bezier_filters.runtime.blas_memory import check_blas_memory


def bernstein_basis(t: FloatArray, degree: int, order: int = 0) -> FloatArray:
    """Bernstein polynomials B_0 .. B_degree, or their derivatives of an order, at real parameters, (..., degree + 1).

    >>> bernstein_basis(np.array(0.5), 2)
    array([0.25, 0.5 , 0.25])
    """
    t = np.asarray(t, dtype=np.float64)[..., np.newaxis]
    if order > degree:
        return np.zeros((*t.shape[:-1], degree + 1))
    # The r-th derivative of a degree-d polynomial is d!/(d-r)! times the r-th difference of
    # its coefficients in the basis of degree d-r.
    low = degree - order
    i = np.arange(low + 1)
    lowered = np.array([comb(low, k) for k in i], dtype=np.float64) * t**i * (1.0 - t) ** (low - i)
    difference = np.diff(np.eye(degree + 1), n=order, axis=0)
    return perm(degree, order) * lowered @ difference


def design_matrix(u: FloatArray, v: FloatArray, degree: int, order: tuple[int, int] = (0, 0)) -> FloatArray:
    """Tensor-product basis B_i(u) B_j(v), or its partial derivative, at n parameters, (n, (degree + 1)**2)."""
    along_u = bernstein_basis(u, degree, order[0])
    along_v = bernstein_basis(v, degree, order[1])
    return (along_u[..., :, np.newaxis] * along_v[..., np.newaxis, :]).reshape(*along_u.shape[:-1], -1)


def monomial_matrix(degree: int) -> FloatArray:
    """Matrix of the change of basis from Bernstein polynomials of t to monomials of s = 2t - 1; row a is for s^a."""
    s = np.polynomial.Polynomial([-1.0, 2.0])
    monomials_in_bernstein = np.empty((degree + 1, degree + 1))
    for a in range(degree + 1):
        power = np.pad((s**a).coef, (0, degree - a))
        # t^k = sum_i C(i,k)/C(d,k) B_i(t)
        monomials_in_bernstein[:, a] = [
            sum(comb(i, k) / comb(degree, k) * power[k] for k in range(i + 1)) for i in range(degree + 1)
        ]
    check_blas_memory()  # the first call of LAPACK, during imports
    return np.asarray(np.linalg.inv(monomials_in_bernstein), dtype=np.float64)
