"""What has to be known of a mesh before anything is fitted to it."""

from bezier_filters.kernels.kernel_input import KernelMesh, kernel_mesh
from bezier_filters.meshes.adjacency import Adjacency, vertex_adjacency
from bezier_filters.meshes.dihedral_angles import sharp_edge_vertices
from bezier_filters.meshes.frames import tangent_planes
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.meshes.spatial_order import SpatialOrder


def fitted_mesh(
    mesh: TriangleMesh,
    ordered: SpatialOrder | None = None,
    adjacency: Adjacency | None = None,
    *,
    creases: bool,
    threads: int = 1,
) -> tuple[KernelMesh, Adjacency]:
    """Neighbours, unless they are known, planes and creases of a mesh, ready for the kernels."""
    adjacency = adjacency or vertex_adjacency(mesh, threads=threads)
    planes = tangent_planes(mesh, adjacency, threads=threads)
    stops = sharp_edge_vertices(mesh, adjacency, planes, threads=threads) if creases else None
    return kernel_mesh(mesh, adjacency, planes, stops, ordered), adjacency
