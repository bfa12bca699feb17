"""The geometry of eight fitted graphs at a time: the formulas of `jets`, and where their values go."""

from typing import Any

from bezier_filters.arrays import ByteArray, FloatArray, IntArray
from bezier_filters.kernels.kernel_input import FITTED, ILL_POSED, SMALLEST_WIDTH, KernelFit
from bezier_filters.kernels.lane_errors import standard_errors
from bezier_filters.kernels.lane_workspace import LaneWorkspace
from bezier_filters.kernels.uncertainty import StandardErrors
from bezier_filters.patches.jets import GraphGeometry
from bezier_filters.runtime.lanes import LANES, load, multiply_add, spread, square_root, store, where_greater
from bezier_filters.runtime.lean import inner_njit

# Places among the outputs; those of vectors are the first of three.
NORMAL, ALONG_MIN, ALONG_MAX = 0, 3, 6
K_MIN, K_MAX, EXTREMALITY_MIN, EXTREMALITY_MAX, RESIDUAL = 9, 10, 11, 12, 13
STANDARD_ERRORS, DISPLACEMENT = 14, 17


@inner_njit()
def write_block(
    fit: KernelFit,
    origin: IntArray,
    block: IntArray,
    work: LaneWorkspace,
    outcomes: ByteArray,
    result: GraphGeometry,
    errors: StandardErrors,
    residuals: FloatArray,
    rings_used: IntArray,
) -> None:
    """Write the geometry of the vertices of a block, and which of them are ill posed."""
    has_third = fit.highest_power >= 2 * 3  # a lower degree says nothing of third derivatives
    _graph_geometry(work.jets, work.frame, has_third, work.outputs)
    store(work.outputs, RESIDUAL, square_root(load(work.total, 0) / load(work.counts, 0)))
    has_errors = fit.normal_noise > 0.0
    if has_errors:
        standard_errors(
            work.matrix,
            fit.exponents.shape[0],
            work.jets,
            load(work.box, 1),
            fit.normal_noise,
            fit.curvature_noise,
            work.outputs[LANES * STANDARD_ERRORS :],
        )
    for lane in range(block.shape[0]):
        if outcomes[lane] != FITTED:
            continue
        per_half_width = max(work.box[LANES + lane], work.box[3 * LANES + lane])
        if not (work.sound[lane] > 0.0 and per_half_width < 2.0 / SMALLEST_WIDTH):
            outcomes[lane] = ILL_POSED
            continue
        i = origin[block[lane]]
        _write(work.outputs, lane, has_third, i, result)
        residuals[i] = work.outputs[LANES * RESIDUAL + lane]
        rings_used[i] = work.rings[lane]
        if has_errors:
            place = LANES * STANDARD_ERRORS + lane
            errors.normal[i] = work.outputs[place]
            errors.mean_curvature[i] = work.outputs[place + LANES]
            errors.gaussian_curvature[i] = work.outputs[place + 2 * LANES]


@inner_njit()
def _graph_geometry(jets: FloatArray, frame: FloatArray, has_third: bool, outputs: FloatArray) -> None:
    """Lanes of all outputs but the residual: see `write_graph_geometry` and `write_extremalities`."""
    zero, one, two, half = spread(0.0), spread(1.0), spread(2.0), spread(0.5)
    p, q, r, s, t = load(jets, 4), load(jets, 1), load(jets, 8), load(jets, 5), load(jets, 2)
    a2 = one + p * p
    w2 = a2 + q * q
    per_a, per_w = one / square_root(a2), one / square_root(w2)
    per_c = square_root(a2) * per_w
    shear = p * q * per_a * per_a
    s11 = zero - r * per_w * per_a * per_a
    s12 = (shear * r - s) * per_w * per_w
    s22 = (two * shear * s - t - shear * shear * r) * per_w * per_c * per_c
    mean, difference = half * (s11 + s22), half * (s11 - s22)
    torsion = square_root(difference * difference + s12 * s12)
    store(outputs, K_MIN, mean - torsion)
    store(outputs, K_MAX, mean + torsion)
    d1 = where_greater(zero, difference, s12, difference + torsion)
    d2 = where_greater(zero, difference, torsion - difference, s12)
    length = square_root(d1 * d1 + d2 * d2)
    d1, d2 = where_greater(length, zero, d1 / length, one), where_greater(length, zero, d2 / length, zero)
    # Local x and y of the unit tangents; a tangent rises by p and q along them.
    max_x, max_y = d1 * per_a - d2 * shear * per_c, d2 * per_c
    min_x, min_y = zero - d1 * shear * per_c - d2 * per_a, d1 * per_c
    max_z, min_z = p * max_x + q * max_y, p * min_x + q * min_y
    for k in range(3):
        x, y, z = load(frame, k), load(frame, 3 + k), load(frame, 6 + k)
        store(outputs, DISPLACEMENT + k, load(jets, 0) * z)
        store(outputs, NORMAL + k, (z - p * x - q * y) * per_w)
        store(outputs, ALONG_MIN + k, multiply_add(min_x, x, multiply_add(min_y, y, min_z * z)))
        store(outputs, ALONG_MAX + k, multiply_add(max_x, x, multiply_add(max_y, y, max_z * z)))
    if has_third:
        store(outputs, EXTREMALITY_MIN, _extremality(jets, min_x, min_y, per_w))
        store(outputs, EXTREMALITY_MAX, _extremality(jets, max_x, max_y, per_w))


@inner_njit()
def _extremality(jets: FloatArray, x: Any, y: Any, per_w: Any) -> Any:
    """Lanes of -(D_d II)(d, d) for the tangents d with local x and y."""
    three = spread(3.0)
    slope_x = load(jets, 8) * x + load(jets, 5) * y
    slope_y = load(jets, 5) * x + load(jets, 2) * y
    second = slope_x * x + slope_y * y
    third = x * x * (load(jets, 12) * x + three * load(jets, 9) * y)
    third = third + y * y * (three * load(jets, 6) * x + load(jets, 3) * y)
    turning = (load(jets, 4) * slope_x + load(jets, 1) * slope_y) * per_w * per_w
    return (three * second * turning - third) * per_w


@inner_njit()
def _write(outputs: FloatArray, lane: int, has_third: bool, i: int, result: GraphGeometry) -> None:
    """Write the outputs of one lane, but for the residual, to vertex i."""
    for k in range(3):
        result.normals[i, k] = outputs[LANES * (NORMAL + k) + lane]
        result.displacements[i, k] = outputs[LANES * (DISPLACEMENT + k) + lane]
        result.direction_min[i, k] = outputs[LANES * (ALONG_MIN + k) + lane]
        result.direction_max[i, k] = outputs[LANES * (ALONG_MAX + k) + lane]
    result.k_min[i] = outputs[LANES * K_MIN + lane]
    result.k_max[i] = outputs[LANES * K_MAX + lane]
    if has_third:
        result.extremality_min[i] = outputs[LANES * EXTREMALITY_MIN + lane]
        result.extremality_max[i] = outputs[LANES * EXTREMALITY_MAX + lane]
