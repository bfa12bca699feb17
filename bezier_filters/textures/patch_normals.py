"""Normals of the fitted surface inside the faces of a mesh, and the tangent spaces in which normal maps hold them.

The patch at a vertex i has the normal n_i and the shape operator S_i, so that to first order its normal at a point p is
n_i + S_i (p - p_i). Interpolated vertex normals and interpolated normals of these patches have errors of second order
in the size of the faces, with opposite signs: with barycentric weights w_i their mean,

    n(p) = sum_i w_i (n_i + S_i (p - p_i) / 2) = sum_i w_i n_i + sum_{i<j} w_i w_j (S_i - S_j) (p_j - p_i) / 2,

has an error of third order. Along an edge it depends on the two vertices there alone, so it is continuous.
"""

from dataclasses import dataclass

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray, unique_rows
from bezier_filters.fitting.vertex_geometry import VertexGeometry
from bezier_filters.meshes.prepared_mesh import PreparedMesh
from bezier_filters.meshes.triangles import area_vectors
from bezier_filters.status import FitStatus
from bezier_filters.textures.texels import area_determinants

CORNER_CYCLES = ((0, 1, 2), (1, 2, 0), (2, 0, 1))  # each corner of a face with the next two
MIN_DETERMINANT = 1e-6  # of the axes of a tangent space, above which they are independent


@dataclass(frozen=True)
class PatchNormals:
    """Quadratic normals of the faces."""

    corners: FloatArray  # (m, 3, 3): unit normals at the corners
    edges: FloatArray  # (m, 3, 3): (S_i - S_j) (p_j - p_i) / 2 from each corner i to the next one, j
    has_patch: BoolArray  # (m,): whether a corner of the face has a patch that describes it

    def evaluate(self, faces: IntArray, weights: FloatArray) -> FloatArray:
        """Unit normals (k, 3) at points of faces (k,) with barycentric coordinates (k, 3)."""
        products = weights * weights[:, [1, 2, 0]]
        found = np.einsum("kc,kcj->kj", weights, self.corners[faces])
        found += np.einsum("kc,kcj->kj", products, self.edges[faces])
        return unit_vectors(found)


def find_patch_normals(mesh: PreparedMesh, geometry: VertexGeometry) -> PatchNormals:
    """Normals of the fitted surface on all faces.

    The patch of a vertex on a sharp edge lies between its two sides, and describes neither. There, and where a vertex
    has no patch, the normal of a corner is that of the patches at the other corners of the face; a face without any
    has its own normal.
    """
    faces, points = mesh.faces, mesh.vertices[mesh.faces]
    is_usable = (geometry.status <= FitStatus.NORMAL_ONLY) & ~are_on_sharp_edges(mesh, geometry)
    normals, own = geometry.normals[faces], unit_vectors(area_vectors(mesh.vertices, faces))
    usable = is_usable[faces] & (np.einsum("fcj,fj->fc", normals, own) > 0.0)

    def bend(corner: int, vectors: FloatArray) -> FloatArray:
        """Change of the normal of the patch at a corner along vectors (m, 3): the shape operator."""
        at = faces[:, corner]
        changes = np.zeros_like(vectors)
        for curvature, direction in (
            (geometry.k_min[at], geometry.direction_min[at]),
            (geometry.k_max[at], geometry.direction_max[at]),
        ):
            changes += (curvature * np.einsum("fj,fj->f", direction, vectors))[:, np.newaxis] * direction
        return changes

    corners, edges = np.empty_like(points), np.empty_like(points)
    for i, j, k in CORNER_CYCLES:
        along = points[:, j] - points[:, i]
        both = usable[:, i] & usable[:, j]
        edges[:, i] = np.where(both[:, np.newaxis], 0.5 * (bend(i, along) - bend(j, along)), 0.0)
        others = sum(
            usable[:, other, np.newaxis] * (normals[:, other] + bend(other, points[:, i] - points[:, other]))
            for other in (j, k)
        )
        continued = np.where(usable.any(axis=1, keepdims=True), others, own)
        corners[:, i] = unit_vectors(np.where(usable[:, i, np.newaxis], normals[:, i], continued))
    return PatchNormals(corners, edges, usable.any(axis=1))


def are_on_sharp_edges(mesh: PreparedMesh, geometry: VertexGeometry) -> BoolArray:
    """Whether vertices (n,) are on sharp edges, those of the denoised surface where noise may hide or make them."""
    smooth = mesh if geometry.noise_free is None else mesh.move(geometry.noise_free)
    return smooth.barriers


def mean_face_normals(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Vertex normals (n, 3) as MeshLab and Blender compute them: means of face normals, weighted by angle."""
    points, own, sums = vertices[faces], unit_vectors(area_vectors(vertices, faces)), np.zeros_like(vertices)
    for i, j, k in CORNER_CYCLES:
        angle = _angles(unit_vectors(points[:, j] - points[:, i]), unit_vectors(points[:, k] - points[:, i]))
        np.add.at(sums, faces[:, i], angle[:, np.newaxis] * own)
    return unit_vectors(sums)


def _angles(a: FloatArray, b: FloatArray) -> FloatArray:
    """Angles between unit vectors (k, 3) in radians, (k,)."""
    return np.asarray(np.arccos(np.clip(np.einsum("kj,kj->k", a, b), -1.0, 1.0)))


@dataclass(frozen=True)
class TangentSpaces:
    """The axes in which a tangent-space normal map holds normals, at the corners of the faces."""

    normals: FloatArray  # (m, 3, 3): unit shading normals
    tangents: FloatArray  # (m, 3, 3): unit vectors along which u grows
    signs: FloatArray  # (m,): -1 where the texture is mirrored, else 1

    def encode(self, faces: IntArray, weights: FloatArray, normals: FloatArray) -> FloatArray:
        """Unit components (k, 3) of normals (k, 3) at points of faces (k,) with barycentric coordinates (k, 3).

        As in MikkTSpace, axes are interpolated and not normalised, and the bitangent is computed at the point.
        """
        normal = np.einsum("kc,kcj->kj", weights, self.normals[faces])
        tangent = np.einsum("kc,kcj->kj", weights, self.tangents[faces])
        bitangent = self.signs[faces, np.newaxis] * np.cross(normal, tangent)
        pairs = ((bitangent, normal), (normal, tangent), (tangent, bitangent))
        crosses = [np.cross(a, b) for a, b in pairs]
        determinant = np.einsum("kj,kj->k", tangent, crosses[0])
        components = np.column_stack([np.einsum("kj,kj->k", normals, cross) for cross in crosses])
        has_axes = np.abs(determinant) > MIN_DETERMINANT
        safe = np.where(has_axes, determinant, 1.0)
        found = unit_vectors(components / safe[:, np.newaxis])
        return np.asarray(np.where(has_axes[:, np.newaxis], found, (0.0, 0.0, 1.0)))


def tangent_spaces(
    vertices: FloatArray, faces: IntArray, coordinates: FloatArray, normals: FloatArray
) -> TangentSpaces:
    """Tangent spaces as MikkTSpace computes them, given texture coordinates (m, 3, 2) and vertex normals (n, 3).

    Tangents of faces are projected to the plane across the vertex normal and averaged, weighted by angle, over the
    corners with the same vertex, texture coordinates and orientation of the texture.
    """
    points, of_corners = vertices[faces], normals[faces]
    a, b = (points[:, k] - points[:, 0] for k in (1, 2))
    v1, v2 = (coordinates[:, k, 1] - coordinates[:, 0, 1] for k in (1, 2))
    signs = np.where(area_determinants(coordinates) < 0.0, -1.0, 1.0)
    along_u = signs[:, np.newaxis] * (a * v2[:, np.newaxis] - b * v1[:, np.newaxis])
    weighted = np.empty_like(points)
    for i, j, k in CORNER_CYCLES:
        across = of_corners[:, i]
        next_side, last_side, tangent = (
            unit_vectors(vectors - np.einsum("fj,fj->f", vectors, across)[:, np.newaxis] * across)
            for vectors in (points[:, j] - points[:, i], points[:, k] - points[:, i], along_u)
        )
        weighted[:, i] = _angles(next_side, last_side)[:, np.newaxis] * tangent
    keys = np.column_stack([faces.ravel(), coordinates.reshape(-1, 2), np.repeat(signs, 3)])
    distinct, place = unique_rows(keys)
    sums = np.zeros((len(distinct), 3))
    np.add.at(sums, place, weighted.reshape(-1, 3))
    return TangentSpaces(of_corners, unit_vectors(sums)[place].reshape(points.shape), signs)


def unit_vectors(vectors: FloatArray) -> FloatArray:
    """Vectors (k, 3) at unit length; zero where they have none."""
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(np.divide(vectors, lengths, out=np.zeros_like(vectors), where=lengths > 0.0))
