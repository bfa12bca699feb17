"""Which side of every face is outside: faces that are flipped against others, and bodies that are inside out."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.meshes.half_edges import distinct_edges, ends_of_half_edges, paired_half_edges
from bezier_filters.meshes.triangles import area_vectors

FLAT = 1e-9  # of the surface area times the diagonal of the bounding box: a smaller volume tells no outside
MOST_NESTED = 100  # bodies inside out that are looked for in others; of more, the box around each has to do


@dataclass(frozen=True)
class FaceSides:
    """What `face_sides` found; a body is a connected part without a border, whose faces can agree."""

    flipped: BoolArray  # (m,): faces that disagree with most of their part, or with the outside of their body
    inside_out: BoolArray  # (m,): faces of bodies that agree on the wrong side
    inside_out_bodies: int


def face_sides(vertices: FloatArray, faces: IntArray) -> FaceSides:
    """Find out which faces (m, 3) of vertices (n, 3), welded and none of them naming a vertex twice, look inwards.

    Faces are connected across edges of two. A body looks outwards where its volume is positive, unless it is a cavity:
    inside out, and within another body. On one-sided surfaces, and on flat ones, nothing is flipped or inside out.

    >>> from bezier_filters.surfaces import sphere
    >>> ball = sphere(resolution=4)
    >>> face_sides(ball.vertices, ball.faces[:, ::-1]).inside_out_bodies
    1
    """
    part, turned, two_sided = _parts(faces, len(vertices))
    count = int(part.max(initial=-1)) + 1
    sizes = np.bincount(part, minlength=count)
    most = 2 * np.bincount(part, weights=turned, minlength=count) > sizes
    flipped = two_sided[part] & (turned != most[part])
    is_body = two_sided & _closed(faces, part, count, len(vertices))
    corners = vertices[faces] - (vertices.mean(axis=0) if len(vertices) else 0.0)
    volumes = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6.0
    # of the part, if all of its faces looked as most of them do
    volume = np.bincount(part, weights=np.where(flipped, -volumes, volumes), minlength=count)
    area = 0.5 * np.bincount(part, weights=np.linalg.norm(area_vectors(vertices, faces), axis=1), minlength=count)
    low, high = _boxes(vertices, faces, part, count)
    inwards = is_body & (volume < -FLAT * area * np.linalg.norm(high - low, axis=1))
    bodies = np.flatnonzero(inwards)
    for k, body in enumerate(bodies[np.argsort(-sizes[bodies], kind="stable")]):
        around = is_body & (low <= low[body]).all(axis=1) & (high >= high[body]).all(axis=1)
        around[body] = False
        point = vertices[faces[part == body][0, 0]] if around.any() else vertices[0]
        inwards[body] = not any(
            k >= MOST_NESTED or _is_inside(point, vertices, faces[part == other]) for other in np.flatnonzero(around)
        )
    mixed = np.bincount(part, weights=flipped, minlength=count) > 0
    wrong = inwards[part] & mixed[part]
    inside_out = inwards[part] & ~mixed[part]
    return FaceSides(np.where(wrong, ~flipped, flipped), inside_out, int((inwards & ~mixed).sum()))


def _parts(faces: IntArray, n: int) -> tuple[IntArray, BoolArray, BoolArray]:
    """Part of each face (m,), whether it is turned against the first one there (m,), and which parts have two sides.

    Every face is there twice, once for each side; where two faces agree, the same sides are joined, else others.
    """
    m = len(faces)
    first, last = paired_half_edges(faces, n)
    starts, _ = ends_of_half_edges(faces)
    agree = starts[first] != starts[last]
    one, other = first // 3, last // 3
    row = np.concatenate([one, one + m])
    column = np.concatenate([np.where(agree, other, other + m), np.where(agree, other + m, other)])
    graph = coo_array((np.ones(len(row)), (row, column)), shape=(2 * m, 2 * m))
    label = connected_components(graph, directed=False)[1]
    front, back = label[:m], label[m:]
    _, part = np.unique(np.minimum(front, back), return_inverse=True)
    two_sided = np.ones(int(part.max(initial=-1)) + 1, dtype=np.bool_)
    two_sided[part[front == back]] = False
    return part.ravel().astype(np.int32), front > back, two_sided


def _closed(faces: IntArray, part: IntArray, count: int, n: int) -> BoolArray:
    """Which parts have no edge but those of two faces, (count,)."""
    _, edge, of_edge = distinct_edges(faces, n)
    closed = np.ones(count, dtype=np.bool_)
    closed[part[np.flatnonzero(of_edge[edge] != 2) // 3]] = False
    return closed


def _boxes(vertices: FloatArray, faces: IntArray, part: IntArray, count: int) -> tuple[FloatArray, FloatArray]:
    """Lowest and highest coordinates of each part, each (count, 3)."""
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    for k in range(3):
        np.minimum.at(low, part, vertices[faces[:, k]])
        np.maximum.at(high, part, vertices[faces[:, k]])
    return low, high


def _is_inside(point: FloatArray, vertices: FloatArray, faces: IntArray) -> bool:
    """Whether a closed surface goes around a point, by the solid angle of its faces."""
    a, b, c = np.moveaxis(vertices[faces] - point, 1, 0)
    lengths = [np.linalg.norm(side, axis=1) for side in (a, b, c)]
    above = np.einsum("ij,ij->i", a, np.cross(b, c))
    below = lengths[0] * lengths[1] * lengths[2]
    for (u, v), length in zip(((a, b), (b, c), (c, a)), (lengths[2], lengths[0], lengths[1]), strict=True):
        below = below + np.einsum("ij,ij->i", u, v) * length
    return bool(abs(np.arctan2(above, below).sum()) > np.pi)
