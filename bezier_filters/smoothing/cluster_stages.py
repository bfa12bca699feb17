"""What is computed on the clusters of a mesh, piece by piece."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.runtime.lean import lean_njit
from bezier_filters.smoothing.pieces import Arrays, Domain, Outcome, Piece

MEMBERS = 2
"""Rings around the center of a cluster that its vertices lie within."""


@dataclass(frozen=True)
class Pace:
    """How long the edges are, and how long between clusters."""

    rings: int = 7
    """Those that the centers of gravity of neighbouring clusters depend on."""

    def __call__(self, piece: Piece, inputs: Mapping[str, Arrays]) -> Outcome:
        """Sums of the squares, of every edge from both its ends."""
        rows = piece.adjacency.vertices
        squares = np.zeros(piece.mesh.vertex_count)
        _add_squares(rows.indptr, rows.indices, piece.mesh.vertices, squares)
        across = piece.clusters.squared_jumps(piece.mesh)
        return Outcome(sums={"edges": squares}, cluster_sums={"across": across})


def pace_of(domain: Domain) -> float:
    """Time on clusters per time on the mesh."""
    sums = domain.run(Pace()).sums
    return float(sums["edges"][0] / sums["across"][0]) if sums["across"][0] > 0.0 else 1.0


@lean_njit()
def _add_squares(ptr: IntArray, indices: IntArray, vertices: FloatArray, sums: FloatArray) -> None:
    """Write the sum of the squared lengths of the edges at every vertex."""
    for i in range(len(vertices)):
        for q in range(ptr[i], ptr[i + 1]):
            j = indices[q]
            x, y, z = vertices[j, 0] - vertices[i, 0], vertices[j, 1] - vertices[i, 1], vertices[j, 2] - vertices[i, 2]
            sums[i] += x * x + y * y + z * z
