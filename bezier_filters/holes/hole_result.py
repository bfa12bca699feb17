"""What hole filling gives: a mesh, and what was done to each hole."""

from dataclasses import dataclass

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.display.html_tables import html_table


@dataclass(frozen=True)
class HoleReport:
    """A hole and its fill.

    Attributes
    ----------
    rim : (k,) int32
        Vertices of the rim, in the direction of the faces that fill the hole.
    islands : int
        Separate sheets within the hole, which the fill is joined to.
    edge_count : int
        Edges of the rim, and of those of the islands.
    perimeter : float
        Their length.
    diameter : float
        Largest distance between two vertices of the rim, a length.
    is_outer_rim : bool
        Whether this is where an open sheet ends, rather than a hole in it.
    filled : bool
        Whether the hole was filled; otherwise `reason` says why not, and nothing of it was changed.
    method : str
        ``"surface"``: triangles on the surface that continues the points and normals around the hole.
        ``"creases"``: sharp edges were continued through the hole, and its parts filled like that.
        ``"variational"``: no such surface; a fill without tension. ``"flat"``: triangles between the
        vertices of the rim, and some more in between, of little area. ``"paper"``: the paper's patch. Empty if open.
    reason : str
        Why the hole was left open, or why better methods were not used; empty if there is nothing to say.
    parts : int
        Sub-holes that creases cut the hole into, 1 without creases, 0 if it was left open.
    creases : (e, 2) int32
        Edges of the new mesh, within the hole, that are creases.
    new_vertices, new_faces : range
        Rows of the result that belong to the fill. Outer rims are filled last: theirs are the last rows.
    rim_error : float
        Largest distance between a rim vertex before and after: 0.
    rim_dihedral : float
        Mean angle between the faces on both sides of the rim, in degrees.
    self_intersections : int
        New faces that cut another face.
    """

    rim: IntArray
    islands: int
    edge_count: int
    perimeter: float
    diameter: float
    is_outer_rim: bool
    filled: bool
    method: str
    reason: str
    parts: int
    creases: IntArray
    new_vertices: range
    new_faces: range
    rim_error: float
    rim_dihedral: float
    self_intersections: int


@dataclass(frozen=True, repr=False)
class HoleFillingResult:
    """A mesh with filled holes.

    Attributes
    ----------
    vertices : (n + added, 3) float64
        The old vertices, unchanged, and the new ones after them.
    faces : (m + added, 3) int32
        The old faces, unchanged, and the new ones after them, oriented as those around them.
    holes : tuple of HoleReport
        One for every hole and every outer rim, ordered by the smallest vertex of the rim.
    noise : float or None
        Standard deviation of the noise along the normal that fills were fitted with, a length; None if the mesh is
        too small to learn it.
    """

    vertices: FloatArray
    faces: IntArray
    holes: tuple[HoleReport, ...]
    noise: float | None

    @property
    def filled(self) -> int:
        """Number of holes that were filled."""
        return sum(hole.filled for hole in self.holes)

    def __repr__(self) -> str:
        """One line: how many holes there were, and how many were filled."""
        return (
            f"HoleFillingResult({len(self.vertices)} vertices, {len(self.faces)} faces, "
            f"{self.filled} of {len(self.holes)} holes filled)"
        )

    def _repr_html_(self) -> str:
        """Table of the holes for notebooks."""
        header = ["edges", "diameter [length]", "fill", "new faces", "rim angle [degrees]", "remarks"]
        rows = [
            [
                hole.edge_count,
                hole.diameter,
                hole.method or "left open",
                len(hole.new_faces),
                hole.rim_dihedral if hole.filled else None,
                hole.reason,
            ]
            for hole in self.holes
        ]
        return html_table(f"{self.filled:,} of {len(self.holes):,} holes filled", header, rows)
