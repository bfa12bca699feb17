"""The geometry of eight fitted graphs z(x, y) at a time, its standard errors, and where the values go."""

from typing import TypeAlias

import numpy as np

from bezier_filters.arrays import ByteArray, FloatArray, IntArray
from bezier_filters.kernels.fit_workspace import (
    ALONG_MAX,
    ALONG_MIN,
    DISPLACEMENT,
    EXTREMALITY_MAX,
    EXTREMALITY_MIN,
    K_MAX,
    K_MIN,
    NORMAL,
    RESIDUAL,
    STANDARD_ERRORS,
    FitWorkspace,
)
from bezier_filters.kernels.kernel_input import (
    FITTED,
    ILL_POSED,
    SMALLEST_WIDTH,
    KernelFit,
    KernelMesh,
    VertexResults,
)
from bezier_filters.kernels.lane_algebra import condition_numbers, substitute_forward
from bezier_filters.meshes.triangles import area_vector, longest_squared
from bezier_filters.runtime.jit import inner_jit, jit
from bezier_filters.runtime.lanes import LANES, Lanes, load, multiply_add, spread, square_root, store, where_greater

ROUNDED = 1e-6  # of the longest edge of a face: a smaller height is rounding
SEEN = 5  # coefficients of which the geometry is a function: those of x, y, x^2, x y and y^2, eliminated last
Gradient: TypeAlias = tuple[Lanes, Lanes, Lanes, Lanes, Lanes]  # derivatives by these


@inner_jit()
def write_block(
    mesh: KernelMesh,
    fit: KernelFit,
    block: IntArray,
    work: FitWorkspace,
    outcomes: ByteArray,
    results: VertexResults,
    conditions: FloatArray | None,
) -> None:
    """Write the geometry of the vertices of a block, and which of them are ill posed.

    A surface turns by pi at most from one face to the next: faces of height h hold no curvature beyond pi / h, and a
    standard error beyond that says that the points determine none.
    """
    outputs, has_errors = work.outputs, fit.normal_noise > 0.0
    has_third = fit.highest_power >= 2 * 3  # a lower degree says nothing of third derivatives
    graph_geometry(work.jets, work.frame, has_third, outputs)
    store(outputs, RESIDUAL, square_root(load(work.total, 0) / load(work.weight, 0)))
    if has_errors:
        standard_errors(fit, work)
    if conditions is not None:
        condition_numbers(work.matrix, fit.exponents.shape[0], work.solution, work.total)
    for lane in range(block.shape[0]):
        if outcomes[lane] != FITTED:
            continue
        per_half_width = max(work.box[LANES + lane], work.box[3 * LANES + lane])
        if not (work.sound[lane] > 0.0 and per_half_width < 2.0 / SMALLEST_WIDTH):
            outcomes[lane] = ILL_POSED
            continue
        bend = max(-outputs[LANES * K_MIN + lane], outputs[LANES * K_MAX + lane])
        if has_errors:
            bend = max(bend, outputs[LANES * (STANDARD_ERRORS + 1) + lane])
        farthest = np.sqrt(work.box[4 * LANES + lane])  # of the points: no height is larger, unless a ball cuts faces
        if (fit.radius > 0.0 or bend * farthest > np.pi) and bend * _smallest_height(mesh, block[lane]) > np.pi:
            outcomes[lane] = ILL_POSED
            continue
        i = mesh.origin[block[lane]]
        for k in range(3):
            results.normals[i, k] = outputs[LANES * (NORMAL + k) + lane]
            results.displacements[i, k] = outputs[LANES * (DISPLACEMENT + k) + lane]
            results.direction_min[i, k] = outputs[LANES * (ALONG_MIN + k) + lane]
            results.direction_max[i, k] = outputs[LANES * (ALONG_MAX + k) + lane]
        results.k_min[i] = outputs[LANES * K_MIN + lane]
        results.k_max[i] = outputs[LANES * K_MAX + lane]
        results.residual[i] = outputs[LANES * RESIDUAL + lane]
        results.rings_used[i] = work.rings[lane]
        if has_third:
            results.extremality_min[i] = outputs[LANES * EXTREMALITY_MIN + lane]
            results.extremality_max[i] = outputs[LANES * EXTREMALITY_MAX + lane]
        if has_errors:
            results.normal_std[i] = outputs[LANES * STANDARD_ERRORS + lane]
            results.mean_curvature_std[i] = outputs[LANES * (STANDARD_ERRORS + 1) + lane]
            results.gaussian_curvature_std[i] = outputs[LANES * (STANDARD_ERRORS + 2) + lane]
        if conditions is not None:
            conditions[i] = work.total[lane]


@jit()
def bound_errors(
    mesh: KernelMesh, ids: IntArray, of_mean: FloatArray, of_gaussian: FloatArray, start: int, stop: int
) -> None:
    """Bring the standard errors of curvatures of vertices ids[start:stop] down to what the faces there can hold."""
    for i in ids[start:stop]:
        height = _smallest_height(mesh, i)
        if height > 0.0:
            most, row = np.pi / height, mesh.origin[i]
            of_mean[row] = min(of_mean[row], most)
            of_gaussian[row] = min(of_gaussian[row], most * most)


@inner_jit()
def _smallest_height(mesh: KernelMesh, i: int) -> float:
    """Smallest height of the faces at a vertex, but for those that are rounding; 0 without any."""
    smallest = np.inf
    for q in range(mesh.face_ptr[i], mesh.face_ptr[i + 1]):
        f = mesh.face_indices[q]
        x, y, z = area_vector(mesh.vertices, mesh.faces[f, 0], mesh.faces[f, 1], mesh.faces[f, 2])
        square, longest = x * x + y * y + z * z, longest_squared(mesh.vertices, mesh.faces, f)
        if square > (ROUNDED * longest) ** 2:
            smallest = min(smallest, square / longest)
    return float(np.sqrt(smallest)) if smallest < np.inf else 0.0


@inner_jit()
def graph_geometry(jets: FloatArray, frame: FloatArray, has_third: bool, outputs: FloatArray) -> None:
    """Lanes of all outputs but the residual and the standard errors, from jets as `differentiate` orders them.

    The curvatures are those of the symmetric shape operator in the orthonormal tangents e1 = (1, 0, p) / a and
    e2 = normal x e1, with MeshLab's sign. `frame` has the x, y and z axes in world coordinates.
    """
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
    # Eigenvector of the larger curvature, by the formula that does not cancel.
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


@inner_jit()
def _extremality(jets: FloatArray, x: Lanes, y: Lanes, per_w: Lanes) -> Lanes:
    """Lanes of -(D_d II)(d, d) for the tangents d with local x and y, with MeshLab's sign of curvature.

    The derivative of a principal curvature along its unit direction d is the covariant derivative
    of the second fundamental form, (D_d II)(d, d), because turning d changes II(d, d) only to
    second order. For a graph, whose Christoffel symbols are z_k z_ij / w^2 with
    w^2 = 1 + z_x^2 + z_y^2 (do Carmo, "Differential geometry of curves and surfaces", 4-3),

        (D_d II)(d, d) = (z_ddd - 3 z_dd (grad z . grad z_d) / w^2) / w.
    """
    three = spread(3.0)
    slope_x = load(jets, 8) * x + load(jets, 5) * y
    slope_y = load(jets, 5) * x + load(jets, 2) * y
    second = slope_x * x + slope_y * y
    third = x * x * (load(jets, 12) * x + three * load(jets, 9) * y)
    third = third + y * y * (three * load(jets, 6) * x + load(jets, 3) * y)
    turning = (load(jets, 4) * slope_x + load(jets, 1) * slope_y) * per_w * per_w
    return (three * second * turning - third) * per_w


@inner_jit()
def standard_errors(fit: KernelFit, work: FitWorkspace) -> None:
    """Write standard errors of normal, mean and Gaussian curvature, from the factor that gave the fit.

    Given the noise sigma, the coefficients have the posterior covariance sigma^2 G^-1, G being the
    matrix of the normal equations with its prior. For a quantity whose derivatives by the
    coefficients are g, the variance is sigma^2 |L^-1 g|^2 with the Cholesky factor L of G. Only the last
    `SEEN` coefficients count: with them eliminated last, the last corner of L is the factor of their own
    inverse covariance. The noise is the standard deviation of the heights, a length, as far as it concerns the normal,
    or the curvatures.
    """
    matrix, order, jets, scale = work.matrix, fit.exponents.shape[0], work.jets, load(work.box, 1)
    zero, one, two, half = spread(0.0), spread(1.0), spread(2.0), spread(0.5)
    p, q, r, s, t = load(jets, 4), load(jets, 1), load(jets, 8), load(jets, 5), load(jets, 2)
    # Times the noise at once, which is small where the derivatives are large: squares must not overflow.
    noise1 = spread(fit.curvature_noise) * scale
    noise2 = noise1 * scale
    a2, b2 = one + p * p, one + q * q
    per_w2 = one / (a2 + q * q)
    per_w3 = per_w2 * square_root(per_w2)
    per_w4 = per_w2 * per_w2
    bend = spread(3.0) * half * (b2 * r - two * p * q * s + a2 * t) * per_w2
    gaussian = (r * t - s * s) * per_w4
    x = _whitened(matrix, order, (scale, zero, zero, zero, zero))
    y = _whitened(matrix, order, (zero, scale, zero, zero, zero))
    xx, xy, yy = _dot(x, x), _dot(x, y), _dot(y, y)
    # |dn|^2 = ((1 + q^2) dp^2 - 2 p q dp dq + (1 + p^2) dq^2) / w^4
    turned = (b2 * xx - two * p * q * xy + a2 * yy) * per_w4
    store(work.outputs, STANDARD_ERRORS, spread(fit.normal_noise) * square_root(turned))
    of_mean = (
        noise1 * (p * t - q * s - p * bend) * per_w3,
        noise1 * (q * r - p * s - q * bend) * per_w3,
        noise2 * b2 * per_w3,
        zero - noise2 * p * q * per_w3,
        noise2 * a2 * per_w3,
    )
    h = _whitened(matrix, order, of_mean)
    store(work.outputs, STANDARD_ERRORS + 1, square_root(_dot(h, h)))
    of_gaussian = (
        zero - spread(4.0) * noise1 * gaussian * p * per_w2,
        zero - spread(4.0) * noise1 * gaussian * q * per_w2,
        two * noise2 * t * per_w4,
        zero - two * noise2 * s * per_w4,
        two * noise2 * r * per_w4,
    )
    k = _whitened(matrix, order, of_gaussian)
    store(work.outputs, STANDARD_ERRORS + 2, square_root(_dot(k, k)))


@inner_jit()
def _whitened(matrix: FloatArray, order: int, gradient: Gradient) -> Gradient:
    """Lanes of L^-1 g, L being the last corner of the factor, below which there is room for a row."""
    first, last = order - SEEN, order * (order + 1) // 2
    for k, entry in enumerate(gradient):
        store(matrix, last + first + k, entry)
    substitute_forward(matrix, order, order, first)
    g = last + first
    return load(matrix, g), load(matrix, g + 1), load(matrix, g + 2), load(matrix, g + 3), load(matrix, g + 4)


@inner_jit()
def _dot(a: Gradient, b: Gradient) -> Lanes:
    """Lanes of the inner product of two vectors."""
    rest = multiply_add(a[2], b[2], multiply_add(a[3], b[3], a[4] * b[4]))
    return multiply_add(a[0], b[0], multiply_add(a[1], b[1], rest))
