"""Face normals without their noise: means over the faces around that agree up to the noise.

A face's neighbours count the less, the farther their normals are from its own, in units of the
noise that is left in both (a bilateral filter). The noise is known: samples of it pass through
the same means. So the filter becomes ever pickier as the noise falls, and comes to rest by itself
where edges and corners, which noise does not explain, are as sharp as they are going to be.
"""

from dataclasses import dataclass, replace

import numpy as np

from bezier_filters.adjacency import Rows
from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.frames import face_normal
from bezier_filters.lean import lean_njit
from bezier_filters.mesh import TriangleMesh
from bezier_filters.parallel import RangeTask, run_in_chunks

SMALLEST_VARIANCE = 1e-12
"""Of a normal, radians^2: below that everything agrees only with itself."""
FARTHEST = 9.0
"""Exponent beyond which a neighbour counts nothing."""


@dataclass(frozen=True)
class NoisyNormals:
    """Unit normals of faces, and what noise did to them.

    Attributes
    ----------
    mesh : TriangleMesh
        Whose normals they are, or were.
    normals : (m, 3) float64
        Zero for faces without area.
    samples : (m, k, 3) float64
        Changes of the normals by k samples of the noise, radians.
    areas : (m,) float64
        Twice the areas of the faces.
    """

    mesh: TriangleMesh
    normals: FloatArray
    samples: FloatArray
    areas: FloatArray


def noisy_normals(mesh: TriangleMesh, noise: FloatArray, *, threads: int = 1) -> NoisyNormals:
    """Normals of a mesh, and how samples of the noise of its vertices (n, k, 3) turn them, to first order."""
    m = mesh.face_count
    result = NoisyNormals(mesh, np.zeros((m, 3)), np.zeros((m, noise.shape[1], 3)), np.zeros(m))

    def make_task() -> RangeTask:
        return lambda start, stop: _write_normals(
            mesh.vertices, mesh.faces, noise, start, stop, result.normals, result.samples, result.areas
        )

    run_in_chunks(make_task, m, threads=threads)
    return result


def filter_normals(
    state: NoisyNormals, faces_at: Rows, rounds: int, tolerance: float, *, threads: int = 1
) -> NoisyNormals:
    """Replace every normal by its mean with those around it, some rounds.

    Parameters
    ----------
    state : NoisyNormals
        From `noisy_normals` or an earlier call.
    faces_at : Rows
        Faces at each vertex.
    rounds : int
        How many times.
    tolerance : float
        Difference of two normals, in standard deviations of what noise makes of it, at which a neighbour weighs
        exp(-1/2).
    threads : int
        Number of threads.

    Examples
    --------
    >>> from bezier_filters.adjacency import vertex_adjacency
    >>> from bezier_filters.mesh import triangle_mesh
    >>> from bezier_filters.surfaces import block_with_sharp_edges
    >>> block = triangle_mesh(*block_with_sharp_edges(resolution=6))
    >>> start = noisy_normals(block, 1e-3 * np.ones((block.vertex_count, 2, 3)))
    >>> end = filter_normals(start, vertex_adjacency(block).faces, 5, 2.0)
    >>> bool(np.allclose(start.normals, end.normals))
    True
    """
    for _ in range(rounds):
        state = _filtered_once(state, faces_at, tolerance, threads)
    return state


def _filtered_once(state: NoisyNormals, faces_at: Rows, tolerance: float, threads: int) -> NoisyNormals:
    variances = _local_variances(state) * tolerance**2
    result = replace(state, normals=np.zeros_like(state.normals), samples=np.zeros_like(state.samples))

    def make_task() -> RangeTask:
        return lambda start, stop: _filter(
            state.mesh.faces,
            faces_at.indptr,
            faces_at.indices,
            state.normals,
            state.samples,
            state.areas,
            variances,
            start,
            stop,
            result.normals,
            result.samples,
        )

    run_in_chunks(make_task, state.mesh.face_count, threads=threads)
    return result


def _local_variances(state: NoisyNormals) -> FloatArray:
    """Mean squared change of the normals around each face."""
    mesh = state.mesh
    values = np.square(state.samples).sum(axis=2).mean(axis=1)
    counts = np.maximum(np.bincount(mesh.faces.ravel(), minlength=mesh.vertex_count), 1)
    for _ in range(2):
        at_vertices = np.bincount(mesh.faces.ravel(), weights=np.repeat(values, 3), minlength=mesh.vertex_count)
        values = (at_vertices / counts)[mesh.faces].mean(axis=1)
    result: FloatArray = np.maximum(values, SMALLEST_VARIANCE)
    return result


@lean_njit()
def _write_normals(
    vertices: FloatArray,
    faces: IntArray,
    noise: FloatArray,
    start: int,
    stop: int,
    normals: FloatArray,
    samples: FloatArray,
    areas: FloatArray,
) -> None:
    """Write unit normals, areas and the changes of the normals."""
    for f in range(start, stop):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        x, y, z = face_normal(vertices, faces, f)
        length = np.sqrt(x * x + y * y + z * z)
        areas[f] = length
        if length == 0.0:
            continue
        x, y, z = x / length, y / length, z / length
        normals[f, 0], normals[f, 1], normals[f, 2] = x, y, z
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


@lean_njit()
def _filter(
    faces: IntArray,
    face_ptr: IntArray,
    face_indices: IntArray,
    normals: FloatArray,
    samples: FloatArray,
    areas: FloatArray,
    variances: FloatArray,
    start: int,
    stop: int,
    new_normals: FloatArray,
    new_samples: FloatArray,
) -> None:
    """Write the means of faces start .. stop-1 with the faces that share a vertex with them."""
    count = samples.shape[1]
    for f in range(start, stop):
        x, y, z = areas[f] * normals[f, 0], areas[f] * normals[f, 1], areas[f] * normals[f, 2]
        for k in range(count):
            for axis in range(3):
                new_samples[f, k, axis] = areas[f] * samples[f, k, axis]
        for corner in range(3):
            i = faces[f, corner]
            for q in range(face_ptr[i], face_ptr[i + 1]):
                g = face_indices[q]
                if g == f or _met_before(faces, f, corner, g):
                    continue
                dx, dy, dz = normals[f, 0] - normals[g, 0], normals[f, 1] - normals[g, 1], normals[f, 2] - normals[g, 2]
                exponent = 0.5 * (dx * dx + dy * dy + dz * dz) / (variances[f] + variances[g])
                if exponent > FARTHEST:
                    continue
                weight = areas[g] * np.exp(-exponent)
                x, y, z = x + weight * normals[g, 0], y + weight * normals[g, 1], z + weight * normals[g, 2]
                for k in range(count):
                    for axis in range(3):
                        new_samples[f, k, axis] += weight * samples[g, k, axis]
        length = np.sqrt(x * x + y * y + z * z)
        if length == 0.0:
            continue
        x, y, z = x / length, y / length, z / length
        new_normals[f, 0], new_normals[f, 1], new_normals[f, 2] = x, y, z
        for k in range(count):
            along = new_samples[f, k, 0] * x + new_samples[f, k, 1] * y + new_samples[f, k, 2] * z
            new_samples[f, k, 0] = (new_samples[f, k, 0] - along * x) / length
            new_samples[f, k, 1] = (new_samples[f, k, 1] - along * y) / length
            new_samples[f, k, 2] = (new_samples[f, k, 2] - along * z) / length


@lean_njit()
def _met_before(faces: IntArray, f: int, corner: int, g: int) -> bool:
    """Whether face g has one of the corners of face f before a given one."""
    for k in range(corner):
        i = faces[f, k]
        if faces[g, 0] == i or faces[g, 1] == i or faces[g, 2] == i:
            return True
    return False
