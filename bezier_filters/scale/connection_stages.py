"""Which vertices do not belong to a closed part."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from bezier_filters.smoothing.closed_parts import wrongly_joined
from bezier_filters.smoothing.pieces import Arrays, Outcome, Piece


@dataclass(frozen=True)
class OpenVertices:
    """Vertices at borders or without faces, and those with wrongly joined faces."""

    rings: int = 1

    def __call__(self, piece: Piece, inputs: Mapping[str, Arrays]) -> Outcome:
        """Whether each is open, (n,), and the number of those at wrong faces."""
        adjacency = piece.adjacency
        wrong = wrongly_joined(piece.mesh.faces, adjacency)
        is_open = adjacency.on_boundary | (adjacency.vertices.lengths == 0)
        return Outcome(vertices={"open": is_open}, sums={"wrong": wrong.astype(np.float64)})
