"""Vertices that fit given face normals."""

import numpy as np

from bezier_filters.adjacency import Adjacency
from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.lean import lean_njit
from bezier_filters.mesh import TriangleMesh
from bezier_filters.parallel import RangeTask, run_in_chunks

ROUNDS = 20
"""More would fit the normals better, but let the vertices drift away from where they were measured."""


def move_to_normals(
    mesh: TriangleMesh, adjacency: Adjacency, normals: FloatArray, movable: BoolArray, *, threads: int = 1
) -> FloatArray:
    """Move the vertices so that the faces become perpendicular to given normals.

    Each round moves every vertex by the mean of what takes it onto the planes through the centers of its faces,
    x_i += mean of ((c_f - x_i) . n_f) n_f: steps downhill for the sum of ((x_i - c_f) . n_f)^2 (after
    Sun, Rosin, Martin, Langbein, "Fast and effective feature-preserving mesh denoising", TVCG 2007).

    Parameters
    ----------
    mesh : TriangleMesh
    adjacency : Adjacency
        Of the same mesh.
    normals : (m, 3) float64
        Unit normals of the faces; those of faces that are zero are ignored.
    movable : (n,) bool
        Vertices that may move.
    threads : int
        Number of threads.

    Returns
    -------
    (n, 3) float64
    """
    rows = adjacency.faces
    current = mesh.vertices
    for _ in range(ROUNDS):
        following = np.empty_like(current)

        def make_task(current: FloatArray = current, following: FloatArray = following) -> RangeTask:
            return lambda start, stop: _move(
                current, mesh.faces, rows.indptr, rows.indices, normals, movable, start, stop, following
            )

        run_in_chunks(make_task, len(current), threads=threads)
        current = following
    return current


@lean_njit()
def _move(
    vertices: FloatArray,
    faces: IntArray,
    face_ptr: IntArray,
    face_indices: IntArray,
    normals: FloatArray,
    movable: BoolArray,
    start: int,
    stop: int,
    moved: FloatArray,
) -> None:
    """One round for vertices start .. stop-1."""
    for i in range(start, stop):
        x, y, z = vertices[i, 0], vertices[i, 1], vertices[i, 2]
        sx, sy, sz, count = 0.0, 0.0, 0.0, 0
        if movable[i]:
            for q in range(face_ptr[i], face_ptr[i + 1]):
                f = face_indices[q]
                a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
                nx, ny, nz = normals[f, 0], normals[f, 1], normals[f, 2]
                height = (
                    ((vertices[a, 0] + vertices[b, 0] + vertices[c, 0]) / 3.0 - x) * nx
                    + ((vertices[a, 1] + vertices[b, 1] + vertices[c, 1]) / 3.0 - y) * ny
                    + ((vertices[a, 2] + vertices[b, 2] + vertices[c, 2]) / 3.0 - z) * nz
                )
                sx, sy, sz, count = sx + height * nx, sy + height * ny, sz + height * nz, count + 1
        count = max(count, 1)
        moved[i, 0], moved[i, 1], moved[i, 2] = x + sx / count, y + sy / count, z + sz / count
