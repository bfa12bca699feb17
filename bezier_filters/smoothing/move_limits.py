"""Limits of the moves of vertices: a multiple of the noise, and none in components of few vertices."""

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from bezier_filters.arrays import BoolArray, FloatArray
from bezier_filters.sampling.mesh_parts import MeshPart

# Largest move of a vertex in standard deviations of its noise: of normal noise one in two millions is farther, so it is
# shape. With 2.5 noise on a tenth of a sphere leaves .0250 edges instead of .0234, with 10 as much.
MAX_MOVE_SIGMAS = 5.0
# Vertices of a component below which the gain by smoothing, 1 +- sqrt(2) times the variance of the noise per vertex, is
# less than three standard errors.
MIN_COMPONENT_VERTICES = 18


def limit_moves(vertices: FloatArray, points: FloatArray, most: FloatArray) -> FloatArray:
    """Points (n, 3) no farther from the vertices than the lengths `most` (n,), in the same directions."""
    moves = points - vertices
    lengths = np.linalg.norm(moves, axis=1)
    too_far = lengths > most
    if not too_far.any():
        return points
    result = points.copy()
    result[too_far] = vertices[too_far] + (most[too_far] / lengths[too_far])[:, np.newaxis] * moves[too_far]
    return result


def small_component_mask(part: MeshPart) -> BoolArray:
    """Vertices of components with too few vertices to distinguish noise from shape, (n,)."""
    rows, n = part.mesh.adjacency.vertices, part.mesh.vertex_count
    graph = csr_array((np.ones(len(rows.indices), np.int8), rows.indices, rows.indptr), shape=(n, n))
    labels = connected_components(graph, directed=False)[1]
    sizes = np.bincount(labels)
    is_small = sizes < MIN_COMPONENT_VERTICES
    is_small[labels[part.cut]] = False
    return np.asarray(is_small[labels])
