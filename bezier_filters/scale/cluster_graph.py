"""The clusters of a mesh in tiles, and how values spread over them."""

import os
import uuid
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bezier_filters.arrays import BoolArray, IntArray, SingleArray
from bezier_filters.scale.run import peak_bytes
from bezier_filters.scale.stage_tasks import NOTHING, Where, clusters_of_piece
from bezier_filters.scale.tile_pieces import piece_around, rows_between
from bezier_filters.scale.tile_results import write_tile
from bezier_filters.scale.tile_values import ClusterValues, Stretches
from bezier_filters.smoothing.laplacian import Laplacian
from bezier_filters.smoothing.scale_space import diffused, heat_terms

RINGS = 3
"""Around the center of a cluster, that its edges to others lie within."""


@dataclass(frozen=True)
class GraphJob:
    """The edges between clusters, to be found for every tile.

    Attributes
    ----------
    where : Where
    folder : Path
        For the results.
    """

    where: Where
    folder: Path


@dataclass(frozen=True)
class SpreadJob:
    """Values on clusters that are averaged over their surroundings.

    Attributes
    ----------
    graph : Path
        Folder of the edges between clusters.
    folder : Path
        For the results.
    values : ClusterValues
        "means" (k, c).
    time : float
        In units of the clusters.
    largest_rate : float
        Of the Laplacian.
    """

    graph: Path
    folder: Path
    values: ClusterValues
    time: float
    largest_rate: float


def find_graph(job: GraphJob, tile: int) -> int:
    """Write the Laplacian of the clusters whose centers lie in a tile; number of the tile."""
    store = job.where.opened()
    start, stop = store.layout.tile(tile)
    piece = piece_around(store, tile, RINGS)
    assert job.where.clusters is not None
    clusters, centers = clusters_of_piece(
        job.where.clusters, piece, Stretches.with_all(piece.ids).ordered(piece.places)
    )
    laplacian = clusters.laplacian()
    own = rows_between(centers, start, stop)
    entries = _entries(laplacian.indptr, own)
    np.save(job.folder / f"centers-{tile:06d}.npy", centers[own])
    temporary = job.folder / f".{uuid.uuid4().hex}.npz"
    np.savez(
        temporary,
        centers=centers[own],
        lengths=np.diff(laplacian.indptr)[own],
        indices=centers[laplacian.indices[entries]],
        weights=laplacian.weights[entries],
        rates=laplacian.rates[own],
    )
    os.replace(temporary, _path(job.folder, tile))
    largest = float(laplacian.rates[own].max(initial=0.0))
    write_tile(
        job.folder, tile, NOTHING, {"rate": largest, "clusters": len(own), "peak_bytes": peak_bytes()}, lasting=False
    )
    return tile


def spread(job: SpreadJob, tile: int) -> int:
    """Average the values on the clusters of a tile over their surroundings; number of the tile."""
    rings = heat_terms(job.time, 2.0 * max(job.largest_rate, 0.5))
    near = _Surroundings(job.graph, job.values.tile_vertices)
    near.load(tile)
    own = near.centers.copy()
    reached = front = own
    for _ in range(rings):
        front = np.setdiff1d(near.neighbours(front), reached, assume_unique=True)
        for other in np.unique(front // np.int32(near.tile_vertices)).tolist():
            near.load(other)
        reached = np.sort(np.concatenate([reached, front]))
    laplacian = near.laplacian(reached, job.largest_rate)
    values = np.ascontiguousarray(job.values.rows_of(reached)["means"])
    result = diffused(laplacian, values, job.time)[np.searchsorted(reached, own)]
    table = np.empty(len(own), dtype=[("means", "<f8", (values.shape[1],))])
    table["means"] = result
    write_tile(
        job.folder, tile, table, {"peak_bytes": peak_bytes(), "read": len(reached), "clusters": len(own)}, lasting=False
    )
    return tile


class _Surroundings:
    """Clusters of some tiles, ascending by their centers, and the edges that leave them."""

    def __init__(self, folder: Path, tile_vertices: int) -> None:
        self.folder, self.tile_vertices = folder, tile_vertices
        self.tiles: dict[int, dict[str, NDArray[Any]]] = {}
        self.centers: IntArray = np.zeros(0, dtype=np.int32)
        self.seen: set[int] = set()

    def load(self, tile: int) -> None:
        """Read the clusters of a tile, if they are not there yet."""
        if tile in self.tiles:
            return
        with np.load(_path(self.folder, tile)) as found:
            self.tiles[tile] = dict(found)
        tables = [self.tiles[k] for k in sorted(self.tiles)]
        self.centers, lengths, self.indices, self.weights, self.rates = (
            np.concatenate([table[name] for table in tables])
            for name in ("centers", "lengths", "indices", "weights", "rates")
        )
        self.ptr = np.append(0, np.cumsum(lengths))

    def neighbours(self, centers: IntArray) -> IntArray:
        """Clusters next to some, each once, ascending."""
        return np.unique(self.indices[_entries(self.ptr, np.searchsorted(self.centers, centers))])

    def laplacian(self, centers: IntArray, largest_rate: float) -> Laplacian:
        """The Laplacian of some clusters, ascending; edges to others are missing."""
        rows = np.searchsorted(self.centers, centers)
        entries = _entries(self.ptr, rows)
        places = np.searchsorted(centers, self.indices[entries])
        places[places == len(centers)] = 0
        is_there: BoolArray = centers[places] == self.indices[entries]
        lengths = np.diff(self.ptr)[rows]
        ptr = np.append(0, np.cumsum(lengths)).astype(np.int32)
        weights: SingleArray = np.where(is_there, self.weights[entries], np.float32(0.0))
        return Laplacian(ptr, places.astype(np.int32), weights, self.rates[rows], largest_rate)


def _entries(ptr: IntArray | NDArray[np.int64], rows: IntArray | NDArray[np.int64]) -> NDArray[np.int64]:
    """Where the entries of some rows are."""
    lengths = (ptr[rows + 1] - ptr[rows]).astype(np.int64)
    starts = np.repeat(ptr[rows] - np.append(0, np.cumsum(lengths)[:-1]), lengths)
    result: NDArray[np.int64] = starts + np.arange(len(starts))
    return result


def _path(folder: Path, tile: int) -> Path:
    return folder / f"graph-{tile:06d}.npz"
