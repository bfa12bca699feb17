"""Vertices that fit given face normals."""

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray, SingleArray
from bezier_filters.meshes.adjacency import Adjacency
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.runtime.jit import jit
from bezier_filters.runtime.parallel import run_kernel
from bezier_filters.smoothing.chebyshev import coefficients

UPDATE_ROUNDS = 20  # more would fit the normals better, but let the vertices drift away from where they were measured
TERMS = 10  # of the polynomial that does as much as all rounds


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
    rows, n = adjacency.faces, mesh.vertex_count
    planes = np.zeros((mesh.face_count, 4), dtype=np.float32)
    planes[:, :3] = normals
    before, current, result = np.zeros((3, n, 3), dtype=np.float32)

    around = mesh.vertices, mesh.faces, rows.indptr, rows.indices, planes, movable
    run_kernel(_first_step, n, *around, current, threads=threads)
    polynomial = coefficients(lambda x: (-np.expm1(UPDATE_ROUNDS * np.log1p(-x)) / x)[:, np.newaxis], 1.0, TERMS)
    for k, coefficient in enumerate(polynomial[:, 0].astype(np.float32)):
        of_step = np.float32(min(k, 2)), coefficient, before, current, result
        run_kernel(_heights, mesh.face_count, mesh.faces, current, planes, threads=threads)
        run_kernel(_advance, n, rows.indptr, rows.indices, planes, movable, *of_step, threads=threads)
        if k > 0:
            before, current = current, before
    return result


@jit()
def _first_step(
    vertices: FloatArray,
    faces: IntArray,
    face_ptr: IntArray,
    face_indices: IntArray,
    planes: SingleArray,
    movable: BoolArray,
    moves: SingleArray,
    start: int,
    stop: int,
) -> None:
    """Write how far vertices start .. stop-1 move in the first round."""
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
    face_ptr: IntArray,
    face_indices: IntArray,
    planes: SingleArray,
    movable: BoolArray,
    factor: np.float32,
    coefficient: np.float32,
    before: SingleArray,
    current: SingleArray,
    result: SingleArray,
    start: int,
    stop: int,
) -> None:
    """Overwrite T_k-1 by T_k+1 = 2 (2 A - 1) T_k - T_k-1, or T_1; add it to the result. Factor 0 leaves T_0."""
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
            scale = np.float32(2.0) * factor / np.float32(max(face_ptr[i + 1] - face_ptr[i], 1))
            kept = factor - np.float32(1.0)
            x = before[i, 0] = scale * sx - factor * x - kept * before[i, 0]
            y = before[i, 1] = scale * sy - factor * y - kept * before[i, 1]
            z = before[i, 2] = scale * sz - factor * z - kept * before[i, 2]
        result[i, 0] += coefficient * x
        result[i, 1] += coefficient * y
        result[i, 2] += coefficient * z
