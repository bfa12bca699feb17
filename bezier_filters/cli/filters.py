"""The commands that run a filter on a file and write another one."""

from typing import Annotated, Any

import typer

from bezier_filters.cli import console
from bezier_filters.cli.app import app, examples
from bezier_filters.cli.files import filter_file
from bezier_filters.cli.options import (
    Alpha,
    Color,
    ColorMapName,
    ColorRange,
    Degree,
    Json,
    Percentile,
    Quiet,
    Radius,
    Rings,
    Robust,
    SaveScript,
    SmoothnessName,
    Source,
    Target,
    Threads,
    length,
)


@app.command(
    epilog=examples(
        "normals scan.ply smooth_normals.ply",
        "normals points.ply oriented.ply --quality z",
    )
)
def normals(
    source: Source,
    target: Target,
    quality: Annotated[
        str, typer.Option(help="Quality to set: angle (to the old normal, degrees), x, y or z.")
    ] = "angle",
    rings: Rings = "auto",
    radius: Radius = None,
    alpha: Alpha = "auto",
    degree: Degree = "auto",
    smoothness: SmoothnessName = "third_order",
    robust: Robust = False,
    color: Color = True,
    colormap: ColorMapName = "auto",
    percentile: Percentile = 2.0,
    color_range: ColorRange = None,
    threads: Threads = None,
    save_script: SaveScript = None,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Set the vertex normals to those of the fitted patches.

    The quality becomes the angle to the old normals in degrees, or a component of the new ones. Neighbourhood, degree
    and weights are chosen from the data unless they are given. PLY files keep the normals, the quality, the colours and
    columns bz_*: the components, their standard error in radians, and how every fit went.
    """
    from bezier_filters.meshlab.vertex_normal_filter import NORMAL_FIELDS, compute_normal_by_bezier_patch_per_vertex

    fit = {"rings": rings, "radius": radius, "alpha": alpha, "degree": degree, "smoothness": smoothness}
    colors = {"color": color, "colormap": colormap, "percentile": percentile, "colorrange": color_range}
    filter_file(
        compute_normal_by_bezier_patch_per_vertex,
        source,
        target,
        fit | colors | {"quality": quality, "robust": robust, "threads": threads},
        label=NORMAL_FIELDS[quality].label if quality in NORMAL_FIELDS else quality,
        save_script=save_script,
        quiet=quiet,
        json=json,
    )


@app.command(
    epilog=examples(
        "curvature bunny.ply curved.ply --quality gaussian --colormap 'French RGB'",
        "curvature scan.ply curved.ply --radius 2% --range -20 20 --json",
    )
)
def curvature(
    source: Source,
    target: Target,
    quality: Annotated[
        str, typer.Option(help="Quality to set: mean, gaussian, min, max, curvedness, shape_index or std.")
    ] = "mean",
    rings: Rings = "auto",
    radius: Radius = None,
    alpha: Alpha = "auto",
    degree: Degree = "auto",
    smoothness: SmoothnessName = "third_order",
    robust: Robust = False,
    color: Color = True,
    colormap: ColorMapName = "auto",
    percentile: Percentile = 2.0,
    color_range: ColorRange = None,
    threads: Threads = None,
    save_script: SaveScript = None,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Compute mean, Gaussian and principal curvatures and directions; one of them becomes the quality.

    Curvature is positive where the surface is convex, in 1/length; Gaussian curvature is in 1/length^2. Neighbourhood,
    degree and weights are chosen from the data unless they are given. PLY files keep all of it in columns bz_*, with
    standard errors and how every fit went; other formats keep the colours.
    """
    from bezier_filters.files.fields import CURVATURE_FIELDS
    from bezier_filters.meshlab.curvature_filter import compute_curvature_by_bezier_patch_per_vertex

    fit = {"rings": rings, "radius": radius, "alpha": alpha, "degree": degree, "smoothness": smoothness}
    colors = {"color": color, "colormap": colormap, "percentile": percentile, "colorrange": color_range}
    filter_file(
        compute_curvature_by_bezier_patch_per_vertex,
        source,
        target,
        fit | colors | {"quality": quality, "robust": robust, "threads": threads},
        label=CURVATURE_FIELDS[quality].label if quality in CURVATURE_FIELDS else quality,
        save_script=save_script,
        quiet=quiet,
        json=json,
    )


@app.command(
    epilog=examples(
        "torsion bunny.ply twisted.ply",
        "torsion bunny.ply twisted.ply --colormap Paper",
    )
)
def torsion(
    source: Source,
    target: Target,
    rings: Rings = "auto",
    radius: Radius = None,
    alpha: Alpha = "auto",
    degree: Degree = "auto",
    smoothness: SmoothnessName = "third_order",
    robust: Robust = False,
    color: Color = True,
    colormap: ColorMapName = "auto",
    percentile: Percentile = 2.0,
    color_range: ColorRange = None,
    threads: Threads = None,
    save_script: SaveScript = None,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Set the quality to the principal geodesic torsion (k_max - k_min) / 2.

    It is how much geodesics twist at most, in 1/length; PLY files keep the two directions of it in columns bz_*, and
    how every fit went. With --colormap Paper it is red where high, blue where medium and green where low.
    """
    from bezier_filters.files.fields import TORSION_FIELD
    from bezier_filters.meshlab.curvature_filter import compute_torsion_by_bezier_patch_per_vertex

    fit = {"rings": rings, "radius": radius, "alpha": alpha, "degree": degree, "smoothness": smoothness}
    colors = {"color": color, "colormap": colormap, "percentile": percentile, "colorrange": color_range}
    filter_file(
        compute_torsion_by_bezier_patch_per_vertex,
        source,
        target,
        fit | colors | {"robust": robust, "threads": threads},
        label=TORSION_FIELD.label,
        save_script=save_script,
        quiet=quiet,
        json=json,
    )


@app.command(
    epilog=examples(
        "smooth scan.ply clean.ply",
        "smooth scan.ply clean.ply --quality displacement --color",
    )
)
def smooth(
    source: Source,
    target: Target,
    method: Annotated[str, typer.Option(help="auto (learns what to do from the mesh) or paper.")] = "auto",
    iterations: Annotated[int, typer.Option(help="How often to smooth; with auto once is enough.", min=1)] = 1,
    noise: Annotated[
        Any,
        typer.Option(
            help="Standard deviation of the noise; learned if left out. With % of the diagonal of the bounding box.",
            parser=length,
            metavar="LENGTH|PERCENT%",
        ),
    ] = None,
    borders: Annotated[str, typer.Option(help="curve (smoothed along the border) or fixed.")] = "curve",
    keep_volume: Annotated[
        bool | None, typer.Option("--keep-volume/--no-keep-volume", help="Keep what closed parts enclose.")
    ] = None,
    rings: Annotated[int, typer.Option(help="Size of the neighbourhoods in edges; for the paper's method.")] = 2,
    alpha: Annotated[float, typer.Option(help="Weight of the points, in (0, 1]; for the paper's method.")] = 0.8,
    quality: Annotated[
        str | None, typer.Option(help="Quality to set: displacement or sharpness; the old one stays if left out.")
    ] = None,
    color: Annotated[
        bool, typer.Option("--color/--no-color", help="Colour the vertices by the quality; needs one.")
    ] = False,
    colormap: ColorMapName = "auto",
    percentile: Percentile = 2.0,
    color_range: ColorRange = None,
    threads: Threads = None,
    save_script: SaveScript = None,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Take the noise off a mesh and keep its shape, its volume and its edges.

    The noise is learned from the mesh; a clean mesh stays as it is. Vertices keep their order and the faces stay. The
    report says what the noise was and is, how far vertices moved, and what became of the volume.
    """
    from bezier_filters.meshlab.smoothing_filter import SMOOTHING_FIELDS, apply_coord_bezier_patch_smoothing

    options = {"method": method, "iterations": iterations, "noise": noise, "borders": borders}
    colors = {"color": color, "colormap": colormap, "percentile": percentile, "colorrange": color_range}
    filter_file(
        apply_coord_bezier_patch_smoothing,
        source,
        target,
        options
        | colors
        | {"keepvolume": keep_volume, "rings": rings, "alpha": alpha, "quality": quality, "threads": threads},
        label=SMOOTHING_FIELDS[quality].label if quality in SMOOTHING_FIELDS else "",
        verb="smoothing",
        show=console.print_smoothing,
        needs_quality=quality is not None,
        save_script=save_script,
        quiet=quiet,
        json=json,
    )


@app.command(
    "fill-holes",
    epilog=examples(
        "fill-holes scan.ply closed.ply --max-edges 300",
        "fill-holes scan.ply closed.ply --max-diameter 10%",
    ),
)
def fill_holes(
    source: Source,
    target: Target,
    method: Annotated[str, typer.Option(help="auto (continues the surface, sharp edges included) or paper.")] = "auto",
    max_edges: Annotated[int | None, typer.Option(help="Leave holes with more edges open.", min=3)] = None,
    max_diameter: Annotated[
        Any,
        typer.Option(
            help="Leave larger holes open. With % of the diagonal of the bounding box.",
            parser=length,
            metavar="LENGTH|PERCENT%",
        ),
    ] = None,
    outer_rims: Annotated[
        bool, typer.Option("--outer-rims/--no-outer-rims", help="Fill where open sheets end, too.")
    ] = False,
    creases: Annotated[
        bool, typer.Option("--creases/--no-creases", help="Continue sharp edges through the holes.")
    ] = True,
    alpha: Annotated[float, typer.Option(help="Weight of the points, in (0, 1]; for the paper's method.")] = 0.8,
    threads: Threads = None,
    save_script: SaveScript = None,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Fill the holes of a mesh: smooth where the surface is smooth, sharp where it is sharp.

    Old vertices and faces stay the first, unchanged; new ones come after them. A hole is filled whole or left open, and
    the report says for each how it was filled, or why not. Where open sheets end is no hole, unless --outer-rims.
    """
    from bezier_filters.meshlab.hole_filter import meshing_close_holes_by_bezier_patch

    filter_file(
        meshing_close_holes_by_bezier_patch,
        source,
        target,
        {
            "method": method,
            "maxholesize": max_edges,
            "maxdiameter": max_diameter,
            "outerrims": outer_rims,
            "creases": creases,
            "alpha": alpha,
            "threads": threads,
        },
        verb="filling",
        show=console.print_holes,
        needs_quality=False,
        save_script=save_script,
        quiet=quiet,
        json=json,
    )
