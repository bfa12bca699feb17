"""Places from which the points of a cloud were seen: directions to them, and normals that contradict them."""

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from bezier_filters.arguments import real_array
from bezier_filters.arrays import FloatArray
from bezier_filters.errors import InvalidParameterError
from bezier_filters.meshes.mesh import TriangleMesh

ViewpointSide = Literal["toward", "away"]


def view_directions(viewpoint: ArrayLike | None, side: ViewpointSide, mesh: TriangleMesh) -> FloatArray | None:
    """Unit vectors (n, 3) from the points of a cloud to their viewpoints, or away from them; zero at a viewpoint.

    None without a viewpoint.

    >>> from bezier_filters.meshes.mesh import triangle_mesh
    >>> view_directions((0, 0, 2), "toward", triangle_mesh([[0, 0, 0], [0, 0, 5]], [])).tolist()
    [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]
    """
    if side not in ("toward", "away"):
        raise InvalidParameterError(f"viewpoint_side: got {side!r}, expected 'toward' or 'away'")
    if viewpoint is None:
        if side != "toward":
            raise InvalidParameterError(f"viewpoint_side: got {side!r} without a viewpoint; give one")
        return None
    if mesh.face_count:
        raise InvalidParameterError(
            "viewpoint: not allowed for a mesh with faces, whose orientation defines the outside"
        )
    try:
        places = real_array(viewpoint)
    except (TypeError, ValueError) as error:
        raise InvalidParameterError(f"viewpoint: expected three numbers, or as many for each point; {error}") from None
    if places.shape not in ((3,), mesh.vertices.shape) or not np.isfinite(places).all():
        raise InvalidParameterError(
            f"viewpoint: got shape {places.shape}, expected finite numbers of shape (3,) or {mesh.vertices.shape}"
        )
    sign = 1.0 if side == "toward" else -1.0
    vectors = np.asarray(sign * (places - mesh.vertices))
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    unit: FloatArray = np.divide(vectors, lengths, out=np.zeros_like(vectors), where=lengths > 0.0)
    return unit


def count_flipped(normals: FloatArray, views: FloatArray) -> int:
    """Number of normals (n, 3) that contradict the views, unit vectors (n, 3).

    >>> count_flipped(np.array([[0.0, 0, 1], [0, 0, -1], [0, 0, 0]]), np.array([[0.0, 0, 1]] * 3))
    1
    """
    return int((np.einsum("ij,ij->i", normals, views) < 0.0).sum())
