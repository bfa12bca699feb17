"""Point clouds: vertex adjacency and tangent planes without faces.

Tangent planes are least-squares planes of the nearest points. The neighbours of a point are its Delaunay neighbours in
its tangent plane: six on average, as on a mesh, also if points lie in scan lines or vary in density. So every algorithm
that needs only vertex neighbours works on point clouds.
"""

import numpy as np
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.meshes.adjacency import Adjacency, Rows
from bezier_filters.meshes.frames import TangentPlanes
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.meshes.orientation import orient_normals
from bezier_filters.runtime.jit import allocating_jit
from bezier_filters.runtime.parallel import run_kernel, thread_count

CANDIDATE_COUNT = 20  # nearest points that may be neighbours: some three layers around a point
MAX_ANGULAR_GAP = np.radians(120.0)  # between consecutive neighbours; a boundary point has a larger one
MIN_OCCLUSION_COSINE = np.cos(np.radians(15.0))  # between the directions to two points, one of which hides the other
MIN_VARIANCE_RATIO = 1e-12  # of the second to the first principal variance; below it points are collinear
MAX_DISTANCE_RATIO = 3.0  # of the distance of a neighbour to the distance that contains its own nearest points
COCIRCULARITY_TOLERANCE = 1e-6  # relative; all points of one empty circle become neighbours


def point_cloud(mesh: TriangleMesh, normals: FloatArray | None = None) -> tuple[Adjacency, TangentPlanes]:
    """Adjacency and tangent planes of the vertices of a mesh, whose faces are ignored.

    Planes are least-squares planes of the nearest points (Hoppe et al., "Surface reconstruction from unorganized
    points", SIGGRAPH 1992). Coincident points count as one neighbour. Isolated or collinear points have no plane and
    get zero normals. Normals are oriented by the sign of `normals` (n, 3), of any length; where these are zero, by
    `orient_normals`.
    """
    first, place_of = _distinct(mesh.vertices)
    points = mesh.vertices[first]
    nearest, reach = _nearest(points)
    planes = _least_squares_normals(points, nearest)
    neighbours, on_boundary = _neighbours(points, nearest, reach, planes)
    planes = orient_normals(points, planes, neighbours, None if normals is None else normals[first])[place_of]
    if normals is not None:
        inward = np.einsum("ij,ij->i", planes, normals) < 0.0
        planes[inward] *= -1.0
    no_faces = Rows(np.zeros(mesh.vertex_count + 1, np.int32), np.empty(0, np.int32))
    adjacency = Adjacency(no_faces, _expand_to_points(neighbours, first, place_of), on_boundary[place_of])
    return adjacency, TangentPlanes(planes, np.full(mesh.vertex_count, 2.0, np.float32))


def _distinct(points: FloatArray) -> tuple[IntArray, IntArray]:
    """Merge coincident points: the row of one point per location, in lexicographic order, and the location of each."""
    order = np.lexsort(points.T)
    new = np.ones(len(points), dtype=np.bool_)
    new[1:] = (points[order[1:]] != points[order[:-1]]).any(axis=1)
    place_of = np.empty(len(points), dtype=np.int32)
    place_of[order] = np.cumsum(new) - 1
    return order[new].astype(np.int32), place_of


def _expand_to_points(neighbours: Rows, first: IntArray, place_of: IntArray) -> Rows:
    """Convert rows of neighbours per location to rows per point."""
    lengths = neighbours.lengths[place_of]
    indptr = np.append(0, np.cumsum(lengths)).astype(np.int32)
    places = neighbours.of(place_of)
    rows = csr_array((np.ones(len(places), dtype=np.int8), first[places], indptr), shape=2 * place_of.shape)
    rows.sort_indices()
    return Rows(indptr, rows.indices.astype(np.int32))


def _nearest(points: FloatArray) -> tuple[IntArray, FloatArray]:
    """Nearest other points, (n, min(CANDIDATE_COUNT, n - 1)), nearest first, and the distance of the last, (n,)."""
    count = min(CANDIDATE_COUNT, len(points) - 1)
    if count < 1:
        return np.empty((len(points), 0), dtype=np.int32), np.zeros(len(points))
    distances, nearest = cKDTree(points).query(points, k=np.arange(2, count + 2), workers=thread_count())
    return np.ascontiguousarray(nearest, dtype=np.int32), distances[:, -1].copy()


def _least_squares_normals(points: FloatArray, nearest: IntArray) -> FloatArray:
    """Unit normals, of any sign, of the least-squares planes; zero without a plane."""
    count = nearest.shape[1] + 1
    total, squares = np.zeros((len(points), 3)), np.zeros((len(points), 3, 3))
    for column in nearest.T:
        away = points[column] - points
        total += away
        squares += away[:, :, np.newaxis] * away[:, np.newaxis, :]
    squares -= total[:, :, np.newaxis] * total[:, np.newaxis, :] / count
    variances, axes = np.linalg.eigh(squares)
    on_a_line = variances[:, 1] <= MIN_VARIANCE_RATIO * variances[:, 2]
    return np.where(on_a_line[:, np.newaxis], 0.0, axes[:, :, 0])


def _neighbours(
    points: FloatArray, nearest: IntArray, reach: FloatArray, normals: FloatArray
) -> tuple[Rows, BoolArray]:
    """Symmetric neighbour rows and boundary flags."""
    n = len(points)
    chosen = np.zeros(nearest.shape, dtype=np.bool_)
    on_boundary = np.zeros(n, dtype=np.bool_)

    run_kernel(_choose_neighbours, n, points, nearest, normals, reach, chosen, on_boundary)
    indptr = np.append(0, np.cumsum(chosen.sum(axis=1)))
    graph = csr_array((np.ones(indptr[-1], dtype=np.int8), nearest[chosen], indptr), shape=(n, n))
    graph = (graph + graph.T).tocsr()
    return Rows(graph.indptr.astype(np.int32), graph.indices.astype(np.int32)), on_boundary


@allocating_jit()
def _choose_neighbours(
    points: FloatArray,
    nearest: IntArray,
    normals: FloatArray,
    reach: FloatArray,
    chosen: BoolArray,
    on_boundary: BoolArray,
    start: int,
    stop: int,
) -> None:
    """Mark the Delaunay neighbours among the nearest points, and the boundary points, which have a wide gap.

    Inversion in the unit circle maps circles through a point to lines, and the Delaunay neighbours of the point to the
    corners of a convex hull.
    """
    inverted = np.empty((nearest.shape[1] + 1, 2))
    candidate = np.empty(nearest.shape[1] + 1, np.int32)
    angles = np.empty(nearest.shape[1])
    for i in range(start, stop):
        nx, ny, nz = normals[i]
        if nx == 0.0 and ny == 0.0 and nz == 0.0:
            continue
        x, y = find_tangents(nx, ny, nz)
        inverted[0] = 0.0  # the image of infinity, a corner of the hull at a boundary
        candidate[0] = -1
        count = 1
        for q in range(nearest.shape[1]):
            edge = points[nearest[i, q]] - points[i]
            a = edge[0] * x[0] + edge[1] * x[1] + edge[2] * x[2]
            b = edge[0] * y[0] + edge[1] * y[1] + edge[2] * y[2]
            flat = np.sqrt(a * a + b * b)
            # The projection keeps the length of the edge, so that a point above this one does not seem near.
            length = np.sqrt(edge[0] * edge[0] + edge[1] * edge[1] + edge[2] * edge[2])
            if flat == 0.0 or length > MAX_DISTANCE_RATIO * reach[nearest[i, q]]:
                continue
            inverted[count, 0], inverted[count, 1] = a / (flat * length), b / (flat * length)
            angles[count - 1] = np.arctan2(b, a)
            candidate[count] = q
            count += 1
        _mark_hull(inverted, candidate, count, chosen[i])
        on_boundary[i] = _largest_gap(angles[: count - 1]) > MAX_ANGULAR_GAP
        if on_boundary[i]:
            _remove_occluded_neighbours(inverted, candidate, count, chosen[i])


@allocating_jit()
def find_tangents(nx: float, ny: float, nz: float) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Two orthonormal tangents of a unit normal."""
    if abs(nx) < 0.7:
        length = np.sqrt(ny * ny + nz * nz)
        x = (0.0, nz / length, -ny / length)
    else:
        length = np.sqrt(nx * nx + nz * nz)
        x = (-nz / length, 0.0, nx / length)
    return x, (ny * x[2] - nz * x[1], nz * x[0] - nx * x[2], nx * x[1] - ny * x[0])


@allocating_jit()
def _mark_hull(points: FloatArray, candidate: IntArray, count: int, marks: BoolArray) -> None:
    """Mark the candidates on the convex hull of points[:count] in the plane, by gift wrapping from the farthest."""
    start, farthest = 0, 0.0
    for k in range(1, count):
        square = points[k, 0] * points[k, 0] + points[k, 1] * points[k, 1]
        if square > farthest:
            start, farthest = k, square
    if start == 0:
        return
    corner, cx, cy = start, 0.0, 0.0
    for _ in range(count):
        if candidate[corner] >= 0:
            marks[candidate[corner]] = True
        following, fx, fy, reach = -1, 0.0, 0.0, 0.0
        for k in range(count):
            dx, dy = points[k, 0] - points[corner, 0], points[k, 1] - points[corner, 1]
            square = dx * dx + dy * dy
            # on a straight side of the hull, points behind the last corner are no candidates
            turn, is_behind = cx * dy - cy * dx, cx * dx + cy * dy < 0.0
            is_behind = is_behind and abs(turn) <= COCIRCULARITY_TOLERANCE * np.sqrt(square * (cx * cx + cy * cy))
            if k == corner or square == 0.0 or is_behind:
                continue
            side = (fx * dy - fy * dx) / np.sqrt(reach * square) if following >= 0 else -1.0
            if side < -COCIRCULARITY_TOLERANCE or (
                side <= COCIRCULARITY_TOLERANCE and square < reach and fx * dx + fy * dy > 0.0
            ):
                following, fx, fy, reach = k, dx, dy, square
        corner, cx, cy = following, fx, fy
        if corner == start or corner < 0:
            return


@allocating_jit()
def _remove_occluded_neighbours(points: FloatArray, candidate: IntArray, count: int, marks: BoolArray) -> None:
    """Unmark candidates that nearer ones occlude, seen from a boundary point.

    The Delaunay triangles there are slivers along the boundary, and all points of a straight boundary would be
    neighbours.
    """
    for k in range(1, count):
        square = points[k, 0] ** 2 + points[k, 1] ** 2
        for m in range(1, count):
            other = points[m, 0] ** 2 + points[m, 1] ** 2  # larger for nearer ones
            along = points[k, 0] * points[m, 0] + points[k, 1] * points[m, 1]
            if marks[candidate[m]] and other > square and along > MIN_OCCLUSION_COSINE * np.sqrt(square * other):
                marks[candidate[k]] = False


@allocating_jit()
def _largest_gap(angles: FloatArray) -> float:
    """Largest gap between consecutive angles on the circle, in radians."""
    if angles.shape[0] == 0:
        return 2.0 * np.pi
    angles.sort()
    gap = angles[0] + 2.0 * np.pi - angles[-1]
    for k in range(angles.shape[0] - 1):
        gap = max(gap, angles[k + 1] - angles[k])
    return float(gap)
