"""Polylines as points and edges."""

from collections.abc import Sequence

import numpy as np

from bezier_filters.arrays import FloatArray, IntArray


def join_polylines(polylines: Sequence[FloatArray]) -> tuple[FloatArray, IntArray, IntArray]:
    """Points (k, 3) of all polylines, edges (e, 2) between them, and the polyline of each point (k,).

    >>> points, edges, number = join_polylines([np.zeros((3, 3)), np.ones((2, 3))])
    >>> edges.tolist(), number.tolist()
    ([[0, 1], [1, 2], [3, 4]], [0, 0, 0, 1, 1])
    """
    points = np.vstack([np.empty((0, 3)), *polylines])
    counts = np.array([len(part) for part in polylines], dtype=np.int64)
    number = np.repeat(np.arange(len(polylines), dtype=np.int32), counts)
    first = np.flatnonzero(number[1:] == number[:-1]).astype(np.int32)
    return points, np.stack([first, first + 1], axis=1), number
