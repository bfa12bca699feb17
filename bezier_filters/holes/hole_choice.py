"""Which of the holes of a mesh are filled."""

from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Integral, Real

import numpy as np

from bezier_filters.arrays import BoolArray
from bezier_filters.errors import InvalidParameterError
from bezier_filters.holes.hole_detection import Hole


@dataclass(frozen=True)
class HoleChoice:
    """Conditions on holes, all of which must hold.

    Attributes
    ----------
    max_edges : int, optional
        Most edges of a hole.
    max_perimeter, max_diameter : float, optional
        Largest perimeter and diameter, lengths.
    holes : sequence of int, optional
        Numbers of the holes, as they are listed in the result.
    selected : (n,) bool, optional
        Vertices of the mesh, one of which a hole must have on its rim.
    outer_rims : bool
        Whether outer rims of open sheets count as holes. Those listed in `holes` always do.

    Raises
    ------
    InvalidParameterError
        If a value is out of range.
    """

    max_edges: int | None = None
    max_perimeter: float | None = None
    max_diameter: float | None = None
    holes: Sequence[int] | None = None
    selected: BoolArray | None = None
    outer_rims: bool = False

    def __post_init__(self) -> None:
        edges = self.max_edges
        if edges is not None and (isinstance(edges, bool) or not isinstance(edges, Integral) or edges < 3):
            raise InvalidParameterError(f"max_edges: got {edges!r}, expected an integer of 3 or more, or None")
        for name in ("max_perimeter", "max_diameter"):
            length = getattr(self, name)
            if length is not None and (
                isinstance(length, bool) or not isinstance(length, Real) or not float(length) > 0.0
            ):
                raise InvalidParameterError(f"{name}: got {length!r}, expected a positive length, or None")

    def check(self, vertex_count: int, hole_count: int) -> None:
        """Raise an InvalidParameterError if `selected` or `holes` do not fit the mesh."""
        if self.selected is not None:
            mask = np.asarray(self.selected)
            if mask.shape != (vertex_count,) or mask.dtype != np.bool_:
                raise InvalidParameterError(
                    f"selected: got {mask.dtype} of shape {mask.shape}, expected bool of shape ({vertex_count},)"
                )
        for k in self.holes or ():
            if isinstance(k, bool) or not isinstance(k, Integral) or not 0 <= k < hole_count:
                raise InvalidParameterError(
                    f"holes: got {k!r}, expected numbers from 0 to {hole_count - 1}, for {hole_count} holes and rims; "
                    "the report of a call with holes=[] lists them"
                )

    def refusal(self, number: int, hole: Hole) -> str:
        """Why a hole is not filled; empty if it is."""
        if self.holes is not None and number not in self.holes:
            return "not among the holes that were asked for"
        if hole.is_outer_rim and not self.outer_rims and self.holes is None:
            return "the outer rim of an open sheet; outer_rims=True fills it, too"
        if self.max_edges is not None and hole.edge_count > self.max_edges:
            return f"{hole.edge_count} edges, more than max_edges={self.max_edges}"
        if self.max_perimeter is not None and hole.perimeter > self.max_perimeter:
            return f"perimeter {hole.perimeter:.6g}, more than max_perimeter={self.max_perimeter:.6g}"
        if self.max_diameter is not None and hole.diameter > self.max_diameter:
            return f"diameter {hole.diameter:.6g}, more than max_diameter={self.max_diameter:.6g}"
        if self.selected is not None and not self.selected[hole.rim].any():
            return "no vertex of its rim is selected"
        return ""
