"""A ball whose faces are turned or share nothing, and what is said of it."""

import numpy as np
from numpy.typing import ArrayLike

from bezier_filters import diagnose
from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.surfaces import sphere

BALL = sphere(resolution=8)


def soup(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, IntArray]:
    """Triangles that share nothing."""
    return vertices[faces].reshape(-1, 3), np.arange(faces.size).reshape(-1, 3)


def turned(faces: IntArray, which: IntArray) -> IntArray:
    """Faces of which some are turned over."""
    result = faces.copy()
    result[which] = result[which, ::-1]
    return result


def findings(vertices: ArrayLike, faces: ArrayLike) -> str:
    """All remarks on a mesh, a line each."""
    return "\n".join(diagnose(vertices, faces))
