"""Sharp edges, which neighbourhoods must not reach across.

A crease is an edge whose faces meet at an angle that neither the curvature nor the noise of its
surroundings explains: much larger than at most edges there.
"""

import numpy as np
from numba import njit

from bezier_filters.adjacency import Adjacency
from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.frames import unit_face_normal
from bezier_filters.mesh import TriangleMesh
from bezier_filters.parallel import RangeTask, run_in_chunks

SHARPEST_SMOOTH = 45.0
"""Degrees up to which no edge is a crease."""
TIMES_USUAL = 10.0
"""A crease is this many times as sharp as the median edge around it."""
MOST_EDGES = 256
"""Around a vertex, of those that the median is taken over."""


def crease_vertices(mesh: TriangleMesh, adjacency: Adjacency, *, threads: int = 1) -> BoolArray:
    """Vertices with two creases or more: those inside a sharp edge or at a corner, not where one ends.

    Parameters
    ----------
    mesh : TriangleMesh
    adjacency : Adjacency
        Of the same mesh.
    threads : int
        Number of threads.

    Returns
    -------
    (n,) bool

    Examples
    --------
    >>> from bezier_filters.adjacency import vertex_adjacency
    >>> from bezier_filters.mesh import triangle_mesh
    >>> from bezier_filters.surfaces import block_with_sharp_edges
    >>> block = triangle_mesh(*block_with_sharp_edges(resolution=8))
    >>> sharp = crease_vertices(block, vertex_adjacency(block))
    >>> inside_a_face = (np.abs(block.vertices[:, :2]) < 0.4).all(axis=1) & (block.vertices[:, 2] == -0.5)
    >>> bool(sharp.any()), bool(sharp[inside_a_face].any())
    (True, False)
    """
    n = mesh.vertex_count
    counts = np.zeros(n, dtype=np.int32)
    rows = adjacency.vertices

    def make_task() -> RangeTask:
        return lambda start, stop: _count_creases(
            mesh.vertices,
            mesh.faces,
            adjacency.faces.indptr,
            adjacency.faces.indices,
            rows.indptr,
            rows.indices,
            start,
            stop,
            counts,
        )

    run_in_chunks(make_task, n, threads=threads)
    result: BoolArray = counts >= 2
    return result


@njit(cache=True, nogil=True, error_model="numpy")
def _other_face(faces: IntArray, face_ptr: IntArray, face_indices: IntArray, i: int, f: int) -> int:
    """The face at vertex i behind the edge of face f that leaves i, counter-clockwise; -1 if there is none."""
    tip = faces[f, 1] if faces[f, 0] == i else faces[f, 2] if faces[f, 1] == i else faces[f, 0]
    for q in range(face_ptr[i], face_ptr[i + 1]):
        g = face_indices[q]
        if g != f and (faces[g, 0] == tip or faces[g, 1] == tip or faces[g, 2] == tip):
            return int(g)
    return -1


@njit(cache=True, nogil=True, error_model="numpy")
def _cosine(vertices: FloatArray, faces: IntArray, f: int, g: int) -> float:
    """Cosine of the angle between two faces; 1 if one of them has no area."""
    a, b, c = unit_face_normal(vertices, faces, f)
    x, y, z = unit_face_normal(vertices, faces, g)
    if (a == 0.0 and b == 0.0 and c == 0.0) or (x == 0.0 and y == 0.0 and z == 0.0):
        return 1.0
    return a * x + b * y + c * z


@njit(cache=True, nogil=True, error_model="numpy")
def _count_creases(
    vertices: FloatArray,
    faces: IntArray,
    face_ptr: IntArray,
    face_indices: IntArray,
    ring_ptr: IntArray,
    ring_indices: IntArray,
    start: int,
    stop: int,
    counts: IntArray,
) -> None:
    """Number of creases at vertices start .. stop-1; 0 where there is one only."""
    angles = np.empty(MOST_EDGES)
    around = np.empty(MOST_EDGES)
    sharp = np.radians(SHARPEST_SMOOTH)
    for i in range(start, stop):
        own = _edge_angles(vertices, faces, face_ptr, face_indices, i, angles, 0)
        if (angles[:own] > sharp).sum() < 2:
            continue
        count = _edge_angles(vertices, faces, face_ptr, face_indices, i, around, 0)
        for q in range(ring_ptr[i], ring_ptr[i + 1]):
            count = _edge_angles(vertices, faces, face_ptr, face_indices, ring_indices[q], around, count)
        limit = max(sharp, TIMES_USUAL * np.median(around[:count]))
        counts[i] = (angles[:own] > limit).sum()


@njit(cache=True, nogil=True, error_model="numpy")
def _edge_angles(
    vertices: FloatArray,
    faces: IntArray,
    face_ptr: IntArray,
    face_indices: IntArray,
    i: int,
    angles: FloatArray,
    count: int,
) -> int:
    """Append the angles between the faces at the edges of vertex i, as far as there is room; return the new count."""
    for q in range(face_ptr[i], face_ptr[i + 1]):
        other = _other_face(faces, face_ptr, face_indices, i, face_indices[q])
        if other >= 0 and count < angles.shape[0]:
            angles[count] = np.arccos(min(max(_cosine(vertices, faces, face_indices[q], other), -1.0), 1.0))
            count += 1
    return count
