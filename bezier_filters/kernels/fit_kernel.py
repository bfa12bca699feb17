"""The fit kernel: penalised weighted least squares for eight vertices at a time.

Collecting neighbourhoods and testing for folds go vertex by vertex. The arithmetic runs on eight vertices in parallel,
see `lanes`; smaller neighbourhoods of a block are padded with points of weight zero. For each vertex it solves the
normal equations

    (A^T W A + P) c = A^T W z

for the coefficients c of monomials in scaled coordinates. P is the smoothness penalty plus the prior precision. Robust
fits repeat this with Tukey's biweights (iteratively reweighted least squares).
"""

import numpy as np

from bezier_filters.arrays import ByteArray, FloatArray, IntArray
from bezier_filters.kernels.fit_frames import complete_axes, write_edge, write_plane
from bezier_filters.kernels.fit_workspace import (
    POWER_CHUNK,
    FitWorkspace,
    RobustWorkspace,
    fit_workspace,
    robust_workspace,
)
from bezier_filters.kernels.graph_geometry import write_block
from bezier_filters.kernels.kernel_input import FITTED, KernelFit, KernelMesh, PatchTable, VertexResults
from bezier_filters.kernels.lane_algebra import (
    UNROLL_FACTOR,
    add_moments,
    add_squared_residuals,
    differentiate,
    factorise_lanes,
    raise_powers,
    sort_lanes,
    substitute_back,
    substitute_forward,
)
from bezier_filters.meshes.neighbourhoods import collect_ball, collect_ring
from bezier_filters.runtime.jit import inner_jit, jit, opaque
from bezier_filters.runtime.lanes import LANES, Lanes, broadcast, load, multiply_add, square_root, store, where_greater
from bezier_filters.runtime.parallel import RangeTask

CAPACITY_RATIO = 2  # initial capacity over the number of points of a regular neighbourhood of k rings, 1 + 3 k (k + 1)
MIN_KERNEL_CAPACITY = 128  # points
BIWEIGHT_CUTOFF = 4.685  # residual of weight zero, in standard deviations: 95 % efficiency for normal residuals
MAX_MEDIAN_RATIO = 0.95  # of consecutive median residuals, while reweighting continues
MAD_TO_SIGMA = 1.4826  # standard deviation of normal residuals over their median absolute value
QUARTIC_ROUNDS = 2  # fixed-point iterations between second derivatives and the expected fourth-degree coefficients
ROUNDING_RESIDUAL = 1e-12  # median residual of an interpolating fit, in half widths of the neighbourhood


def fit_task(
    mesh: KernelMesh,
    fit: KernelFit,
    ids: IntArray,
    results: VertexResults,
    outcomes: ByteArray,
    conditions: FloatArray | None = None,
    patches: PatchTable | None = None,
) -> RangeTask:
    """Task for one thread: fit the vertices ids[start:stop]; write their geometry and outcomes[start:stop].

    Condition numbers and patches are written if arrays are given for them.
    """
    capacity = max(MIN_KERNEL_CAPACITY, CAPACITY_RATIO * 3 * fit.rings * (fit.rings + 1))

    def scratch() -> tuple[FitWorkspace, RobustWorkspace | None]:
        return fit_workspace(fit, len(mesh.vertices), capacity), robust_workspace(capacity) if fit.rounds else None

    work, robust = scratch()

    @np.errstate(all="ignore")  # lanes without a vertex divide by zero; compiled code does not warn
    def run(start: int, stop: int) -> None:
        nonlocal capacity, work, robust
        while start < stop:
            start, needed = fit_in_lanes(
                mesh, fit, ids, start, stop, work, results, outcomes, conditions, robust, patches
            )
            if start < stop:  # this block needs a larger capacity and is collected again
                capacity = 2 * needed
                work, robust = scratch()

    return run


@jit()
def fit_in_lanes(
    mesh: KernelMesh,
    fit: KernelFit,
    ids: IntArray,
    start: int,
    stop: int,
    work: FitWorkspace,
    results: VertexResults,
    outcomes: ByteArray,
    conditions: FloatArray | None,
    robust: RobustWorkspace | None,
    patches: PatchTable | None,
) -> tuple[int, int]:
    """Fit the vertices ids[start:stop] until the capacity is exceeded; return the next start and the capacity needed.

    Condition numbers, reweighting and the patches themselves are optional. With an argument of None, their code is not
    compiled.
    """
    capacity = work.points.shape[0] // (4 * LANES)
    for first in range(start, stop, LANES):
        block = ids[first : min(first + LANES, stop)]
        block_outcomes = outcomes[first : min(first + LANES, stop)]
        most, needed = _collect(mesh, fit, block, capacity, work, block_outcomes)
        if needed > capacity:
            return first, needed
        if most == 0:
            continue
        complete_axes(work.frame)
        _project(fit.square, capacity, most, work)
        if robust is None:
            _solve(fit, capacity, most, work, None)
        else:
            _solve_robustly(fit, capacity, most, work, robust)
        _differentiate(fit, work)
        if fit.quartic.shape[0] > 0:
            for _ in range(QUARTIC_ROUNDS):
                _expect_quartic(fit, work)
                _differentiate(fit, work)
        _weigh_by_distance(fit, capacity, most, work)
        store(work.total, 0, broadcast(0.0))
        add_squared_residuals(work.coefficients, fit.starts, work.points, capacity, most, work.total, None)
        write_block(mesh, fit, block, work, block_outcomes, results, conditions, patches)
    return stop, 0


@inner_jit()
def _collect(
    mesh: KernelMesh,
    fit: KernelFit,
    block: IntArray,
    capacity: int,
    work: FitWorkspace,
    outcomes: ByteArray,
) -> tuple[int, int]:
    """Collect the neighbourhoods and frames of a block; return the largest number of points and the capacity needed.

    Points are relative to the vertex of their lane. A lane without a vertex or without a frame has no points.
    """
    most, row, rings, visited, members = 0, LANES * capacity, work.rings, work.visited, work.members
    store(work.counts, 0, broadcast(0.0))
    for lane in range(block.shape[0]):
        i = block[lane]
        if fit.radius > 0.0:
            count, inner, neighbours, rings[lane] = collect_ball(
                mesh.vertices, mesh.ring_ptr, mesh.ring_indices, mesh.barriers, i, fit.radius, visited, members
            )
        else:
            count, inner = collect_ring(mesh.ring_ptr, mesh.ring_indices, mesh.barriers, i, fit.rings, visited, members)
            neighbours, rings[lane] = mesh.ring_ptr[i + 1] - mesh.ring_ptr[i], fit.rings
        if count + UNROLL_FACTOR > capacity:
            return most, count + UNROLL_FACTOR
        outcome = write_plane(mesh, fit, members, count, inner, neighbours, work.one_frame)
        if outcome == FITTED:
            outcome = write_edge(mesh, fit.any_axis, members, count, neighbours, work.one_frame)
        outcomes[lane] = outcome
        if outcome != FITTED:
            continue
        x, y, z = mesh.vertices[i, 0], mesh.vertices[i, 1], mesh.vertices[i, 2]
        for p in range(count):
            j, place = np.uint32(members[p]), LANES * p + lane
            work.points[place] = mesh.vertices[j, 0] - x
            work.points[place + row] = mesh.vertices[j, 1] - y
            work.points[place + 2 * row] = mesh.vertices[j, 2] - z
        for k in range(9):
            work.frame[LANES * k + lane] = work.one_frame[k]
        work.counts[lane] = count
        most = max(most, count)
    return most, capacity


@inner_jit()
def _project(square: bool, stride: int, count: int, work: FitWorkspace) -> None:
    """Transform relative points to parameters and heights; parameters of a degenerate rectangle are not finite.

    Padding, up to a full group of points, has weight zero and coincides with the vertex.
    """
    points, frame, box = work.points, work.frame, work.box
    zero, one = broadcast(0.0), broadcast(1.0)
    low_x, high_x, low_y, high_y, radius, reach = zero, zero, zero, zero, zero, zero
    for p in range(count + UNROLL_FACTOR):
        presence = where_greater(load(work.counts, 0), broadcast(np.float64(p)), one, zero)
        store(points, 3 * stride + p, presence)
        dx = where_greater(presence, zero, load(points, p), zero)
        dy = where_greater(presence, zero, load(points, stride + p), zero)
        dz = where_greater(presence, zero, load(points, 2 * stride + p), zero)
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
        distance = multiply_add(z, z, distance)
        reach = where_greater(distance, reach, distance, reach)
    if square:
        high_x = square_root(radius)
        low_x = zero - high_x
        low_y, high_y = low_x, high_x
    half, two = broadcast(0.5), broadcast(2.0)
    middle_x, scale_x = half * (low_x + high_x), two / (high_x - low_x)
    middle_y, scale_y = half * (low_y + high_y), two / (high_y - low_y)
    store(box, 0, middle_x)
    store(box, 1, scale_x)
    store(box, 2, middle_y)
    store(box, 3, scale_y)
    store(box, 4, reach)
    for p in range(count + UNROLL_FACTOR):
        store(points, p, (load(points, p) - middle_x) * scale_x)
        store(points, stride + p, (load(points, stride + p) - middle_y) * scale_y)


@inner_jit()
def _solve(fit: KernelFit, stride: int, count: int, work: FitWorkspace, weights: FloatArray | None) -> None:
    """Assemble the normal equations, with the moments of the heights as the last row, and solve them by Cholesky.

    `weights` are lanes of robust weights, multiplied with the distance weights.
    """
    _sum_moments(fit, stride, count, work, weights)
    for k in range(fit.moment_place.shape[0]):
        store(work.matrix, k, load(work.moments, fit.moment_place[k]) + broadcast(fit.penalty[k]))
    degree, scale = 0, broadcast(1.0)
    for k in range(fit.prior.shape[0]):
        while degree < fit.prior_degree[k]:  # per length to per half width of this neighbourhood
            degree += 1
            scale = scale * load(work.box, 1) * load(work.box, 1)
        place = fit.prior_place[k]
        store(work.matrix, place, multiply_add(broadcast(fit.prior[k]), scale, load(work.matrix, place)))
    order = fit.exponents.shape[0]
    last = order * (order + 1) // 2
    for k in range(order):
        store(work.matrix, last + k, load(work.heights, fit.lexicographic[k]))
    factorise_lanes(work.matrix, order + 1, order, fit.smallest_pivot, work.is_full_rank)
    _back_substitute(fit, order, work)


@inner_jit()
def _back_substitute(fit: KernelFit, order: int, work: FitWorkspace) -> None:
    """Solve with the Cholesky factor and store the coefficients in lexicographic order."""
    substitute_back(work.matrix, order, order, work.solution)
    for k in range(order):
        store(work.coefficients, fit.lexicographic[k], load(work.solution, k))


@inner_jit()
def _solve_robustly(fit: KernelFit, stride: int, count: int, work: FitWorkspace, robust: RobustWorkspace) -> None:
    """Iteratively reweighted least squares with Tukey's biweight of the residuals.

    The slowest of the eight fits determines the number of rounds. The others keep their weights, and so their
    solutions, to the last bit.
    """
    zero, one = broadcast(0.0), broadcast(1.0)
    for p in range(count):
        store(robust.weights, p, one)
    store(robust.medians, 0, broadcast(np.inf))
    _solve(fit, stride, count, work, robust.weights)
    for _ in range(fit.rounds):
        add_squared_residuals(work.coefficients, fit.starts, work.points, stride, count, work.total, robust.residuals)
        if not _find_reaches(fit.free, stride, count, work, robust):
            break
        reach = load(robust.reaches, 0)
        for p in range(count):
            ratio = load(robust.residuals, p) / reach
            rest = one - ratio * ratio
            rest = where_greater(rest, zero, rest, zero)
            store(robust.weights, p, where_greater(reach, zero, rest * rest, load(robust.weights, p)))
        _solve(fit, stride, count, work, robust.weights)
    store(work.is_full_rank, 0, where_greater(zero, load(robust.medians, 0), zero, load(work.is_full_rank, 0)))


@inner_jit()
def _find_reaches(free: int, stride: int, count: int, work: FitWorkspace, robust: RobustWorkspace) -> bool:
    """Compute the cutoff residual of each neighbourhood; return whether any reweighting continues.

    It ends when the median residual has converged or is a rounding error, which would make weights random. A
    neighbourhood that keeps no more points than `free` coefficients is ill posed.
    """
    zero = broadcast(0.0)
    for p in range(count):
        residual = load(robust.residuals, p)
        size = where_greater(residual, zero, residual, zero - residual)
        store(robust.sizes, p, where_greater(load(work.points, 3 * stride + p), zero, size, broadcast(np.inf)))
    sort_lanes(robust.sizes, count)
    any_active = False
    for lane in range(LANES):
        points, median, reach = int(work.counts[lane]), 0.0, 0.0
        if points > 0 and work.is_full_rank[lane] > 0.0:
            # mean of the two middle residuals, which coincide for an odd number
            median = 0.5 * (
                robust.sizes[LANES * (points // 2) + lane] + robust.sizes[LANES * ((points - 1) // 2) + lane]
            )
        if ROUNDING_RESIDUAL / work.box[LANES + lane] < median < MAX_MEDIAN_RATIO * robust.medians[lane]:
            reach = BIWEIGHT_CUTOFF * MAD_TO_SIGMA * median
            if points <= free or robust.sizes[LANES * free + lane] >= reach:
                median, reach = -1.0, 0.0
        else:
            median = min(0.0, robust.medians[lane])
        robust.medians[lane], robust.reaches[lane] = median, reach
        any_active = any_active or reach > 0.0
    return any_active


@inner_jit()
def _expect_quartic(fit: KernelFit, work: FitWorkspace) -> None:
    """Solve again with the prior mean of the fourth-degree terms that second derivatives S predict.

    The prior mean is (x' S x) (x' S^2 x) / 8 times a factor: see `quartic_mean`. As S^2 = tr(S) S - det(S), it is
    (tr(S) q^2 - det(S) q x' x) / 8 with q = x' S x. The norm of S is bounded by the curvature of the sphere through the
    farthest point.
    """
    order, scale = fit.exponents.shape[0], load(work.box, 1)
    zero, one, two, half, eighth = broadcast(0.0), broadcast(1.0), broadcast(2.0), broadcast(0.5), broadcast(0.125)
    a, b, c = load(work.jets, 8), load(work.jets, 5), load(work.jets, 2)
    mean, difference = half * (a + c), half * (a - c)
    bend = where_greater(mean, zero, mean, zero - mean) + square_root(difference * difference + b * b)
    sine = bend * square_root(load(work.box, 4))
    less = where_greater(sine, one, one / sine, one)
    a, b, c = less * a, less * b, less * c
    trace, determinant = eighth * (a + c), eighth * (a * c - b * b)
    quartic = (
        trace * a * a - determinant * a,
        two * b * (two * trace * a - determinant),
        two * trace * (two * b * b + a * c) - determinant * (a + c),
        two * b * (two * trace * c - determinant),
        trace * c * c - determinant * c,
    )
    power = scale * scale
    power = power * power  # the prior is per length; heights are over half widths of the neighbourhood
    last = order * (order + 1) // 2
    for k in range(order):
        store(work.matrix, last + k, load(work.heights, fit.lexicographic[k]))
    for k in range(fit.quartic.shape[0]):
        total = zero
        for n in range(len(quartic)):
            total = multiply_add(broadcast(fit.quartic[k, n]), quartic[n], total)
        place = last + fit.quartic_order[k]
        store(work.matrix, place, multiply_add(total, power, load(work.matrix, place)))
    substitute_forward(work.matrix, order, order, 0)
    _back_substitute(fit, order, work)


@inner_jit()
def _weigh_by_distance(fit: KernelFit, stride: int, count: int, work: FitWorkspace) -> None:
    """Sum the distance weights of the points, and overwrite their presence by square roots of the weights.

    A polynomial of high degree may have arbitrary residuals at points of small weight. The weighted mean square never
    exceeds that of the heights, the residuals of a fit of zero.
    """
    if fit.weight_scale == 0.0:
        store(work.weight, 0, load(work.counts, 0))
        return
    total = broadcast(0.0)
    for p in range(count):
        weight = load(work.points, 3 * stride + p)
        weight = weight * _weight(fit, load(work.points, p), load(work.points, stride + p), load(work.box, 1))
        total = total + weight
        store(work.points, 3 * stride + p, square_root(weight))
    store(work.weight, 0, total)


@inner_jit()
def _differentiate(fit: KernelFit, work: FitWorkspace) -> None:
    """Partial derivatives up to third order at the vertex, with respect to lengths."""
    zero, one = broadcast(0.0), broadcast(1.0)
    for axis in range(2):
        store(work.origin, axis, (zero - load(work.box, 2 * axis)) * load(work.box, 2 * axis + 1))
    differentiate(work.coefficients, fit.starts, work.origin, work.jets)
    scale_r = one
    for r in range(4):
        scale = scale_r
        for q in range(4 - r):
            store(work.jets, 4 * r + q, load(work.jets, 4 * r + q) * scale)
            scale = scale * load(work.box, 3)
        scale_r = scale_r * load(work.box, 1)


@inner_jit()
def _sum_moments(fit: KernelFit, stride: int, count: int, work: FitWorkspace, weights: FloatArray | None) -> None:
    """Sum the moments s^a t^b and s^a t^b z over the points, in chunks."""
    zero, one = broadcast(0.0), broadcast(1.0)
    for k in range(fit.moment_starts[-1]):
        store(work.moments, k, zero)
    for k in range(fit.starts[-1]):
        store(work.heights, k, zero)
    # Chunks of equal size, whose powers fit into the L1 cache; the last one is not nearly empty.
    chunks = (count + POWER_CHUNK - 1) // POWER_CHUNK
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
            if weights is not None:
                weight = weight * load(weights, q)
            store(work.left, p, weight)
            store(work.left, POWER_CHUNK + p, a)
            store(work.right, p, one)
            store(work.right, POWER_CHUNK + p, b)
        raise_powers(work.left, POWER_CHUNK, here, fit.highest_power)
        raise_powers(work.right, POWER_CHUNK, here, fit.highest_power)
        for k in range(fit.highest_power // 2 + 1):
            for p in range(here):
                power = load(work.right, k * POWER_CHUNK + p)
                store(work.lifted, k * POWER_CHUNK + p, power * load(work.points, z + begin + p))
        add_moments(work.left, work.right, opaque(POWER_CHUNK), here, fit.moment_starts, work.moments)
        add_moments(work.left, work.lifted, opaque(POWER_CHUNK), here, fit.starts, work.heights)


@inner_jit()
def _weight(fit: KernelFit, a: Lanes, b: Lanes, scale: Lanes) -> Lanes:
    """Lanes of the distance weights of points with parameters a, b; `scale` is half widths per length."""
    ratio = broadcast(fit.weight_scale) * (a * a + b * b) / (scale * scale)
    power = ratio
    for _ in range(fit.weight_power - 1):
        power = power * ratio
    return broadcast(1.0) / (broadcast(1.0) + power)
