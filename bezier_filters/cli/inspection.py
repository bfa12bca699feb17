"""The commands that measure meshes: against a reference, and their surfaces."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import bezier_filters as bf  # which loads what it has when it is used
from bezier_filters.cli import console
from bezier_filters.cli.app import (
    Front,
    Json,
    MeshSource,
    Overwrite,
    Quiet,
    Skip,
    Source,
    Up,
    app,
    check_target,
    end_with_remarks,
    examples,
    options,
    parse_path,
    pipe_callback,
)
from bezier_filters.cli.option_checks import check_options, check_picture_options
from bezier_filters.cli.pages import check_page, write_deviation_page
from bezier_filters.fields import DEVIATION, MEASURES, qualities
from bezier_filters.parameters import PARAMETERS
from bezier_filters.runtime.file_names import printable_name, printable_path, user_path

if TYPE_CHECKING:
    from bezier_filters.arrays import Report

Output = Annotated[
    Path | None,
    typer.Option(
        "--out",
        "-o",
        help="Mesh to write with the deviations, or - for the standard output. PLY, VTP, VTU and NPZ keep all fields.",
        metavar="OUTPUT",
        parser=parse_path,
        callback=pipe_callback(".ply"),
    ),
]


@app.command(
    epilog=examples(
        "compare scan.ply model.ply -o deviation.ply --tolerance 0.05 --reference-noise 0",
        "compare scan.ply earlier.ply -o deviation.ply --picture deviation.png --report deviation.html",
        "compare points.ply model.ply --json",
    )
)
@options(*PARAMETERS[DEVIATION])
def compare(
    source: Source,
    reference: Annotated[
        Path, typer.Argument(help="Mesh whose surface is the reference.", metavar="REFERENCE", parser=parse_path)
    ],
    *,
    target: Output = None,
    picture: Annotated[
        Path | None, typer.Option(help="Picture with the mesh, its colours and a histogram.", metavar="PICTURE.png")
    ] = None,
    view: Annotated[
        list[str] | None, typer.Option(help="View of the picture: front, back, left, ...; may be repeated.")
    ] = None,
    up: Up = "auto",
    front: Front = "auto",
    page: Annotated[
        Path | None, typer.Option("--report", help="Page with the mesh and its deviations.", metavar="PAGE.html")
    ] = None,
    skip: Skip = False,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
    json: Json = False,
    **given: Any,
) -> None:
    """Compare a mesh or point cloud with a reference surface.

    Distances are signed, and the report says what of them is noise. Both must be in the same position: nothing is
    registered. The distance is that of the fitted surface of the mesh from the fitted surface of the reference,
    positive outside, with a standard error from the noise of both. Shallow defects, lower than the noise, show in means
    over regions. Colours are green within the tolerance.
    """
    from bezier_filters.meshlab.meshset import Mesh, read_current_mesh
    from bezier_filters.meshlab.save_formats import format_of
    from bezier_filters.pictures.render import check_picture

    files = [source, reference]
    if page is not None:
        check_page(page)
    for path in filter(None, (target, picture, page)):
        check_target(path, *files, overwrite=overwrite)
    if target is not None:
        format_of(target)
    if picture is not None:
        check_picture(picture)
    check_options(PARAMETERS[DEVIATION], given)
    check_picture_options(views=view, up=up, front=front)
    with console.stages(quiet=quiet or json) as stage:
        stage(f"reading {printable_name(reference)}")
        loaded = read_current_mesh(bf.load_mesh(reference, skip=skip))
        stage(f"reading {printable_name(source)}")
        ms = bf.load_mesh(source, skip=skip)
        ms.add_mesh(Mesh(loaded.vertices, loaded.faces), "reference", set_as_current=False)
        given["color"] |= target is not None
        progress = stage(f"comparing {printable_name(source)}")
        report = bf.compute_deviation_by_bezier_patch_per_vertex(ms, progress=progress, **given)
        remarks: Sequence[str] = ()
        if target is not None:
            stage(f"writing {printable_name(target)}")
            remarks = bf.save_mesh(ms, target, compact=True)
        if picture is not None:
            from bezier_filters.pictures.deviation_picture import deviation_panel
            from bezier_filters.pictures.views import file_up

            stage(f"drawing {printable_name(picture)}")
            title = f"{printable_name(source)}, compared with {printable_name(reference)}"
            panel = replace(deviation_panel(ms, report, title), file_up=file_up(source))
            bf.render_panels(picture, [panel], views=view or ["front", "back"], up=up, front=front)
        if page is not None:
            stage(f"writing {printable_name(page)}")
            write_deviation_page(source, page, ms, report, printable_name(reference), up=up, front=front)
    if json:
        paths = {"input": source, "reference": reference, "output": target, "picture": picture, "page": page}
        console.print_json({name: path and user_path(path) for name, path in paths.items()} | report)
    elif not quiet:
        _print(report, source, target, picture, page)
    for remark in remarks:
        console.err().print(f"note: {printable_name(target or source)} is {remark}", markup=False)
    end_with_remarks(printable_path(target or source), report)


def _print(report: "Report", source: Path, target: Path | None, *pictures: Path | None) -> None:
    console.print_deviation(report, printable_path(source))
    if report["statistics"]:
        console.print_statistics(report, qualities(DEVIATION)[report["quality"]].label)
    if target is not None:
        console.print_written(report, printable_path(target))
    for path in filter(None, pictures):
        console.out().print(f"wrote [bold]{console.escape(printable_path(path))}[/]")
    console.print_outcome(report)


@app.command(epilog=examples("measure scan.ply", "measure scan.ply --repeats 0 --json"))
@options(*PARAMETERS[MEASURES])
def measure(source: MeshSource, *, skip: Skip = False, quiet: Quiet = False, json: Json = False, **given: Any) -> None:
    """Measure area, volume, total curvatures and bending energies.

    They are those of the surface that is fitted to a mesh. Standard errors and biases come from fits with new noise of
    the learned strength. The theorem of Gauss and Bonnet checks the total Gaussian curvature.
    """
    check_options(PARAMETERS[MEASURES], given)
    with console.stages(quiet=quiet or json) as stage:
        stage(f"reading {printable_name(source)}")
        ms = bf.load_mesh(source, skip=skip)
        progress = stage(f"measuring {printable_name(source)}")
        report = bf.get_surface_measures_by_bezier_patch(ms, progress=progress, **given)
    if json:
        console.print_json({"input": user_path(source), **report})
    elif not quiet:
        console.print_measures(report, printable_path(source))
    end_with_remarks(printable_path(source), report)
