"""The nearest place on the blended surface, by Newton's method on its faces."""

from typing import NamedTuple

import numpy as np

from bezier_filters.arrays import ByteArray, FloatArray, IntArray
from bezier_filters.meshes.box_tree import BoxTree
from bezier_filters.meshes.frames import unit_face_normal
from bezier_filters.patch_surface.blending import (
    FORM,
    NORMAL,
    SIZE,
    WEIGHTS,
    SurfaceArrays,
    T,
    X,
    approach_surface,
    place_on_surface,
)
from bezier_filters.patch_surface.nearest_face import COORDINATE_1, COORDINATE_2, PLACE_SIZE, STACK_SIZE, nearest_face
from bezier_filters.runtime.jit import inner_jit, jit
from bezier_filters.runtime.parallel import RangeTask

MAX_MOVES = 48  # Newton steps, shorter ones and changes of the face for one point; most need four to six
# A step that leads farther away is halved while it is longer than this, in barycentric coordinates, if the next one
# towards the surface is at most this part of the size of the face.
MIN_SHORTENED, MAX_RISE = 1e-3, 0.1
PROJECTION_ACCURACY = (
    1e-8  # least step in barycentric coordinates and sizes of the face; errors of distances: its square
)
ON_EDGE = 1e-14  # barycentric coordinate up to which a place is on an edge: rounding errors
# Newton step, over the size of the face, from which on the nearest place of a path that ends nowhere is good enough: at
# vertices of noisy meshes, where the second derivatives of the surface jump, steps do not become shorter. Of the
# vertices of a torus with noise of a tenth of an edge 3 % have no place, and 6 % with a tenth of it; 28 % of a coarser
# torus had none without it.
STATIONARY = 1e-3
NEIGHBOUR_PATHS = 39  # from a face across one edge, two or three; two leave three times as many queries
MIN_NEWTON_RATIO = 1e-3  # least determinant of Newton's matrix over that of its positive part
TANGENTS, RATES, WORK_SIZE = SIZE, SIZE + 6, SIZE + 8  # columns of the scratch array of a thread
# Outcomes of a query, see `PlaceStatus`
ON_SURFACE, AT_BORDER, NOT_CONVERGED, ON_FACE, NO_PLACE = 0, 1, 2, 3, 4


class Places(NamedTuple):
    """Results at q points, as in `SurfacePoints`."""

    face: IntArray  # (q,)
    coordinates: FloatArray  # (q, 2): barycentric coordinates of corners 1 and 2
    points: FloatArray  # (q, 3)
    normals: FloatArray
    curvatures: FloatArray  # (q, 2): smaller and larger one
    directions: FloatArray  # (q, 2, 3): of these
    errors: FloatArray  # (q, 4): as in `SurfaceArrays`
    outcome: ByteArray  # (q,)


def projection_task(
    surface: SurfaceArrays, tree: BoxTree, queries: FloatArray, order: IntArray, places: Places
) -> RangeTask:
    """Task for one thread: find the places nearest to queries[order[start:stop]]."""
    work, stack, place = np.empty(WORK_SIZE), np.empty(STACK_SIZE, np.int32), np.empty(2 * PLACE_SIZE)

    def run(start: int, stop: int) -> None:
        project_points(surface, tree, queries, order, start, stop, work, stack, place, places)

    return run


def evaluation_task(surface: SurfaceArrays, places: Places) -> RangeTask:
    """Task for one thread: find the surface over given places of faces."""
    work = np.empty(WORK_SIZE)

    def run(start: int, stop: int) -> None:
        evaluate_places(surface, start, stop, work, places)

    return run


@jit()
def evaluate_places(surface: SurfaceArrays, start: int, stop: int, work: FloatArray, places: Places) -> None:
    """Find the surface over the given places, rows start .. stop-1."""
    for q in range(start, stop):
        f, a, b = places.face[q], places.coordinates[q, 0], places.coordinates[q, 1]
        places.outcome[q] = ON_SURFACE if place_on_surface(surface, f, a, b, work) else ON_FACE
        write_place(surface, f, a, b, work, q, places)


@jit()
def project_points(
    surface: SurfaceArrays,
    tree: BoxTree,
    queries: FloatArray,
    order: IntArray,
    start: int,
    stop: int,
    work: FloatArray,
    stack: IntArray,
    place: FloatArray,
    places: Places,
) -> None:
    """Find the places nearest to queries[order[start:stop]]."""
    guess = -1
    for q in order[start:stop]:
        x, y, z = queries[q, 0], queries[q, 1], queries[q, 2]
        guess = nearest_face(surface.vertices, surface.faces, tree, x, y, z, guess, stack, place)
        if guess < 0:
            places.outcome[q] = NO_PLACE
            continue
        f, a, b, outcome = descend(surface, guess, place[COORDINATE_1], place[COORDINATE_2], x, y, z, work)
        if outcome == NOT_CONVERGED:
            f, a, b, outcome = _descend_from_neighbours(surface, guess, f, a, b, x, y, z, work)
        if outcome == NOT_CONVERGED:
            f, a, b, outcome = descend(
                surface, guess, place[COORDINATE_1], place[COORDINATE_2], x, y, z, work, STATIONARY
            )
        places.outcome[q] = outcome
        write_place(surface, f, a, b, work, q, places)


@inner_jit()
def _descend_from_neighbours(
    surface: SurfaceArrays, start: int, f: int, a: float, b: float, x: float, y: float, z: float, work: FloatArray
) -> tuple[int, float, float, int]:
    """Nearest of the places reached from faces around the first one, or else place (a, b) of face f, not converged.

    Where noise turns faces over, the surface over them runs back, and paths end at the edge where it turns.
    """
    least, found_f, found_a, found_b, found = np.inf, f, a, b, NOT_CONVERGED
    for path in range(NEIGHBOUR_PATHS):
        face, rest = start, path
        while rest >= 0 and face >= 0:  # digits of the path are edges
            face, rest = surface.neighbours[face, rest % 3], rest // 3 - 1
        if face < 0:
            continue
        f, a, b, outcome = descend(surface, face, 1.0 / 3.0, 1.0 / 3.0, x, y, z, work)
        squared = (x - work[X]) ** 2 + (y - work[X + 1]) ** 2 + (z - work[X + 2]) ** 2
        if outcome == ON_SURFACE and squared < least:
            least, found_f, found_a, found_b, found = squared, f, a, b, outcome
    # for what follows from the position
    if not place_on_surface(surface, found_f, found_a, found_b, work):
        found = ON_FACE
    return found_f, found_a, found_b, found


@inner_jit()
def descend(
    surface: SurfaceArrays,
    f: int,
    a: float,
    b: float,
    x: float,
    y: float,
    z: float,
    work: FloatArray,
    accuracy: float = 0.0,
) -> tuple[int, float, float, int]:
    """From a place on a face, move to the place on the surface nearest to (x, y, z): face, coordinates, outcome.

    Where a step leaves the face it goes on in the next one; at a border it goes along it. Of a path that ends nowhere,
    the nearest place is taken if the step from there is shorter than the accuracy.
    """
    previous = -1
    work[T] = 0.0
    # the last accepted place, its squared distance, and the step from there, in parts
    at_f, at_a, at_b, at_t, least, taken_a, taken_b, part = f, a, b, 0.0, np.inf, 0.0, 0.0, 1.0
    rate_a = rate_b = at_g1 = at_g2 = 0.0
    best_f, best_a, best_b, best, best_step = f, a, b, np.inf, np.inf
    for _ in range(MAX_MOVES):
        rise = approach_surface(surface, f, a, b, work)
        if not rise < np.inf:
            return f, a, b, ON_FACE
        squared = (x - work[X]) ** 2 + (y - work[X + 1]) ** 2 + (z - work[X + 2]) ** 2
        if squared > least and rise < MAX_RISE and part * max(abs(taken_a), abs(taken_b)) > MIN_SHORTENED:
            part *= 0.5
            f, previous = at_f, -1
            a, b = _move(at_a, at_b, part * taken_a, part * taken_b)
            work[T] = at_t + (a - at_a) * rate_a + (b - at_b) * rate_b
            continue
        g1, g2, h11, h12, h22 = _derivatives(surface, f, a, b, x, y, z, work)
        if f == at_f and rise < MAX_RISE:
            h11, h12, h22 = _match_step(h11, h12, h22, a - at_a, b - at_b, at_g1 - g1, at_g2 - g2)
        at_f, at_a, at_b, at_t, taken_a, taken_b, part = f, a, b, work[T], 0.0, 0.0, 1.0
        at_g1, at_g2, least = g1, g2, squared if rise < MAX_RISE else np.inf
        determinant = h11 * h22 - h12 * h12
        if not determinant > 0.0:
            return f, a, b, NOT_CONVERGED
        step_a, step_b = (h22 * g1 - h12 * g2) / determinant, (h11 * g2 - h12 * g1) / determinant
        if max(abs(step_a), abs(step_b), rise) < PROJECTION_ACCURACY:
            return f, a, b, ON_SURFACE
        if squared < best and rise < accuracy:
            best_f, best_a, best_b, best = f, a, b, squared
            best_step = (g1 * step_a + g2 * step_b) / np.sqrt(determinant)
        edge = _edge_left(a, b, step_a, step_b, -1)
        if edge >= 0:
            other = surface.neighbours[f, (edge + 1) % 3]
            if other >= 0 and other != previous:
                previous = f
                f, a, b = _enter(surface, f, other, a, b)
                continue
            at_border = other < 0
            # along the edge, from corner edge + 1 to the next
            u1 = -1.0 if edge == 0 else 0.0 if edge == 1 else 1.0
            u2 = 1.0 if edge == 0 else -1.0 if edge == 1 else 0.0
            along = (g1 * u1 + g2 * u2) / (h11 * u1 * u1 + 2.0 * h12 * u1 * u2 + h22 * u2 * u2)
            if max(abs(along), rise) < PROJECTION_ACCURACY:
                if other < 0:
                    return f, a, b, AT_BORDER
                break
            step_a, step_b = along * u1, along * u2
            second = _edge_left(a, b, step_a, step_b, edge)
            if second >= 0:
                other = surface.neighbours[f, (second + 1) % 3]
                if other < 0 or other == previous:
                    if other < 0 or at_border:
                        return f, a, b, AT_BORDER
                    break
                previous = f
                f, a, b = _enter(surface, f, other, a, b)
                continue
        else:
            previous = -1
        taken_a, taken_b, rate_a, rate_b = step_a, step_b, work[RATES], work[RATES + 1]
        a, b = _move(a, b, step_a, step_b)
        work[T] = at_t + (a - at_a) * rate_a + (b - at_b) * rate_b
    if best_step < accuracy * accuracy and place_on_surface(surface, best_f, best_a, best_b, work):
        return best_f, best_a, best_b, ON_SURFACE
    return f, a, b, NOT_CONVERGED


@inner_jit()
def _derivatives(
    surface: SurfaceArrays, f: int, a: float, b: float, x: float, y: float, z: float, work: FloatArray
) -> tuple[float, float, float, float, float]:
    """Gradient J' r and matrix J' J + (r N) J' B J of Newton's step for the residual r = (x, y, z) - S(a, b).

    As N S_a = 0, N S_ab = - J' B J with the second fundamental form B, convex positive. Where the matrix is indefinite,
    beyond a centre of curvature, its first part replaces it.
    """
    i, j, k = surface.faces[f, 0], surface.faces[f, 1], surface.faces[f, 2]
    t, c = work[T], 1.0 - a - b
    ray = rise1 = rise2 = 0.0
    for axis in range(3):
        n0, normal = surface.normals[i, axis], work[NORMAL + axis]
        ray += normal * (c * n0 + a * surface.normals[j, axis] + b * surface.normals[k, axis])
        v0 = surface.vertices[i, axis]
        rise1 += normal * (surface.vertices[j, axis] - v0 + t * (surface.normals[j, axis] - n0))
        rise2 += normal * (surface.vertices[k, axis] - v0 + t * (surface.normals[k, axis] - n0))
    j11 = j12 = j22 = g1 = g2 = height = 0.0
    tangent = work[TANGENTS : TANGENTS + 6]
    for axis in range(3):
        n0, v0 = surface.normals[i, axis], surface.vertices[i, axis]
        along = c * n0 + a * surface.normals[j, axis] + b * surface.normals[k, axis]
        s1 = surface.vertices[j, axis] - v0 + t * (surface.normals[j, axis] - n0) - rise1 / ray * along
        s2 = surface.vertices[k, axis] - v0 + t * (surface.normals[k, axis] - n0) - rise2 / ray * along
        residual = (x if axis == 0 else y if axis == 1 else z) - work[X + axis]
        tangent[axis], tangent[3 + axis] = s1, s2
        j11, j12, j22 = j11 + s1 * s1, j12 + s1 * s2, j22 + s2 * s2
        g1, g2, height = g1 + s1 * residual, g2 + s2 * residual, height + work[NORMAL + axis] * residual
    work[RATES], work[RATES + 1] = -rise1 / ray, -rise2 / ray  # of the height T along the surface
    form = work[FORM : FORM + 6]
    h11 = j11 + height * _form(form, tangent[:3], tangent[:3])
    h12 = j12 + height * _form(form, tangent[:3], tangent[3:])
    h22 = j22 + height * _form(form, tangent[3:], tangent[3:])
    if h11 > 0.0 and h11 * h22 - h12 * h12 > MIN_NEWTON_RATIO * (j11 * j22 - j12 * j12):
        return g1, g2, h11, h12, h22
    return g1, g2, j11, j12, j22


@inner_jit()
def _match_step(
    h11: float, h12: float, h22: float, s1: float, s2: float, y1: float, y2: float
) -> tuple[float, float, float]:
    """The matrix H updated by BFGS so that it maps the last step s to the change y of the gradient, if s'y > 0.

    The blended surface bends more between patches that differ than they do, which `_derivatives` does not see.
    """
    v1, v2, along = h11 * s1 + h12 * s2, h12 * s1 + h22 * s2, y1 * s1 + y2 * s2
    before = s1 * v1 + s2 * v2
    if not (along > MIN_NEWTON_RATIO * before and before > 0.0):
        return h11, h12, h22
    return (
        h11 + y1 * y1 / along - v1 * v1 / before,
        h12 + y1 * y2 / along - v1 * v2 / before,
        h22 + y2 * y2 / along - v2 * v2 / before,
    )


@inner_jit()
def _form(form: FloatArray, u: FloatArray, v: FloatArray) -> float:
    """The bilinear form u' B v of a symmetric matrix with the entries xx, xy, xz, yy, yz, zz."""
    x = form[0] * v[0] + form[1] * v[1] + form[2] * v[2]
    y = form[1] * v[0] + form[3] * v[1] + form[4] * v[2]
    z = form[2] * v[0] + form[4] * v[1] + form[5] * v[2]
    return float(u[0] * x + u[1] * y + u[2] * z)


@inner_jit()
def _edge_left(a: float, b: float, step_a: float, step_b: float, except_edge: int) -> int:
    """The edge, by its opposite corner, that a place is on and that a step leaves the face across; -1 if none."""
    edge, most = -1, 0.0
    for m in range(3):
        coordinate = a if m == 1 else b if m == 2 else 1.0 - a - b
        step = step_a if m == 1 else step_b if m == 2 else -step_a - step_b
        if m != except_edge and coordinate <= ON_EDGE and step < most:
            edge, most = m, step
    return edge


@inner_jit()
def _move(a: float, b: float, step_a: float, step_b: float) -> tuple[float, float]:
    """Move by a step, or to the edge that it crosses."""
    part, edge = 1.0, -1
    for m in range(3):
        coordinate = a if m == 1 else b if m == 2 else 1.0 - a - b
        step = step_a if m == 1 else step_b if m == 2 else -step_a - step_b
        if coordinate > ON_EDGE and coordinate + part * step < 0.0:
            part, edge = -coordinate / step, m
    a, b = max(a + part * step_a, 0.0), max(b + part * step_b, 0.0)
    if edge == 0:
        total = a + b
        a, b = a / total, b / total
    elif edge == 1:
        a = 0.0
    elif edge == 2:
        b = 0.0
    return a, b


@inner_jit()
def _enter(surface: SurfaceArrays, f: int, other: int, a: float, b: float) -> tuple[int, float, float]:
    """The place with coordinates (a, b) on an edge of face f in the other face at that edge."""
    found_a = found_b = 0.0
    for m in range(3):
        coordinate = a if m == 1 else b if m == 2 else 1.0 - a - b
        if surface.faces[other, 1] == surface.faces[f, m]:
            found_a = coordinate
        elif surface.faces[other, 2] == surface.faces[f, m]:
            found_b = coordinate
    return other, found_a, found_b


@inner_jit()
def write_place(surface: SurfaceArrays, f: int, a: float, b: float, work: FloatArray, q: int, places: Places) -> None:
    """Write the results of a place, with zero curvature on the face itself where it has no surface."""
    places.face[q], places.coordinates[q, 0], places.coordinates[q, 1] = f, a, b
    corners = surface.faces[f]
    if places.outcome[q] == ON_FACE:
        nx, ny, nz = unit_face_normal(surface.vertices, surface.faces, f)
        places.normals[q, 0], places.normals[q, 1], places.normals[q, 2] = nx, ny, nz
        for axis in range(3):
            places.points[q, axis] = (
                (1.0 - a - b) * surface.vertices[corners[0], axis]
                + a * surface.vertices[corners[1], axis]
                + b * surface.vertices[corners[2], axis]
            )
        return
    for axis in range(3):
        places.points[q, axis], places.normals[q, axis] = work[X + axis], work[NORMAL + axis]
    for column in range(places.errors.shape[1]):
        total = 0.0
        for m in range(3):
            total += work[WEIGHTS + m] * surface.errors[corners[m], column]
        places.errors[q, column] = total
    # an orthonormal tangent basis: the coordinate axis farthest from the normal, made tangential, and its cross product
    normal, basis = work[NORMAL : NORMAL + 3], work[TANGENTS : TANGENTS + 6]
    least = 0 if abs(normal[0]) < abs(normal[1]) else 1
    least = least if abs(normal[least]) < abs(normal[2]) else 2
    length = np.sqrt(1.0 - normal[least] * normal[least])
    for axis in range(3):
        basis[axis] = ((1.0 if axis == least else 0.0) - normal[least] * normal[axis]) / length
    basis[3] = normal[1] * basis[2] - normal[2] * basis[1]
    basis[4] = normal[2] * basis[0] - normal[0] * basis[2]
    basis[5] = normal[0] * basis[1] - normal[1] * basis[0]
    form = work[FORM : FORM + 6]
    s11, s12 = _form(form, basis[:3], basis[:3]), _form(form, basis[:3], basis[3:])
    s22 = _form(form, basis[3:], basis[3:])
    mean, difference = 0.5 * (s11 + s22), 0.5 * (s11 - s22)
    torsion = np.hypot(difference, s12)
    places.curvatures[q, 0], places.curvatures[q, 1] = mean - torsion, mean + torsion
    d1, d2 = (difference + torsion, s12) if difference > 0.0 else (s12, torsion - difference)
    norm = np.hypot(d1, d2)
    d1, d2 = (d1 / norm, d2 / norm) if norm > 0.0 else (1.0, 0.0)
    for axis in range(3):
        places.directions[q, 1, axis] = d1 * basis[axis] + d2 * basis[3 + axis]
    for axis in range(3):
        one, two = (axis + 1) % 3, (axis + 2) % 3
        places.directions[q, 0, axis] = (
            normal[one] * places.directions[q, 1, two] - normal[two] * places.directions[q, 1, one]
        )
