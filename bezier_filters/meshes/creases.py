"""Sharp edges, which neighbourhoods must not reach across.

A crease is an edge whose faces meet at an angle that neither the curvature nor the noise of its
surroundings explains: much larger than at most edges there.
"""

from math import cos, radians

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.meshes.adjacency import Adjacency
from bezier_filters.meshes.frames import STEEPEST, TangentPlanes, unit_face_normal
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.runtime.lean import inner_njit, lean_njit
from bezier_filters.runtime.parallel import RangeTask, run_in_chunks

SHARPEST_SMOOTH = radians(45.0)
"""Angle up to which no edge is a crease."""
TIMES_USUAL = 10.0
"""A crease is more than this many times as sharp as most edges around it."""
MOST_EDGES = 256
"""Around a vertex, of those that are looked at."""
NARROW_CONE = cos(STEEPEST - SHARPEST_SMOOTH / 2.0)
"""Where `TangentPlanes.safe_cosine` is less, the faces differ too little for a crease."""


def crease_vertices(mesh: TriangleMesh, adjacency: Adjacency, planes: TangentPlanes, *, threads: int = 1) -> BoolArray:
    """Vertices with two creases or more: those inside a sharp edge or at a corner, not where one ends.

    Parameters
    ----------
    mesh : TriangleMesh
    adjacency : Adjacency
        Of the same mesh.
    planes : TangentPlanes
        Of the same mesh.
    threads : int
        Number of threads.

    Returns
    -------
    (n,) bool

    Examples
    --------
    >>> from bezier_filters.meshes.adjacency import vertex_adjacency
    >>> from bezier_filters.meshes.frames import tangent_planes
    >>> from bezier_filters.meshes.mesh import triangle_mesh
    >>> from bezier_filters.surfaces import block_with_sharp_edges
    >>> block = triangle_mesh(*block_with_sharp_edges(resolution=8))
    >>> adjacency = vertex_adjacency(block)
    >>> sharp = crease_vertices(block, adjacency, tangent_planes(block, adjacency))
    >>> inside_a_face = (np.abs(block.vertices[:, :2]) < 0.4).all(axis=1) & (block.vertices[:, 2] == -0.5)
    >>> bool(sharp.any()), bool(sharp[inside_a_face].any())
    (True, False)
    """
    result = np.zeros(mesh.vertex_count, dtype=np.bool_)
    candidates = np.flatnonzero(planes.safe_cosine >= NARROW_CONE).astype(np.int32)
    faces, vertices = adjacency.faces, adjacency.vertices

    def make_task() -> RangeTask:
        angles = np.empty(MOST_EDGES)
        return lambda start, stop: _find_creases(
            mesh.vertices,
            mesh.faces,
            faces.indptr,
            faces.indices,
            vertices.indptr,
            vertices.indices,
            candidates[start:stop],
            angles,
            result,
        )

    run_in_chunks(make_task, len(candidates), threads=threads)
    return result


@lean_njit()
def _find_creases(
    vertices: FloatArray,
    faces: IntArray,
    face_ptr: IntArray,
    face_indices: IntArray,
    ring_ptr: IntArray,
    ring_indices: IntArray,
    ids: IntArray,
    angles: FloatArray,
    result: BoolArray,
) -> None:
    """Mark those of the vertices `ids` that have two creases or more."""
    for i in ids:
        own = _edge_angles(vertices, faces, face_ptr, face_indices, i, angles, 0)
        sharp = 0
        for a in range(own):
            sharp += angles[a] > SHARPEST_SMOOTH
        if sharp < 2:
            continue
        count = _edge_angles(vertices, faces, face_ptr, face_indices, i, angles, own)
        for q in range(ring_ptr[i], ring_ptr[i + 1]):
            count = _edge_angles(vertices, faces, face_ptr, face_indices, ring_indices[q], angles, count)
        creases = 0
        for a in range(own):
            if angles[a] > SHARPEST_SMOOTH:
                flatter = 0
                for b in range(own, count):
                    flatter += TIMES_USUAL * angles[b] < angles[a]
                creases += 2 * flatter > count - own
        result[i] = creases >= 2


@inner_njit()
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
        f = face_indices[q]
        other = _other_face(faces, face_ptr, face_indices, i, f)
        if other >= 0 and count < angles.shape[0]:
            angles[count] = np.arccos(min(max(_cosine(vertices, faces, f, other), -1.0), 1.0))
            count += 1
    return count


@inner_njit()
def _other_face(faces: IntArray, face_ptr: IntArray, face_indices: IntArray, i: int, f: int) -> int:
    """The face at vertex i behind the edge of face f that leaves i, counter-clockwise; -1 if there is none."""
    tip = faces[f, 1] if faces[f, 0] == i else faces[f, 2] if faces[f, 1] == i else faces[f, 0]
    for q in range(face_ptr[i], face_ptr[i + 1]):
        g = face_indices[q]
        if g != f and (faces[g, 0] == tip or faces[g, 1] == tip or faces[g, 2] == tip):
            return int(g)
    return -1


@inner_njit()
def _cosine(vertices: FloatArray, faces: IntArray, f: int, g: int) -> float:
    """Cosine of the angle between two faces; 1 if one of them has no area."""
    a, b, c = unit_face_normal(vertices, faces, f)
    x, y, z = unit_face_normal(vertices, faces, g)
    if (a == 0.0 and b == 0.0 and c == 0.0) or (x == 0.0 and y == 0.0 and z == 0.0):
        return 1.0
    return a * x + b * y + c * z
