"""The commands for meshes that do not fit into memory, in tiles on Dask."""

import re
from pathlib import Path
from typing import Annotated, Any

import typer

from bezier_filters.cli import console
from bezier_filters.cli.app import app
from bezier_filters.cli.options import Alpha, Degree, Json, Quiet, Rings, Robust, SmoothnessName
from bezier_filters.errors import CancelledError

scale_app = typer.Typer(
    help="Meshes of any size, in tiles on Dask: one machine or a cluster.",
    epilog="Example: bezier-filters scale curvature statue.ply curved.ply --memory-limit 2GB",
    no_args_is_help=True,
    rich_markup_mode="markdown",
)
app.add_typer(scale_app, name="scale")

_SIZE = re.compile(r"(\d+(?:\.\d+)?)\s*([KMGT]?)(I?)B?", re.IGNORECASE)


def size_in_bytes(text: str) -> int:
    """Parse an option that is an amount of memory."""
    found = _SIZE.fullmatch(text.strip())
    if found is None:
        raise typer.BadParameter(f"got {text!r}, expected an amount of memory such as 2GB or 800MB")
    number, prefix, binary = found.groups()
    unit: int = (1024 if binary else 1000) ** " KMGT".index(prefix.upper() or " ")
    return int(float(number) * unit)


BigSource = Annotated[
    Path, typer.Argument(help="Binary PLY file of triangles, or an NPY file of vertices.", metavar="BIG.ply")
]
BigTarget = Annotated[Path, typer.Argument(help="PLY file to write.", metavar="OUT.ply")]
Faces = Annotated[Path | None, typer.Option(help="NPY file of the faces, if the input is one of the vertices.")]
Scheduler = Annotated[
    str | None,
    typer.Option(
        help="threads, processes, synchronous, or the address of a Dask scheduler; by default, processes of this "
        "machine are started.",
        metavar="tcp://HOST:8786",
    ),
]
Workers = Annotated[int | None, typer.Option(help="Processes on this machine; all cores by default.", min=1)]
TileVertices = Annotated[int | None, typer.Option(help="Vertices of a tile; by default what memory allows.", min=256)]
MemoryLimit = Annotated[
    Any, typer.Option(help="Memory of each worker that is started.", parser=size_in_bytes, metavar="2GB")
]
StoreFolder = Annotated[
    Path | None, typer.Option("--store", help="Folder for the tiles; OUT.ply.tiles by default, removed at the end.")
]
Resume = Annotated[bool, typer.Option("--resume", help="Go on with an interrupted run: only what is not done yet.")]
KeepStore = Annotated[bool, typer.Option("--keep-store", help="Leave the tiles there at the end.")]
Columns = Annotated[list[str] | None, typer.Option("--column", help="Column to write; may be repeated.")]


@scale_app.command(epilog="Example: bezier-filters scale curvature statue.ply curved.ply --memory-limit 2GB")
def curvature(
    source: BigSource,
    target: BigTarget,
    quality: Annotated[
        str, typer.Option(help="Quality to set: mean, gaussian, min, max, curvedness, shape_index or std.")
    ] = "mean",
    faces: Faces = None,
    rings: Rings = "auto",
    alpha: Alpha = "auto",
    degree: Degree = "auto",
    smoothness: SmoothnessName = "third_order",
    robust: Robust = False,
    column: Columns = None,
    scheduler: Scheduler = None,
    workers: Workers = None,
    tile_vertices: TileVertices = None,
    memory_limit: MemoryLimit = None,
    store: StoreFolder = None,
    resume: Resume = False,
    keep_store: KeepStore = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Compute mean, Gaussian and principal curvatures and directions, with the values that the mesh has in memory."""
    fit = {"rings": rings, "alpha": alpha, "degree": degree, "smoothness": smoothness, "robust": robust}
    run = {
        "scheduler": scheduler,
        "workers": workers,
        "tile_vertices": tile_vertices,
        "memory_limit": memory_limit,
        "store": store,
        "resume": resume,
        "keep_store": keep_store,
    }
    run |= {"quality": quality, "columns": column}
    report = _run("estimate_file", source, faces, target, fit, run, quiet=quiet or json)
    if json:
        console.print_json(report)
    elif not quiet:
        console.print_status(report, str(source))
        console.print_tiles(report)
        console.print_written(report, str(target))


@scale_app.command(epilog="Example: bezier-filters scale smooth statue.ply smooth.ply --iterations 3")
def smooth(
    source: BigSource,
    target: BigTarget,
    faces: Faces = None,
    iterations: Annotated[int, typer.Option(help="How many times.", min=1)] = 1,
    rings: Rings = 2,
    alpha: Alpha = 0.8,
    degree: Degree = "auto",
    smoothness: SmoothnessName = "paper",
    robust: Robust = False,
    scheduler: Scheduler = None,
    workers: Workers = None,
    tile_vertices: TileVertices = None,
    memory_limit: MemoryLimit = None,
    store: StoreFolder = None,
    resume: Resume = False,
    keep_store: KeepStore = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Move every vertex onto its patch, as the paper does; the automatic smoothing is for meshes in memory."""
    fit = {"rings": rings, "alpha": alpha, "degree": degree, "smoothness": smoothness, "robust": robust}
    run = {
        "scheduler": scheduler,
        "workers": workers,
        "tile_vertices": tile_vertices,
        "memory_limit": memory_limit,
        "store": store,
        "resume": resume,
        "keep_store": keep_store,
        "iterations": iterations,
    }
    report = _run("smooth_file", source, faces, target, fit, run, quiet=quiet or json)
    if json:
        console.print_json(report)
    elif not quiet:
        console.print_tiles(report)
        console.print_written(report, str(target))


def _run(
    name: str, source: Path, faces: Path | None, target: Path, fit: dict[str, Any], run: dict[str, Any], *, quiet: bool
) -> dict[str, Any]:
    """Call a function of `bezier_filters.scale`; its report."""
    from bezier_filters import scale

    files = source if faces is None else (source, faces)
    try:
        with console.stage_bar("scale", quiet=quiet) as progress:
            found: dict[str, Any] = getattr(scale, name)(
                files, target, options=scale.FitOptions(**fit), progress=progress, **run
            )
    except KeyboardInterrupt:
        raise CancelledError("interrupted; give --resume to go on with what is not done yet") from None
    return found
