"""The standard errors of eight fits at a time: the formulas of `uncertainty`."""

from typing import Any

from bezier_filters.arrays import FloatArray
from bezier_filters.kernels.uncertainty import SEEN
from bezier_filters.runtime.lanes import load, multiply_add, spread, square_root, store
from bezier_filters.runtime.lean import inner_njit


@inner_njit()
def standard_errors(
    matrix: FloatArray,
    order: int,
    jets: FloatArray,
    scale: Any,
    normal_noise: float,
    curvature_noise: float,
    errors: FloatArray,
) -> None:
    """Standard errors of normal, mean and Gaussian curvature; see `write_standard_errors`.

    Parameters
    ----------
    matrix : lanes
        Cholesky factor with reciprocal diagonal, packed.
    order : int
        Of the factor.
    jets : lanes
        Derivatives by lengths, as `differentiate` orders them.
    scale : lanes
        Parameters per length.
    normal_noise, curvature_noise : float
        Standard deviation of the heights, a length, as far as it concerns the normal, or the curvatures.
    errors : lanes
        Three entries, which are written.
    """
    zero, one, two, half = spread(0.0), spread(1.0), spread(2.0), spread(0.5)
    p, q, r, s, t = load(jets, 4), load(jets, 1), load(jets, 8), load(jets, 5), load(jets, 2)
    # Times the noise at once, which is small where the derivatives are large: squares must not overflow.
    noise1 = spread(curvature_noise) * scale
    noise2 = noise1 * scale
    a2, b2 = one + p * p, one + q * q
    per_w2 = one / (a2 + q * q)
    per_w3 = per_w2 * square_root(per_w2)
    per_w4 = per_w2 * per_w2
    bend = spread(3.0) * half * (b2 * r - two * p * q * s + a2 * t) * per_w2
    gaussian = (r * t - s * s) * per_w4
    x0, x1, x2, x3, x4 = _whitened(matrix, order, scale, zero, zero, zero, zero)
    y0, y1, y2, y3, y4 = _whitened(matrix, order, zero, scale, zero, zero, zero)
    xx = _dot(x0, x1, x2, x3, x4, x0, x1, x2, x3, x4)
    xy = _dot(x0, x1, x2, x3, x4, y0, y1, y2, y3, y4)
    yy = _dot(y0, y1, y2, y3, y4, y0, y1, y2, y3, y4)
    # |dn|^2 = ((1 + q^2) dp^2 - 2 p q dp dq + (1 + p^2) dq^2) / w^4
    turned = (b2 * xx - two * p * q * xy + a2 * yy) * per_w4
    store(errors, 0, spread(normal_noise) * square_root(turned))
    h0, h1, h2, h3, h4 = _whitened(
        matrix,
        order,
        noise1 * (p * t - q * s - p * bend) * per_w3,
        noise1 * (q * r - p * s - q * bend) * per_w3,
        noise2 * b2 * per_w3,
        zero - noise2 * p * q * per_w3,
        noise2 * a2 * per_w3,
    )
    store(errors, 1, square_root(_dot(h0, h1, h2, h3, h4, h0, h1, h2, h3, h4)))
    k0, k1, k2, k3, k4 = _whitened(
        matrix,
        order,
        zero - spread(4.0) * noise1 * gaussian * p * per_w2,
        zero - spread(4.0) * noise1 * gaussian * q * per_w2,
        two * noise2 * t * per_w4,
        zero - two * noise2 * s * per_w4,
        two * noise2 * r * per_w4,
    )
    store(errors, 2, square_root(_dot(k0, k1, k2, k3, k4, k0, k1, k2, k3, k4)))


@inner_njit()
def _whitened(matrix: FloatArray, order: int, g0: Any, g1: Any, g2: Any, g3: Any, g4: Any) -> Any:
    """Lanes of L^-1 g, L being the last corner of the factor, by forward substitution."""
    first = order - SEEN
    d0 = first * (first + 1) // 2 + first
    d1 = d0 + first + 1
    d2 = d1 + first + 2
    d3 = d2 + first + 3
    d4 = d3 + first + 4
    g0 = g0 * load(matrix, d0)
    g1 = (g1 - g0 * load(matrix, d1)) * load(matrix, d1 + 1)
    g2 = (g2 - g0 * load(matrix, d2) - g1 * load(matrix, d2 + 1)) * load(matrix, d2 + 2)
    g3 = g3 - g0 * load(matrix, d3) - g1 * load(matrix, d3 + 1) - g2 * load(matrix, d3 + 2)
    g3 = g3 * load(matrix, d3 + 3)
    g4 = g4 - g0 * load(matrix, d4) - g1 * load(matrix, d4 + 1) - g2 * load(matrix, d4 + 2) - g3 * load(matrix, d4 + 3)
    g4 = g4 * load(matrix, d4 + 4)
    return g0, g1, g2, g3, g4


@inner_njit()
def _dot(a0: Any, a1: Any, a2: Any, a3: Any, a4: Any, b0: Any, b1: Any, b2: Any, b3: Any, b4: Any) -> Any:
    """Lanes of the inner product of two vectors."""
    return multiply_add(a0, b0, multiply_add(a1, b1, multiply_add(a2, b2, multiply_add(a3, b3, a4 * b4))))
