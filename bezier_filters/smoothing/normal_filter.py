"""Face normals without their noise, and vertices that fit them.

The normals become means over the faces around that agree up to the noise. A face's neighbours count the less, the
farther their normals are from its own, in units of the noise that is left in both (a bilateral filter). The noise is
known: samples of it pass through the same means. So the filter becomes ever pickier as the noise falls, and comes to
rest by itself where edges and corners, which noise does not explain, are as sharp as they are going to be.

To tell how far the result follows the data, a mesh whose vertices are moved a little, the probe, passes along.
"""

from functools import partial
from typing import NamedTuple

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray, SingleArray
from bezier_filters.meshes.adjacency import Adjacency, Rows
from bezier_filters.meshes.frames import face_normal
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.meshes.triangles import has_corner
from bezier_filters.runtime.jit import inner_jit, jit
from bezier_filters.runtime.parallel import RangeTask, run_in_chunks, run_kernel
from bezier_filters.smoothing.chebyshev import Step, coefficients
from bezier_filters.smoothing.laplacian import MeshStars, mesh_stars

SMALLEST_VARIANCE = 1e-12  # of a normal, radians^2: below that everything agrees only with itself
SQUARINGS = 5
POWER = 2**SQUARINGS  # weights are (1 - x / power)^power, nearly exp(-x) and soon computed
UPDATE_ROUNDS = 20  # more would fit the normals better, but let the vertices drift away from where they were measured
TERMS = 10  # of the polynomial that does as much as all rounds


class NoisyNormals(NamedTuple):
    """Unit normals of faces, and what noise did to them."""

    faces: IntArray  # (m, 3): vertices of the faces
    # (m, 8): normal of the mesh, twice the area of the face, normal of the probe, variance of the normal around the
    # face. Normals of faces without area are zero.
    both: SingleArray
    samples: SingleArray  # (m, k, 3): changes of the normals by k samples of the noise, radians

    @property
    def normals(self) -> SingleArray:
        """Unit normals of the mesh, (m, 3)."""
        return self.both[:, 0:3]

    @property
    def probed_normals(self) -> SingleArray:
        """Unit normals of the mesh with moved vertices, (m, 3)."""
        return self.both[:, 4:7]


def noisy_normals(mesh: TriangleMesh, probe: TriangleMesh, noise: SingleArray, *, threads: int = 1) -> NoisyNormals:
    """Normals of two meshes, and how samples of the noise of vertices (n, k, 3) turn the first ones, to first order."""
    m = mesh.face_count
    both, samples = np.zeros((m, 8), dtype=np.float32), np.zeros((m, noise.shape[1], 3), dtype=np.float32)
    result = NoisyNormals(mesh.faces, both, samples)
    run_kernel(_write_normals, m, mesh.vertices, probe.vertices, noise, result, threads=threads)
    return result


def filter_normals(
    state: NoisyNormals, faces_at: Rows, rounds: int, tolerance: float, *, threads: int = 1
) -> NoisyNormals:
    """Replace every normal by its mean with those around it, some rounds.

    The arrays of the state are overwritten. A neighbour weighs exp(-1/2) if two normals differ by `tolerance` standard
    deviations of what noise makes of their difference.

    >>> from bezier_filters.meshes.adjacency import vertex_adjacency
    >>> from bezier_filters.meshes.mesh import triangle_mesh
    >>> from bezier_filters.surfaces import block_with_sharp_edges
    >>> block = triangle_mesh(*block_with_sharp_edges(resolution=6))
    >>> start = noisy_normals(block, block, np.full((block.vertex_count, 2, 3), 1e-3, np.float32))
    >>> before = start.normals.copy()
    >>> end = filter_normals(start, vertex_adjacency(block).faces, 5, 2.0)
    >>> bool(np.allclose(before, end.normals, atol=1e-6))
    True
    """
    rows = faces_at.indptr, faces_at.indices
    most = 1 + 3 * int(faces_at.lengths.max(initial=0))
    result = state._replace(both=np.zeros_like(state.both), samples=np.zeros_like(state.samples))
    for _ in range(rounds):
        _write_variances(state, faces_at, tolerance, threads)

        def make_task(old: NoisyNormals = state, new: NoisyNormals = result) -> RangeTask:
            around, weights = np.empty(most, dtype=np.int32), np.empty((most, 2), dtype=np.float32)
            return partial(_filter, *rows, old, new, around, weights)

        run_in_chunks(make_task, len(state.faces), threads=threads)
        state, result = result, state
    return state


def _write_variances(state: NoisyNormals, faces_at: Rows, tolerance: float, threads: int) -> None:
    """Write the mean squared change of the normals around each face, times the squared tolerance."""
    faces, both = state.faces, state.both
    m, n = len(faces), len(faces_at.lengths)
    values = np.zeros(n, dtype=np.float32)
    squared, least = np.float32(tolerance**2), np.float32(SMALLEST_VARIANCE)
    run_kernel(_mean_squares, m, state.samples, squared, both, threads=threads)
    for _ in range(2):
        run_kernel(_to_vertices, n, faces_at.indptr, faces_at.indices, both, values, threads=threads)
        run_kernel(_to_faces, m, faces, values, least * squared, both, threads=threads)


@jit()
def _mean_squares(samples: SingleArray, factor: np.float32, both: SingleArray, start: int, stop: int) -> None:
    for f in range(start, stop):
        total = np.float32(0.0)
        for k in range(samples.shape[1]):
            total += samples[f, k, 0] ** 2 + samples[f, k, 1] ** 2 + samples[f, k, 2] ** 2
        both[f, 7] = factor * total / np.float32(samples.shape[1])


@jit()
def _to_vertices(
    face_ptr: IntArray, face_indices: IntArray, both: SingleArray, values: SingleArray, start: int, stop: int
) -> None:
    for i in range(start, stop):
        total = np.float32(0.0)
        for q in range(face_ptr[i], face_ptr[i + 1]):
            total += both[face_indices[q], 7]
        values[i] = total / np.float32(max(face_ptr[i + 1] - face_ptr[i], 1))


@jit()
def _to_faces(
    faces: IntArray, values: SingleArray, least: np.float32, both: SingleArray, start: int, stop: int
) -> None:
    for f in range(start, stop):
        mean = (values[faces[f, 0]] + values[faces[f, 1]] + values[faces[f, 2]]) / np.float32(3.0)
        both[f, 7] = max(mean, least)


@jit()
def _write_normals(
    vertices: FloatArray, moved: FloatArray, noise: SingleArray, result: NoisyNormals, start: int, stop: int
) -> None:
    """Write unit normals, areas and the changes of the normals."""
    faces, both, samples = result
    for f in range(start, stop):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        x, y, z = face_normal(moved, faces, f)
        length = np.sqrt(x * x + y * y + z * z)
        if length > 0.0:
            both[f, 4], both[f, 5], both[f, 6] = x / length, y / length, z / length
        x, y, z = face_normal(vertices, faces, f)
        length = np.sqrt(x * x + y * y + z * z)
        both[f, 3] = length
        if length == 0.0:
            continue
        x, y, z = x / length, y / length, z / length
        both[f, 0], both[f, 1], both[f, 2] = x, y, z
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
            samples[f, k, 0], samples[f, k, 1], samples[f, k, 2] = dx - along * x, dy - along * y, dz - along * z


@jit()
def _filter(
    face_ptr: IntArray,
    face_indices: IntArray,
    old: NoisyNormals,
    new: NoisyNormals,
    around: IntArray,
    weights: SingleArray,
    start: int,
    stop: int,
) -> None:
    """Write the means of faces start .. stop-1 with the faces that share a vertex with them.

    Work space for the faces around one and their weights, by the normals of both meshes.
    """
    faces, both, samples = old
    _, new_both, new_samples = new
    for f in range(start, stop):
        around[0], weights[0, 0], weights[0, 1], count = f, both[f, 3], both[f, 3], 1
        new_both[f, 3] = both[f, 3]
        for corner in range(3):
            i = faces[f, corner]
            for q in range(face_ptr[i], face_ptr[i + 1]):
                g = face_indices[q]
                if g != f and not _met_before(faces, f, corner, g):
                    around[count] = g
                    weights[count, 0] = _weight(both, f, g, 0)
                    weights[count, 1] = _weight(both, f, g, 4)
                    count += 1
        for first in range(0, 5, 4):
            x = y = z = np.float32(0.0)
            for q in range(count):
                g, weight = around[q], weights[q, first // 4]
                x += weight * both[g, first]
                y += weight * both[g, first + 1]
                z += weight * both[g, first + 2]
            new_both[f, first], new_both[f, first + 1], new_both[f, first + 2] = x, y, z
        _normalise(new_both, f, 4)
        length = _normalise(new_both, f, 0)
        if length == np.float32(0.0):
            new_samples[f] = np.float32(0.0)
            continue
        nx, ny, nz = new_both[f, 0], new_both[f, 1], new_both[f, 2]
        for k in range(samples.shape[1]):
            x = y = z = np.float32(0.0)
            for q in range(count):
                g, weight = around[q], weights[q, 0]
                x += weight * samples[g, k, 0]
                y += weight * samples[g, k, 1]
                z += weight * samples[g, k, 2]
            along = x * nx + y * ny + z * nz
            new_samples[f, k, 0] = (x - along * nx) / length
            new_samples[f, k, 1] = (y - along * ny) / length
            new_samples[f, k, 2] = (z - along * nz) / length


@inner_jit()
def _weight(both: SingleArray, f: int, g: int, first: int) -> np.float32:
    """How much face g counts for face f, by the normals in three columns."""
    dx, dy, dz = (
        both[f, first] - both[g, first],
        both[f, first + 1] - both[g, first + 1],
        both[f, first + 2] - both[g, first + 2],
    )
    exponent = np.float32(0.5) * (dx * dx + dy * dy + dz * dz) / (both[f, 7] + both[g, 7])
    result = max(np.float32(1.0) - exponent / np.float32(POWER), np.float32(0.0))
    for _ in range(SQUARINGS):
        result *= result
    return np.float32(both[g, 3] * result)


@inner_jit()
def _normalise(both: SingleArray, f: int, first: int) -> np.float32:
    """Divide the vector in three columns by its length; return that."""
    x, y, z = both[f, first], both[f, first + 1], both[f, first + 2]
    length: np.float32 = np.sqrt(x * x + y * y + z * z)
    if length > np.float32(0.0):
        both[f, first], both[f, first + 1], both[f, first + 2] = x / length, y / length, z / length
    return length


@inner_jit()
def _met_before(faces: IntArray, f: int, corner: int, g: int) -> bool:
    """Whether face g has one of the corners of face f before a given one."""
    result = False
    for k in range(corner):
        result = result or has_corner(faces, g, faces[f, k])
    return result


def move_to_normals(
    mesh: TriangleMesh, adjacency: Adjacency, normals: SingleArray, movable: BoolArray, *, threads: int = 1
) -> SingleArray:
    """Move the vertices so that the faces become perpendicular to given normals.

    Each round moves every vertex by the mean of what takes it onto the planes through the centers of its faces,
    x_i += mean of ((c_f - x_i) . n_f) n_f: steps downhill for the sum of ((x_i - c_f) . n_f)^2 (after
    Sun, Rosin, Martin, Langbein, "Fast and effective feature-preserving mesh denoising", TVCG 2007).
    The first step is linear in the coordinates, b = -A x, and all of them together are the polynomial
    (1 - (1 - A)^rounds) / A of b, which a short Chebyshev series gives: the eigenvalues of A lie in [0, 1].

    Faces whose normals (m, 3) are zero are ignored; vertices that are not movable (n,) stay. Returns the moves, (n, 3).
    """
    stars = mesh_stars(mesh, adjacency)
    planes = np.zeros((mesh.face_count, 4), dtype=np.float32)
    planes[:, :3] = normals
    before, current, result = np.zeros((3, mesh.vertex_count, 3), dtype=np.float32)
    run_kernel(_first_step, len(result), stars, planes, movable, current, threads=threads)
    polynomial = coefficients(lambda x: (-np.expm1(UPDATE_ROUNDS * np.log1p(-x)) / x)[:, np.newaxis], 1.0, TERMS)
    for k, coefficient in enumerate(polynomial[:, 0].astype(np.float32)):
        step = Step(np.float32(2.0), np.float32(min(k, 2)), before, current)
        run_kernel(_heights, mesh.face_count, mesh.faces, current, planes, threads=threads)
        run_kernel(_advance, len(result), stars, planes, movable, step, coefficient, result, threads=threads)
        if k > 0:
            before, current = current, before
    return result


@jit()
def _first_step(
    mesh: MeshStars, planes: SingleArray, movable: BoolArray, moves: SingleArray, start: int, stop: int
) -> None:
    """Write how far vertices start .. stop-1 move in the first round."""
    vertices, faces, face_ptr, face_indices = mesh
    for i in range(start, stop):
        if not movable[i]:
            continue
        x, y, z = vertices[i, 0], vertices[i, 1], vertices[i, 2]
        sx, sy, sz = 0.0, 0.0, 0.0
        for q in range(face_ptr[i], face_ptr[i + 1]):
            f = face_indices[q]
            a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
            nx, ny, nz = planes[f, 0], planes[f, 1], planes[f, 2]
            height = (
                ((vertices[a, 0] - x) + (vertices[b, 0] - x) + (vertices[c, 0] - x)) * nx
                + ((vertices[a, 1] - y) + (vertices[b, 1] - y) + (vertices[c, 1] - y)) * ny
                + ((vertices[a, 2] - z) + (vertices[b, 2] - z) + (vertices[c, 2] - z)) * nz
            ) / 3.0
            sx, sy, sz = sx + height * nx, sy + height * ny, sz + height * nz
        count = max(face_ptr[i + 1] - face_ptr[i], 1)
        moves[i, 0], moves[i, 1], moves[i, 2] = sx / count, sy / count, sz / count


@jit()
def _heights(faces: IntArray, moves: SingleArray, planes: SingleArray, start: int, stop: int) -> None:
    """Write how far the centers of faces start .. stop-1 move along their normals."""
    third = np.float32(1.0 / 3.0)
    for f in range(start, stop):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
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
    for i in range(start, stop):
        if not movable[i]:
            continue
        x, y, z = current[i, 0], current[i, 1], current[i, 2]
        if factor > np.float32(0.0):
            sx = sy = sz = np.float32(0.0)
            for q in range(face_ptr[i], face_ptr[i + 1]):
                f = face_indices[q]
                nx, ny, nz = planes[f, 0], planes[f, 1], planes[f, 2]
                height = x * nx + y * ny + z * nz - planes[f, 3]
                sx += height * nx
                sy += height * ny
                sz += height * nz
            scale = double * factor / np.float32(max(face_ptr[i + 1] - face_ptr[i], 1))
            kept = factor - np.float32(1.0)
            x = before[i, 0] = scale * sx - factor * x - kept * before[i, 0]
            y = before[i, 1] = scale * sy - factor * y - kept * before[i, 1]
            z = before[i, 2] = scale * sz - factor * z - kept * before[i, 2]
        result[i, 0] += coefficient * x
        result[i, 1] += coefficient * y
        result[i, 2] += coefficient * z
