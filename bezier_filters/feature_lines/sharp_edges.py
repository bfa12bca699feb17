"""Edges of a mesh that are much sharper than those around them."""

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.meshes.adjacency import Adjacency, Rows
from bezier_filters.meshes.mesh_edges import MeshEdges
from bezier_filters.runtime.lean import lean_njit

DEVIATIONS = 4.0
"""Of the angles that noise makes: one edge in 16,000 is sharper by chance."""
TIMES_FLATTER = 12.6
"""The same where the noise is not known: of the edges around a sharp edge a quarter or more are either so many times
flatter, or sharp themselves as on coarse polyhedra."""


def find_sharp_edges(edges: MeshEdges, adjacency: Adjacency, angle: float, noise: float = 0.0) -> BoolArray:
    """Which edges (e,) bend by more than an angle, in radians, and much more than those around them.

    Independent errors of the vertices along the normal, of the standard deviation `noise`, change the angle at an edge
    of the width w by 4/3 noise / w (by propagation through two equal triangles); sharp edges bend by much more, too.

    Examples
    --------
    >>> from bezier_filters.meshes.adjacency import vertex_adjacency
    >>> from bezier_filters.meshes.mesh import triangle_mesh
    >>> from bezier_filters.meshes.mesh_edges import mesh_edges
    >>> from bezier_filters.surfaces import block_with_sharp_edges
    >>> block = triangle_mesh(*block_with_sharp_edges(resolution=8))
    >>> edges = mesh_edges(block)
    >>> sharp = find_sharp_edges(edges, vertex_adjacency(block), np.radians(40.0))
    >>> np.degrees(edges.angles[sharp]).round().min(), edges.angles[~sharp].max().round(6)
    (np.float64(90.0), np.float64(0.0))
    """
    result = np.zeros(len(edges.angles), dtype=np.bool_)
    limit = DEVIATIONS * 4.0 / 3.0 * noise
    candidates = np.flatnonzero((edges.angles > angle) & (edges.angles * edges.widths > limit)).astype(np.int32)
    if len(candidates):
        at_vertex = _edges_at_vertices(edges, len(adjacency.vertices))
        ring = adjacency.vertices
        ends, angles = edges.vertices, edges.angles
        _mark(ends, angles, candidates, at_vertex.indptr, at_vertex.indices, ring.indptr, ring.indices, angle, result)
    return result


def _edges_at_vertices(edges: MeshEdges, n: int) -> Rows:
    ends = edges.vertices.ravel()
    indptr = np.concatenate([[0], np.cumsum(np.bincount(ends, minlength=n))]).astype(np.int32)
    return Rows(indptr, (np.argsort(ends, kind="stable") // 2).astype(np.int32))


@lean_njit()
def _mark(
    ends: IntArray,
    angles: FloatArray,
    candidates: IntArray,
    edge_ptr: IntArray,
    edge_indices: IntArray,
    ring_ptr: IntArray,
    ring_indices: IntArray,
    least: float,
    result: BoolArray,
) -> None:
    """Mark those candidates beside which a quarter of the edges, or more, are much flatter or sharp."""
    for e in candidates:
        count, clear = 0, 0
        for side in range(2):
            i = ends[e, side]
            for q in range(ring_ptr[i], ring_ptr[i + 1]):
                j = ring_indices[q]
                for p in range(edge_ptr[j], edge_ptr[j + 1]):
                    count += 1
                    other = angles[edge_indices[p]]
                    clear += TIMES_FLATTER * other < angles[e] or other > least
        result[e] = 4 * clear >= count
