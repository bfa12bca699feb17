"""Tangent planes: vertex normals, fold detection and the local x axis."""

from dataclasses import dataclass
from math import cos, radians, sin
from typing import TypeAlias

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray, SingleArray
from bezier_filters.meshes.adjacency import Adjacency
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.meshes.triangles import area_vector, unit_normal
from bezier_filters.runtime.jit import inner_jit, jit
from bezier_filters.runtime.parallel import run_kernel

Vector: TypeAlias = tuple[float, float, float]
MAX_FACE_TILT = radians(89.0)  # angle between a face and the plane beyond which the projection folds
FOLD_COSINE, MAX_TILT_SINE = cos(MAX_FACE_TILT), sin(MAX_FACE_TILT)
COSINE_ROUNDING = 2e-7  # larger than the rounding error of a bound up to 2 in single precision
NO_SAFE_COSINE = 2.0  # greater than any cosine: no direction is known to be safe
ZERO_AREA_COSINE = 3.0  # the same, at vertices whose faces all have zero area
NORMAL_SMOOTHING_ROUNDS = 4  # rounds of averaging noisy normals
MAX_TIED_EDGES = 256  # edges of equal length among which the neighbourhood decides
# relative difference below which lengths count as equal: far above rounding, far below irregularity
TIE_TOLERANCE = 1e-6


@dataclass(frozen=True)
class TangentPlanes:
    """Approximate tangent planes of all vertices."""

    # (n, 3): normalised mean of the unit normals of the faces at each vertex; zero without faces. Where all faces have
    # zero area, as at coincident vertices of marching cubes, it is the mean over the neighbours.
    normals: FloatArray
    # (n,): if the cosine between a direction and the normal is larger than this, no face at the vertex folds in the
    # projection along that direction; `NO_SAFE_COSINE` if no such bound is known
    safe_cosine: SingleArray


def tangent_planes(mesh: TriangleMesh, adjacency: Adjacency) -> TangentPlanes:
    """Tangent planes from the adjacent unit face normals, as in the paper."""
    of_faces = np.empty((mesh.face_count, 3))
    normals = np.zeros((mesh.vertex_count, 3))
    safe_cosine = np.full(mesh.vertex_count, NO_SAFE_COSINE, dtype=np.float32)
    rows = adjacency.faces
    run_kernel(_unit_face_normals, mesh.face_count, mesh.vertices, mesh.faces, of_faces)
    planes = of_faces, rows.indptr, rows.indices, normals, safe_cosine
    run_kernel(_vertex_planes, mesh.vertex_count, *planes)
    neighbours = adjacency.vertices
    run_kernel(_normals_without_area, mesh.vertex_count, neighbours.indptr, neighbours.indices, normals, safe_cosine)
    return TangentPlanes(normals, safe_cosine)


@inner_jit()
def face_normal(vertices: FloatArray, faces: IntArray, f: int) -> Vector:
    """Normal of face f, with twice its area as length."""
    return area_vector(vertices, faces[f, 0], faces[f, 1], faces[f, 2])


@inner_jit()
def unit_face_normal(vertices: FloatArray, faces: IntArray, f: int) -> Vector:
    """Unit normal of face f; zero if its area is zero."""
    x, y, z, _ = unit_normal(vertices, faces[f, 0], faces[f, 1], faces[f, 2])
    return x, y, z


def unit_face_normals(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Unit normals of faces, (m, 3); zero where the area is zero."""
    normals = np.empty((len(faces), 3))
    _unit_face_normals(vertices, faces, normals, 0, len(faces))
    return normals


@jit()
def _unit_face_normals(vertices: FloatArray, faces: IntArray, normals: FloatArray, start: int, stop: int) -> None:
    """Unit normals of faces start .. stop-1; zero where the area is zero."""
    for f in range(start, stop):
        normals[f, 0], normals[f, 1], normals[f, 2] = unit_face_normal(vertices, faces, f)


@jit()
def _vertex_planes(
    of_faces: FloatArray,
    face_ptr: IntArray,
    face_indices: IntArray,
    normals: FloatArray,
    safe_cosine: SingleArray,
    start: int,
    stop: int,
) -> None:
    """Normals of vertices start .. stop-1, and the bounds that their cones of face normals give."""
    for i in range(start, stop):
        x, y, z = 0.0, 0.0, 0.0
        for q in range(face_ptr[i], face_ptr[i + 1]):
            f = face_indices[q]
            x, y, z = x + of_faces[f, 0], y + of_faces[f, 1], z + of_faces[f, 2]
        length = np.sqrt(x * x + y * y + z * z)
        if length < 1e-9:  # no face, or faces that cancel out or have zero area
            if face_ptr[i + 1] > face_ptr[i]:
                has_area = False
                for q in range(face_ptr[i], face_ptr[i + 1]):
                    f = face_indices[q]
                    has_area = has_area or of_faces[f, 0] != 0.0 or of_faces[f, 1] != 0.0 or of_faces[f, 2] != 0.0
                safe_cosine[i] = NO_SAFE_COSINE if has_area else ZERO_AREA_COSINE
            continue
        x, y, z = x / length, y / length, z / length
        normals[i, 0], normals[i, 1], normals[i, 2] = x, y, z
        cosine = 1.0
        for q in range(face_ptr[i], face_ptr[i + 1]):
            f = face_indices[q]
            fx, fy, fz = of_faces[f, 0], of_faces[f, 1], of_faces[f, 2]
            if fx != 0.0 or fy != 0.0 or fz != 0.0:
                cosine = min(cosine, fx * x + fy * y + fz * z)
        # All face normals lie in a cone about the vertex normal; `cosine` is that of its half angle. A direction within
        # MAX_FACE_TILT minus the half angle of the normal sees all faces from the front.
        if cosine > FOLD_COSINE:
            bound = FOLD_COSINE * cosine + MAX_TILT_SINE * np.sqrt(1.0 - cosine * cosine)
            safe_cosine[i] = bound + COSINE_ROUNDING


@jit()
def _normals_without_area(
    ptr: IntArray, indices: IntArray, normals: FloatArray, safe_cosine: SingleArray, start: int, stop: int
) -> None:
    """Give vertices of start .. stop-1 whose faces have zero area the mean normal of their other neighbours."""
    for i in range(start, stop):
        if safe_cosine[i] != ZERO_AREA_COSINE:
            continue
        x, y, z = 0.0, 0.0, 0.0
        for q in range(ptr[i], ptr[i + 1]):
            j = indices[q]
            if safe_cosine[j] != ZERO_AREA_COSINE:  # another thread may be writing the normals of these
                x, y, z = x + normals[j, 0], y + normals[j, 1], z + normals[j, 2]
        length = np.sqrt(x * x + y * y + z * z)
        if length > 1e-9:
            normals[i, 0], normals[i, 1], normals[i, 2] = x / length, y / length, z / length


@inner_jit()
def fraction_flipped(normals: FloatArray, members: IntArray, count: int, nx: float, ny: float, nz: float) -> float:
    """Share of members[:count] with vertex normals more than `MAX_FACE_TILT` away from (nx, ny, nz).

    Noise folds single faces of a wide neighbourhood. Where the surface itself folds, the vertex normals
    of a whole region turn away.
    """
    turned = 0
    for a in range(count):
        j = np.uint32(members[a])
        if normals[j, 0] * nx + normals[j, 1] * ny + normals[j, 2] * nz <= FOLD_COSINE:
            turned += 1
    return turned / max(count, 1)


def smooth_normals(
    normals: FloatArray, adjacency_ptr: IntArray, neighbours: IntArray, barriers: BoolArray
) -> FloatArray:
    """Average unit normals (n, 3) over neighbours, `NORMAL_SMOOTHING_ROUNDS` times, but not across `barriers`.

    Noise of a third of an edge in all directions flips single normals; their mean over a neighbourhood stays reliable.
    """
    for _ in range(NORMAL_SMOOTHING_ROUNDS):
        before, normals = normals, np.empty_like(normals)
        run_kernel(_average_normals, len(normals), adjacency_ptr, neighbours, barriers, before, normals)
    return normals


@jit()
def _average_normals(
    ptr: IntArray, indices: IntArray, barriers: BoolArray, before: FloatArray, after: FloatArray, start: int, stop: int
) -> None:
    """Mean normals of vertices start .. stop-1 and their neighbours."""
    for i in range(start, stop):
        x, y, z = before[i, 0], before[i, 1], before[i, 2]
        if not barriers[i]:
            for q in range(ptr[i], ptr[i + 1]):
                j = indices[q]
                if not barriers[j]:
                    x, y, z = x + before[j, 0], y + before[j, 1], z + before[j, 2]
        length = np.sqrt(x * x + y * y + z * z)
        if length < 1e-9:  # the normals cancel out
            x, y, z, length = before[i, 0], before[i, 1], before[i, 2], 1.0
        after[i, 0], after[i, 1], after[i, 2] = x / length, y / length, z / length


@inner_jit()
def mean_normal(normals: FloatArray, members: IntArray, count: int) -> Vector:
    """Normalised mean of the normals of members[:count], zero if they cancel out."""
    x, y, z = 0.0, 0.0, 0.0
    for a in range(count):
        j = np.uint32(members[a])
        x, y, z = x + normals[j, 0], y + normals[j, 1], z + normals[j, 2]
    length = np.sqrt(x * x + y * y + z * z)
    if length < 1e-9:
        return 0.0, 0.0, 0.0
    return x / length, y / length, z / length


@jit()
def farthest_direction(
    vertices: FloatArray, members: IntArray, neighbours: int, count: int, nx: float, ny: float, nz: float
) -> Vector:
    """Unit projection of the neighbour that projects farthest from the center members[0].

    The paper points the x axis to any projected neighbour, and its fit depends on the choice.
    The farthest one follows from the geometry alone. Where several are equally far, as on
    regular meshes, the whole neighbourhood decides: see `_signature`. Directions with equal
    signatures see the same neighbourhood or its mirror image, and the first one wins.

    The first `count` members are the center, its neighbours, and the rest of the neighbourhood; (nx, ny, nz) is the
    unit normal of the plane. Zero if every neighbour projects onto the center.
    """
    bx, by, bz, farthest, second = farthest_edge(vertices, members, neighbours, nx, ny, nz)
    length = np.sqrt(farthest)
    if second <= (1.0 - TIE_TOLERANCE) * farthest:
        return (bx / length, by / length, bz / length) if farthest > 0.0 else (0.0, 0.0, 0.0)
    best = (-np.inf, -np.inf)
    tied = 0
    for a in range(1, neighbours + 1):
        x, y, z = _project_edge(vertices, members[0], members[a], nx, ny, nz)
        if x * x + y * y + z * z > (1.0 - TIE_TOLERANCE) * farthest:
            tied += 1
            if tied > MAX_TIED_EDGES:
                break
            x, y, z = x / length, y / length, z / length
            if tied == 1:
                bx, by, bz = x, y, z
                continue
            if tied == 2:
                best = _signature(vertices, members, count, length, (bx, by, bz), (nx, ny, nz))
            other = _signature(vertices, members, count, length, (x, y, z), (nx, ny, nz))
            if other[0] > best[0] + TIE_TOLERANCE or (
                other[0] > best[0] - TIE_TOLERANCE and other[1] > best[1] * (1.0 + TIE_TOLERANCE)
            ):
                bx, by, bz = x, y, z
                best = other
    return bx, by, bz


@inner_jit(inline="always")
def farthest_edge(
    vertices: FloatArray, members: IntArray, neighbours: int, nx: float, ny: float, nz: float
) -> tuple[float, float, float, float, float]:
    """The longest projected edge to a neighbour, its squared length, and that of the second longest."""
    bx, by, bz, farthest, second = 0.0, 0.0, 0.0, 0.0, 0.0
    for a in range(1, neighbours + 1):
        x, y, z = _project_edge(vertices, members[0], members[a], nx, ny, nz)
        square = x * x + y * y + z * z
        is_farther = square > farthest  # without an unpredictable branch
        bx, by, bz = (x if is_farther else bx), (y if is_farther else by), (z if is_farther else bz)
        second = max(second, min(square, farthest))
        farthest = max(farthest, square)
    return bx, by, bz, farthest, second


@inner_jit(inline="always")
def _project_edge(vertices: FloatArray, i: int, j: int, nx: float, ny: float, nz: float) -> Vector:
    """Tangential part of the edge from vertex i to vertex j."""
    x, y, z = vertices[j, 0] - vertices[i, 0], vertices[j, 1] - vertices[i, 1], vertices[j, 2] - vertices[i, 2]
    return tangential_part(x, y, z, nx, ny, nz)


@inner_jit(inline="always")
def tangential_part(x: float, y: float, z: float, nx: float, ny: float, nz: float) -> Vector:
    """Tangential part of a vector: its projection along a unit normal."""
    height = x * nx + y * ny + z * nz
    return x - height * nx, y - height * ny, z - height * nz


@inner_jit()
def _signature(
    vertices: FloatArray, members: IntArray, count: int, length: float, axis: Vector, normal: Vector
) -> tuple[float, float]:
    """Two moments of a neighbourhood about an axis, which do not depend on the numbering.

    With a the coordinate along the axis and h the height, the means of a^3 + a^4 and of a^2 h^2
    in units of `length`. They do not change if the normal is flipped.
    """
    i, (x, y, z), (nx, ny, nz) = members[0], axis, normal
    along, heights = 0.0, 0.0
    for k in range(1, count):
        j = members[k]
        dx, dy, dz = vertices[j, 0] - vertices[i, 0], vertices[j, 1] - vertices[i, 1], vertices[j, 2] - vertices[i, 2]
        a = (dx * x + dy * y + dz * z) / length
        h = (dx * nx + dy * ny + dz * nz) / length
        along += a * a * a + a * a * a * a
        heights += a * a * h * h
    return along / count, heights / count
