"""Point clouds: vertex adjacency and tangent planes without faces.

Tangent planes are least-squares planes of the nearest points, of as many as do not lie along one line. The neighbours
of a point are its Delaunay neighbours in its tangent plane: six on average, as on a mesh, also if points vary in
density. Along scan lines, where these lie much farther apart in one direction, all points nearer than the next line are
neighbours, too. So every algorithm that needs only vertex neighbours works on point clouds.
"""

from typing import NamedTuple, TypeAlias

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
# the same where the nearest ones lie on a line: twice as many, until they do not. A point of scan lines that are 30 of
# its steps apart has some 160 points nearer than 1.3 times the gap.
MAX_CANDIDATE_COUNT = 640
# Ratio of the second to the first principal variance below which points lie along a line. That of a disc is 1, that of
# half a disc, as at a border, 0.28; the 20 nearest of random points of a plane seldom have less than 0.2.
MIN_WIDTH_RATIO = 0.1
MIN_CURVE_WIDTH_RATIO = 0.01  # the same for the widest neighbourhood: a curve, whose points determine no plane
# ratio of the larger width of a star of neighbours to the distance of the nearest point, from which on these are lines
MAX_STAR_RATIO = 3.0
LINE_REACH = 0.7  # distance, over the larger width of such a star, within which all points are neighbours
MAX_ANGULAR_GAP = np.radians(120.0)  # between consecutive neighbours; a boundary point has a larger one
MIN_OCCLUSION_COSINE = np.cos(np.radians(15.0))  # between the directions to two points, one of which hides the other
MIN_VARIANCE_RATIO = 1e-12  # of the second to the first principal variance; below it points are collinear
MAX_DISTANCE_RATIO = 3.0  # of the distance of a neighbour to the distance that contains its own nearest points
QUERY_CHUNK = 1 << 22  # candidates that are looked up at a time
# cosine between normal and view from which on a point tells the side of its sheet: planes of sheets that are nearer to
# each other than their points are some 30 degrees wrong at most; with 0.25 and 0.7 the plates of the tests are the same
MIN_VIEW_COSINE = 0.5
MIN_SHEET_POINTS = 3  # points of a side among the nearest ones, as many as have a plane; fewer are errors of planes
OPPOSITE_FACTOR = 4  # nearest points, over a wanted number, among which those of the same side are; half of two sheets
NO_POINT = -1  # in place of a candidate that is none
COCIRCULARITY_TOLERANCE = 1e-6  # relative; all points of one empty circle become neighbours
Candidates: TypeAlias = tuple[IntArray, IntArray]  # some points (m,) and their candidates (m, k), nearest first


class PointCloud(NamedTuple):
    """The neighbours and tangent planes of points."""

    adjacency: Adjacency
    planes: TangentPlanes
    nearest: Rows | None = None  # nearest points of each, without itself, if a number of them is wanted


def point_cloud(
    mesh: TriangleMesh,
    normals: FloatArray | None = None,
    views: FloatArray | None = None,
    count: int | None = None,
) -> PointCloud:
    """Adjacency and tangent planes of the vertices of a mesh, whose faces are ignored.

    Planes are least-squares planes of the nearest points (Hoppe et al., "Surface reconstruction from unorganized
    points", SIGGRAPH 1992). Coincident points count as one neighbour. Isolated or collinear points have no plane and
    get zero normals; so do the points of a curve. Normals are oriented by the sign of `normals` (n, 3), of any length;
    where these are zero, by `orient_normals`. Points whose given normals are opposite lie on other sides of a wall, and
    are no neighbours.

    Instead of normals, there may be `views` (n, 3): unit vectors in whose directions the points were seen from, zero
    where unknown. They orient the normals, and points that were seen from opposite sides are no neighbours.

    With a `count`, planes are those of as many nearest points, of which the point itself is one; the other ones are
    listed.
    """
    first, place_of = _distinct(mesh.vertices)
    points = mesh.vertices[first]
    given, seen = (None if vectors is None else vectors[first] for vectors in (normals, views))
    sides = given if seen is None else _sides(points, seen)
    groups, reach = _nearest(points, sides)
    planes = _planes(points, groups)
    counted = None
    if count is not None:
        counted = _list_nearest(points, count - 1, sides)
        planes = _planes(points, counted)
    neighbours, on_boundary = _neighbours(points, groups, reach, planes)
    planes = orient_normals(points, planes, neighbours, given, seen)[place_of]
    if normals is not None:
        inward = np.einsum("ij,ij->i", planes, normals) < 0.0
        planes[inward] *= -1.0
    no_faces = Rows(np.zeros(mesh.vertex_count + 1, np.int32), np.empty(0, np.int32))
    adjacency = Adjacency(no_faces, _expand_to_points(neighbours, first, place_of), on_boundary[place_of])
    listed = None if counted is None else _expand_to_points(_rows_of(counted), first, place_of)
    return PointCloud(adjacency, TangentPlanes(planes, np.full(mesh.vertex_count, 2.0, np.float32)), listed)


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


def _nearest(points: FloatArray, normals: FloatArray | None) -> tuple[list[Candidates], FloatArray]:
    """Candidates of every point, nearest first, in groups of equal number, and the distance of the last of each, (n,).

    The nearest `CANDIDATE_COUNT` points whose normals, if they are given, are not opposite; where these lie along a
    line, twice as many, and so on.
    """
    n, groups, reach = len(points), [], np.zeros(len(points))
    if n < 2:
        return [(np.arange(n, dtype=np.int32), np.empty((n, 0), dtype=np.int32))], reach
    tree, left = cKDTree(points), np.arange(n, dtype=np.int32)
    count, wanted = min(CANDIDATE_COUNT, n - 1), np.full(n, min(CANDIDATE_COUNT, n - 1))
    while len(left):
        is_last = count >= min(MAX_CANDIDATE_COUNT, n - 1)
        open_rows: list[IntArray] = []
        for rows in np.array_split(left, max(1, len(left) * count // QUERY_CHUNK)):
            distances, nearest = tree.query(points[rows], k=np.arange(2, count + 2), workers=thread_count())
            nearest = np.ascontiguousarray(nearest, dtype=np.int32)
            if normals is not None:
                is_opposite = np.einsum("ij,ikj->ik", normals[rows], normals[nearest]) < 0.0
                is_opposite |= np.cumsum(~is_opposite, axis=1) > wanted[rows, np.newaxis]
                nearest[is_opposite] = NO_POINT
            known = nearest != NO_POINT
            is_scarce = known.sum(axis=1) < wanted[rows]
            is_line = ~is_scarce & (_width_ratios(points, rows, nearest) < MIN_WIDTH_RATIO)
            wanted[rows[is_line]] *= 2
            is_done = np.full(len(rows), is_last) | ~(is_scarce | is_line)
            reach[rows] = np.where(known, distances, 0.0).max(axis=1)
            groups.append((rows[is_done], nearest[is_done]))
            open_rows.append(rows[~is_done])
        left, count = np.concatenate(open_rows), min(2 * count, n - 1, MAX_CANDIDATE_COUNT)
    return [group for group in groups if len(group[0])], reach


def _list_nearest(points: FloatArray, count: int, normals: FloatArray | None) -> list[Candidates]:
    """The nearest `count` points of every point, or all; with normals, those whose normals are not opposite."""
    n = len(points)
    count = max(min(count, n - 1), 0)
    asked = count if normals is None else min(OPPOSITE_FACTOR * count, n - 1)
    every, groups, tree = np.arange(n, dtype=np.int32), [], cKDTree(points) if n else None
    for rows in np.array_split(every, max(1, n * asked // QUERY_CHUNK)):
        if tree is None or not asked:
            groups.append((rows, np.empty((len(rows), 0), dtype=np.int32)))
            continue
        _, nearest = tree.query(points[rows], k=np.arange(2, asked + 2), workers=thread_count())
        nearest = np.ascontiguousarray(nearest, dtype=np.int32)
        if normals is not None:
            is_opposite = np.einsum("ij,ikj->ik", normals[rows], normals[nearest]) < 0.0
            is_opposite |= np.cumsum(~is_opposite, axis=1) > count
            nearest[is_opposite] = NO_POINT
            first = np.argsort(is_opposite, axis=1, kind="stable")[:, :count]
            nearest = np.ascontiguousarray(np.take_along_axis(nearest, first, axis=1))
        groups.append((rows, nearest))
    return groups


def _rows_of(groups: list[Candidates]) -> Rows:
    """Candidates of all points in order as rows."""
    nearest = np.concatenate([columns for _, columns in groups])
    indptr = np.append(0, np.cumsum((nearest != NO_POINT).sum(axis=1))).astype(np.int32)
    return Rows(indptr, nearest[nearest != NO_POINT])


def _planes(points: FloatArray, groups: list[Candidates]) -> FloatArray:
    """Unit normals, of any sign, of the least-squares planes of all points; zero without a plane."""
    planes = np.zeros((len(points), 3))
    for rows, nearest in groups:
        planes[rows] = _least_squares_normals(points, rows, nearest)
    return planes


def _sides(points: FloatArray, views: FloatArray) -> FloatArray:
    """Normals (n, 3) towards the views, zero where a point was seen at grazing angle.

    The planes are those of points seen from the same side as this one, whatever their sheet: a sheet that was seen from
    two places is not divided, and another one close behind it does not turn its planes. A side that fewer than
    `MIN_SHEET_POINTS` of the nearest points and the point itself have is none.
    """
    planes = _planes(points, _nearest(points, views)[0])
    cosines = np.einsum("ij,ij->i", planes, views)
    sides = np.where((np.abs(cosines) >= MIN_VIEW_COSINE)[:, np.newaxis], planes * np.sign(cosines)[:, np.newaxis], 0.0)
    result = np.zeros_like(sides)
    for rows, nearest in _list_nearest(points, CANDIDATE_COUNT, None):
        agreement = np.einsum("ij,ikj->ik", sides[rows], sides[nearest])
        is_sheet = (agreement > 0.0).sum(axis=1) + 1 >= MIN_SHEET_POINTS
        result[rows[is_sheet]] = sides[rows[is_sheet]]
    return result


def _principal_axes(points: FloatArray, rows: IntArray, nearest: IntArray) -> tuple[FloatArray, FloatArray]:
    """Principal variances, ascending and times the number of points, (m, 3), and axes of points and candidates."""
    total, squares, count = np.zeros((len(rows), 3)), np.zeros((len(rows), 3, 3)), np.ones(len(rows))
    for column in nearest.T:
        is_known = column != NO_POINT
        away = (points[column] - points[rows]) * is_known[:, np.newaxis]
        total += away
        squares += away[:, :, np.newaxis] * away[:, np.newaxis, :]
        count += is_known
    squares -= total[:, :, np.newaxis] * total[:, np.newaxis, :] / count[:, np.newaxis, np.newaxis]
    variances, axes = np.linalg.eigh(squares)
    return variances, axes


def _width_ratios(points: FloatArray, rows: IntArray, nearest: IntArray) -> FloatArray:
    """Ratios of the second to the first principal variance, (m,)."""
    variances, _ = _principal_axes(points, rows, nearest)
    return np.asarray(variances[:, 1] / np.maximum(variances[:, 2], np.finfo(np.float64).tiny))


def _least_squares_normals(points: FloatArray, rows: IntArray, nearest: IntArray) -> FloatArray:
    """Unit normals, of any sign, of the least-squares planes; zero without a plane."""
    variances, axes = _principal_axes(points, rows, nearest)
    least = MIN_VARIANCE_RATIO if nearest.shape[1] <= CANDIDATE_COUNT else MIN_CURVE_WIDTH_RATIO
    on_a_line = variances[:, 1] <= least * variances[:, 2]
    return np.where(on_a_line[:, np.newaxis], 0.0, axes[:, :, 0])


def _neighbours(
    points: FloatArray, groups: list[Candidates], reach: FloatArray, normals: FloatArray
) -> tuple[Rows, BoolArray]:
    """Symmetric neighbour rows and boundary flags."""
    n = len(points)
    on_boundary = np.zeros(n, dtype=np.bool_)
    starts, ends = [], []
    for rows, nearest in groups:
        chosen = np.zeros(nearest.shape, dtype=np.bool_)
        run_kernel(_choose_neighbours, len(rows), points, rows, nearest, normals, reach, chosen, on_boundary)
        starts.append(np.repeat(rows, chosen.sum(axis=1)))
        ends.append(nearest[chosen])
    start, end = np.concatenate(starts), np.concatenate(ends)
    graph = csr_array((np.ones(len(start), dtype=np.int8), (start, end)), shape=(n, n))
    graph = (graph + graph.T).tocsr()
    graph.sort_indices()
    return Rows(graph.indptr.astype(np.int32), graph.indices.astype(np.int32)), on_boundary


@allocating_jit()
def _choose_neighbours(
    points: FloatArray,
    rows: IntArray,
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
    for row in range(start, stop):
        i = rows[row]
        nx, ny, nz = normals[i]
        if nx == 0.0 and ny == 0.0 and nz == 0.0:
            continue
        x, y = find_tangents(nx, ny, nz)
        inverted[0] = 0.0  # the image of infinity, a corner of the hull at a boundary
        candidate[0] = -1
        count = 1
        for q in range(nearest.shape[1]):
            j = nearest[row, q]
            if j == NO_POINT:
                continue
            edge = points[j] - points[i]
            a = edge[0] * x[0] + edge[1] * x[1] + edge[2] * x[2]
            b = edge[0] * y[0] + edge[1] * y[1] + edge[2] * y[2]
            flat = np.sqrt(a * a + b * b)
            # The projection keeps the length of the edge, so that a point above this one does not seem near.
            length = np.sqrt(edge[0] * edge[0] + edge[1] * edge[1] + edge[2] * edge[2])
            if flat == 0.0 or length > MAX_DISTANCE_RATIO * reach[j]:
                continue
            inverted[count, 0], inverted[count, 1] = a / (flat * length), b / (flat * length)
            angles[count - 1] = np.arctan2(b, a)
            candidate[count] = q
            count += 1
        _mark_hull(inverted, candidate, count, chosen[row])
        on_boundary[i] = _largest_gap(angles[: count - 1]) > MAX_ANGULAR_GAP
        if on_boundary[i]:
            _remove_occluded_neighbours(inverted, candidate, count, chosen[row])
        if nearest.shape[1] > CANDIDATE_COUNT:
            _mark_points_on_lines(inverted, candidate, count, chosen[row])


@allocating_jit()
def _mark_points_on_lines(inverted: FloatArray, candidate: IntArray, count: int, marks: BoolArray) -> None:
    """Mark all candidates nearer than the next scan line, where the marked ones are far in one direction only.

    The larger width of the star is the root of the larger principal second moment of the marked points.
    """
    xx, xy, yy, members = 0.0, 0.0, 0.0, 0
    for k in range(1, count):
        if marks[candidate[k]]:
            square = inverted[k, 0] ** 2 + inverted[k, 1] ** 2
            a, b = inverted[k, 0] / square, inverted[k, 1] / square
            xx, xy, yy, members = xx + a * a, xy + a * b, yy + b * b, members + 1
    if members < 2:
        return
    mean, half = 0.5 * (xx + yy), np.sqrt(0.25 * (xx - yy) ** 2 + xy * xy)
    nearest = 0.0
    for k in range(1, count):
        nearest = max(nearest, inverted[k, 0] ** 2 + inverted[k, 1] ** 2)
    if mean + half < MAX_STAR_RATIO**2 * members / nearest:
        return
    reach = LINE_REACH**2 * (mean + half) / members
    for k in range(1, count):
        if reach * (inverted[k, 0] ** 2 + inverted[k, 1] ** 2) > 1.0:
            marks[candidate[k]] = True


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
