"""The commands that show the fields of files: as a picture, in a window, or in MeshLab."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bezier_filters.cli import console
from bezier_filters.cli.app import (
    ColorRange,
    Front,
    Json,
    Overwrite,
    Percentile,
    Quiet,
    Skip,
    Source,
    Up,
    app,
    check_target,
    examples,
    parse_path,
    pipe_callback,
    read_pipes,
)
from bezier_filters.cli.option_checks import check_colors, check_picture_options
from bezier_filters.display import ColorScale
from bezier_filters.runtime.file_names import printable_name, printable_path, user_path

if TYPE_CHECKING:
    from bezier_filters.pictures.field_panels import MeshFile

Sources = Annotated[
    list[Path],
    typer.Argument(
        help="Meshes side by side, for example before and after; - is the standard input.",
        metavar="MESH",
        parser=parse_path,
        callback=read_pipes,
    ),
]


def _picture(context: typer.Context, path: Path) -> Path:
    from bezier_filters.pictures.render import check_picture

    path = pipe_callback(".png")(context, path) or path
    check_picture(path)
    return path


Picture = Annotated[
    Path,
    typer.Argument(
        help="Picture to write: .png, .jpg, .svg or .pdf; - is a PNG on the standard output.",
        metavar="PICTURE.png",
        parser=parse_path,
        callback=_picture,
        is_eager=True,  # where only a mesh is given, the picture is missing
    ),
]
FieldNames = Annotated[
    list[str] | None,
    typer.Option(
        "--field",
        help="quality, color, shape (grey) or a bz_* column; may be repeated. The quality by default, if there is one.",
    ),
]
PictureColors = Annotated[
    str,
    typer.Option(help="auto (Cool Warm or Viridis), Paper, Paper Curvature, or a map of matplotlib: RdBu_r, ..."),
]
Scale = Annotated[ColorScale, typer.Option(help="symlog is logarithmic both ways from zero, for values of all sizes.")]


def _read(source: Path, stage: console.Stage, *, skip: bool) -> "MeshFile":
    from bezier_filters.pictures.field_panels import read_mesh_file

    stage(f"reading {printable_name(source)}")
    return read_mesh_file(source, skip=skip)


@app.command(
    epilog=examples(
        "render curved.ply curved.png --field quality --field bz_shape_index --histogram",
        "render scan.ply clean.ply both.png --view iso",
        "render curved.ply lines.png --field shape --directions",
    )
)
def render(
    sources: Sources,
    picture: Picture,
    field: FieldNames = None,
    view: Annotated[
        list[str] | None, typer.Option(help="front, back, left, right, top, bottom or iso; may be repeated.")
    ] = None,
    colormap: PictureColors = "auto",
    percentile: Percentile = 2.0,
    limits: ColorRange = None,
    scale: Scale = "linear",
    histogram: Annotated[bool, typer.Option("--histogram", help="Draw a histogram above every colour bar.")] = False,
    directions: Annotated[
        bool, typer.Option("--directions", help="Draw lines along the principal directions, where these are certain.")
    ] = False,
    size: Annotated[int, typer.Option(help="Largest side of one image in pixels.", min=50, max=4000)] = 600,
    dpi: Annotated[float, typer.Option(help="Pixels per inch, stored in the file.", min=1)] = 100,
    up: Up = "auto",
    front: Front = "auto",
    skip: Skip = False,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Draw meshes with their fields as a picture with colour bars.

    It needs no display.     One mesh has a column for every field. Several have a column each and a row for every
    field, with the same colours for the same quantity; a mesh that lacks the field is grey.
    """
    from bezier_filters.pictures.field_panels import add_directions, default_field, field_panels
    from bezier_filters.pictures.render import render_panels

    check_target(picture, *sources, overwrite=overwrite)
    check_picture_options(views=view, up=up, front=front, colormap=colormap, percentile=percentile, limits=limits)
    with console.stages(quiet=quiet or json) as stage:
        files = [_read(source, stage, skip=skip) for source in sources]
        stage(f"drawing {printable_name(picture)}")
        fields, views = field or [default_field(files)], view or ["front", "back"]
        panels, shown, colors = [], [], (colormap, percentile, limits, scale)
        for name in fields:
            row = field_panels(files, name, *colors, histogram=histogram)
            if directions:
                row = [add_directions(panel, file) for panel, file in zip(row, files, strict=True)]
            panels += row
            legend = next((panel for panel in row if panel.values is not None), row[0])
            shown.append({"field": name, "label": legend.label, "unit": legend.unit, "limits": legend.limits})
        columns = len(files) if len(files) > 1 else None
        title = printable_name(sources[0]) if len(files) == 1 else None
        render_panels(
            picture, panels, views=views, columns=columns, size=(size, size), title=title, up=up, front=front, dpi=dpi
        )
    if json:
        inputs = [user_path(source) for source in sources]
        console.print_json({"inputs": inputs, "output": user_path(picture), "views": views, "panels": shown})
    elif not quiet:
        console.out().print(f"wrote [bold]{console.escape(printable_path(picture))}[/]")


@app.command(epilog=examples("view curved.ply --field quality --field bz_shape_index"))
def view(
    sources: Sources,
    field: FieldNames = None,
    colormap: PictureColors = "auto",
    percentile: Percentile = 2.0,
    limits: ColorRange = None,
    scale: Scale = "linear",
    up: Up = "auto",
    front: Front = "auto",
    skip: Skip = False,
) -> None:
    """Show meshes with their fields in a window.

    Turn them with the mouse; q closes the window. It needs a display.
    """
    from bezier_filters.pictures.field_panels import default_field, field_panels
    from bezier_filters.pictures.scene import check_display, show_panels
    from bezier_filters.runtime.supervision import restore_default_interrupts

    check_picture_options(up=up, front=front, colormap=colormap, percentile=percentile, limits=limits)
    check_display()
    with console.stages(quiet=False) as stage:
        files = [_read(source, stage, skip=skip) for source in sources]
    panels, colors = [], (colormap, percentile, limits, scale)
    for name in field or [default_field(files)]:
        panels += field_panels(files, name, *colors)
    restore_default_interrupts()
    show_panels(panels, columns=len(files) if len(files) > 1 else None, up=up, front=front)


@app.command(epilog=examples("qmap curved.ply curved.qmap --field bz_k_max"))
def qmap(
    source: Source,
    target: Annotated[Path, typer.Argument(help="Quality mapper file to write.", metavar="OUTPUT.qmap")],
    field: Annotated[str, typer.Option(help="Field whose range is taken: quality or a bz_* column.")] = "quality",
    colormap: Annotated[
        str,
        typer.Option(help="auto (Cool Warm or Viridis), Paper, Paper Curvature, or a map of pymeshlab: Turbo, ..."),
    ] = "auto",
    percentile: Percentile = 2.0,
    limits: ColorRange = None,
    skip: Skip = False,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Write a colour map for MeshLab's Quality Mapper.

    It has the range of the values; the Load button there opens it.
    """
    from bezier_filters.display import AUTO, default_colormap
    from bezier_filters.meshlab.mesh_colors import save_quality_map
    from bezier_filters.pictures.field_panels import check_field, field_limits

    check_target(target, source, overwrite=overwrite)
    check_colors({"colormap": colormap, "percentile": percentile} | ({"colorrange": limits} if limits else {}))
    with console.stages(quiet=quiet or json) as stage:
        files = [_read(source, stage, skip=skip)]
    check_field(files, field)
    shown = files[0].field(field)
    if shown is None:
        raise typer.BadParameter(f"{field!r} has no values; choose quality or a bz_* column")
    low, high = field_limits(files, field, percentile=percentile, limits=limits)
    name = default_colormap(signed=shown.signed) if colormap == AUTO else colormap
    save_quality_map(target, low, high, name)
    if json:
        report = {"field": field, "label": shown.label, "unit": shown.unit, "limits": [low, high], "colormap": name}
        console.print_json({"input": user_path(source), "output": user_path(target), **report})
    elif not quiet:
        console.out().print(
            f"wrote [bold]{console.escape(printable_path(target))}[/]: {name}, {low:g} to {high:g} \\[{shown.unit}]"
        )
