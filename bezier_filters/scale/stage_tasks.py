"""What workers do for the automatic smoothing: a stage on one tile, from the store and back to it."""

import os
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.meshes.adjacency import Adjacency, Rows
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.scale.run import peak_bytes
from bezier_filters.scale.store import Store, open_store
from bezier_filters.scale.tile_pieces import TilePiece, piece_around, rows_between
from bezier_filters.scale.tile_results import write_tile
from bezier_filters.scale.tile_values import ClusterValues, RowFile, Stretches, columns_of, table_of_columns
from bezier_filters.smoothing.accurate_sums import sums_by_part
from bezier_filters.smoothing.clusters import Clusters, numbered
from bezier_filters.smoothing.pieces import Outcome, Piece, Stage
from bezier_filters.smoothing.whole_mesh import moved_and_scaled, partial_sums

NOTHING: NDArray[Any] = np.zeros(0, dtype=np.uint8)
"""Rows of a stage that has only sums."""


@dataclass(frozen=True)
class Where:
    """The mesh that a stage sees.

    Attributes
    ----------
    store : Path
        Folder of the store.
    vertices : Path or None
        File with other coordinates than those of the source.
    center, scale
        What is taken off the coordinates, and what they are multiplied by then.
    clusters : RowFile or None
        "center" and "label" of the cluster of every vertex: its center in the store and in the source.
    """

    store: Path
    vertices: Path | None = None
    center: FloatArray = field(default_factory=lambda: np.zeros(3))
    scale: float = 1.0
    clusters: RowFile | None = None

    def opened(self) -> Store:
        """The store."""
        store = open_store(self.store)
        return store if self.vertices is None else store.with_vertices(self.vertices)


@dataclass(frozen=True)
class StageJob:
    """A stage on all tiles.

    Attributes
    ----------
    where : Where
    folder : Path
        For its results.
    stage : Stage
    inputs : dict
        Values at vertices or on clusters, by name.
    """

    where: Where
    folder: Path
    stage: Stage
    inputs: dict[str, RowFile | ClusterValues]

    @property
    def vertices(self) -> Path:
        """Folder of the values at vertices."""
        return self.folder / "vertices"

    @property
    def clusters(self) -> Path:
        """Folder of the values on clusters."""
        return self.folder / "clusters"


def run_stage(job: StageJob, tile: int) -> int:
    """Run a stage on a tile and write what it finds; number of the tile."""
    begin = time.perf_counter()
    store = job.where.opened()
    start, stop = store.layout.tile(tile)
    there = _own_tile(start, stop) if job.stage.rings == 0 else piece_around(store, tile, job.stage.rings)
    stretches = Stretches.with_all(there.ids).ordered(there.places)
    coordinates = stretches.read(store.vertices)[stretches.rows]
    mesh = TriangleMesh(coordinates.astype(np.float64, copy=False), there.faces)
    if job.where.scale != 1.0 or job.where.center.any():
        mesh = moved_and_scaled(mesh, job.where.center, job.where.scale)
    clusters, centers = None, np.zeros(0, dtype=np.int32)
    if job.where.clusters is not None and job.stage.rings > 0:
        clusters, centers = clusters_of_piece(job.where.clusters, there, stretches)
    inputs = {name: _columns(values, stretches, centers) for name, values in job.inputs.items()}
    outcome = job.stage(Piece(mesh, there.adjacency, clusters), inputs)
    rows, own_clusters = there.rows(start, stop), rows_between(centers, start, stop)
    report = {
        "vertices": stop - start,
        "read": len(there.ids),
        "sums": {k: s.tolist() for k, s in partial_sums(outcome, rows, own_clusters).items()},
        "parts": {k: _of_parts(v, rows) for k, v in outcome.part_sums.items()},
        "largest": {k: float(v[rows].max(initial=-np.inf)) for k, v in outcome.largest.items()},
        "seconds": time.perf_counter() - begin,
        "peak_bytes": peak_bytes(),
        "process": os.getpid(),
    }
    _write(job, tile, outcome, rows, own_clusters, report)
    return tile


def _columns(values: RowFile | ClusterValues, stretches: Stretches, centers: IntArray) -> dict[str, NDArray[Any]]:
    """Values at the vertices, or on the clusters, of a piece."""
    if not isinstance(values, ClusterValues):
        return columns_of(stretches.read(values), stretches.rows)
    ascending, places = np.unique(centers, return_inverse=True)
    return columns_of(values.rows_of(ascending), places)


def _write(
    job: StageJob, tile: int, outcome: Outcome, rows: IntArray, clusters: IntArray, report: dict[str, Any]
) -> None:
    """Values on clusters first: the file with the report says that all is done."""
    if outcome.clusters:
        write_tile(job.clusters, tile, table_of_columns(dict(outcome.clusters), clusters), {}, lasting=False)
    table = table_of_columns(dict(outcome.vertices), rows) if outcome.vertices else NOTHING
    write_tile(job.vertices, tile, table, report | {"has_clusters": bool(outcome.clusters)}, lasting=False)


def _own_tile(start: int, stop: int) -> TilePiece:
    """A tile without faces."""
    empty = Rows(np.zeros(stop - start + 1, dtype=np.int32), np.zeros(0, dtype=np.int32))
    no_faces = np.zeros((0, 3), dtype=np.int32)
    ids = np.arange(start, stop, dtype=np.int32)
    return TilePiece(
        ids, ids - np.int32(start), no_faces, Adjacency(empty, empty, np.zeros(stop - start, dtype=np.bool_))
    )


def clusters_of_piece(values: RowFile, piece: TilePiece, stretches: Stretches) -> tuple[Clusters, IntArray]:
    """Clusters of a piece in the order of the source, and their centers in the store.

    Those with their centers in the tile are complete.
    """
    rows = columns_of(stretches.read(values), stretches.rows)
    clusters = numbered(rows["label"], piece.adjacency)
    centers = np.empty_like(clusters.centers)
    centers[clusters.of_vertex] = rows["center"]
    return clusters, centers


def _of_parts(values: tuple[IntArray, FloatArray], rows: IntArray) -> dict[str, list[Any]]:
    """Sums over the closed parts that a tile has vertices of, and which they are."""
    parts = values[0][rows]
    there, numbers = np.unique(parts[parts >= 0], return_inverse=True)
    sums = sums_by_part(numbers.astype(np.int32), values[1][rows][parts >= 0], len(there))
    return {"parts": there.tolist(), "sums": sums.tolist()}
