"""How large a mesh is, and how long its edges are."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.runtime.lean import lean_njit
from bezier_filters.runtime.parallel import RangeTask, run_in_chunks
from bezier_filters.smoothing.pieces import Arrays, Domain, Outcome, Piece


@dataclass(frozen=True)
class Extent:
    """Where a mesh is, and its scale.

    Attributes
    ----------
    mean_edge : float
        Mean length of the edges; 0 if there are none.
    far_center : (3,) float64
        Mean of the vertices, if they are so far from the origin that digits would be lost; zeros if not.
    """

    mean_edge: float
    far_center: FloatArray


@dataclass(frozen=True)
class Lengths:
    """Lengths of the edges, from both their ends, and coordinates."""

    rings: int = 1

    def __call__(self, piece: Piece, inputs: Mapping[str, Arrays]) -> Outcome:
        """Their sums, the number of the edges, and bounds of the coordinates."""
        vertices, rows = piece.mesh.vertices, piece.adjacency.vertices
        lengths = np.zeros(len(vertices))

        def make_task() -> RangeTask:
            return lambda start, stop: _sum_lengths(vertices, rows.indptr, rows.indices, start, stop, lengths)

        run_in_chunks(make_task, len(vertices), threads=piece.threads)
        columns = {f"high {k}": vertices[:, k] for k in range(3)} | {f"low {k}": -vertices[:, k] for k in range(3)}
        return Outcome(
            sums={"lengths": lengths, "edges": rows.lengths.astype(np.float64), "vertices": vertices}, largest=columns
        )


def extent_of(domain: Domain) -> Extent:
    """Measure a mesh.

    Examples
    --------
    >>> from bezier_filters.meshes.adjacency import vertex_adjacency
    >>> from bezier_filters.meshes.mesh import triangle_mesh
    >>> from bezier_filters.smoothing.whole_mesh import WholeMesh
    >>> triangle = triangle_mesh([[0, 0, 0], [3, 0, 0], [0, 4, 0]], [[0, 1, 2]])
    >>> extent_of(WholeMesh(triangle, vertex_adjacency(triangle))).mean_edge
    4.0
    """
    found = domain.run(Lengths())
    center = found.sums["vertices"] / max(domain.vertex_count, 1)
    size = max(found.largest[f"high {k}"] + found.largest[f"low {k}"] for k in range(3))
    near = bool(np.abs(center).max() <= size)
    edges = max(float(found.sums["edges"][0]), 1.0)
    return Extent(float(found.sums["lengths"][0]) / edges, np.zeros(3) if near else center)


@lean_njit()
def _sum_lengths(
    vertices: FloatArray, ptr: IntArray, indices: IntArray, start: int, stop: int, lengths: FloatArray
) -> None:
    """Write the sum of the lengths of the edges at vertices start .. stop-1."""
    for i in range(start, stop):
        for q in range(ptr[i], ptr[i + 1]):
            j = indices[q]
            x, y, z = vertices[j, 0] - vertices[i, 0], vertices[j, 1] - vertices[i, 1], vertices[j, 2] - vertices[i, 2]
            lengths[i] += np.sqrt(x * x + y * y + z * z)
