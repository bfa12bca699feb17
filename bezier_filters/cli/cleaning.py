"""The command that cleans a scan: it fills the holes, then removes the noise."""

from pathlib import Path
from typing import Annotated, Any

import typer

import bezier_filters as bf
from bezier_filters.cli import console
from bezier_filters.cli.app import (
    Json,
    Overwrite,
    Quiet,
    Skip,
    Source,
    Target,
    Verbose,
    app,
    check_target,
    end_with_remarks,
    examples,
    options,
)
from bezier_filters.cli.option_checks import check_options
from bezier_filters.cli.pages import check_page, write_page
from bezier_filters.parameters import FILLING, REPAIR, RUN, SMOOTHING
from bezier_filters.runtime.file_names import printable_name, printable_path, user_path

_FILLING = ("maxholesize", "maxperimeter", "maxdiameter", "outerrims", "intersecting", "trim")
_SMOOTHING = ("noise", "detail")
CLEANING = (
    *(item for item in FILLING if item.name in _FILLING),
    *(item for item in SMOOTHING if item.name in _SMOOTHING),
    *REPAIR,
    *RUN,
)


@app.command(epilog=examples("clean scan.ply cleaned.ply", "clean scan.ply cleaned.ply --report page.html"))
@options(*CLEANING)
def clean(
    source: Source,
    target: Target,
    *,
    page: Annotated[
        Path | None,
        typer.Option("--report", help="Page on the mesh before and after, as of `report`.", metavar="PAGE.html"),
    ] = None,
    skip: Skip = False,
    overwrite: Overwrite = False,
    verbose: Verbose = False,
    quiet: Quiet = False,
    json: Json = False,
    **given: Any,
) -> None:
    """Clean a scan: fill its holes, then remove its noise.

    It is fill-holes and then smooth; of a point cloud, smooth alone. Holes come first: a fill continues the surface
    below the noise, and smoothing then treats the rims like all other vertices. The outer rim of an open sheet stays,
    unless --outer-rims. Old vertices and faces come first, in their order.
    """
    from bezier_filters.meshlab.save_formats import format_of

    check_target(target, source, overwrite=overwrite)
    format_of(target)
    check_options(CLEANING, given)
    if page is not None:
        check_page(page)
        check_target(page, source, target, overwrite=overwrite)
    shared = {name: given[name] for name in ("noise", "threads")}
    with console.stages(quiet=quiet or json) as stage:
        stage(f"reading {printable_name(source)}")
        ms = bf.load_mesh(source, skip=skip)
        filled: dict[str, Any] = {}
        if ms.current_mesh().face_number():  # a point cloud has no holes
            filling = {name: given[name] for name in (*_FILLING, "repair")}
            filled = bf.meshing_close_holes_by_bezier_patch(
                ms, progress=stage(f"filling {printable_name(source)}"), **filling, **shared
            )
        smoothed = bf.apply_coord_bezier_patch_smoothing(
            ms, progress=stage(f"smoothing {printable_name(source)}"), detail=given["detail"], **shared
        )
        if page is not None:  # before the mesh, which may replace the source
            write_page(source, page, stage, cleaned=target, skip=skip)
        stage(f"writing {printable_name(target)}")
        remarks = bf.save_mesh(ms, target, compact=True)
    report = {name: filled.get(name, []) + smoothed[name] for name in ("remarks", "warnings")}
    if json:
        shown = None if page is None else user_path(page)
        paths = {"input": user_path(source), "output": user_path(target), "page": shown}
        console.print_json(paths | {"fill": filled, "smooth": smoothed} | report)
    elif not quiet:
        if filled:
            console.print_holes(filled, printable_path(source), verbose=verbose)
        console.print_smoothing(smoothed, printable_path(source), verbose=verbose)
        seconds = {"fill": sum(filled.get("seconds", {}).values()), "smooth": sum(smoothed["seconds"].values())}
        console.print_written({"seconds": seconds}, printable_path(target))
        if page is not None:
            console.out().print(f"wrote [bold]{console.escape(printable_path(page))}[/]; open it in a browser")
        console.print_outcome(filled)
        console.print_outcome(smoothed)
    for remark in remarks:
        console.err().print(f"note: {printable_name(target)} is {remark}", markup=False)
    end_with_remarks(printable_path(target), report)
