"""Lone vertices that stick out, or lie outside of their neighbours: what is around is better told without them."""

import numpy as np

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.meshes.adjacency import Adjacency
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.meshes.triangles import next_corner
from bezier_filters.runtime.jit import jit
from bezier_filters.runtime.parallel import run_kernel

STEEP = 0.25  # times the distance of its neighbours from their middle: how far off that a tip is, at the least,
ALONE = 8.0  # and times their own distance from a plane
FLAT = 0.25  # times the same, how far neighbours of a vertex are off a plane, at the most, that it is outside of


def without_tips(mesh: TriangleMesh, adjacency: Adjacency) -> TriangleMesh:
    """The mesh with every vertex that sticks out of a plane of neighbours moved into their middle.

    The edges around a tip are sharp, but no edges of the surface.

    >>> from bezier_filters.meshes.adjacency import vertex_adjacency
    >>> from bezier_filters.meshes.mesh import triangle_mesh
    >>> from bezier_filters.surfaces import sphere
    >>> ball = sphere(resolution=20)
    >>> vertices = ball.vertices.copy()
    >>> vertices[100] *= 1.1
    >>> mesh = triangle_mesh(vertices, ball.faces)
    >>> flat = without_tips(mesh, vertex_adjacency(mesh)).vertices
    >>> np.flatnonzero((flat != vertices).any(axis=1)), bool(0.99 < np.linalg.norm(flat[100]) < 1.0)
    (array([100]), True)
    """
    return _flattened(mesh, adjacency, True)


def unfolded(mesh: TriangleMesh, adjacency: Adjacency) -> TriangleMesh:
    """The mesh with every vertex that lies outside of its neighbours, if these lie in a plane, moved into their middle.

    Along the surface it is farther off than an edge, and its faces are turned over.
    """
    return _flattened(mesh, adjacency, False)


def _flattened(mesh: TriangleMesh, adjacency: Adjacency, tips: bool) -> TriangleMesh:
    points, at_vertex = mesh.vertices.copy(), adjacency.faces
    inside = np.flatnonzero(~adjacency.on_boundary).astype(np.int32)
    arrays = mesh.vertices, mesh.faces, at_vertex.indptr, at_vertex.indices
    run_kernel(_flatten, len(inside), *arrays, inside, points, tips)
    return TriangleMesh(points, mesh.faces)


@jit()
def _flatten(
    vertices: FloatArray,
    faces: IntArray,
    face_ptr: IntArray,
    face_indices: IntArray,
    ids: IntArray,
    points: FloatArray,
    tips: bool,
    start: int,
    stop: int,
) -> None:
    """Write the middle of the neighbours of those of the vertices ids[start:stop] that are tips."""
    for i in ids[start:stop]:
        first, last = face_ptr[i], face_ptr[i + 1]
        if first == last:
            continue
        mx = my = mz = nx = ny = nz = 0.0
        for q in range(first, last):  # of the two other corners of a face, the first: every neighbour comes once
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
        is_tip = height > ALONE**2 * uneven and height > STEEP**2 * scale
        if (is_tip and tips) or (is_star and not is_inside and uneven < FLAT**2 * scale):
            points[i, 0], points[i, 1], points[i, 2] = mx, my, mz
