"""The blended surface over a face: an implicit function of the patches at its corners.

The patch at vertex i is the zero set of f_i(x) = z - P_i(x, y) in its local frame. Along the edge from vertex i to j,
with s the part of it at which x projects, clamped to [0, 1],

    f_ij = (1 - q(s)) f_i + q(s) f_j,   q(s) = s^3 (10 - 15 s + 6 s^2).

Both faces at an edge have the same f_ij. Within a face with barycentric coordinates l_1, l_2, l_3, the edge opposite of
corner k has the weight b_k = (l_i l_j)^3 / sum, and f = sum_k b_k f_ij. At an edge its own weight is 1 and the others
are 0, with first and second derivatives of 0, so that f and its gradient are those of f_ij from both sides: the surface
f = 0 is tangent-continuous. At a vertex all f_ij agree with f_i to second order, so that the surface touches the patch
of the vertex and has its curvature. Where all patches are equal, as on a plane, it is that patch.

Barycentric coordinates away from the face follow the vertex normals n_i: x = sum l_i (v_i + t n_i).
"""

from typing import NamedTuple

import numpy as np

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.kernels.kernel_input import PATCH_ORIGIN
from bezier_filters.kernels.patch_rows import JET, evaluate_patch
from bezier_filters.runtime.jit import inner_jit

NEWTON_STEPS = 12  # at most; heights along a ray need two or three
HEIGHT_ACCURACY = 1e-12  # least step towards the surface, in sizes of the face
POSITION_ROUNDING = 1e-15  # error of a position over its coordinates, a few units in the last place
MIN_RAY_SLOPE = 0.05  # least derivative of f along a ray; below it the ray grazes the surface, and there is no position
# columns of the scratch array of a thread
X, T, NORMAL, SLOPE, FORM, WEIGHTS, GRADIENTS, JETS, LOCAL = 0, 3, 4, 7, 8, 14, 17, 26, 56
RAY, SIZE = LOCAL + JET, LOCAL + JET + 3


class SurfaceArrays(NamedTuple):
    """Arrays of a `Surface` for the kernels; the mesh is cut along its sharp edges."""

    vertices: FloatArray  # (n, 3)
    faces: IntArray  # (m, 3)
    neighbours: IntArray  # (m, 3): face across the edge from corner k to the next, -1 at a border or sharp edge
    normals: FloatArray  # (n, 3): unit directions along which faces are extended
    patches: FloatArray  # (n, w): rows of a `PatchTable`; a zero frame where there is no patch
    errors: FloatArray  # (n, 4): standard errors of height, normal, mean and Gaussian curvature


@inner_jit()
def place_on_surface(surface: SurfaceArrays, f: int, a: float, b: float, work: FloatArray) -> bool:
    """Find the surface over the point with barycentric coordinates (1 - a - b, a, b) of face f; see `approach_surface`.

    Returns False where the ray meets no surface.
    """
    work[T] = 0.0
    for _ in range(NEWTON_STEPS):
        step = approach_surface(surface, f, a, b, work)
        if not step < np.inf:
            return False
        if step <= HEIGHT_ACCURACY:
            return True
    return False


@inner_jit()
def approach_surface(surface: SurfaceArrays, f: int, a: float, b: float, work: FloatArray) -> float:
    """Newton's step from the height T over a face towards the surface; returns its size over that of the face.

    It is infinite where the ray along the interpolated normal does not meet the surface from outside. Writes to `work`
    the new height T and position X, and what belongs to the old one: the unit NORMAL of the surface, the length SLOPE
    of the gradient, the second fundamental FORM (6,) in space, xx, xy, xz, yy, yz, zz, of the mean of the patches,
    convex positive; and the WEIGHTS of the corners.
    """
    i, j, k = surface.faces[f, 0], surface.faces[f, 1], surface.faces[f, 2]
    c, t, size, ray, slope = 1.0 - a - b, work[T], 0.0, 0.0, 0.0
    for axis in range(3):
        v0, v1, v2 = surface.vertices[i, axis], surface.vertices[j, axis], surface.vertices[k, axis]
        along = c * surface.normals[i, axis] + a * surface.normals[j, axis] + b * surface.normals[k, axis]
        work[RAY + axis] = along
        work[X + axis] = c * v0 + a * v1 + b * v2 + t * along
        size += abs(v1 - v0) + abs(v2 - v0)
        ray += along * along
    value = _blend(surface, i, j, k, a, b, t, work)
    for axis in range(3):
        slope += work[RAY + axis] * work[NORMAL + axis]
    slope *= work[SLOPE]
    if not slope > MIN_RAY_SLOPE * ray:
        return np.inf
    step, rounding = value / slope, 0.0
    for axis in range(3):
        work[X + axis] -= step * work[RAY + axis]
        rounding += POSITION_ROUNDING * abs(work[X + axis])
    work[T] = t - step
    return float(max(abs(step) - rounding, 0.0) / size)


@inner_jit()
def _blend(surface: SurfaceArrays, i: int, j: int, k: int, a: float, b: float, t: float, work: FloatArray) -> float:
    """Value of f at X, over barycentric coordinates (1 - a - b, a, b) at height t; writes what follows from it."""
    _write_jets(surface, i, 0, work)
    _write_jets(surface, j, 1, work)
    _write_jets(surface, k, 2, work)
    _write_gradients(surface, i, j, k, a, b, t, work)
    l0, l1, l2 = 1.0 - a - b, a, b
    u0, u1, u2 = (l1 * l2) ** 3, (l2 * l0) ** 3, (l0 * l1) ** 3
    total = u0 + u1 + u2
    for m in range(3):
        work[WEIGHTS + m] = 0.0
        work[NORMAL + m] = 0.0
    value, at_vertex = 0.0, not total > 1e-100
    if at_vertex:  # all edges there agree with the patch of the vertex
        u0, u1, u2, total = (0.0 if l0 > 0.5 else 1.0), (0.0 if l1 > 0.5 else 1.0), (0.0 if l2 > 0.5 else 1.0), 2.0
    first, last, opposite = 0, 0, 0
    for edge in range(3):
        if edge == 0:
            first, last, opposite, weight = j, k, 0, u0 / total
        elif edge == 1:
            first, last, opposite, weight = k, i, 1, u1 / total
        else:
            first, last, opposite, weight = i, j, 2, u2 / total
        one, other = (opposite + 1) % 3, (opposite + 2) % 3
        length, part = 0.0, 0.0
        for axis in range(3):
            side = surface.vertices[last, axis] - surface.vertices[first, axis]
            length += side * side
            part += side * (work[X + axis] - surface.vertices[first, axis])
        s = min(max(part / length, 0.0), 1.0) if length > 0.0 else 0.5
        share = s * s * s * (10.0 + s * (6.0 * s - 15.0))
        growth = 30.0 * s * s * (1.0 - s) * (1.0 - s) / length if length > 0.0 else 0.0
        if not surface.patches[first, :9].any():
            share, growth = 1.0, 0.0
        elif not surface.patches[last, :9].any():
            share, growth = 0.0, 0.0
        jet, next_jet = JETS + 10 * one, JETS + 10 * other
        here = (1.0 - share) * work[jet] + share * work[next_jet]
        value += weight * here
        work[WEIGHTS + one] += weight * (1.0 - share)
        work[WEIGHTS + other] += weight * share
        # derivative of the weight of this edge by each barycentric coordinate
        d_edge0 = d_edge1 = d_edge2 = 0.0
        if not at_vertex:
            d0 = 3.0 * l0 * l0 * (l2**3 + l1**3)  # of the sum, by l0
            d1 = 3.0 * l1 * l1 * (l2**3 + l0**3)
            d2 = 3.0 * l2 * l2 * (l1**3 + l0**3)
            d_edge0, d_edge1, d_edge2 = -weight * d0, -weight * d1, -weight * d2
            if edge == 0:
                d_edge1 += 3.0 * l1 * l1 * l2**3
                d_edge2 += 3.0 * l2 * l2 * l1**3
            elif edge == 1:
                d_edge2 += 3.0 * l2 * l2 * l0**3
                d_edge0 += 3.0 * l0 * l0 * l2**3
            else:
                d_edge0 += 3.0 * l0 * l0 * l1**3
                d_edge1 += 3.0 * l1 * l1 * l0**3
            d_edge0, d_edge1, d_edge2 = d_edge0 / total, d_edge1 / total, d_edge2 / total
        difference = weight * growth * (work[next_jet] - work[jet])
        for axis in range(3):
            side = surface.vertices[last, axis] - surface.vertices[first, axis]
            turn = (
                d_edge0 * work[GRADIENTS + axis]
                + d_edge1 * work[GRADIENTS + 3 + axis]
                + d_edge2 * work[GRADIENTS + 6 + axis]
            )
            work[NORMAL + axis] += (
                weight * ((1.0 - share) * work[jet + 1 + axis] + share * work[next_jet + 1 + axis])
                + difference * side
                + here * turn
            )
    _write_form(work)
    return value


@inner_jit()
def _write_form(work: FloatArray) -> None:
    """Normalise the gradient, and write the mean second fundamental form of the patches."""
    square, mean_square = 0.0, 0.0
    for axis in range(3):
        mean = 0.0
        for corner in range(3):
            mean += work[WEIGHTS + corner] * work[JETS + 10 * corner + 1 + axis]
        mean_square += mean * mean
        square += work[NORMAL + axis] ** 2
    work[SLOPE] = np.sqrt(square)
    per_slope = 1.0 / work[SLOPE] if square > 0.0 else 0.0
    per_mean = 1.0 / np.sqrt(mean_square) if mean_square > 0.0 else 0.0
    for axis in range(3):
        work[NORMAL + axis] *= per_slope
    for entry in range(6):
        total = 0.0
        for corner in range(3):
            total += work[WEIGHTS + corner] * work[JETS + 10 * corner + 4 + entry]
        work[FORM + entry] = total * per_mean


@inner_jit()
def _write_jets(surface: SurfaceArrays, i: int, corner: int, work: FloatArray) -> None:
    """Write f_i at X, its gradient (3,) and its Hessian (6,) in space; zeros without a patch."""
    begin, row = JETS + 10 * corner, surface.patches[i]
    dx = work[X] - row[PATCH_ORIGIN]
    dy = work[X + 1] - row[PATCH_ORIGIN + 1]
    dz = work[X + 2] - row[PATCH_ORIGIN + 2]
    x, y = row[0] * dx + row[1] * dy + row[2] * dz, row[3] * dx + row[4] * dy + row[5] * dz
    jet = work[LOCAL : LOCAL + JET]
    evaluate_patch(row, x, y, jet)
    work[begin] = row[6] * dx + row[7] * dy + row[8] * dz - jet[0]
    for axis in range(3):
        work[begin + 1 + axis] = row[6 + axis] - jet[1] * row[axis] - jet[2] * row[3 + axis]
    place = begin + 4
    for one in range(3):
        for other in range(one, 3):
            mixed = row[one] * row[3 + other] + row[3 + one] * row[other]
            work[place] = -(jet[3] * row[one] * row[other] + jet[4] * mixed + jet[5] * row[3 + one] * row[3 + other])
            place += 1


@inner_jit()
def _write_gradients(
    surface: SurfaceArrays, i: int, j: int, k: int, a: float, b: float, t: float, work: FloatArray
) -> None:
    """Write the gradients (9,) in space of the barycentric coordinates, whose map from (l_1, l_2, t) is inverted."""
    c = 1.0 - a - b
    v, n = surface.vertices, surface.normals
    x1 = v[j, 0] - v[i, 0] + t * (n[j, 0] - n[i, 0])
    y1 = v[j, 1] - v[i, 1] + t * (n[j, 1] - n[i, 1])
    z1 = v[j, 2] - v[i, 2] + t * (n[j, 2] - n[i, 2])
    x2 = v[k, 0] - v[i, 0] + t * (n[k, 0] - n[i, 0])
    y2 = v[k, 1] - v[i, 1] + t * (n[k, 1] - n[i, 1])
    z2 = v[k, 2] - v[i, 2] + t * (n[k, 2] - n[i, 2])
    x3 = c * n[i, 0] + a * n[j, 0] + b * n[k, 0]
    y3 = c * n[i, 1] + a * n[j, 1] + b * n[k, 1]
    z3 = c * n[i, 2] + a * n[j, 2] + b * n[k, 2]
    gx, gy, gz = y2 * z3 - z2 * y3, z2 * x3 - x2 * z3, x2 * y3 - y2 * x3
    hx, hy, hz = y3 * z1 - z3 * y1, z3 * x1 - x3 * z1, x3 * y1 - y3 * x1
    volume = x1 * gx + y1 * gy + z1 * gz
    per_volume = 1.0 / volume if abs(volume) > 1e-300 else 0.0
    work[GRADIENTS + 3], work[GRADIENTS + 4], work[GRADIENTS + 5] = gx * per_volume, gy * per_volume, gz * per_volume
    work[GRADIENTS + 6], work[GRADIENTS + 7], work[GRADIENTS + 8] = hx * per_volume, hy * per_volume, hz * per_volume
    for axis in range(3):
        work[GRADIENTS + axis] = -work[GRADIENTS + 3 + axis] - work[GRADIENTS + 6 + axis]
