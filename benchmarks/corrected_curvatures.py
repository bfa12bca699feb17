"""Interpolated corrected curvature measures, after Lachaud, Romon, Thibert and Coeurjolly: the strongest peer.

CGAL has them since version 6 (`interpolated_corrected_curvatures`), but its Python package does not, so these are the
formulas of the article, with the ball and the weights of faces that CGAL documents.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.differential_geometry import principal_curvatures_of
from bezier_filters.errors import InvalidParameterError
from bezier_filters.meshes.adjacency import vertex_adjacency
from bezier_filters.meshes.frames import tangent_planes
from bezier_filters.meshes.half_edges import face_neighbours
from bezier_filters.meshes.mesh import triangle_mesh

AREA, MEAN, GAUSSIAN, TENSOR = 0, 1, 2, slice(3, 12)  # columns of the measures


class CorrectedCurvatures(NamedTuple):
    """Curvatures of the vertices, in 1/length and 1/length^2, positive where the surface is convex to its normals."""

    mean_curvature: FloatArray  # (n,), H
    gaussian_curvature: FloatArray  # (n,), K
    k_min: FloatArray  # (n,)
    k_max: FloatArray  # (n,)
    direction_min: FloatArray  # (n, 3)
    direction_max: FloatArray  # (n, 3)


def corrected_curvatures(
    vertices: ArrayLike, faces: ArrayLike, radius: float, *, normals: ArrayLike | None = None
) -> CorrectedCurvatures:
    """Curvatures of a mesh from corrected measures of the faces in a ball around every vertex.

    A face with corners x and unit normals u there, which are interpolated linearly over it, has the measures

        mu0 = 1/2 m . (x1 - x0) x (x2 - x0)                                                             area
        mu1 = 1/2 m . ((u2 - u1) x x0 + (u0 - u2) x x1 + (u1 - u0) x x2)                                 mean curvature
        mu2 = 1/2 u0 . u1 x u2                                                                      Gaussian curvature
        mu(X, Y) = 1/2 m . (<Y, u2 - u0> X x (x1 - x0) - <Y, u1 - u0> X x (x2 - x0))                            tensor

    with m the mean of the normals (Lachaud, Romon, Thibert, Coeurjolly, "Interpolated corrected curvature measures for
    polygonal surfaces", Computer Graphics Forum 39, 2020, with unit normals at the corners). Sums over a ball give
    H = mu1 / 2 mu0 and K = mu2 / mu0; the principal curvatures are the eigenvalues of -mu(X, Y) / mu0, made symmetric,
    in the plane across the vertex normal.

    As in CGAL the ball holds the faces that are connected with the vertex through edges of such faces; a face that it
    cuts counts by the share (radius - d_min) / (d_max - d_min), of the distances of its corners and its centre.

    Parameters
    ----------
    vertices : (n, 3) array_like of float
        Coordinates.
    faces : (m, 3) array_like of int
        Triangles, counter-clockwise seen from outside.
    radius : float
        Of the ball, a positive length.
    normals : (n, 3) array_like of float, optional
        Corrected normals; by default the means of the face normals, weighted by area.

    Returns
    -------
    CorrectedCurvatures
        0 at vertices without a face with an area in the ball.

    Raises
    ------
    InvalidMeshError
        If the arrays are not a mesh with finite coordinates.
    InvalidParameterError
        If the radius is not positive.

    Examples
    --------
    >>> from bezier_filters.surfaces import sphere
    >>> ball = sphere(radius=2.0, resolution=20)
    >>> found = corrected_curvatures(ball.vertices, ball.faces, 0.5)
    >>> bool(abs(found.mean_curvature - 0.5).max() < 0.001)
    True
    """
    if not (np.isfinite(radius) and radius > 0.0):
        raise InvalidParameterError(f"radius: got {radius!r}, expected a positive length")
    mesh = triangle_mesh(vertices, faces)
    adjacency = vertex_adjacency(mesh)
    given = tangent_planes(mesh, adjacency).normals if normals is None else np.asarray(normals, dtype=np.float64)
    measures = face_measures(mesh.vertices, mesh.faces, given)
    around = adjacency.faces
    neighbours = face_neighbours(mesh.faces)
    sums = _ball_sums(mesh.vertices, mesh.faces, around.indptr, around.indices, neighbours, measures, float(radius))
    area = sums[:, AREA, np.newaxis]
    per_area = np.divide(sums, area, out=np.zeros_like(sums), where=area != 0.0)
    tensor = -per_area[:, TENSOR].reshape(-1, 3, 3)
    e1, e2 = _tangents(given)

    def entry(a: FloatArray, b: FloatArray) -> FloatArray:
        return np.asarray(np.einsum("ni,nij,nj->n", a, 0.5 * (tensor + tensor.transpose(0, 2, 1)), b))

    principal = principal_curvatures_of(entry(e1, e1), entry(e1, e2), entry(e2, e2), e1, e2)
    return CorrectedCurvatures(0.5 * per_area[:, MEAN], per_area[:, GAUSSIAN], *principal)


def face_measures(vertices: FloatArray, faces: IntArray, normals: FloatArray) -> FloatArray:
    """The measures of faces with normals (n, 3) at the vertices: mu0, mu1, mu2 and the rows of mu(X, Y), (m, 12)."""
    x0, x1, x2 = vertices[faces].transpose(1, 0, 2)
    u0, u1, u2 = normals[faces].transpose(1, 0, 2)
    mean = (u0 + u1 + u2) / 3.0
    a, b = x1 - x0, x2 - x0
    measures = np.empty((len(faces), 12))
    measures[:, AREA] = _dot(mean, np.cross(a, b))
    # the sum does not depend on the origin; at a corner it loses no digits
    measures[:, MEAN] = _dot(mean, np.cross(u0 - u2, a) + np.cross(u1 - u0, b))
    measures[:, GAUSSIAN] = _dot(u0, np.cross(u1, u2))
    # m . X x a = X . a x m
    tensor = np.einsum("ni,nj->nij", np.cross(a, mean), u2 - u0) - np.einsum("ni,nj->nij", np.cross(b, mean), u1 - u0)
    measures[:, TENSOR] = tensor.reshape(-1, 9)
    return 0.5 * measures


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("ij,ij->i", a, b))


def _tangents(normals: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Two unit vectors e1, e2 with e1 x e2 = n for unit normals."""
    axes = np.eye(3)[np.argmin(np.abs(normals), axis=1)]
    e1 = np.cross(normals, axes)
    e1 /= np.maximum(np.linalg.norm(e1, axis=1, keepdims=True), 1e-300)  # zero where there is no normal
    return e1, np.cross(normals, e1)


@njit(cache=True, nogil=True, error_model="numpy")
def _ball_sums(
    vertices: FloatArray,
    faces: IntArray,
    face_ptr: IntArray,
    face_indices: IntArray,
    beside: IntArray,
    measures: FloatArray,
    radius: float,
) -> FloatArray:
    """Sums of measures (m, k) over the balls around all vertices, (n, k)."""
    sums = np.zeros((len(vertices), measures.shape[1]))
    last_vertex = np.full(len(faces), -1, dtype=np.int32)  # whose search came to a face last
    queue = np.empty(len(faces), dtype=np.int32)
    for v in range(len(vertices)):
        length = 0
        for q in range(face_ptr[v], face_ptr[v + 1]):
            queue[length] = face_indices[q]
            last_vertex[face_indices[q]] = v
            length += 1
        first = 0
        while first < length:
            f = queue[first]
            first += 1
            share = _share_in_ball(vertices, faces[f], vertices[v], radius)
            if share == 0.0:
                continue
            for k in range(measures.shape[1]):
                sums[v, k] += share * measures[f, k]
            for k in range(3):
                g = beside[f, k]
                if g >= 0 and last_vertex[g] != v:
                    last_vertex[g] = v
                    queue[length] = g
                    length += 1
    return sums


@njit(cache=True, nogil=True, error_model="numpy")
def _share_in_ball(vertices: FloatArray, face: IntArray, centre: FloatArray, radius: float) -> float:
    """How much of a face counts, by the distances of its corners and its centre."""
    nearest, farthest = np.inf, 0.0
    for corner in range(4):
        square = 0.0
        for k in range(3):
            if corner < 3:
                x = vertices[face[corner], k]
            else:
                x = (vertices[face[0], k] + vertices[face[1], k] + vertices[face[2], k]) / 3.0
            square += (x - centre[k]) ** 2
        nearest, farthest = min(nearest, square), max(farthest, square)
    if farthest <= radius * radius:
        return 1.0
    if nearest >= radius * radius:
        return 0.0
    return (radius - np.sqrt(nearest)) / (np.sqrt(farthest) - np.sqrt(nearest))
