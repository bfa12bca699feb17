"""The frame over which a neighbourhood is a height field, if it is one.

Its plane is chosen vertex by vertex. So is its x axis where any will do; otherwise it points to the farthest
neighbour, for eight vertices at a time, by the rules of `frames.farthest_direction`.
"""

import numpy as np

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.kernels.fit_workspace import FitWorkspace
from bezier_filters.kernels.kernel_input import FITTED, FOLDED, ILL_POSED, NO_FRAME, KernelFit, KernelMesh
from bezier_filters.meshes.frames import (
    FOLD_COSINE,
    TIE,
    direction_to,
    farthest_direction,
    mean_normal,
    turned_share,
    unit_face_normal,
)
from bezier_filters.runtime.jit import inner_jit, variable
from bezier_filters.runtime.lanes import LANES, Lanes, load, multiply_add, spread, square_root, store, where_greater


@inner_jit()
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
        folded = folds(mesh, members, inner, nx, ny, nz)
    if folded:
        return FOLDED
    frame[6], frame[7], frame[8] = nx, ny, nz
    return FITTED


@inner_jit()
def folds(mesh: KernelMesh, members: IntArray, count: int, nx: float, ny: float, nz: float) -> bool:
    """Whether a face at members[:count] folds or stands on edge when projected along (nx, ny, nz)."""
    normals = mesh.normals
    for a in range(count):
        j = np.uint32(members[a])
        if normals[j, 0] * nx + normals[j, 1] * ny + normals[j, 2] * nz > mesh.safe_cosine[j]:
            continue
        for q in range(mesh.face_ptr[j], mesh.face_ptr[j + 1]):
            fx, fy, fz = unit_face_normal(mesh.vertices, mesh.faces, variable(mesh.face_indices[q]))
            if fx * nx + fy * ny + fz * nz <= FOLD_COSINE and (fx != 0.0 or fy != 0.0 or fz != 0.0):
                return True
    return False


@inner_jit()
def write_any_axes(mesh: KernelMesh, members: IntArray, count: int, neighbours: int, frame: FloatArray) -> int:
    """Write x and y axes, any that there are, of the local frame of members[0] before its z axis; return the outcome.

    `neighbours` of the `count` members, after the first, share an edge with it.
    """
    i = members[0]
    nx, ny, nz = frame[6], frame[7], frame[8]
    xx, xy, xz = 0.0, 0.0, 0.0
    if neighbours > 0:
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


@inner_jit()
def point_to_farthest(stride: int, work: FitWorkspace) -> None:
    """Write the x and y axes of frames whose z axes are known; zeros where every neighbour projects onto the vertex.

    The points are edges from the vertices to the points of their neighbourhoods, in rows x, y, z of `stride` entries;
    the first are the neighbours, after the vertex itself. What is no point at all is zero.
    """
    frame, tied = work.frame, work.total
    most_points, most_neighbours = _largest(work.counts), _largest(work.neighbours)
    zero, share = spread(0.0), spread(1.0 - TIE)
    farthest, second, bx, by, bz = zero, zero, zero, zero, zero
    # The second farthest, too: only where it is as far, on lattices mostly, the costly rules for ties are needed.
    for p in range(1, most_neighbours + 1):
        x, y, z, square = _projected(stride, work, p)
        second = where_greater(square, farthest, farthest, where_greater(square, second, square, second))
        bx = where_greater(square, farthest, x, bx)
        by = where_greater(square, farthest, y, by)
        bz = where_greater(square, farthest, z, bz)
        farthest = where_greater(square, farthest, square, farthest)
    scale = where_greater(farthest, zero, spread(1.0) / square_root(farthest), zero)
    store(frame, 0, bx * scale)
    store(frame, 1, by * scale)
    store(frame, 2, bz * scale)
    store(tied, 0, where_greater(second, share * farthest, spread(1.0), zero))
    if _largest(tied) > 0:
        _break_ties(stride, work, most_points, most_neighbours, farthest, scale)
    xx, xy, xz = load(frame, 0), load(frame, 1), load(frame, 2)
    nx, ny, nz = load(frame, 6), load(frame, 7), load(frame, 8)
    rest = multiply_add(xx, nx, multiply_add(xy, ny, xz * nz))  # of the part along the normal, if that was nearly all
    xx, xy, xz = xx - rest * nx, xy - rest * ny, xz - rest * nz
    square = multiply_add(xx, xx, multiply_add(xy, xy, xz * xz))
    scale = where_greater(square, zero, spread(1.0) / square_root(square), zero)
    xx, xy, xz = xx * scale, xy * scale, xz * scale
    store(frame, 0, xx)
    store(frame, 1, xy)
    store(frame, 2, xz)
    store(frame, 3, ny * xz - nz * xy)
    store(frame, 4, nz * xx - nx * xz)
    store(frame, 5, nx * xy - ny * xx)


@inner_jit()
def _largest(lanes: FloatArray) -> int:
    """The largest of eight numbers, as an integer."""
    result = 0.0
    for lane in range(LANES):
        result = max(result, lanes[lane])
    return int(result)


@inner_jit()
def _projected(stride: int, work: FitWorkspace, p: int) -> tuple[Lanes, Lanes, Lanes, Lanes]:
    """Lanes of edge p without its part along the normal, and of its squared length; -1 for what is no neighbour."""
    points, frame = work.points, work.frame
    nx, ny, nz = load(frame, 6), load(frame, 7), load(frame, 8)
    x, y, z = load(points, p), load(points, stride + p), load(points, 2 * stride + p)
    height = multiply_add(x, nx, multiply_add(y, ny, z * nz))
    x, y, z = x - height * nx, y - height * ny, z - height * nz
    square = multiply_add(x, x, multiply_add(y, y, z * z))
    return x, y, z, where_greater(spread(np.float64(p)), load(work.neighbours, 0), spread(-1.0), square)


@inner_jit()
def _break_ties(
    stride: int, work: FitWorkspace, most_points: int, most_neighbours: int, farthest: Lanes, scale: Lanes
) -> None:
    """Choose among equally far neighbours by how the whole neighbourhood lies: see `frames.farthest_direction`."""
    points, frame = work.points, work.frame
    zero, one, share, tie = spread(0.0), spread(1.0), spread(1.0 - TIE), spread(TIE)
    nx, ny, nz = load(frame, 6), load(frame, 7), load(frame, 8)
    bx, by, bz = load(frame, 0), load(frame, 1), load(frame, 2)
    best_along, best_heights = spread(-np.inf), spread(-np.inf)
    for p in range(1, most_neighbours + 1):
        x, y, z, square = _projected(stride, work, p)
        x, y, z = x * scale, y * scale, z * scale
        along, heights = zero, zero
        for k in range(1, most_points):
            dx, dy, dz = load(points, k), load(points, stride + k), load(points, 2 * stride + k)
            a = multiply_add(dx, x, multiply_add(dy, y, dz * z)) * scale
            h = multiply_add(dx, nx, multiply_add(dy, ny, dz * nz)) * scale
            along = multiply_add(a * a * a, one + a, along)
            heights = multiply_add(a * a, h * h, heights)
        along, heights = along / load(work.counts, 0), heights / load(work.counts, 0)
        # First the moments along the axis, then those of the heights; within rounding, the first neighbour stays.
        better = where_greater(heights, best_heights * (one + tie), one, zero)
        better = where_greater(along, best_along - tie, better, zero)
        better = where_greater(along, best_along + tie, one, better)
        better = where_greater(square, share * farthest, better, zero)
        bx, by, bz = (
            where_greater(better, zero, x, bx),
            where_greater(better, zero, y, by),
            where_greater(better, zero, z, bz),
        )
        best_along = where_greater(better, zero, along, best_along)
        best_heights = where_greater(better, zero, heights, best_heights)
    store(frame, 0, bx)
    store(frame, 1, by)
    store(frame, 2, bz)
