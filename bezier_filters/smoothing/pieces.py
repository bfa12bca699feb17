"""Computations on a mesh in stages, each of which looks a few rings around every vertex.

A stage computes on a piece: on the whole mesh, if it is in memory, or on a tile with the rings around it that the
stage looks at. What holds for the mesh as a whole are sums over all vertices, and the largest of their values.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from bezier_filters.arrays import FloatArray, IntArray, SingleArray
from bezier_filters.meshes.adjacency import Adjacency
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.smoothing.clusters import Clusters
from bezier_filters.smoothing.laplacian import Laplacian, LaplacianRule
from bezier_filters.smoothing.mesh_parts import SampledParts

Arrays: TypeAlias = Mapping[str, NDArray[Any]]
"""Values at vertices (n,) or (n, c), or on clusters, by their names."""
Handle: TypeAlias = Any
"""What a domain knows values by: `Arrays` themselves in memory, files in tiles."""


class Piece:
    """A mesh, or a tile of one with what is around it.

    Attributes
    ----------
    mesh : TriangleMesh
        Vertices and faces in the order of the whole mesh.
    adjacency : Adjacency
        Of the piece; it is complete around all vertices that count.
    clusters : Clusters or None
        That its vertices belong to, once there are any.
    threads : int
        Number of threads.
    kept : dict
        What a stage would have to compute anew the next time; it may be gone by then.
    """

    def __init__(
        self, mesh: TriangleMesh, adjacency: Adjacency, clusters: Clusters | None = None, *, threads: int = 1
    ) -> None:
        self.mesh, self.adjacency, self.threads = mesh, adjacency, threads
        self._clusters = clusters
        self._laplacians: dict[LaplacianRule, Laplacian] = {}
        self.kept: dict[str, Any] = {}

    @property
    def clusters(self) -> Clusters:
        """That its vertices belong to."""
        assert self._clusters is not None, "the domain has no clusters yet"
        return self._clusters

    def laplacian(self, rule: LaplacianRule, shape: FloatArray | None = None) -> Laplacian:
        """The Laplacian of the mesh, or of the same mesh with vertices elsewhere. It is kept for the next stage."""
        key = replace(rule, largest_rate=None)
        if key not in self._laplacians:
            mesh = self.mesh if shape is None else TriangleMesh(shape, self.mesh.faces)
            self._laplacians[key] = key.of(mesh, self.adjacency, threads=self.threads)
        return replace(self._laplacians[key], largest_rate=rule.largest_rate)

    def forget(self) -> None:
        """Make room: for large meshes, memory counts."""
        self._laplacians.clear()
        self.kept.clear()


@dataclass(frozen=True)
class Outcome:
    """What a stage computes on a piece.

    Attributes
    ----------
    vertices, clusters : mapping
        Values at all vertices (n,) or (n, c), or on all clusters, of the piece.
    sums, squares : mapping
        Values at vertices whose sums over the mesh are wanted, or those of their squares.
    cluster_sums : mapping
        Values on clusters (k, c) whose sums are wanted.
    part_sums : mapping
        Values at vertices (n,) whose sums over each closed part are wanted, with the numbers of the parts (n,).
    largest : mapping
        Values at vertices (n,) of which the largest is wanted.
    """

    vertices: Arrays = field(default_factory=dict)
    clusters: Arrays = field(default_factory=dict)
    sums: Arrays = field(default_factory=dict)
    squares: Arrays = field(default_factory=dict)
    cluster_sums: Arrays = field(default_factory=dict)
    part_sums: Mapping[str, tuple[IntArray, FloatArray]] = field(default_factory=dict)
    largest: Arrays = field(default_factory=dict)


@dataclass(frozen=True)
class Found:
    """The same for the whole mesh.

    Attributes
    ----------
    vertices, clusters : Handle
        The values.
    sums : mapping
        Sums (c,), whatever they are of; of parts, one for each, (parts,).
    largest : mapping
        Largest values; -inf if there are no vertices.
    """

    vertices: Handle
    clusters: Handle
    sums: dict[str, FloatArray]
    largest: dict[str, float]


class Stage(Protocol):
    """Some computation; a frozen dataclass of its options."""

    @property
    def rings(self) -> int:
        """How many rings around a vertex the values there depend on; 0 if it needs no faces at all."""

    def __call__(self, piece: Piece, inputs: Mapping[str, Arrays]) -> Outcome:
        """Compute on a piece."""


@dataclass(frozen=True)
class Draw:
    """Random numbers for all vertices, in the order of the mesh.

    Attributes
    ----------
    kind : {"signs", "choices", "normal", "normal32"}
        Signs, or the same from `Generator.choice`, or numbers of the standard normal distribution.
    seed : int
        Of the generator.
    columns : int
        Numbers per vertex.
    skipped : int
        Columns of signs that were drawn before.
    """

    kind: str
    seed: int
    columns: int = 1
    skipped: int = 0

    def generator(self, n: int) -> np.random.Generator:
        """For a mesh of n vertices."""
        result = np.random.default_rng(self.seed)
        for _ in range(self.skipped):
            self._signs(result, n)
        return result

    def rows(self, generator: np.random.Generator, count: int) -> NDArray[Any]:
        """The next rows, (count,) or (count, columns); several columns of signs come one after the other."""
        if self.kind == "signs":
            columns = [self._signs(generator, count) for _ in range(self.columns)]
            return columns[0] if self.columns == 1 else np.column_stack(columns)
        if self.kind == "choices":
            return generator.choice(np.array([-1.0, 1.0]), count).astype(np.float32)
        dtype = np.float64 if self.kind == "normal" else np.float32
        return generator.standard_normal((count, self.columns), dtype=dtype)

    @staticmethod
    def _signs(generator: np.random.Generator, count: int) -> SingleArray:
        return (2.0 * generator.integers(0, 2, count, dtype=np.int8) - 1.0).astype(np.float32)


@dataclass(frozen=True)
class ClosedParts:
    """Connected parts without a border.

    Attributes
    ----------
    of_vertex : Handle
        "part" (n,) int32, the number of the closed part that a vertex belongs to, -1 for others.
    origins : (parts, 3) float64
        The first vertex of each.
    """

    of_vertex: Handle
    origins: FloatArray

    @property
    def count(self) -> int:
        """How many there are."""
        return len(self.origins)


class Domain(Protocol):
    """A mesh that stages run on, in memory or in tiles."""

    @property
    def vertex_count(self) -> int:
        """Number of vertices."""

    @property
    def steps(self) -> int:
        """Steps that a stage had better not exceed if it can do with fewer and go on from there."""

    @property
    def cluster_pace(self) -> float:
        """Time on clusters per time on the mesh."""

    def run(self, stage: Stage, *, part_count: int = 0, **inputs: Handle) -> Found:
        """Run a stage on all of the mesh, with values that other stages have found and some closed parts."""

    def free(self, *handles: Handle) -> None:
        """Make room: these values are not needed any more."""

    def normalised(self, center: FloatArray, scale: float) -> "Domain":
        """The same mesh, moved and scaled, without clusters."""

    def with_points(self, points: Handle) -> "Domain":
        """The same faces with vertices elsewhere, "points" (n, 3), without clusters."""

    def clustered(self) -> "Domain":
        """The same mesh in clusters."""

    def diffused(self, means: Handle, time: float) -> Handle:
        """The values "means" on clusters (k, c), averaged over some `time` squared edges around them."""

    def drawn(self, draw: Draw) -> Handle:
        """Random numbers at all vertices, "drawn"."""

    def ordered(self, ranks: list[int], name: str, values: Handle) -> list[float]:
        """Values (n,) float32, none of which is negative, that would have some places if they were sorted."""

    def center_of_largest(self, means: Handle) -> int:
        """Number in the mesh of the center of the cluster with the largest of the values "means", (k, 1)."""

    def closed_parts(self) -> ClosedParts:
        """The connected parts that enclose a volume, with the values "part" (n,)."""

    def sampled_parts(self, around: tuple[int, ...] = ()) -> SampledParts:
        """Parts of the mesh, in memory."""

    def at(self, vertices: IntArray, name: str, values: Handle) -> NDArray[Any]:
        """Values at some vertices."""
