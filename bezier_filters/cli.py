"""The command line ``bezier-filters``."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from bezier_filters import console
from bezier_filters._version import __version__
from bezier_filters.cli_options import (
    Alpha,
    Color,
    ColorMapName,
    Degree,
    Json,
    Percentile,
    Quiet,
    Radius,
    Rings,
    Robust,
    SmoothnessName,
    Source,
    Target,
    Threads,
    length,
)

EPILOG = "Every command explains itself: bezier-filters COMMAND --help"
app = typer.Typer(
    name="bezier-filters",
    help="Curvature, normals, torsion and smoothing of meshes by third-order Bezier patches, for MeshLab.",
    epilog=EPILOG,
    no_args_is_help=True,
    add_completion=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _print_version(wanted: bool) -> None:
    if wanted:
        print(f"bezier-filters {__version__}")
        raise typer.Exit


@app.callback()
def _app(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    pass


@app.command(epilog="Example: bezier-filters normals scan.ply smooth_normals.ply")
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
    colormap: ColorMapName = "Turbo",
    percentile: Percentile = 2.0,
    threads: Threads = None,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Set the vertex normals to those of the fitted patches."""
    from bezier_filters.filters import NORMAL_FIELDS, compute_normal_by_bezier_patch_per_vertex

    fit = {"rings": rings, "radius": radius, "alpha": alpha, "degree": degree, "smoothness": smoothness}
    colors = {"color": color, "colormap": colormap, "percentile": percentile}
    _filter_file(
        compute_normal_by_bezier_patch_per_vertex,
        source,
        target,
        fit | colors | {"quality": quality, "robust": robust, "threads": threads},
        label=NORMAL_FIELDS[quality].label if quality in NORMAL_FIELDS else quality,
        quiet=quiet,
        json=json,
    )


@app.command(epilog="Example: bezier-filters curvature bunny.ply curved.ply --quality gaussian --colormap 'French RGB'")
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
    colormap: ColorMapName = "Turbo",
    percentile: Percentile = 2.0,
    threads: Threads = None,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Compute mean, Gaussian and principal curvatures and directions; one of them becomes the quality."""
    from bezier_filters.fields import CURVATURE_FIELDS
    from bezier_filters.filters import compute_curvature_by_bezier_patch_per_vertex

    fit = {"rings": rings, "radius": radius, "alpha": alpha, "degree": degree, "smoothness": smoothness}
    colors = {"color": color, "colormap": colormap, "percentile": percentile}
    _filter_file(
        compute_curvature_by_bezier_patch_per_vertex,
        source,
        target,
        fit | colors | {"quality": quality, "robust": robust, "threads": threads},
        label=CURVATURE_FIELDS[quality].label if quality in CURVATURE_FIELDS else quality,
        quiet=quiet,
        json=json,
    )


@app.command(epilog="Example: bezier-filters torsion bunny.ply twisted.ply")
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
    colormap: ColorMapName = "Turbo",
    percentile: Percentile = 2.0,
    threads: Threads = None,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Set the quality to the principal geodesic torsion (k_max - k_min) / 2."""
    from bezier_filters.fields import TORSION_FIELD
    from bezier_filters.filters import compute_torsion_by_bezier_patch_per_vertex

    fit = {"rings": rings, "radius": radius, "alpha": alpha, "degree": degree, "smoothness": smoothness}
    colors = {"color": color, "colormap": colormap, "percentile": percentile}
    _filter_file(
        compute_torsion_by_bezier_patch_per_vertex,
        source,
        target,
        fit | colors | {"robust": robust, "threads": threads},
        label=TORSION_FIELD.label,
        quiet=quiet,
        json=json,
    )


@app.command(epilog="Example: bezier-filters smooth scan.ply clean.ply")
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
    colormap: ColorMapName = "Turbo",
    percentile: Percentile = 2.0,
    threads: Threads = None,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Take the noise off a mesh and keep its shape, its volume and its edges."""
    from bezier_filters.smoothing_filter import SMOOTHING_FIELDS, apply_coord_bezier_patch_smoothing

    options = {"method": method, "iterations": iterations, "noise": noise, "borders": borders}
    colors = {"color": color, "colormap": colormap, "percentile": percentile}
    _filter_file(
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
        quiet=quiet,
        json=json,
    )


@app.command(epilog="Example: bezier-filters render curved.ply curved.png --view front --view back")
def render(
    source: Source,
    picture: Annotated[Path, typer.Argument(help="PNG file to write.", metavar="PICTURE.png")],
    field: Annotated[
        list[str] | None, typer.Option(help="Field to show, one panel each: quality, color, or a bz_* column.")
    ] = None,
    view: Annotated[
        list[str] | None, typer.Option(help="front, back, left, right, top, bottom or iso; may be repeated.")
    ] = None,
    colormap: Annotated[str, typer.Option(help="Colour map of matplotlib.")] = "turbo",
    percentile: Percentile = 2.0,
    size: Annotated[int, typer.Option(help="Largest side of one image in pixels.", min=50, max=4000)] = 600,
    up: Annotated[str, typer.Option(help="Axis that points up: auto, x, y, z, -x, -y or -z.")] = "auto",
    quiet: Quiet = False,
) -> None:
    """Draw a mesh with its quality or other fields as a PNG with colour bar, without any display."""
    from bezier_filters.mesh_files import load_mesh
    from bezier_filters.pictures import field_panels
    from bezier_filters.render import render_panels

    panels = field_panels(load_mesh(source), source, field or ["quality"], colormap, percentile)
    render_panels(picture, panels, views=view or ["front", "back"], size=(size, size), up=up)
    if not quiet:
        console.out.print(f"wrote [bold]{picture}[/]")


@app.command(epilog="Example: bezier-filters info scan.ply")
def info(source: Source, json: Json = False) -> None:
    """Say what is in a mesh or point cloud, and whether it is fit for fitting."""
    from bezier_filters.mesh import inspect_mesh, triangle_mesh
    from bezier_filters.mesh_files import load_mesh
    from bezier_filters.meshset import current_mesh, topological_measures

    ms = load_mesh(source)
    loaded = current_mesh(ms)
    mesh = triangle_mesh(loaded.vertex_matrix(), loaded.face_matrix())
    topology = topological_measures(mesh.vertices, mesh.faces) if mesh.face_count else {}
    summary = console.mesh_summary(mesh, inspect_mesh(mesh), topology)
    if json:
        console.print_json({"file": str(source), **summary})
    else:
        console.print_mesh_summary(summary, str(source))


@app.command(epilog="Example: bezier-filters demo my_scan.ply --out pictures")
def demo(
    source: Annotated[
        Path | None, typer.Argument(help="Any mesh; the bunny that pymeshlab ships if left out.", metavar="[MESH]")
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder for the files.")] = Path("out"),
    quiet: Quiet = False,
) -> None:
    """Write normals, mean and Gaussian curvature and torsion of a mesh as coloured PLYs and one picture."""
    from bezier_filters.demo import picture_path, run_demo

    for number, step in enumerate(run_demo(out, source)):
        if not quiet and number == 0:
            console.print_status(step.report, str(source or "bunny"))
        if not quiet:
            console.print_statistics(step.report, step.field.label)
            console.print_written(step.report, str(step.path))
    if not quiet:
        console.out.print(f"wrote [bold]{picture_path(out, source)}[/]; open the PLY files in MeshLab")


def _filter_file(
    run: Callable[..., dict[str, Any]],
    source: Path,
    target: Path,
    options: dict[str, Any],
    *,
    label: str,
    quiet: bool,
    json: bool,
    verb: str = "fitting",
    show: Callable[[dict[str, Any], str], None] = console.print_status,
    needs_quality: bool = True,
) -> None:
    """Load, filter, save and report."""
    from bezier_filters.mesh_files import format_support, load_mesh, save_mesh

    support = format_support(target)
    ms = load_mesh(source)
    with console.progress_bar(f"{verb} {source.name}", quiet=quiet or json) as progress:
        report = run(ms, progress=progress, **options)
    save_mesh(ms, target)
    if json:
        console.print_json({"input": str(source), "output": str(target), **report})
    elif not quiet:
        show(report, str(source))
        console.print_statistics(report, label)
        console.print_written(report, str(target))
    if needs_quality and not support.quality:
        console.err.print(
            f"note: {target.suffix} files hold no quality and no bz_* columns; write a PLY file to keep them"
        )


def main() -> None:
    """Run the command line; bad input ends it with one line and exit status 2."""
    from bezier_filters.errors import CancelledError

    try:
        app()
    except (ValueError, OSError, ImportError, CancelledError) as error:
        _fail(error)
    except Exception as error:
        # pymeshlab's exceptions share no base but Exception, and importing it here would be slow.
        if not any(base.__name__ == "PyMeshLabException" for base in type(error).__mro__):
            raise
        _fail(error)


def _fail(error: Exception) -> None:
    message = " ".join(str(error).split())
    console.err.print(f"bezier-filters: {message}", markup=False)
    raise SystemExit(2)
