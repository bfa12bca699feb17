"""A mesh in tiles that stages run on: rounds of tasks, which see each other's values through the store."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.runtime.atomic import atomic_write
from bezier_filters.scale.array_file import new_array_file
from bezier_filters.scale.cluster_graph import GraphJob, SpreadJob, find_graph, spread
from bezier_filters.scale.connection_stages import OpenVertices
from bezier_filters.scale.connections import ROWS, Neighbours, cluster_centers, label_parts, neighbours_of
from bezier_filters.scale.sampled_parts import sampled_parts_of
from bezier_filters.scale.stage_runs import Rounds, largest_of, sums_of
from bezier_filters.scale.stage_tasks import StageJob, Where, run_stage
from bezier_filters.scale.store import Store
from bezier_filters.scale.tile_pieces import KEPT_RINGS
from bezier_filters.scale.tile_results import look_at_tile
from bezier_filters.scale.tile_values import ClusterValues, FileValues, RowFile, TileValues, rows_at
from bezier_filters.smoothing.cluster_stages import pace_of
from bezier_filters.smoothing.mesh_parts import SampledParts
from bezier_filters.smoothing.pieces import ClosedParts, Draw, Found, Stage
from bezier_filters.smoothing.whole_mesh import moved_and_scaled

STEPS = KEPT_RINGS[-1] - 2
"""That a stage makes at the most: the tiles that are kept have enough around them."""


@dataclass(frozen=True)
class TiledMesh:
    """A mesh in tiles, see `pieces.Domain`.

    Attributes
    ----------
    rounds : Rounds
        Where stages run.
    where : Where
        The mesh that they see.
    graph : Path or None
        Folder of the edges between clusters, once there are any,
    cluster_rate : float
        the largest rate at which values spread on them,
    cluster_pace : float
        and how fast.
    """

    rounds: Rounds
    where: Where
    graph: Path | None = None
    cluster_rate: float = 0.0
    cluster_pace: float = 1.0

    @property
    def store(self) -> Store:
        """The mesh on disk."""
        return self.where.opened()

    @property
    def vertex_count(self) -> int:
        """Number of vertices."""
        return self.rounds.store.layout.vertex_count

    @property
    def steps(self) -> int:
        """As many as there are rings around the tiles."""
        return STEPS

    def run(self, stage: Stage, *, part_count: int = 0, **inputs: Any) -> Found:
        """Run a stage: a round of tasks."""
        name = type(stage).__name__
        folder = self.rounds.next_folder(name)
        job = StageJob(self.where, folder, stage, inputs)
        needed = [_reported(values) for values in inputs.values() if not isinstance(values, FileValues)]
        reports = self.rounds.run(run_stage, job, job.vertices, _in_words(name), needed)
        size = self.rounds.store.layout.tile_vertices
        clusters = None if self.graph is None else ClusterValues(job.clusters, self.graph, size)
        return Found(TileValues(job.vertices, size), clusters, sums_of(reports, part_count), largest_of(reports))

    def free(self, *handles: RowFile | ClusterValues) -> None:
        """Remove the files of some values; their sums stay."""
        for handle in handles:
            if isinstance(handle, TileValues | ClusterValues):
                self.rounds.free(_reported(handle))
            elif isinstance(handle, FileValues):
                handle.table.path.unlink(missing_ok=True)

    def normalised(self, center: FloatArray, scale: float) -> TiledMesh:
        """The same mesh, moved and scaled, without clusters."""
        return TiledMesh(self.rounds, replace(self.where, center=center, scale=scale))

    def with_points(self, points: TileValues) -> TiledMesh:
        """The same faces with vertices elsewhere, without clusters."""
        path = points.folder.parent / "points.bin"
        if not path.is_file():
            with atomic_write(path) as temporary, open(temporary, "wb") as stream:
                for tile in range(self.rounds.store.layout.tile_count):
                    table = look_at_tile(points.folder, tile).rows
                    np.ascontiguousarray(table.read(0, table.rows)["points"]).tofile(stream)
        return TiledMesh(self.rounds, Where(self.where.store, path.resolve()))

    def clustered(self) -> TiledMesh:
        """The same mesh in clusters; they depend on the faces only, and are kept in the store."""
        with self.rounds.stages.stage("cluster"):
            centers = cluster_centers(self.rounds.store, self._neighbours())
        where = replace(self.where, clusters=centers)
        graph = self.rounds.next_folder("graph") / "vertices"
        reports = self.rounds.run(find_graph, GraphJob(where, graph), graph, "cluster")
        found = replace(self, where=where, graph=graph, cluster_rate=max(report["rate"] for report in reports))
        return replace(found, cluster_pace=pace_of(found))

    def diffused(self, means: ClusterValues, time: float) -> ClusterValues:
        """Values on clusters, averaged over their surroundings."""
        assert self.graph is not None
        folder = self.rounds.next_folder("spread") / "vertices"
        job = SpreadJob(self.graph, folder, means, time * self.cluster_pace, self.cluster_rate)
        self.rounds.run(spread, job, folder, "spread", [_reported(means)])
        return replace(means, folder=folder)

    def drawn(self, draw: Draw) -> FileValues:
        """Random numbers at all vertices, drawn in the order of the source, some rows at a time."""
        n, store = self.vertex_count, self.rounds.store
        path = self.rounds.next_folder("drawn").with_suffix(".bin")
        generator = draw.generator(n)
        sample = draw.rows(draw.generator(0), 0)
        table = new_array_file(path, sample.dtype, 1 if sample.ndim == 1 else sample.shape[1], n)
        step = n if draw.columns > 1 and draw.kind == "signs" else ROWS
        for start in range(0, n, max(step, 1)):
            stop = min(start + step, n)
            table.mapped("r+")[store.rank.read(start, stop)] = draw.rows(generator, stop - start).reshape(
                (-1,) if table.columns == 1 else (-1, table.columns)
            )
        return FileValues(table, "drawn", keep_columns=sample.ndim > 1)

    def ordered(self, ranks: list[int], name: str, values: TileValues) -> list[float]:
        """Values that would have some places if they were sorted: their high bits are counted, then the low ones."""
        found: list[float] = self.rounds.recalled(
            "ordered", lambda: [self._ordered(rank, name, values) for rank in ranks]
        )
        return found

    def _ordered(self, rank: int, name: str, values: TileValues) -> float:
        prefix = 0
        for shift in (16, 0):
            counts = np.zeros(1 << 16, dtype=np.int64)
            for start in range(0, self.vertex_count, ROWS):
                rows = np.ascontiguousarray(values.read(start, min(start + ROWS, self.vertex_count))[name])
                bits = rows.view(np.uint32)  # ascend with the values, none of which is negative
                chosen = bits if shift else bits[bits >> 16 == prefix >> 16]
                counts += np.bincount(chosen >> shift & 0xFFFF, minlength=len(counts))
            ends = np.cumsum(counts)
            part = int(np.searchsorted(ends, rank, side="right"))
            rank -= int(ends[part] - counts[part])
            prefix |= part << shift
        return float(np.array([prefix], dtype=np.uint32).view(np.float32)[0])

    def center_of_largest(self, means: ClusterValues) -> int:
        """Center of the cluster with the largest value; the first of several in the order of the source."""
        return int(self.rounds.recalled("largest", lambda: self._center_of_largest(means)))

    def _center_of_largest(self, means: ClusterValues) -> int:
        best, found = -np.inf, -1
        for tile in range(self.rounds.store.layout.tile_count):
            centers = np.load(means.centers / f"centers-{tile:06d}.npy")
            if not len(centers):
                continue
            values = means.rows_of(centers)["means"][:, 0]
            if values.max() < best:
                continue
            numbers = rows_at(self.rounds.store.order, centers[values == values.max()])
            first = int(numbers.min())
            found = first if values.max() > best else min(first, found)
            best = float(values.max())
        return found

    def sampled_parts(self, around: tuple[int, ...] = ()) -> SampledParts:
        """Parts of the mesh, or all of it if it is not large."""
        parts = sampled_parts_of(self.store, around, threads=self.rounds.threads)
        return replace(parts, mesh=moved_and_scaled(parts.mesh, self.where.center, self.where.scale))

    def closed_parts(self) -> ClosedParts:
        """The connected parts that enclose a volume."""
        found = self.run(OpenVertices())
        n, path = self.vertex_count, self.rounds.next_folder("parts").with_suffix(".bin")
        is_open: BoolArray = np.empty(n, dtype=np.bool_)
        for start in range(0, n, ROWS):
            is_open[start : start + ROWS] = found.vertices.read(start, min(start + ROWS, n))["open"]
        if found.sums["wrong"][0] > 0.0 or not self.rounds.store.layout.face_count:
            is_open[:] = True
        with self.rounds.stages.stage("parts"):
            of_vertex, firsts = label_parts(self.rounds.store, self._neighbours(), is_open, path)
        order = np.argsort(firsts)
        origins = np.empty((len(firsts), 3))
        if len(firsts):
            origins[order] = rows_at(self.store.vertices, firsts[order])
        return ClosedParts(of_vertex, origins)

    def at(self, vertices: IntArray, name: str, values: TileValues) -> NDArray[Any]:
        """Values at some vertices of the source."""
        ids = rows_at(self.rounds.store.rank, vertices)
        order = np.argsort(ids)

        def find() -> list[float]:
            found: list[float] = rows_at(values, ids[order])[name].tolist()
            return found

        rows = np.array(self.rounds.recalled("at", find))
        result = np.empty_like(rows)
        result[order] = rows
        return result

    def _neighbours(self) -> Neighbours:
        return neighbours_of(self.rounds.store, threads=self.rounds.threads)


def _reported(values: TileValues | ClusterValues) -> Path:
    """Folder with the reports of the stage that has left some values."""
    return values.folder.parent / "vertices"


def _in_words(name: str) -> str:
    """Name of a stage for the user."""
    return "".join(f" {letter.lower()}" if letter.isupper() else letter for letter in name).strip()
