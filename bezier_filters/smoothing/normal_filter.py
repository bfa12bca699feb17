"""A bilateral filter of face normals, and an update of the vertices that fits the filtered normals.

Each normal becomes a mean over the adjacent faces, with weights exp(-d^2 / (2 tolerance^2 v)), where d is the
difference of two normals and v the variance of its noise. The remaining noise is known, because samples of it pass
through the same means. As it falls, the weights become more selective, and the filter converges where edges and
corners, which noise does not explain, are sharp.

A second mesh with slightly displaced vertices, the probe, passes through the same filter and gives the leverages.
"""

from functools import partial
from typing import NamedTuple

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray, SingleArray
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.meshes.prepared_mesh import PreparedMesh
from bezier_filters.meshes.triangles import has_corner, unit_normal
from bezier_filters.runtime.jit import inner_jit, jit
from bezier_filters.runtime.lanes import LANES, Place, broadcast, load, multiply_add, square_root, store, where_greater
from bezier_filters.runtime.parallel import RangeTask, run_in_chunks, run_kernel
from bezier_filters.runtime.rows import ROW_LENGTH, duplicate_low, inner_products, zero_w
from bezier_filters.smoothing.chebyshev import Step, coefficients
from bezier_filters.smoothing.laplacian import MeshStars, mesh_stars

MIN_NORMAL_VARIANCE = 1e-12  # lower bound of the variance of a normal, radians^2
WEIGHT_SQUARINGS = 5
WEIGHT_POWER = 2**WEIGHT_SQUARINGS  # weights are (1 - x / power)^power, nearly exp(-x) and fast to compute
UPDATE_ROUNDS = 20  # more would fit the normals better, but the vertices would drift from their measured positions
ONE, FOUR, EIGHT = np.uint32(1), np.uint32(ROW_LENGTH), np.uint32(LANES)  # unsigned, see `lanes.Place`
AREA_LANE, VARIANCE_LANE = np.uint32(3), np.uint32(7)  # lanes of a face, see `NoisyNormals`
UPDATE_TERMS = 10  # terms of the polynomial that is equivalent to all rounds


class NoisyNormals(NamedTuple):
    """Unit normals of faces, and the effect of noise on them."""

    faces: IntArray  # (m, 3): vertices of the faces
    # (m (2 + k), 4), for each face: normal of the mesh and twice the area of the face; normal of the probe and variance
    # of the normal around the face; and changes of the normal by k samples of the noise, radians. Normals of faces
    # without area are zero. k is even.
    rows: SingleArray
    face_ptr: IntArray  # faces at each vertex, as compressed rows
    face_indices: IntArray

    @property
    def normals(self) -> SingleArray:
        """Unit normals of the mesh, (m, 3)."""
        return self._part(0)

    @property
    def probed_normals(self) -> SingleArray:
        """Unit normals of the mesh with moved vertices, (m, 3)."""
        return self._part(1)

    def _part(self, number: int) -> SingleArray:
        return self.rows.reshape(len(self.faces), -1, ROW_LENGTH)[:, number, :3]


def noisy_normals(mesh: PreparedMesh, probe: TriangleMesh, noise: SingleArray) -> NoisyNormals:
    """Normals of two meshes, and first-order changes of the first ones by samples of vertex noise (n, k, 3)."""
    m, at_vertex = mesh.face_count, mesh.adjacency.faces
    rows = np.zeros((m * (2 + noise.shape[1]), ROW_LENGTH), dtype=np.float32)
    state = NoisyNormals(mesh.faces, rows, at_vertex.indptr, at_vertex.indices)
    run_kernel(_write_normals, m, mesh.vertices, probe.vertices, noise, state)
    return state


def filter_normals(state: NoisyNormals, rounds: int, tolerance: float) -> NoisyNormals:
    """Replace every normal by its weighted mean with the adjacent ones, for a number of rounds.

    The rows of the state are overwritten. The weight of a neighbour is exp(-1/2) if the two normals differ by
    `tolerance` standard deviations of the noise of their difference.

    >>> from bezier_filters.meshes.mesh import triangle_mesh
    >>> from bezier_filters.meshes.prepared_mesh import prepare_mesh
    >>> from bezier_filters.surfaces import block_with_sharp_edges
    >>> block = prepare_mesh(triangle_mesh(*block_with_sharp_edges(resolution=6)))
    >>> noise = np.full((block.vertex_count, 2, 3), 1e-3, np.float32)
    >>> start = noisy_normals(block, block, noise)
    >>> before = start.normals.copy()
    >>> bool(np.allclose(before, filter_normals(start, 5, 2.0).normals, atol=1e-6))
    True
    """
    most = 1 + 3 * int(np.diff(state.face_ptr).max(initial=0))
    means, squares, factor = np.empty_like(state.rows), np.empty(len(state.faces), np.float32), np.float32(tolerance**2)
    run_kernel(_mean_squares, len(state.faces), state.rows, factor, squares)
    for _ in range(rounds):
        _write_variances(state, squares, np.float32(MIN_NORMAL_VARIANCE) * factor)

        def make_task(state: NoisyNormals = state, means: SingleArray = means) -> RangeTask:
            around, weights = np.empty(most, dtype=np.int32), np.empty(LANES * most, dtype=np.float32)
            return partial(_filter, state, state.rows.ravel(), means.ravel(), factor, squares, around, weights)

        run_in_chunks(make_task, len(state.faces))
        state, means = state._replace(rows=means), state.rows
    return state


def _write_variances(state: NoisyNormals, squares: SingleArray, least: np.float32) -> None:
    """Write local means of the mean squared changes of the normals, (m,), which are overwritten, too."""
    m, at_vertices = len(state.faces), np.zeros(len(state.face_ptr) - 1, dtype=np.float32)
    rows = state.rows.ravel()
    for result, stride, first in ((squares, 1, 0), (rows, len(rows) // max(m, 1), int(VARIANCE_LANE))):
        run_kernel(_average_to_vertices, len(at_vertices), state.face_ptr, state.face_indices, squares, at_vertices)
        run_kernel(_average_to_faces, m, state.faces, at_vertices, least, result, stride, first)


@jit()
def _mean_squares(rows: SingleArray, factor: np.float32, of_faces: SingleArray, start: int, stop: int) -> None:
    """Write the mean squared change of the normals of faces start .. stop-1 by the samples, times a factor."""
    stride = rows.shape[0] // of_faces.shape[0]
    for f in range(start, stop):
        total = np.float32(0.0)
        for k in range(stride * f + 2, stride * (f + 1)):
            total += rows[k, 0] ** 2 + rows[k, 1] ** 2 + rows[k, 2] ** 2
        of_faces[f] = factor * total / np.float32(stride - 2)


@jit()
def _average_to_vertices(
    face_ptr: IntArray, face_indices: IntArray, of_faces: SingleArray, at_vertices: SingleArray, start: int, stop: int
) -> None:
    for i in range(np.uint32(start), np.uint32(stop)):
        total, first, after = np.float32(0.0), np.uint32(face_ptr[i]), np.uint32(face_ptr[i + ONE])
        for q in range(first, after):
            total += of_faces[np.uint32(face_indices[q])]
        at_vertices[i] = total / np.float32(max(after - first, ONE))


@jit()
def _average_to_faces(
    faces: IntArray,
    at_vertices: SingleArray,
    least: np.float32,
    result: SingleArray,
    stride: int,
    first: int,
    start: int,
    stop: int,
) -> None:
    """Write means over the corners of faces start .. stop-1 to every so many places of a flat array."""
    for f in range(np.uint32(start), np.uint32(stop)):
        a, b, c = np.uint32(faces[f, 0]), np.uint32(faces[f, 1]), np.uint32(faces[f, 2])
        mean = (at_vertices[a] + at_vertices[b] + at_vertices[c]) / np.float32(3.0)
        result[stride * f + first] = max(mean, least)


@jit()
def _write_normals(
    vertices: FloatArray, moved: FloatArray, noise: SingleArray, result: NoisyNormals, start: int, stop: int
) -> None:
    """Write unit normals, areas and the changes of the normals."""
    faces, rows = result.faces, result.rows
    stride = rows.shape[0] // faces.shape[0]
    for f in range(start, stop):
        own = stride * f
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        rows[own + 1, 0], rows[own + 1, 1], rows[own + 1, 2], _ = unit_normal(moved, a, b, c)
        x, y, z, length = unit_normal(vertices, a, b, c)
        rows[own, 0], rows[own, 1], rows[own, 2], rows[own, 3] = x, y, z, length
        if length == 0.0:
            continue
        ux, uy, uz = vertices[b, 0] - vertices[a, 0], vertices[b, 1] - vertices[a, 1], vertices[b, 2] - vertices[a, 2]
        vx, vy, vz = vertices[c, 0] - vertices[a, 0], vertices[c, 1] - vertices[a, 1], vertices[c, 2] - vertices[a, 2]
        for k in range(noise.shape[1]):
            x0, y0, z0 = noise[a, k, 0], noise[a, k, 1], noise[a, k, 2]
            px, py, pz = noise[b, k, 0] - x0, noise[b, k, 1] - y0, noise[b, k, 2] - z0
            qx, qy, qz = noise[c, k, 0] - x0, noise[c, k, 1] - y0, noise[c, k, 2] - z0
            dx = (py * vz - pz * vy + uy * qz - uz * qy) / length
            dy = (pz * vx - px * vz + uz * qx - ux * qz) / length
            dz = (px * vy - py * vx + ux * qy - uy * qx) / length
            along = dx * x + dy * y + dz * z
            sample = own + 2 + k
            rows[sample, 0], rows[sample, 1], rows[sample, 2] = dx - along * x, dy - along * y, dz - along * z


@jit()
def _filter(
    state: NoisyNormals,
    rows: SingleArray,
    means: SingleArray,
    factor: np.float32,
    squares: SingleArray,
    around: IntArray,
    weights: SingleArray,
    start: int,
    stop: int,
) -> None:
    """Write the means of faces start .. stop-1 with the faces that share a vertex with them.

    Rows and means are flat; lanes hold two rows. `squares` get the mean squared changes of the normals, times a factor.
    Work space for the faces around one and the lanes of their weights.
    """
    pairs = np.uint32(len(rows) // (LANES * len(state.faces)))  # of rows for each face
    one, zero = broadcast(np.float32(1.0)), broadcast(np.float32(0.0))
    for f in range(np.uint32(start), np.uint32(stop)):
        own, count = pairs * f, _faces_around(state, f, around)
        here, area, variance = load(rows, own), rows[EIGHT * own + AREA_LANE], rows[EIGHT * own + VARIANCE_LANE]
        normals = broadcast(area) * here
        for q in range(np.uint32(count)):
            g = pairs * np.uint32(around[q])
            there, scale = load(rows, g), np.float32(-0.5 / WEIGHT_POWER) / (variance + rows[EIGHT * g + VARIANCE_LANE])
            # Agreement of the two normals with those of the other face.
            weight = one + broadcast(scale) * inner_products(here - there, here - there)
            weight = where_greater(weight, zero, weight, zero)
            for _ in range(WEIGHT_SQUARINGS):
                weight = weight * weight
            weight = weight * broadcast(rows[EIGHT * g + AREA_LANE])
            normals = multiply_add(weight, there, normals)
            store(weights, q, duplicate_low(weight))
        lengths = square_root(inner_products(normals, normals))
        normals = zero_w(where_greater(lengths, zero, normals / lengths, normals))
        store(means, own, normals)
        means[EIGHT * own + AREA_LANE] = area
        normal, inverse = duplicate_low(normals), duplicate_low(where_greater(lengths, zero, one / lengths, zero))
        total = np.float32(0.0)
        for k in range(ONE, pairs):
            samples = broadcast(area) * load(rows, own + k)
            for q in range(np.uint32(count)):
                samples = multiply_add(load(weights, q), load(rows, pairs * np.uint32(around[q]) + k), samples)
            samples = inverse * samples
            samples = samples - inner_products(samples, normal) * normal
            store(means, own + k, samples)
            store(weights, count, inner_products(samples, samples))  # beyond the weights
            total += weights[EIGHT * count]
            total += weights[EIGHT * count + FOUR]
        squares[f] = factor * total / np.float32(2 * (pairs - 1))


@inner_jit()
def _faces_around(state: NoisyNormals, f: Place, around: IntArray) -> np.uint32:
    """Write the faces that share a vertex with one, each once; return their number.

    All are written, and repeated ones are overwritten: a branch would be mispredicted for every third one.
    Numbers are unsigned here, see `lanes.Place`.
    """
    faces, face_ptr, face_indices, count = state.faces, state.face_ptr, state.face_indices, np.uint32(0)
    a, b, c = int(np.uint32(faces[f, 0])), int(np.uint32(faces[f, 1])), int(np.uint32(faces[f, 2]))
    for q in range(np.uint32(face_ptr[a]), np.uint32(face_ptr[a + 1])):
        around[count] = g = int(np.uint32(face_indices[q]))
        count += np.uint32(g != f)
    for q in range(np.uint32(face_ptr[b]), np.uint32(face_ptr[b + 1])):
        around[count] = g = int(np.uint32(face_indices[q]))
        count += np.uint32(not has_corner(faces, g, a))
    for q in range(np.uint32(face_ptr[c]), np.uint32(face_ptr[c + 1])):
        around[count] = g = int(np.uint32(face_indices[q]))
        count += np.uint32(not (has_corner(faces, g, a) or has_corner(faces, g, b)))
    return count


def move_to_normals(mesh: PreparedMesh, normals: SingleArray, movable: BoolArray) -> SingleArray:
    """Move the vertices so that the faces become perpendicular to given normals.

    Each round moves every vertex by the mean of its projections onto the planes through the centers of its faces,
    x_i += mean of ((c_f - x_i) . n_f) n_f: gradient descent for the sum of ((x_i - c_f) . n_f)^2 (after
    Sun, Rosin, Martin, Langbein, "Fast and effective feature-preserving mesh denoising", TVCG 2007).
    The first step is linear in the coordinates, b = -A x, and all of them together are the polynomial
    (1 - (1 - A)^rounds) / A of b, which a short Chebyshev series gives: the eigenvalues of A lie in [0, 1].

    Faces whose normals (m, 3) are zero are ignored; vertices that are not movable (n,) stay. Returns the moves, (n, 3).
    """
    stars = mesh_stars(mesh)
    planes = np.zeros((mesh.face_count, 4), dtype=np.float32)
    planes[:, :3] = normals
    before, current, result = np.zeros((3, mesh.vertex_count, 3), dtype=np.float32)
    run_kernel(_first_step, len(result), stars, planes, movable, current)
    polynomial = coefficients(lambda x: (-np.expm1(UPDATE_ROUNDS * np.log1p(-x)) / x)[:, np.newaxis], 1.0, UPDATE_TERMS)
    for k, coefficient in enumerate(polynomial[:, 0].astype(np.float32)):
        step = Step(np.float32(2.0), np.float32(min(k, 2)), before, current)
        run_kernel(_heights, mesh.face_count, mesh.faces, current, planes)
        run_kernel(_advance, len(result), stars, planes, movable, step, coefficient, result)
        if k > 0:
            before, current = current, before
    return result


@jit()
def _first_step(
    mesh: MeshStars, planes: SingleArray, movable: BoolArray, moves: SingleArray, start: int, stop: int
) -> None:
    """Write the moves of vertices start .. stop-1 in the first round."""
    vertices, faces, face_ptr, face_indices = mesh
    for i in range(np.uint32(start), np.uint32(stop)):
        if not movable[i]:
            continue
        x, y, z = vertices[i, 0], vertices[i, 1], vertices[i, 2]
        sx, sy, sz = 0.0, 0.0, 0.0
        first, after = np.uint32(face_ptr[i]), np.uint32(face_ptr[i + ONE])
        for q in range(first, after):
            f = np.uint32(face_indices[q])
            a, b, c = np.uint32(faces[f, 0]), np.uint32(faces[f, 1]), np.uint32(faces[f, 2])
            nx, ny, nz = planes[f, 0], planes[f, 1], planes[f, 2]
            height = (
                ((vertices[a, 0] - x) + (vertices[b, 0] - x) + (vertices[c, 0] - x)) * nx
                + ((vertices[a, 1] - y) + (vertices[b, 1] - y) + (vertices[c, 1] - y)) * ny
                + ((vertices[a, 2] - z) + (vertices[b, 2] - z) + (vertices[c, 2] - z)) * nz
            ) / 3.0
            sx, sy, sz = sx + height * nx, sy + height * ny, sz + height * nz
        count = max(after - first, ONE)
        moves[i, 0], moves[i, 1], moves[i, 2] = sx / count, sy / count, sz / count


@jit()
def _heights(faces: IntArray, moves: SingleArray, planes: SingleArray, start: int, stop: int) -> None:
    """Write the moves of the centers of faces start .. stop-1 along their normals."""
    third = np.float32(1.0 / 3.0)
    for f in range(np.uint32(start), np.uint32(stop)):
        a, b, c = np.uint32(faces[f, 0]), np.uint32(faces[f, 1]), np.uint32(faces[f, 2])
        planes[f, 3] = third * (
            (moves[a, 0] + moves[b, 0] + moves[c, 0]) * planes[f, 0]
            + (moves[a, 1] + moves[b, 1] + moves[c, 1]) * planes[f, 1]
            + (moves[a, 2] + moves[b, 2] + moves[c, 2]) * planes[f, 2]
        )


@jit()
def _advance(
    mesh: MeshStars,
    planes: SingleArray,
    movable: BoolArray,
    step: Step,
    coefficient: np.float32,
    result: SingleArray,
    start: int,
    stop: int,
) -> None:
    """Overwrite T_k-1 by T_k+1 = 2 (2 A - 1) T_k - T_k-1, or T_1; add it to the result. Factor 0 leaves T_0."""
    face_ptr, face_indices = mesh.face_ptr, mesh.face_indices
    double, factor, before, current = step
    for i in range(np.uint32(start), np.uint32(stop)):
        if not movable[i]:
            continue
        x, y, z = current[i, 0], current[i, 1], current[i, 2]
        if factor > np.float32(0.0):
            sx = sy = sz = np.float32(0.0)
            begin, after = np.uint32(face_ptr[i]), np.uint32(face_ptr[i + ONE])
            for q in range(begin, after):
                f = np.uint32(face_indices[q])
                nx, ny, nz = planes[f, 0], planes[f, 1], planes[f, 2]
                height = x * nx + y * ny + z * nz - planes[f, 3]
                sx += height * nx
                sy += height * ny
                sz += height * nz
            scale = double * factor / np.float32(max(after - begin, ONE))
            kept = factor - np.float32(1.0)
            x = before[i, 0] = scale * sx - factor * x - kept * before[i, 0]
            y = before[i, 1] = scale * sy - factor * y - kept * before[i, 1]
            z = before[i, 2] = scale * sz - factor * z - kept * before[i, 2]
        result[i, 0] += coefficient * x
        result[i, 1] += coefficient * y
        result[i, 2] += coefficient * z
