"""Random samples of neighbourhoods, projected to local coordinates over their tangent planes.

Vertices are drawn by stratified sampling: one from each of equal intervals of the vertex numbers.
"""

from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.kernels.kernel_input import KernelMesh, recompute_barriers
from bezier_filters.meshes.frames import farthest_direction, fraction_flipped, mean_normal
from bezier_filters.meshes.neighbourhoods import clear_marks, next_ring
from bezier_filters.runtime.jit import inner_jit, jit, opaque
from bezier_filters.runtime.parallel import RangeTask, run_in_chunks

SAMPLE_CHUNK = 32  # neighbourhoods per chunk
NORMAL_CHECK_RINGS = 2  # rings in which flipped normals are counted
MAX_NEIGHBOURHOOD_POINTS = 450  # points of the largest usable neighbourhood
# fraction of flipped normals, more than 90 degrees from the plane normal, in a usable neighbourhood
MAX_FLIPPED_FRACTION = 0.02
MAX_FLIPPED_BY_OUTLIERS = 0.25  # the same in the search for outliers, which flip more normals

# how neighbourhoods are sampled: from the mesh; with smoothed normals; or without the sharp edges around single spikes
# and with more flipped normals
SampleMode = Literal["plain", "smoothed", "tolerant"]


class NeighbourhoodSample(NamedTuple):
    """Neighbourhoods of N vertices, out to the widest ring."""

    centers: IntArray  # (N,): the vertices
    # (N, n, 3): coordinates (x, y, z) over the tangent plane of each vertex, ordered by distance in edges; rows beyond
    # a neighbourhood's size are zero
    points: FloatArray
    sizes: IntArray  # (N, rings + 1): number of points within k edges, for each k up to the widest ring
    is_interior: BoolArray  # (N, rings + 1): whether the k-ring has no boundary or crease inside
    # (N, rings + 1): whether, in addition, at most the allowed fraction of its normals is flipped
    usable: BoolArray
    # (N,): fraction of flipped normals within two edges; 0 if that ring is not interior
    flipped_fraction: FloatArray


def sample_by_mode(
    mesh: KernelMesh, ids: IntArray, rings: int, mode: SampleMode, *, keep_barriers: bool = False
) -> NeighbourhoodSample:
    """Neighbourhoods of the vertices `ids` of a mesh in memory in one of the modes, on request with its barriers."""
    if mode == "tolerant" and not keep_barriers:
        mesh = recompute_barriers(mesh)
    most = MAX_FLIPPED_BY_OUTLIERS if mode == "tolerant" else MAX_FLIPPED_FRACTION
    return sample_neighbourhoods(mesh, ids, rings=rings, max_flipped_fraction=most)


def sample_neighbourhoods(
    mesh: KernelMesh, ids: IntArray, *, rings: int, max_flipped_fraction: float
) -> NeighbourhoodSample:
    """Project the neighbourhoods of some vertices, out to a widest ring, onto their tangent planes.

    Rings with a larger fraction of flipped normals than `max_flipped_fraction`, or with more points than
    `MAX_NEIGHBOURHOOD_POINTS`, are not usable.
    """
    by_ring = len(ids), rings + 1
    sample = NeighbourhoodSample(
        ids,
        np.zeros((len(ids), MAX_NEIGHBOURHOOD_POINTS, 3)),
        np.zeros(by_ring, dtype=np.int32),
        np.zeros(by_ring, dtype=np.bool_),
        np.zeros(by_ring, dtype=np.bool_),
        np.zeros(len(ids)),
    )
    n = len(mesh.vertices)

    def make_task() -> RangeTask:
        members, visited = np.empty(n + 1, np.int32), np.zeros(n, np.bool_)
        return lambda start, stop: _project_sample(mesh, max_flipped_fraction, members, visited, sample, start, stop)

    run_in_chunks(make_task, len(ids), chunk=SAMPLE_CHUNK)
    return sample


def draw_from_mesh(mesh: KernelMesh, count: int) -> IntArray:
    """Up to `count` vertices of a mesh that have a normal, in random order: see `draw_vertices`."""

    def has_normal(ids: IntArray) -> BoolArray:
        return np.asarray(mesh.normals[ids].any(axis=1))

    def list_with_normals() -> IntArray:
        return np.asarray(vertex_of_row[has_normal(vertex_of_row)])

    vertex_of_row = np.empty_like(mesh.origin)
    vertex_of_row[mesh.origin] = np.arange(len(mesh.origin), dtype=np.int32)
    return draw_vertices(len(vertex_of_row), vertex_of_row.__getitem__, has_normal, list_with_normals, count)


def draw_vertices(
    vertex_count: int,
    vertices_of: Callable[[IntArray], IntArray],
    has_normal: Callable[[IntArray], BoolArray],
    list_with_normals: Callable[[], IntArray],
    count: int,
) -> IntArray:
    """Draw up to `count` vertices with a normal, in random order.

    One vertex is drawn from each of `count` intervals of the vertex numbers, so that no region is missed; rotations of
    the mesh do not matter. `vertices_of` gives the vertices of numbers in the user's order. `list_with_normals` lists
    all vertices with a normal in that order. It is called only if a vertex without a normal was drawn from all.
    """
    generator = np.random.default_rng(0)
    ids = vertices_of(_draw_per_stretch(vertex_count, count, generator))
    if not has_normal(ids).all():
        candidates = list_with_normals()
        ids = candidates[_draw_per_stretch(len(candidates), count, generator)]
    return generator.permutation(ids)


def _draw_per_stretch(n: int, count: int, generator: np.random.Generator) -> IntArray:
    """Draw one of the numbers below n from each of `count` equal intervals; all numbers, if there are fewer."""
    ends = np.linspace(0, n, min(n, count) + 1).astype(np.int32)
    return generator.integers(ends[:-1], ends[1:], dtype=np.int32) if n else ends[:0]


@jit()
def _project_sample(
    mesh: KernelMesh,
    max_flipped_fraction: float,
    members: IntArray,
    visited: BoolArray,
    sample: NeighbourhoodSample,
    start: int,
    stop: int,
) -> None:
    """Fill rows start .. stop-1 of a sample."""
    points, sizes, rings = sample.points, sample.sizes, sample.sizes.shape[1] - 1
    for row in range(start, stop):
        i = sample.centers[row]
        members[0] = i
        visited[i] = True
        inner, count, plane_count = opaque(0), opaque(1), opaque(0)
        open_ring = False
        for k in range(1, rings + 1):
            before, inner = inner, count
            count = next_ring(mesh.ring_ptr, mesh.ring_indices, mesh.barriers, before, inner, visited, members)
            sizes[row, k] = count
            for a in range(before, inner):
                open_ring = open_ring or mesh.on_boundary[members[a]] or mesh.barriers[members[a]]
            sample.is_interior[row, k] = not open_ring
            if open_ring or count > points.shape[1]:
                continue
            nx, ny, nz = mean_normal(mesh.normals, members, count)
            if nx == 0.0 and ny == 0.0 and nz == 0.0:
                continue
            if k == NORMAL_CHECK_RINGS:
                sample.flipped_fraction[row] = fraction_flipped(mesh.normals, members, count, nx, ny, nz)
            if fraction_flipped(mesh.normals, members, inner, nx, ny, nz) > max_flipped_fraction:
                continue
            sample.usable[row, k] = True
            plane_count = count
        clear_marks(visited, members, count)
        if plane_count > 0:
            _project(mesh, members, plane_count, points[row])


@inner_jit()
def _project(mesh: KernelMesh, members: IntArray, count: int, points: FloatArray) -> None:
    """Write the coordinates of members[:count] over the plane of their mean normal."""
    i = members[0]
    neighbours = mesh.ring_ptr[i + 1] - mesh.ring_ptr[i]
    nx, ny, nz = mean_normal(mesh.normals, members, count)
    x = farthest_direction(mesh.vertices, members, neighbours, count, nx, ny, nz)
    y = (ny * x[2] - nz * x[1], nz * x[0] - nx * x[2], nx * x[1] - ny * x[0])
    for a in range(count):
        j = members[a]
        dx = mesh.vertices[j, 0] - mesh.vertices[i, 0]
        dy = mesh.vertices[j, 1] - mesh.vertices[i, 1]
        dz = mesh.vertices[j, 2] - mesh.vertices[i, 2]
        points[a, 0] = dx * x[0] + dy * x[1] + dz * x[2]
        points[a, 1] = dx * y[0] + dy * y[1] + dz * y[2]
        points[a, 2] = dx * nx + dy * ny + dz * nz
