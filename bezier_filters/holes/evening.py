"""Triangles made more even: vertices move to the mean of their neighbours."""

from dataclasses import replace

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.holes.fill_topology import Fill
from bezier_filters.meshes.triangles import area_vector
from bezier_filters.runtime.lean import inner_njit, lean_njit


def evened(fill: Fill) -> Fill:
    """Move every new vertex to the mean of its neighbours, unless that turns a triangle over."""
    n = len(fill.points)
    goals, counts, moving = np.zeros((n, 3)), np.zeros(n), np.arange(n) >= fill.rim_count
    points = fill.points.copy()
    _even_out(fill.points, fill.faces, goals, counts, moving, points)
    return replace(fill, points=points)


@lean_njit()
def _even_out(
    before: FloatArray, faces: IntArray, goals: FloatArray, counts: FloatArray, moving: BoolArray, points: FloatArray
) -> None:
    """Write the new points; those of turned triangles, and of triangles that turn because they stay, keep their places.

    `goals` and `counts` are zero at first.
    """
    for k in range(3):
        for f in range(faces.shape[0]):
            i, j = faces[f, k], faces[f, (k + 1) % 3]
            counts[i] += 1.0
            for axis in range(3):
                goals[i, axis] += before[j, axis]
    for i in range(before.shape[0]):
        if moving[i]:
            for axis in range(3):
                points[i, axis] = goals[i, axis] / max(counts[i], 1.0)
    turned = True
    while turned:
        turned = False
        # All triangles are judged before vertices go back, so that their order does not matter.
        for f in range(faces.shape[0]):
            a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
            if (moving[a] or moving[b] or moving[c]) and _are_opposite(before, points, a, b, c):
                moving[a] = moving[b] = moving[c] = False
                turned = True
        for i in range(before.shape[0]):
            if not moving[i]:
                for axis in range(3):
                    points[i, axis] = before[i, axis]


@inner_njit()
def _are_opposite(before: FloatArray, after: FloatArray, a: int, b: int, c: int) -> bool:
    """Whether a triangle is turned by more than a right angle."""
    ux, uy, uz = area_vector(before, a, b, c)
    vx, vy, vz = area_vector(after, a, b, c)
    return ux * vx + uy * vy + uz * vz < 0.0
