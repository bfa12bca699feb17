"""The commands for meshes that do not fit into memory, in tiles on Dask."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from bezier_filters.cli import console
from bezier_filters.cli.app import (
    Json,
    Overwrite,
    Quiet,
    app,
    check_target,
    choose_scheduler,
    end_with_remarks,
    examples,
    options,
    parse_path,
    pipe_callback,
    read_pipe,
)
from bezier_filters.errors import CancelledError
from bezier_filters.parameters import FIT, QUALITY_IN_TILES, SMOOTHING, Parameter, parameters
from bezier_filters.runtime.file_names import printable_path

if TYPE_CHECKING:
    from bezier_filters.arrays import Report
    from bezier_filters.runtime.parallel import Progress

scale_app = typer.Typer(
    help="Process meshes of any size in tiles, on one or many machines.",
    epilog="Example: bezier-filters scale curvature statue.ply curved.ply --memory-limit 2GB",
    no_args_is_help=True,
    rich_markup_mode=None,
)
app.add_typer(scale_app, name="scale")


def parse_location(text: str) -> Path:
    """Parse the name of a file; a URL stays a text, as paths have no double slashes."""
    return cast(Path, text) if "://" in text else parse_path(text)


BigSource = Annotated[
    Path,
    typer.Argument(
        help="Binary PLY file of triangles, or an NPY file of vertices, or a URL; - is the standard input.",
        metavar="BIG.ply",
        parser=parse_location,
        callback=read_pipe,
    ),
]
BigTarget = Annotated[
    Path,
    typer.Argument(
        help="PLY file or URL to write, or - for the standard output.",
        metavar="OUT.ply",
        parser=parse_location,
        callback=pipe_callback(".ply"),
    ),
]
Faces = Annotated[
    Path | None,
    typer.Option(
        help="NPY file of the faces, if the input is one of the vertices.", metavar="FACES.npy", parser=parse_location
    ),
]
Columns = Annotated[list[str] | None, typer.Option("--column", help="Column to write; may be repeated.")]

# differences from the filters in memory: lengths cannot be percentages
_CHANGED: dict[str, dict[str, Any]] = {
    "noise": {"kind": "float", "help": "Standard deviation of the noise, a length; learned if left out."},
    "detail": {"kind": "float", "help": "Size of the smallest detail to keep, a length."},
    "keepvolume": {"name": "keep_volume"},
}
_PAPER = {"rings": 2, "alpha": 0.8, "smoothness": "paper"}
TILE_FIT = [replace(p, **_CHANGED.get(p.name, {})) for p in FIT if p.name != "radius"]
PAPER_FIT = [replace(p, default=_PAPER.get(p.name, p.default)) for p in TILE_FIT if p.name not in _CHANGED]
TILE_SMOOTHING = [replace(item, **_CHANGED.get(item.name, {})) for item in SMOOTHING if item.name not in _PAPER]
TILES = parameters("""
scheduler : address, optional
    threads, processes, synchronous or an address; by default DASK_SCHEDULER_ADDRESS, else processes started here.
scheduler_file : path, optional
    File with the address, as written by dask scheduler --scheduler-file.
workers : int, optional
    Processes on this machine; all cores by default.
tile_vertices : int, optional
    Vertices of a tile; by default what memory allows.
memory_limit : size, optional
    Memory of each worker that is started.
store : location, optional
    Folder or URL for the tiles; OUT.ply.tiles by default, removed at the end.
resume : switch, default False
    Continue an interrupted run, and compute only missing tiles.
keep_store : switch, default False
    Leave the tiles there at the end.
""")


def _check_local_target(target: str | Path, *sources: str | Path | None, overwrite: bool) -> None:
    """Check a target that is no URL, which the run checks."""
    if "://" not in str(target):
        check_target(*(Path(path) for path in (target, *sources) if path is not None), overwrite=overwrite)


CURVATURE_EXAMPLES = (
    "scale curvature statue.ply curved.ply --memory-limit 2GB",
    "scale curvature statue.ply curved.ply --scheduler-file cluster.json --store s3://bucket/tiles",
)


@scale_app.command(epilog=examples(*CURVATURE_EXAMPLES))
@options(QUALITY_IN_TILES, *TILE_FIT, *TILES)
def curvature(
    source: BigSource,
    target: BigTarget,
    *,
    faces: Faces = None,
    column: Columns = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
    json: Json = False,
    **given: Any,
) -> None:
    """Compute curvatures and principal directions.

    Mean, Gaussian and principal curvatures have the values that the mesh has in memory.
    """
    from bezier_filters.scale import FitOptions, estimate_file

    _check_local_target(target, source, faces, overwrite=overwrite)
    fit = FitOptions(**_pop_fit_options(given, TILE_FIT))
    given["scheduler"] = choose_scheduler(given["scheduler"], given.pop("scheduler_file"))
    files = source if faces is None else (source, faces)
    with _resumable(quiet=quiet or json) as progress:
        report = estimate_file(files, target, columns=column, options=fit, progress=progress, **given)
    _print(report, target, lambda: console.print_status(report, printable_path(source)), quiet=quiet, json=json)


@scale_app.command(epilog="Example: bezier-filters scale smooth statue.ply smooth.ply --scheduler tcp://HOST:8786")
@options(*TILE_SMOOTHING, *PAPER_FIT, *TILES)
def smooth(
    source: BigSource,
    target: BigTarget,
    *,
    faces: Faces = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
    json: Json = False,
    **given: Any,
) -> None:
    """Remove noise and keep the shape and the edges.

    Vertices differ from the result in memory by at most a hundredth of the noise.

    Rings, alpha, degree, smoothness and robust are for the paper's method, which moves every vertex onto its patch.
    """
    from bezier_filters.scale import FitOptions, smooth_file
    from bezier_filters.scale.smooth import PAPER_OPTIONS

    _check_local_target(target, source, faces, overwrite=overwrite)
    fit = FitOptions(**_pop_fit_options(given, PAPER_FIT))
    given["scheduler"] = choose_scheduler(given["scheduler"], given.pop("scheduler_file"))
    files = source if faces is None else (source, faces)
    with _resumable(quiet=quiet or json) as progress:
        paper = None if given["method"] == "auto" and fit == PAPER_OPTIONS else fit  # else it is refused
        report = smooth_file(files, target, options=paper, progress=progress, **given)
    _print(report, target, lambda: console.print_noise(report), quiet=quiet, json=json)


def _pop_fit_options(given: dict[str, Any], table: Iterable[Parameter]) -> dict[str, Any]:
    """Remove the options of the fit from the given options, and return them."""
    return {parameter.name: given.pop(parameter.name) for parameter in table}


@contextmanager
def _resumable(*, quiet: bool) -> Iterator[Callable[[str, int, int], None]]:
    """The progress bar of a run that can be interrupted and resumed."""
    from bezier_filters.scale.run import DASHBOARD

    try:
        with console.stages(quiet=quiet) as stage:
            bars, dashboard = dict[str, "Progress | None"](), ""

            def progress(name: str, done: int, total: int) -> None:
                nonlocal dashboard
                if name.startswith(DASHBOARD):
                    dashboard = name.removeprefix(DASHBOARD)
                    return
                if name not in bars:
                    bars.clear()
                    bars[name] = stage(f"{name} {dashboard}".strip())
                if (bar := bars[name]) is not None:
                    bar(done, total)

            stage("reading")
            yield progress
    except KeyboardInterrupt:
        raise CancelledError("interrupted; give --resume to continue") from None


def _print(report: "Report", target: Path, first: Callable[[], None], *, quiet: bool, json: bool) -> None:
    if json:
        console.print_json(report)
    elif not quiet:
        first()
        console.print_tiles(report)
        console.print_written(report, printable_path(target))
    end_with_remarks(printable_path(target), report)
