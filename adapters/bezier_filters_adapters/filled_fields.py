"""Fields of a mesh after its holes were filled: old rows stay, new ones continue those at the rims."""

from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.fields import PREFIX
from bezier_filters.holes.adjacent_rows import adjacent_faces, nearest_rim_vertices
from bezier_filters.holes.polyharmonic_fairing import polyharmonic_continuation

Values: TypeAlias = NDArray[Any]

NEW = PREFIX + "new"  # field of vertices and of faces: 1 for those of fills, 0 for old ones
_COLOR_CHANNELS = (3, 4)


@dataclass(frozen=True)
class Fill:
    """A mesh with filled holes, as `bezier_filters.fill_holes` returns it, and where new rows begin."""

    vertices: FloatArray
    faces: IntArray
    old_vertices: int
    old_faces: int

    @property
    def new_faces(self) -> IntArray:
        """The faces of the fills, (f, 3)."""
        return self.faces[self.old_faces :]

    def marks(self) -> dict[str, Values]:
        """The field `NEW` of the vertices."""
        return {NEW: (np.arange(len(self.vertices)) >= self.old_vertices).astype(np.uint8)}

    def like_vertex(self) -> IntArray:
        """For each new vertex the nearest old one at a rim, (k,)."""
        if not len(self.new_faces):
            return np.empty(0, np.int32)
        return nearest_rim_vertices(self.vertices, self.new_faces, self.old_vertices)

    def like_face(self) -> IntArray:
        """For each new face an old one next to it, (f,)."""
        if not len(self.new_faces):
            return np.empty(0, np.int32)
        return adjacent_faces(self.vertices, self.faces[: self.old_faces], self.new_faces)

    def new_vertex_rows(self, name: str, values: Values) -> Values:
        """Rows of a field (n, ...) for the new vertices, (k, ...).

        Numbers with a decimal point and colours are continued harmonically, as in pymeshlab's meshes; codes and labels
        are those of the nearest vertices; columns of this package are 0, as nothing has been estimated there.
        """
        if len(self.vertices) == self.old_vertices or name.startswith(PREFIX):
            return np.zeros((len(self.vertices) - self.old_vertices, *values.shape[1:]), values.dtype)
        is_color = values.dtype == np.uint8 and values.ndim > 1 and values.shape[1] in _COLOR_CHANNELS
        if is_color or np.issubdtype(values.dtype, np.floating):
            used, local = np.unique(self.new_faces, return_inverse=True)
            rim = used[used < self.old_vertices]
            known = values[rim].reshape(len(rim), -1).astype(np.float64)
            if np.isfinite(known).all():
                faces = local.reshape(-1, 3).astype(np.int32)
                found = polyharmonic_continuation(self.vertices[used], faces, known)[len(rim) :]
                found = np.rint(found) if is_color else found
                return found.reshape(-1, *values.shape[1:]).astype(values.dtype)
        return values[self.like_vertex()]

    def new_face_rows(self, name: str, values: Values, like_face: IntArray) -> Values:
        """Rows of a field (m, ...) for the new faces, (f, ...): those of old faces, or 0 in columns of this package."""
        found = values[like_face]
        return np.zeros_like(found) if name.startswith(PREFIX) else found
