"""The hot loop: fits eight vertices at a time.

What meanders through the mesh is done for one vertex after the other: collecting the neighbourhood
and testing for folds. What is arithmetic is done for eight at once, see `lanes`. A neighbourhood with
fewer points than the others of its block is filled up with points that weigh nothing.
"""

from typing import Any

import numpy as np

from bezier_filters.arrays import BoolArray, ByteArray, FloatArray, IntArray
from bezier_filters.kernels.kernel_input import FITTED, KernelFit, KernelMesh
from bezier_filters.kernels.lane_algebra import (
    GROUP,
    add_moments,
    add_squared_residuals,
    differentiate,
    raise_powers,
    solve_lanes,
)
from bezier_filters.kernels.lane_frames import point_to_farthest
from bezier_filters.kernels.lane_results import write_block
from bezier_filters.kernels.lane_workspace import CHUNK, LaneWorkspace, lane_workspace
from bezier_filters.kernels.local_frames import write_axes, write_plane
from bezier_filters.kernels.uncertainty import StandardErrors
from bezier_filters.meshes.neighbourhoods import collect_ball, collect_ring
from bezier_filters.patches.jets import GraphGeometry
from bezier_filters.runtime.lanes import LANES, load, multiply_add, spread, square_root, store, where_greater
from bezier_filters.runtime.lean import inner_njit, lean_njit, variable
from bezier_filters.runtime.parallel import RangeTask

ROOM = 2
"""Times the points of a regular neighbourhood, of 1 + 3 k (k + 1), that there is room for at first,"""
FEWEST = 128
"""and how much room there is at least."""


def lane_task(
    mesh: KernelMesh,
    fit: KernelFit,
    ids: IntArray,
    result: GraphGeometry,
    errors: StandardErrors,
    residuals: FloatArray,
    rings_used: IntArray,
    outcomes: ByteArray,
) -> RangeTask:
    """Task for one thread: fit the vertices ids[start:stop]; write their geometry and outcomes[start:stop].

    The same as `scalar_kernel.scalar_task`, up to rounding, but without reweighting by residuals and condition numbers.
    """
    n = len(mesh.vertices)
    visited, members = np.zeros(n, dtype=np.bool_), np.empty(n + 1, dtype=np.int32)
    work = lane_workspace(fit, max(FEWEST, ROOM * 3 * fit.rings * (fit.rings + 1)))

    def run(start: int, stop: int) -> None:
        nonlocal work
        while start < stop:
            start, needed = fit_in_lanes(
                mesh,
                fit,
                ids,
                start,
                stop,
                visited,
                members,
                work,
                result,
                errors,
                residuals,
                rings_used,
                outcomes,
            )
            if start < stop:  # there a block needs more room, and is collected once more
                work = lane_workspace(fit, 2 * needed)

    return run


@lean_njit()
def fit_in_lanes(
    mesh: KernelMesh,
    fit: KernelFit,
    ids: IntArray,
    start: int,
    stop: int,
    visited: BoolArray,
    members: IntArray,
    work: LaneWorkspace,
    result: GraphGeometry,
    errors: StandardErrors,
    residuals: FloatArray,
    rings_used: IntArray,
    outcomes: ByteArray,
) -> tuple[int, int]:
    """Fit the vertices ids[start:stop] as far as there is room; return how far, and the room that is needed next."""
    capacity = work.points.shape[0] // (4 * LANES)
    for first in range(start, stop, LANES):
        block = ids[first : min(first + LANES, stop)]
        of_block = outcomes[first : min(first + LANES, stop)]
        most, needed = _collect(mesh, fit, block, visited, members, capacity, work, of_block)
        if needed > capacity:
            return first, needed
        if most == 0:
            continue
        _mark_presence(work.counts, most, capacity, work.points)
        if not fit.any_axis:
            point_to_farthest(work.points, capacity, work.counts, work.neighbours, work.total, work.frame)
        _project(fit.square, capacity, most, work)
        _fit_heights(fit, capacity, most, work)
        write_block(fit, mesh.origin, block, work, of_block, result, errors, residuals, rings_used)
    return stop, 0


@inner_njit()
def _collect(
    mesh: KernelMesh,
    fit: KernelFit,
    block: IntArray,
    visited: BoolArray,
    members: IntArray,
    capacity: int,
    work: LaneWorkspace,
    outcomes: ByteArray,
) -> tuple[int, int]:
    """Collect the neighbourhoods of a block and choose their planes; return their most points and the capacity needed.

    A lane whose vertex has no frame, or that has no vertex, is left without points.
    """
    most, rings = 0, work.rings
    store(work.counts, 0, spread(0.0))
    store(work.neighbours, 0, spread(0.0))
    for lane in range(block.shape[0]):
        i = block[lane]
        if fit.radius > 0.0:
            count, inner, neighbours, rings[lane] = collect_ball(
                mesh.vertices, mesh.ring_ptr, mesh.ring_indices, mesh.stops, i, fit.radius, visited, members
            )
        else:
            count, inner = collect_ring(mesh.ring_ptr, mesh.ring_indices, mesh.stops, i, fit.rings, visited, members)
            neighbours, rings[lane] = mesh.ring_ptr[i + 1] - mesh.ring_ptr[i], fit.rings
        if count + GROUP > capacity:
            return most, count + GROUP
        outcome = write_plane(mesh, fit, members, count, inner, work.one_frame)
        if outcome == FITTED and fit.any_axis:
            outcome = write_axes(mesh, fit, members, count, neighbours, work.one_frame)
        outcomes[lane] = outcome
        if outcome == FITTED:
            _gather(mesh.vertices, members, count, lane, capacity, work)
            work.counts[lane], work.neighbours[lane] = count, neighbours
            most = max(most, count)
    return most, capacity


@inner_njit()
def _gather(vertices: FloatArray, members: IntArray, count: int, lane: int, stride: int, work: LaneWorkspace) -> None:
    """Write the edges from members[0] and the frame of one neighbourhood to its lane."""
    points, i = work.points, members[0]
    x, y, z = vertices[i, 0], vertices[i, 1], vertices[i, 2]
    row = LANES * stride
    for p in range(count):
        j, place = np.uint32(members[p]), LANES * p + lane
        points[place] = vertices[j, 0] - x
        points[place + row] = vertices[j, 1] - y
        points[place + 2 * row] = vertices[j, 2] - z
    for k in range(9):
        work.frame[LANES * k + lane] = work.one_frame[k]


@inner_njit()
def _mark_presence(counts: FloatArray, most: int, stride: int, points: FloatArray) -> None:
    """Tell points from what weighs nothing and lies on the vertex itself, up to a full group of points."""
    zero, one = spread(0.0), spread(1.0)
    for p in range(most + GROUP):
        presence = where_greater(load(counts, 0), spread(np.float64(p)), one, zero)
        store(points, 3 * stride + p, presence)
        for row in range(3):
            store(points, row * stride + p, where_greater(presence, zero, load(points, row * stride + p), zero))


@inner_njit()
def _project(square: bool, stride: int, count: int, work: LaneWorkspace) -> None:
    """Turn edges into parameters and heights; the parameters of a rectangle without area are not finite."""
    points, frame, box = work.points, work.frame, work.box
    low_x, high_x, low_y, high_y, radius = spread(0.0), spread(0.0), spread(0.0), spread(0.0), spread(0.0)
    for p in range(count):
        dx, dy, dz = load(points, p), load(points, stride + p), load(points, 2 * stride + p)
        x = multiply_add(dx, load(frame, 0), multiply_add(dy, load(frame, 1), dz * load(frame, 2)))
        y = multiply_add(dx, load(frame, 3), multiply_add(dy, load(frame, 4), dz * load(frame, 5)))
        z = multiply_add(dx, load(frame, 6), multiply_add(dy, load(frame, 7), dz * load(frame, 8)))
        store(points, p, x)
        store(points, stride + p, y)
        store(points, 2 * stride + p, z)
        low_x, high_x = where_greater(low_x, x, x, low_x), where_greater(x, high_x, x, high_x)
        low_y, high_y = where_greater(low_y, y, y, low_y), where_greater(y, high_y, y, high_y)
        distance = multiply_add(x, x, y * y)
        radius = where_greater(distance, radius, distance, radius)
    if square:
        high_x = square_root(radius)
        low_x = spread(0.0) - high_x
        low_y, high_y = low_x, high_x
    half, two = spread(0.5), spread(2.0)
    middle_x, scale_x = half * (low_x + high_x), two / (high_x - low_x)
    middle_y, scale_y = half * (low_y + high_y), two / (high_y - low_y)
    store(box, 0, middle_x)
    store(box, 1, scale_x)
    store(box, 2, middle_y)
    store(box, 3, scale_y)
    for p in range(count + GROUP):
        store(points, p, (load(points, p) - middle_x) * scale_x)
        store(points, stride + p, (load(points, stride + p) - middle_y) * scale_y)


@inner_njit()
def _fit_heights(fit: KernelFit, stride: int, count: int, work: LaneWorkspace) -> None:
    """Find the coefficients, the residual and the derivatives at the vertex."""
    _sum_moments(fit, stride, count, work)
    order = fit.exponents.shape[0]
    _set_up(fit, order, work)
    solve_lanes(work.matrix, order, fit.smallest_pivot, work.solution, work.sound)
    for k in range(order):
        store(work.coefficients, fit.lexicographic[k], load(work.solution, k))
    zero, one = spread(0.0), spread(1.0)
    store(work.total, 0, zero)
    add_squared_residuals(work.coefficients, fit.starts, work.points, stride, count, work.total)
    rows = fit.highest_power + 1
    for axis in range(2):
        at_vertex = (zero - load(work.box, 2 * axis)) * load(work.box, 2 * axis + 1)
        power = one
        for k in range(rows):
            store(work.origin, axis * rows + k, power)
            power = power * at_vertex
    differentiate(work.solution, fit.exponents, work.origin, work.origin[LANES * rows :], work.jets)
    scale_r = one
    for r in range(4):
        scale = scale_r
        for q in range(4 - r):
            store(work.jets, 4 * r + q, load(work.jets, 4 * r + q) * scale)
            scale = scale * load(work.box, 3)
        scale_r = scale_r * load(work.box, 1)


@inner_njit()
def _sum_moments(fit: KernelFit, stride: int, count: int, work: LaneWorkspace) -> None:
    """Sum the products of powers over the points, without and with the height, chunk by chunk."""
    zero, one = spread(0.0), spread(1.0)
    for k in range(fit.moment_starts[-1]):
        store(work.moments, k, zero)
    for k in range(fit.starts[-1]):
        store(work.heights, k, zero)
    chunks = (count + CHUNK - 1) // CHUNK
    size = (count + chunks - 1) // chunks
    s, t, z, presence = 0, stride, 2 * stride, 3 * stride
    for begin in range(0, count, size):
        here = min(size, count - begin)
        for p in range(here):
            q = begin + p
            a, b = load(work.points, s + q), load(work.points, t + q)
            weight = load(work.points, presence + q)
            if fit.weight_scale > 0.0:
                weight = weight * _weight(fit, a, b, load(work.box, 1))
            store(work.left, p, weight)
            store(work.left, CHUNK + p, a)
            store(work.right, p, one)
            store(work.right, CHUNK + p, b)
        raise_powers(work.left, CHUNK, here, fit.highest_power)
        raise_powers(work.right, CHUNK, here, fit.highest_power)
        for b in range(fit.highest_power // 2 + 1):
            for p in range(here):
                store(work.lifted, b * CHUNK + p, load(work.right, b * CHUNK + p) * load(work.points, z + begin + p))
        add_moments(work.left, work.right, variable(CHUNK), here, fit.moment_starts, work.moments)
        add_moments(work.left, work.lifted, variable(CHUNK), here, fit.starts, work.heights)


@inner_njit()
def _weight(fit: KernelFit, a: Any, b: Any, scale: Any) -> Any:
    """Lanes of the distance weights of points with parameters a, b on squares of `scale` per length."""
    ratio = spread(fit.weight_scale) * (a * a + b * b) / (scale * scale)
    power = ratio
    for _ in range(fit.weight_power - 1):
        power = power * ratio
    return spread(1.0) / (spread(1.0) + power)


@inner_njit()
def _set_up(fit: KernelFit, order: int, work: LaneWorkspace) -> None:
    """Set up the normal equations, with the moments of the heights as the last row."""
    for k in range(fit.moment_place.shape[0]):
        store(work.matrix, k, load(work.moments, fit.moment_place[k]) + spread(fit.penalty[k]))
    degree, scale = 0, spread(1.0)
    for k in range(fit.prior.shape[0]):
        while degree < fit.prior_degree[k]:  # from units of length to those of this neighbourhood
            degree += 1
            scale = scale * load(work.box, 1) * load(work.box, 1)
        place = fit.prior_place[k]
        store(work.matrix, place, multiply_add(spread(fit.prior[k]), scale, load(work.matrix, place)))
    last = order * (order + 1) // 2
    for k in range(order):
        store(work.matrix, last + k, load(work.heights, fit.lexicographic[k]))
