"""What became of a hole."""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from bezier_filters.arrays import IntArray
from bezier_filters.holes.hole import Hole
from bezier_filters.meshes.unit_size import LENGTH


@dataclass(frozen=True)
class HoleReport:
    """A hole and its fill.

    Attributes
    ----------
    rim : (k,) int32
        Vertices of the rim, in the direction of the faces that fill the hole; ascending if the border is not manifold.
    islands : int
        Number of separate sheets inside the hole, to which the fill is joined.
    edge_count : int
        Edges of the rim, and of those of the islands.
    perimeter : float
        Total length of these edges.
    diameter : float
        Largest distance between two vertices of the rim, a length.
    is_outer_rim : bool
        Whether this is the outer border of an open sheet, rather than a hole.
    filled : bool
        Whether the hole was filled; otherwise `reason` says why not.
    method : str
        ``"surface"``: triangles on the implicit surface that continues the points and normals around the hole.
        ``"creases"``: sharp edges were continued through the hole, and the sub-holes between them filled.
        ``"variational"``: no such surface; a polyharmonic fill of order 2 or more. ``"flat"``: in the plane of the rim,
        a harmonic fill or a triangulation of the rim alone, of little area. ``"paper"``: the paper's patch, or one for
        each sub-hole. ``"straight"``: a straight band between two rims, at which the surface ends at an angle. Empty if
        open.
    reason : str
        Why the hole stays open, why better methods failed, or that triangles stay larger than those around the hole
        because of the limit on their number; empty otherwise.
    parts : int
        Number of sub-holes that creases cut the hole into; 1 without creases, 0 if it stays open.
    creases : (e, 2) int32
        Edges of the new mesh, within the hole, that are creases.
    new_vertices, new_faces : range
        Rows of the fill in the result. Outer rims are filled last and have the last rows.
    rim_error : float
        Largest distance between a rim vertex before and after: 0.
    rim_dihedral : float
        Mean angle between the faces on both sides of the rim, in degrees.
    self_intersections : int
        Number of new faces that intersect another face; of the best fill if the hole stays open for that reason.
    """

    rim: IntArray
    islands: int
    edge_count: int
    perimeter: float = field(metadata=LENGTH)
    diameter: float = field(metadata=LENGTH)
    is_outer_rim: bool
    filled: bool = False
    method: str = ""
    reason: str = ""
    parts: int = 0
    creases: IntArray = field(default_factory=lambda: np.empty((0, 2), dtype=np.int32))
    new_vertices: range = range(0)
    new_faces: range = range(0)
    rim_error: float = field(default=0.0, metadata=LENGTH)
    rim_dihedral: float = 0.0
    self_intersections: int = 0


def describe_hole(hole: Hole, reason: str = "") -> HoleReport:
    """The report of an open hole, with the reason why it is not to be filled, if there is one."""
    islands = len(hole.loops) - 1
    return HoleReport(
        hole.rim, islands, hole.edge_count, hole.perimeter, hole.diameter, hole.is_outer_rim, reason=reason
    )


def hole_columns(holes: Sequence[HoleReport]) -> dict[str, list[object]]:
    """Columns with a row for each hole; of vertices, faces and edges their number."""
    names = [entry.name for entry in fields(HoleReport)]
    values: dict[str, list[Any]] = {name: [getattr(hole, name) for hole in holes] for name in names}
    counted = ("rim", "creases", "new_vertices", "new_faces")
    return values | {name: [len(value) for value in values[name]] for name in counted}
