"""A mesh in memory that stages run on."""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.meshes.adjacency import Adjacency
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.smoothing.accurate_sums import column_sums, sums_by_part, total
from bezier_filters.smoothing.closed_parts import closed_parts
from bezier_filters.smoothing.cluster_stages import pace_of
from bezier_filters.smoothing.clusters import Clusters, clusters_of
from bezier_filters.smoothing.laplacian import Laplacian
from bezier_filters.smoothing.mesh_parts import SampledParts, sampled_parts
from bezier_filters.smoothing.pieces import Arrays, ClosedParts, Draw, Found, Outcome, Piece, Stage
from bezier_filters.smoothing.scale_space import diffused


@dataclass(frozen=True)
class WholeMesh:
    """A mesh in memory, see `pieces.Domain`.

    Attributes
    ----------
    mesh : TriangleMesh
    adjacency : Adjacency
        Of the same mesh.
    threads : int
        Number of threads.
    clusters : Clusters or None
        Of the mesh, once there are any.
    cluster_laplacian : Laplacian or None
        How values spread on them,
    cluster_pace : float
        and how fast.
    """

    mesh: TriangleMesh
    adjacency: Adjacency
    threads: int = 1
    clusters: Clusters | None = None
    cluster_laplacian: Laplacian | None = None
    cluster_pace: float = 1.0

    @property
    def vertex_count(self) -> int:
        """Number of vertices."""
        return self.mesh.vertex_count

    @property
    def steps(self) -> int:
        """All of them at once."""
        return sys.maxsize

    @cached_property
    def piece(self) -> Piece:
        """All of the mesh."""
        return Piece(self.mesh, self.adjacency, self.clusters, threads=self.threads)

    def run(self, stage: Stage, *, part_count: int = 0, **inputs: Any) -> Found:
        """Run a stage."""
        outcome = stage(self.piece, inputs)
        partial = partial_sums(outcome)
        partial |= {name: sums_by_part(*values, part_count) for name, values in outcome.part_sums.items()}
        sums = {name: total(found[np.newaxis]) for name, found in partial.items()}
        largest = {name: float(values.max(initial=-np.inf)) for name, values in outcome.largest.items()}
        return Found(outcome.vertices, outcome.clusters, sums, largest)

    def free(self, *handles: Arrays) -> None:
        """Nothing to do: values that nobody knows go by themselves."""

    def normalised(self, center: FloatArray, scale: float) -> WholeMesh:
        """The same mesh, moved and scaled, without clusters."""
        return WholeMesh(moved_and_scaled(self.mesh, center, scale), self.adjacency, self.threads)

    def with_points(self, points: Arrays) -> WholeMesh:
        """The same faces with vertices elsewhere, without clusters."""
        return WholeMesh(TriangleMesh(points["points"], self.mesh.faces), self.adjacency, self.threads)

    def clustered(self) -> WholeMesh:
        """The same mesh in clusters."""
        clusters = clusters_of(self.adjacency)
        found = replace(self, clusters=clusters, cluster_laplacian=clusters.laplacian())
        return replace(found, cluster_pace=pace_of(found))

    def diffused(self, means: Arrays, time: float) -> Arrays:
        """Values on clusters, averaged over their surroundings."""
        assert self.cluster_laplacian is not None
        time *= self.cluster_pace
        return {"means": diffused(self.cluster_laplacian, means["means"], time, threads=self.threads)}

    def drawn(self, draw: Draw) -> Arrays:
        """Random numbers at all vertices."""
        return {"drawn": draw.rows(draw.generator(self.vertex_count), self.vertex_count)}

    def ordered(self, ranks: list[int], name: str, values: Arrays) -> list[float]:
        """Values that would have some places if they were sorted."""
        return [float(x) for x in np.partition(values[name], ranks)[ranks]]

    def center_of_largest(self, means: Arrays) -> int:
        """Center of the cluster with the largest value."""
        assert self.clusters is not None
        return int(self.clusters.centers[means["means"][:, 0].argmax()])

    def closed_parts(self) -> ClosedParts:
        """The connected parts that enclose a volume."""
        of_vertex, first = closed_parts(self.mesh, self.adjacency)
        return ClosedParts({"part": of_vertex}, self.mesh.vertices[first])

    def sampled_parts(self, around: tuple[int, ...] = ()) -> SampledParts:
        """Parts of the mesh, or all of it if it is not large."""
        return sampled_parts(self.mesh, self.adjacency, around, threads=self.threads)

    def at(self, vertices: IntArray, name: str, values: Arrays) -> NDArray[Any]:
        """Values at some vertices."""
        return values[name][vertices]


def moved_and_scaled(mesh: TriangleMesh, center: FloatArray, scale: float) -> TriangleMesh:
    """The mesh with another origin and another unit of length."""
    return TriangleMesh((mesh.vertices - center) * scale, mesh.faces)


def partial_sums(outcome: Outcome, rows: IntArray | None = None, clusters: IntArray | None = None) -> dict[str, Any]:
    """Sums over some vertices and clusters, or all, with what rounding took off them."""
    found = {name: column_sums(values, rows) for name, values in outcome.sums.items()}
    found |= {name: column_sums(values, rows, squared=True) for name, values in outcome.squares.items()}
    return found | {name: column_sums(values, clusters) for name, values in outcome.cluster_sums.items()}
