"""Penalised least-squares fit of one Bezier patch to the points of a neighbourhood.

The control heights b minimise |alpha (A b - z)|^2 + |(1 - alpha) S b|^2: A is the design matrix of the tensor-product
Bernstein basis, z are the heights of the points, and S are smoothness rows.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from bezier_filters.arguments import checks_arguments, real_array
from bezier_filters.arrays import FloatArray
from bezier_filters.errors import InvalidParameterError, is_integer, is_real
from bezier_filters.patches.patch import BezierPatch, ParameterRectangle
from bezier_filters.patches.polynomials import PolynomialSpace, monomials_from_bernstein, tensor_space
from bezier_filters.patches.smoothness import Penalty, smoothness_matrix

DEGREES = (2, 3, 4)
# of the largest entry of S in monomials: smaller ones are rounding (6e-16 at most; others are 7e-8 or more)
PENALTY_ROUNDING = 1e-12


@dataclass(frozen=True)
class PatchFit:
    """Degree, weight and smoothness rows of a patch fit.

    Attributes
    ----------
    degree : int
        2 (biquadratic), 3 (bicubic, the paper) or 4.
    alpha : float
        Weight of the points in [alpha A; (1 - alpha) S], in (0, 1]; 1 fits the points alone.
    smoothness : {"third_order", "paper"}
        The rows S: see `smoothness.smoothness_matrix`.

    Raises
    ------
    InvalidParameterError
        If a value is out of range.
    """

    degree: int = 3
    alpha: float = 0.8
    smoothness: Penalty = "third_order"

    def __post_init__(self) -> None:
        if not is_integer(self.degree) or self.degree not in DEGREES:
            raise InvalidParameterError(f"degree: got {self.degree!r}, expected one of {DEGREES}")
        if not is_real(self.alpha) or not 0.0 < self.alpha <= 1.0:
            raise InvalidParameterError(f"alpha: got {self.alpha!r}, expected a number in (0, 1]")
        smoothness_matrix(self.smoothness, self.degree)

    @property
    def space(self) -> PolynomialSpace:
        """The polynomials of the patch."""
        return tensor_space(self.degree)

    @property
    def smoothness_rows(self) -> FloatArray:
        """S, shape (r, (degree + 1)**2)."""
        return smoothness_matrix(self.smoothness, self.degree)

    @property
    def monomial_penalty(self) -> FloatArray:
        """Penalty ((1 - alpha) / alpha)^2 S^T S on A^T A, for monomials on [-1, 1]^2."""
        rows = self.smoothness_rows @ np.linalg.inv(monomials_from_bernstein(self.degree))
        # What is free must stay so: next to points on a line, even rounding would determine it.
        rows[np.abs(rows) < PENALTY_ROUNDING * np.abs(rows).max()] = 0.0
        return ((1.0 - self.alpha) / self.alpha) ** 2 * (rows.T @ rows)

    @property
    def free_coefficients(self) -> int:
        """Dimension of the null space of S: the least number of points that determine a fit."""
        rows = 0 if self.alpha == 1.0 else np.linalg.matrix_rank(self.smoothness_rows)
        return int((self.degree + 1) ** 2 - rows)

    @property
    def square(self) -> bool:
        """Whether the parameters cover a square around the vertex, not the paper's bounding rectangle.

        These smoothness rows do not depend on the position of the rectangle.
        """
        return self.smoothness in ("third_order", "flattest")

    def rectangle(self, x: FloatArray, y: FloatArray) -> ParameterRectangle:
        """Parameter rectangle of points whose own vertex is at (0, 0); see `square`."""
        return ParameterRectangle.centred(x, y) if self.square else ParameterRectangle.bounding(x, y)


def _finite_array(name: str, values: ArrayLike, shape: tuple[int | None, ...]) -> FloatArray:
    """Check that values are finite numbers of a shape, in which None stands for any number of rows."""
    try:
        array = real_array(values)
    except (TypeError, ValueError) as error:
        raise InvalidParameterError(f"{name}: expected real numbers; {error}") from None
    if array.ndim != len(shape) or any(n not in (None, k) for n, k in zip(shape, array.shape, strict=True)):
        raise InvalidParameterError(f"{name}: got shape {array.shape}, expected {str(shape).replace('None', 'n')}")
    if not np.isfinite(array).all():
        raise InvalidParameterError(f"{name}: some numbers are NaN or infinite; leave them out")
    return array


@checks_arguments
def fit_patch(points: FloatArray, origin: FloatArray, axes: FloatArray, fit: PatchFit | None = None) -> BezierPatch:
    """Fit a patch to points, as a height field over a given plane.

    Solves [alpha A; (1 - alpha) S] b = [alpha z; 0] for the heights of the control points, by
    QR. For every vertex of a mesh use `estimate_vertex_geometry`, which is a thousand times faster.

    Parameters
    ----------
    points : (n, 3) float64
        Points in world coordinates.
    origin : (3,) float64
        Origin of the plane: the vertex whose neighbourhood is fitted.
    axes : (3, 3) float64
        Rows: unit x and y axes of the plane and its normal.
    fit : PatchFit, optional
        Degree, alpha and smoothness.

    Returns
    -------
    BezierPatch

    Raises
    ------
    InvalidParameterError
        If the points do not determine the patch: too few, or badly placed.

    Examples
    --------
    >>> x, y = np.meshgrid(np.linspace(-1, 1, 5), np.linspace(-1, 1, 5))
    >>> points = np.column_stack([x.ravel(), y.ravel(), (x * y).ravel()])
    >>> patch = fit_patch(points, np.zeros(3), np.eye(3), PatchFit(degree=2))
    >>> u, v = patch.parameters(np.array([[0.5, 0.5, 0.0]]))
    >>> patch.evaluate(u, v).round(6)
    array([[0.5 , 0.5 , 0.25]])
    """
    points, origin, axes = (
        _finite_array(name, values, shape)
        for name, values, shape in (("points", points, (None, 3)), ("origin", origin, (3,)), ("axes", axes, (3, 3)))
    )
    fit = fit or PatchFit()
    x, y, z = ((points - origin) @ axes.T).T
    rectangle = fit.rectangle(x, y)
    if not (rectangle.width > 0.0 and rectangle.height > 0.0):
        raise InvalidParameterError("points: their projections lie on a line parallel to an axis")
    patch = BezierPatch(origin, axes, rectangle, np.zeros((fit.degree + 1, fit.degree + 1)))
    equations = fit.alpha * patch.design_matrix(*rectangle.parameters(x, y))
    target = fit.alpha * z
    if fit.alpha < 1.0:
        smoothness = (1.0 - fit.alpha) * fit.smoothness_rows
        equations = np.vstack([equations, smoothness])
        target = np.append(target, np.zeros(len(smoothness)))
    heights, _, rank, _ = np.linalg.lstsq(equations, target, rcond=None)
    if rank < equations.shape[1]:
        raise InvalidParameterError(
            f"points: {len(points)} points determine only {rank} of {equations.shape[1]} control points; "
            "add points or use third_order smoothness with alpha < 1"
        )
    return BezierPatch(origin, axes, rectangle, heights.reshape(fit.degree + 1, fit.degree + 1))
