"""Estimates the geometry of meshes that do not fit into memory, file to file."""

import os
from collections.abc import Sequence
from dataclasses import asdict, replace
from functools import partial

import numpy as np

from bezier_filters.arguments import checks_arguments
from bezier_filters.arrays import FloatArray, Report
from bezier_filters.errors import InvalidParameterError
from bezier_filters.fields import CURVATURE, ESTIMATES, PREFIX, QUALITY, TORSION, Field, fields_of, values_of
from bezier_filters.fitting.fallbacks import fit_with_fallbacks
from bezier_filters.fitting.outlier_removal import rebase_displacements
from bezier_filters.fitting.region_fits import count_part, fit_regions
from bezier_filters.fitting.surface_fit import SurfaceFit
from bezier_filters.fitting.vertex_geometry import FitChoice, VertexGeometry, empty_geometry
from bezier_filters.meshes.adjacency import incoherent_vertices
from bezier_filters.meshes.face_sides import MIN_RELATIVE_VOLUME
from bezier_filters.meshes.half_edges import proper_faces
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.meshes.prepared_mesh import prepare_mesh
from bezier_filters.runtime.parallel import single_threaded_blas
from bezier_filters.scale.array_file import Values
from bezier_filters.scale.clients import Scheduler
from bezier_filters.scale.halo import TilePart, tile_part
from bezier_filters.scale.learn import check_tile_options, learn_fit, mesh_to_fit, rings_needed
from bezier_filters.scale.run import Round, RunOptions, StageProgress, file_run
from bezier_filters.scale.source import SourcePath, open_source
from bezier_filters.scale.store import Store
from bezier_filters.scale.tiles import TileReport, table_of
from bezier_filters.smoothing.volume import ClosedComponents, component_volumes
from bezier_filters.status import FitStatus
from bezier_filters.surface_model.fit_options import FitOptions
from bezier_filters.surface_model.model_tree import leaves

ALL = "all"  # every estimate
QUALITIES = {CURVATURE: "mean", TORSION: "torsion", ALL: "mean"}  # default qualities


@checks_arguments
@single_threaded_blas()
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
) -> Report:
    """Normals, curvature or torsion of a mesh of any size: the values of `estimate_vertex_geometry`, in tiles.

    The mesh is sorted spatially in a folder, the store, and cut into tiles. The fit is learned from the same
    sampled neighbourhoods as in memory. Then every tile is a task for Dask: a worker reads it with the rings
    around it that its values depend on, and writes its results. Finally they are joined in one PLY file.

    The vertices and faces of a tile keep their order in the whole mesh, so that the values are the same as in
    memory to the last bit, whatever the tiles and the scheduler; but fits do not end at sharp edges that noise hides.

    Parameters
    ----------
    source : path, or two of them
        A binary PLY file of triangles, or NPY files of vertices (n, 3) and faces (m, 3).
    target : path
        PLY file to write: coordinates, quality and columns ``bz_*`` as double, and faces.
    quantity : {"curvature", "normals", "torsion", "all"}
        Quantity to estimate; it determines the columns and the quality by default.
    quality : str, optional
        Any that a filter has (mean, gaussian, torsion, x, ...; see `bezier_filters.fields`). By default mean, or
        torsion if that is the quantity; normals have none.
    columns : sequence of str, optional
        Columns to write, with or without ``bz_``: any of those of the three filters. By default those of the quantity.
    options : FitOptions, optional
        How to fit.
    scheduler : optional
        A `distributed.Client`, a cluster (`LocalCluster`, `SLURMCluster`, ...), the address of a scheduler
        ("tcp://host:8786"), the path of its file ("scheduler.json"), or "threads", "processes" or "synchronous". By
        default what Dask would use: the current client, or the scheduler of DASK_SCHEDULER_ADDRESS; without any,
        processes of this machine are started, and ended when all is done. Clients and clusters stay open. All workers
        must see the store under the same path.
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
        Whether to continue with an existing store, and compute only missing tiles.
    keep_store : bool
        Whether to keep the store at the end; it stays if the run fails.
    progress : callable, optional
        ``progress(stage, done, total)``; if it returns False the run is cancelled, and can be resumed.

    Returns
    -------
    dict
        Report: the choice of the fit, status counts, tiles, seconds and the most memory of any process; ``scheduler``
        and ``dashboard`` (addresses, or the name of a local scheduler and None); ``warnings`` (texts: why most
        vertices have no curvature) and ``remarks`` (texts on orientation).

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
    check_tile_options(options)
    if isinstance(columns, str):
        raise InvalidParameterError(f"columns: got {columns!r}, expected a list of names")
    opened = open_source(source)
    chosen_quality, chosen = chosen_columns(quantity, quality, columns)
    parameters = {"quantity": quantity, "quality": chosen_quality, "columns": chosen, "options": asdict(options)}
    how = RunOptions(scheduler, workers, tile_vertices, memory_limit, store, resume, keep_store, progress)
    row_size = 3 * opened.dtype.itemsize + 8 * (len(chosen) + bool(chosen_quality))
    with file_run(opened, target, how, row_size=row_size, in_store=row_size) as run:
        with run.stages.stage("learn"):
            fit = learn_fit(run.store, options)
        job = partial(estimate_tile, run.store, fit, chosen_quality, chosen)
        done = run.tiles("fit", run.results(parameters), job)
        run.write(done.tiles)
    status = {status: int(k) for status, k in zip(FitStatus, done.sums("status"), strict=True) if k}
    return run.report() | {
        "quantity": quantity,
        "quality": chosen_quality or None,
        "attributes": chosen,
        "fit": asdict(_count_parts(fit, done)),
        "status": {code.name: count for code, count in status.items()},
        "warnings": _status_warnings(status),
        "remarks": _orientation_remarks(done, sum(status.values())),
        "halo_rings": rings_needed(fit),
    }


def estimate_fields(quantity: str = ALL) -> dict[str, Field]:
    """Fields of the estimates, by their columns."""
    filters = ESTIMATES if quantity == ALL else (quantity,)
    return {field.column: field for field in fields_of(*filters) if field.attribute is not None}


def chosen_columns(quantity: str, quality: str | None, columns: Sequence[str] | None) -> tuple[str, list[str]]:
    """Column of the quality, "" for none, and columns to write, which must exist."""
    every = estimate_fields()
    if quantity not in (*ESTIMATES, ALL):
        raise InvalidParameterError(f"quantity: got {quantity!r}, expected one of {', '.join((*ESTIMATES, ALL))}")
    wanted = (
        list(estimate_fields(quantity)) if columns is None else [PREFIX + name.removeprefix(PREFIX) for name in columns]
    )
    if not set(wanted) <= every.keys() or len(set(wanted)) < len(wanted):
        raise InvalidParameterError(f"columns: got {wanted}, expected some of {list(every)}, each once")
    qualities = {field.quality: column for column, field in every.items() if field.quality}
    quality = quality or QUALITIES.get(quantity)
    if quality is not None and quality not in qualities:
        raise InvalidParameterError(f"quality: got {quality!r}, expected one of {', '.join(qualities)}")
    return "" if quality is None else qualities[quality], wanted


def estimate_tile(
    store: Store, fit: SurfaceFit, quality: str, columns: Sequence[str], tile: int
) -> tuple[Values, TileReport]:
    """Estimates for the vertices of a tile, as rows of the result file, with the quality unless it is empty."""
    geometry, part = fit_tile(store, fit, tile)
    every = estimate_fields()
    values = values_of([every[name] for name in {*columns, quality} - {""}], geometry)
    written = ({QUALITY: values[quality]} if quality else {}) | {name: values[name] for name in columns}
    rows = table_of(part.mesh.vertices[part.own], written, store.layout.dtype)
    counts = geometry.status_counts()
    sums = {
        "status": [float(counts.get(status.name, 0)) for status in FitStatus],
        "parts": [float(part.vertices) for part in geometry.fit.parts],
        "orientation": _orientation_sums(part, store.coordinates(0, 1)[0]),
    }
    return rows, TileReport(tile, len(part.ids), sums)


def _status_warnings(counts: dict[FitStatus, int]) -> list[str]:
    """A warning if no vertex has a curvature, or folds spoil most of them, as in memory."""
    most, total = max(counts, key=lambda status: counts[status]), sum(counts.values())
    if not any(status.has_curvature for status in counts):
        return [_no_curvature(most)]
    bad = sum(count for status, count in counts.items() if status >= FitStatus.FOLDED)
    if most != FitStatus.FOLDED or 2 * bad < total:
        return []
    return [f"{bad:,} of {total:,} vertices have no curvature to rely on: {most.message}"]


def _orientation_remarks(done: Round, vertex_count: int) -> list[str]:
    """Remarks about wrong signs, by flipped faces or negative volume, from the sums over all tiles."""
    incoherent, open_vertices, volume, squares = done.sums("orientation")
    if incoherent:
        return [
            f"at {int(incoherent):,} vertices, faces are flipped against others, or more than two meet at an edge: "
            "signs may be wrong there (meshing_re_orient_faces_coherently)"
        ]
    size = np.sqrt(squares / vertex_count)
    if open_vertices or volume >= -MIN_RELATIVE_VOLUME * size**3:
        return []
    return [
        "the closed surface has a negative volume, so that it is inside out: the signs of its curvatures and normals "
        "are wrong (meshing_invert_face_orientation)"
    ]


def _orientation_sums(part: TilePart, origin: FloatArray) -> list[float]:
    """Sums over a tile: vertices with incoherent faces, and on borders; volume and squared distances from a point (3,).

    The units are 1, 1, length^3 and length^2.
    """
    mesh = prepare_mesh(part.mesh)
    if len(mesh.adjacency.faces.indices) < mesh.faces.size:  # some faces repeat a vertex
        mesh = prepare_mesh(TriangleMesh(mesh.vertices, proper_faces(mesh.faces)))
    incoherent = incoherent_vertices(mesh.faces, mesh.adjacency)[part.own]
    whole = ClosedComponents(np.zeros(mesh.vertex_count, np.int32), origin[np.newaxis])
    volume = component_volumes(whole, TriangleMesh(mesh.vertices, part.mesh.faces[part.faces_of_tile()]))[0]
    squares = np.square(mesh.vertices[part.own] - origin).sum()
    return [float(incoherent.sum()), float(mesh.adjacency.on_boundary[part.own].sum()), float(volume), float(squares)]


def _no_curvature(status: FitStatus) -> str:
    """Why no vertex has a curvature, by the most frequent status."""
    return (
        f"no vertex has a curvature: {status.message}; where faces share no vertices or lie on each other, weld them "
        "(meshing_merge_close_vertices) and remove duplicates (meshing_remove_duplicate_faces) first"
    )


def fit_tile(store: Store, fit: SurfaceFit, tile: int) -> tuple[VertexGeometry, TilePart]:
    """Estimate the vertices of a tile as in the whole mesh; also returns the part of the mesh that was read."""
    part = tile_part(store, tile, rings_needed(fit))
    part = replace(part, mesh=prepare_mesh(part.mesh))  # whose adjacency is used again
    arrays = mesh_to_fit(part.mesh, fit.with_barriers, fit.cleaned, fit.smooth_normals)
    own = np.arange(part.own.start, part.own.stop, dtype=np.int32)
    arrays = arrays._replace(origin=np.arange(len(part.ids), dtype=np.int32) - own[0])
    geometry = empty_geometry(len(own))
    fit_with_fallbacks(arrays, own, fit.attempts, geometry, robust=fit.robust)
    choice = fit_regions(arrays, own, fit, geometry)
    if fit.cleaned:
        rebase_displacements(part.mesh.vertices, arrays, own, geometry)
    return replace(geometry, fit=choice), part


def _count_parts(fit: SurfaceFit, done: Round) -> FitChoice:
    """The choice with the number of vertices of each region."""
    if fit.regions is None:
        return fit.choice
    found = zip(done.sums("parts"), leaves(fit.regions), strict=True)
    parts = tuple(count_part(part, int(count)) for count, part in found if count)
    return replace(fit.choice, parts=parts)
