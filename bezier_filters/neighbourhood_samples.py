"""A sample of neighbourhoods in local coordinates, from which the surface is learned."""

from dataclasses import dataclass

import numpy as np
from numba import njit

from bezier_filters.adjacency import Adjacency
from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.frames import farthest_direction, mean_normal, turned_share
from bezier_filters.kernel_input import KernelMesh
from bezier_filters.neighbourhoods import collect_ring


@dataclass(frozen=True)
class NeighbourhoodSample:
    """Neighbourhoods of N vertices, out to the widest ring.

    Attributes
    ----------
    centers : (N,) int32
        The vertices.
    points : (N, n, 3) float64
        Coordinates (x, y, z) over the tangent plane of each vertex, ordered by distance in edges;
        rows beyond a neighbourhood's size are zero.
    sizes : (N, rings + 1) int32
        Number of points within k edges, for each k up to the widest ring.
    clear : (N, rings + 1) bool
        Whether the k-ring has no boundary or crease inside.
    usable : (N, rings + 1) bool
        Whether, in addition, the k-ring projects with at most the allowed share of turned vertices.
    """

    centers: IntArray
    points: FloatArray
    sizes: IntArray
    clear: BoolArray
    usable: BoolArray


def sample_neighbourhoods(
    mesh: KernelMesh,
    adjacency: Adjacency,
    *,
    rings: int,
    count: int,
    most_turned: float,
    most_points: int = 450,
    seed: int = 0,
) -> NeighbourhoodSample:
    """Draw vertices at random and project their neighbourhoods onto their tangent planes.

    Parameters
    ----------
    mesh : KernelMesh
    adjacency : Adjacency
        Of the same mesh.
    rings : int
        Widest ring.
    count : int
        Number of vertices to draw; fewer if the mesh has fewer with faces.
    most_turned : float
        Share of turned vertices above which a ring is not usable.
    most_points : int
        Rings with more points count as not usable.
    seed : int
        Of the draw.
    """
    candidates = np.flatnonzero(mesh.normals.any(axis=1))
    ids = np.random.default_rng(seed).permutation(candidates)[:count].astype(np.int32)
    points = np.zeros((len(ids), most_points, 3))
    sizes = np.zeros((len(ids), rings + 1), dtype=np.int32)
    clear, usable = np.zeros((2, len(ids), rings + 1), dtype=np.bool_)
    _project_sample(mesh, adjacency.on_boundary, ids, rings, points, sizes, clear, usable, most_turned)
    return NeighbourhoodSample(ids, points, sizes, clear, usable)


@njit(cache=True, nogil=True, error_model="numpy")
def _project_sample(
    mesh: KernelMesh,
    on_boundary: BoolArray,
    ids: IntArray,
    rings: int,
    points: FloatArray,
    sizes: IntArray,
    clear: BoolArray,
    usable: BoolArray,
    most_turned: float,
) -> None:
    """Fill the arrays of a `NeighbourhoodSample`."""
    n = mesh.vertices.shape[0]
    members = np.empty(n, np.int32)
    visited = np.full(n, -1, np.int32)
    for row in range(ids.shape[0]):
        i = ids[row]
        plane_count = 0
        open_ring = False
        for k in range(1, rings + 1):
            count, inner = _ring_again(mesh, i, k, visited, members)
            sizes[row, k] = count
            nx, ny, nz = mean_normal(mesh.normals, members, count)
            for a in range(inner):
                open_ring = open_ring or on_boundary[members[a]] or mesh.stops[members[a]]
            clear[row, k] = not open_ring
            if open_ring or count > points.shape[1] or (nx == 0.0 and ny == 0.0 and nz == 0.0):
                continue
            if turned_share(mesh.normals, members, inner, nx, ny, nz) > most_turned:
                continue
            usable[row, k] = True
            plane_count = count
        if plane_count == 0:
            continue
        valence = mesh.ring_ptr[i + 1] - mesh.ring_ptr[i]
        nx, ny, nz = mean_normal(mesh.normals, members, plane_count)
        x = farthest_direction(mesh.vertices, members, valence, plane_count, nx, ny, nz)
        for a in range(plane_count):
            j = members[a]
            dx = mesh.vertices[j, 0] - mesh.vertices[i, 0]
            dy = mesh.vertices[j, 1] - mesh.vertices[i, 1]
            dz = mesh.vertices[j, 2] - mesh.vertices[i, 2]
            points[row, a, 0] = dx * x[0] + dy * x[1] + dz * x[2]
            points[row, a, 1] = (
                dx * (ny * x[2] - nz * x[1]) + dy * (nz * x[0] - nx * x[2]) + dz * (nx * x[1] - ny * x[0])
            )
            points[row, a, 2] = dx * nx + dy * ny + dz * nz


@njit(cache=True, nogil=True, error_model="numpy")
def _ring_again(mesh: KernelMesh, i: int, k: int, visited: IntArray, members: IntArray) -> tuple[int, int]:
    """Collect the k-ring of a vertex that may have been collected before."""
    count, inner = collect_ring(mesh.ring_ptr, mesh.ring_indices, mesh.stops, i, k, visited, members)
    for a in range(count):
        visited[members[a]] = -1
    return count, inner
