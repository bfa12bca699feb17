"""The paper's fold test: whether edges of a neighbourhood cross or touch when projected onto a plane.

These are the "coincident or crossing projections" of Li, Barsky, Jin (2009); coincident vertices have touching edges.
The fit kernel has a cheaper test by angles (see docs/deviations.md), so with the paper's test planes are found first.
"""

import numpy as np

from bezier_filters.arrays import BoolArray, ByteArray, FloatArray, IntArray
from bezier_filters.kernels.kernel_input import FITTED, FOLDED_OVER, ILL_POSED, MAX_VALENCE, KernelMesh
from bezier_filters.meshes.frames import Vector, mean_normal
from bezier_filters.meshes.neighbourhoods import collect_ring
from bezier_filters.runtime.jit import allocating_jit, inner_jit
from bezier_filters.runtime.parallel import run_kernel

# planes perpendicular to the vertex normal, to the mean normal of the neighbourhood, and to the normal of a neighbour
OWN_PLANE, MEAN_PLANE, NEIGHBOUR_PLANE = 0, 1, 2
# Rounding error of twice the area of a triangle, in squares of the radius of the neighbourhood; double precision gives
# some 1e-16. On blocks, whose upright faces have no area, results are the same from 1e-15 to 1e-9.
AREA_TOLERANCE = 1e-12


def find_planes(
    mesh: KernelMesh, ids: IntArray, rings: int, fewest_points: int, plane: int
) -> tuple[FloatArray, ByteArray]:
    """Unit normals (k, 3) of planes onto which edges of the neighbourhoods project without crossing; outcomes (k,).

    Outcomes are FITTED where there is such a plane, FOLDED_OVER where there is none, and ILL_POSED where no plane is
    tested: there are fewer than `fewest_points` points, or more than `MAX_VALENCE`, for which the test is too costly.
    """
    normals, outcomes = np.zeros((len(ids), 3)), np.empty(len(ids), dtype=np.int8)
    arrays = mesh.vertices, mesh.normals, mesh.ring_ptr, mesh.ring_indices, mesh.barriers
    run_kernel(_find_planes, len(ids), *arrays, ids, rings, fewest_points, plane, normals, outcomes)
    return normals, outcomes


@allocating_jit()
def _find_planes(
    vertices: FloatArray,
    normals: FloatArray,
    ring_ptr: IntArray,
    ring_indices: IntArray,
    barriers: BoolArray,
    ids: IntArray,
    rings: int,
    fewest_points: int,
    plane: int,
    found: FloatArray,
    outcomes: ByteArray,
    start: int,
    stop: int,
) -> None:
    n = len(vertices)
    visited, members, places = np.zeros(n, np.bool_), np.empty(n + 1, np.int32), np.full(n, -1, np.int32)
    flat = np.empty((MAX_VALENCE + 1, 2))
    for k in range(start, stop):
        i = ids[k]
        count, _ = collect_ring(ring_ptr, ring_indices, barriers, i, rings, visited, members)
        outcomes[k] = ILL_POSED
        if count < fewest_points or count > MAX_VALENCE:
            continue
        for a in range(count):
            places[members[a]] = a
        edges = np.empty((_write_edges(ring_ptr, ring_indices, members, count, places, None), 2), np.int32)
        _write_edges(ring_ptr, ring_indices, members, count, places, edges)
        for a in range(count):
            places[members[a]] = -1
        outcomes[k] = FOLDED_OVER
        if plane == NEIGHBOUR_PLANE:
            nearest = -np.inf
            for a in range(1, 1 + ring_ptr[i + 1] - ring_ptr[i]):
                j = members[a]
                nx, ny, nz = normals[j, 0], normals[j, 1], normals[j, 2]
                cosine = nx * normals[i, 0] + ny * normals[i, 1] + nz * normals[i, 2]
                if cosine <= nearest or (nx == 0.0 and ny == 0.0 and nz == 0.0):
                    continue
                if not _edges_cross(vertices, members, count, edges, flat, (nx, ny, nz)):
                    nearest = cosine
                    found[k, 0], found[k, 1], found[k, 2] = nx, ny, nz
                    outcomes[k] = FITTED
            continue
        nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
        if plane == MEAN_PLANE:
            nx, ny, nz = mean_normal(normals, members, count)
        if nx == 0.0 and ny == 0.0 and nz == 0.0:
            continue
        if not _edges_cross(vertices, members, count, edges, flat, (nx, ny, nz)):
            found[k, 0], found[k, 1], found[k, 2] = nx, ny, nz
            outcomes[k] = FITTED


@inner_jit()
def _write_edges(
    ring_ptr: IntArray,
    ring_indices: IntArray,
    members: IntArray,
    count: int,
    places: IntArray,
    edges: IntArray | None,
) -> int:
    """Write the edges between members[:count] as pairs of their indices, if an array is given; return their number."""
    written = 0
    for a in range(count):
        j = members[a]
        if a > 0 and ring_ptr[j + 1] - ring_ptr[j] > MAX_VALENCE:
            continue  # its edges occur in the rows of the other members
        for q in range(ring_ptr[j], ring_ptr[j + 1]):
            b = places[ring_indices[q]]
            other = ring_indices[q]
            if b > a or (b > 0 and ring_ptr[other + 1] - ring_ptr[other] > MAX_VALENCE):
                if edges is not None:
                    edges[written, 0], edges[written, 1] = a, b
                written += 1
    return written


@inner_jit()
def _edges_cross(
    vertices: FloatArray, members: IntArray, count: int, edges: IntArray, flat: FloatArray, normal: Vector
) -> bool:
    """Whether two edges without a common end intersect when projected along a unit normal."""
    nx, ny, nz = normal
    if abs(nx) <= abs(ny) and abs(nx) <= abs(nz):  # x = normal x the coordinate axis farthest from it
        x, y, z = 0.0, nz, -ny
    elif abs(ny) <= abs(nz):
        x, y, z = -nz, 0.0, nx
    else:
        x, y, z = ny, -nx, 0.0
    length = np.sqrt(x * x + y * y + z * z)
    x, y, z = x / length, y / length, z / length
    reach, i = 0.0, members[0]
    for a in range(count):
        j = members[a]
        dx = vertices[j, 0] - vertices[i, 0]
        dy = vertices[j, 1] - vertices[i, 1]
        dz = vertices[j, 2] - vertices[i, 2]
        flat[a, 0] = dx * x + dy * y + dz * z
        flat[a, 1] = dx * (ny * z - nz * y) + dy * (nz * x - nx * z) + dz * (nx * y - ny * x)
        reach = max(reach, dx * dx + dy * dy + dz * dz)
    for p in range(len(edges)):
        a, b = edges[p, 0], edges[p, 1]
        for q in range(p):
            c, d = edges[q, 0], edges[q, 1]
            if a != c and a != d and b != c and b != d and _segments_meet(flat, a, b, c, d, AREA_TOLERANCE * reach):
                return True
    return False


@inner_jit()
def _segments_meet(flat: FloatArray, a: int, b: int, c: int, d: int, rounding: float) -> bool:
    """Whether two segments of the plane have a common point; areas up to `rounding` count as zero."""
    for k in range(2):
        if max(flat[a, k], flat[b, k]) < min(flat[c, k], flat[d, k]):
            return False
        if max(flat[c, k], flat[d, k]) < min(flat[a, k], flat[b, k]):
            return False
    own = _side(flat, a, b, c, rounding) * _side(flat, a, b, d, rounding)
    return own <= 0 and _side(flat, c, d, a, rounding) * _side(flat, c, d, b, rounding) <= 0


@inner_jit()
def _side(flat: FloatArray, a: int, b: int, c: int, rounding: float) -> int:
    """Orientation of the triangle (a, b, c): 1 counter-clockwise, -1 clockwise, 0 collinear."""
    ux, uy, vx, vy = flat[b, 0] - flat[a, 0], flat[b, 1] - flat[a, 1], flat[c, 0] - flat[a, 0], flat[c, 1] - flat[a, 1]
    area = ux * vy - uy * vx
    return 1 if area > rounding else (-1 if area < -rounding else 0)
