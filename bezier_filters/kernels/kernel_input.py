"""What the kernels read and write: the arrays of a mesh, how to fit, and the results."""

from typing import NamedTuple

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray, SingleArray
from bezier_filters.meshes.adjacency import Adjacency, vertex_adjacency
from bezier_filters.meshes.frames import UNBOUNDED, TangentPlanes, steady_normals, tangent_planes
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.meshes.sharp_edges import sharp_edge_vertices
from bezier_filters.meshes.spatial_order import SpatialOrder
from bezier_filters.meshes.tips import without_tips

# Outcomes of one fit.
FITTED = 0
NO_FRAME = 1  # the vertex has no face, or its face normals cancel out
ILL_POSED = 2  # too few points, or points that do not determine the polynomial, or hold its curvature
FOLDED = 3  # the neighbourhood folds over when projected onto the plane
OUTCOMES = (FITTED, NO_FRAME, ILL_POSED, FOLDED)

# edges of a vertex beyond which no neighbourhood but its own goes on from it: those of all of its neighbours would have
# all of them, n^2 points around the tip of a fan of n faces
MOST_EDGES = 1_000
# of a neighbourhood, a length: below, the squares of third derivatives, times noise, are too large for a float64
SMALLEST_WIDTH = 1e-60


class KernelMesh(NamedTuple):
    """The arrays of a mesh that the kernels read, in an order of their own."""

    vertices: FloatArray
    faces: IntArray
    face_ptr: IntArray
    face_indices: IntArray
    ring_ptr: IntArray
    ring_indices: IntArray
    normals: FloatArray
    safe_cosine: SingleArray
    stops: BoolArray  # where neighbourhoods end: see `collect_ring`
    origin: IntArray  # row of each vertex in the results
    x_axes: FloatArray  # (n, 3): directions of the x axes of local frames; (0, 3) where these follow from the points


def kernel_mesh(
    mesh: TriangleMesh,
    adjacency: Adjacency,
    planes: TangentPlanes,
    stops: BoolArray | None = None,
    ordered: SpatialOrder | None = None,
) -> KernelMesh:
    """Collect the arrays for the kernels; without `ordered`, vertices are in the order of the results."""
    return KernelMesh(
        mesh.vertices,
        mesh.faces,
        adjacency.faces.indptr,
        adjacency.faces.indices,
        adjacency.vertices.indptr,
        adjacency.vertices.indices,
        planes.normals,
        planes.safe_cosine,
        hubs(adjacency.vertices.indptr) if stops is None else stops | hubs(adjacency.vertices.indptr),
        np.arange(mesh.vertex_count, dtype=np.int32) if ordered is None else ordered.order,
        np.empty((0, 3)),
    )


def hubs(ring_ptr: IntArray) -> BoolArray:
    """Vertices (n,) with so many edges that neighbourhoods end there."""
    return np.asarray(np.diff(ring_ptr) > MOST_EDGES)


def fitted_mesh(
    mesh: TriangleMesh, ordered: SpatialOrder | None = None, adjacency: Adjacency | None = None, *, creases: bool
) -> tuple[KernelMesh, Adjacency]:
    """Neighbours, unless they are known, planes and creases of a mesh, ready for the kernels."""
    adjacency = adjacency or vertex_adjacency(mesh)
    planes = tangent_planes(mesh, adjacency)
    stops = sharp_edge_vertices(mesh, adjacency, planes) if creases else None
    return kernel_mesh(mesh, adjacency, planes, stops, ordered), adjacency


def with_steady_normals(mesh: KernelMesh) -> KernelMesh:
    """A mesh whose frames come from averages of normals, for noise that leaves single ones without a meaning."""
    normals = steady_normals(mesh.normals, mesh.ring_ptr, mesh.ring_indices, mesh.stops)
    return mesh._replace(normals=normals, safe_cosine=np.full(len(normals), UNBOUNDED, dtype=np.float32))


def with_edges_without_tips(mesh: KernelMesh, adjacency: Adjacency) -> KernelMesh:
    """A mesh whose neighbourhoods end at the sharp edges that are there without lone tips."""
    if not len(mesh.faces):
        return mesh
    flat = without_tips(TriangleMesh(mesh.vertices, mesh.faces), adjacency)
    stops = sharp_edge_vertices(flat, adjacency, tangent_planes(flat, adjacency))
    return mesh._replace(stops=stops | hubs(mesh.ring_ptr))


def with_vertices(mesh: KernelMesh, adjacency: Adjacency, vertices: FloatArray) -> KernelMesh:
    """A mesh whose vertices are elsewhere, with the planes that it has there; a cloud of points keeps its planes."""
    if not len(mesh.faces):
        return mesh._replace(vertices=vertices)
    planes = tangent_planes(TriangleMesh(vertices, mesh.faces), adjacency)
    return mesh._replace(vertices=vertices, normals=planes.normals, safe_cosine=planes.safe_cosine)


class KernelFit(NamedTuple):
    """How to fit: `fallbacks.FitAttempt` in arrays.

    Coefficients are in the order of elimination. If there are standard errors, those of x, y, x^2,
    x y and y^2 come last: their covariance then follows from the last corner of the Cholesky factor.
    """

    rings: int
    radius: float  # of a ball that takes the place of the rings; 0 for none
    fewest_points: int
    free: int  # coefficients that only the points can determine
    square: bool
    any_axis: bool  # whether the result is the same for any direction of the x axis
    mean_plane: bool
    other_plane: bool
    most_turned: float  # share of vertices that may turn away; if negative, no face may fold
    highest_power: int
    exponents: IntArray
    starts: IntArray  # of the coefficients of s^a t^b for each a, in lexicographic order,
    lexicographic: IntArray  # and where each coefficient is in that order
    moment_starts: IntArray  # of their products, likewise,
    moment_place: IntArray  # and where each entry of the lower triangle of A^T A is among them
    penalty: FloatArray
    prior: FloatArray  # non-zero entries of the prior, per length,
    prior_place: IntArray  # where they belong in the packed matrix,
    prior_degree: IntArray  # and their degree, ascending
    # (5, 5): prior, per length, of the coefficients of degree 4, x^4 to y^4, times what these are expected to be in
    # multiples of what round surfaces have; (0, 5) where they are expected to be 0,
    quartic: FloatArray
    quartic_order: IntArray  # and where they are in the order of elimination
    smallest_pivot: float
    normal_noise: float  # standard deviation of the heights; 0 for no standard errors
    curvature_noise: float
    weight_scale: float  # points weigh 1 / (1 + (scale distance^2)^power); 0 for equal weights
    weight_power: int
    rounds: int  # of reweighting by residuals; 0 for none


class VertexResults(NamedTuple):
    """Arrays of a `VertexGeometry` that the kernels write, by their names there."""

    normals: FloatArray
    k_min: FloatArray
    k_max: FloatArray
    direction_min: FloatArray
    direction_max: FloatArray
    extremality_min: FloatArray
    extremality_max: FloatArray
    displacements: FloatArray
    residual: FloatArray
    normal_std: FloatArray
    mean_curvature_std: FloatArray
    gaussian_curvature_std: FloatArray
    rings_used: IntArray
