"""Faces of a point cloud: the triangles on which its points agree, as a surface of one or more sheets.

Each point has the Delaunay triangles of its neighbours in its own tangent plane (see `point_cloud`). Where planes
differ, points may disagree. A triangle needs the votes of two of its corners, or two adjacent faces. Those with more
votes and smaller circumscribed circles are taken first, as long as an edge has one face on each side (as in Gopi,
Krishnan, Silva, "Surface reconstruction based on lower dimensional localized Delaunay triangulation", Eurographics
2000). So the faces are a manifold along their edges, and what needs a mesh works on a cloud; they are no reconstruction
for display.

Noise turns tangent planes, and points disagree. So the triangles are those of the points on their patches.
"""

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.fitting.fallbacks import fit_with_fallbacks
from bezier_filters.fitting.mesh_neighbourhoods import MeshNeighbourhoods
from bezier_filters.fitting.point_cloud import find_tangents, point_cloud
from bezier_filters.fitting.surface_fit import choose_fit
from bezier_filters.fitting.vertex_geometry import empty_geometry
from bezier_filters.kernels.kernel_input import kernel_mesh
from bezier_filters.meshes.adjacency import Adjacency
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.meshes.prepared_mesh import PreparedMesh, prepare_mesh
from bezier_filters.meshes.spatial_order import sort_spatially
from bezier_filters.runtime.jit import allocating_jit, jit
from bezier_filters.runtime.parallel import run_kernel
from bezier_filters.surface_model.fit_options import FitOptions

MIN_VOTES = 2  # of the corners of a triangle that have it in their tangent planes
MIN_NEIGHBOURS = 2  # adjacent faces of a triangle with fewer votes, which fills a gap


def cloud_surface(cloud: TriangleMesh, given: FloatArray | None = None) -> PreparedMesh:
    """A point cloud with faces between its points, which look to the side of `given` normals (n, 3) as `point_cloud`.

    >>> from bezier_filters.meshes.mesh import triangle_mesh
    >>> from bezier_filters.surfaces import sphere
    >>> ball = sphere(resolution=10)
    >>> made = cloud_surface(triangle_mesh(ball.vertices, []))
    >>> made.face_count == len(ball.faces)
    True
    """
    ordered = sort_spatially(cloud)
    mesh = ordered.mesh
    adjacency, planes, _ = point_cloud(mesh, None if given is None else given[ordered.order])
    arrays = kernel_mesh(mesh, adjacency, planes)
    source, options, geometry = MeshNeighbourhoods(arrays), FitOptions(), empty_geometry(mesh.vertex_count)
    fit, whole = choose_fit(source, options)
    points, normals = mesh.vertices, planes.normals
    if whole is not None:
        arrays = (source.clean if fit.cleaned else source).mesh
        ids: IntArray = np.arange(mesh.vertex_count, dtype=np.int32)
        fit_with_fallbacks(arrays, ids, fit.attempts, geometry, robust=fit.robust)
        points, normals = arrays.vertices + geometry.displacements, geometry.normals
        adjacency, planes, _ = point_cloud(TriangleMesh(points, mesh.faces), normals)
        normals = planes.normals
    faces = ordered.order[triangulate_cloud(points, adjacency, normals)]
    return prepare_mesh(TriangleMesh(cloud.vertices, faces.astype(np.int32)))


def triangulate_cloud(points: FloatArray, adjacency: Adjacency, normals: FloatArray) -> IntArray:
    """Triangles (m, 3) of points (n, 3), counter-clockwise about their unit normals (n, 3).

    >>> from bezier_filters.fitting.point_cloud import point_cloud
    >>> from bezier_filters.meshes.mesh import triangle_mesh
    >>> kite = triangle_mesh([[0, 0, 0], [1, 0, 0], [2, 2, 0], [0, 1, 0]], [])
    >>> adjacency, planes, _ = point_cloud(kite)
    >>> triangulate_cloud(kite.vertices, adjacency, planes.normals).tolist()
    [[0, 1, 3], [1, 2, 3]]
    """
    rows, n = adjacency.vertices, len(points)
    stars = np.full((len(rows.indices), 3), -1, dtype=np.int32)
    run_kernel(_write_stars, n, points, normals, rows.indptr, rows.indices, stars)
    stars = stars[stars[:, 0] >= 0]
    triangles, votes = _count_votes(stars, n)
    is_usable = (votes >= MIN_VOTES) | ~adjacency.on_boundary[triangles].all(axis=1)  # no slivers along borders
    triangles, votes = triangles[is_usable], votes[is_usable]
    order = np.lexsort((_circumradii(points, triangles), -votes)).astype(np.int32)
    pairs = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    _, edges = np.unique(pairs[:, 0].astype(np.int64) * n + pairs[:, 1], return_inverse=True)
    edges = edges.reshape(-1, 3).astype(np.int32)
    is_taken = np.zeros(len(triangles), dtype=np.bool_)
    has_face = np.zeros((int(edges.max(initial=-1)) + 1, 2), dtype=np.bool_)
    _take_triangles(points, normals, triangles, votes >= MIN_VOTES, edges, order, has_face, is_taken)
    return _orient(points, normals, triangles[is_taken])


def _count_votes(stars: IntArray, n: int) -> tuple[IntArray, IntArray]:
    """Distinct triangles among rows (k, 3) of sorted corners, and how often each is there."""
    rows = np.sort(stars, axis=1)
    order = np.lexsort(rows.T[::-1])
    rows = rows[order]
    is_new = np.ones(len(rows), dtype=np.bool_)
    is_new[1:] = (rows[1:] != rows[:-1]).any(axis=1)
    first = np.flatnonzero(is_new)
    return rows[first], np.diff(np.append(first, len(rows)))


def _circumradii(points: FloatArray, triangles: IntArray) -> FloatArray:
    """Radii of the circumscribed circles of triangles, (m,); infinite without an area."""
    a, b, c = (points[triangles[:, k]] for k in range(3))
    sides = [np.linalg.norm(q - p, axis=1) for p, q in ((a, b), (b, c), (c, a))]
    with np.errstate(divide="ignore", invalid="ignore"):
        radii = sides[0] * sides[1] * sides[2] / (2.0 * np.linalg.norm(np.cross(b - a, c - a), axis=1))
    return np.where(np.isfinite(radii), radii, np.inf)


def _orient(points: FloatArray, normals: FloatArray, triangles: IntArray) -> IntArray:
    """Triangles turned so that they are counter-clockwise about the sum of the normals of their corners."""
    a, b, c = (points[triangles[:, k]] for k in range(3))
    upward = normals[triangles].sum(axis=1)
    is_clockwise = np.einsum("ij,ij->i", np.cross(b - a, c - a), upward) < 0.0
    triangles[is_clockwise] = triangles[is_clockwise][:, [0, 2, 1]]
    return triangles


@allocating_jit()
def _write_stars(
    points: FloatArray,
    normals: FloatArray,
    indptr: IntArray,
    indices: IntArray,
    stars: IntArray,
    start: int,
    stop: int,
) -> None:
    """Write the Delaunay triangles of points start .. stop-1 with their neighbours, one for each of these at most.

    Inversion in the unit circle maps the circles through a point to lines: of three consecutive neighbours the middle
    one is a Delaunay neighbour if its image is beyond the line through the images of the others.
    """
    for i in range(start, stop):
        nx, ny, nz = normals[i]
        first, count = indptr[i], indptr[i + 1] - indptr[i]
        if count < 2 or (nx == 0.0 and ny == 0.0 and nz == 0.0):
            continue
        x, y = find_tangents(nx, ny, nz)
        images, angles = np.empty((count, 2)), np.empty(count)
        for q in range(count):
            edge = points[indices[first + q]] - points[i]
            a = edge[0] * x[0] + edge[1] * x[1] + edge[2] * x[2]
            b = edge[0] * y[0] + edge[1] * y[1] + edge[2] * y[2]
            flat = np.sqrt(a * a + b * b)
            length = np.sqrt(edge[0] * edge[0] + edge[1] * edge[1] + edge[2] * edge[2])
            scale = 1.0 / (flat * length) if flat > 0.0 else 0.0
            images[q, 0], images[q, 1], angles[q] = a * scale, b * scale, np.arctan2(b, a)
        ring = _delaunay_ring(images, angles, np.argsort(angles).astype(np.int32))
        for k in range(len(ring)):
            p, q = ring[k], ring[(k + 1) % len(ring)]
            if p != q and _angle(angles[p], angles[q]) < np.pi:
                row = first + k
                stars[row, 0], stars[row, 1], stars[row, 2] = i, indices[first + p], indices[first + q]


@allocating_jit()
def _delaunay_ring(images: FloatArray, angles: FloatArray, ring: IntArray) -> IntArray:
    """The Delaunay neighbours among neighbours in the order of their angles."""
    keep, count = np.ones(len(ring), dtype=np.bool_), len(ring)
    has_changed = True
    while has_changed and count > 2:
        has_changed = False
        for k in range(len(ring)):
            if not keep[k]:
                continue
            before, after = k - 1, (k + 1) % len(ring)
            while not keep[before]:
                before -= 1
            while not keep[after]:
                after = (after + 1) % len(ring)
            a, b, c = ring[before], ring[k], ring[after]
            if before % len(ring) == after or _angle(angles[a], angles[c]) >= np.pi:
                continue
            turn = (images[b, 0] - images[a, 0]) * (images[c, 1] - images[b, 1])
            turn -= (images[b, 1] - images[a, 1]) * (images[c, 0] - images[b, 0])
            if turn <= 0.0:
                keep[k], has_changed = False, True
                count -= 1
    return ring[keep]


@jit()
def _angle(start: float, end: float) -> float:
    """Angle from one direction counter-clockwise to another, from 0 to 2 pi."""
    return end - start if end >= start else end - start + 2.0 * np.pi


@jit()
def _take_triangles(
    points: FloatArray,
    normals: FloatArray,
    triangles: IntArray,
    is_agreed: BoolArray,
    edges: IntArray,
    order: IntArray,
    has_face: BoolArray,
    is_taken: BoolArray,
) -> None:
    """Mark triangles in an order as taken, if no edge gets a second face on one of its sides.

    Triangles with fewer votes only fill gaps.
    """
    for f in order:
        is_free, neighbours = True, 0
        for k in range(3):
            side = _side(points, normals, triangles[f, k], triangles[f, (k + 1) % 3], triangles[f, (k + 2) % 3])
            is_free = is_free and not has_face[edges[f, k], side]
            neighbours += has_face[edges[f, k], 1 - side]
        is_taken[f] = is_free and (is_agreed[f] or neighbours >= MIN_NEIGHBOURS)
        if is_taken[f]:
            for k in range(3):
                side = _side(points, normals, triangles[f, k], triangles[f, (k + 1) % 3], triangles[f, (k + 2) % 3])
                has_face[edges[f, k], side] = True


@jit()
def _side(points: FloatArray, normals: FloatArray, a: int, b: int, c: int) -> int:
    """Side of an edge (a, b) that a point c is on, 0 or 1, in the tangent plane of the corner of lower number."""
    i, j = min(a, b), max(a, b)
    ux, uy, uz = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
    vx, vy, vz = points[c, 0] - points[i, 0], points[c, 1] - points[i, 1], points[c, 2] - points[i, 2]
    height = (uy * vz - uz * vy) * normals[i, 0] + (uz * vx - ux * vz) * normals[i, 1]
    return 1 if height + (ux * vy - uy * vx) * normals[i, 2] > 0.0 else 0
