"""Spikes and folded vertices: single vertices far from a plane of neighbours, or outside of their polygon."""

import numpy as np

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.meshes.prepared_mesh import PreparedMesh
from bezier_filters.meshes.triangles import next_corner
from bezier_filters.runtime.jit import jit
from bezier_filters.runtime.parallel import run_kernel

# least height of a spike above the plane of its neighbours, over their RMS distance from their centroid, and over their
# own RMS height above the plane
MIN_SPIKE_HEIGHT, MIN_SPIKE_RATIO = 0.25, 8.0
# largest RMS height of the neighbours of a folded vertex above their plane, over their RMS distance from the centroid
MAX_FLAT_DEVIATION = 0.25


def remove_spikes(mesh: PreparedMesh) -> PreparedMesh:
    """Move every spike, and every folded vertex, to the centroid of its neighbours.

    The edges around a spike are sharp, but they are not edges of the surface.

    >>> from bezier_filters.meshes.mesh import triangle_mesh
    >>> from bezier_filters.meshes.prepared_mesh import prepare_mesh
    >>> from bezier_filters.surfaces import sphere
    >>> ball = sphere(resolution=20)
    >>> vertices = ball.vertices.copy()
    >>> vertices[100] *= 1.1
    >>> flat = remove_spikes(prepare_mesh(triangle_mesh(vertices, ball.faces))).vertices
    >>> np.flatnonzero((flat != vertices).any(axis=1)), bool(0.99 < np.linalg.norm(flat[100]) < 1.0)
    (array([100]), True)
    """
    return _move_to_centroids(mesh, True)


def move_folded_vertices(mesh: PreparedMesh) -> PreparedMesh:
    """Move every vertex outside of the polygon of its neighbours, if that is nearly flat, to their centroid.

    Some faces of such a vertex are folded over.
    """
    return _move_to_centroids(mesh, False)


def _move_to_centroids(mesh: PreparedMesh, spikes: bool) -> PreparedMesh:
    points, at_vertex = mesh.vertices.copy(), mesh.adjacency.faces
    inside = np.flatnonzero(~mesh.adjacency.on_boundary).astype(np.int32)
    arrays = mesh.vertices, mesh.faces, at_vertex.indptr, at_vertex.indices
    run_kernel(_write_centroids, len(inside), *arrays, inside, points, spikes)
    return mesh.move(points)


@jit()
def _write_centroids(
    vertices: FloatArray,
    faces: IntArray,
    face_ptr: IntArray,
    face_indices: IntArray,
    ids: IntArray,
    points: FloatArray,
    spikes: bool,
    start: int,
    stop: int,
) -> None:
    """Write the centroid of the neighbours for folded vertices, and on request for spikes, of ids[start:stop]."""
    for i in ids[start:stop]:
        first, last = face_ptr[i], face_ptr[i + 1]
        if first == last:
            continue
        mx = my = mz = nx = ny = nz = 0.0
        for q in range(first, last):  # the next corner of each face: every neighbour comes once
            j = next_corner(faces, face_indices[q], i)
            mx, my, mz = mx + vertices[j, 0], my + vertices[j, 1], mz + vertices[j, 2]
        count = last - first
        mx, my, mz = mx / count, my / count, mz / count
        for q in range(first, last):
            j = next_corner(faces, face_indices[q], i)
            k = next_corner(faces, face_indices[q], j)
            ux, uy, uz = vertices[j, 0] - mx, vertices[j, 1] - my, vertices[j, 2] - mz
            vx, vy, vz = vertices[k, 0] - mx, vertices[k, 1] - my, vertices[k, 2] - mz
            nx, ny, nz = nx + uy * vz - uz * vy, ny + uz * vx - ux * vz, nz + ux * vy - uy * vx
        wx, wy, wz = vertices[i, 0] - mx, vertices[i, 1] - my, vertices[i, 2] - mz
        uneven = width = 0.0
        is_inside, is_star = True, True
        for q in range(first, last):
            j = next_corner(faces, face_indices[q], i)
            k = next_corner(faces, face_indices[q], j)
            ux, uy, uz = vertices[j, 0] - mx, vertices[j, 1] - my, vertices[j, 2] - mz
            vx, vy, vz = vertices[k, 0] - mx, vertices[k, 1] - my, vertices[k, 2] - mz
            uneven += (ux * nx + uy * ny + uz * nz) ** 2 / count
            width += (ux * ux + uy * uy + uz * uz) / count
            is_star &= nx * (uy * vz - uz * vy) + ny * (uz * vx - ux * vz) + nz * (ux * vy - uy * vx) > 0.0
            ux, uy, uz, vx, vy, vz = ux - wx, uy - wy, uz - wz, vx - wx, vy - wy, vz - wz
            is_inside &= nx * (uy * vz - uz * vy) + ny * (uz * vx - ux * vz) + nz * (ux * vy - uy * vx) > 0.0
        scale = width * (nx * nx + ny * ny + nz * nz)
        height = (wx * nx + wy * ny + wz * nz) ** 2
        is_spike = height > MIN_SPIKE_RATIO**2 * uneven and height > MIN_SPIKE_HEIGHT**2 * scale
        if (is_spike and spikes) or (is_star and not is_inside and uneven < MAX_FLAT_DEVIATION**2 * scale):
            points[i, 0], points[i, 1], points[i, 2] = mx, my, mz
