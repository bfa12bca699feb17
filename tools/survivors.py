"""Remesh a surface on some of its vertices, which keep their positions exactly.

Every vertex to be deleted is collapsed along an edge onto a surviving neighbour, the one that leaves
the best triangles; edges are flipped towards Delaunay in between. A collapse that would make the
mesh non-manifold, or a face look away from the surface, is not done: such a vertex stays.
"""

import numpy as np
from numba import njit

import bezier_filters as bf
from bezier_filters.meshes.frames import tangent_planes
from half_edges import HalfEdges, half_edges, next_edge, origin, previous_edge, vertex_star

QUALITIES = (0.6, 0.5, 0.4, 0.3, 0.2, 0.1, 0.05, 0.02, 0.01, 0.01, 0.01)
"""Worst triangle that a collapse may leave (1 is equilateral, 0 is flat), pass by pass."""
SWEEPS = 10
"""Sweeps of flips after every pass."""
TURN = 0.3
"""Cosine between a new face and those it replaces, at least."""
LEAN = 0.1
"""Cosine between a new face and the normals of the full mesh at its corners, at least."""


def keep_survivors(vertices: np.ndarray, faces: np.ndarray, survivors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Delete all but the surviving vertices, as far as possible.

    Parameters
    ----------
    vertices : (n, 3) float64
    faces : (m, 3) int32
        An oriented manifold, with or without borders.
    survivors : (n,) bool
        Vertices to keep.

    Returns
    -------
    kept : (k,) int64
        Vertices of the new mesh, ascending: the survivors that have faces, and what could not be deleted.
    faces : (q, 3) int32
        Triangles; they index `kept`.

    Raises
    ------
    ValueError
        If the mesh is not an oriented manifold.
    """
    mesh = half_edges(faces, len(vertices))
    checked = bf.triangle_mesh(vertices, faces)
    normals = tangent_planes(checked, bf.vertex_adjacency(checked)).normals
    stamp = np.full(len(vertices), -1, dtype=np.int32)
    for quality in QUALITIES:
        _collapse_pass(mesh, vertices, normals, survivors, stamp, quality)
        for _ in range(SWEEPS):
            if not _flip_pass(mesh, vertices, normals):
                break
    left = mesh.faces[mesh.faces[:, 0] >= 0]
    kept = np.unique(left)
    return kept, np.searchsorted(kept, left).astype(np.int32)


@njit(cache=True)
def _dot(p: np.ndarray, q: np.ndarray) -> float:
    """Of three numbers, in this order on every machine: what is nearly as good makes another mesh."""
    return p[0] * q[0] + p[1] * q[1] + p[2] * q[2]


@njit(cache=True)
def _normal(vertices: np.ndarray, a: int, b: int, c: int) -> tuple[np.ndarray, float]:
    """Unit normal and quality of a triangle, 4 sqrt(3) area / sum of squared edges."""
    p, q = vertices[b] - vertices[a], vertices[c] - vertices[a]
    r = q - p
    normal = np.array([p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]])
    length = np.sqrt(_dot(normal, normal))
    if length == 0.0:
        return normal, 0.0
    return normal / length, 2.0 * np.sqrt(3.0) * length / (_dot(p, p) + _dot(q, q) + _dot(r, r))


@njit(cache=True)
def _faces_surface(normal: np.ndarray, normals: np.ndarray, a: int, b: int, c: int) -> bool:
    """Whether a face looks the way the full mesh does at its corners."""
    return min(_dot(normal, normals[a]), _dot(normal, normals[b]), _dot(normal, normals[c])) > LEAN


@njit(cache=True)
def _collapse_pass(
    mesh: HalfEdges,
    vertices: np.ndarray,
    normals: np.ndarray,
    survivors: np.ndarray,
    stamp: np.ndarray,
    worst: float,
) -> None:
    """Collapse every vertex to be deleted that has a neighbour to go to."""
    star, other = np.empty(mesh.faces.shape[0], np.int32), np.empty(mesh.faces.shape[0], np.int32)
    ring = np.empty(mesh.faces.shape[0] + 1, np.int32)
    for v in range(survivors.shape[0]):
        if survivors[v] or mesh.out[v] < 0:
            continue
        count, border = vertex_star(mesh, v, star)
        size = count
        for k in range(count):
            ring[k] = origin(mesh, next_edge(star[k]))
        if border:
            ring[count] = origin(mesh, previous_edge(star[count - 1]))
            size += 1
        best, target = worst, -1
        for k in range(size):
            if survivors[ring[k]] and not (border and 0 < k < count):
                quality = _quality_after(mesh, vertices, normals, star, count, ring[k])
                if quality > best and _link_condition(mesh, v, ring, size, k, border, stamp, other):
                    best, target = quality, k
        if target >= 0:
            _collapse(mesh, star, count, border, target, ring[target])
            mesh.out[v] = -1


@njit(cache=True)
def _quality_after(
    mesh: HalfEdges, vertices: np.ndarray, normals: np.ndarray, star: np.ndarray, count: int, w: int
) -> float:
    """Worst triangle once the star's centre is at w; 0 if a face turns away."""
    worst = 1.0
    for k in range(count):
        v, a, b = origin(mesh, star[k]), origin(mesh, next_edge(star[k])), origin(mesh, previous_edge(star[k]))
        if a != w and b != w:
            before, _ = _normal(vertices, v, a, b)
            after, quality = _normal(vertices, w, a, b)
            if _dot(before, after) < TURN or not _faces_surface(after, normals, w, a, b):
                return 0.0
            worst = min(worst, quality)
    return worst


@njit(cache=True)
def _link_condition(
    mesh: HalfEdges, v: int, ring: np.ndarray, size: int, k: int, border: bool, stamp: np.ndarray, other: np.ndarray
) -> bool:
    """Whether v and ring[k] share only the neighbours beside their edge, so that the mesh stays a manifold."""
    beside = 1 if border else 2
    if size <= beside + border or (size == 3 and not border and _across_is(mesh, v, ring, k)):
        return False
    for q in range(size):
        stamp[ring[q]] = v
    w = ring[k]
    count, w_border = vertex_star(mesh, w, other)
    shared = 0
    for q in range(count):
        shared += stamp[origin(mesh, next_edge(other[q]))] == v
    if w_border:
        shared += stamp[origin(mesh, previous_edge(other[count - 1]))] == v
    for q in range(size):
        stamp[ring[q]] = -1
    return shared == beside


@njit(cache=True)
def _across_is(mesh: HalfEdges, v: int, ring: np.ndarray, k: int) -> bool:
    """Whether the face across the edge opposite ring[k], in a star of three, has ring[k] too: a tetrahedron."""
    a = ring[(k + 1) % 3]
    h = mesh.out[v]
    while origin(mesh, next_edge(h)) != a:
        h = mesh.twin[previous_edge(h)]
    across = mesh.twin[next_edge(h)]
    return across >= 0 and origin(mesh, previous_edge(across)) == ring[k]


@njit(cache=True)
def _collapse(mesh: HalfEdges, star: np.ndarray, count: int, border: bool, k: int, w: int) -> None:
    """Move the star's centre onto w, its k-th neighbour; the faces at their edge vanish."""
    for q in range(count):
        mesh.faces[star[q] // 3, star[q] % 3] = w
    if k < count:
        _remove(mesh, next_edge(star[k]), previous_edge(star[k]))
    if k > 0 or not border:
        h = star[(k - 1) % count]
        _remove(mesh, next_edge(h), h)


@njit(cache=True)
def _remove(mesh: HalfEdges, first: int, second: int) -> None:
    """Remove a face whose half-edges `first` and `second` have come to lie on each other."""
    p, q = mesh.twin[first], mesh.twin[second]
    if p >= 0:
        mesh.twin[p] = q
        mesh.out[origin(mesh, p)], mesh.out[origin(mesh, next_edge(p))] = p, next_edge(p)
    if q >= 0:
        mesh.twin[q] = p
        mesh.out[origin(mesh, q)], mesh.out[origin(mesh, next_edge(q))] = q, next_edge(q)
    mesh.faces[first // 3] = -1


@njit(cache=True)
def _flip_pass(mesh: HalfEdges, vertices: np.ndarray, normals: np.ndarray) -> int:
    """Flip edges whose opposite angles sum to more than 180 degrees; return how many."""
    star = np.empty(mesh.faces.shape[0], np.int32)
    flips = 0
    for h in range(mesh.twin.shape[0]):
        t = mesh.twin[h]
        if mesh.faces[h // 3, 0] < 0 or t < h:
            continue
        a, b, c, d = origin(mesh, h), origin(mesh, t), origin(mesh, previous_edge(h)), origin(mesh, previous_edge(t))
        if _cotangent(vertices, c, a, b) + _cotangent(vertices, d, a, b) > -1e-6:
            continue
        if _flip_is_sound(mesh, vertices, normals, a, b, c, d, star):
            _flip(mesh, h, t, a, b, c, d)
            flips += 1
    return flips


@njit(cache=True)
def _cotangent(vertices: np.ndarray, apex: int, a: int, b: int) -> float:
    p, q = vertices[a] - vertices[apex], vertices[b] - vertices[apex]
    sine = np.sqrt(max(_dot(p, p) * _dot(q, q) - _dot(p, q) ** 2, 0.0))
    return _dot(p, q) / max(sine, 1e-12 * np.sqrt(_dot(p, p) * _dot(q, q)), 1e-300)  # vertices may coincide


@njit(cache=True)
def _flip_is_sound(
    mesh: HalfEdges, vertices: np.ndarray, normals: np.ndarray, a: int, b: int, c: int, d: int, star: np.ndarray
) -> bool:
    """Whether the edge a b may become c d: a new edge, and no face turns away."""
    count, border = vertex_star(mesh, c, star)
    for k in range(count):
        if origin(mesh, next_edge(star[k])) == d:
            return False
    if border and origin(mesh, previous_edge(star[count - 1])) == d:
        return False
    before_c, _ = _normal(vertices, a, b, c)
    before_d, _ = _normal(vertices, b, a, d)
    after_a, _ = _normal(vertices, a, d, c)
    after_b, _ = _normal(vertices, d, b, c)
    turn = min(
        min(_dot(before_c, after_a), _dot(before_c, after_b)), min(_dot(before_d, after_a), _dot(before_d, after_b))
    )
    return turn > TURN and _faces_surface(after_a, normals, a, d, c) and _faces_surface(after_b, normals, d, b, c)


@njit(cache=True)
def _flip(mesh: HalfEdges, h: int, t: int, a: int, b: int, c: int, d: int) -> None:
    """Make the faces (a, b, c) of half-edge h and (b, a, d) of its twin t into (a, d, c) and (d, b, c)."""
    bc, ca, ad, db = (
        mesh.twin[next_edge(h)],
        mesh.twin[previous_edge(h)],
        mesh.twin[next_edge(t)],
        mesh.twin[previous_edge(t)],
    )
    f, g = h // 3, t // 3
    mesh.faces[f, 0], mesh.faces[f, 1], mesh.faces[f, 2] = a, d, c
    mesh.faces[g, 0], mesh.faces[g, 1], mesh.faces[g, 2] = d, b, c
    _join(mesh, 3 * f, ad)
    _join(mesh, 3 * f + 1, 3 * g + 2)
    _join(mesh, 3 * f + 2, ca)
    _join(mesh, 3 * g, db)
    _join(mesh, 3 * g + 1, bc)
    mesh.out[a], mesh.out[d], mesh.out[b], mesh.out[c] = 3 * f, 3 * g, 3 * g + 1, 3 * f + 2


@njit(cache=True)
def _join(mesh: HalfEdges, h: int, twin: int) -> None:
    mesh.twin[h] = twin
    if twin >= 0:
        mesh.twin[twin] = h
