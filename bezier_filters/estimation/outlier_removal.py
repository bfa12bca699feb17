"""Takes outliers off a mesh before it is fitted: single vertices that are far off the surface around them."""

from dataclasses import replace

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.estimation.fallbacks import MORE_RINGS, FitAttempt, fallback_chain, fit_with_fallbacks
from bezier_filters.estimation.vertex_geometry import VertexGeometry, empty_geometry
from bezier_filters.kernels.kernel_input import KernelMesh, recompute_barriers, replace_vertices
from bezier_filters.learning.learn import MAY_TURN
from bezier_filters.meshes.adjacency import Adjacency
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.meshes.tips import unfolded
from bezier_filters.patches.fitting import PatchFit
from bezier_filters.status import FitStatus

RINGS = 3  # of the robust fit that tells what is far off: narrow, and without a model to be misled
FAR = 3.5  # standard deviations of the noise around a vertex: those that are moved for nothing hardly move
SPREADS = 2  # how many edges around a vertex its noise is told from
EDGE_RINGS = 3  # within which faces decide about a sharp edge, without tips
OUTLIER_REACH = RINGS + MORE_RINGS + SPREADS + EDGE_RINGS  # how many edges around a vertex decide where it is moved to
ALIKE = 0.75  # of the distance of a vertex from its fit: how much that of a neighbour on the same edge differs
OPPOSITE = 0.55  # length of the mean of the unit vectors towards such neighbours, if there are some on both sides
GEOMETRIC_MEAN = np.exp(-0.5 * (np.euler_gamma + np.log(2.0)))  # of the absolute value of a standard normal variable


def without_outliers(mesh: KernelMesh, adjacency: Adjacency, edges: BoolArray | None = None) -> KernelMesh:
    """The mesh with every vertex that is far off its own robust patch moved onto it.

    A surface is learned from that, as outliers would pass for noise and for shape. Neighbourhoods end at the sharp
    edges that are there without lone tips, and at `edges` (n,), if others are known.
    """
    n = len(mesh.vertices)
    mesh = recompute_barriers(mesh, adjacency)
    if len(mesh.faces):
        mesh = mesh._replace(vertices=unfolded(TriangleMesh(mesh.vertices, mesh.faces), adjacency).vertices)
    if edges is not None:
        mesh = mesh._replace(barriers=mesh.barriers | edges)
    every = np.arange(n, dtype=np.int32)
    own = mesh._replace(origin=every)
    geometry = empty_geometry(n)
    fit_with_fallbacks(own, every, _attempts(), geometry, robust=True)
    moves = geometry.displacements
    distances = np.linalg.norm(moves, axis=1)
    is_far = distances > FAR / GEOMETRIC_MEAN * _geometric_means(mesh, distances, geometry.rings_used > 0)
    is_far &= ~(mesh.barriers | _is_on_edge(mesh, moves))
    return replace_vertices(mesh, adjacency, np.where(is_far[:, np.newaxis], mesh.vertices + moves, mesh.vertices))


def _attempts() -> list[FitAttempt]:
    """Fits whose neighbourhoods outliers may fold; narrow fallbacks would follow them."""
    chain = fallback_chain(RINGS, PatchFit())
    wide = [one for one in chain if one.status in (FitStatus.OK, FitStatus.WIDER_RING)]
    return [replace(one, mean_plane=True, most_turned=MAY_TURN) for one in wide]


def _is_on_edge(mesh: KernelMesh, moves: FloatArray) -> BoolArray:
    """Whether vertices are off their fits as neighbours on both sides are, (n,): on an edge that fits reach across."""
    n = len(moves)
    starts = np.repeat(np.arange(n), np.diff(mesh.ring_ptr))
    apart = np.linalg.norm(moves[mesh.ring_indices] - moves[starts], axis=1)
    alike = apart < ALIKE * np.linalg.norm(moves, axis=1)[starts]
    starts, ends = starts[alike], mesh.ring_indices[alike]
    ways = mesh.vertices[ends] - mesh.vertices[starts]
    ways /= np.maximum(np.linalg.norm(ways, axis=1, keepdims=True), np.finfo(np.float64).tiny)
    sums = np.column_stack([np.bincount(starts, way, n) for way in ways.T])
    counts = np.bincount(starts, minlength=n)
    result: BoolArray = (counts >= 2) & (np.linalg.norm(sums, axis=1) < OPPOSITE * counts)
    return result


def _geometric_means(mesh: KernelMesh, values: FloatArray, is_known: BoolArray) -> FloatArray:
    """Of the values (n,) that are known around every vertex: few large ones among them do not matter much."""
    n = len(values)
    rows = np.repeat(np.arange(n), np.diff(mesh.ring_ptr))
    logarithms = np.log(np.maximum(values, np.finfo(np.float64).tiny))
    for _ in range(SPREADS):
        sums, counts = (
            own + np.bincount(rows, weights=own[mesh.ring_indices], minlength=n)
            for own in (np.where(is_known, logarithms, 0.0), is_known.astype(np.float64))
        )
        is_known, logarithms = counts > 0.0, sums / np.maximum(counts, 1.0)
    return np.exp(logarithms)


def measure_from(points: FloatArray, mesh: KernelMesh, ids: IntArray, geometry: VertexGeometry) -> None:
    """Let displacements of vertices `ids` of a cleaned mesh start from the points (n, 3) where they were measured."""
    rows = mesh.origin[ids]
    fitted = geometry.rings_used[rows] > 0
    geometry.displacements[rows[fitted]] += (mesh.vertices - points)[ids[fitted]]
