"""Checks of what a surface is asked: the surface itself, points in space, and places of faces."""

from typing import Any

import numpy as np

from bezier_filters.arguments import brief_repr, real_array
from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.errors import InvalidParameterError
from bezier_filters.meshes.mesh import MAX_COORDINATE

# How far barycentric coordinates may be outside of a face by rounding. Those computed from positions have errors of
# 2e-16 times the distance from the origin over the height of the face: this is right up to some 4,000 heights.
MAX_COORDINATE_ROUNDING = 1e-12


def check_points(points: Any, name: str = "points") -> FloatArray:
    """Points (q, 3); an empty list counts as none."""
    expected = "expected finite numbers of shape (q, 3)"
    try:
        found = real_array(points)
    except (TypeError, ValueError) as error:
        raise InvalidParameterError(f"{name}: {expected}; {error}") from None
    if found.shape == (0,):
        return np.empty((0, 3))
    if found.ndim != 2 or found.shape[1] != 3:
        hint = "; for one point give a list of one" if found.shape == (3,) else ""
        raise InvalidParameterError(f"{name}: got shape {found.shape}, {expected}{hint}")
    bad = np.flatnonzero(~np.isfinite(found).all(axis=1))
    if len(bad):
        raise InvalidParameterError(
            f"{name}: {len(bad):,} of {len(found):,} have a coordinate that is NaN or infinite, the first in row "
            f"{bad[0]}; leave them out"
        )
    if np.abs(found).max(initial=0.0) > MAX_COORDINATE:
        raise InvalidParameterError(f"{name}: expected coordinates up to {MAX_COORDINATE:g}, as of vertices")
    return found


def check_places(faces: Any, coordinates: Any, face_count: int) -> tuple[IntArray, FloatArray]:
    """Faces (q,) and barycentric coordinates (q, 2) in them; those outside by rounding are moved to the edge."""
    rows = np.asarray(faces)
    if rows.ndim != 1 or (len(rows) and rows.dtype.kind not in "iu"):
        raise InvalidParameterError(
            f"faces: got {brief_repr(faces)} of shape {rows.shape}, expected integers of shape (q,)"
        )
    if len(rows) and not (rows.min() >= 0 and rows.max() < face_count):
        raise InvalidParameterError(
            f"faces: got {rows.min()} to {rows.max()}, expected integers from 0 to {face_count - 1}"
        )
    try:
        where = real_array(coordinates)
    except (TypeError, ValueError) as error:
        raise InvalidParameterError(f"coordinates: expected real numbers of shape ({len(rows)}, 2); {error}") from None
    where = where.reshape(0, 2) if where.shape == (0,) else where
    if where.shape != (len(rows), 2):
        raise InvalidParameterError(f"coordinates: got shape {where.shape}, expected ({len(rows)}, 2)")
    total = where.sum(axis=1)
    outside = ~((where >= -MAX_COORDINATE_ROUNDING).all(axis=1) & (total <= 1.0 + MAX_COORDINATE_ROUNDING))
    if outside.any():
        row = int(outside.argmax())
        raise InvalidParameterError(
            f"coordinates: got {where[row].tolist()} in row {row}, expected 0 or more, and at most 1 in total"
        )
    inside = np.maximum(where, 0.0)
    return rows.astype(np.int32), inside / np.maximum(inside.sum(axis=1), 1.0)[:, np.newaxis]
