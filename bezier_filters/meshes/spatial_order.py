"""Renumbers a mesh so that what lies close together in space does so in memory.

Vertices of scans, and of subdivided meshes, come in any order. Then nearly every look at a neighbour
waits for memory, which takes most of the time of a fit. Here they are sorted by the cells of a grid
that surround them, along a Z-shaped curve through the cells (Morton 1966).
"""

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import reverse_cuthill_mckee

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.meshes.adjacency import Adjacency
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.runtime.jit import inner_jit, jit
from bezier_filters.runtime.parallel import run_kernel

PER_CELL = 32  # vertices of a closed surface in a cell of the grid, roughly
LARGE = 1 << 16  # vertices: what is known of those of smaller meshes fits into a cache, in any order
JUMP, MOST_JUMPS = 256, 0.05  # from the last neighbour of a vertex to that of the next, and share of longer ones
MOST_BITS = 8  # of the number of cells along an axis


Values = TypeVar("Values", FloatArray, BoolArray)


@dataclass(frozen=True)
class Grid:
    """The grid of cubes around a mesh."""

    low: FloatArray  # (3,): its lowest corner
    scale: float  # cells per length; 0 if all vertices lie in one
    bits: int  # of the number of cells along an axis

    @property
    def cell_count(self) -> int:
        """Number of cells."""
        return 1 << 3 * self.bits

    def cells(self, vertices: FloatArray) -> IntArray:
        """Numbers of the cells along the curve that vertices (n, 3) lie in, (n,) int32."""
        result = np.empty(len(vertices), dtype=np.int32)
        run_kernel(_find_cells, len(vertices), vertices, self.low, self.scale, self.bits, result)
        return result


def grid_around(low: FloatArray, high: FloatArray, vertex_count: int) -> Grid:
    """The grid for a number of vertices between two corners (3,)."""
    bits = int(np.clip(np.log2(max(vertex_count / PER_CELL, 1.0)) / 2.0, 1, MOST_BITS))
    size = max(float(high[k]) - float(low[k]) for k in range(3))
    return Grid(low, (1 << bits) / size if 0.0 < size < np.inf else 0.0, bits)


@dataclass(frozen=True)
class SpatialOrder:
    """A mesh in spatial order, and where its vertices came from."""

    mesh: TriangleMesh  # the renumbered mesh
    order: IntArray  # (n,): vertex i of it was vertex order[i]

    def back(self, values: Values) -> Values:
        """Values (n, ...) of the renumbered vertices, as the vertices were numbered before."""
        result = np.empty_like(values)
        result[self.order] = values
        return result


def as_it_is(mesh: TriangleMesh) -> SpatialOrder:
    """A mesh in its own order."""
    return SpatialOrder(mesh, np.arange(mesh.vertex_count, dtype=np.int32))


def is_in_turn(adjacency: Adjacency) -> bool:
    """Whether a mesh is small, or neighbours of successive vertices are seldom far apart.

    Vertices row by row, as scanners write them, are as good as an order by levels. Those of octrees and of subdivision
    are not.
    """
    rows = adjacency.vertices
    return len(rows) < LARGE or _count_jumps(rows.indptr, rows.indices) <= MOST_JUMPS * len(rows)


@jit()
def _count_jumps(indptr: IntArray, indices: IntArray) -> int:
    """How many last neighbours of vertices are far from those of the vertices before; some have none."""
    count, before = 0, -1
    for i in range(indptr.shape[0] - 1):
        if indptr[i + 1] > indptr[i]:
            last = indices[indptr[i + 1] - 1]
            count += before >= 0 and abs(last - before) > JUMP
            before = last
    return count


def read_in_turn(mesh: TriangleMesh, adjacency: Adjacency) -> SpatialOrder:
    """The mesh as it is, if that is in turn, or `by_levels`."""
    return as_it_is(mesh) if is_in_turn(adjacency) else by_levels(mesh, adjacency)


def by_levels(mesh: TriangleMesh, adjacency: Adjacency) -> SpatialOrder:
    """The mesh level by level from an end (Cuthill and McKee 1969).

    For means over neighbours, again and again, that suits better than cells: levels are read in turn.
    """
    n, rows = mesh.vertex_count, adjacency.vertices
    graph = csr_array((np.ones(len(rows.indices), dtype=np.int8), rows.indices, rows.indptr), shape=(n, n))
    order = reverse_cuthill_mckee(graph, symmetric_mode=True).astype(np.int32)
    rank = np.empty(n, dtype=np.int32)
    rank[order] = np.arange(n, dtype=np.int32)
    faces = rank[mesh.faces]
    return SpatialOrder(TriangleMesh(mesh.vertices[order], faces[np.argsort(faces[:, 0], kind="stable")]), order)


def in_spatial_order(mesh: TriangleMesh) -> SpatialOrder:
    """Renumber vertices, and sort faces alike.

    Vertices of one cell keep their order.
    """
    n, m = mesh.vertex_count, mesh.face_count
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    widen_bounds(mesh.vertices, low, high)
    grid = grid_around(low, high, n)
    order, rank = np.empty(n, dtype=np.int32), np.empty(n, dtype=np.int32)  # not one block: only the order is kept
    cells = grid.cells(mesh.vertices)
    ends = np.zeros(grid.cell_count + 1, dtype=np.int32)
    _sort_by_cell(cells, ends, order)
    vertices, faces = np.empty_like(mesh.vertices), np.empty_like(mesh.faces)
    run_kernel(_move_vertices, n, mesh.vertices, order, rank, vertices)
    ends[:] = 0
    face_order = np.empty(m, dtype=np.int32)
    _sort_by_cell(cells[mesh.faces[:, 0]], ends, face_order)
    run_kernel(_move_faces, m, mesh.faces, face_order, rank, faces)
    return SpatialOrder(TriangleMesh(vertices, faces), order)


@jit()
def widen_bounds(vertices: FloatArray, low: FloatArray, high: FloatArray) -> None:
    """Lower and raise bounds of the coordinates, so that they hold for all vertices."""
    for i in range(vertices.shape[0]):
        for k in range(3):
            low[k], high[k] = min(low[k], vertices[i, k]), max(high[k], vertices[i, k])


@jit()
def _find_cells(
    vertices: FloatArray, low: FloatArray, scale: float, bits: int, cells: IntArray, start: int, stop: int
) -> None:
    """Cells of vertices start .. stop-1, numbered along the curve."""
    last = (1 << bits) - 1
    for i in range(start, stop):
        cell = 0
        for k in range(3):
            step = (vertices[i, k] - low[k]) * scale
            cell |= _spread_bits(int(step) if step < last else last) << k
        cells[i] = cell


@inner_jit()
def _spread_bits(x: int) -> int:
    """Two zeros after each of the lowest eight bits."""
    x = (x | x << 8) & 0x00F00F
    x = (x | x << 4) & 0x0C30C3
    return (x | x << 2) & 0x249249


@jit()
def _sort_by_cell(cells: IntArray, ends: IntArray, order: IntArray) -> None:
    """Write the numbers of all items in the order of their cells; `ends` is work space of zeros."""
    for i in range(cells.shape[0]):
        ends[cells[i] + 1] += 1
    for k in range(1, ends.shape[0]):
        ends[k] += ends[k - 1]
    for i in range(cells.shape[0]):
        cell = cells[i]
        order[ends[cell]] = i
        ends[cell] += 1


@jit()
def _move_vertices(
    old: FloatArray, order: IntArray, rank: IntArray, vertices: FloatArray, start: int, stop: int
) -> None:
    """Write vertices start .. stop-1 of the new order, and the new numbers of the old ones."""
    for i in range(start, stop):
        j = order[i]
        rank[j] = i
        vertices[i, 0], vertices[i, 1], vertices[i, 2] = old[j, 0], old[j, 1], old[j, 2]


@jit()
def _move_faces(old: IntArray, order: IntArray, rank: IntArray, faces: IntArray, start: int, stop: int) -> None:
    """Write faces start .. stop-1 of the new order with the new numbers of their vertices."""
    for f in range(start, stop):
        g = order[f]
        faces[f, 0], faces[f, 1], faces[f, 2] = rank[old[g, 0]], rank[old[g, 1]], rank[old[g, 2]]
