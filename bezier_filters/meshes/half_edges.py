"""Edges and half-edges: adjacent faces, dihedral angles, and boundary loops.

Half-edge 3 f + k runs from corner k of face f to the next corner.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from bezier_filters.arrays import BoolArray, FloatArray, IntArray, unique_rows
from bezier_filters.meshes.mesh import TriangleMesh, ensure_mesh
from bezier_filters.meshes.mesh_objects import MeshLike
from bezier_filters.meshes.triangles import area_vectors, unit_normal
from bezier_filters.runtime.jit import inner_jit, jit, short_jit
from bezier_filters.runtime.parallel import run_kernel

COINCIDENCE_TOLERANCE = 1e-4  # distance up to which vertices coincide, over the longest border edge at them
NON_MANIFOLD = -2  # stands for the opposite half-edge where it is not unique


def ends_of_half_edges(faces: IntArray) -> tuple[IntArray, IntArray]:
    """Start and end of all half-edges of faces (m, 3), each (3 m,)."""
    return faces.ravel(), faces[:, [1, 2, 0]].ravel()


def proper_faces(faces: IntArray) -> IntArray:
    """Faces of (m, 3) with three different vertices."""
    return np.asarray(faces[(faces != faces[:, [1, 2, 0]]).all(axis=1)])


def distinct_edges(faces: IntArray, n: int) -> tuple[IntArray, IntArray, IntArray]:
    """Edges of faces (m, 3) between n vertices: ends (e, 2), the edge of each half-edge, half-edges per edge."""
    starts, ends = (side.astype(np.int64) for side in ends_of_half_edges(faces))
    keys, number, count = np.unique(
        np.minimum(starts, ends) * n + np.maximum(starts, ends), return_inverse=True, return_counts=True
    )
    edges = np.stack(np.divmod(keys, max(n, 1)), axis=1)
    return edges.astype(np.int32), number.astype(np.int32), count.astype(np.int32)


def _first_and_last(edge: IntArray, count: IntArray) -> tuple[IntArray, IntArray]:
    """First and last half-edge of each edge, given the edge of each half-edge and the half-edges per edge."""
    order = np.argsort(edge, kind="stable").astype(np.int32)
    return order[np.cumsum(count) - count], order[np.cumsum(count) - 1]


def half_edge_pairs(faces: IntArray, n: int) -> tuple[IntArray, IntArray]:
    """Both half-edges of every edge with exactly two, each (e,)."""
    _, edge, count = distinct_edges(faces, n)
    first, last = _first_and_last(edge, count)
    return first[count == 2], last[count == 2]


def faces_at_edges(faces: IntArray, starts: IntArray, ends: IntArray) -> IntArray:
    """Face (of m) with the half-edge from each start to its end, -1 if there is none, (k,).

    >>> faces = np.array([[0, 1, 2], [2, 1, 3]], dtype=np.int32)
    >>> faces_at_edges(faces, np.array([2, 1, 1], dtype=np.int32), np.array([1, 2, 0], dtype=np.int32))
    array([ 1,  0, -1], dtype=int32)
    """
    n = 1 + max(int(faces.max(initial=0)), int(starts.max(initial=0)))
    found = np.empty(len(starts), dtype=np.int32)
    _find_faces(faces, half_edge_lists(faces, n), starts, ends, found)
    return found


def face_neighbours(faces: IntArray) -> IntArray:
    """Face across the edge from corner k to the next, -1 at the border, (m, 3), of manifold, oriented faces."""
    found = np.empty_like(faces)
    find_neighbours(faces, allocate_half_edges(faces.size, 1 + int(faces.max(initial=0))), found)
    return found


class HalfEdgeLists(NamedTuple):
    """Linked lists of the half-edges that start at each vertex; for few faces faster than sorting."""

    first: IntArray  # (n,): the first half-edge of each vertex, -1 if there is none
    following: IntArray  # (3 m,): the next one in the list of each


def half_edge_lists(faces: IntArray, n: int) -> HalfEdgeLists:
    """Lists of the half-edges of faces (m, 3) between n vertices."""
    lists = allocate_half_edges(faces.size, n)
    _link(faces, lists)
    return lists


def allocate_half_edges(count: int, n: int) -> HalfEdgeLists:
    """Allocate lists of `count` half-edges between n vertices."""
    return HalfEdgeLists(np.empty(n, dtype=np.int32), np.empty(count, dtype=np.int32))


@short_jit()
def _link(faces: IntArray, lists: HalfEdgeLists) -> None:
    for i in range(lists.first.shape[0]):
        lists.first[i] = -1
    for f in range(faces.shape[0] - 1, -1, -1):
        for k in range(2, -1, -1):
            lists.following[3 * f + k] = lists.first[faces[f, k]]
            lists.first[faces[f, k]] = 3 * f + k


@inner_jit()
def face_at_edge(faces: IntArray, lists: HalfEdgeLists, start: int, end: int) -> int:
    """The face with the half-edge from start to end, -1 if there is none."""
    place = lists.first[start]
    while place >= 0 and faces[place // 3, (place + 1) % 3] != end:
        place = lists.following[place]
    return place // 3 if place >= 0 else -1


@short_jit()
def _find_faces(faces: IntArray, lists: HalfEdgeLists, starts: IntArray, ends: IntArray, found: IntArray) -> None:
    for q in range(starts.shape[0]):
        found[q] = face_at_edge(faces, lists, starts[q], ends[q])


@short_jit()
def find_neighbours(faces: IntArray, lists: HalfEdgeLists, found: IntArray) -> None:
    """Write `face_neighbours`; the lists are work space."""
    _link(faces, lists)
    for f in range(faces.shape[0]):
        for k in range(3):
            found[f, k] = face_at_edge(faces, lists, faces[f, (k + 1) % 3], faces[f, k])


def normals_along(
    points: FloatArray, faces: IntArray, lists: HalfEdgeLists, loop: IntArray, *, beyond: bool
) -> FloatArray:
    """Unit normals (k, 3) of the faces along the edges of a loop, or across them; zero where there is no face.

    Row k belongs to the edge that starts at loop[k].
    """
    normals = np.zeros((len(loop), 3))
    _write_normals(points, faces, lists, loop, beyond, normals)
    return normals


@short_jit()
def _write_normals(
    points: FloatArray, faces: IntArray, lists: HalfEdgeLists, loop: IntArray, beyond: bool, normals: FloatArray
) -> None:
    for k in range(loop.shape[0]):
        start, end = loop[k], loop[(k + 1) % loop.shape[0]]
        f = face_at_edge(faces, lists, end, start) if beyond else face_at_edge(faces, lists, start, end)
        if f >= 0:
            x, y, z, _ = unit_normal(points, faces[f, 0], faces[f, 1], faces[f, 2])
            normals[k, 0], normals[k, 1], normals[k, 2] = x, y, z


def half_edge_twins(faces: IntArray, n: int) -> IntArray:
    """Opposite half-edges of faces (m, 3) between n vertices, (3 m,).

    -1 on the boundary, `NON_MANIFOLD` at edges with more than two faces or with two that disagree.
    """
    start, end = ends_of_half_edges(faces)
    _, edge, count = distinct_edges(faces, n)
    first, last = _first_and_last(edge, count)
    twin = first[edge] + (last[edge] - np.arange(len(edge)))
    opposite = (count == 2) & (start[first] == end[last])
    return np.where(opposite[edge], twin, np.where(count[edge] == 1, -1, NON_MANIFOLD)).astype(np.int32)


@dataclass(frozen=True)
class MeshEdges:
    """The distinct edges of a mesh, without edges of faces that repeat a vertex."""

    vertices: IntArray  # (e, 2): their ends, the smaller one first; rows in ascending order
    # (m, 3): number of the edge from each corner of a face to the next; -1 where the face repeats a vertex
    of_faces: IntArray
    # (e,): angle between the normals of the two faces, in radians, 0 to pi: 0 where the surface is flat, where the
    # edge does not have two faces, and where a face has zero area
    angles: FloatArray
    is_convex: BoolArray  # (e,): whether the faces bend away from the outside
    # (e,): width across the edge of the strip that is nearer to it than to the other edges of its faces: a third of
    # each height, which is two thirds of their area over the length of the edge
    widths: FloatArray


def dihedral_angles(normals: FloatArray, others: FloatArray) -> FloatArray:
    """Angles between unit normals (k, 3), in radians: by their chord, which is accurate where they are nearly equal."""
    half_chord = 0.5 * np.linalg.norm(normals - others, axis=1)
    return np.asarray(2.0 * np.arcsin(np.minimum(half_chord, 1.0)), dtype=np.float64)


def mesh_edges(mesh: TriangleMesh) -> MeshEdges:
    """Find the edges of a mesh.

    >>> from bezier_filters.meshes.mesh import triangle_mesh
    >>> ridge = triangle_mesh([[0, 0, 0], [0, 1, 0], [1, 0, -1], [-1, 0, -1]], [[0, 2, 1], [0, 1, 3]])
    >>> edges = mesh_edges(ridge)
    >>> edges.vertices[0], np.degrees(edges.angles[0]).round(), edges.is_convex[0]
    (array([0, 1], dtype=int32), np.float64(90.0), np.True_)
    """
    faces = mesh.faces
    proper = (faces != faces[:, [1, 2, 0]]).all(axis=1)
    vertices, number, count = distinct_edges(faces[proper], mesh.vertex_count)
    of_faces = np.full((len(faces), 3), -1, dtype=np.int32)
    of_faces[proper] = number.reshape(-1, 3)

    normals = area_vectors(mesh.vertices, faces)
    doubled_areas = np.linalg.norm(normals, axis=1)
    known = doubled_areas > 0.0
    normals[known] /= doubled_areas[known, np.newaxis]
    lengths = np.linalg.norm(mesh.vertices[vertices[:, 1]] - mesh.vertices[vertices[:, 0]], axis=1)
    area = np.bincount(number, weights=np.repeat(doubled_areas[proper], 3), minlength=len(vertices))
    widths = np.divide(area, 3.0 * lengths, out=np.zeros(len(vertices)), where=lengths > 0.0)

    is_inner = count == 2
    first, second = (of_edges[is_inner] for of_edges in _first_and_last(number, count))
    face_ids = np.flatnonzero(proper)
    own, other = face_ids[first // 3], face_ids[second // 3]
    angles, is_convex = np.zeros(len(vertices)), np.zeros(len(vertices), dtype=np.bool_)
    angles[is_inner] = np.where(known[own] & known[other], dihedral_angles(normals[own], normals[other]), 0.0)
    beyond = mesh.vertices[faces[other, (second + 2) % 3]] - mesh.vertices[faces[own, 0]]
    is_convex[is_inner] = np.einsum("ij,ij->i", beyond, normals[own]) < 0.0
    return MeshEdges(vertices, of_faces, angles, is_convex, widths)


@dataclass(frozen=True)
class BorderEdges:
    """Half-edges at the border, and the non-manifold vertices among their ends."""

    # each (b,): start, end, and third vertex of the face
    start: IntArray
    end: IntArray
    third: IntArray
    # (n,): vertices of edges with three faces or more, or with two that disagree, among the faces at the border
    non_manifold: BoolArray


def faces_at(faces: IntArray, marked: BoolArray) -> IntArray:
    """Indices of the faces with a marked vertex."""
    found = np.empty(len(faces), dtype=np.bool_)
    run_kernel(_touch, len(faces), faces, marked, found)
    return np.flatnonzero(found).astype(np.int32)


@jit()
def _touch(faces: IntArray, marked: BoolArray, found: BoolArray, start: int, stop: int) -> None:
    for f in range(start, stop):
        found[f] = marked[faces[f, 0]] or marked[faces[f, 1]] or marked[faces[f, 2]]


def border_edges(mesh: TriangleMesh, on_boundary: BoolArray) -> BorderEdges:
    """Border of a mesh, from the faces at the boundary; `on_boundary` is that of `Adjacency`."""
    faces = proper_faces(mesh.faces[faces_at(mesh.faces, on_boundary)])
    twin = half_edge_twins(faces, mesh.vertex_count)
    start, end = ends_of_half_edges(faces)
    # An edge whose other face is not among these has an end that is not on the boundary.
    borders = (twin == -1) & on_boundary[start] & on_boundary[end]
    third = faces[:, [2, 0, 1]].ravel()
    non_manifold = np.zeros(mesh.vertex_count, dtype=np.bool_)
    non_manifold[start[twin == NON_MANIFOLD]] = non_manifold[end[twin == NON_MANIFOLD]] = True
    return BorderEdges(start[borders], end[borders], third[borders], non_manifold)


def non_manifold_edge_vertices(mesh: TriangleMesh) -> BoolArray:
    """Vertices (n,) of edges with three faces or more, or with two in the same direction."""
    return border_edges(mesh, np.ones(mesh.vertex_count, dtype=np.bool_)).non_manifold


def coincident_border_edges(mesh: TriangleMesh, border: BorderEdges) -> BoolArray:
    """Border edges (b,) that coincide with another one, as at seams whose vertices a file stores twice.

    Edges whose faces coincide as well do not count, as in a two-sided sheet.
    """
    welded, n = weld_vertices(mesh, border), mesh.vertex_count
    start, end, third = (welded[ends].astype(np.int64) for ends in (border.start, border.end, border.third))
    _, edge_of, count = np.unique(
        np.minimum(start, end) * n + np.maximum(start, end), return_inverse=True, return_counts=True
    )
    _, face_of, same = np.unique(edge_of * n + third, return_inverse=True, return_counts=True)
    return np.asarray((start != end) & (count[edge_of] > same[face_of]))


def weld_vertices(mesh: TriangleMesh, border: BorderEdges) -> IntArray:
    """Representative (n,) of each vertex among the coincident vertices of faces at the border."""
    ids = np.unique(np.concatenate([border.start, border.end, border.third]))
    edge = np.linalg.norm(mesh.vertices[border.end] - mesh.vertices[border.start], axis=1)
    longest = np.zeros(mesh.vertex_count)
    np.maximum.at(longest, border.start, edge)
    np.maximum.at(longest, border.end, edge)
    place = _group_coincident(mesh.vertices[ids], COINCIDENCE_TOLERANCE * longest[ids])
    welded = np.arange(mesh.vertex_count, dtype=np.int32)
    _, first = np.unique(place, return_index=True)
    welded[ids] = ids[first[place]]
    return welded


def _group_coincident(points: FloatArray, tolerances: FloatArray) -> IntArray:
    """Group number of each point, (k,): points within their tolerances of each other share a group."""
    places, place = unique_rows(points)
    place, reach = place.ravel(), np.zeros(len(places))
    np.maximum.at(reach, place, tolerances)
    distance, other = cKDTree(places).query(places, k=[2, 3], distance_upper_bound=max(reach.max(initial=0.0), 1e-300))
    near = distance <= np.minimum(reach[:, np.newaxis], np.append(reach, 0.0)[other])
    row, column = np.nonzero(near)
    graph = coo_array((np.ones(len(row)), (row, other[row, column])), shape=(len(places), len(places)))
    return np.asarray(connected_components(graph, directed=False)[1][place])


def boundary_loops(mesh: ArrayLike | MeshLike, faces: ArrayLike | None = None) -> list[IntArray]:
    """Ordered boundary loops, one array of vertex indices each.

    A loop runs along its faces' own direction: counter-clockwise around the outer rim of a
    sheet seen from outside, clockwise around a hole. Loops that only touch at a vertex are
    kept apart by walking around the faces at that vertex.

    Parameters
    ----------
    mesh : TriangleMesh or other mesh object, or (n, 3) array_like of float
        A mesh, see `mesh_arrays`, or the coordinates of its vertices.
    faces : (m, 3) array_like of int, optional
        Triangles, if `mesh` is an array.

    Returns
    -------
    list of (k,) int32
        Loops ordered by their smallest vertex, at which each one starts. A border that meets an edge with more than two
        faces, or with two in the same direction, is not a loop and is omitted; `fill_holes` lists it.

    Examples
    --------
    >>> boundary_loops([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    [array([0, 1, 2], dtype=int32)]
    """
    mesh = ensure_mesh(mesh, faces)
    proper = proper_faces(mesh.faces)
    twin, start = half_edge_twins(proper, mesh.vertex_count), proper.ravel()
    boundary = np.flatnonzero(twin == -1)
    following = np.arange(len(twin)).reshape(-1, 3)[:, [1, 2, 0]].ravel()
    successor = np.where(twin == NON_MANIFOLD, np.arange(len(twin)), following).astype(np.int32)
    # Rotate about the end vertex of all boundary half-edges at once, each within its own fan of faces.
    turning = boundary
    while len(turning):
        turning = turning[twin[successor[turning]] >= 0]
        successor[turning] = following[twin[successor[turning]]]
    paths = cycles(successor, boundary[np.argsort(start[boundary], kind="stable")].astype(np.int32))
    return [start[path] for path in paths if twin[path[-1]] == -1 and successor[path[-1]] == path[0]]


def cycles(successor: IntArray, order: IntArray) -> list[IntArray]:
    """Cycles of a permutation, given by the successor of each item, in the order of their first items.

    Items that are their own successors may end paths; these are returned as well.
    """
    items, ends = np.empty(len(successor), dtype=np.int32), np.empty_like(order)
    count = _follow(successor, order, np.zeros(len(successor), dtype=np.bool_), items, ends)
    return np.split(items[: ends[count - 1]], ends[: count - 1]) if count else []


@jit()
def _follow(successor: IntArray, order: IntArray, seen: BoolArray, items: IntArray, ends: IntArray) -> int:
    """Write the items of all cycles and the end of each; return the number of cycles."""
    written, count = 0, 0
    for first in order:
        item = first
        while not seen[item]:
            seen[item] = True
            items[written] = item
            written += 1
            item = successor[item]
        if written > 0 and (count == 0 or written > ends[count - 1]):
            ends[count] = written
            count += 1
    return count
