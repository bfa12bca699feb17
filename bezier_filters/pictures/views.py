"""Views of a mesh: which axis points up, which side is the front, and the directions of sight."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.errors import InvalidParameterError

AUTO_AXIS = "auto"

# Right, up and towards the viewer, each in the coordinates (right, up, towards) of the front view.
_VIEWS = {
    "front": ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    "back": ((-1, 0, 0), (0, 1, 0), (0, 0, -1)),
    "left": ((0, 0, 1), (0, 1, 0), (-1, 0, 0)),
    "right": ((0, 0, -1), (0, 1, 0), (1, 0, 0)),
    "top": ((1, 0, 0), (0, 0, -1), (0, 1, 0)),
    "bottom": ((1, 0, 0), (0, 0, 1), (0, -1, 0)),
}
_ISO_TOWARDS = (1.0, 0.8, 1.6)
_VECTORS = {
    f"{sign}{axis}": np.eye(3)[k] * (-1.0 if sign else 1.0) for sign in ("", "-") for k, axis in enumerate("xyz")
}
# the front by the axis that points up, and the reverse for open sheets: x, or y, points to the right
_FRONTS = {"x": "z", "y": "z", "z": "-y", "-x": "-z", "-y": "-z", "-z": "y"}
_UPS = {"z": "y", "-z": "-y", "-y": "z", "y": "-z", "x": "z", "-x": "z"}
_UP_OF_FORMATS = {".obj": "y", ".glb": "y", ".gltf": "y", ".stl": "z", ".las": "z", ".laz": "z"}
_LONGER = 1.5  # ratio of lengths from which on one side of a box is clearly longer
_SHEET = 0.3  # length of the mean normal from which on a mesh is an open sheet: 0 of closed meshes, 0.5 of a hemisphere

VIEW_NAMES = (*_VIEWS, "iso")
AXES = tuple(_VECTORS)


@dataclass(frozen=True)
class Orientation:
    """Axes that point up and towards the viewer, and the one that points up by the convention of a file."""

    up: str = AUTO_AXIS
    front: str = AUTO_AXIS
    convention: str = AUTO_AXIS

    def first_view(self, vertices: FloatArray, faces: IntArray) -> FloatArray:
        """Directions right, up and towards the viewer, (3, 3): sheets from the front, bodies from a corner."""
        axes = choose_orientation(vertices, faces, self.up, self.front, convention=self.convention)
        is_body = len(faces) > 0 and np.linalg.norm(mean_normal(vertices, faces)) <= _SHEET
        return view_axes("iso" if is_body else "front", *axes)


def check_axes(up: str, front: str) -> None:
    """Refuse what is no axis, or two that are parallel."""
    for name, got in (("up", up), ("front", front)):
        if got not in (AUTO_AXIS, *AXES):
            raise InvalidParameterError(f"{name}: got {got!r}, expected one of {', '.join((AUTO_AXIS, *AXES))}")
    if up != AUTO_AXIS and up[-1] == front[-1]:
        raise InvalidParameterError(f"front: got {front!r}, expected an axis perpendicular to up, {up!r}")


def has_border(faces: IntArray) -> bool:
    """Whether faces (m, 3) have an edge that belongs to one face alone, so that backs of faces may be seen."""
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    return bool((np.unique(edges, axis=0, return_counts=True)[1] == 1).any())


def file_up(path: Path) -> str:
    """Axis that points up by the convention of a file's format; ``"auto"`` where there is none, as for PLY."""
    return _UP_OF_FORMATS.get(path.suffix.lower(), AUTO_AXIS)


def mean_normal(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Mean of the normals of faces (m, 3), weighted by area, shape (3,): 0 for closed meshes, a unit one for planes."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    area = float(np.linalg.norm(normals, axis=1).sum())
    return np.asarray(normals.sum(axis=0) / area) if area > 0.0 else np.zeros(3)


def choose_orientation(
    vertices: FloatArray, faces: IntArray, up: str = AUTO_AXIS, front: str = AUTO_AXIS, *, convention: str = AUTO_AXIS
) -> tuple[str, str]:
    """Axes that point up and towards the viewer in the front view, where they are not given.

    Open sheets are seen from the side that their normals face, as the camera that scanned them saw them: with x to the
    right. Other meshes stand upright by the convention of their file, else along z if they are clearly longest in z,
    else along y; flat ones are seen from above. The front is never the narrow side.
    """
    check_axes(up, front)
    if up != AUTO_AXIS and front != AUTO_AXIS:
        return up, front
    normal = mean_normal(vertices, faces) if len(faces) else np.zeros(3)
    if front == AUTO_AXIS and np.linalg.norm(normal) > _SHEET:
        free = [axis for axis in AXES if up == AUTO_AXIS or axis[-1] != up[-1]]
        front = max(free, key=lambda axis: float(normal @ _VECTORS[axis]))
        if up == AUTO_AXIS and front[-1] == "x" and convention in ("y", "z"):
            up = convention
    if front != AUTO_AXIS:
        return (_UPS[front] if up == AUTO_AXIS else up), front
    if up == AUTO_AXIS:
        up = _up_of_body(vertices, convention)
    return up, _widest_front(vertices, up)


def _up_of_body(vertices: FloatArray, convention: str) -> str:
    """Axis that points up of what is no open sheet."""
    x, y, z = np.ptp(vertices, axis=0)
    if convention == "z":
        return "y" if min(x, y) > _LONGER * z else "z"
    if z > _LONGER * max(x, y) and convention == AUTO_AXIS:
        return "z"
    return "-z" if min(x, z) > _LONGER * y else "y"


def _widest_front(vertices: FloatArray, up: str) -> str:
    """The usual front for an axis that points up, or the side next to it if that is clearly wider."""
    right, _, towards = view_axes("front", up)
    sizes = np.ptp(vertices @ np.array([right, towards]).T, axis=0)
    side = next(name for name, axis in _VECTORS.items() if np.array_equal(axis, right))
    return side if sizes[1] > _LONGER * sizes[0] else _FRONTS[up]


def view_axes(view: str, up: str, front: str = AUTO_AXIS) -> FloatArray:
    """Directions right, up and towards the viewer of a named view: the rows of a (3, 3) rotation.

    >>> view_axes("top", up="z").tolist()
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    """
    above, towards = _VECTORS[up], _VECTORS[_FRONTS[up] if front == AUTO_AXIS else front]
    if view == "iso":
        sight = np.array(_ISO_TOWARDS) / np.linalg.norm(_ISO_TOWARDS)
        right = np.cross((0, 1, 0), sight)
        right /= np.linalg.norm(right)
        local = np.array([right, np.cross(sight, right), sight])
    else:
        local = np.array(_VIEWS[view], dtype=np.float64)
    return np.asarray(local @ np.array([np.cross(above, towards), above, towards]))
