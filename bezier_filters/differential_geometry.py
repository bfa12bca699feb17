"""Curvatures of surfaces, with MeshLab's sign: positive where a surface is convex towards its normal."""

import numpy as np

from bezier_filters.arrays import FloatArray


class DerivedCurvatures:
    """What follows from principal curvatures, for classes that have them."""

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

    They are those of symmetric shape operators, (n,) each entry, in orthonormal bases e1, e2, each (n, 3), whose third
    vector is the normal. The smaller one's direction is the normal x that of the larger; signs are arbitrary.
    """
    mean, difference = 0.5 * (s11 + s22), 0.5 * (s11 - s22)
    torsion = np.hypot(difference, s12)
    angle = 0.5 * np.arctan2(s12, difference)[:, np.newaxis]
    direction_min, direction_max = np.cos(angle) * e2 - np.sin(angle) * e1, np.cos(angle) * e1 + np.sin(angle) * e2
    return mean - torsion, mean + torsion, direction_min, direction_max
