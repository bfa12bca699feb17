"""Holes of a mesh: which border loops there are, which of them are holes, and which islands lie in them."""

from dataclasses import dataclass, replace
from math import pi

import numpy as np
from scipy.optimize import linear_sum_assignment

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.holes.loop_geometry import area_vector, diameter, edge_lengths, enclosed, plane_axes
from bezier_filters.meshes.adjacency import Adjacency
from bezier_filters.meshes.half_edges import border_half_edges
from bezier_filters.meshes.mesh import TriangleMesh

RIM_TURNING = pi
"""A loop that turns towards its surface by more than this is an outer rim: half-way from a tube to a flat disk."""
ISLAND_HEIGHT = 0.25
"""Times the diameter of a hole: how far from its plane an island may lie."""


@dataclass(frozen=True)
class Hole:
    """A hole of a mesh, or the outer rim of an open sheet.

    Attributes
    ----------
    loops : tuple of (k,) int32
        Vertices of its rim, and of the rims of the islands in it, each in the direction in which faces that fill
        the hole run: counter-clockwise around the hole seen from outside, clockwise around islands.
    turning : float
        Total geodesic curvature of the rim as its surface sees it, in radians: near -2 pi around a hole in a
        flat surface, 0 at the end of a tube, 2 pi around a flat sheet (Gauss-Bonnet).
    perimeter : float
        Length of all loops.
    diameter : float
        Largest distance between two vertices of the rim, a length.
    """

    loops: tuple[IntArray, ...]
    turning: float
    perimeter: float
    diameter: float

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
        return sum(len(loop) for loop in self.loops)


def find_holes(mesh: TriangleMesh, adjacency: Adjacency) -> list[Hole]:
    """All holes and outer rims, ordered by the smallest vertex of their rim.

    Where several holes meet at a vertex, each goes on with the next edge around the vertex across the gap. A sheet
    within a hole, near its plane and with the same side up, is an island of that hole; its rim is not listed by
    itself. If it touches the rim at a vertex, both are one loop, which passes that vertex twice.

    Raises
    ------
    InvalidMeshError
        If an edge at a hole has more than two faces, or two faces that run through it the same way.

    Examples
    --------
    >>> from bezier_filters.meshes.adjacency import vertex_adjacency
    >>> from bezier_filters.surfaces import punched_patch
    >>> from bezier_filters.meshes.mesh import triangle_mesh
    >>> sheet = punched_patch()
    >>> mesh = triangle_mesh(sheet.vertices, sheet.faces)
    >>> [hole.is_outer_rim for hole in find_holes(mesh, vertex_adjacency(mesh))]
    [True, False, False, False]
    """
    holes = []
    for loop, gaps in _loops_around_gaps(mesh, adjacency):
        turning = float((gaps - pi).sum())
        # Sheets that touch at a vertex share the outside around them, but each has a rim of its own.
        parts = simple_loops(loop) if turning > RIM_TURNING else [loop]
        for part in parts:
            rim = mesh.vertices[part]
            holes.append(Hole((part[::-1].copy(),), turning, float(edge_lengths(rim).sum()), diameter(rim)))
    holes.sort(key=lambda hole: int(hole.rim.min()))
    return _with_islands(mesh, holes)


def simple_loops(loop: IntArray) -> list[IntArray]:
    """Cut a closed loop at the vertices that it passes more than once.

    Examples
    --------
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


def _loops_around_gaps(mesh: TriangleMesh, adjacency: Adjacency) -> list[tuple[IntArray, FloatArray]]:
    """Loops of border half-edges, as their faces run, and the angle of the gap at each of their vertices, (k,)."""
    start, end = border_half_edges(mesh, adjacency.on_boundary)
    if len(start) == 0:
        return []
    order = np.argsort(start, kind="stable")
    start, end = start[order], end[order]
    first, last = np.searchsorted(start, end), np.searchsorted(start, end, side="right")
    successor = first.astype(np.int32)
    gaps = 2.0 * pi - angle_sums(mesh, adjacency, end)  # at the end of each half-edge
    for vertex in np.unique(end[last - first > 1]):
        arriving, leaving = np.flatnonzero(end == vertex), np.flatnonzero(start == vertex)
        following, angles = _across_gaps(mesh, adjacency, vertex, start[arriving], end[leaving])
        successor[arriving], gaps[arriving] = leaving[following], angles
    result = []
    seen = np.zeros(len(start), dtype=np.bool_)
    for k in range(len(start)):
        path: list[int] = []
        half_edge = k
        while not seen[half_edge]:
            seen[half_edge] = True
            path.append(half_edge)
            half_edge = int(successor[half_edge])
        if path:
            result.append((end[path], gaps[path]))
    return result


def _across_gaps(
    mesh: TriangleMesh, adjacency: Adjacency, vertex: int, before: IntArray, after: IntArray
) -> tuple[IntArray, FloatArray]:
    """Which half-edge goes on after each one that arrives at a vertex of several fans of faces, and the gap between.

    Half-edges are given by their other ends. Seen along the normal, each goes on with the next, counter-clockwise.
    """
    a, b, c = (mesh.vertices[mesh.faces[adjacency.faces.row(vertex), k]] for k in range(3))
    normal = np.cross(b - a, c - a).sum(axis=0)
    x, y, _ = plane_axes(normal if normal.any() else np.array([0.0, 0.0, 1.0]))

    def bearings(ids: IntArray) -> FloatArray:
        directions = mesh.vertices[ids] - mesh.vertices[vertex]
        return np.asarray(np.arctan2(directions @ y, directions @ x), dtype=np.float64)

    angles = (bearings(after) - bearings(before)[:, np.newaxis]) % (2.0 * pi)
    row, column = linear_sum_assignment(angles)
    return column.astype(np.int32), angles[row, column]


def angle_sums(mesh: TriangleMesh, adjacency: Adjacency, ids: IntArray) -> FloatArray:
    """Sum of the angles of all faces at some vertices, in radians."""
    rows = [adjacency.faces.row(i) for i in ids]
    faces = mesh.faces[np.concatenate(rows)]
    owner = np.repeat(np.arange(len(ids)), [len(row) for row in rows])
    corner = np.argmax(faces == ids[owner, np.newaxis], axis=1)
    tip, left, right = (mesh.vertices[faces[np.arange(len(faces)), (corner + k) % 3]] for k in range(3))
    sine = np.linalg.norm(np.cross(left - tip, right - tip), axis=1)
    angles = np.arctan2(sine, np.einsum("ij,ij->i", left - tip, right - tip))
    return np.bincount(owner, weights=angles, minlength=len(ids)).astype(np.float64)


def _with_islands(mesh: TriangleMesh, holes: list[Hole]) -> list[Hole]:
    """Move the outer rims that lie in a hole to the smallest such hole."""
    result = dict(enumerate(holes))
    for k, sheet in enumerate(holes):
        if not sheet.is_outer_rim:
            continue
        around = [j for j, hole in enumerate(holes) if not hole.is_outer_rim and _lies_in(mesh, sheet, hole)]
        if around:
            j = min(around, key=lambda j: holes[j].diameter)
            hole = result[j]
            result[j] = replace(hole, loops=hole.loops + sheet.loops, perimeter=hole.perimeter + sheet.perimeter)
            del result[k]
    return list(result.values())


def _lies_in(mesh: TriangleMesh, sheet: Hole, hole: Hole) -> bool:
    """Whether an outer rim is that of an island in a hole."""
    rim, points = mesh.vertices[hole.rim], mesh.vertices[sheet.rim]
    low, high = rim.min(axis=0), rim.max(axis=0)
    margin = ISLAND_HEIGHT * hole.diameter
    if sheet.diameter >= hole.diameter or not ((points > low - margin) & (points < high + margin)).all():
        return False
    normal = area_vector(rim)
    if not normal.any() or normal @ area_vector(points) >= 0.0:
        return False
    axes = plane_axes(normal)
    local = (points - rim.mean(axis=0)) @ axes.T
    near = np.abs(local[:, 2]) <= margin
    return bool((near & enclosed(local[:, :2], (rim - rim.mean(axis=0)) @ axes[:2].T)).all())
