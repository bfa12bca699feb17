"""Renumbers a mesh for memory locality.

Vertices of scans and of subdivided meshes come in any order. Then nearly every access to a neighbour
misses the cache, and fits mostly wait for memory. Here vertices are sorted by the cells of a grid,
in the order of the Morton curve through the cells (Morton 1966).
"""

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import reverse_cuthill_mckee

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.meshes.adjacency import Adjacency
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.meshes.prepared_mesh import PreparedMesh
from bezier_filters.runtime.jit import inner_jit, jit
from bezier_filters.runtime.parallel import run_kernel

VERTICES_PER_CELL = 32  # vertices of a closed surface in a cell of the grid, roughly
MIN_REORDER_VERTICES = 1 << 16  # vertices; the data of smaller meshes fit into a cache in any order
# a jump is a distance in memory, in vertices, between the last neighbours of consecutive vertices, beyond this length;
# and the largest share of jumps of a mesh with locality
JUMP_LENGTH, MAX_JUMP_FRACTION = 256, 0.05
MAX_GRID_BITS = 8  # bits of the cell number along an axis


Values = TypeVar("Values", FloatArray, BoolArray)


@dataclass(frozen=True)
class Grid:
    """The grid of cubes around a mesh."""

    low: FloatArray  # (3,): its lowest corner
    scale: float  # cells per length; 0 if all vertices lie in one cell
    bits: int  # bits of the cell number along an axis

    @property
    def cell_count(self) -> int:
        """Number of cells."""
        return 1 << 3 * self.bits

    def cells(self, vertices: FloatArray) -> IntArray:
        """Cell numbers along the Morton curve of vertices (n, 3), (n,) int32."""
        result = np.empty(len(vertices), dtype=np.int32)
        run_kernel(_find_cells, len(vertices), vertices, self.low, self.scale, self.bits, result)
        return result


def grid_around(low: FloatArray, high: FloatArray, vertex_count: int) -> Grid:
    """The grid for a number of vertices between two corners (3,)."""
    bits = int(np.clip(np.log2(max(vertex_count / VERTICES_PER_CELL, 1.0)) / 2.0, 1, MAX_GRID_BITS))
    size = max(float(high[k]) - float(low[k]) for k in range(3))
    return Grid(low, (1 << bits) / size if 0.0 < size < np.inf else 0.0, bits)


@dataclass(frozen=True)
class SpatialOrder:
    """A renumbered mesh, with the permutation of its vertices."""

    mesh: TriangleMesh  # the renumbered mesh
    order: IntArray  # (n,): its vertex i was vertex order[i]

    def restore_order(self, values: Values) -> Values:
        """Values (n, ...) of the renumbered vertices in the original order."""
        result = np.empty_like(values)
        result[self.order] = values
        return result


def identity_order(mesh: TriangleMesh) -> SpatialOrder:
    """A mesh in its own order, with the identity permutation."""
    return SpatialOrder(mesh, np.arange(mesh.vertex_count, dtype=np.int32))


def has_locality(adjacency: Adjacency) -> bool:
    """Whether a mesh is small, or neighbours of consecutive vertices are mostly close in memory.

    Rows of vertices, as scanners write them, are as good as the Cuthill-McKee order. Octree and subdivision orders are
    not.
    """
    rows = adjacency.vertices
    return len(rows) < MIN_REORDER_VERTICES or _count_jumps(rows.indptr, rows.indices) <= MAX_JUMP_FRACTION * len(rows)


@jit()
def _count_jumps(indptr: IntArray, indices: IntArray) -> int:
    """Count consecutive vertices whose last neighbours are far apart; vertices without neighbours are skipped."""
    count, before = 0, -1
    for i in range(indptr.shape[0] - 1):
        if indptr[i + 1] > indptr[i]:
            last = indices[indptr[i + 1] - 1]
            count += before >= 0 and abs(last - before) > JUMP_LENGTH
            before = last
    return count


def ensure_locality(mesh: PreparedMesh) -> SpatialOrder:
    """The mesh in its own order if it has locality, else in `cuthill_mckee_order`."""
    return identity_order(mesh) if has_locality(mesh.adjacency) else cuthill_mckee_order(mesh)


def cuthill_mckee_order(mesh: PreparedMesh) -> SpatialOrder:
    """The mesh in the reverse Cuthill-McKee order (Cuthill and McKee 1969), level by level.

    For repeated means over neighbours it is faster than the Morton order: levels are read sequentially.
    """
    n, rows = mesh.vertex_count, mesh.adjacency.vertices
    graph = csr_array((np.ones(len(rows.indices), dtype=np.int8), rows.indices, rows.indptr), shape=(n, n))
    order = reverse_cuthill_mckee(graph, symmetric_mode=True).astype(np.int32)
    rank = np.empty(n, dtype=np.int32)
    rank[order] = np.arange(n, dtype=np.int32)
    faces = rank[mesh.faces]
    return SpatialOrder(TriangleMesh(mesh.vertices[order], faces[np.argsort(faces[:, 0], kind="stable")]), order)


def sort_spatially(mesh: TriangleMesh) -> SpatialOrder:
    """Sort vertices, and faces by their first corners, by cells along the Morton curve.

    Vertices of one cell keep their order.
    """
    n, m = mesh.vertex_count, mesh.face_count
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    widen_bounds(mesh.vertices, low, high)
    grid = grid_around(low, high, n)
    # separate allocations: only the order outlives this function
    order, rank = np.empty(n, dtype=np.int32), np.empty(n, dtype=np.int32)
    cells = grid.cells(mesh.vertices)
    ends = np.zeros(grid.cell_count + 1, dtype=np.int32)
    sort_by_cell(cells, ends, order)
    vertices, faces = np.empty_like(mesh.vertices), np.empty_like(mesh.faces)
    run_kernel(_move_vertices, n, mesh.vertices, order, rank, vertices)
    ends[:] = 0
    face_order = np.empty(m, dtype=np.int32)
    sort_by_cell(cells[mesh.faces[:, 0]], ends, face_order)
    run_kernel(_move_faces, m, mesh.faces, face_order, rank, faces)
    return SpatialOrder(TriangleMesh(vertices, faces), order)


@jit()
def widen_bounds(vertices: FloatArray, low: FloatArray, high: FloatArray) -> None:
    """Extend bounds of the coordinates to all vertices."""
    for i in range(vertices.shape[0]):
        for k in range(3):
            low[k], high[k] = min(low[k], vertices[i, k]), max(high[k], vertices[i, k])


@jit()
def _find_cells(
    vertices: FloatArray, low: FloatArray, scale: float, bits: int, cells: IntArray, start: int, stop: int
) -> None:
    """Write the cells of vertices start .. stop-1, numbered along the Morton curve."""
    last = (1 << bits) - 1
    for i in range(start, stop):
        cell = 0
        for k in range(3):
            step = (vertices[i, k] - low[k]) * scale
            cell |= _spread_bits(int(step) if step < last else last) << k
        cells[i] = cell


@inner_jit()
def _spread_bits(x: int) -> int:
    """Insert two zeros after each of the lowest eight bits."""
    x = (x | x << 8) & 0x00F00F
    x = (x | x << 4) & 0x0C30C3
    return (x | x << 2) & 0x249249


@jit()
def sort_by_cell(cells: IntArray, ends: IntArray, order: IntArray) -> None:
    """Write the indices of all items in the order of their cells (counting sort); `ends` is zeroed work space."""
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
    """Write vertices start .. stop-1 of the new order, and the rank of each old vertex."""
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
