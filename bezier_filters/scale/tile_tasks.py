"""What workers do: the results of one tile, from the store and back to it."""

import os
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bezier_filters.arrays import FloatArray
from bezier_filters.estimation.adaptive_fit import SurfaceFit, fit_parts
from bezier_filters.estimation.fallbacks import fit_with_fallbacks
from bezier_filters.estimation.vertex_geometry import FitChoice, VertexGeometry, empty_geometry
from bezier_filters.fields import ESTIMATES, PREFIX, columns
from bezier_filters.kernels.kernel_input import fitted_mesh
from bezier_filters.scale.halo import part_around
from bezier_filters.scale.sampling import rings_needed
from bezier_filters.scale.store import open_store
from bezier_filters.scale.tile_results import write_tile

QUANTITIES = {name: partial(columns, name) for name in ESTIMATES}
"""What can be estimated, and the columns that it is written to."""
SMOOTHING, DISPLACEMENT = "smoothing", PREFIX + "displacement"
"""What moves the vertices onto their patches instead, and the column of how far they are from where they were."""
QUALITY = "quality"
CACHED = 1 << 11
"""Rows that fit into the cache."""


@dataclass(frozen=True)
class TileJob:
    """What is done with every tile.

    Attributes
    ----------
    store : Path
        Folder of the store.
    results : Path
        Folder of the results.
    fit : SurfaceFit
        How vertices are fitted.
    creases, robust : bool
        Whether neighbourhoods end at creases, and whether points far off a fit lose their weight.
    quantity : str
        One of `QUANTITIES`, or `SMOOTHING`.
    quality : str
        Column that becomes the quality, too; empty for none.
    columns : tuple of str
        Columns that are written.
    coordinates : str
        Type that coordinates are written in.
    vertices : Path or None
        File with other coordinates than those of the source.
    threads : int
        That a task may use.
    """

    store: Path
    results: Path
    fit: SurfaceFit
    creases: bool
    robust: bool
    quantity: str
    quality: str = ""
    columns: tuple[str, ...] = ()
    coordinates: str = "<f8"
    vertices: Path | None = None
    threads: int = 1


@dataclass(frozen=True)
class TileGeometry:
    """The estimate for the vertices of a tile, which of the store they are, and how many had to be read for it."""

    geometry: VertexGeometry
    choice: FitChoice
    vertices: FloatArray
    rows: tuple[int, int]
    read: int


def run_tile(job: TileJob, tile: int) -> int:
    """Compute the results of a tile and write them; its number."""
    start, cpu_start = time.perf_counter(), time.process_time()
    found = estimate_tile(job, tile)
    vertices = found.vertices
    if job.quantity == SMOOTHING:
        vertices = vertices + found.geometry.displacements
        moved = vertices - open_store(job.store).coordinates(*found.rows)
        columns = {DISPLACEMENT: np.linalg.norm(moved, axis=1)}
    else:
        columns = QUANTITIES[job.quantity](found.geometry)
    rows = table_of(vertices, columns, job.quality, job.columns, job.coordinates)
    report = {
        "tile": tile,
        "vertices": len(rows),
        "read": found.read,
        "status": found.geometry.status_counts(),
        "parts": [part.vertices for part in found.choice.parts],
        "seconds": time.perf_counter() - start,
        "cpu_seconds": time.process_time() - cpu_start,
        "peak_bytes": peak_bytes(),
        "process": os.getpid(),
    }
    write_tile(job.results, tile, rows, report)
    return tile


def estimate_tile(job: TileJob, tile: int) -> TileGeometry:
    """Estimate the vertices of a tile: the same values as for the whole mesh."""
    store = open_store(job.store)
    if job.vertices is not None:
        store = store.with_vertices(job.vertices)
    start, stop = store.layout.tile(tile)
    part = part_around(store, np.arange(start, stop, dtype=np.int32), rings_needed(job.fit))
    arrays, _ = fitted_mesh(part.mesh, creases=job.creases, threads=job.threads)
    first, read = int(np.searchsorted(part.ids, start)), len(part.ids)
    vertices = part.mesh.vertices[first : first + stop - start].copy()
    ids = np.arange(first, first + stop - start, dtype=np.int32)
    arrays = arrays._replace(origin=np.arange(len(part.ids), dtype=np.int32) - np.int32(first))
    geometry = empty_geometry(stop - start)
    fit_with_fallbacks(arrays, ids, job.fit.attempts, geometry, robust=job.robust, threads=job.threads)
    choice = fit_parts(arrays, ids, job.fit, geometry, robust=job.robust, threads=job.threads)
    return TileGeometry(geometry, choice, vertices, (start, stop), read)


def table_of(
    vertices: FloatArray, columns: Mapping[str, FloatArray], quality: str, names: Sequence[str], coordinates: str
) -> NDArray[Any]:
    """Rows of a PLY file: coordinates of some type, one of the columns as quality, if any, and some columns."""
    fields = [(axis, coordinates) for axis in "xyz"]
    fields += [(QUALITY, "<f8")] * bool(quality) + [(name, "<f8") for name in names]
    rows = np.empty(len(vertices), dtype=fields)
    every = [(axis, vertices[:, k]) for k, axis in enumerate("xyz")]
    every += [(QUALITY, columns[quality])] if quality else []
    every += [(name, columns[name]) for name in names]
    for start in range(0, len(rows), CACHED):  # column after column, as long as the rows are at hand
        stop = start + CACHED
        for name, values in every:
            rows[name][start:stop] = values[start:stop]
    return rows


def peak_bytes() -> int:
    """The most memory that this process has had so far, 0 where that is not known."""
    if sys.platform == "win32":
        return 0
    import resource

    unit = 1 if sys.platform == "darwin" else 1024
    return int(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss) * unit
