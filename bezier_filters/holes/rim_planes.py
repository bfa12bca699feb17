"""Planes through rims, and rims that are circles.

A surface was cut off, or modelled open, where its rim lies in a plane and the surface arrives there like a tube (see
`Hole.is_end`).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bezier_filters.arrays import FloatArray
from bezier_filters.holes.loops import plane_axes, vector_area

# Root mean square distance of a rim from its plane or circle, in edges, that is no accident. Rims of removed faces are
# a tenth of an edge away or more, those in files of few digits a hundredth.
MAX_PLANE_DISTANCE = 0.01
MAX_NOISE_RATIO = 1.5  # the same over the noise: one in a hundred rims of twelve vertices exceeds it
# The same, in edges, of a rim that may be flat, whatever the noise; with more, rims might end at different heights.
MAX_ROUGH_DISTANCE = 0.5
MIN_CIRCLE_EDGES = 8  # of a rim: the six corners around a vertex of a regular mesh lie on a circle, too


@dataclass(frozen=True)
class RimPlane:
    """The plane of the vector area of rims, through their mean vertex."""

    origin: FloatArray  # (3,)
    axes: FloatArray  # (3, 3): rows are two directions in the plane and the normal
    distance: float  # root mean square distance of the vertices from it, a length
    edge: float  # mean length of the edges, a length

    @property
    def is_nearly_flat(self) -> bool:
        """Whether the rim may lie in a plane, apart from noise."""
        return self.distance <= MAX_ROUGH_DISTANCE * self.edge

    def is_flat(self, noise: float | None) -> bool:
        """Whether the distances are those of noise with this standard deviation and of rounding."""
        return self.distance <= MAX_NOISE_RATIO * (noise or 0.0) + MAX_PLANE_DISTANCE * self.edge

    def project(self, points: FloatArray) -> FloatArray:
        """Coordinates of points (n, 3) in the plane, (n, 2)."""
        return np.asarray((points - self.origin) @ self.axes[:2].T)


def rim_plane(loops: Sequence[FloatArray]) -> RimPlane | None:
    """Plane of closed loops, (k, 3) each; None if their vector area is zero.

    The vector area, unlike the plane of least squares, also has a side, and noise of the rim changes it less.
    """
    area = np.sum([vector_area(loop) for loop in loops], axis=0)
    if not area.any():
        return None
    points, axes = np.concatenate(loops), plane_axes(area)
    origin = points.mean(axis=0)
    edges = np.concatenate([np.roll(loop, -1, axis=0) - loop for loop in loops])
    distance = float(np.sqrt(np.square((points - origin) @ axes[2]).mean()))
    return RimPlane(origin, axes, distance, float(np.linalg.norm(edges, axis=1).mean()))


def is_flat_circle(rim: FloatArray) -> bool:
    """Whether a rim (k, 3) is a circle in a plane, as of a bolt hole."""
    plane = rim_plane([rim]) if len(rim) >= MIN_CIRCLE_EDGES else None
    if plane is None or not plane.is_flat(0.0):
        return False
    points = plane.project(rim)
    # Least squares of x^2 + y^2 = 2 a x + 2 b y + c (Kasa 1976).
    terms = np.column_stack([2.0 * points, np.ones(len(points))])
    a, b, _ = np.linalg.lstsq(terms, np.square(points).sum(axis=1), rcond=None)[0]
    radii = np.hypot(points[:, 0] - a, points[:, 1] - b)
    return bool(radii.std() <= MAX_PLANE_DISTANCE * plane.edge)
