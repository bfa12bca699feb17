"""Moves outliers, single vertices far from the surface around them, onto robust fits before a mesh is fitted."""

from dataclasses import replace

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.fitting.fallbacks import MAX_EXTRA_RINGS, FitAttempt, fallback_chain, fit_with_fallbacks
from bezier_filters.fitting.vertex_geometry import VertexGeometry, empty_geometry
from bezier_filters.kernels.kernel_input import KernelMesh, recompute_barriers, replace_vertices
from bezier_filters.meshes.spikes import move_folded_vertices
from bezier_filters.noise.outliers import MIN_STANDING_PART
from bezier_filters.patches.patch_fit import PatchFit
from bezier_filters.sampling.neighbourhood_samples import MAX_FLIPPED_BY_OUTLIERS
from bezier_filters.status import FitStatus

ROBUST_FIT_RINGS = 3  # ring of the robust fit: narrow, and without a model that outliers could mislead
OUTLIER_SIGMAS = 3.5  # local standard deviations of an outlier's residual; false positives hardly move
# Least local standard deviation over the edges around. On exact planes distances are rounding, whose logarithms would
# make the means depend on the order of summation. With a tenth or ten times as much, 388 or 345 vertices of a block
# with impulses at 30 % move in place of 368 of 1,538.
MIN_DEVIATION_PER_EDGE = 1e-6
AVERAGING_PASSES = 2  # means over neighbours of the local standard deviation
EDGE_RINGS = 3  # rings whose faces decide about a sharp edge without spikes
# rings around a vertex that decide where it is moved
OUTLIER_REACH = ROBUST_FIT_RINGS + MAX_EXTRA_RINGS + AVERAGING_PASSES + EDGE_RINGS
# difference of the displacements of neighbours on one sharp edge, over the displacement of the vertex
MAX_EDGE_DIFFERENCE = 0.75
# length of the mean unit vector towards such neighbours, if they lie on both sides
MAX_DIRECTION_MEAN = 0.55
NORMAL_GEOMETRIC_MEAN = np.exp(
    -0.5 * (np.euler_gamma + np.log(2.0))
)  # of the absolute value of a standard normal variable


def move_outliers(mesh: KernelMesh, hidden_barriers: BoolArray | None = None) -> KernelMesh:
    """Move every vertex with a large residual onto its own robust patch.

    The surface is learned from the result: otherwise outliers would count as noise and shape. Neighbourhoods end at the
    sharp edges of the mesh without single spikes, and at `hidden_barriers` (n,), if they are known.
    """
    n = len(mesh.vertices)
    mesh = recompute_barriers(mesh)
    if len(mesh.faces):
        mesh = mesh._replace(vertices=move_folded_vertices(mesh.mesh_with_adjacency()).vertices)
    if hidden_barriers is not None:
        mesh = mesh._replace(barriers=mesh.barriers | hidden_barriers)
    every = np.arange(n, dtype=np.int32)
    own = mesh._replace(origin=every)
    geometry = empty_geometry(n)
    fit_with_fallbacks(own, every, _attempts(), geometry, robust=True)
    moves = geometry.displacements
    distances = np.linalg.norm(moves, axis=1)
    least = MIN_DEVIATION_PER_EDGE * _mean_edges(mesh)
    deviations = _geometric_means(mesh, np.maximum(distances, least), geometry.rings_used > 0)
    is_far = distances > OUTLIER_SIGMAS / NORMAL_GEOMETRIC_MEAN * deviations
    is_far &= ~(mesh.barriers | _is_on_edge(mesh, moves))
    is_far &= _stands_out(mesh, moves)
    return replace_vertices(mesh, np.where(is_far[:, np.newaxis], mesh.vertices + moves, mesh.vertices))


def _stands_out(mesh: KernelMesh, moves: FloatArray) -> BoolArray:
    """Whether most neighbours are on the other side of the middle of each move, (n,)."""
    lengths = np.linalg.norm(moves, axis=1)
    starts = np.repeat(np.arange(len(moves)), np.diff(mesh.ring_ptr))
    heights = np.einsum("ij,ij->i", mesh.vertices[mesh.ring_indices] - mesh.vertices[starts], moves[starts])
    is_beyond = heights > MIN_STANDING_PART * np.square(lengths)[starts]
    result: BoolArray = 2 * np.bincount(starts[is_beyond], minlength=len(moves)) >= np.diff(mesh.ring_ptr)
    return result


def _attempts() -> list[FitAttempt]:
    """Fits that tolerate flipped normals; narrow fallbacks are missing, because they would follow outliers."""
    chain = fallback_chain(ROBUST_FIT_RINGS, PatchFit())
    wide = [one for one in chain if one.status in (FitStatus.OK, FitStatus.WIDER_RING)]
    return [replace(one, mean_plane=True, max_flipped_fraction=MAX_FLIPPED_BY_OUTLIERS) for one in wide]


def _is_on_edge(mesh: KernelMesh, moves: FloatArray) -> BoolArray:
    """Whether neighbours on both sides have similar displacements, (n,): such vertices lie on a sharp edge."""
    n = len(moves)
    starts = np.repeat(np.arange(n), np.diff(mesh.ring_ptr))
    apart = np.linalg.norm(moves[mesh.ring_indices] - moves[starts], axis=1)
    is_similar = apart < MAX_EDGE_DIFFERENCE * np.linalg.norm(moves, axis=1)[starts]
    starts, ends = starts[is_similar], mesh.ring_indices[is_similar]
    ways = mesh.vertices[ends] - mesh.vertices[starts]
    ways /= np.maximum(np.linalg.norm(ways, axis=1, keepdims=True), np.finfo(np.float64).tiny)
    sums = np.column_stack([np.bincount(starts, way, n) for way in ways.T])
    counts = np.bincount(starts, minlength=n)
    result: BoolArray = (counts >= 2) & (np.linalg.norm(sums, axis=1) < MAX_DIRECTION_MEAN * counts)
    return result


def _mean_edges(mesh: KernelMesh) -> FloatArray:
    """Mean length of the edges at every vertex, (n,); 0 without any."""
    counts = np.diff(mesh.ring_ptr)
    starts = np.repeat(np.arange(len(counts)), counts)
    lengths = np.linalg.norm(mesh.vertices[mesh.ring_indices] - mesh.vertices[starts], axis=1)
    result: FloatArray = np.bincount(starts, lengths, len(counts)) / np.maximum(counts, 1)
    return result


def _geometric_means(mesh: KernelMesh, values: FloatArray, is_known: BoolArray) -> FloatArray:
    """Geometric means of the known values (n,) around every vertex, which a few large ones hardly change."""
    n = len(values)
    rows = np.repeat(np.arange(n), np.diff(mesh.ring_ptr))
    logarithms = np.log(np.maximum(values, np.finfo(np.float64).tiny))
    for _ in range(AVERAGING_PASSES):
        sums, counts = (
            own + np.bincount(rows, weights=own[mesh.ring_indices], minlength=n)
            for own in (np.where(is_known, logarithms, 0.0), is_known.astype(np.float64))
        )
        is_known, logarithms = counts > 0.0, sums / np.maximum(counts, 1.0)
    return np.exp(logarithms)


def rebase_displacements(points: FloatArray, mesh: KernelMesh, ids: IntArray, geometry: VertexGeometry) -> None:
    """Make the displacements of vertices `ids` of a mesh without outliers start from the measured points (n, 3)."""
    rows = mesh.origin[ids]
    fitted = geometry.rings_used[rows] > 0
    geometry.displacements[rows[fitted]] += (mesh.vertices - points)[ids[fitted]]
