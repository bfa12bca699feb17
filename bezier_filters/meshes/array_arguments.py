"""Functions of vertices and faces that are given a mesh of some library say how to get these from it."""

import os
from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

from bezier_filters.errors import InvalidMeshError

Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")

_OF_MESHES = ("current_mesh", "vertex_matrix", "points", "vertices")
"""What meshes of pymeshlab, pyvista and trimesh have, and arrays do not."""


def takes_arrays(function: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
    """Refuse a mesh, or the path of one, as the first argument of a function of vertices and faces.

    Without this, Python would say that the faces are missing, which does not help.

    >>> @takes_arrays
    ... def count(vertices, faces):
    ...     return len(vertices)
    >>> count([[0, 0, 0]], [])
    1
    >>> count("scan.ply")
    Traceback (most recent call last):
        ...
    bezier_filters.errors.InvalidMeshError: vertices: got a str, expected an array of shape (n, 3); \
`vertices, faces = bezier_filters.mesh_arrays(...)` reads meshes and files
    """

    @wraps(function)
    def checked(*args: Parameters.args, **options: Parameters.kwargs) -> Result:
        first = args[0] if args else options.get("vertices")
        if isinstance(first, str | os.PathLike) or any(hasattr(first, name) for name in _OF_MESHES):
            raise InvalidMeshError(
                f"vertices: got a {type(first).__name__}, expected an array of shape (n, 3); "
                "`vertices, faces = bezier_filters.mesh_arrays(...)` reads meshes and files"
            )
        return function(*args, **options)

    return checked
