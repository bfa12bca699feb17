"""The patches of the vertices as one of the estimates of a surface, for point clouds.

Low-pass filters have few neighbours at the border of a cloud, which is no polygon; patches are fitted there as anywhere
else. Neighbourhoods end at the sharp edges of another estimate of the surface. In a cloud no vertex is on the edge
itself: patches next to it may see beyond it, so that vertices there keep the other estimate.
"""

from typing import NamedTuple

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.fitting.fallbacks import fit_with_fallbacks
from bezier_filters.fitting.mesh_neighbourhoods import MeshNeighbourhoods
from bezier_filters.fitting.surface_fit import SurfaceFit, choose_fit
from bezier_filters.fitting.vertex_geometry import empty_geometry
from bezier_filters.kernels.kernel_input import KernelMesh, kernel_mesh
from bezier_filters.meshes.frames import NO_SAFE_COSINE, TangentPlanes
from bezier_filters.meshes.half_edges import mesh_edges
from bezier_filters.meshes.prepared_mesh import PreparedMesh
from bezier_filters.meshes.sharp_edges import sharp_edges
from bezier_filters.status import FitStatus
from bezier_filters.surface_model.fit_options import FitOptions

# Rings around sharp edges where patches may see beyond them. With 2 a box with noise of .1 spacings has errors of .075
# spacings two to four spacings from its edges, with 3 of .032, without patches of .019.
EDGE_RINGS = 3


class PatchPlan(NamedTuple):
    """The fit of the patches, and the kind of the estimate at whose sharp edges they end."""

    fit: SurfaceFit
    base: int


class PatchMoves(NamedTuple):
    """Moves of vertices onto their patches, lengths (n, 3), and where there are such patches, (n,)."""

    moves: FloatArray
    has_patch: BoolArray


def patch_arrays(mesh: PreparedMesh, surface: PreparedMesh) -> tuple[KernelMesh, BoolArray]:
    """A noisy mesh with the normals and the sharp edges of an estimate of it, and the vertices (n,) near such edges."""
    edges, rows = mesh_edges(surface), mesh.adjacency.vertices
    is_sharp = sharp_edges(surface, edges, surface.adjacency)
    barriers = np.bincount(edges.vertices[is_sharp].ravel(), minlength=mesh.vertex_count) >= 2
    near = barriers.copy()
    for _ in range(EDGE_RINGS):
        near[rows.of(np.flatnonzero(near).astype(np.int32))] = True
    planes = TangentPlanes(surface.planes.normals, np.full(mesh.vertex_count, NO_SAFE_COSINE, dtype=np.float32))
    return kernel_mesh(mesh, mesh.adjacency, planes, barriers), near


def choose_patch_fit(arrays: KernelMesh, sigma: float) -> SurfaceFit | None:
    """The fit for noise of standard deviation `sigma`, a length; None if the surface cannot be learned."""
    fit, leaf = choose_fit(MeshNeighbourhoods(arrays), FitOptions(noise=sigma, robust=False))
    return None if leaf is None else fit


def move_to_patches(arrays: KernelMesh, near: BoolArray, fit: SurfaceFit) -> PatchMoves:
    """Move all vertices but those near sharp edges, (n,), to their patches."""
    ids: IntArray = np.arange(len(arrays.vertices), dtype=np.int32)
    geometry = empty_geometry(len(ids))
    fit_with_fallbacks(arrays, ids, fit.attempts, geometry)
    return PatchMoves(geometry.displacements, (geometry.status <= FitStatus.WIDER_RING) & ~near)
