"""The Bezier patch over a tangent plane: a height field in a local frame."""

from dataclasses import dataclass

import numpy as np

from bezier_filters.arrays import FloatArray
from bezier_filters.patches.bernstein import design_matrix


@dataclass(frozen=True)
class ParameterRectangle:
    """The rectangle of the tangent plane that is mapped to the unit square of (u, v).

    Attributes
    ----------
    x, y : float
        Its corner (u, v) = (0, 0) in local coordinates.
    width, height : float
        Its sides along the local x and y axes, positive.
    """

    x: float
    y: float
    width: float
    height: float

    @staticmethod
    def bounding(x: FloatArray, y: float | FloatArray) -> "ParameterRectangle":
        """Bounding rectangle of points (x, y) of the plane: the paper's choice."""
        return ParameterRectangle(float(np.min(x)), float(np.min(y)), float(np.ptp(x)), float(np.ptp(y)))

    @staticmethod
    def centred(x: FloatArray, y: FloatArray) -> "ParameterRectangle":
        """Square about the origin that contains the points in every rotation: its inscribed circle contains them."""
        radius = float(np.sqrt(np.max(np.square(x) + np.square(y))))
        return ParameterRectangle(-radius, -radius, 2.0 * radius, 2.0 * radius)

    def parameters(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Parameters (u, v) of points (x, y) of the plane."""
        return (x - self.x) / self.width, (y - self.y) / self.height


@dataclass(frozen=True)
class BezierPatch:
    """A Bezier patch of bi-degree d that is a height field over a plane.

    Bernstein polynomials have linear precision, so a patch fitted to heights over a plane is
    the graph (x(u), y(v), z(u, v)): the control points sit at the Greville points of the
    parameter rectangle, at the heights `heights`.

    Attributes
    ----------
    origin : (3,) float64
        Origin of the local frame in world coordinates.
    axes : (3, 3) float64
        Rows: the unit x and y axes of the plane and its normal z, right-handed.
    rectangle : ParameterRectangle
        Image of the unit square of (u, v) in the plane.
    heights : (d + 1, d + 1) float64
        Heights of the control points; the first index runs along u.

    Examples
    --------
    >>> plane = ParameterRectangle(0.0, 0.0, 1.0, 1.0)
    >>> patch = BezierPatch(np.zeros(3), np.eye(3), plane, np.zeros((4, 4)))
    >>> patch.evaluate(np.array([0.25]), np.array([0.5]))
    array([[0.25, 0.5 , 0.  ]])
    """

    origin: FloatArray
    axes: FloatArray
    rectangle: ParameterRectangle
    heights: FloatArray

    @property
    def degree(self) -> int:
        """Degree in each of u and v."""
        return len(self.heights) - 1

    @property
    def control_net(self) -> FloatArray:
        """Control points in world coordinates, shape (d + 1, d + 1, 3)."""
        greville = np.arange(self.degree + 1) / self.degree
        x = self.rectangle.x + self.rectangle.width * greville
        y = self.rectangle.y + self.rectangle.height * greville
        local = np.stack([*np.meshgrid(x, y, indexing="ij"), self.heights], axis=-1)
        return self.to_world(local)

    def to_local(self, points: FloatArray) -> FloatArray:
        """Local coordinates (x, y, z) of world points, shape (..., 3)."""
        return (points - self.origin) @ self.axes.T

    def to_world(self, local: FloatArray) -> FloatArray:
        """World coordinates of local points, shape (..., 3)."""
        return local @ self.axes + self.origin

    def parameters(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Parameters (u, v), each (...), of the projections of world points (..., 3)."""
        local = self.to_local(points)
        return self.rectangle.parameters(local[..., 0], local[..., 1])

    def design_matrix(self, u: FloatArray, v: FloatArray, order: tuple[int, int] = (0, 0)) -> FloatArray:
        """Basis functions of the control points at n parameters, shape (n, (d + 1)**2)."""
        return design_matrix(u, v, self.degree, order)

    def evaluate(self, u: FloatArray, v: FloatArray, order: tuple[int, int] = (0, 0)) -> FloatArray:
        """Points of the patch, or its partial derivatives by (u, v), in world coordinates.

        Parameters
        ----------
        u, v : (n,) float64
            Parameters.
        order : (int, int)
            Orders of the derivative by u and by v; (0, 0) gives points.

        Returns
        -------
        (n, 3) float64
        """
        net = self.control_net.reshape(-1, 3) - self.origin
        derivative: FloatArray = self.design_matrix(u, v, order) @ net
        return derivative + self.origin if order == (0, 0) else derivative
