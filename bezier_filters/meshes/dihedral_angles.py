"""The edges of a mesh, each one once, the angles at which faces meet there, and which of these edges are sharp.

A sharp edge is one whose faces meet at a large angle that neither the curvature nor the noise of its surroundings
explains: much larger than at most edges there. There are three rules, which differ in how large and how much larger:

======================  ==========================  ===========  ==================================================
function                for                         larger than  and, if most or many edges around are flatter, than
======================  ==========================  ===========  ==================================================
`sharp_edge_vertices`   neighbourhoods of fits      45 degrees   10 times half of those of two rings
`find_sharp_edges`      feature lines               40 degrees   12.6 times a quarter of those of two rings, and noise
`sharp_edges_at_hole`   creases through a hole      35 degrees   4 times the median of five rings
======================  ==========================  ===========  ==================================================
"""

from dataclasses import dataclass
from math import cos, radians

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.meshes.adjacency import Adjacency, Rows
from bezier_filters.meshes.frames import STEEPEST, TangentPlanes
from bezier_filters.meshes.half_edges import ends_of_half_edges
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.meshes.triangles import cosine_between, has_corner, next_corner
from bezier_filters.runtime.jit import inner_jit, jit
from bezier_filters.runtime.parallel import RangeTask, run_in_chunks

IN_NEIGHBOURHOODS, AS_LINES, AT_HOLES = radians(45.0), radians(40.0), radians(35.0)
"""Angles up to which no edge is sharp, by what for."""
TIMES_AROUND, TIMES_A_QUARTER, TIMES_MEDIAN = 10.0, 12.6, 4.0
"""How many times as sharp an edge must be as most, a quarter, or the median of those around it, in the same order."""
NOISE_DEVIATIONS = 4.0
"""Of the angles that noise makes, beyond which an edge belongs to a line: one in 16,000 is sharper by chance."""
MOST_EDGES = 256
"""Around a vertex, of those that are looked at."""
NARROW_CONE = cos(STEEPEST - IN_NEIGHBOURHOODS / 2.0)
"""Where `TangentPlanes.safe_cosine` is less, the faces differ too little for a sharp edge."""


@dataclass(frozen=True)
class MeshEdges:
    """The distinct edges of a mesh; those of faces that name a vertex twice are left out."""

    vertices: IntArray  # (e, 2): their ends, the smaller one first; rows in ascending order
    # (m, 3): number of the edge from each corner of a face to the next; -1 where the face names a vertex twice
    of_faces: IntArray
    is_inner: BoolArray  # (e,): whether there are two faces
    # (e,): angle between the normals of the two faces, in radians, 0 to pi: 0 where the surface is flat, where there
    # are not just two faces, and where a face has no area
    angles: FloatArray
    is_convex: BoolArray  # (e,): whether the faces bend away from the outside
    # (e,): length across the edge of the part of its faces that is nearer to it than to their other edges: two thirds
    # of their area over the length of the edge, a third of each height
    widths: FloatArray


def distinct_edges(faces: IntArray, n: int) -> tuple[IntArray, IntArray, IntArray]:
    """Edges of faces (m, 3) between n vertices, each once: ends (e, 2), the edge of each half-edge, how many it has."""
    starts, ends = (side.astype(np.int64) for side in ends_of_half_edges(faces))
    keys, number, count = np.unique(
        np.minimum(starts, ends) * n + np.maximum(starts, ends), return_inverse=True, return_counts=True
    )
    edges = np.stack(np.divmod(keys, max(n, 1)), axis=1)
    return edges.astype(np.int32), number.astype(np.int32), count.astype(np.int32)


def dihedral_angles(normals: FloatArray, others: FloatArray) -> FloatArray:
    """Angles between unit normals (k, 3), in radians: by their chord, which is accurate where they are nearly equal."""
    half_chord = 0.5 * np.linalg.norm(normals - others, axis=1)
    return np.asarray(2.0 * np.arcsin(np.minimum(half_chord, 1.0)), dtype=np.float64)


def mesh_edges(mesh: TriangleMesh) -> MeshEdges:
    """Find the edges of a mesh.

    Examples
    --------
    >>> from bezier_filters.meshes.mesh import triangle_mesh
    >>> ridge = triangle_mesh([[0, 0, 0], [0, 1, 0], [1, 0, -1], [-1, 0, -1]], [[0, 2, 1], [0, 1, 3]])
    >>> edges = mesh_edges(ridge)
    >>> edges.vertices[0], np.degrees(edges.angles[0]).round(), edges.is_convex[0]
    (array([0, 1], dtype=int32), np.float64(90.0), np.True_)
    """
    faces = mesh.faces
    proper = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    vertices, number, count = distinct_edges(faces[proper], mesh.vertex_count)
    of_faces = np.full((len(faces), 3), -1, dtype=np.int32)
    of_faces[proper] = number.reshape(-1, 3)

    corners = mesh.vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    doubled_areas = np.linalg.norm(normals, axis=1)
    known = doubled_areas > 0.0
    normals[known] /= doubled_areas[known, np.newaxis]
    lengths = np.linalg.norm(mesh.vertices[vertices[:, 1]] - mesh.vertices[vertices[:, 0]], axis=1)
    area = np.bincount(number, weights=np.repeat(doubled_areas[proper], 3), minlength=len(vertices))
    widths = np.divide(area, 3.0 * lengths, out=np.zeros(len(vertices)), where=lengths > 0.0)

    # The two half-edges of each edge that has two.
    order = np.argsort(number, kind="stable")
    is_inner = count == 2
    first = order[(np.cumsum(count) - count)[is_inner]]
    second = order[(np.cumsum(count) - count)[is_inner] + 1]
    face_ids = np.flatnonzero(proper)
    own, other = face_ids[first // 3], face_ids[second // 3]
    angles, is_convex = np.zeros(len(vertices)), np.zeros(len(vertices), dtype=np.bool_)
    angles[is_inner] = np.where(known[own] & known[other], dihedral_angles(normals[own], normals[other]), 0.0)
    tips = faces[other, (second + 2) % 3]
    is_convex[is_inner] = np.einsum("ij,ij->i", mesh.vertices[tips] - corners[own, 0], normals[own]) < 0.0
    return MeshEdges(vertices, of_faces, is_inner, angles, is_convex, widths)


def sharp_edges_at_hole(edges: MeshEdges) -> tuple[BoolArray, float]:
    """Which edges (e,) of the rings around a hole are much sharper than most, and from which angle on they are."""
    angles = edges.angles[edges.is_inner]
    limit = max(AT_HOLES, TIMES_MEDIAN * float(np.median(angles))) if len(angles) else AT_HOLES
    return edges.angles > limit, limit


def find_sharp_edges(edges: MeshEdges, adjacency: Adjacency, angle: float = AS_LINES, noise: float = 0.0) -> BoolArray:
    """Which edges (e,) bend by more than an angle, in radians, and much more than those around them.

    Independent errors of the vertices along the normal, of the standard deviation `noise`, change the angle at an edge
    of the width w by 4/3 noise / w (by propagation through two equal triangles); sharp edges bend by much more, too.
    Where the noise is not known: of the edges around a sharp edge a quarter or more are either much flatter, or sharp
    themselves as on coarse polyhedra.

    Examples
    --------
    >>> from bezier_filters.meshes.adjacency import vertex_adjacency
    >>> from bezier_filters.meshes.mesh import triangle_mesh
    >>> from bezier_filters.surfaces import block_with_sharp_edges
    >>> block = triangle_mesh(*block_with_sharp_edges(resolution=8))
    >>> edges = mesh_edges(block)
    >>> sharp = find_sharp_edges(edges, vertex_adjacency(block))
    >>> np.degrees(edges.angles[sharp]).round().min(), edges.angles[~sharp].max().round(6)
    (np.float64(90.0), np.float64(0.0))
    """
    result = np.zeros(len(edges.angles), dtype=np.bool_)
    limit = NOISE_DEVIATIONS * 4.0 / 3.0 * noise
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


@jit()
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
                    clear += TIMES_A_QUARTER * other < angles[e] or other > least
        result[e] = 4 * clear >= count


def sharp_edge_vertices(
    mesh: TriangleMesh, adjacency: Adjacency, planes: TangentPlanes, *, threads: int = 1
) -> BoolArray:
    """Vertices (n,) with two sharp edges or more: those inside one or at a corner, not where one ends.

    Examples
    --------
    >>> from bezier_filters.meshes.adjacency import vertex_adjacency
    >>> from bezier_filters.meshes.frames import tangent_planes
    >>> from bezier_filters.meshes.mesh import triangle_mesh
    >>> from bezier_filters.surfaces import block_with_sharp_edges
    >>> block = triangle_mesh(*block_with_sharp_edges(resolution=8))
    >>> adjacency = vertex_adjacency(block)
    >>> sharp = sharp_edge_vertices(block, adjacency, tangent_planes(block, adjacency))
    >>> inside_a_face = (np.abs(block.vertices[:, :2]) < 0.4).all(axis=1) & (block.vertices[:, 2] == -0.5)
    >>> bool(sharp.any()), bool(sharp[inside_a_face].any())
    (True, False)
    """
    result = np.zeros(mesh.vertex_count, dtype=np.bool_)
    candidates = np.flatnonzero(planes.safe_cosine >= NARROW_CONE).astype(np.int32)
    at_vertex, ring = adjacency.faces, adjacency.vertices

    def make_task() -> RangeTask:
        angles = np.empty(MOST_EDGES)
        return lambda start, stop: _find_sharp_vertices(
            mesh.vertices,
            mesh.faces,
            at_vertex.indptr,
            at_vertex.indices,
            ring.indptr,
            ring.indices,
            candidates[start:stop],
            angles,
            result,
        )

    run_in_chunks(make_task, len(candidates), threads=threads)
    return result


@jit()
def _find_sharp_vertices(
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
    """Mark those of the vertices `ids` that have two sharp edges or more; `angles` is work space."""
    for i in ids:
        own = _edge_angles(vertices, faces, face_ptr, face_indices, i, angles, 0)
        large = 0
        for a in range(own):
            large += angles[a] > IN_NEIGHBOURHOODS
        if large < 2:
            continue
        count = _edge_angles(vertices, faces, face_ptr, face_indices, i, angles, own)
        for q in range(ring_ptr[i], ring_ptr[i + 1]):
            count = _edge_angles(vertices, faces, face_ptr, face_indices, ring_indices[q], angles, count)
        sharp = 0
        for a in range(own):
            if angles[a] > IN_NEIGHBOURHOODS:
                flatter = 0
                for b in range(own, count):
                    flatter += TIMES_AROUND * angles[b] < angles[a]
                sharp += 2 * flatter > count - own
        result[i] = sharp >= 2  # where a sharp edge ends, one side of a fit may look across it


@inner_jit()
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
            a, b, c, d, e, g = faces[f, 0], faces[f, 1], faces[f, 2], faces[other, 0], faces[other, 1], faces[other, 2]
            cosine = cosine_between(vertices, a, b, c, d, e, g, 1.0)
            angles[count] = np.arccos(min(max(cosine, -1.0), 1.0))
            count += 1
    return count


@inner_jit()
def _other_face(faces: IntArray, face_ptr: IntArray, face_indices: IntArray, i: int, f: int) -> int:
    """The face at vertex i behind the edge of face f that leaves i, counter-clockwise; -1 if there is none."""
    tip = next_corner(faces, f, i)
    for q in range(face_ptr[i], face_ptr[i + 1]):
        g = face_indices[q]
        if g != f and has_corner(faces, g, tip):
            return int(g)
    return -1
