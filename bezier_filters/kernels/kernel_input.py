"""Inputs and outputs of the kernels: arrays of a mesh, parameters of a fit, results."""

from typing import NamedTuple

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray, SingleArray
from bezier_filters.meshes.adjacency import Adjacency, Rows
from bezier_filters.meshes.frames import NO_SAFE_COSINE, TangentPlanes, smooth_normals
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.meshes.prepared_mesh import PreparedMesh, prepare_mesh
from bezier_filters.meshes.spatial_order import SpatialOrder
from bezier_filters.meshes.spikes import remove_spikes

# Outcomes of one fit.
FITTED = 0
NO_FRAME = 1  # the vertex has no face, or its face normals cancel out
ILL_POSED = 2  # the points do not determine the polynomial, or do not resolve its curvature
FOLDED_OVER = 3  # the neighbourhood folds over when projected onto the plane
UNTRIED = 4  # no attempt was made yet; the kernel does not return it
OUTCOMES = (FITTED, NO_FRAME, ILL_POSED, FOLDED_OVER, UNTRIED)

# Valence of a vertex that neighbourhoods may extend across. Around the tip of a fan of n faces, each of the n
# neighbourhoods would otherwise have n points.
MAX_VALENCE = 1_000
# width of a neighbourhood, a length; for a smaller one, squares of third derivatives times noise overflow float64
MIN_NEIGHBOURHOOD_WIDTH = 1e-60


class KernelMesh(NamedTuple):
    """Arrays of a mesh for the kernels, in an order that improves memory locality."""

    vertices: FloatArray
    faces: IntArray
    face_ptr: IntArray
    face_indices: IntArray
    ring_ptr: IntArray
    ring_indices: IntArray
    on_boundary: BoolArray
    normals: FloatArray
    safe_cosine: SingleArray
    barriers: BoolArray  # vertices that neighbourhoods do not extend across: see `collect_ring`
    origin: IntArray  # row of each vertex in the results
    x_axes: FloatArray  # (n, 3): given directions of the x axes of local frames; (0, 3) if the points determine them
    # rows of the nearest points, for clouds whose neighbourhoods have a given number of points; else empty
    nearest_ptr: IntArray
    nearest_indices: IntArray

    def mesh_with_adjacency(self) -> PreparedMesh:
        """The mesh and its adjacency."""
        around, neighbours = Rows(self.face_ptr, self.face_indices), Rows(self.ring_ptr, self.ring_indices)
        return PreparedMesh(self.vertices, self.faces, Adjacency(around, neighbours, self.on_boundary))


def kernel_mesh(
    mesh: TriangleMesh,
    adjacency: Adjacency,
    planes: TangentPlanes,
    barriers: BoolArray | None = None,
    ordered: SpatialOrder | None = None,
    nearest: Rows | None = None,
) -> KernelMesh:
    """Collect the arrays for the kernels; without `ordered`, vertices have the order of the results."""
    nearest = Rows(np.empty(0, np.int32), np.empty(0, np.int32)) if nearest is None else nearest
    return KernelMesh(
        mesh.vertices,
        mesh.faces,
        adjacency.faces.indptr,
        adjacency.faces.indices,
        adjacency.vertices.indptr,
        adjacency.vertices.indices,
        adjacency.on_boundary,
        planes.normals,
        planes.safe_cosine,
        hubs(adjacency.vertices.indptr) if barriers is None else barriers | hubs(adjacency.vertices.indptr),
        np.arange(mesh.vertex_count, dtype=np.int32) if ordered is None else ordered.order,
        np.empty((0, 3)),
        nearest.indptr,
        nearest.indices,
    )


def hubs(ring_ptr: IntArray) -> BoolArray:
    """Vertices whose valence exceeds `MAX_VALENCE`, (n,): barriers of neighbourhoods."""
    return np.asarray(np.diff(ring_ptr) > MAX_VALENCE)


def prepare_kernel_mesh(mesh: TriangleMesh, ordered: SpatialOrder | None = None, *, with_barriers: bool) -> KernelMesh:
    """Collect a mesh, its adjacency, its tangent planes and, on request, barriers at sharp edges for the kernels."""
    prepared = prepare_mesh(mesh)
    return kernel_mesh(
        prepared, prepared.adjacency, prepared.planes, prepared.barriers if with_barriers else None, ordered
    )


def use_smoothed_normals(mesh: KernelMesh) -> KernelMesh:
    """Replace the normals by averages over neighbours, for noise that makes single normals useless."""
    normals = smooth_normals(mesh.normals, mesh.ring_ptr, mesh.ring_indices, mesh.barriers)
    return mesh._replace(normals=normals, safe_cosine=np.full(len(normals), NO_SAFE_COSINE, dtype=np.float32))


def use_nearest_points(mesh: KernelMesh) -> KernelMesh:
    """Replace the first ring of every vertex by its nearest points."""
    return mesh._replace(ring_ptr=mesh.nearest_ptr, ring_indices=mesh.nearest_indices)


def recompute_barriers(mesh: KernelMesh) -> KernelMesh:
    """Replace the barriers by the sharp edges of the mesh without isolated spikes."""
    if not len(mesh.faces):
        return mesh
    return mesh._replace(barriers=remove_spikes(mesh.mesh_with_adjacency()).barriers | hubs(mesh.ring_ptr))


def replace_vertices(mesh: KernelMesh, vertices: FloatArray) -> KernelMesh:
    """Replace the vertices and recompute the tangent planes; a point cloud keeps its planes."""
    if not len(mesh.faces):
        return mesh._replace(vertices=vertices)
    planes = mesh.mesh_with_adjacency().move(vertices).planes
    return mesh._replace(vertices=vertices, normals=planes.normals, safe_cosine=planes.safe_cosine)


class KernelFit(NamedTuple):
    """Parameters of a fit: `fallbacks.FitAttempt` as arrays.

    Coefficients are in the order of elimination. For standard errors, those of x, y, x^2, x y and y^2 come last: the
    last corner of the Cholesky factor then determines their covariance.
    """

    rings: int
    radius: float  # of a ball that replaces the rings; 0 for none
    fewest_points: int
    free: int  # number of unpenalised coefficients, which only the points determine
    square: bool
    any_axis: bool  # whether the result is invariant under rotation of the x axis
    mean_plane: bool
    other_plane: bool
    # largest allowed fraction of vertices with flipped normals; if negative, not even a single face may fold over
    max_flipped_fraction: float
    highest_power: int
    exponents: IntArray
    starts: IntArray  # index of s^a t^0 for each a in lexicographic order
    lexicographic: IntArray  # lexicographic index of each coefficient
    moment_starts: IntArray  # the same as `starts` for products of two monomials
    moment_place: IntArray  # index of the moment of each entry of the lower triangle of A^T A
    penalty: FloatArray
    prior: FloatArray  # non-zero entries of the prior precision, per length
    prior_place: IntArray  # their indices in the packed matrix
    prior_degree: IntArray  # their degrees, ascending
    # (5, 5): prior precision, per length, of the coefficients x^4 to y^4 times their prior mean in multiples of that of
    # round surfaces; (0, 5) if the prior mean is 0
    quartic: FloatArray
    quartic_order: IntArray  # indices of these coefficients in the order of elimination
    smallest_pivot: float
    normal_noise: float  # standard deviation of the heights; 0 for no standard errors
    curvature_noise: float
    height_noise: float
    weight_scale: float  # points weigh 1 / (1 + (scale distance^2)^power); 0 for equal weights
    weight_power: int
    rounds: int  # of reweighting by residuals; 0 for none


class VertexResults(NamedTuple):
    """Arrays of a `VertexGeometry` that the kernels write, under the same names."""

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


class PatchTable(NamedTuple):
    """Arrays for the fitted polynomials themselves; row i belongs to vertex i of the results.

    A row of `rows` has the local frame (x, y and z axis), its origin, the middle and the reciprocal half width of the
    parameter square along x and along y, the total degree d, and the coefficients of s^a t^b, for each a from 0 to D,
    b from 0 to D - a. The height over (x, y) is their polynomial of s = (x - middle_x) / half_x, and t likewise.
    Without a fit the frame is zero.
    """

    rows: FloatArray  # (n, PATCH_HEAD + (D + 1)(D + 2) / 2)
    height_std: FloatArray  # (n,): standard errors of the heights at the vertices


PATCH_ORIGIN, PATCH_SQUARE, PATCH_DEGREE, PATCH_HEAD = 9, 12, 16, 17  # first columns of these parts of a row
