"""Fields of directions on a surface, without signs, with the standard error of their angle.

With theta the angle from `direction_max`, counter-clockwise about the normal, t = (k_max - k_min) / 2 and the mean
curvature H, the normal curvature is H + t cos 2 theta and the geodesic torsion t sin 2 theta. The fields are

    max, min          theta = 0, 90 degrees: principal directions
    torsion           theta = +-45 degrees: extreme geodesic torsion +-t
    normal curvature  cos 2 theta = (k - H) / t: normal curvature k, 0 in asymptotic directions; none where |k - H| > t

Let s be the standard error of H. In round neighbourhoods the two entries of the shape operator that turn its axes have
errors of s / sqrt 2, and errors independent of that of H. The angle of the principal directions then has the standard
error s / (sqrt 8 t); the angle of a given normal curvature has, besides, that of theta,
s sqrt(1 + cos^2 2 theta / 2) / (2 t sin 2 theta).
"""

import numpy as np

from bezier_filters.arrays import FloatArray
from bezier_filters.differential_geometry import MIN_CURVATURE_DIFFERENCE, UMBILIC_RATIO
from bezier_filters.patch_surface.projection import Places
from bezier_filters.runtime.jit import inner_jit

# codes of the fields
MAX_FIELD, MIN_FIELD, TORSION_PLUS, TORSION_MINUS, NORMAL_PLUS, NORMAL_MINUS = 0, 1, 2, 3, 4, 5
MEAN_CURVATURE_ERROR = 2  # column of the errors of `Places`
# Standard error of an angle in radians, 9.4 degrees, from which on noise alone may make the direction
MAX_DIRECTION_STD = 1.0 / (np.sqrt(2.0) * UMBILIC_RATIO)
DIAGONAL = np.sqrt(0.5)  # cosine of 45 degrees


@inner_jit()
def write_direction(place: Places, field: int, value: float, previous: FloatArray, direction: FloatArray) -> float:
    """Write the direction (3,) of a field at the place in row 0, on the side of the previous one (3,).

    `value` is the given normal curvature. Returns the standard error of the angle, infinite where there is no
    direction: at umbilics and planes, and where no direction has the given normal curvature.
    """
    cosine, sine, std = direction_angle(
        place.curvatures[0, 0], place.curvatures[0, 1], place.errors[0, MEAN_CURVATURE_ERROR], field, value
    )
    along = 0.0
    for axis in range(3):
        direction[axis] = cosine * place.directions[0, 1, axis] + sine * place.directions[0, 0, axis]
        along += direction[axis] * previous[axis]
    if along < 0.0:
        for axis in range(3):
            direction[axis] = -direction[axis]
    return std


@inner_jit()
def direction_angle(
    k_min: float, k_max: float, mean_std: float, field: int, value: float
) -> tuple[float, float, float]:
    """Cosine and sine of the angle from `direction_max` to the direction of a field, and the angle's standard error."""
    torsion = 0.5 * (k_max - k_min)
    if not 2.0 * torsion > MIN_CURVATURE_DIFFERENCE * max(abs(k_min), abs(k_max)):
        return 1.0, 0.0, np.inf
    std = mean_std / (np.sqrt(8.0) * torsion)
    if field == MAX_FIELD:
        return 1.0, 0.0, std
    if field == MIN_FIELD:
        return 0.0, 1.0, std
    if field == TORSION_PLUS:
        return DIAGONAL, DIAGONAL, std
    if field == TORSION_MINUS:
        return DIAGONAL, -DIAGONAL, std
    double = (value - 0.5 * (k_min + k_max)) / torsion  # cos 2 theta
    if not abs(double) < 1.0:
        return 1.0, 0.0, np.inf
    of_theta = mean_std * np.sqrt(1.0 + 0.5 * double * double) / (2.0 * torsion * np.sqrt(1.0 - double * double))
    sine = np.sqrt(0.5 * (1.0 - double))
    return np.sqrt(0.5 * (1.0 + double)), sine if field == NORMAL_PLUS else -sine, np.hypot(std, of_theta)
