"""The red blood cell of Evans and Fung as a mesh with its exact geometry."""

import numpy as np

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.errors import InvalidParameterError
from bezier_filters.surfaces import SampledSurface, sampling

THICKNESS = np.polynomial.Polynomial([0.2072, 2.0026, -1.1228])
"""By r^2; times sqrt(1 - r^2)."""


def red_blood_cell(*, resolution: int = 16, jitter: float = 0.0, seed: int = 0) -> SampledSurface:
    """Resting red blood cell z = +-1/2 sqrt(1 - r^2) (0.2072 + 2.0026 r^2 - 1.1228 r^4), r^2 = x^2 + y^2.

    The shape that Evans and Fung ("Improved measurements of the erythrocyte geometry",
    Microvascular Research 4, 1972) measured, in units of its radius: a disc with a thick rim and a
    dimple on either side. The mesh is that of the unit sphere, squeezed along z.
    """
    directions, faces = sampling.sphere_directions(resolution, jitter=jitter, seed=seed)
    x, y = directions[:, 0], directions[:, 1]
    z = 0.5 * directions[:, 2] * THICKNESS(x * x + y * y)
    return red_blood_cell_at(np.column_stack([x, y, z]), faces)


def red_blood_cell_at(vertices: FloatArray, faces: IntArray) -> SampledSurface:
    """`red_blood_cell` sampled at given points of it.

    These are points (n, 3) and triangles (m, 3), counter-clockwise seen from outside. Points off the surface are
    refused: z^2 may be off by rounding to single precision.
    """
    x, y, z = vertices.T
    square = x * x + y * y
    # F = z^2 - Q(x^2 + y^2), halved, with Q the square of the height.
    height_square = np.polynomial.Polynomial([0.25, -0.25]) * THICKNESS**2
    off = float(np.abs(z * z - height_square(square)).max())
    if not off < 1e-6:
        raise InvalidParameterError(f"vertices: z^2 is off by up to {off:.2g}, expected points of the red blood cell")
    slope, bend = height_square.deriv()(square), height_square.deriv(2)(square)
    gradients = np.column_stack([-x * slope, -y * slope, z])
    radial = np.column_stack([x, y, np.zeros_like(z)])
    hessians = -slope[:, None, None] * np.diag([1.0, 1.0, 0.0]) + np.diag([0.0, 0.0, 1.0])
    hessians -= 2.0 * bend[:, None, None] * radial[:, :, None] * radial[:, None, :]
    return SampledSurface.from_level_set(vertices, faces, gradients, hessians)
