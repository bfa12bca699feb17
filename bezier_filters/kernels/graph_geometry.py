"""Differential geometry of eight fitted graphs z(x, y) at a time, with standard errors, and output of the results.

Curvatures are eigenvalues of the symmetric shape operator in an orthonormal tangent basis. Standard errors follow from
the posterior covariance of the coefficients by linear error propagation (the delta method).
"""

from typing import TypeAlias

import numpy as np

from bezier_filters.arrays import ByteArray, FloatArray, IntArray
from bezier_filters.kernels.fit_workspace import (
    OUT_DIRECTION_MAX,
    OUT_DIRECTION_MIN,
    OUT_DISPLACEMENT,
    OUT_EXTREMALITY_MAX,
    OUT_EXTREMALITY_MIN,
    OUT_K_MAX,
    OUT_K_MIN,
    OUT_NORMAL,
    OUT_RESIDUAL,
    OUT_STANDARD_ERRORS,
    FitWorkspace,
)
from bezier_filters.kernels.kernel_input import (
    FITTED,
    ILL_POSED,
    MIN_NEIGHBOURHOOD_WIDTH,
    KernelFit,
    KernelMesh,
    PatchTable,
    VertexResults,
)
from bezier_filters.kernels.lane_algebra import condition_numbers, substitute_forward
from bezier_filters.kernels.patch_rows import height_errors, write_patch
from bezier_filters.meshes.triangles import area_vector, longest_squared
from bezier_filters.runtime.jit import inner_jit, jit
from bezier_filters.runtime.lanes import LANES, Lanes, broadcast, load, multiply_add, square_root, store, where_greater

MIN_HEIGHT_RATIO = 1e-6  # height of a face over its longest edge, above the rounding error of coordinates
GEOMETRY_TERMS = 5  # coefficients that determine the geometry: x, y, x^2, x y and y^2, eliminated last
Gradient: TypeAlias = tuple[Lanes, Lanes, Lanes, Lanes, Lanes]  # derivatives with respect to these coefficients


@inner_jit()
def write_block(
    mesh: KernelMesh,
    fit: KernelFit,
    block: IntArray,
    work: FitWorkspace,
    outcomes: ByteArray,
    results: VertexResults,
    conditions: FloatArray | None,
    patches: PatchTable | None,
) -> None:
    """Write the geometry of the vertices of a block, and mark the ill-posed ones.

    A surface turns by at most pi from one face to the next: faces of height h resolve no curvature beyond pi / h. A
    larger standard error means that the points do not determine the curvature.
    """
    outputs, has_errors = work.outputs, fit.normal_noise > 0.0
    has_third = fit.highest_power >= 2 * 3  # a lower degree has no third derivatives
    graph_geometry(work.jets, work.frame, has_third, outputs)
    store(outputs, OUT_RESIDUAL, square_root(load(work.total, 0) / load(work.weight, 0)))
    if has_errors:
        standard_errors(fit, work)
    if conditions is not None:
        condition_numbers(work.matrix, fit.exponents.shape[0], work.solution, work.total)
    if patches is not None:
        height_errors(fit, work)
    for lane in range(block.shape[0]):
        if outcomes[lane] != FITTED:
            continue
        per_half_width = max(work.box[LANES + lane], work.box[3 * LANES + lane])
        if not (work.is_full_rank[lane] > 0.0 and per_half_width < 2.0 / MIN_NEIGHBOURHOOD_WIDTH):
            outcomes[lane] = ILL_POSED
            continue
        bend = max(-outputs[LANES * OUT_K_MIN + lane], outputs[LANES * OUT_K_MAX + lane])
        if has_errors:
            bend = max(bend, outputs[LANES * (OUT_STANDARD_ERRORS + 1) + lane])
        farthest = np.sqrt(work.box[4 * LANES + lane])  # no height of a face is larger, unless a ball cuts faces
        if (fit.radius > 0.0 or bend * farthest > np.pi) and bend * _smallest_height(mesh, block[lane]) > np.pi:
            outcomes[lane] = ILL_POSED
            continue
        i = mesh.origin[block[lane]]
        for k in range(3):
            results.normals[i, k] = outputs[LANES * (OUT_NORMAL + k) + lane]
            results.displacements[i, k] = outputs[LANES * (OUT_DISPLACEMENT + k) + lane]
            results.direction_min[i, k] = outputs[LANES * (OUT_DIRECTION_MIN + k) + lane]
            results.direction_max[i, k] = outputs[LANES * (OUT_DIRECTION_MAX + k) + lane]
        results.k_min[i] = outputs[LANES * OUT_K_MIN + lane]
        results.k_max[i] = outputs[LANES * OUT_K_MAX + lane]
        results.residual[i] = outputs[LANES * OUT_RESIDUAL + lane]
        results.rings_used[i] = work.rings[lane]
        if has_third:
            results.extremality_min[i] = outputs[LANES * OUT_EXTREMALITY_MIN + lane]
            results.extremality_max[i] = outputs[LANES * OUT_EXTREMALITY_MAX + lane]
        if has_errors:
            results.normal_std[i] = outputs[LANES * OUT_STANDARD_ERRORS + lane]
            results.mean_curvature_std[i] = outputs[LANES * (OUT_STANDARD_ERRORS + 1) + lane]
            results.gaussian_curvature_std[i] = outputs[LANES * (OUT_STANDARD_ERRORS + 2) + lane]
        if conditions is not None:
            conditions[i] = work.total[lane]
        if patches is not None:
            patches.height_std[i] = work.total[lane]
            write_patch(fit, work, lane, mesh.vertices[block[lane]], patches.rows[i])


@jit()
def bound_errors(
    mesh: KernelMesh, ids: IntArray, mean_errors: FloatArray, gaussian_errors: FloatArray, start: int, stop: int
) -> None:
    """Clamp the standard errors of curvatures at ids[start:stop] to the curvature that the faces resolve."""
    for i in ids[start:stop]:
        height = _smallest_height(mesh, i)
        if height > 0.0:
            most, row = np.pi / height, mesh.origin[i]
            mean_errors[row] = min(mean_errors[row], most)
            gaussian_errors[row] = min(gaussian_errors[row], most * most)


@inner_jit()
def _smallest_height(mesh: KernelMesh, i: int) -> float:
    """Smallest height of the faces at a vertex, degenerate faces excluded; 0 without any."""
    smallest = np.inf
    for q in range(mesh.face_ptr[i], mesh.face_ptr[i + 1]):
        f = mesh.face_indices[q]
        x, y, z = area_vector(mesh.vertices, mesh.faces[f, 0], mesh.faces[f, 1], mesh.faces[f, 2])
        square, longest = x * x + y * y + z * z, longest_squared(mesh.vertices, mesh.faces, f)
        if square > (MIN_HEIGHT_RATIO * longest) ** 2:
            smallest = min(smallest, square / longest)
    return float(np.sqrt(smallest)) if smallest < np.inf else 0.0


@inner_jit()
def graph_geometry(jets: FloatArray, frame: FloatArray, has_third: bool, outputs: FloatArray) -> None:
    """Lanes of all outputs but the residual and the standard errors, from jets as `differentiate` orders them.

    The curvatures are those of the symmetric shape operator in the orthonormal tangents e1 = (1, 0, p) / a and
    e2 = normal x e1, with MeshLab's sign. `frame` has the x, y and z axes in world coordinates.
    """
    zero, one, two, half = broadcast(0.0), broadcast(1.0), broadcast(2.0), broadcast(0.5)
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
    store(outputs, OUT_K_MIN, mean - torsion)
    store(outputs, OUT_K_MAX, mean + torsion)
    # Eigenvector of the larger curvature, by the formula without cancellation.
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
        store(outputs, OUT_DISPLACEMENT + k, load(jets, 0) * z)
        store(outputs, OUT_NORMAL + k, (z - p * x - q * y) * per_w)
        store(outputs, OUT_DIRECTION_MIN + k, multiply_add(min_x, x, multiply_add(min_y, y, min_z * z)))
        store(outputs, OUT_DIRECTION_MAX + k, multiply_add(max_x, x, multiply_add(max_y, y, max_z * z)))
    if has_third:
        store(outputs, OUT_EXTREMALITY_MIN, _extremality(jets, min_x, min_y, per_w))
        store(outputs, OUT_EXTREMALITY_MAX, _extremality(jets, max_x, max_y, per_w))


@inner_jit()
def _extremality(jets: FloatArray, x: Lanes, y: Lanes, per_w: Lanes) -> Lanes:
    """Lanes of -(D_d II)(d, d) for the tangents d with local x and y, with MeshLab's sign of curvature.

    The derivative of a principal curvature along its unit direction d is the covariant derivative
    of the second fundamental form, (D_d II)(d, d), because turning d changes II(d, d) only to
    second order. For a graph, whose Christoffel symbols are z_k z_ij / w^2 with
    w^2 = 1 + z_x^2 + z_y^2 (do Carmo, "Differential geometry of curves and surfaces", 4-3),

        (D_d II)(d, d) = (z_ddd - 3 z_dd (grad z . grad z_d) / w^2) / w.
    """
    three = broadcast(3.0)
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
    `GEOMETRY_TERMS` coefficients count: with them eliminated last, the last corner of L is the factor of their own
    inverse covariance. Normals and curvatures have a noise of their own, a standard deviation of the heights, a length.
    """
    matrix, order, jets, scale = work.matrix, fit.exponents.shape[0], work.jets, load(work.box, 1)
    zero, one, two, half = broadcast(0.0), broadcast(1.0), broadcast(2.0), broadcast(0.5)
    p, q, r, s, t = load(jets, 4), load(jets, 1), load(jets, 8), load(jets, 5), load(jets, 2)
    # Multiplied by the noise first, which is small where the derivatives are large, so that squares do not overflow.
    noise1 = broadcast(fit.curvature_noise) * scale
    noise2 = noise1 * scale
    a2, b2 = one + p * p, one + q * q
    per_w2 = one / (a2 + q * q)
    per_w3 = per_w2 * square_root(per_w2)
    per_w4 = per_w2 * per_w2
    bend = broadcast(3.0) * half * (b2 * r - two * p * q * s + a2 * t) * per_w2
    gaussian = (r * t - s * s) * per_w4
    x = _whiten(matrix, order, (scale, zero, zero, zero, zero))
    y = _whiten(matrix, order, (zero, scale, zero, zero, zero))
    xx, xy, yy = _dot(x, x), _dot(x, y), _dot(y, y)
    # |dn|^2 = ((1 + q^2) dp^2 - 2 p q dp dq + (1 + p^2) dq^2) / w^4
    turned = (b2 * xx - two * p * q * xy + a2 * yy) * per_w4
    store(work.outputs, OUT_STANDARD_ERRORS, broadcast(fit.normal_noise) * square_root(turned))
    mean_gradient = (
        noise1 * (p * t - q * s - p * bend) * per_w3,
        noise1 * (q * r - p * s - q * bend) * per_w3,
        noise2 * b2 * per_w3,
        zero - noise2 * p * q * per_w3,
        noise2 * a2 * per_w3,
    )
    h = _whiten(matrix, order, mean_gradient)
    store(work.outputs, OUT_STANDARD_ERRORS + 1, square_root(_dot(h, h)))
    gaussian_gradient = (
        zero - broadcast(4.0) * noise1 * gaussian * p * per_w2,
        zero - broadcast(4.0) * noise1 * gaussian * q * per_w2,
        two * noise2 * t * per_w4,
        zero - two * noise2 * s * per_w4,
        two * noise2 * r * per_w4,
    )
    k = _whiten(matrix, order, gaussian_gradient)
    store(work.outputs, OUT_STANDARD_ERRORS + 2, square_root(_dot(k, k)))


@inner_jit()
def _whiten(matrix: FloatArray, order: int, gradient: Gradient) -> Gradient:
    """Lanes of L^-1 g with the last corner L of the factor, below which there is a scratch row."""
    first, last = order - GEOMETRY_TERMS, order * (order + 1) // 2
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
