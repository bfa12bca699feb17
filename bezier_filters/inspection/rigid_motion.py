"""What of the deviation of two surfaces is a rigid motion of one of them: that they are not registered."""

import numpy as np

from bezier_filters.arrays import FloatArray

RIGID_PARAMETERS = 6  # three of the translation, three of the rotation


def rigid_share(points: FloatArray, normals: FloatArray, distances: FloatArray) -> float | None:
    """Share of the sum of squares of distances (k,) along normals (k, 3) at points (k, 3) that a rigid motion makes.

    To first order a translation t and a rotation w change them by n . t + n . (w x p), which is fitted by least
    squares. None for too few points, or without distances.

    >>> points = np.random.default_rng(0).normal(size=(50, 3))
    >>> normals = points / np.linalg.norm(points, axis=1, keepdims=True)
    >>> motion = 0.01 * normals[:, 0]
    >>> round(rigid_share(points, normals, motion), 3), round(rigid_share(points, normals, motion + 0.01), 1)
    (1.0, 0.3)
    """
    largest = np.abs(distances).max(initial=0.0)
    if len(distances) <= RIGID_PARAMETERS or not largest > 0.0:
        return None
    values, offsets = distances / largest, points - points.mean(axis=0)
    size = np.abs(offsets).max()
    columns = np.hstack([normals, np.cross(offsets / size if size > 0.0 else offsets, normals)])
    fitted = columns @ np.linalg.lstsq(columns, values)[0]
    return float(min(max(1.0 - np.square(values - fitted).sum() / np.square(values).sum(), 0.0), 1.0))
