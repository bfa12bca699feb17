"""A hole of a mesh, or another border: its loops and its kind.

The total geodesic curvature of a border, seen from its surface, distinguishes holes from outer rims: by Gauss-Bonnet it
is -2 pi around a hole in a plane, 0 at the end of a tube and 2 pi around a flat sheet. The mean cosine of the angle
between the plane of the rim and the faces there is 1, 0 and -1. Noise hardly changes it, as the sum of the area vectors
of faces depends on the border of their union alone.
"""

from dataclasses import dataclass
from math import pi

from bezier_filters.arrays import IntArray

# total geodesic curvature of an outer rim, in radians: half-way from the end of a tube to a flat disk
MIN_OUTER_RIM_TURNING = pi
MAX_END_COSINE = 0.5  # mean cosine at the end of a surface: half-way from a hole in a plane to a tube


@dataclass(frozen=True)
class Hole:
    """A hole of a mesh, or the outer rim of an open sheet."""

    # each (k,): vertices of its rim, then of the rims of its islands, in the direction of the faces that fill the hole:
    # counter-clockwise around the hole seen from outside, clockwise around islands
    loops: tuple[IntArray, ...]
    # total geodesic curvature of the rim as its surface sees it, in radians; see the module
    turning: float
    perimeter: float  # of all loops
    diameter: float  # largest distance between two vertices of the rim, a length
    obstacle: str = ""  # why it cannot be filled; empty if it can
    cosine: float = 1.0  # mean cosine of the angle between the plane of the rim and the faces there; see the module
    is_border: bool = False  # whether a lid would be large compared with the component, as that of a scan from one side
    is_circle: bool = False  # whether it is a circle in a plane, in an open sheet, as of a bolt hole
    is_band: bool = False  # whether it is the hole between two rims, both of which are its loops
    non_manifold_edges: int = 0  # number of edges of a non-manifold border, whose only "loop" is a list of its vertices

    @property
    def rim(self) -> IntArray:
        """Vertices of the rim, (k,)."""
        return self.loops[0]

    @property
    def is_outer_rim(self) -> bool:
        """Whether this is the outer border of an open sheet."""
        return self.turning > MIN_OUTER_RIM_TURNING or self.is_border

    @property
    def is_end(self) -> bool:
        """Whether the surface arrives at the rim rather like a tube, or a sheet, than like the plane of the rim."""
        return self.cosine < MAX_END_COSINE

    @property
    def edge_count(self) -> int:
        """Number of edges of all loops."""
        return self.non_manifold_edges or sum(len(loop) for loop in self.loops)
