"""Which edges of a mesh are sharp: where its faces meet at an angle that the curvature around does not explain.

An edge is sharp if its angle is large, and much larger than those of enough edges around. How many are enough depends
on what it is for: a line too many does little harm, but a fit that ends where it should not has too few points.

======================  ==================  ============  =====================================================
function                for                 larger than   of the edges around, so many are so much flatter
======================  ==================  ============  =====================================================
`sharp_edges`           lines, holes (35)   40 degrees    a quarter 12.6 times, or sharp as on coarse polyhedra
`sharp_edge_vertices`   fits                45 degrees    half of them 10 times
======================  ==================  ============  =====================================================

Lines that stop go straight on along less sharp edges. Noise makes angles, too: `estimation.hidden_edges` applies the
rules to the denoised surface; there, fits end at the edges of lines, too.
"""

from math import cos, radians
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.meshes.adjacency import Adjacency
from bezier_filters.meshes.frames import STEEPEST, TangentPlanes, steady_normals, tangent_planes
from bezier_filters.meshes.half_edges import MeshEdges
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.meshes.triangles import cosine_between, has_corner, next_corner
from bezier_filters.runtime.jit import inner_jit, jit
from bezier_filters.runtime.parallel import RangeTask, run_in_chunks

SHARP, FOR_FITS = radians(40.0), radians(45.0)  # angles up to which no edge is sharp
# how many times as sharp an edge must be as a quarter, or half, of those around it, in the same order
TIMES_A_QUARTER, TIMES_HALF = 12.6, 10.0
WEAK = 0.75  # times the least angle of sharp edges: that of edges that continue them,
STRAIGHT_ON = cos(radians(30.0))  # if they go straight on: least cosine of the angle between both
# least angle between averaged normals at both ends of some edge, where a sharp edge is near: on a box it is half of
# the angle there
STEEP = SHARP / 5.0
EXACT = radians(1.0)  # least standard deviation of an angle
MOST_EDGES = 256  # around a vertex, of those that are looked at
# where `TangentPlanes.safe_cosine` is less, the faces differ too little for a sharp edge
NARROW_CONE = cos(STEEPEST - FOR_FITS / 2.0)


def sharp_edges(mesh: TriangleMesh, edges: MeshEdges, adjacency: Adjacency, angle: float = SHARP) -> BoolArray:
    """Which edges (e,) bend by more than an angle, in radians, and by much more than those around, or continue such."""
    result = np.zeros(len(edges.angles), dtype=np.bool_)
    candidates = np.flatnonzero(edges.angles > angle).astype(np.int32)
    if len(candidates):
        arrays, ring = _edge_arrays(edges, mesh.vertex_count), adjacency.vertices
        _mark(arrays, candidates, ring.indptr, ring.indices, angle, result)
        count = np.bincount(edges.vertices[result].ravel(), minlength=mesh.vertex_count).astype(np.int32)
        _continue(mesh.vertices, arrays, candidates, WEAK * angle, count, result)
    return result


def certainties(edges: MeshEdges, noise: float, angle: float = SHARP) -> FloatArray:
    """Probability of each edge (e,) to bend by more than an angle, in radians, without the noise.

    Independent errors of the vertices along the normal, of the standard deviation `noise`, change the angle at an edge
    of the width w by 4/3 noise / w: by propagation through two equal triangles.
    """
    deviations = np.maximum(4.0 / 3.0 * noise / np.maximum(edges.widths, 1e-300 * max(noise, 1.0)), EXACT)
    return np.asarray(ndtr((edges.angles - angle) / deviations), dtype=np.float64)


def may_have_sharp_edges(mesh: TriangleMesh, adjacency: Adjacency) -> bool:
    """Whether the surface turns anywhere as quickly as at a sharp edge, which is soon told, with noise or without.

    >>> from bezier_filters.meshes.adjacency import vertex_adjacency
    >>> from bezier_filters.meshes.mesh import triangle_mesh
    >>> from bezier_filters.surfaces import block_with_sharp_edges, sphere
    >>> ball = sphere(resolution=20)
    >>> meshes = [triangle_mesh(*block_with_sharp_edges(resolution=8)), triangle_mesh(ball.vertices, ball.faces)]
    >>> [may_have_sharp_edges(mesh, vertex_adjacency(mesh)) for mesh in meshes]
    [True, False]
    """
    rows, normals = adjacency.vertices, tangent_planes(mesh, adjacency).normals
    nowhere = np.zeros(mesh.vertex_count, dtype=np.bool_)
    for _ in range(2):
        normals = steady_normals(normals, rows.indptr, rows.indices, nowhere)
    return bool(_turns(rows.indptr, rows.indices, normals, cos(STEEP)))


@jit()
def _turns(ptr: IntArray, indices: IntArray, normals: FloatArray, least_cosine: float) -> bool:
    """Whether the normals of any two neighbours differ by more than an angle."""
    for i in range(len(ptr) - 1):
        x, y, z = normals[i, 0], normals[i, 1], normals[i, 2]
        for q in range(ptr[i], ptr[i + 1]):
            j = indices[q]
            if x * normals[j, 0] + y * normals[j, 1] + z * normals[j, 2] < least_cosine:
                return True
    return False


class _EdgeArrays(NamedTuple):
    """Edges as compiled code reads them: their ends and angles, and those at each vertex as compressed rows."""

    ends: IntArray
    angles: FloatArray
    ptr: IntArray
    indices: IntArray


def _edge_arrays(edges: MeshEdges, n: int) -> _EdgeArrays:
    ends = edges.vertices.ravel()
    ptr = np.concatenate([[0], np.cumsum(np.bincount(ends, minlength=n))]).astype(np.int32)
    return _EdgeArrays(edges.vertices, edges.angles, ptr, (np.argsort(ends, kind="stable") // 2).astype(np.int32))


@jit()
def _mark(
    edges: _EdgeArrays,
    candidates: IntArray,
    ring_ptr: IntArray,
    ring_indices: IntArray,
    least: float,
    result: BoolArray,
) -> None:
    """Mark those candidates beside which a quarter of the edges, or more, are much flatter or sharp."""
    for e in candidates:
        count, clear = 0, 0
        for side in range(2):
            i = edges.ends[e, side]
            for q in range(ring_ptr[i], ring_ptr[i + 1]):
                j = ring_indices[q]
                for p in range(edges.ptr[j], edges.ptr[j + 1]):
                    count += 1
                    other = edges.angles[edges.indices[p]]
                    clear += TIMES_A_QUARTER * other < edges.angles[e] or other > least
        result[e] = 4 * clear >= count


@jit()
def _continue(
    vertices: FloatArray, edges: _EdgeArrays, candidates: IntArray, least: float, count: IntArray, result: BoolArray
) -> None:
    """Let lines of two edges or more go straight on along the sharpest edge: those of a rounded edge differ by chance.

    `count` says how many sharp edges meet at each vertex, and is kept.
    """
    ends, angles = edges.ends, edges.angles
    for e in candidates:
        is_line = result[e] and count[ends[e, 0]] + count[ends[e, 1]] > 2
        for side in range(2 if is_line else 0):
            before, tip = ends[e, 1 - side], ends[e, side]
            while count[tip] == 1:
                best, after = -1, -1
                for p in range(edges.ptr[tip], edges.ptr[tip + 1]):
                    k = edges.indices[p]
                    other = ends[k, 0] + ends[k, 1] - tip
                    is_sharper = not result[k] and angles[k] > (angles[best] if best >= 0 else least)
                    if is_sharper and _turn(vertices, before, tip, other) > STRAIGHT_ON:
                        best, after = k, other
                if best < 0:
                    break
                result[best] = True
                count[tip] += 1
                count[after] += 1
                before, tip = tip, after


@inner_jit()
def _turn(vertices: FloatArray, i: int, j: int, k: int) -> float:
    """Cosine of the angle by which the way from vertex i over j to k turns."""
    product, first, second = 0.0, 0.0, 0.0
    for c in range(3):
        before, after = vertices[j, c] - vertices[i, c], vertices[k, c] - vertices[j, c]
        product, first, second = product + before * after, first + before * before, second + after * after
    return float(product / np.sqrt(max(first * second, 1e-300)))


def sharp_edge_vertices(mesh: TriangleMesh, adjacency: Adjacency, planes: TangentPlanes) -> BoolArray:
    """Vertices (n,) with two sharp edges or more: those inside one or at a corner, not where one ends."""
    result = np.zeros(mesh.vertex_count, dtype=np.bool_)
    candidates = np.flatnonzero(planes.safe_cosine >= NARROW_CONE).astype(np.int32)
    at_vertex, ring = adjacency.faces, adjacency.vertices
    arrays = _FaceArrays(mesh.vertices, mesh.faces, at_vertex.indptr, at_vertex.indices, ring.indptr, ring.indices)

    def make_task() -> RangeTask:
        cosines = np.empty(MOST_EDGES)
        return lambda start, stop: _find_sharp_vertices(arrays, candidates[start:stop], cosines, result)

    run_in_chunks(make_task, len(candidates))
    return result


class _FaceArrays(NamedTuple):
    """A mesh as compiled code reads it: the faces at each vertex, and its neighbours, as compressed rows."""

    vertices: FloatArray
    faces: IntArray
    face_ptr: IntArray
    face_indices: IntArray
    ring_ptr: IntArray
    ring_indices: IntArray


@jit()
def _find_sharp_vertices(mesh: _FaceArrays, ids: IntArray, cosines: FloatArray, result: BoolArray) -> None:
    """Mark those of the vertices `ids` that have two sharp edges or more; `cosines` is work space."""
    large = np.cos(FOR_FITS)
    for i in ids:
        own = _edge_cosines(mesh, i, cosines, 0)
        candidates, least = 0, 1.0
        for a in range(own):
            candidates += cosines[a] < large
            least = min(least, cosines[a])
        if candidates < 2:
            continue
        count = _edge_cosines_around(mesh, i, _much_flatter(least), cosines, own)
        sharp = 0
        for a in range(own):
            if count > own and cosines[a] < large:
                flatter, bound = 0, _much_flatter(cosines[a])
                for b in range(own, count):
                    flatter += cosines[b] > bound
                sharp += 2 * flatter > count - own
        result[i] = sharp >= 2  # where a sharp edge ends, one side of a fit may look across it


@inner_jit()
def _much_flatter(cosine: float) -> float:
    """Cosine of an angle so many times smaller."""
    return float(np.cos(np.arccos(min(max(cosine, -1.0), 1.0)) / TIMES_HALF))


@inner_jit()
def _edge_cosines_around(mesh: _FaceArrays, i: int, flat: float, cosines: FloatArray, own: int) -> int:
    """Append those of vertex i and its neighbours after its own, and return the new count.

    It stays what it was once fewer than half can be flatter than an edge with the cosine `flat`.
    """
    count = _edge_cosines(mesh, i, cosines, own)
    most = count - own
    for q in range(mesh.ring_ptr[i], mesh.ring_ptr[i + 1]):
        j = mesh.ring_indices[q]
        most += mesh.face_ptr[j + 1] - mesh.face_ptr[j]
    seen, steep = own, 0
    for q in range(mesh.ring_ptr[i], mesh.ring_ptr[i + 1]):
        for b in range(seen, count):
            steep += cosines[b] <= flat
        if 2 * steep >= most:
            return own
        seen, count = count, _edge_cosines(mesh, mesh.ring_indices[q], cosines, count)
    return count


@inner_jit()
def _edge_cosines(mesh: _FaceArrays, i: int, cosines: FloatArray, count: int) -> int:
    """Append those of the angles between the faces at the edges of vertex i, if there is room; return the new count."""
    faces = mesh.faces
    for q in range(mesh.face_ptr[i], mesh.face_ptr[i + 1]):
        if count == cosines.shape[0]:
            break
        f = mesh.face_indices[q]
        other = _other_face(mesh, i, f)
        if other >= 0:
            a, b, c, d, e, g = faces[f, 0], faces[f, 1], faces[f, 2], faces[other, 0], faces[other, 1], faces[other, 2]
            cosines[count] = cosine_between(mesh.vertices, a, b, c, d, e, g, 1.0)
            count += 1
    return count


@inner_jit()
def _other_face(mesh: _FaceArrays, i: int, f: int) -> int:
    """The face at vertex i behind the edge of face f that leaves i, counter-clockwise; -1 if there is none."""
    tip = next_corner(mesh.faces, f, i)
    here, there = i, tip  # of which the first has no more faces than the second: hubs have thousands
    if mesh.face_ptr[tip + 1] - mesh.face_ptr[tip] < mesh.face_ptr[i + 1] - mesh.face_ptr[i]:
        here, there = tip, i
    for q in range(mesh.face_ptr[here], mesh.face_ptr[here + 1]):
        g = mesh.face_indices[q]
        if g != f and has_corner(mesh.faces, g, there):
            return int(g)
    return -1
