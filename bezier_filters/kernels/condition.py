"""How well the points of a neighbourhood determine their fit: a condition number from the factorisation that gave it.

The normal equations of the fit have the matrix G = L L^T. With the columns of the stacked system scaled to unit
length, as if D = diag(G) were the identity, its condition number in the Frobenius norm is

    kappa = |D^(-1/2) L|_F |L^(-1) D^(1/2)|_F = sqrt(m sum_ij (L^-1)_ij^2 D_j),

which is at least the one in the spectral norm and at most m times it (Demmel, "Applied Numerical Linear
Algebra", 1997, section 3.5: scaling the columns is optimal up to a factor of sqrt(m)). The relative error of
the coefficients is a small multiple of kappa^2 times the unit roundoff.
"""

import numpy as np

from bezier_filters.arrays import FloatArray
from bezier_filters.runtime.lean import inner_njit


@inner_njit()
def factor_condition(factor: FloatArray, order: int, column: FloatArray) -> float:
    """Condition number kappa of the stacked system whose normal equations have a Cholesky factor.

    Parameters
    ----------
    factor : (order (order + 1) / 2,) float64
        Lower triangle L row by row, with reciprocal diagonal.
    order : int
        Number of coefficients m.
    column : (order,) float64
        Work space.

    Returns
    -------
    float
        m or more; the square root of m for each factor is reached where the columns are orthogonal.
    """
    total = 0.0
    for j in range(order):
        row = factor[j * (j + 1) // 2 :]
        squared = 1.0 / (row[j] * row[j])
        for k in range(j):
            squared += row[k] * row[k]
        column[j] = row[j]
        length = column[j] * column[j]
        for i in range(j + 1, order):
            below = factor[i * (i + 1) // 2 :]
            entry = 0.0
            for k in range(j, i):
                entry -= below[k] * column[k]
            column[i] = entry * below[i]
            length += column[i] * column[i]
        total += length * squared
    return float(np.sqrt(order * total))
