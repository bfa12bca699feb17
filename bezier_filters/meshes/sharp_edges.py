"""Sharp edges of a mesh: dihedral angles too large to be explained by the curvature of the surface.

An edge is sharp if its angle is large, and much larger than the angles of enough edges nearby. How many are enough
depends on the use: a spurious line does little harm, but a fit that ends at a spurious barrier has too few points.

======================  ==================  ============  =======================================================
function                used for            angle above   edges nearby that are much flatter
======================  ==================  ============  =======================================================
`sharp_edges`           lines, holes (35)   40 degrees    a quarter by 12.6, or also sharp (on coarse polyhedra)
`sharp_edge_vertices`   fits                45 degrees    half by 10
======================  ==================  ============  =======================================================

Lines continue straight on along less sharp edges. Noise causes angles as well: under noise these rules are applied to
the denoised surface of `estimation.hidden_edges`, where fits end at the edges of lines, too.
"""

from math import cos, radians
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.meshes.adjacency import Adjacency
from bezier_filters.meshes.frames import MAX_FACE_TILT, TangentPlanes, smooth_normals
from bezier_filters.meshes.half_edges import MeshEdges
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.meshes.triangles import cosine_between, has_corner, next_corner
from bezier_filters.runtime.jit import inner_jit, jit
from bezier_filters.runtime.parallel import RangeTask, run_in_chunks

SHARP_ANGLE, FIT_SHARP_ANGLE = radians(40.0), radians(45.0)  # least angles of sharp edges, for lines and for fits
# least ratio of the angle of a sharp edge to those of a quarter, or of half, of the edges nearby
MIN_QUARTER_RATIO, MIN_HALF_RATIO = 12.6, 10.0
CONTINUATION_RATIO = 0.75  # least angle of an edge that continues a line, over the least angle of sharp edges
MIN_CONTINUATION_COSINE = cos(radians(30.0))  # least cosine of the angle between consecutive edges of a line
# least angle between smoothed normals at both ends of an edge near sharp edges: on a box, half of the angle there
MIN_SMOOTHED_ANGLE = SHARP_ANGLE / 5.0
MIN_ANGLE_DEVIATION = radians(1.0)  # least standard deviation of an angle
MAX_RING_EDGES = 256  # edges around a vertex that are examined
# `TangentPlanes.safe_cosine` below which the faces at a vertex differ too little for a sharp edge
MAX_SMOOTH_COSINE = cos(MAX_FACE_TILT - FIT_SHARP_ANGLE / 2.0)


def sharp_edges(mesh: TriangleMesh, edges: MeshEdges, adjacency: Adjacency, angle: float = SHARP_ANGLE) -> BoolArray:
    """Sharp edges (e,): angles above `angle`, in radians, and far above those nearby, and continuations of them."""
    result = np.zeros(len(edges.angles), dtype=np.bool_)
    candidates = np.flatnonzero(edges.angles > angle).astype(np.int32)
    if len(candidates):
        arrays, ring = _edge_arrays(edges, mesh.vertex_count), adjacency.vertices
        _mark(arrays, candidates, ring.indptr, ring.indices, angle, result)
        count = np.bincount(edges.vertices[result].ravel(), minlength=mesh.vertex_count).astype(np.int32)
        _continue(mesh.vertices, arrays, candidates, CONTINUATION_RATIO * angle, count, result)
    return result


def certainties(edges: MeshEdges, noise: float, angle: float = SHARP_ANGLE) -> FloatArray:
    """Probability of each edge (e,) to have a noise-free angle above `angle`, in radians.

    Independent errors of the vertices along the normal, with the standard deviation `noise`, give the angle at an edge
    of width w the standard deviation 4/3 noise / w (error propagation through two equal triangles).
    """
    deviations = np.maximum(4.0 / 3.0 * noise / np.maximum(edges.widths, 1e-300 * max(noise, 1.0)), MIN_ANGLE_DEVIATION)
    return np.asarray(ndtr((edges.angles - angle) / deviations), dtype=np.float64)


def may_have_sharp_edges(adjacency: Adjacency, normals: FloatArray) -> bool:
    """Whether smoothed vertex normals (n, 3) differ anywhere as much as at a sharp edge: a fast test, also under noise.

    >>> from bezier_filters.meshes.mesh import triangle_mesh
    >>> from bezier_filters.meshes.prepared_mesh import prepare_mesh
    >>> from bezier_filters.surfaces import block_with_sharp_edges, sphere
    >>> ball = sphere(resolution=20)
    >>> meshes = [triangle_mesh(*block_with_sharp_edges(resolution=8)), triangle_mesh(ball.vertices, ball.faces)]
    >>> [may_have_sharp_edges(mesh.adjacency, mesh.planes.normals) for mesh in map(prepare_mesh, meshes)]
    [True, False]
    """
    rows, nowhere = adjacency.vertices, np.zeros(len(normals), dtype=np.bool_)
    for _ in range(2):
        normals = smooth_normals(normals, rows.indptr, rows.indices, nowhere)
    return bool(_turns(rows.indptr, rows.indices, normals, cos(MIN_SMOOTHED_ANGLE)))


@jit()
def _turns(ptr: IntArray, indices: IntArray, normals: FloatArray, least_cosine: float) -> bool:
    """Whether the normals of any two neighbours have a cosine below `least_cosine`."""
    for i in range(len(ptr) - 1):
        x, y, z = normals[i, 0], normals[i, 1], normals[i, 2]
        for q in range(ptr[i], ptr[i + 1]):
            j = indices[q]
            if x * normals[j, 0] + y * normals[j, 1] + z * normals[j, 2] < least_cosine:
                return True
    return False


class _EdgeArrays(NamedTuple):
    """Edges for compiled code: ends, angles, and the edges at each vertex as compressed rows."""

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
    """Mark candidates next to which at least a quarter of the edges are much flatter, or sharp as well."""
    for e in candidates:
        count, clear = 0, 0
        for side in range(2):
            i = edges.ends[e, side]
            for q in range(ring_ptr[i], ring_ptr[i + 1]):
                j = ring_indices[q]
                for p in range(edges.ptr[j], edges.ptr[j + 1]):
                    count += 1
                    other = edges.angles[edges.indices[p]]
                    clear += MIN_QUARTER_RATIO * other < edges.angles[e] or other > least
        result[e] = 4 * clear >= count


@jit()
def _continue(
    vertices: FloatArray, edges: _EdgeArrays, candidates: IntArray, least: float, count: IntArray, result: BoolArray
) -> None:
    """Continue lines of two edges or more straight on along the sharpest edge; rounded edges have gaps by chance.

    `count` is the number of sharp edges at each vertex, and is updated.
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
                    if is_sharper and _turn(vertices, before, tip, other) > MIN_CONTINUATION_COSINE:
                        best, after = k, other
                if best < 0:
                    break
                result[best] = True
                count[tip] += 1
                count[after] += 1
                before, tip = tip, after


@inner_jit()
def _turn(vertices: FloatArray, i: int, j: int, k: int) -> float:
    """Cosine of the turning angle of the path from vertex i over j to k."""
    product, first, second = 0.0, 0.0, 0.0
    for c in range(3):
        before, after = vertices[j, c] - vertices[i, c], vertices[k, c] - vertices[j, c]
        product, first, second = product + before * after, first + before * before, second + after * after
    return float(product / np.sqrt(max(first * second, 1e-300)))


def sharp_edge_vertices(mesh: TriangleMesh, adjacency: Adjacency, planes: TangentPlanes) -> BoolArray:
    """Vertices (n,) with two sharp edges or more: inside a line or at a corner, not at the end of a line."""
    result = np.zeros(mesh.vertex_count, dtype=np.bool_)
    candidates = np.flatnonzero(planes.safe_cosine >= MAX_SMOOTH_COSINE).astype(np.int32)
    at_vertex, ring = adjacency.faces, adjacency.vertices
    arrays = _FaceArrays(mesh.vertices, mesh.faces, at_vertex.indptr, at_vertex.indices, ring.indptr, ring.indices)

    def make_task() -> RangeTask:
        cosines = np.empty(MAX_RING_EDGES)
        return lambda start, stop: _find_sharp_vertices(arrays, candidates[start:stop], cosines, result)

    run_in_chunks(make_task, len(candidates))
    return result


class _FaceArrays(NamedTuple):
    """A mesh for compiled code: faces and neighbours of each vertex as compressed rows."""

    vertices: FloatArray
    faces: IntArray
    face_ptr: IntArray
    face_indices: IntArray
    ring_ptr: IntArray
    ring_indices: IntArray


@jit()
def _find_sharp_vertices(mesh: _FaceArrays, ids: IntArray, cosines: FloatArray, result: BoolArray) -> None:
    """Mark vertices of `ids` with two sharp edges or more; `cosines` is work space."""
    large = np.cos(FIT_SHARP_ANGLE)
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
        result[i] = sharp >= 2  # at the end of a sharp edge, fits may extend around it


@inner_jit()
def _much_flatter(cosine: float) -> float:
    """Cosine of the angle divided by `MIN_HALF_RATIO`."""
    return float(np.cos(np.arccos(min(max(cosine, -1.0), 1.0)) / MIN_HALF_RATIO))


@inner_jit()
def _edge_cosines_around(mesh: _FaceArrays, i: int, flat: float, cosines: FloatArray, own: int) -> int:
    """Append the cosines of vertex i and its neighbours after its own, and return the new count.

    Returns `own` as soon as no more than half of them can be flatter than an edge with the cosine `flat`.
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
    """Append the cosines of the dihedral angles at the edges of vertex i, up to the capacity; return the new count."""
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
    """The face at vertex i across the edge of face f that starts at i, counter-clockwise; -1 if there is none."""
    tip = next_corner(mesh.faces, f, i)
    here, there = i, tip  # search at the end with fewer faces: hubs have thousands
    if mesh.face_ptr[tip + 1] - mesh.face_ptr[tip] < mesh.face_ptr[i + 1] - mesh.face_ptr[i]:
        here, there = tip, i
    for q in range(mesh.face_ptr[here], mesh.face_ptr[here + 1]):
        g = mesh.face_indices[q]
        if g != f and has_corner(mesh.faces, g, there):
            return int(g)
    return -1
