"""A mesh of a smooth surface together with the surface's exact geometry.

Every surface is a level set F(x, y, z) = const, and one formula serves them all: with g the gradient
and M the Hessian of F, the normal is n = g / |g| and the shape operator is M / |g| on the tangent
plane. The functions of this package only place the samples and write down g and M.
"""

from dataclasses import dataclass

import numpy as np

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.differential_geometry import DerivedCurvatures, principal_curvatures_of


@dataclass(frozen=True)
class SampledSurface(DerivedCurvatures):
    """A triangle mesh whose vertices lie on a smooth surface, with the surface's exact geometry.

    Curvatures are positive on a convex body with outward normals (MeshLab's sign) and have the
    unit 1/length; the Gaussian curvature has 1/length^2. Open patches have upward normals.

    Attributes
    ----------
    vertices : (n, 3) float64
        Points of the surface.
    faces : (m, 3) int32
        Consistently oriented triangles, counter-clockwise seen from outside or above.
    normals : (n, 3) float64
        Unit normals, outward or upward.
    k_min, k_max : (n,) float64
        Principal curvatures, ``k_min <= k_max``.
    direction_min, direction_max : (n, 3) float64
        Unit tangent directions of `k_min` and `k_max`, with
        ``direction_min = normals x direction_max``. Their signs are arbitrary, and at umbilics
        (``k_min == k_max``) so is the pair: compare lines, not vectors.
    """

    vertices: FloatArray
    faces: IntArray
    normals: FloatArray
    k_min: FloatArray
    k_max: FloatArray
    direction_min: FloatArray
    direction_max: FloatArray

    @classmethod
    def from_level_set(
        cls, vertices: FloatArray, faces: IntArray, gradients: FloatArray, hessians: FloatArray
    ) -> "SampledSurface":
        """Surface F = const from the derivatives of F at its vertices.

        The derivative of n = g / |g| along a tangent t is P M t / |g| with P = I - n n^T, so the
        shape operator is the symmetric 2 x 2 matrix of M / |g| in any orthonormal tangent frame
        (Goldman, "Curvature formulas for implicit curves and surfaces", CAGD 22, 2005).

        Faces (m, 3) are oriented like the gradients (n, 3), which point outward and are not zero; their scale cancels
        with that of the Hessians (n, 3, 3).

        The unit sphere x^2 + y^2 + z^2 = 1 at one point:

        >>> point = np.array([[0.0, 0.0, 1.0]])
        >>> no_faces = np.empty((0, 3), dtype=np.int32)
        >>> SampledSurface.from_level_set(point, no_faces, 2 * point, 2 * np.eye(3)[None]).mean_curvature
        array([1.])
        """
        slope = np.linalg.norm(gradients, axis=1, keepdims=True)
        normals = gradients / slope
        least_aligned_axis = np.eye(3)[np.abs(normals).argmin(axis=1)]
        first = np.cross(normals, least_aligned_axis)
        first /= np.linalg.norm(first, axis=1, keepdims=True)
        second = np.cross(normals, first)

        frame = np.stack([first, second], axis=1)
        shape = frame @ hessians @ frame.transpose(0, 2, 1) / slope[:, :, None]
        twist = 0.5 * (shape[:, 0, 1] + shape[:, 1, 0])
        curvatures = principal_curvatures_of(shape[:, 0, 0], twist, shape[:, 1, 1], first, second)
        return cls(vertices, faces, normals, *curvatures)
