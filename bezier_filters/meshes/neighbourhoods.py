"""Neighbourhoods of a vertex: k-rings (vertices within k edges) and balls (vertices within a distance)."""

from typing import NamedTuple

import numpy as np

from bezier_filters.arguments import checks_arguments
from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.errors import InvalidParameterError, is_integer
from bezier_filters.meshes.adjacency import Adjacency, Rows
from bezier_filters.runtime.jit import inner_jit, jit, opaque

MAX_NEIGHBOURHOOD_RINGS = 1000  # rings that users may request; work space grows with them


@checks_arguments
def k_rings(adjacency: Adjacency, rings: int) -> Rows:
    """Vertices within `rings` edges of every vertex, the vertex itself first.

    Fits collect one neighbourhood at a time; this function is for users who need all of them.

    Parameters
    ----------
    adjacency : Adjacency
        From `vertex_adjacency`.
    rings : int
        At least 0; 0 gives the vertex alone.

    Returns
    -------
    Rows
        One row per vertex, ordered by distance in edges.

    Examples
    --------
    >>> from bezier_filters.meshes.adjacency import vertex_adjacency
    >>> from bezier_filters.meshes.mesh import triangle_mesh
    >>> strip = triangle_mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], [[0, 1, 2], [2, 1, 3]])
    >>> k_rings(vertex_adjacency(strip), 1).row(3)
    array([3, 1, 2], dtype=int32)
    """
    if not (is_integer(rings) and 0 <= rings <= MAX_NEIGHBOURHOOD_RINGS):
        raise InvalidParameterError(f"rings: got {rings!r}, expected an integer from 0 to {MAX_NEIGHBOURHOOD_RINGS}")
    n, rows = len(adjacency.vertices), adjacency.vertices
    members, (visited, barriers) = np.empty(n + 1, dtype=np.int32), np.zeros((2, n), dtype=np.bool_)
    found = [np.empty(0, dtype=np.int32)]
    for i in range(n):
        count, _ = collect_ring(rows.indptr, rows.indices, barriers, i, rings, visited, members)
        found.append(members[:count].copy())
    indptr = np.cumsum([len(row) for row in found], dtype=np.int32)
    return Rows(indptr, np.concatenate(found))


class SearchWorkspace(NamedTuple):
    """Work space of searches among n vertices, reused because allocation takes longer than a small search."""

    visited: BoolArray  # (n,): false everywhere before and after
    members: IntArray  # (n + 1,)


def search_workspace(n: int) -> SearchWorkspace:
    """Work space for n vertices; searches touch only the entries of the vertices they meet."""
    return SearchWorkspace(np.zeros(n, dtype=np.bool_), np.empty(n + 1, dtype=np.int32))


def rings_around(
    neighbours: Rows, seeds: IntArray, rings: int, room: SearchWorkspace | None = None
) -> tuple[IntArray, IntArray]:
    """Vertices within some rings of the seeds, and the distance of each in edges.

    The seeds come first; each ring is in the order in which the search meets it.

    >>> path = Rows(np.array([0, 1, 3, 4], np.int32), np.array([1, 0, 2, 1], np.int32))
    >>> members, distances = rings_around(path, np.array([1], np.int32), 2)
    >>> members.tolist(), distances.tolist()
    ([1, 0, 2], [0, 1, 1])
    """
    visited, members = room or search_workspace(len(neighbours))
    ends = np.zeros(rings + 1, dtype=np.int32)
    members[: len(seeds)], ends[0] = seeds, len(seeds)
    _spread(neighbours.indptr, neighbours.indices, visited, members, ends)
    sizes = np.diff(ends, prepend=0)
    return members[: ends[-1]].copy(), np.repeat(np.arange(rings + 1, dtype=np.int32), sizes)


@jit()
def _spread(indptr: IntArray, indices: IntArray, visited: BoolArray, members: IntArray, ends: IntArray) -> None:
    """Append ring after ring to the members before the first end, and write the end of each."""
    for a in range(ends[0]):
        visited[members[a]] = True
    start = opaque(0)
    for ring in range(1, ends.shape[0]):
        count = ends[ring - 1]
        for a in range(start, ends[ring - 1]):
            for q in range(indptr[members[a]], indptr[members[a] + 1]):
                members[count] = indices[q]
                count += not visited[indices[q]]
                visited[indices[q]] = True
        start, ends[ring] = ends[ring - 1], count
    clear_marks(visited, members, ends[ends.shape[0] - 1])


@jit()
def collect_ring(
    indptr: IntArray,
    indices: IntArray,
    barriers: BoolArray,
    center: int,
    rings: int,
    visited: BoolArray,
    members: IntArray,
) -> tuple[int, int]:
    """Breadth-first search from one vertex, up to `rings` edges.

    It reaches vertices marked by `barriers` but does not continue from them, unless it starts there. `visited` is work
    space, false everywhere before and after. `members` (n + 1,) receives the vertices, the center first, ordered by
    distance in edges; entries behind them are overwritten. Returns their number, and the number within ``rings - 1``.
    """
    members[0] = center
    visited[center] = True
    inner, count = opaque(0), opaque(1)
    if rings > 0:  # all vertices of the first ring are new
        inner = count
        for q in range(indptr[center], indptr[center + 1]):
            k = indices[np.uint32(q)]
            members[np.uint64(count)] = k
            visited[np.uint32(k)] = True
            count += 1
    for _ in range(1, rings):
        start, inner = inner, count
        count = next_ring(indptr, indices, barriers, start, count, visited, members)
    clear_marks(visited, members, count)
    return count, inner


@inner_jit()
def clear_marks(visited: BoolArray, members: IntArray, count: int) -> None:
    """Clear the marks at members[:count]."""
    for a in range(count):
        visited[np.uint32(members[a])] = False


@inner_jit()
def next_ring(
    indptr: IntArray,
    indices: IntArray,
    barriers: BoolArray,
    start: int,
    stop: int,
    visited: BoolArray,
    members: IntArray,
) -> int:
    """Extend the search of `collect_ring` by one ring, from members[start:stop]; return the new count."""
    count = stop
    for a in range(start, stop):
        j = members[a]
        if barriers[j] and a > 0:
            continue
        for q in range(indptr[j], indptr[j + 1]):
            k = indices[np.uint32(q)]
            # No unpredictable branch: the next entry overwrites a vertex that was visited before.
            members[np.uint64(count)] = k
            count += not visited[np.uint32(k)]
            visited[np.uint32(k)] = True
    return count


@inner_jit()
def collect_ball(
    vertices: FloatArray,
    indptr: IntArray,
    indices: IntArray,
    barriers: BoolArray,
    center: int,
    radius: float,
    visited: BoolArray,
    members: IntArray,
) -> tuple[int, int, int, int]:
    """Breadth-first search from one vertex that stays in the ball of a radius around it.

    Another sheet of the surface may lie within the radius as well. Vertices that the search
    cannot reach inside the ball do not belong to the neighbourhood.

    Arguments are those of `collect_ring`. Returns the number of vertices, the number within ``rings - 1`` edges, the
    number of neighbours of the center, and the number of rings.
    """
    members[0] = center
    visited[center] = True
    start, inner, count, neighbours, rings = opaque(0), opaque(0), opaque(1), 0, 0
    x, y, z = vertices[center, 0], vertices[center, 1], vertices[center, 2]
    while inner < count:
        start, inner = inner, count
        met = next_ring(indptr, indices, barriers, start, inner, visited, members)
        for a in range(inner, met):
            k = members[a]
            dx, dy, dz = vertices[k, 0] - x, vertices[k, 1] - y, vertices[k, 2] - z
            if dx * dx + dy * dy + dz * dz <= radius * radius:
                members[count] = k
                count += 1
            else:
                visited[k] = False
        if count > inner:
            rings += 1
        if rings == 1:
            neighbours = count - 1
    clear_marks(visited, members, count)
    return count, start, neighbours, rings
