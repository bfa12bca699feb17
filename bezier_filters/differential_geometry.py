"""Curvatures of surfaces, with MeshLab's sign: positive where a surface is convex towards its normal."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from bezier_filters.arguments import brief_repr, real_array
from bezier_filters.arrays import BoolArray, FloatArray
from bezier_filters.errors import InvalidParameterError

MIN_TANGENTIAL_SINE = 1e-12
"""Sine of the angle between a normal and a direction up to which the direction counts as normal, without a tangential
part: rounding leaves 1e-16 to 1e-14. Halving or doubling it changes only slopes of 1e-12 radians."""
UMBILIC_RATIO = 2.0 * float(np.sqrt(np.log(100.0)))
"""Difference of the principal curvatures over the standard error of the mean curvature, up to which noise may make it.
Noise alone exceeds it once in a hundred times: in neighbourhoods that are round, half the difference has the
distribution of Rayleigh, whose scale is that standard error over root 2."""
MIN_CURVATURE_DIFFERENCE = 0.02
"""Difference of the principal curvatures, in units of the larger one, below which directions mean nothing even without
noise."""


class DerivedCurvatures:
    """Mean and Gaussian curvature and torsion, for classes with principal curvatures."""

    k_min: FloatArray
    k_max: FloatArray

    @property
    def mean_curvature(self) -> FloatArray:
        """Mean curvature H = (k_min + k_max) / 2, shape (n,), 1/length."""
        return 0.5 * (self.k_min + self.k_max)

    @property
    def gaussian_curvature(self) -> FloatArray:
        """Gaussian curvature K = k_min k_max, shape (n,), 1/length^2."""
        return self.k_min * self.k_max

    @property
    def geodesic_torsion(self) -> FloatArray:
        """Principal geodesic torsion t_max = (k_max - k_min) / 2 >= 0, shape (n,), 1/length."""
        return 0.5 * (self.k_max - self.k_min)


def principal_curvatures_of(
    s11: FloatArray, s12: FloatArray, s22: FloatArray, e1: FloatArray, e2: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """The smaller and the larger principal curvature, each (n,), and their unit directions, each (n, 3).

    The entries (n,) belong to symmetric shape operators in orthonormal bases e1, e2, each (n, 3), whose third vector is
    the normal. The direction of the smaller curvature is normal x the other direction; signs are arbitrary.
    """
    mean, difference = 0.5 * (s11 + s22), 0.5 * (s11 - s22)
    torsion = np.hypot(difference, s12)
    angle = 0.5 * np.arctan2(s12, difference)[:, np.newaxis]
    direction_min, direction_max = np.cos(angle) * e2 - np.sin(angle) * e1, np.cos(angle) * e1 + np.sin(angle) * e2
    return mean - torsion, mean + torsion, direction_min, direction_max


class TangentAngles(NamedTuple):
    """Angles of the tangential parts of directions, each (n,)."""

    cosine: FloatArray  # of the angle from direction_max, counter-clockwise about the normal; 0 where there is none
    sine: FloatArray
    length: FloatArray  # of the tangential part of the unit direction: the sine of the angle to the normal
    exist: BoolArray


def tangent_angles(directions: ArrayLike, direction_max: FloatArray, direction_min: FloatArray) -> TangentAngles:
    """Angles of the tangential parts of directions, (3,) or (n, 3), in the bases of principal directions, each (n, 3).

    Directions may have any length; zero vectors have no tangential part. Other shapes and values that are not finite
    raise an InvalidParameterError.
    """
    unit = unit_directions(directions, len(direction_max))
    cosine, sine = (np.asarray(np.einsum("ij,ij->i", axes, unit)) for axes in (direction_max, direction_min))
    length = np.hypot(cosine, sine)
    exist = length > MIN_TANGENTIAL_SINE
    scale = np.divide(1.0, length, out=np.zeros_like(length), where=exist)
    return TangentAngles(cosine * scale, sine * scale, length, exist)


def unit_directions(directions: ArrayLike, n: int) -> FloatArray:
    """Directions (3,) or (n, 3) of any length as unit vectors (n, 3); zero vectors stay zero."""
    expected = f"expected finite numbers of the shape (3,) or ({n}, 3)"
    try:
        array = real_array(directions)
    except (TypeError, ValueError) as error:
        raise InvalidParameterError(f"directions: {expected}; {error}") from None
    if array.shape not in ((3,), (n, 3)):
        raise InvalidParameterError(f"directions: got the shape {array.shape}, {expected}")
    if not np.isfinite(array).all():
        raise InvalidParameterError(f"directions: got {brief_repr(float(array[~np.isfinite(array)][0]))}, {expected}")
    largest = np.abs(array).max(axis=-1, keepdims=True)  # avoids overflow and underflow of squares
    scaled = np.divide(array, largest, out=np.zeros_like(array), where=largest > 0.0)
    unit = scaled / np.maximum(np.linalg.norm(scaled, axis=-1, keepdims=True), 1.0)  # lengths are 0, or 1 and more
    return np.broadcast_to(unit, (n, 3))


@dataclass(frozen=True)
class TerrainCurvature:
    """Curvatures of a land surface under gravity, row ``i`` for vertex ``i``.

    All are positive where the land is convex to the side of the normals, which on terrain look up: on ridges and
    spurs, and negative in hollows and valleys. Every value is finite; those of curvature are 0 where `is_defined` is
    False.

    Attributes
    ----------
    slope : (n,) float64
        Angle between the surface and the horizontal plane in radians, in [0, pi]; over pi / 2 the normal looks
        down, as under an overhang. 0 where there is no normal.
    profile : (n,) float64
        Normal curvature along the line of steepest slope, 1/length.
    tangential : (n,) float64
        Normal curvature along the contour line, 1/length.
    plan : (n,) float64
        Curvature of the contour line itself, ``tangential / sin(slope)`` (Meusnier), 1/length. It grows without limit
        towards summits and level land.
    is_defined : (n,) bool
        Whether there is a curvature and a direction of slope; there is none where the land is level.
    """

    slope: FloatArray
    profile: FloatArray
    tangential: FloatArray
    plan: FloatArray
    is_defined: BoolArray
