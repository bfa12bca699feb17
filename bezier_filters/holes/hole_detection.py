"""Holes of a mesh: which border loops are holes, which islands lie in them, and which of them are to be filled."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import pi
from types import NoneType

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from bezier_filters.arguments import in_short
from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.errors import InvalidParameterError, is_integer, is_real
from bezier_filters.holes.loops import angle_sums, diameter, enclosed, plane_axes, vector_area
from bezier_filters.meshes.adjacency import Adjacency
from bezier_filters.meshes.half_edges import BorderEdges, border_edges, cycles, doubled_edges
from bezier_filters.meshes.mesh import TriangleMesh, checked_selection
from bezier_filters.meshes.self_intersections import faces_in_boxes
from bezier_filters.meshes.triangles import area_vectors

# a loop that turns towards its surface by more than this is an outer rim: half-way from a tube to a flat disk
RIM_TURNING = pi
WELD = "it has no width; weld them first (repair=True of the filter, or meshing_merge_close_vertices)"
ORIENT = "repair them first (repair=True of the filter, or pymeshlab's meshing_repair filters)"
ISLAND_HEIGHT = 0.25  # times the diameter of a hole: how far from its plane an island may lie


@dataclass(frozen=True)
class Hole:
    """A hole of a mesh, or the outer rim of an open sheet."""

    # each (k,): vertices of its rim, and of the rims of the islands in it, each in the direction in which faces that
    # fill the hole run: counter-clockwise around the hole seen from outside, clockwise around islands
    loops: tuple[IntArray, ...]
    # total geodesic curvature of the rim as its surface sees it, in radians: near -2 pi around a hole in a flat
    # surface, 0 at the end of a tube, 2 pi around a flat sheet (Gauss-Bonnet)
    turning: float
    perimeter: float  # of all loops
    diameter: float  # largest distance between two vertices of the rim, a length
    obstacle: str = ""  # why nobody can fill it
    unclear_edges: int = 0  # of a border whose order is unclear: its only "loop" just lists its vertices

    @property
    def rim(self) -> IntArray:
        """Vertices of the rim, (k,)."""
        return self.loops[0]

    @property
    def is_outer_rim(self) -> bool:
        """Whether this is where an open sheet ends."""
        return self.turning > RIM_TURNING

    @property
    def edge_count(self) -> int:
        """Number of edges of all loops."""
        return self.unclear_edges or sum(len(loop) for loop in self.loops)


def find_holes(mesh: TriangleMesh, adjacency: Adjacency) -> list[Hole]:
    """All holes and outer rims, ordered by the smallest vertex of their rim.

    Where several holes meet at a vertex, each goes on with the next edge around the vertex across the gap. A sheet
    within a hole, near its plane and with the same side up, is an island of that hole; its rim is not listed by
    itself. If it touches the rim at a vertex, both are one loop, which passes that vertex twice. A border that meets an
    edge with more than two faces, or with two that run through it the same way, has an obstacle; so has one that
    lies on another border.
    """
    holes = []
    border = border_edges(mesh, adjacency.on_boundary)
    n, doubled = mesh.vertex_count, doubled_edges(mesh, border)
    cracks = np.sort((border.start * np.int64(n) + border.end)[doubled])
    loops, rest = _loops_around_gaps(mesh, adjacency, border)
    for loop, gaps in loops:
        turning = float((gaps - pi).sum())
        # Sheets that touch at a vertex share the outside around them, but each has a rim of its own.
        parts = simple_loops(loop) if turning > RIM_TURNING else [loop]
        for part in parts:
            points = mesh.vertices[part]
            count = _count_listed(part * np.int64(n) + np.roll(part, -1), cracks)
            obstacle = f"{count} of its {len(part)} edges lie on those of another border: {WELD}" if count else ""
            length = float(np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1).sum())
            holes.append(Hole((part[::-1].copy(),), turning, length, diameter(points), obstacle))
    for start, end in rest:
        length = np.linalg.norm(mesh.vertices[end] - mesh.vertices[start], axis=1).sum()
        where = end[border.unclear[end]][0]
        obstacle = f"meets edges of several faces, or of faces that disagree, at vertex {where}: {ORIENT}"
        rim = np.union1d(start, end)
        holes.append(Hole((rim,), 0.0, float(length), diameter(mesh.vertices[rim]), obstacle, len(start)))
    holes.sort(key=lambda hole: int(hole.rim.min()))
    return _with_islands(mesh, holes)


def _count_listed(keys: IntArray, listed: IntArray) -> int:
    """Number of keys that are among sorted ones."""
    return int((np.searchsorted(listed, keys, side="right") - np.searchsorted(listed, keys)).sum())


def simple_loops(loop: IntArray) -> list[IntArray]:
    """Cut a closed loop at the vertices that it passes more than once.

    >>> [part.tolist() for part in simple_loops(np.array([0, 1, 2, 0, 3, 4], dtype=np.int32))]
    [[0, 1, 2], [0, 3, 4]]
    """
    parts: list[IntArray] = []
    path: list[int] = []
    place: dict[int, int] = {}
    for vertex in [*loop.tolist(), int(loop[0])]:
        if vertex in place:
            begin = place[vertex]
            parts.append(np.array(path[begin:], dtype=np.int32))
            for left in path[begin:]:
                del place[left]
            del path[begin:]
        place[vertex] = len(path)
        path.append(vertex)
    return [part for part in parts if len(part) > 2]


def _loops_around_gaps(
    mesh: TriangleMesh, adjacency: Adjacency, border: BorderEdges
) -> tuple[list[tuple[IntArray, FloatArray]], list[tuple[IntArray, IntArray]]]:
    """Loops of border half-edges, as their faces run, and the angle of the gap at each of their vertices, (k,).

    What is connected with a vertex where it is unclear how a border goes on comes apart: starts and ends of its edges.
    """
    order = np.argsort(border.start, kind="stable")
    start, end = border.start[order], border.end[order]
    first, last = np.searchsorted(start, end), np.searchsorted(start, end, side="right")
    arrivals = np.bincount(end, minlength=mesh.vertex_count)[end]
    stuck = border.unclear[end] & ((last - first != 1) | (arrivals != 1))
    if ((last - first != arrivals) & ~stuck).any():
        raise InvalidParameterError("on_border: got other vertices than those on the edges of one face only")
    parts = _connected_with(stuck, start, end, mesh.vertex_count)
    unclear = np.zeros(len(start), dtype=np.bool_)
    unclear[np.concatenate([*parts, np.empty(0, dtype=np.int64)])] = True
    rest = [(start[part], end[part]) for part in parts]
    successor = np.where(unclear, np.arange(len(start)), first).astype(np.int32)
    around = mesh.faces[np.unique(adjacency.faces.of(end))]
    gaps = 2.0 * pi - angle_sums(mesh.vertices, around, mesh.vertex_count)[end]  # at the end of each half-edge
    by_end = np.argsort(end, kind="stable")
    for vertex in np.unique(end[(last - first > 1) & ~unclear]):
        arriving = by_end[slice(*np.searchsorted(end, [vertex, vertex + 1], sorter=by_end))]
        leaving = np.arange(*np.searchsorted(start, [vertex, vertex + 1]))
        following, angles = _across_gaps(mesh, adjacency, vertex, start[arriving], end[leaving])
        successor[arriving], gaps[arriving] = leaving[following], angles
    return [(end[loop], gaps[loop]) for loop in cycles(successor, np.flatnonzero(~unclear).astype(np.int32))], rest


def _connected_with(stuck: BoolArray, start: IntArray, end: IntArray, n: int) -> list[IntArray]:
    """Numbers of the half-edges of every connected part of the border that has a stuck one."""
    if not stuck.any():
        return []
    graph = coo_array((np.ones(len(start)), (start, end)), shape=(n, n))
    part = connected_components(graph, directed=False)[1][start]
    members = np.flatnonzero(np.isin(part, part[stuck]))
    members = members[np.argsort(part[members], kind="stable")]
    return np.split(members, np.flatnonzero(np.diff(part[members])) + 1)


def _across_gaps(
    mesh: TriangleMesh, adjacency: Adjacency, vertex: int, before: IntArray, after: IntArray
) -> tuple[IntArray, FloatArray]:
    """Which half-edge goes on after each one that arrives at a vertex of several fans of faces, and the gap between.

    Half-edges are given by their other ends. Seen along the normal, each goes on with the next, counter-clockwise.
    """
    normal = area_vectors(mesh.vertices, mesh.faces[adjacency.faces.row(vertex)]).sum(axis=0)
    x, y, _ = plane_axes(normal if normal.any() else np.array([0.0, 0.0, 1.0]))

    def bearings(ids: IntArray) -> FloatArray:
        directions = mesh.vertices[ids] - mesh.vertices[vertex]
        return np.asarray(np.arctan2(directions @ y, directions @ x), dtype=np.float64)

    angles = (bearings(after) - bearings(before)[:, np.newaxis]) % (2.0 * pi)
    row, column = linear_sum_assignment(angles)
    return column.astype(np.int32), angles[row, column]


def _with_islands(mesh: TriangleMesh, holes: list[Hole]) -> list[Hole]:
    """Move the outer rims that lie in a hole to the smallest such hole."""
    around = [j for j, hole in enumerate(holes) if not (hole.is_outer_rim or hole.obstacle)]
    sheets = [k for k, hole in enumerate(holes) if hole.is_outer_rim and not hole.obstacle]
    if not around or not sheets:
        return holes
    boxes = [_box_around(mesh, holes[j]) for j in around]
    # An outer rim is near a hole only if its first vertex is.
    firsts = np.array([mesh.vertices[holes[k].rim[0]] for k in sheets])
    corners = np.arange(len(sheets), dtype=np.int32)[:, np.newaxis].repeat(3, axis=1)
    near = faces_in_boxes(firsts, corners, np.array([box[0] for box in boxes]), np.array([box[1] for box in boxes]))
    smallest: dict[int, int] = {}  # the first of the smallest holes that an outer rim lies in
    for place in sorted(range(len(around)), key=lambda place: holes[around[place]].diameter):
        hole = holes[around[place]]
        for sheet in near.row(place).tolist():
            if sheet not in smallest and _lies_in(mesh, holes[sheets[sheet]], hole):
                smallest[sheet] = around[place]
    islands: dict[int, list[Hole]] = {}
    for sheet in sorted(smallest):
        islands.setdefault(smallest[sheet], []).append(holes[sheets[sheet]])
    moved = {sheets[sheet] for sheet in smallest}
    return [_with_loops(hole, islands.get(k, [])) for k, hole in enumerate(holes) if k not in moved]


def _with_loops(hole: Hole, islands: list[Hole]) -> Hole:
    """A hole with the rims of its islands."""
    loops = sum((island.loops for island in islands), ())
    length = sum((island.perimeter for island in islands), hole.perimeter)
    return replace(hole, loops=hole.loops + loops, perimeter=length)


def _box_around(mesh: TriangleMesh, hole: Hole) -> tuple[FloatArray, FloatArray]:
    """Lowest and highest corner of the box that islands of a hole lie in, each (3,)."""
    rim, margin = mesh.vertices[hole.rim], ISLAND_HEIGHT * hole.diameter
    return rim.min(axis=0) - margin, rim.max(axis=0) + margin


def _lies_in(mesh: TriangleMesh, sheet: Hole, hole: Hole) -> bool:
    """Whether an outer rim is that of an island in a hole."""
    rim, points = mesh.vertices[hole.rim], mesh.vertices[sheet.rim]
    low, high = _box_around(mesh, hole)
    if sheet.diameter >= hole.diameter or not ((points > low) & (points < high)).all():
        return False
    normal = vector_area(rim)
    if not normal.any() or normal @ vector_area(points) >= 0.0:
        return False
    axes = plane_axes(normal)
    local = (points - rim.mean(axis=0)) @ axes.T
    near = np.abs(local[:, 2]) <= ISLAND_HEIGHT * hole.diameter
    return bool((near & enclosed(local[:, :2], (rim - rim.mean(axis=0)) @ axes[:2].T)).all())


@dataclass(frozen=True)
class HoleChoice:
    """Conditions on holes, all of which must hold; an InvalidParameterError if a value is out of range."""

    max_edges: int | None = None
    max_perimeter: float | None = None  # a length
    max_diameter: float | None = None  # a length
    holes: Sequence[int] | None = None  # numbers of the holes, as they are listed in the result
    selected: BoolArray | None = None  # (n,): vertices of the mesh, one of which a hole must have on its rim
    outer_rims: bool = False  # whether those of open sheets count as holes; those listed in `holes` always do

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
            checked_selection(self.selected, vertex_count)
        if not isinstance(self.holes, Sequence | NoneType) and np.ndim(self.holes) != 1:
            raise InvalidParameterError(f"holes: got {in_short(self.holes)}, expected a list of numbers, or None")
        for k in () if self.holes is None else self.holes:
            if not (is_integer(k) and 0 <= k < hole_count):
                raise InvalidParameterError(
                    f"holes: got {k!r}, expected numbers from 0 to {hole_count - 1}, for {hole_count} holes and rims; "
                    "the report of a call with holes=[] lists them"
                )

    def refusal(self, number: int, hole: Hole) -> str:
        """Why a hole is not filled; empty if it is."""
        if hole.obstacle:
            return hole.obstacle
        if self.holes is not None and number not in self.holes:
            return "not among the holes that were asked for"
        if hole.is_outer_rim and not self.outer_rims and self.holes is None:
            return "the outer rim of an open sheet; outer_rims=True fills it, too"
        if self.max_edges is not None and hole.edge_count > self.max_edges:
            return f"{hole.edge_count} edges, more than max_edges={self.max_edges}"
        if self.max_perimeter is not None and hole.perimeter > self.max_perimeter:
            return "its perimeter is more than max_perimeter"
        if self.max_diameter is not None and hole.diameter > self.max_diameter:
            return "its diameter is more than max_diameter"
        if self.selected is not None and not self.selected[hole.rim].any():
            return "no vertex of its rim is selected"
        return ""
