"""Estimates the geometry of meshes that do not fit into memory, file to file."""

import os
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from bezier_filters.errors import InvalidParameterError
from bezier_filters.estimation.adaptive_fit import SurfaceFit
from bezier_filters.estimation.vertex_geometry import FitChoice, FitPart, empty_geometry
from bezier_filters.fields import CURVATURE, PREFIX, TORSION, qualities
from bezier_filters.learning.model_tree import leaves
from bezier_filters.scale.file_run import RunOptions, file_run
from bezier_filters.scale.mesh_source import SourcePath, open_source
from bezier_filters.scale.sampling import FitOptions, learn_fit, rings_needed
from bezier_filters.scale.scheduling import Scheduler, dashboard
from bezier_filters.scale.tile_results import TileResult
from bezier_filters.scale.tile_run import Finished, StageProgress, Stages, results_folder, run_job
from bezier_filters.scale.tile_tasks import QUANTITIES, TileJob, peak_bytes
from bezier_filters.status import FitStatus


def estimate_file(
    source: SourcePath,
    target: str | os.PathLike[str],
    quantity: str = "curvature",
    *,
    quality: str | None = None,
    columns: Sequence[str] | None = None,
    options: FitOptions | None = None,
    scheduler: Scheduler = None,
    workers: int | None = None,
    tile_vertices: int | None = None,
    memory_limit: int | None = None,
    store: str | os.PathLike[str] | None = None,
    resume: bool = False,
    keep_store: bool = False,
    progress: StageProgress | None = None,
) -> dict[str, Any]:
    """Normals, curvature or torsion of a mesh of any size: the values of `estimate_vertex_geometry`, in tiles.

    The mesh is sorted in space in a folder, the store, and cut into tiles. How to fit is learned from the same
    sampled neighbourhoods as in memory. Then every tile is a task for Dask: a worker reads it with the rings
    around it that its values depend on, and writes its results. In the end they are joined to one PLY file.

    The vertices and faces of a tile keep their order in the whole mesh, so that the values are the same as in
    memory to the last bit, whatever the tiles and the scheduler.

    Parameters
    ----------
    source : path, or two of them
        A binary PLY file of triangles, or NPY files of vertices (n, 3) and faces (m, 3).
    target : path
        PLY file to write: coordinates, quality and columns ``bz_*`` as double, and faces.
    quantity : {"curvature", "normals", "torsion"}
        What to estimate; it says which columns there are.
    quality : str, optional
        For curvature: mean, gaussian, min, max, curvedness, shape_index or std; mean by default. Torsion is its own
        quality, normals have none.
    columns : sequence of str, optional
        Columns to write, with or without ``bz_``; all by default.
    options : FitOptions, optional
        How to fit.
    scheduler : optional
        "threads", "processes", "synchronous", the address of a Dask scheduler, or a `distributed.Client`; by
        default, processes of this machine are started, and ended when all is done. All workers must see the store
        under the same path.
    workers : int, optional
        Processes or threads on this machine; all cores by default.
    tile_vertices : int, optional
        Vertices of a tile, 256 or more; by default 524,288, or as many as there is memory for.
    memory_limit : int, optional
        Bytes of each worker that is started.
    store : path, optional
        Folder for the store, with room for 70 bytes per vertex and the size of the result. By default the target
        with ``.tiles`` after its name.
    resume : bool
        Whether to go on with a store that is there, and compute only what it does not have.
    keep_store : bool
        Whether to leave the store there at the end; it stays if anything goes wrong.
    progress : callable, optional
        ``progress(stage, done, total)``; if it returns False the run is cancelled, and can be resumed.

    Returns
    -------
    dict
        Report: the choice of the fit, status counts, tiles, seconds and the most memory of any process.

    Raises
    ------
    FieldFileError
        If the source is damaged, or cannot be read in parts, or the store belongs to another one.
    InvalidMeshError
        If it is not a mesh of triangles with finite coordinates.
    InvalidParameterError
        If a parameter is out of range.
    ImportError
        If Dask is not installed.
    LostTaskError
        If workers die again and again of the same tile.
    CancelledError
        If `progress` returned False.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from bezier_filters.surfaces import sphere
    >>> folder, ball = Path(tempfile.mkdtemp()), sphere(resolution=30)
    >>> np.save(folder / "v.npy", ball.vertices)
    >>> np.save(folder / "f.npy", ball.faces)
    >>> files = folder / "v.npy", folder / "f.npy"
    >>> report = estimate_file(files, folder / "out.ply", tile_vertices=1024, scheduler="synchronous")
    >>> report["status"] == {"OK": len(ball.vertices)}
    True
    """
    options = options or FitOptions()
    opened, creases = open_source(source), options.creases
    chosen_quality, chosen = _columns(quantity, quality, columns)
    parameters = {"quantity": quantity, "quality": chosen_quality, "columns": chosen, "options": asdict(options)}
    how = RunOptions(scheduler, workers, tile_vertices, memory_limit, store, resume, keep_store, progress)
    row_size = 3 * opened.dtype.itemsize + 8 * (len(chosen) + bool(chosen_quality))
    with file_run(opened, target, how, row_size=row_size, in_store=row_size) as run:
        mesh = run.mesh
        with run.stages.stage("learn"):
            fit = learn_fit(mesh, options, threads=run.workers)
        results = results_folder(mesh, parameters)
        job = TileJob(
            mesh.folder.resolve(),
            results.resolve(),
            fit,
            creases,
            options.robust,
            quantity,
            chosen_quality,
            tuple(chosen),
            mesh.layout.dtype,
        )
        with run.stages.stage("start"):
            ready = run.cluster.ready()
        link = dashboard(ready)
        with run.stages.stage("fit", link) as report:
            finished = run_job(ready, mesh, job, workers=run.workers, progress=report)
        run.write(finished.tiles)
    return (
        run.files
        | {
            "quantity": quantity,
            "quality": chosen_quality or None,
            "attributes": chosen,
            "fit": asdict(_with_counts(fit, finished.tiles)),
            "status": _status(finished.tiles),
            "dashboard": link or None,
        }
        | tile_report(finished, mesh.layout.tile_vertices, rings_needed(fit), run.stages)
    )


def tile_report(finished: Finished, tile_vertices: int, rings: int, stages: Stages) -> dict[str, Any]:
    """What is told of the tiles."""
    return {
        "vertices": sum(tile.report["vertices"] for tile in finished.tiles),
        "tiles": len(finished.tiles),
        "computed_tiles": finished.computed,
        "damaged_tiles": list(finished.damaged),
        "tile_vertices": tile_vertices,
        "halo_rings": rings,
        "halo": finished.halo,
        "tile_seconds": sum(tile.report["seconds"] for tile in finished.tiles),
        "peak_bytes": {"worker": finished.peak_bytes, "driver": peak_bytes()},
        "seconds": stages.seconds,
    }


def _columns(quantity: str, quality: str | None, columns: Sequence[str] | None) -> tuple[str, list[str]]:
    """The column that becomes the quality, or "", and those that are written."""
    if quantity not in QUANTITIES:
        raise InvalidParameterError(f"quantity: got {quantity!r}, expected one of {', '.join(QUANTITIES)}")
    there = list(QUANTITIES[quantity](empty_geometry(0)))
    wanted = there if columns is None else [PREFIX + name.removeprefix(PREFIX) for name in columns]
    unknown = [name for name in wanted if name not in there]
    if unknown or len(set(wanted)) < len(wanted):
        raise InvalidParameterError(f"columns: got {wanted}, expected some of {there}, each once")
    if quantity != "curvature":
        if quality is not None:
            raise InvalidParameterError(f"quality: got {quality!r}, expected None for {quantity}")
        return qualities(TORSION)["torsion"].column if quantity == TORSION else "", wanted
    fields = qualities(CURVATURE)
    if quality is not None and quality not in fields:
        raise InvalidParameterError(f"quality: got {quality!r}, expected one of {', '.join(fields)}")
    return fields[quality or "mean"].column, wanted


def _status(tiles: Sequence[TileResult]) -> dict[str, int]:
    """Vertices per status, from best to worst."""
    counts: Counter[str] = Counter()
    for tile in tiles:
        counts.update(tile.report["status"])
    return {status.name: counts[status.name] for status in FitStatus if counts[status.name]}


def _with_counts(fit: SurfaceFit, tiles: Sequence[TileResult]) -> FitChoice:
    """The choice with the number of vertices of each part."""
    if fit.parts is None:
        return fit.choice
    counts = np.sum([tile.report["parts"] for tile in tiles], axis=0)
    found = zip(counts, leaves(fit.parts), strict=True)
    parts = tuple(FitPart(int(count), part.rings, part.degree, part.noise_sigma) for count, part in found)
    return replace(fit.choice, parts=parts)
