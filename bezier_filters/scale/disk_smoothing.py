"""Smooths meshes that do not fit into memory, file to file: every vertex moves to its patch, some times."""

import os
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from bezier_filters.errors import InvalidParameterError
from bezier_filters.runtime.atomic import atomic_write
from bezier_filters.scale.disk_estimation import tile_report
from bezier_filters.scale.joined_file import write_joined
from bezier_filters.scale.mesh_source import SourcePath, open_source
from bezier_filters.scale.sampling import FitOptions, learn_fit, rings_needed
from bezier_filters.scale.scheduling import Scheduler, running
from bezier_filters.scale.tile_run import (
    Finished,
    StageProgress,
    Stages,
    check_room,
    prepared_store,
    remove_store,
    results_folder,
    run_job,
    tile_size,
    worker_count,
)
from bezier_filters.scale.tile_tasks import DISPLACEMENT, SMOOTHING, TileJob

PAPER = FitOptions(rings=2, alpha=0.8, smoothness="paper")
"""As ``bezier_filters.smooth(..., method="paper")``."""


def smooth_file(
    source: SourcePath,
    target: str | os.PathLike[str],
    *,
    iterations: int = 1,
    options: FitOptions = PAPER,
    scheduler: Scheduler = None,
    workers: int | None = None,
    tile_vertices: int | None = None,
    memory_limit: int | None = None,
    store: str | os.PathLike[str] | None = None,
    resume: bool = False,
    keep_store: bool = False,
    progress: StageProgress | None = None,
) -> dict[str, Any]:
    """Move every vertex of a mesh of any size onto its patch, all from the old mesh, some times.

    By default this is the paper's smoothing, with the vertices of ``smooth(..., method="paper")``; after the first
    time up to rounding, as the tiles keep the order of the mesh before: 1e-12, more where faces join what is far
    apart. With other options vertices move onto the patches of `estimate_vertex_geometry` with these, for example
    of learned weights.

    Tiles see the coordinates around them after each step through the store.

    Parameters
    ----------
    source, target, scheduler, workers, tile_vertices, memory_limit, store, resume, keep_store, progress
        As in `estimate_file`. The quality of the target is ``bz_displacement``: how far each vertex moved in all.
    iterations : int
        How many times, at least 1.
    options : FitOptions
        How patches are fitted. What is left open is learned anew every time.

    Returns
    -------
    dict
        Report, as of `estimate_file`; tiles are those of all steps.

    Raises
    ------
    FieldFileError, InvalidMeshError, InvalidParameterError, ImportError, LostTaskError, CancelledError
        As `estimate_file`.

    Examples
    --------
    >>> import tempfile
    >>> from bezier_filters import smooth
    >>> from bezier_filters.surfaces import sphere
    >>> folder, ball = Path(tempfile.mkdtemp()), sphere(resolution=20)
    >>> np.save(folder / "v.npy", ball.vertices)
    >>> np.save(folder / "f.npy", ball.faces)
    >>> files = folder / "v.npy", folder / "f.npy"
    >>> report = smooth_file(files, folder / "out.ply", tile_vertices=1024, scheduler="synchronous")
    >>> moved = open_source(folder / "out.ply").vertices(0, len(ball.vertices))
    >>> bool((moved == smooth(ball.vertices, ball.faces, method="paper").vertices).all())
    True
    """
    creases = options.creases
    if isinstance(iterations, bool) or not isinstance(iterations, int) or iterations < 1:
        raise InvalidParameterError(f"iterations: got {iterations!r}, expected an integer of 1 or more")
    opened, stages = open_source(source), Stages(progress)
    tile_size(tile_vertices, memory_limit)  # refused at once if there cannot be any
    workers = worker_count(workers)
    folder = Path(store) if store is not None else Path(f"{os.fspath(target)}.tiles")
    computed, damaged = 0, list[int]()
    if not resume:
        check_room(opened, folder, Path(target), 40 * (1 + iterations))
    with running(scheduler, workers=workers, memory_limit=memory_limit) as cluster:
        with stages.stage("sort") as report:
            mesh = prepared_store(
                opened, folder, tile_vertices, memory_limit, resume=resume, threads=workers, progress=report
            )
        current = mesh
        for step in range(iterations):
            results = results_folder(mesh, {"quantity": SMOOTHING, "options": asdict(options), "step": step})
            with stages.stage("learn"):
                fit = learn_fit(current, options, threads=workers)
            job = TileJob(
                mesh.folder.resolve(),
                results.resolve(),
                fit,
                creases,
                options.robust,
                SMOOTHING,
                DISPLACEMENT,
                (DISPLACEMENT,),
                vertices=current.vertices.path.resolve() if step else None,
            )
            with stages.stage(f"step {step + 1}") as report:
                finished = run_job(cluster.ready(), mesh, job, workers=workers, progress=report)
            computed += finished.computed
            damaged += finished.damaged
            current = mesh.with_vertices(_joined_vertices(results, finished))
        cluster.release()
        with stages.stage("write") as report:
            write_joined(target, opened, mesh, finished.tiles, threads=workers, progress=report)
    if not keep_store:
        remove_store(folder)
    in_all = Finished(finished.tiles, computed, tuple(damaged))
    return {
        "input": [str(path) for path in opened.paths],
        "output": os.fspath(target),
        "iterations": iterations,
        "quality": DISPLACEMENT,
        "attributes": [DISPLACEMENT],
        "fit": asdict(fit.choice),
    } | tile_report(in_all, mesh.layout.tile_vertices, rings_needed(fit), stages)


def _joined_vertices(results: Path, finished: Finished) -> Path:
    """One file with the coordinates of all tiles, in the order of the store."""
    path = results / "vertices.bin"
    with atomic_write(path) as temporary, open(temporary, "wb") as stream:
        for tile in finished.tiles:
            rows = tile.rows.read(0, tile.rows.rows)
            np.column_stack([rows[axis] for axis in "xyz"]).tofile(stream)
    return path
