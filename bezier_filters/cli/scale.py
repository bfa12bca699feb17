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
    report = _run("estimate_file", **locals())
    if not (quiet or json):
        console.print_status(report, str(source))
        console.print_tiles(report)
        console.print_written(report, str(target))


@scale_app.command(epilog="Example: bezier-filters scale smooth statue.ply smooth.ply --scheduler tcp://HOST:8786")
def smooth(
    source: BigSource,
    target: BigTarget,
    method: Annotated[str, typer.Option(help="auto (learns what to do from the mesh) or paper.")] = "auto",
    faces: Faces = None,
    iterations: Annotated[int, typer.Option(help="How many times; with auto once is enough.", min=1)] = 1,
    noise: Annotated[
        float | None, typer.Option(help="Standard deviation of the noise, a length; learned if left out.", min=0.0)
    ] = None,
    borders: Annotated[str, typer.Option(help="curve (smoothed along the border) or fixed.")] = "curve",
    keep_volume: Annotated[
        bool | None, typer.Option("--keep-volume/--no-keep-volume", help="Keep what closed parts enclose.")
    ] = None,
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
    """Take the noise off, with the vertices that the mesh gets in memory.

    Rings, alpha, degree, smoothness and robust are for the paper's method, which moves every vertex onto its patch.
    """
    report = _run("smooth_file", **locals())
    if not (quiet or json):
        console.print_noise(report)
        console.print_tiles(report)
        console.print_written(report, str(target))


_FIT = ("rings", "alpha", "degree", "smoothness", "robust")


def _run(
    name: str, source: Path, target: Path, faces: Path | None, quiet: bool, json: bool, **options: Any
) -> dict[str, Any]:
    """Call a function of `bezier_filters.scale` with the options of a command; its report, printed if it is to be."""
    from bezier_filters import scale

    fit = scale.FitOptions(**{option: options.pop(option) for option in _FIT})
    options["options"] = None if options.get("method") == "auto" else fit
    if "column" in options:
        options["columns"] = options.pop("column")
    files = source if faces is None else (source, faces)
    try:
        with console.stage_bar("scale", quiet=quiet or json) as progress:
            found: dict[str, Any] = getattr(scale, name)(files, target, progress=progress, **options)
    except KeyboardInterrupt:
        raise CancelledError("interrupted; give --resume to go on with what is not done yet") from None
    if json:
        console.print_json(found)
    return found
