"""The smooth surface to which Loop subdivision of a closed mesh tends, with its exact geometry.

It has the shape of the mesh and known normals and curvatures, which no analytic surface offers.
"""

import sys
from pathlib import Path

import numpy as np
import pymeshlab

import bezier_filters as bf
from bezier_filters.surfaces import SampledSurface
from peers import loaded

sys.path.append(str(Path(__file__).parents[1] / "tools"))
from half_edges import HalfEdges, half_edges


def limit_surface(vertices: np.ndarray, faces: np.ndarray, *, subdivisions: int) -> tuple[SampledSurface, np.ndarray]:
    """Subdivide a closed mesh and move its vertices to the limit.

    The limit and its tangents follow from the ring of a vertex (Loop, "Smooth subdivision surfaces
    based on triangles", 1987). At vertices of valence 6 the surface is a quartic box spline, whose
    second derivative along an edge is the second difference over it; elsewhere curvature has no
    finite value.

    Returns
    -------
    surface : SampledSurface
        Curvatures are NaN, and so are the principal directions, where they have no value.
    regular : (n,) bool
        Where they have one.
    """
    meshset = loaded(vertices, faces)
    meshset.meshing_surface_subdivision_loop(iterations=subdivisions, threshold=pymeshlab.PercentageValue(0))
    points = meshset.current_mesh().vertex_matrix()
    fine = meshset.current_mesh().face_matrix().astype(np.int32)
    mesh = half_edges(fine, len(points))
    if (mesh.twin < 0).any():
        raise ValueError("the mesh has borders, expected a closed one")
    valences = bf.vertex_adjacency(bf.triangle_mesh(points, fine)).vertices.lengths

    limit = np.empty_like(points)
    first, second = np.empty_like(points), np.empty_like(points)  # derivatives along x and y, up to their length
    hessians = np.full((len(points), 3, 3), np.nan)  # of the three coordinates: xx, xy, yy
    for valence in np.unique(valences):
        ids = np.flatnonzero(valences == valence)
        ring = points[ordered_rings(mesh, ids, valence)]
        angle = 2.0 * np.pi * np.arange(valence) / valence
        beta = (0.625 - (0.375 + 0.25 * np.cos(angle[1])) ** 2) / valence
        share = 1.0 / (0.375 / beta + valence)
        limit[ids] = (1.0 - valence * share) * points[ids] + share * ring.sum(axis=1)
        # For valence 6 and edges of length 1 in the parameter plane, these are the derivatives.
        first[ids] = 2.0 / valence * np.einsum("k,nki->ni", np.cos(angle), ring)
        second[ids] = 2.0 / valence * np.einsum("k,nki->ni", np.sin(angle), ring)
        if valence == 6:
            along = ring[:, :3] + ring[:, 3:] - 2.0 * points[ids, np.newaxis]  # at 0, 60 and 120 degrees
            hessians[ids, 0] = along[:, 0]
            hessians[ids, 1] = (along[:, 1] - along[:, 2]) / np.sqrt(3.0)
            hessians[ids, 2] = (2.0 * (along[:, 1] + along[:, 2]) - along[:, 0]) / 3.0
    return _surface(limit, fine, first, second, hessians), valences == 6


def ordered_rings(mesh: HalfEdges, ids: np.ndarray, valence: int) -> np.ndarray:
    """Neighbours of inner vertices of one valence, counter-clockwise, shape (len(ids), valence)."""
    origins = mesh.faces.ravel()
    ring = np.empty((len(ids), valence), dtype=np.int64)
    h = mesh.out[ids]
    for k in range(valence):
        ring[:, k] = origins[h - h % 3 + (h + 1) % 3]
        h = mesh.twin[h - h % 3 + (h + 2) % 3]
    return ring


def _surface(
    points: np.ndarray, faces: np.ndarray, first: np.ndarray, second: np.ndarray, hessians: np.ndarray
) -> SampledSurface:
    """Geometry from the derivatives of a parametrisation."""
    normals = np.cross(first, second)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    tangents = np.stack([first, second], axis=1)
    metric = tangents @ tangents.transpose(0, 2, 1)
    bending = -np.einsum("nki,ni->nk", hessians, normals)[:, [0, 1, 1, 2]].reshape(-1, 2, 2)
    # In an orthonormal frame the shape operator is symmetric: metric = L L^T.
    to_frame = np.linalg.inv(np.linalg.cholesky(metric))
    shape = to_frame @ bending @ to_frame.transpose(0, 2, 1)
    regular = np.isfinite(shape).all(axis=(1, 2))
    curvatures, axes = np.full((len(points), 2), np.nan), np.full((len(points), 2, 2), np.nan)
    curvatures[regular], axes[regular] = np.linalg.eigh(shape[regular])
    directions = axes.transpose(0, 2, 1) @ to_frame @ tangents
    return SampledSurface(
        vertices=points,
        faces=faces,
        normals=normals,
        k_min=curvatures[:, 0],
        k_max=curvatures[:, 1],
        direction_min=np.cross(normals, directions[:, 1]),
        direction_max=directions[:, 1],
    )
