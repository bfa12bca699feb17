"""The command that bakes images over the texture coordinates of a mesh."""

from pathlib import Path
from typing import Annotated, Any

import typer

import bezier_filters as bf  # which loads what it has when it is used
from bezier_filters.cli import console
from bezier_filters.cli.app import (
    Json,
    MeshSource,
    Overwrite,
    Quiet,
    Skip,
    app,
    check_target,
    end_with_remarks,
    examples,
    options,
    parse_path,
    pipe_callback,
)
from bezier_filters.cli.option_checks import check_options
from bezier_filters.fields import BAKE
from bezier_filters.parameters import PARAMETERS
from bezier_filters.runtime.file_names import printable_name, printable_path, user_path

TextureFile = Annotated[
    Path,
    typer.Argument(
        help="PNG file to write, or - for the standard output.",
        metavar="IMAGE.png",
        parser=parse_path,
        callback=pipe_callback(".png"),
    ),
]


@app.command(
    epilog=examples(
        "bake textured.obj curvature.png --size 2048",
        "bake textured.obj cavity.png --map cavity --scale 1%",
        "bake textured.obj normals.png --map normal --bits 8",
    )
)
@options(*PARAMETERS[BAKE])
def bake(
    source: MeshSource,
    target: TextureFile,
    *,
    skip: Skip = False,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
    json: Json = False,
    **given: Any,
) -> None:
    """Bake a curvature, cavity, convexity or normal map.

    It is an image over the texture coordinates of the mesh.     Grey maps are linear data. In a curvature map mid grey
    is flat, white convex and black concave; a cavity map is white except where concave, a convexity map black except
    where convex. A normal map, in tangent space, makes a coarse mesh look like the smooth surface that is fitted to it.
    Charts are padded against seams.
    """
    from bezier_filters.files.texture_files import check_texture_file

    check_texture_file(target, given["bits"])
    check_target(target, source, overwrite=overwrite)
    check_options(PARAMETERS[BAKE], given)
    with console.stages(quiet=quiet or json) as stage:
        stage(f"reading {printable_name(source)}")
        ms = bf.load_mesh(source, skip=skip)
        progress = stage(f"baking {printable_name(source)}")
        report = bf.compute_texmap_by_bezier_patch(ms, textname=str(target), progress=progress, **given)
    if json:
        paths = {"input": user_path(source), "output": user_path(target)}
        console.print_json(paths | report | {"texture": user_path(target)})
    elif not quiet:
        console.print_texture(report, printable_path(source))
        console.print_written(report, printable_path(target))
        console.print_outcome(report)
    end_with_remarks(printable_path(target), report)
