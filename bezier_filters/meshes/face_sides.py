"""Which side of every face is outside: faces that are flipped against others, and bodies that are inside out."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.meshes.half_edges import distinct_edges, ends_of_half_edges, half_edge_pairs
from bezier_filters.meshes.triangles import area_vectors

# least volume, over the surface area times the diagonal of the bounding box, whose sign determines the outside
MIN_RELATIVE_VOLUME = 1e-9
MAX_NESTED_BODIES = 100  # inside-out bodies tested for being cavities by solid angles; the others by bounding boxes


@dataclass(frozen=True)
class FaceSides:
    """Result of `face_sides`; a body is a component without a border that can be oriented."""

    flipped: BoolArray  # (m,): faces against most of their component, or against the outside of their body
    inside_out: BoolArray  # (m,): faces of bodies that are oriented inwards as a whole
    inside_out_bodies: int


def face_sides(vertices: FloatArray, faces: IntArray) -> FaceSides:
    """Find the faces (m, 3) of welded vertices (n, 3) that point inwards; no face may repeat a vertex.

    Faces are connected across edges of two faces. A body is oriented outwards if its volume is positive, or if it is
    a cavity: inside out, within another body. On one-sided and on flat surfaces, nothing is flipped or inside out.

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
    is_body = two_sided & _are_closed(faces, part, count, len(vertices))
    corners = vertices[faces] - (vertices.mean(axis=0) if len(vertices) else 0.0)
    volumes = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6.0
    # volume of the component after its flipped faces are turned
    volume = np.bincount(part, weights=np.where(flipped, -volumes, volumes), minlength=count)
    area = 0.5 * np.bincount(part, weights=np.linalg.norm(area_vectors(vertices, faces), axis=1), minlength=count)
    low, high = _boxes(vertices, faces, part, count)
    inwards = is_body & (volume < -MIN_RELATIVE_VOLUME * area * np.linalg.norm(high - low, axis=1))
    bodies = np.flatnonzero(inwards)
    for k, body in enumerate(bodies[np.argsort(-sizes[bodies], kind="stable")]):
        around = is_body & (low <= low[body]).all(axis=1) & (high >= high[body]).all(axis=1)
        around[body] = False
        point = vertices[faces[part == body][0, 0]] if around.any() else vertices[0]
        inwards[body] = not any(
            k >= MAX_NESTED_BODIES or _is_inside(point, vertices, faces[part == other])
            for other in np.flatnonzero(around)
        )
    mixed = np.bincount(part, weights=flipped, minlength=count) > 0
    wrong = inwards[part] & mixed[part]
    inside_out = inwards[part] & ~mixed[part]
    return FaceSides(np.where(wrong, ~flipped, flipped), inside_out, int((inwards & ~mixed).sum()))


def _parts(faces: IntArray, n: int) -> tuple[IntArray, BoolArray, BoolArray]:
    """Component of each face (m,), whether it is turned against the first one (m,), and two-sided components.

    The graph has two nodes per face, one for each side. Equal sides of faces that agree are joined, else opposite ones.
    """
    m = len(faces)
    first, last = half_edge_pairs(faces, n)
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


def _are_closed(faces: IntArray, part: IntArray, count: int, n: int) -> BoolArray:
    """Which components have two faces at every edge, (count,)."""
    _, edge, of_edge = distinct_edges(faces, n)
    closed = np.ones(count, dtype=np.bool_)
    closed[part[np.flatnonzero(of_edge[edge] != 2) // 3]] = False
    return closed


def _boxes(vertices: FloatArray, faces: IntArray, part: IntArray, count: int) -> tuple[FloatArray, FloatArray]:
    """Lowest and highest coordinates of each component, each (count, 3)."""
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    for k in range(3):
        np.minimum.at(low, part, vertices[faces[:, k]])
        np.maximum.at(high, part, vertices[faces[:, k]])
    return low, high


def _is_inside(point: FloatArray, vertices: FloatArray, faces: IntArray) -> bool:
    """Whether a closed surface encloses a point, by the solid angle of its faces."""
    a, b, c = np.moveaxis(vertices[faces] - point, 1, 0)
    lengths = [np.linalg.norm(side, axis=1) for side in (a, b, c)]
    above = np.einsum("ij,ij->i", a, np.cross(b, c))
    below = lengths[0] * lengths[1] * lengths[2]
    for (u, v), length in zip(((a, b), (b, c), (c, a)), (lengths[2], lengths[0], lengths[1]), strict=True):
        below = below + np.einsum("ij,ij->i", u, v) * length
    return bool(abs(np.arctan2(above, below).sum()) > np.pi)
