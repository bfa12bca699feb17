"""Local frames of neighbourhoods: the plane over which a neighbourhood is a height field, and the axes in it."""

import numpy as np

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.kernels.kernel_input import (
    FITTED,
    FOLDED_OVER,
    ILL_POSED,
    MAX_VALENCE,
    NO_FRAME,
    KernelFit,
    KernelMesh,
)
from bezier_filters.meshes.frames import (
    FOLD_COSINE,
    TIE_TOLERANCE,
    Vector,
    farthest_direction,
    farthest_edge,
    fraction_flipped,
    mean_normal,
    tangential_part,
    unit_face_normal,
)
from bezier_filters.runtime.jit import inner_jit, opaque
from bezier_filters.runtime.lanes import broadcast, load, multiply_add, square_root, store


@inner_jit(inline="always")
def write_plane(
    mesh: KernelMesh, fit: KernelFit, members: IntArray, count: int, inner: int, neighbours: int, frame: FloatArray
) -> int:
    """Write the z axis of the local frame of members[0] into the last third of frame (9,); return the outcome.

    The first `inner` of the `count` members must not fold over; `neighbours`, after the first, share an edge with it.
    """
    i = members[0]
    nx, ny, nz = mesh.normals[i, 0], mesh.normals[i, 1], mesh.normals[i, 2]
    if fit.mean_plane:
        nx, ny, nz = mean_normal(mesh.normals, members, count)
    if nx == 0.0 and ny == 0.0 and nz == 0.0:
        return NO_FRAME
    if count < fit.fewest_points:
        return ILL_POSED
    if fit.other_plane:
        nx, ny, nz = neighbour_normal(mesh, members, inner, neighbours)
        folded = nx == 0.0 and ny == 0.0 and nz == 0.0
    elif fit.max_flipped_fraction >= 0.0:
        folded = fraction_flipped(mesh.normals, members, inner, nx, ny, nz) > fit.max_flipped_fraction
    else:
        folded = folds(mesh, members, inner, nx, ny, nz)
    if folded:
        return FOLDED_OVER
    frame[6], frame[7], frame[8] = nx, ny, nz
    return FITTED


@inner_jit(inline="always")
def folds(mesh: KernelMesh, members: IntArray, count: int, nx: float, ny: float, nz: float) -> bool:
    """Whether a face at members[:count] folds over or is vertical when projected along (nx, ny, nz)."""
    normals = mesh.normals
    for a in range(count):
        j = np.uint32(members[a])
        if a > 0 and mesh.face_ptr[j + 1] - mesh.face_ptr[j] > MAX_VALENCE:
            continue  # its faces near the first vertex also belong to other members
        if normals[j, 0] * nx + normals[j, 1] * ny + normals[j, 2] * nz > mesh.safe_cosine[j]:
            continue
        for q in range(mesh.face_ptr[j], mesh.face_ptr[j + 1]):
            fx, fy, fz = unit_face_normal(mesh.vertices, mesh.faces, opaque(mesh.face_indices[q]))
            if fx * nx + fy * ny + fz * nz <= FOLD_COSINE and (fx != 0.0 or fy != 0.0 or fz != 0.0):
                return True
    return False


@inner_jit()
def neighbour_normal(mesh: KernelMesh, members: IntArray, count: int, neighbours: int) -> Vector:
    """Normal of a neighbour over whose plane members[:count] do not fold, closest to that of members[0]; or zero."""
    normals, i = mesh.normals, members[0]
    best, nearest = -1, -np.inf
    for a in range(1, min(neighbours, MAX_VALENCE) + 1):
        j = members[a]
        nx, ny, nz = normals[j, 0], normals[j, 1], normals[j, 2]
        cosine = nx * normals[i, 0] + ny * normals[i, 1] + nz * normals[i, 2]
        if cosine > nearest and (nx != 0.0 or ny != 0.0 or nz != 0.0) and not folds(mesh, members, count, nx, ny, nz):
            best, nearest = j, cosine
    return (normals[best, 0], normals[best, 1], normals[best, 2]) if best >= 0 else (0.0, 0.0, 0.0)


@inner_jit(inline="always")
def write_edge(
    mesh: KernelMesh, any_axis: bool, members: IntArray, count: int, neighbours: int, frame: FloatArray
) -> int:
    """Write a vector along the x axis of the local frame of members[0], before the z axis; return the outcome.

    `neighbours` of the `count` members, after the first, share an edge with it. If the result does not depend on the
    axis, x points to the first of them. Otherwise it is the given direction, or that of the farthest neighbour. If
    these project to the vertex itself, or are tied, x points in the direction of the farthest point.
    """
    nx, ny, nz = frame[6], frame[7], frame[8]
    i, seen = members[0], min(neighbours, 1) if any_axis else neighbours
    x, y, z, farthest, second = farthest_edge(mesh.vertices, members, seen, nx, ny, nz)
    if not any_axis and mesh.x_axes.shape[0] > 0:
        x, y, z = tangential_part(mesh.x_axes[i, 0], mesh.x_axes[i, 1], mesh.x_axes[i, 2], nx, ny, nz)
        farthest, second = x * x + y * y + z * z, 0.0
    if farthest == 0.0 or second > (1.0 - TIE_TOLERANCE) * farthest:
        x, y, z = farthest_direction(mesh.vertices, members, neighbours, count, nx, ny, nz)
    frame[0], frame[1], frame[2] = x, y, z
    return ILL_POSED if x == 0.0 and y == 0.0 and z == 0.0 else FITTED


@inner_jit()
def complete_axes(frame: FloatArray) -> None:
    """Orthonormalise the x axes of eight frames (Gram-Schmidt, twice) and add the y axes."""
    nx, ny, nz = load(frame, 6), load(frame, 7), load(frame, 8)
    x, y, z = load(frame, 0), load(frame, 1), load(frame, 2)
    for _ in range(2):  # twice: some edges are nearly parallel to the normal
        per_length = broadcast(1.0) / square_root(multiply_add(x, x, multiply_add(y, y, z * z)))
        x, y, z = x * per_length, y * per_length, z * per_length
        rest = multiply_add(x, nx, multiply_add(y, ny, z * nz))
        x, y, z = x - rest * nx, y - rest * ny, z - rest * nz
    store(frame, 0, x)
    store(frame, 1, y)
    store(frame, 2, z)
    store(frame, 3, ny * z - nz * y)
    store(frame, 4, nz * x - nx * z)
    store(frame, 5, nx * y - ny * x)
