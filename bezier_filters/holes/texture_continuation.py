"""Texture coordinates of the faces that fill holes.

Where the texture is continuous along the whole rim of a fill, its coordinates are continued harmonically, as colours
are. Elsewhere each new face shows the texture of an old face next to it: at seams, where a fill joins several rims,
and where the texture inside the hole belongs to other faces, as in atlases with small charts inside large ones.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.holes.polyharmonic_fairing import polyharmonic_continuation
from bezier_filters.meshes.half_edges import face_neighbours
from bezier_filters.meshes.self_intersections import faces_in_boxes

SEAM_TOLERANCE = 1e-5  # relative difference of texture coordinates at a vertex above which it is on a seam
MAX_COVERED = 0.1  # share of a fill on texture that old faces show, beyond the share of overlaps around the fill
MAX_PROBES = 64  # new faces of a fill, and old faces around it, for which that is determined


@dataclass(frozen=True)
class Texture:
    """Texture of some faces."""

    coordinates: FloatArray  # (m, 3, 2): at their corners
    images: IntArray  # (m,): number of the image that each face shows


class _Fill(NamedTuple):
    """Harmonic texture of a fill."""

    rows: IntArray  # (k,): its new faces
    coordinates: FloatArray  # (k, 3, 2)
    image: int


def continue_texture(
    vertices: FloatArray, old_faces: IntArray, new_faces: IntArray, like_face: IntArray, texture: Texture
) -> Texture:
    """Texture of the new faces (f, 3), given that of the old ones (m, 3), with which they share vertices.

    Each new face has an old one next to it, `like_face` (f,).
    """
    adjacent = wedge_coordinates(vertices[new_faces], vertices[old_faces[like_face]], texture.coordinates[like_face])
    found = Texture(adjacent, texture.images[like_face])
    is_old = np.zeros(len(vertices), dtype=np.bool_)
    is_old[old_faces] = True
    rim = np.unique(new_faces[is_old[new_faces]])
    values, is_seam = _rim_values(rim, old_faces, texture)
    continued = list[_Fill]()
    for rows in _fill_rows(new_faces):
        own, local = np.unique(new_faces[rows], return_inverse=True)
        order = np.argsort(~is_old[own], kind="stable")  # the rim first
        faces = np.argsort(order)[local].reshape(-1, 3).astype(np.int32, copy=False)
        known = np.searchsorted(rim, own[is_old[own]])
        images = values[known, 2]
        if is_seam[known].any() or (images != images[0]).any() or not _has_one_rim(faces):
            continue
        result = polyharmonic_continuation(vertices[own[order]], faces, values[known, :2])
        if np.isfinite(result).all():
            continued.append(_Fill(rows, result[faces], int(images[0])))
    is_shown = _find_shown_elsewhere(continued, like_face, texture)
    for fill in (fill for fill, shown in zip(continued, is_shown, strict=True) if not shown):
        found.coordinates[fill.rows], found.images[fill.rows] = fill.coordinates, fill.image
    return found


def _fill_rows(faces: IntArray) -> list[IntArray]:
    """Rows of the faces of each fill: components that are connected by edges."""
    neighbours = face_neighbours(faces)
    row, corner = np.nonzero(neighbours >= 0)
    graph = coo_array((np.ones(len(row)), (row, neighbours[row, corner])), shape=(len(faces), len(faces)))
    fill = connected_components(graph, directed=False)[1]
    order = np.argsort(fill, kind="stable").astype(np.int32)
    return np.split(order, np.flatnonzero(np.diff(fill[order])) + 1)


def _has_one_rim(faces: IntArray) -> bool:
    """Whether the border of a fill is connected; a fill with islands has several rims."""
    row, corner = np.nonzero(face_neighbours(faces) < 0)
    starts, ends = faces[row, corner], faces[row, (corner + 1) % 3]
    n = int(faces.max()) + 1
    graph = coo_array((np.ones(len(starts)), (starts, ends)), shape=(n, n))
    part = connected_components(graph, directed=False)[1]
    return bool((part[starts] == part[starts[0]]).all())


def _rim_values(rim: IntArray, faces: IntArray, texture: Texture) -> tuple[FloatArray, BoolArray]:
    """Texture coordinates and image (r, 3) at vertices of rims, in ascending order, and whether there is a seam."""
    place = np.minimum(np.searchsorted(rim, faces), len(rim) - 1)
    row, corner = np.nonzero(rim[place] == faces)
    place = place[row, corner]
    found = np.column_stack([texture.coordinates[row, corner], texture.images[row]])
    low, high = np.full((len(rim), 3), np.inf), np.full((len(rim), 3), -np.inf)
    np.minimum.at(low, place, found)
    np.maximum.at(high, place, found)
    tolerance = SEAM_TOLERANCE * np.maximum(1.0, np.abs(low))
    return 0.5 * (low + high), np.asarray((high - low > tolerance).any(axis=1))


def _find_shown_elsewhere(fills: list[_Fill], like_face: IntArray, texture: Texture) -> BoolArray:
    """Whether old faces show the part of the texture on which a fill lies, (k,).

    Where the old faces around a fill overlap others in the texture just as much, as with repeated patterns and the two
    halves of symmetric shapes, the texture is shared on purpose.
    """
    probes, images = list[FloatArray](), list[IntArray]()
    for fill in fills:
        around = np.unique(like_face[fill.rows])
        for corners in (fill.coordinates, texture.coordinates[around]):
            probes.append(corners[_sample(len(corners))].mean(axis=1))
            images.append(np.full(len(probes[-1]), fill.image, dtype=np.int32))
    if not probes:
        return np.zeros(0, dtype=np.bool_)
    counts = _count_covering(np.concatenate(probes), np.concatenate(images), texture)
    parts = np.split(counts, np.cumsum([len(each) for each in probes])[:-1])
    return np.array(
        [
            (inside > 0).mean() > (around > 1).mean() + MAX_COVERED  # a face covers its own centre
            for inside, around in zip(parts[::2], parts[1::2], strict=True)
        ]
    )


def _sample(count: int) -> IntArray:
    """At most `MAX_PROBES` of some rows, equally spaced."""
    return np.linspace(0, count - 1, min(count, MAX_PROBES)).astype(np.int32)


def _count_covering(points: FloatArray, images: IntArray, texture: Texture) -> IntArray:
    """Number of faces that cover points (k, 2) in the plane of an image, (k,)."""
    corners = np.pad(texture.coordinates, ((0, 0), (0, 0), (0, 1)))  # in space, where boxes are
    boxes = np.pad(points, ((0, 0), (0, 1)))
    near = faces_in_boxes(
        corners.reshape(-1, 3), np.arange(corners.size // 3, dtype=np.int32).reshape(-1, 3), boxes, boxes
    )
    point = np.repeat(np.arange(len(points)), np.diff(near.indptr))
    triangles, place = texture.coordinates[near.indices], points[point]
    sides = np.roll(triangles, -1, axis=1) - triangles
    offsets = place[:, np.newaxis] - triangles
    turns = sides[..., 0] * offsets[..., 1] - sides[..., 1] * offsets[..., 0]
    covers = ((turns > 0.0).all(axis=1) | (turns < 0.0).all(axis=1)) & (texture.images[near.indices] == images[point])
    return np.bincount(point[covers], minlength=len(points)).astype(np.int32)


def wedge_coordinates(corners: FloatArray, triangles: FloatArray, coordinates: FloatArray) -> FloatArray:
    """Texture coordinates (f, 3, 2) for corners (f, 3, 3) of new faces: those of the nearest points on old triangles.

    The triangles (f, 3, 3), with texture coordinates (f, 3, 2), are old faces next to the new ones. New faces thus show
    only parts of the texture that old faces show, and the texture is continuous across common edges.

    >>> old = np.array([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]])
    >>> new = np.array([[[1.0, 0, 0], [2, 2, 0], [0, 1, 0]]])
    >>> wedge_coordinates(new, old, old[..., :2])[0].tolist()
    [[1.0, 0.0], [0.5, 0.5], [0.0, 1.0]]
    """
    a, b, c = (triangles[:, np.newaxis, k] for k in range(3))
    normal = np.cross(b - a, c - a)
    squared = np.maximum(np.einsum("fkj,fkj->fk", normal, normal), 1e-300)
    weights = [np.einsum("fkj,fkj->fk", np.cross(q - p, corners - p), normal) / squared for p, q in ((b, c), (c, a))]
    barycentric = np.stack([*weights, 1.0 - weights[0] - weights[1]], axis=2)
    barycentric = np.maximum(barycentric, 0.0)  # 0 beyond an edge; the sum is 1 or more
    barycentric /= barycentric.sum(axis=2, keepdims=True)
    return np.asarray(barycentric @ coordinates, dtype=np.float64)
