"""The commands that run filters on a file and write another one."""

import inspect
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated, Any

import typer

import bezier_filters as bf  # which loads what it has when it is used
from bezier_filters.cli import console
from bezier_filters.cli.app import (
    Front,
    Json,
    MeshSource,
    Overwrite,
    Quiet,
    SaveScript,
    Skip,
    Source,
    Target,
    Up,
    Verbose,
    app,
    check_target,
    end_with_remarks,
    examples,
    options,
    parse_path,
    pipe_callback,
)
from bezier_filters.cli.option_checks import check_options, check_picture_options
from bezier_filters.cli.pages import check_page, write_line_page
from bezier_filters.fields import qualities
from bezier_filters.parameters import COLORS, PARAMETERS, Parameter
from bezier_filters.runtime.file_names import printable_name, printable_path, user_path

_COLOR = COLORS[0]
_COLORED = replace(_COLOR, default=True)  # as commands do whose filters have a quality anyway
Lines = Annotated[
    Path,
    typer.Argument(
        help="Lines to write, a PLY, OBJ or VTP file, or - for the standard output.",
        metavar="LINES.ply",
        parser=parse_path,
        callback=pipe_callback(".ply"),
    ),
]
Picture = Annotated[Path | None, typer.Option(help="PNG file with the mesh and its lines.", metavar="PICTURE.png")]
PictureView = Annotated[
    list[str] | None, typer.Option(help="View of the picture: front, back, left, ...; may be repeated.")
]


def filter_command(
    name: str,
    filter_name: str,
    *,
    color: Parameter = _COLORED,
    verb: str = "fitting",
    show: Callable[..., None] = console.print_status,
) -> Callable[[Callable[[], None]], Callable[[], None]]:
    """Add a command that loads a mesh, runs a filter of the package, saves and reports.

    The docstring of the decorated function is its help; the filter's parameters are its options, with a different
    default for colours. The verb is for the progress bar; `show` prints the report, given it, the source and `verbose`.
    """

    def add(described: Callable[[], None]) -> Callable[[], None]:
        text, *lines = (inspect.getdoc(described) or "").split("\nExample: bezier-filters ")

        @app.command(name, help=text, epilog=examples(*lines))
        @options(*(color if item == _COLOR else item for item in PARAMETERS[name]))
        def command(
            source: Source,
            target: Target,
            *,
            save_script: SaveScript = None,
            skip: Skip = False,
            overwrite: Overwrite = False,
            verbose: Verbose = False,
            quiet: Quiet = False,
            json: Json = False,
            **given: object,
        ) -> None:
            from bezier_filters.meshlab.save_formats import FIELD_SUFFIXES, format_of

            check_target(target, source, overwrite=overwrite)
            if save_script is not None:  # a step is added to one that is there
                check_target(save_script, source, target, overwrite=overwrite)
            suffix = format_of(target)
            check_options(PARAMETERS[name], given)
            with console.stages(quiet=quiet or json) as stage:
                stage(f"reading {printable_name(source)}")
                ms = bf.load_mesh(source, skip=skip)
                report = getattr(bf, filter_name)(ms, progress=stage(f"{verb} {printable_name(source)}"), **given)
                stage(f"writing {printable_name(target)}")
                remarks = bf.save_mesh(ms, target, compact=True)
            if save_script is not None:
                _add_step(save_script, filter_name, given)
            if json:
                console.print_json({"input": user_path(source), "output": user_path(target), **report})
            elif not quiet:
                show(report, printable_path(source), verbose=verbose)
                if report.get("statistics"):
                    console.print_statistics(report, qualities(name)[report["quality"]].label)
                console.print_written(report, printable_path(target))
                console.print_outcome(report)
            for remark in remarks:
                console.err().print(f"note: {printable_name(target)} is {remark}", markup=False)
            if report.get("quality") and suffix not in FIELD_SUFFIXES:
                console.err().print(
                    f"note: {target.suffix} files hold no quality and no bz_* columns; write a PLY, VTP, VTU, CSV "
                    "or NPZ file to keep them"
                )
            end_with_remarks(printable_path(target), report)

        return described

    return add


def _add_step(script: Path, name: str, given: dict[str, object]) -> None:
    """Append a step to a filter script, without the number of threads, which depends on the machine."""
    before = bf.read_filter_script(script) if script.exists() else []
    bf.save_filter_script(script, [*before, bf.script_step(name, **(given | {"threads": None}))])


@filter_command("normals", "compute_normal_by_bezier_patch_per_vertex")
def normals() -> None:
    """Set the vertex normals to those of the fitted patches.

    The quality becomes the angle to the old normals in degrees, or a component of the new ones. Neighbourhood, degree
    and weights are chosen from the data unless they are given. PLY files keep the normals, the quality, the colours and
    columns bz_*: the components, their standard error in radians, and how every fit went.

    Example: bezier-filters normals scan.ply smooth_normals.ply
    Example: bezier-filters normals points.ply oriented.ply --quality z
    Example: bezier-filters normals points.ply oriented.ply --viewpoint 0 0 1.8 --neighbours 30
    """


@filter_command("curvature", "compute_curvature_by_bezier_patch_per_vertex")
def curvature() -> None:
    """Compute curvatures; one of them becomes the quality.

    They are the mean, Gaussian and principal curvatures, with the principal directions. Curvature is positive where the
    surface is convex, in 1/length; Gaussian curvature is in 1/length^2. Neighbourhood, degree and weights are chosen
    from the data unless they are given. PLY files keep all of it in columns bz_*, with standard errors and how every
    fit went; other formats keep the colours.

    Example: bezier-filters curvature bunny.ply curved.ply --quality gaussian --colormap 'French RGB'
    Example: bezier-filters curvature scan.ply curved.ply --radius 2% --range -20 20 --json
    Example: bezier-filters curvature scan.ply curved.ply --direction 0 0 -1 --quality along
    """


@filter_command("torsion", "compute_torsion_by_bezier_patch_per_vertex")
def torsion() -> None:
    """Set the quality to the principal geodesic torsion.

    It is (k_max - k_min) / 2, the largest torsion of geodesics, in 1/length; PLY files keep its two directions in
    columns bz_*, and how every fit went. With --colormap Paper it is red where high, blue where medium and green where
    low.

    Example: bezier-filters torsion bunny.ply twisted.ply
    Example: bezier-filters torsion bunny.ply twisted.ply --colormap Paper
    """


@filter_command(
    "smooth",
    "apply_coord_bezier_patch_smoothing",
    color=replace(_COLOR, help="Colour all vertices by the quality; needs one."),
    verb="smoothing",
    show=console.print_smoothing,
)
def smooth() -> None:
    """Remove noise and keep the shape, the volume and the edges.

    The noise is learned from the mesh; a clean mesh does not change. Vertices keep their order and the faces stay. The
    report has the noise before and after, the displacements and the change of the volume.

    Example: bezier-filters smooth scan.ply clean.ply
    Example: bezier-filters smooth scan.ply clean.ply --quality displacement --color
    """


@filter_command("fill-holes", "meshing_close_holes_by_bezier_patch", verb="filling", show=console.print_holes)
def fill_holes() -> None:
    """Fill holes smoothly, and continue sharp edges through them.

    Old vertices and faces come first, unchanged, and new ones after them. A hole is filled completely or left open, and
    the report says for each how it was filled, or why not. The border of an open sheet is no hole, unless --outer-rims.

    Example: bezier-filters fill-holes scan.ply closed.ply --max-edges 300
    Example: bezier-filters fill-holes scan.ply closed.ply --max-diameter 10%
    """


@filter_command(
    "replace", "meshing_replace_selection_by_bezier_patch", verb="replacing", show=console.print_replacements
)
def replace_faces() -> None:
    """Replace selected faces by the continuation of the surface.

    They may be a bump, a scar, or the mark of a support. They satisfy a condition, or are selected in the file: MeshLab
    saves the selection in PLY files, as flags. The report has the volume and the height that were removed. A part of
    the selection that cannot be replaced stays as it is, and the report says why.

    Example: bezier-filters replace scan.ply clean.ply --where 'abs(x0) < 0.1 && abs(y0) < 0.1'
    """


@filter_command("bridge", "meshing_bridge_holes_by_bezier_patch", verb="bridging", show=console.print_bridges)
def bridge() -> None:
    """Join pairs of holes by bands of faces.

    Such are a gap around a tube, two halves of a body, or the missing wall of a bolt hole. A band continues the surface
    on both sides, and is straight where the surface ends at an angle. All other holes stay open. The report lists the
    holes with the numbers that --pairs takes, such as '1 2, 3 4'.

    Example: bezier-filters bridge scan.ply joined.ply
    """


@filter_command(
    "subdivide",
    "meshing_surface_subdivision_by_bezier_patch",
    verb="subdividing",
    show=console.print_remeshing,
)
def subdivide() -> None:
    """Make a mesh finer, with new vertices on the curved surface.

    The surface is that of the patches. Every face becomes four, or only edges are split that are farther from the
    surface than a tolerance. Sharp edges stay sharp. The vertices of a clean mesh stay; those of a noisy one move onto
    the surface, which is free of noise.

    Example: bezier-filters subdivide scan.ply fine.ply --iterations 2
    Example: bezier-filters subdivide scan.ply fine.ply --tolerance 0.01%
    """


@filter_command("remesh", "meshing_remeshing_by_bezier_patch", verb="remeshing", show=console.print_remeshing)
def remesh() -> None:
    """Make regular triangles with vertices on the curved surface.

    The surface is that of the patches. Edges have one length, or a length that follows from the curvature and a
    tolerance, which also decimates a mesh. Sharp edges, borders and seams of textures stay, and the new vertices are
    free of noise.

    Example: bezier-filters remesh scan.ply even.ply --vertex-count 20000
    Example: bezier-filters remesh scan.ply light.ply --tolerance 0.05%
    """


@app.command(epilog="Example: bezier-filters creases scan.ply lines.ply --picture creases.png")
@options(*PARAMETERS["creases"])
def creases(
    source: MeshSource,
    target: Lines,
    *,
    picture: Picture = None,
    view: PictureView = None,
    up: Up = "auto",
    front: Front = "auto",
    skip: Skip = False,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
    json: Json = False,
    **given: Any,
) -> None:
    """Find sharp edges, ridges and ravines, and write them as lines."""
    from bezier_filters.files.ply_text import check_line_file, save_lines
    from bezier_filters.meshlab.crease_filter import creases_of, lines_as_mesh, report_of
    from bezier_filters.meshlab.meshset import read_current_mesh
    from bezier_filters.meshlab.vertex_filters import FitArguments
    from bezier_filters.pictures.render import check_picture
    from bezier_filters.runtime.compile_time import clock_without_compilation

    check_line_file(target)
    check_target(target, source, overwrite=overwrite)
    if picture is not None:
        check_picture(picture)
        check_target(picture, source, overwrite=overwrite)
    check_picture_options(views=view, up=up, front=front)
    angle, strength = given.pop("angle"), given.pop("minstrength")
    check_options(PARAMETERS["creases"], given)
    with console.stages(quiet=quiet or json) as stage:
        stage(f"reading {printable_name(source)}")
        mesh = read_current_mesh(bf.load_mesh(source, skip=skip))
        begin = clock_without_compilation()
        found = creases_of(
            mesh, FitArguments(**given, progress=stage(f"fitting {printable_name(source)}")), angle, strength
        )
        seconds = clock_without_compilation() - begin
        stage(f"writing {printable_name(target)}")
        save_lines(target, *lines_as_mesh(found))
        if picture is not None:
            from bezier_filters.pictures.field_panels import crease_panel
            from bezier_filters.pictures.views import file_up

            stage(f"drawing {printable_name(picture)}")
            panel = crease_panel(mesh.vertices, mesh.faces, found, title=printable_name(source))
            panel = replace(panel, file_up=file_up(source))
            bf.render_panels(picture, [panel], views=view or ["front", "back"], up=up, front=front)
    report = report_of(found, mesh) | {"seconds": {"fit": seconds}}
    if json:
        shown = None if picture is None else user_path(picture)
        console.print_json({"input": user_path(source), "output": user_path(target), "picture": shown, **report})
    elif not quiet:
        console.print_creases(report, printable_path(source))
        console.print_written(report, printable_path(target))
        if picture is not None:
            console.out().print(f"wrote [bold]{console.escape(printable_path(picture))}[/]")
        console.print_outcome(report)
    end_with_remarks(printable_path(target), report)


@app.command(
    epilog=examples(
        "lines scan.ply lines.vtp --family curvature --spacing 2% --picture lines.png",
        "lines scan.ply lines.ply --family torsion --seeds '0.1 0 0.2, 0.1 0.1 0.2'",
    )
)
@options(*PARAMETERS["lines"])
def lines(
    source: MeshSource,
    target: Lines,
    *,
    picture: Picture = None,
    page: Annotated[
        Path | None, typer.Option("--report", help="Page with the mesh and its lines.", metavar="PAGE.html")
    ] = None,
    view: PictureView = None,
    up: Up = "auto",
    front: Front = "auto",
    skip: Skip = False,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
    json: Json = False,
    **given: Any,
) -> None:
    """Trace lines of curvature or torsion on the surface.

    Other families are asymptotic lines and lines of a given normal curvature. They lie on the surface of the fitted
    patches, evenly spaced, and end where the direction is not known: at umbilics, on planes and in noise. VTP and PLY
    files have the normal curvature, the geodesic torsion and the standard error of the direction at every point in
    columns bz_*. Rings mark umbilics; bz_umbilic_index has their index.
    """
    from bezier_filters.files.ply_text import check_line_file, save_lines
    from bezier_filters.meshlab.line_filter import LineArguments, lines_as_mesh, lines_of, report_of
    from bezier_filters.meshlab.meshset import read_current_mesh
    from bezier_filters.pictures.render import check_picture
    from bezier_filters.runtime.compile_time import clock_without_compilation

    check_line_file(target)
    check_target(target, source, overwrite=overwrite)
    if picture is not None:
        check_picture(picture)
        check_target(picture, source, overwrite=overwrite)
    if page is not None:
        check_page(page)
        check_target(page, source, overwrite=overwrite)
    check_picture_options(views=view, up=up, front=front)
    check_options(PARAMETERS["lines"], given)
    with console.stages(quiet=quiet or json) as stage:
        stage(f"reading {printable_name(source)}")
        mesh = read_current_mesh(bf.load_mesh(source, skip=skip))
        begin = clock_without_compilation()
        progress = stage(f"tracing lines on {printable_name(source)}")
        found, geometry, fitted = lines_of(mesh, LineArguments(**given, progress=progress))
        traced = clock_without_compilation()
        stage(f"writing {printable_name(target)}")
        save_lines(target, *lines_as_mesh(found))
        if picture is not None:
            from bezier_filters.pictures.line_panels import line_panel
            from bezier_filters.pictures.views import file_up

            stage(f"drawing {printable_name(picture)}")
            panel = line_panel(mesh.vertices, mesh.faces, found, title=printable_name(source))
            panel = replace(panel, file_up=file_up(source))
            bf.render_panels(picture, [panel], views=view or ["front", "back"], up=up, front=front)
        if page is not None:
            stage(f"writing {printable_name(page)}")
            write_line_page(source, page, mesh, found, up=up, front=front)
    report = report_of(found, geometry, mesh) | {"seconds": {"fit": fitted - begin, "trace": traced - fitted}}
    if json:
        paths = {"input": source, "output": target, "picture": picture, "page": page}
        console.print_json({name: path and user_path(path) for name, path in paths.items()} | report)
    elif not quiet:
        console.print_lines(report, printable_path(source))
        console.print_written(report, printable_path(target))
        for path in filter(None, (picture, page)):
            console.out().print(f"wrote [bold]{console.escape(printable_path(path))}[/]")
        console.print_outcome(report)
    end_with_remarks(printable_path(target), report)


@app.command(epilog="Example: bezier-filters run repair.mlx scan.ply clean.ply")
def run(
    script: Annotated[Path, typer.Argument(help="Filter script to run.", metavar="SCRIPT.mlx")],
    source: Source,
    target: Target,
    skip: Skip = False,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Run a MeshLab filter script.

    Its steps may be MeshLab's filters and those of this package. A script is the .mlx file that MeshLab and pymeshlab
    save, or --save-script of the other commands. The name of a step is MeshLab's, pymeshlab's, or one of this package,
    such as compute_curvature_by_bezier_patch_per_vertex. Names are checked before the first step runs; the output is
    written after the last.
    """
    from bezier_filters.meshlab.save_formats import format_of
    from bezier_filters.meshlab.scripts import check_steps

    steps = bf.read_filter_script(script)
    names = check_steps(steps)
    format_of(target)
    check_target(target, source, script, overwrite=overwrite)
    with console.stages(quiet=quiet or json) as stage:
        stage(f"reading {printable_name(source)}")
        ms = bf.load_mesh(source, skip=skip)
        done = bf.run_filter_script(ms, steps, progress=stage(printable_name(script)))
        stage(f"writing {printable_name(target)}")
        remarks = bf.save_mesh(ms, target, compact=True)
    for remark in remarks:
        console.err().print(f"note: {printable_name(target)} is {remark}", markup=False)
    if json:
        summary = {"script": user_path(script), "input": user_path(source), "output": user_path(target)}
        console.print_json(summary | {"steps": [asdict(report) for report in done]})
    elif not quiet:
        width = max(map(len, names), default=0)
        for report in done:
            console.out().print(f"{report.filter:<{width}}  {report.by:<14}  {report.seconds:7.2f} s", markup=False)
        console.print_written({"seconds": dict(enumerate(report.seconds for report in done))}, printable_path(target))
    found = [report.report for report in done]
    notes = {key: [text for report in found for text in report.get(key, [])] for key in ("remarks", "warnings")}
    end_with_remarks(printable_path(target), notes)
