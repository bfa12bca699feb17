"""Umbilics: where the field of principal directions has none, and turns around.

The index of a face is the number of turns of the field along its edges. Between the ends of an edge, directions are
compared after the rotation that takes one normal to the other, as lines, by an angle of at most 90 degrees; the
curvature of the surface inside the face, the area of the spherical triangle of its normals, is added. So indices are
whole multiples of 1/2, and on a closed surface their sum is the Euler characteristic, whatever the noise (Poincare and
Hopf). Faces that share a vertex without a known direction form one umbilic, with the sum of their indices.
"""

from dataclasses import dataclass, field

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.differential_geometry import MIN_CURVATURE_DIFFERENCE, UMBILIC_RATIO
from bezier_filters.fitting.vertex_geometry import VertexGeometry
from bezier_filters.meshes.unit_size import LENGTH
from bezier_filters.patch_surface.surface import Surface
from bezier_filters.surface_lines.coordinate_rounding import include_rounding


@dataclass(frozen=True)
class Umbilic:
    """A place or region where principal directions are not known, and around which they turn.

    Attributes
    ----------
    point : (3,) float64
        Its place on the surface; in a region, where the field that is there has its zeros.
    normal : (3,) float64
        Unit normal of the surface there.
    index : float
        Turns of the principal directions around it, counter-clockwise positive: 1/2 for the generic lemon and
        monstar, -1/2 for the star.
    radius : float
        Radius of a disc of the area of its faces, a length.
    """

    point: FloatArray = field(metadata=LENGTH)
    normal: FloatArray
    index: float
    radius: float = field(metadata=LENGTH)


def find_umbilics(surface: Surface) -> tuple[Umbilic, ...]:
    """Find the umbilics of a surface, the largest index first.

    Regions without known directions that touch the border or a sharp edge have no index, and are no umbilics.

    Examples
    --------
    >>> from bezier_filters import fit_surface
    >>> from bezier_filters.surfaces import ellipsoid
    >>> shape = ellipsoid(semi_axes=(1.0, 0.8, 0.5), resolution=16)
    >>> [umbilic.index for umbilic in find_umbilics(fit_surface(shape.vertices, shape.faces))]
    [0.5, 0.5, 0.5, 0.5]
    """
    faces, geometry = surface.cut.faces, include_rounding(surface).geometry
    indices, zeros = face_indices(faces, geometry)
    clusters, on_border = _clusters(surface, ~has_directions(geometry))
    rows = np.flatnonzero((clusters >= 0) | (indices != 0.0))
    alone = clusters[rows] < 0
    names = clusters[rows].copy()
    names[alone] = clusters.max(initial=-1) + 1 + np.arange(alone.sum())
    names = np.unique(names, return_inverse=True)[1].astype(np.int32)
    count = names.max(initial=-1) + 1
    total = np.bincount(names, indices[rows], count)
    touches = np.bincount(names, on_border[rows], count) > 0.0
    corners = surface.cut.vertices[faces[rows]]
    areas = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    area = np.bincount(names, areas, count)
    counts = indices[rows] * total[names] > 0.0  # faces with the sign of their umbilic
    places = np.einsum("mk,mkd->md", zeros[rows], corners)
    sums = np.column_stack([np.bincount(names, counts * places[:, axis], count) for axis in range(3)])
    kept = np.flatnonzero((np.abs(total) > 0.25) & ~touches)
    if not len(kept):
        return ()
    points = sums[kept] / np.bincount(names, counts, count)[kept, np.newaxis]
    found = surface.query(np.ldexp(points, surface.exponent))
    order = np.argsort(-total[kept], kind="stable")
    order = order[found.normals[order].any(axis=1)]  # faces without an area have no normal, and no tangent plane
    radii = np.ldexp(np.sqrt(area[kept] / np.pi), surface.exponent)
    return tuple(
        Umbilic(found.points[k], found.normals[k], round(2.0 * total[kept[k]]) / 2.0, float(radii[k])) for k in order
    )


def ring_around(umbilic: Umbilic, radius: float) -> FloatArray:
    """A closed polyline (13, 3) around an umbilic on its tangent plane, to mark it."""
    across = np.cross(umbilic.normal, np.eye(3)[np.abs(umbilic.normal).argmin()])
    across /= np.linalg.norm(across)
    angles = np.linspace(0.0, 2.0 * np.pi, 13)[:, np.newaxis]
    other = np.cross(umbilic.normal, across)
    return np.asarray(umbilic.point + radius * (np.cos(angles) * across + np.sin(angles) * other))


def has_directions(geometry: VertexGeometry) -> BoolArray:
    """Vertices (n,) whose principal directions are known: as for lines, see `trace_lines`."""
    difference = geometry.k_max - geometry.k_min
    size = np.maximum(np.abs(geometry.k_min), np.abs(geometry.k_max))
    least = np.maximum(UMBILIC_RATIO * geometry.mean_curvature_std, MIN_CURVATURE_DIFFERENCE * size)
    return np.asarray(difference > least)


def face_indices(faces: IntArray, geometry: VertexGeometry) -> tuple[FloatArray, FloatArray]:
    """Index of each face (m,), and the barycentric coordinates (m, 3) of the zero of its field, or of its middle."""
    normals = geometry.normals[faces]
    lines = geometry.direction_max[faces]
    turns = np.empty((len(faces), 3))
    for k in range(3):
        i, j = k, (k + 1) % 3
        carried = _rotate(lines[:, i], normals[:, i], normals[:, j])
        other, up = lines[:, j], normals[:, j]
        cosine = np.einsum("ij,ij->i", carried, other)
        sine = np.einsum("ij,ij->i", np.cross(carried, other), up)
        angle = 0.5 * np.arctan2(2.0 * sine * cosine, cosine**2 - sine**2)
        turns[:, k] = angle
    a, b, c = normals.swapaxes(0, 1)
    volume = np.einsum("ij,ij->i", a, np.cross(b, c))
    cosines = [np.einsum("ij,ij->i", *pair) for pair in ((a, b), (b, c), (c, a))]
    solid = 2.0 * np.arctan2(volume, 1.0 + sum(cosines))
    indices = np.round((turns.sum(axis=1) + solid) / np.pi) / 2.0
    # the field t (cos 2 phi, sin 2 phi) at the corners as complex numbers, in the frame of the first one
    phases = np.column_stack([np.zeros(len(faces)), turns[:, 0], -turns[:, 2]])
    fields = geometry.geodesic_torsion[faces] * np.exp(2j * phases)
    # coordinates of the zero of a linear field: cross products of the values at the other two corners
    areas = (fields[:, [1, 2, 0]].conj() * fields[:, [2, 0, 1]]).imag
    total = areas.sum(axis=1, keepdims=True)
    zeros = np.divide(areas, total, out=np.full(areas.shape, 1.0 / 3.0), where=total != 0.0)
    inside = (zeros >= 0.0).all(axis=1, keepdims=True)
    return indices, np.where(inside, zeros, 1.0 / 3.0)


def _rotate(vectors: FloatArray, start: FloatArray, end: FloatArray) -> FloatArray:
    """Rotate vectors (m, 3) by the smallest rotations that take unit vectors to others, each (m, 3)."""
    axis = np.cross(start, end)
    cosine = np.einsum("ij,ij->i", start, end)[:, np.newaxis]
    along = np.einsum("ij,ij->i", axis, vectors)[:, np.newaxis] / np.maximum(1.0 + cosine, 1e-12)
    return np.asarray(cosine * vectors + np.cross(axis, vectors) + along * axis)


def _clusters(surface: Surface, unknown: BoolArray) -> tuple[IntArray, BoolArray]:
    """Number of the cluster of each face (m,) with vertices of a mask (n,), or -1; and faces (m,) on the border."""
    faces, n = surface.cut.faces, len(unknown)
    is_unknown = unknown[faces]
    pairs = [(faces[:, k], faces[:, (k + 1) % 3]) for k in range(3)]
    joined = [(i[unknown[i] & unknown[j]], j[unknown[i] & unknown[j]]) for i, j in pairs]
    starts, ends = (np.concatenate([pair[k] for pair in joined]) for k in (0, 1))
    # a face also joins the vertices around it: two of them without directions are an edge, so that edges suffice
    graph = coo_array((np.ones(len(starts), np.bool_), (starts, ends)), shape=(n, n))
    group = connected_components(graph, directed=False)[1]
    first = is_unknown.argmax(axis=1)
    clusters = np.where(is_unknown.any(axis=1), group[faces[np.arange(len(faces)), first]], -1)
    border = np.zeros(n, dtype=np.bool_)
    open_face, corner = np.nonzero(surface.arrays.neighbours < 0)
    border[faces[open_face, corner]] = border[faces[open_face, (corner + 1) % 3]] = True
    return clusters.astype(np.int32), np.asarray((border[faces] & is_unknown).any(axis=1))
