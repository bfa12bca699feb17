"""Hole detection: border loops, their classification as holes or outer rims, islands, and the choice of holes.

The measures that distinguish holes from outer rims are explained in `hole`. Noise of the border increases its total
geodesic curvature, so an outer rim must be one by the surface around it, too (`rim_turning`).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import pi
from types import NoneType

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from bezier_filters.arguments import brief_repr
from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.errors import InvalidParameterError, is_integer, is_real
from bezier_filters.holes.hole import MAX_END_COSINE, MIN_OUTER_RIM_TURNING, Hole
from bezier_filters.holes.islands import assign_islands, join_rims_of_faces
from bezier_filters.holes.loops import angle_sums, diameter, plane_axes, simple_loops, vector_area
from bezier_filters.holes.rim_planes import is_flat_circle, rim_plane
from bezier_filters.holes.rim_turning import smooth_turning
from bezier_filters.meshes.adjacency import components
from bezier_filters.meshes.half_edges import BorderEdges, border_edges, coincident_border_edges, cycles
from bezier_filters.meshes.mesh import check_selection
from bezier_filters.meshes.neighbourhoods import search_workspace
from bezier_filters.meshes.prepared_mesh import PreparedMesh
from bezier_filters.meshes.triangles import area_vectors

# Area of a lid, over that of the component that it would close, from which a rim is the border of a surface and no hole
# in it: that of a cap of 70 degrees, cut from a sphere. Range scans have .34 to .7, statues without their bases .2.
MIN_LID_SHARE = 1.0 / 3.0
MIN_FLAT_COSINE = 0.999  # mean cosine of the angle between faces and the plane of a rim in a flat part: 2.5 degrees
WELD_HINT = "it has no width; weld them first (repair=True of the filter, or meshing_merge_close_vertices)"
ORIENT_HINT = "repair them first (repair=True of the filter, or pymeshlab's meshing_repair filters)"


def find_holes(mesh: PreparedMesh) -> list[Hole]:
    """Find all holes and outer rims, ordered by the smallest vertex of their rim.

    If several borders meet at a vertex, each continues with the next edge across its gap. A sheet inside a hole, near
    its plane and with the same orientation, is an island of that hole; its rim is not listed separately. An island
    that touches the rim at a vertex forms one loop with it, which passes the vertex twice. A border has an obstacle if
    it meets a non-manifold edge, with more than two faces or with two of opposite orientation, or if it coincides with
    another border. Rims of ends in one plane, of which one surrounds the others, form one hole, that of a missing face.
    """
    holes = []
    border = border_edges(mesh, mesh.adjacency.on_boundary)
    n, doubled = mesh.vertex_count, coincident_border_edges(mesh, border)
    cracks = np.sort((border.start * np.int64(n) + border.end)[doubled])
    loops, rest = _border_loops(mesh, border)
    room = search_workspace(n)
    for loop, gaps in loops:
        turning = float((gaps - pi).sum())
        if turning > MIN_OUTER_RIM_TURNING:  # noise of the border increases its turning
            smooth = smooth_turning(mesh, loop, room)
            turning = turning if smooth is None else min(turning, smooth)
        # Sheets that touch at a vertex share one loop, but each has its own rim.
        rims = simple_loops(loop) if turning > MIN_OUTER_RIM_TURNING else [loop]
        for rim in rims:
            count = _count_listed(rim * np.int64(n) + np.roll(rim, -1), cracks)
            obstacle = f"{count} of its {len(rim)} edges lie on those of another border: {WELD_HINT}" if count else ""
            holes.append(measure_hole(mesh, (rim[::-1].copy(),), obstacle, turning))
    for start, end in rest:
        length = np.linalg.norm(mesh.vertices[end] - mesh.vertices[start], axis=1).sum()
        where = end[border.non_manifold[end]][0]
        obstacle = f"meets edges of several faces, or of faces that disagree, at vertex {where}: {ORIENT_HINT}"
        rim = np.union1d(start, end)
        holes.append(
            Hole((rim,), 0.0, float(length), diameter(mesh.vertices[rim]), obstacle, non_manifold_edges=len(start))
        )
    holes = _find_borders(mesh, sorted(holes, key=lambda hole: int(hole.rim.min())))
    return _find_circles(mesh, join_rims_of_faces(mesh, assign_islands(mesh, holes)))


def measure_hole(mesh: PreparedMesh, loops: tuple[IntArray, ...], obstacle: str = "", turning: float = 0.0) -> Hole:
    """A hole with given loops, in the direction of the faces that fill it; the first is its rim."""
    points = [mesh.vertices[loop[::-1]] for loop in loops]  # as the border runs
    length = sum(float(np.linalg.norm(np.roll(rim, -1, axis=0) - rim, axis=1).sum()) for rim in points)
    cosine = _mean_cosine(mesh, loops[0]) if len(loops[0]) and not obstacle else 1.0
    return Hole(loops, turning, length, diameter(points[0]) if len(points[0]) else 0.0, obstacle, cosine)


def _mean_cosine(mesh: PreparedMesh, rim: IntArray) -> float:
    """See `Hole.cosine`; the rim runs in the direction of the faces that fill it."""
    area = vector_area(mesh.vertices[rim])
    around = area_vectors(mesh.vertices, mesh.faces[np.unique(mesh.adjacency.faces.of(rim))])
    most = float(np.linalg.norm(area) * np.linalg.norm(around, axis=1).sum())
    return float(around.sum(axis=0) @ area) / most if most else 1.0


def _find_borders(mesh: PreparedMesh, holes: list[Hole]) -> list[Hole]:
    """Mark rims whose lid would be large compared with the component, and opposite to it.

    By Gauss's theorem the sum of the area vectors of the faces of a component is opposite to that of its lids, so it is
    0 for a tube with two ends. Flat ends are holes however large, as somebody has made them.
    """
    uncertain = [k for k, hole in enumerate(holes) if hole.cosine < 0.0 and not (hole.is_outer_rim or hole.obstacle)]
    uncertain = [k for k in uncertain if not _is_nearly_flat_end(mesh, holes[k])]
    if not uncertain:
        return holes
    component = components(mesh.adjacency)
    areas, owner = area_vectors(mesh.vertices, mesh.faces), component[mesh.faces[:, 0]]
    sums = np.stack([np.bincount(owner, weights=column) for column in areas.T], axis=1)
    totals = np.bincount(owner, weights=np.linalg.norm(areas, axis=1))
    for k in uncertain:
        own, lid = component[holes[k].rim[0]], vector_area(mesh.vertices[holes[k].rim])
        share = -(sums[own] @ lid) / (np.linalg.norm(lid) * totals[own])
        holes[k] = replace(holes[k], is_border=bool(share > MIN_LID_SHARE))
    return holes


def _is_nearly_flat_end(mesh: PreparedMesh, hole: Hole) -> bool:
    """Whether a rim may lie in a plane, apart from noise, and the surface arrives there like a tube."""
    plane = rim_plane([mesh.vertices[hole.rim]])
    return plane is not None and plane.is_nearly_flat and abs(hole.cosine) < MAX_END_COSINE


def _find_circles(mesh: PreparedMesh, holes: list[Hole]) -> list[Hole]:
    """Mark the circles in flat parts of open sheets."""
    sheets = [hole.rim[0] for hole in holes if hole.is_outer_rim]
    if not sheets:
        return holes
    is_circle = [
        hole.cosine > MIN_FLAT_COSINE and len(hole.loops) == 1 and is_flat_circle(mesh.vertices[hole.rim])
        for hole in holes
    ]
    if not any(is_circle):
        return holes
    component = components(mesh.adjacency)
    open_ = np.unique(component[sheets])
    return [
        replace(hole, is_circle=True) if circle and component[hole.rim[0]] in open_ else hole
        for hole, circle in zip(holes, is_circle, strict=True)
    ]


def _count_listed(keys: IntArray, listed: IntArray) -> int:
    """Number of keys found in a sorted array, counted with their multiplicity there."""
    return int((np.searchsorted(listed, keys, side="right") - np.searchsorted(listed, keys)).sum())


def _border_loops(
    mesh: PreparedMesh, border: BorderEdges
) -> tuple[list[tuple[IntArray, FloatArray]], list[tuple[IntArray, IntArray]]]:
    """Loops of border half-edges, in the direction of their faces, with the gap angle at each vertex, (k,).

    Components of the border with a vertex where its continuation is ambiguous are returned separately, as the starts
    and ends of their edges.
    """
    order = np.argsort(border.start, kind="stable")
    start, end = border.start[order], border.end[order]
    first, last = np.searchsorted(start, end), np.searchsorted(start, end, side="right")
    arrivals = np.bincount(end, minlength=mesh.vertex_count)[end]
    ambiguous = border.non_manifold[end] & ((last - first != 1) | (arrivals != 1))
    if ((last - first != arrivals) & ~ambiguous).any():
        raise InvalidParameterError("on_border: got vertices other than the ends of edges with one face")
    components = _ambiguous_components(ambiguous, start, end, mesh.vertex_count)
    undetermined = np.zeros(len(start), dtype=np.bool_)
    undetermined[np.concatenate([*components, np.empty(0, dtype=np.int64)])] = True
    rest = [(start[component], end[component]) for component in components]
    successor = np.where(undetermined, np.arange(len(start)), first).astype(np.int32)
    around = mesh.faces[np.unique(mesh.adjacency.faces.of(end))]
    gaps = 2.0 * pi - angle_sums(mesh.vertices, around, mesh.vertex_count)[end]  # at the end of each half-edge
    by_end = np.argsort(end, kind="stable")
    for vertex in np.unique(end[(last - first > 1) & ~undetermined]):
        arriving = by_end[slice(*np.searchsorted(end, [vertex, vertex + 1], sorter=by_end))]
        leaving = np.arange(*np.searchsorted(start, [vertex, vertex + 1]))
        following, angles = _match_across_gaps(mesh, vertex, start[arriving], end[leaving])
        successor[arriving], gaps[arriving] = leaving[following], angles
    return [(end[loop], gaps[loop]) for loop in cycles(successor, np.flatnonzero(~undetermined).astype(np.int32))], rest


def _ambiguous_components(ambiguous: BoolArray, start: IntArray, end: IntArray, n: int) -> list[IntArray]:
    """Numbers of the half-edges of each connected component of the border with an ambiguous half-edge."""
    if not ambiguous.any():
        return []
    graph = coo_array((np.ones(len(start)), (start, end)), shape=(n, n))
    component = connected_components(graph, directed=False)[1][start]
    members = np.flatnonzero(np.isin(component, component[ambiguous]))
    members = members[np.argsort(component[members], kind="stable")]
    return np.split(members, np.flatnonzero(np.diff(component[members])) + 1)


def _match_across_gaps(
    mesh: PreparedMesh, vertex: int, before: IntArray, after: IntArray
) -> tuple[IntArray, FloatArray]:
    """Match arriving to departing half-edges at a vertex with several fans of faces; also return the gap angles.

    Half-edges are given by their other ends. Seen along the normal, each continues with the next one counter-clockwise:
    the assignment with the least sum of gap angles.
    """
    normal = area_vectors(mesh.vertices, mesh.faces[mesh.adjacency.faces.row(vertex)]).sum(axis=0)
    x, y, _ = plane_axes(normal if normal.any() else np.array([0.0, 0.0, 1.0]))

    def bearings(ids: IntArray) -> FloatArray:
        directions = mesh.vertices[ids] - mesh.vertices[vertex]
        return np.asarray(np.arctan2(directions @ y, directions @ x), dtype=np.float64)

    angles = (bearings(after) - bearings(before)[:, np.newaxis]) % (2.0 * pi)
    row, column = linear_sum_assignment(angles)
    return column.astype(np.int32), angles[row, column]


@dataclass(frozen=True)
class HoleChoice:
    """Conditions on the holes to fill, combined by "and"; InvalidParameterError if a value is out of range."""

    max_edges: int | None = None
    max_perimeter: float | None = None  # a length
    max_diameter: float | None = None  # a length
    holes: Sequence[int] | None = None  # numbers of the holes in the order of the result
    selected: BoolArray | None = None  # (n,): a hole must have one of these vertices on its rim
    bolt_holes: bool = False  # whether circles in open sheets count as holes; any in `holes` or selected do
    outer_rims: bool = False  # whether outer rims of open sheets count as holes; any listed in `holes` do

    def __post_init__(self) -> None:
        edges = self.max_edges
        if edges is not None and not (is_integer(edges) and edges >= 3):
            raise InvalidParameterError(f"max_edges: got {edges!r}, expected an integer of 3 or more, or None")
        for name, length in (("max_perimeter", self.max_perimeter), ("max_diameter", self.max_diameter)):
            if length is not None and not (is_real(length) and length > 0.0):
                raise InvalidParameterError(f"{name}: got {length!r}, expected a positive length, or None")

    def check(self, vertex_count: int, hole_count: int) -> None:
        """Raise an InvalidParameterError if `selected` or `holes` do not fit the mesh."""
        if self.selected is not None:
            check_selection(self.selected, vertex_count)
        if not isinstance(self.holes, Sequence | NoneType) and np.ndim(self.holes) != 1:
            raise InvalidParameterError(f"holes: got {brief_repr(self.holes)}, expected a list of numbers, or None")
        for k in () if self.holes is None else self.holes:
            if not (is_integer(k) and 0 <= k < hole_count):
                raise InvalidParameterError(
                    f"holes: got {k!r}, expected numbers from 0 to {hole_count - 1}, for {hole_count} holes and rims; "
                    "the report of a call with holes=[] lists them"
                )

    def refusal(self, number: int, hole: Hole) -> str:
        """Reason not to fill a hole; empty if it is to be filled."""
        if hole.obstacle:
            return hole.obstacle
        if self.holes is not None and number not in self.holes:
            return "not among the holes that were asked for"
        if hole.is_outer_rim and not self.outer_rims and self.holes is None:
            return "the outer rim of an open sheet; outer_rims=True fills it, too"
        if hole.is_circle and not self.bolt_holes and self.holes is None and self.selected is None:
            return "a circle in an open sheet, as of a bolt hole; bolt_holes=True fills it, too"
        if self.max_edges is not None and hole.edge_count > self.max_edges:
            return f"{hole.edge_count} edges, more than max_edges={self.max_edges}"
        if self.max_perimeter is not None and hole.perimeter > self.max_perimeter:
            return "its perimeter is more than max_perimeter"
        if self.max_diameter is not None and hole.diameter > self.max_diameter:
            return "its diameter is more than max_diameter"
        if self.selected is not None and not self.selected[hole.rim].any():
            return "no vertex of its rim is selected"
        return ""
