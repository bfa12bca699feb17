"""The frame over which a neighbourhood is a height field, if it is one."""

import numpy as np

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.kernels.kernel_input import FITTED, FOLDED, ILL_POSED, NO_FRAME, KernelFit, KernelMesh
from bezier_filters.meshes.frames import direction_to, farthest_direction, folds, mean_normal, turned_share
from bezier_filters.runtime.lean import inner_njit


@inner_njit()
def write_plane(mesh: KernelMesh, fit: KernelFit, members: IntArray, count: int, inner: int, frame: FloatArray) -> int:
    """Write the z axis of the local frame of members[0] into the last third of frame (9,); return the outcome so far.

    `inner` of the `count` members must not fold.
    """
    i = members[0]
    nx, ny, nz = mesh.normals[i, 0], mesh.normals[i, 1], mesh.normals[i, 2]
    if fit.mean_plane:
        nx, ny, nz = mean_normal(mesh.normals, members, count)
    if nx == 0.0 and ny == 0.0 and nz == 0.0:
        return NO_FRAME
    if count < fit.fewest_points:
        return ILL_POSED
    if fit.most_turned >= 0.0:
        folded = turned_share(mesh.normals, members, inner, nx, ny, nz) > fit.most_turned
    else:
        folded = folds(
            mesh.vertices,
            mesh.faces,
            mesh.face_ptr,
            mesh.face_indices,
            mesh.normals,
            mesh.safe_cosine,
            members,
            inner,
            nx,
            ny,
            nz,
        )
    if folded:
        return FOLDED
    frame[6], frame[7], frame[8] = nx, ny, nz
    return FITTED


@inner_njit()
def write_axes(
    mesh: KernelMesh, fit: KernelFit, members: IntArray, count: int, neighbours: int, frame: FloatArray
) -> int:
    """Write the x and y axes of the local frame of members[0], before its z axis; return the outcome so far.

    `neighbours` of the `count` members, after the first, share an edge with it.
    """
    i = members[0]
    nx, ny, nz = frame[6], frame[7], frame[8]
    xx, xy, xz = 0.0, 0.0, 0.0
    if fit.any_axis and neighbours > 0:
        xx, xy, xz = direction_to(mesh.vertices, i, members[1], nx, ny, nz)
    if xx == 0.0 and xy == 0.0 and xz == 0.0:
        xx, xy, xz = farthest_direction(mesh.vertices, members, neighbours, count, nx, ny, nz)
    if xx == 0.0 and xy == 0.0 and xz == 0.0:
        return ILL_POSED
    rest = xx * nx + xy * ny + xz * nz  # of the edge's part along the normal, if that is nearly all of it
    xx, xy, xz = xx - rest * nx, xy - rest * ny, xz - rest * nz
    length = np.sqrt(xx * xx + xy * xy + xz * xz)
    xx, xy, xz = xx / length, xy / length, xz / length
    frame[0], frame[1], frame[2] = xx, xy, xz
    frame[3], frame[4], frame[5] = ny * xz - nz * xy, nz * xx - nx * xz, nx * xy - ny * xx
    return FITTED
