"""The paper's test for folds: whether edges of a neighbourhood cross or touch when projected onto a plane.

That is "coincident or crossing projections" of Li, Barsky, Jin (2009); vertices that coincide have edges that touch.
The kernel that fits tests angles instead, which is cheaper: see docs/deviations.md. So planes are found here, before.
"""

import numpy as np

from bezier_filters.arrays import BoolArray, ByteArray, FloatArray, IntArray
from bezier_filters.kernels.kernel_input import FITTED, FOLDED, ILL_POSED, MOST_EDGES, KernelMesh
from bezier_filters.meshes.frames import Vector, mean_normal
from bezier_filters.meshes.neighbourhoods import collect_ring
from bezier_filters.runtime.jit import allocating_jit, inner_jit
from bezier_filters.runtime.parallel import run_kernel

OWN, MEAN, OTHER = 0, 1, 2  # planes: normal to the vertex normal, to the neighbourhood's mean, to that of a neighbour
# of twice the area of a triangle, in squares of the neighbourhood's reach: what rounding, some 1e-16, may make of none.
# On blocks, whose upright faces have none, nothing changes between 1e-15 and 1e-9.
ROUNDING = 1e-12


def find_planes(
    mesh: KernelMesh, ids: IntArray, rings: int, fewest_points: int, plane: int
) -> tuple[FloatArray, ByteArray]:
    """Unit normals (k, 3) of planes over which no edges of the neighbourhoods of vertices cross, and outcomes (k,).

    Outcomes are FITTED where there is such a plane, FOLDED where there is none, and ILL_POSED where it is not looked
    for: there are fewer points than are asked for, or more than `MOST_EDGES`, of which too many pairs would be tested.
    """
    normals, outcomes = np.zeros((len(ids), 3)), np.empty(len(ids), dtype=np.int8)
    arrays = mesh.vertices, mesh.normals, mesh.ring_ptr, mesh.ring_indices, mesh.stops
    run_kernel(_find_planes, len(ids), *arrays, ids, rings, fewest_points, plane, normals, outcomes)
    return normals, outcomes


@allocating_jit()
def _find_planes(
    vertices: FloatArray,
    normals: FloatArray,
    ring_ptr: IntArray,
    ring_indices: IntArray,
    stops: BoolArray,
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
    flat = np.empty((MOST_EDGES + 1, 2))
    for k in range(start, stop):
        i = ids[k]
        count, _ = collect_ring(ring_ptr, ring_indices, stops, i, rings, visited, members)
        outcomes[k] = ILL_POSED
        if count < fewest_points or count > MOST_EDGES:
            continue
        for a in range(count):
            places[members[a]] = a
        edges = np.empty((_write_edges(ring_ptr, ring_indices, members, count, places, None), 2), np.int32)
        _write_edges(ring_ptr, ring_indices, members, count, places, edges)
        for a in range(count):
            places[members[a]] = -1
        outcomes[k] = FOLDED
        if plane == OTHER:
            nearest = -np.inf
            for a in range(1, 1 + ring_ptr[i + 1] - ring_ptr[i]):
                j = members[a]
                nx, ny, nz = normals[j, 0], normals[j, 1], normals[j, 2]
                cosine = nx * normals[i, 0] + ny * normals[i, 1] + nz * normals[i, 2]
                if cosine <= nearest or (nx == 0.0 and ny == 0.0 and nz == 0.0):
                    continue
                if not _cross(vertices, members, count, edges, flat, (nx, ny, nz)):
                    nearest = cosine
                    found[k, 0], found[k, 1], found[k, 2] = nx, ny, nz
                    outcomes[k] = FITTED
            continue
        nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
        if plane == MEAN:
            nx, ny, nz = mean_normal(normals, members, count)
        if nx == 0.0 and ny == 0.0 and nz == 0.0:
            continue
        if not _cross(vertices, members, count, edges, flat, (nx, ny, nz)):
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
    """Write the edges between members[:count], by their places, if there is room for them; return how many."""
    written = 0
    for a in range(count):
        j = members[a]
        if a > 0 and ring_ptr[j + 1] - ring_ptr[j] > MOST_EDGES:
            continue  # the others have its edges, too
        for q in range(ring_ptr[j], ring_ptr[j + 1]):
            b = places[ring_indices[q]]
            other = ring_indices[q]
            if b > a or (b > 0 and ring_ptr[other + 1] - ring_ptr[other] > MOST_EDGES):
                if edges is not None:
                    edges[written, 0], edges[written, 1] = a, b
                written += 1
    return written


@inner_jit()
def _cross(
    vertices: FloatArray, members: IntArray, count: int, edges: IntArray, flat: FloatArray, normal: Vector
) -> bool:
    """Whether two edges without a common end meet when projected along a unit normal."""
    nx, ny, nz = normal
    if abs(nx) <= abs(ny) and abs(nx) <= abs(nz):  # the x axis is the normal times the axis that is farthest from it
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
            if a != c and a != d and b != c and b != d and _meet(flat, a, b, c, d, ROUNDING * reach):
                return True
    return False


@inner_jit()
def _meet(flat: FloatArray, a: int, b: int, c: int, d: int, rounding: float) -> bool:
    """Whether two segments of the plane have a common point; areas no larger than `rounding` count as none."""
    for k in range(2):
        if max(flat[a, k], flat[b, k]) < min(flat[c, k], flat[d, k]):
            return False
        if max(flat[c, k], flat[d, k]) < min(flat[a, k], flat[b, k]):
            return False
    own = _side(flat, a, b, c, rounding) * _side(flat, a, b, d, rounding)
    return own <= 0 and _side(flat, c, d, a, rounding) * _side(flat, c, d, b, rounding) <= 0


@inner_jit()
def _side(flat: FloatArray, a: int, b: int, c: int, rounding: float) -> int:
    """On which side of the line from a to b a point is: 1 left, -1 right, 0 on it."""
    ux, uy, vx, vy = flat[b, 0] - flat[a, 0], flat[b, 1] - flat[a, 1], flat[c, 0] - flat[a, 0], flat[c, 1] - flat[a, 1]
    area = ux * vy - uy * vx
    return 1 if area > rounding else (-1 if area < -rounding else 0)
