"""The hot loop: fits eight vertices at a time.

What meanders through the mesh is done for one vertex after the other: collecting the neighbourhood,
choosing its frame, writing its geometry. What is arithmetic is done for eight at once, see `lanes`. A
neighbourhood with fewer points than the others of its block is filled up with points that weigh nothing.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.jets import GraphGeometry, write_displacement, write_extremalities, write_graph_geometry
from bezier_filters.kernel_input import FITTED, ILL_POSED, KernelFit, KernelMesh
from bezier_filters.lane_algebra import (
    GROUP,
    add_moments,
    add_squared_residuals,
    differentiate,
    raise_powers,
    solve_lanes,
)
from bezier_filters.lanes import LANES, aligned, load, multiply_add, spread, square_root, store, where_greater
from bezier_filters.lean import lean_njit
from bezier_filters.local_frames import write_frame
from bezier_filters.neighbourhoods import collect_ball, collect_ring
from bezier_filters.uncertainty import SEEN, StandardErrors, last_corner, write_standard_errors

CHUNK = 32
"""Most points whose powers are held at a time: they fit into the nearest cache."""
ROOM = 2
"""Times the points of a regular neighbourhood, of 1 + 3 k (k + 1), that there is room for at first,"""
FEWEST = 128
"""and how much room there is at least."""


class LaneWorkspace(NamedTuple):
    """Scratch arrays for one block; all but the last four are flat arrays of lanes."""

    points: FloatArray  # table with rows x, y, height, presence; then s, t, height, presence
    frame: FloatArray  # (9): x, y and z axes
    box: FloatArray  # (4): middle and reciprocal half width of the parameter rectangle along x, then y
    left: FloatArray  # table of the powers of s times the weights
    right: FloatArray  # table of the powers of t
    lifted: FloatArray  # table of those times the height
    moments: FloatArray
    heights: FloatArray  # moments with the height
    matrix: FloatArray
    solution: FloatArray
    coefficients: FloatArray  # the solution in lexicographic order
    sound: FloatArray  # (1)
    total: FloatArray  # (1): sum of the squared residuals
    origin: FloatArray  # table with 2 rows of powers: s and t of the vertex
    jets: FloatArray  # (16)
    one_frame: FloatArray  # (9,): of one vertex
    one_jet: FloatArray  # (4, 4)
    corner: FloatArray  # (SEEN (SEEN + 1) / 2,)
    sensitivities: FloatArray  # (4, SEEN)


@njit(cache=True, nogil=True)
def _workspace(fit: KernelFit, capacity: int) -> LaneWorkspace:
    """Scratch arrays for neighbourhoods of up to `capacity` points."""
    order, rows = fit.exponents.shape[0], fit.highest_power + 1
    return LaneWorkspace(
        aligned(4 * capacity),
        aligned(9),
        aligned(4),
        aligned(rows * CHUNK),
        aligned((rows + GROUP) * CHUNK),
        aligned((fit.highest_power // 2 + 1 + GROUP) * CHUNK),
        aligned(fit.moment_place.max() + 1 + GROUP),
        aligned(order + GROUP),
        aligned((order + 1 + GROUP) * (order + 2 + GROUP) // 2),
        aligned(order),
        aligned(order),
        aligned(1),
        aligned(1),
        aligned(2 * rows),
        aligned(16),
        np.empty(9),
        np.zeros((4, 4)),
        np.empty(SEEN * (SEEN + 1) // 2),
        np.empty((4, SEEN)),
    )


@njit(cache=True, nogil=True, error_model="numpy")
def fit_in_lanes(
    mesh: KernelMesh,
    fit: KernelFit,
    ids: IntArray,
    start: int,
    stop: int,
    visited: IntArray,
    members: IntArray,
    result: GraphGeometry,
    errors: StandardErrors,
    residuals: FloatArray,
    rings_used: IntArray,
    outcomes: IntArray,
) -> None:
    """Fit the vertices ids[start:stop]; write their geometry and outcomes[start:stop].

    The same as `scalar_kernel.fit_vertices`, up to rounding, but without reweighting by residuals.
    """
    capacity = max(FEWEST, ROOM * 3 * fit.rings * (fit.rings + 1))
    work = _workspace(fit, capacity)
    counts, rings = np.zeros(LANES, np.int32), np.zeros(LANES, np.int32)
    for first in range(start, stop, LANES):
        block = ids[first : min(first + LANES, stop)]
        of_block = outcomes[first : min(first + LANES, stop)]
        while True:
            needed = _collect(mesh, fit, block, visited, members, capacity, work, counts, rings, of_block)
            if needed <= capacity:
                break
            visited[:] = -1  # the block is collected once more
            capacity = 2 * needed
            work = _workspace(fit, capacity)
        if counts.max() == 0:
            continue
        _project(fit.square, capacity, counts.max(), work)
        _fit_heights(fit, capacity, counts.max(), work)
        _write_block(fit, block, work, counts, rings, of_block, result, errors, residuals, rings_used)


@lean_njit()
def _collect(
    mesh: KernelMesh,
    fit: KernelFit,
    block: IntArray,
    visited: IntArray,
    members: IntArray,
    capacity: int,
    work: LaneWorkspace,
    counts: IntArray,
    rings: IntArray,
    outcomes: IntArray,
) -> int:
    """Collect the neighbourhoods of a block and choose their frames; return the capacity that this needs.

    A lane whose vertex has no frame, or that has no vertex, is left without points.
    """
    most = 0
    for lane in range(LANES):
        counts[lane] = 0
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
            return count + GROUP
        outcomes[lane] = write_frame(mesh, fit, members, count, inner, neighbours, work.one_frame)
        if outcomes[lane] == FITTED:
            _gather(mesh.vertices, members, count, lane, capacity, work)
            counts[lane] = count
            most = max(most, count)
    _fill_up(counts, most, capacity, work.points)
    return capacity


@lean_njit()
def _gather(vertices: FloatArray, members: IntArray, count: int, lane: int, stride: int, work: LaneWorkspace) -> None:
    """Write the edges from members[0] and the frame of one neighbourhood to its lane."""
    points, i = work.points, members[0]
    x, y, z = vertices[i, 0], vertices[i, 1], vertices[i, 2]
    row = LANES * stride
    for p in range(count):
        j, place = members[p], LANES * p + lane
        points[place] = vertices[j, 0] - x
        points[place + row] = vertices[j, 1] - y
        points[place + 2 * row] = vertices[j, 2] - z
        points[place + 3 * row] = 1.0
    for k in range(9):
        work.frame[LANES * k + lane] = work.one_frame[k]


@lean_njit()
def _fill_up(counts: IntArray, most: int, stride: int, points: FloatArray) -> None:
    """Put what weighs nothing on the vertex itself, up to a full group of points."""
    for lane in range(LANES):
        for row in range(4):
            for p in range(counts[lane], most + GROUP):
                points[LANES * (row * stride + p) + lane] = 0.0


@lean_njit()
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


@lean_njit()
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


@lean_njit()
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
        add_moments(work.left, work.right, CHUNK, here, fit.moment_starts, work.moments)
        add_moments(work.left, work.lifted, CHUNK, here, fit.starts, work.heights)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _weight(fit, a, b, scale):  # type: ignore[no-untyped-def]
    """Lanes of the distance weights of points with parameters a, b on squares of `scale` per length."""
    ratio = spread(fit.weight_scale) * (a * a + b * b) / (scale * scale)
    power = ratio
    for _ in range(fit.weight_power - 1):
        power = power * ratio
    return spread(1.0) / (spread(1.0) + power)


@lean_njit()
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


@lean_njit()
def _write_block(
    fit: KernelFit,
    block: IntArray,
    work: LaneWorkspace,
    counts: IntArray,
    rings: IntArray,
    outcomes: IntArray,
    result: GraphGeometry,
    errors: StandardErrors,
    residuals: FloatArray,
    rings_used: IntArray,
) -> None:
    """Write the geometry of the vertices of a block, and which of them are ill posed."""
    for lane in range(block.shape[0]):
        if outcomes[lane] != FITTED:
            continue
        if not work.sound[lane] > 0.0:
            outcomes[lane] = ILL_POSED
            continue
        i = block[lane]
        _write(fit, lane, i, work, result, errors)
        residuals[i] = np.sqrt(work.total[lane] / counts[lane])
        rings_used[i] = rings[lane]


@lean_njit()
def _write(
    fit: KernelFit, lane: int, i: int, work: LaneWorkspace, result: GraphGeometry, errors: StandardErrors
) -> None:
    """Write the geometry of vertex i, which is in one of the lanes."""
    jet, frame, corner = work.one_jet, work.one_frame, work.corner
    for r in range(4):
        for q in range(4 - r):
            jet[r, q] = work.jets[LANES * (4 * r + q) + lane]
    for k in range(9):
        frame[k] = work.frame[LANES * k + lane]
    zx, zy, zxx, zxy, zyy = jet[1, 0], jet[0, 1], jet[2, 0], jet[1, 1], jet[0, 2]
    write_graph_geometry(zx, zy, zxx, zxy, zyy, frame, i, result)
    write_displacement(jet[0, 0], frame, i, result)
    if fit.highest_power >= 2 * 3:  # a lower degree says nothing of third derivatives
        write_extremalities(jet, frame, i, result)
    if fit.normal_noise > 0.0:
        last_corner(work.matrix[lane::LANES], fit.exponents.shape[0], corner)
        noise, scale = (fit.normal_noise, fit.curvature_noise), work.box[LANES + lane]
        write_standard_errors(corner, noise, scale, (zx, zy, zxx, zxy, zyy), work.sensitivities, i, errors)
