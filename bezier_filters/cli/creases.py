"""The command that finds creases and writes them as lines."""

from pathlib import Path
from typing import Annotated

import typer

from bezier_filters.cli import console
from bezier_filters.cli.app import app
from bezier_filters.cli.options import Alpha, Degree, Json, Quiet, Radius, Rings, Robust, Source, Threads


@app.command(epilog="Example: bezier-filters creases scan.ply lines.ply --picture creases.png")
def creases(
    source: Source,
    target: Annotated[Path, typer.Argument(help="Lines to write, a PLY or OBJ file.", metavar="LINES.ply")],
    angle: Annotated[float, typer.Option(help="Degrees between faces from which on an edge may be sharp.")] = 40.0,
    min_strength: Annotated[
        float, typer.Option(help="Leave out lines that are shorter, in radii of the curvature across them.", min=0.0)
    ] = 2.0,
    picture: Annotated[
        Path | None, typer.Option(help="PNG file with the mesh and its lines.", metavar="PICTURE.png")
    ] = None,
    view: Annotated[
        list[str] | None, typer.Option(help="View of the picture: front, back, left, ...; may be repeated.")
    ] = None,
    rings: Rings = "auto",
    radius: Radius = None,
    alpha: Alpha = "auto",
    degree: Degree = "auto",
    robust: Robust = False,
    threads: Threads = None,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Find sharp edges, ridges and ravines, and write them as lines."""
    import time

    import numpy as np

    from bezier_filters.feature_lines.crease_lines import COLORS, edge_mesh
    from bezier_filters.files.line_files import check_line_file, save_lines
    from bezier_filters.meshlab.crease_filter import creases_of, described
    from bezier_filters.meshlab.mesh_files import load_mesh
    from bezier_filters.meshlab.meshset import read_current_mesh
    from bezier_filters.meshlab.vertex_filter import FitOptions
    from bezier_filters.pictures.render import check_picture, render_panels

    check_line_file(target)
    if picture is not None:
        check_picture(picture)
    mesh = read_current_mesh(load_mesh(source))
    begin = time.perf_counter()
    with console.progress_bar(f"fitting {source.name}", quiet=quiet or json) as progress:
        fit = FitOptions(rings, radius, alpha, degree, "third_order", robust, threads, progress)
        found = creases_of(mesh, fit, angle, min_strength)
    seconds = time.perf_counter() - begin
    points, edges, line_of_point = edge_mesh(found.lines)
    strengths = np.array([line.strength for line in found.lines])[line_of_point]
    colors = np.array([COLORS[line.kind] for line in found.lines]).reshape(-1, 3)[line_of_point]
    save_lines(target, points, edges, strengths, colors)
    if picture is not None:
        from bezier_filters.pictures.field_panels import crease_panel

        panel = crease_panel(mesh.vertices, mesh.faces, found, title=source.name)
        render_panels(picture, [panel], views=view or ["front", "back"])
    report = {
        "lines": [described(line) for line in found.lines],
        "sharp_edges": len(found.sharp_edges),
        "status": found.geometry.status_counts(),
        "seconds": {"fit": seconds},
    }
    if json:
        shown = None if picture is None else str(picture)
        console.print_json({"input": str(source), "output": str(target), "picture": shown, **report})
    elif not quiet:
        console.print_creases(report, str(source))
        console.print_written(report, str(target))
        if picture is not None:
            console.out.print(f"wrote [bold]{picture}[/]")
