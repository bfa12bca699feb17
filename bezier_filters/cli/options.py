"""Arguments and options that the commands share, and how they are read."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

Source = Annotated[
    Path, typer.Argument(help="Mesh or point cloud to read: any format that pymeshlab reads.", metavar="INPUT")
]
Target = Annotated[
    Path, typer.Argument(help="Mesh to write. PLY keeps quality, colour and all fields.", metavar="OUTPUT")
]


def auto_or(kind: type) -> Callable[[str], Any]:
    """Parser of an option that is a number or 'auto'."""

    def parse(text: str) -> Any:
        try:
            return text if text == "auto" else kind(text)
        except ValueError:
            raise typer.BadParameter(f"got {text!r}, expected a number or auto") from None

    return parse


def number_option(kind: type, text: str) -> Any:
    """An option that is a number or 'auto'."""
    return typer.Option(help=text, parser=auto_or(kind), metavar="NUMBER|auto")


def length(text: str) -> Any:
    """Parse an option that is a length, or a percentage of the diagonal of the bounding box."""
    try:
        if not text.endswith("%"):
            return float(text)
        percentage = float(text.removesuffix("%"))
    except ValueError:
        percentage = -1.0
    if not 0.0 < percentage <= 100.0:
        raise typer.BadParameter(f"got {text!r}, expected a length such as 0.5, or a percentage such as 2%")
    from bezier_filters.meshlab.meshset import PercentageValue

    return PercentageValue(percentage)


Rings = Annotated[Any, number_option(int, "Size of the fitted neighbourhood in edges; auto lets the data choose.")]
Radius = Annotated[
    Any,
    typer.Option(
        help="Size of the neighbourhood as a length, instead of rings; with % of the diagonal of the bounding box.",
        parser=length,
        metavar="LENGTH|PERCENT%",
    ),
]
Alpha = Annotated[Any, number_option(float, "Weight of the points against smoothness, in (0, 1].")]
Degree = Annotated[Any, number_option(int, "Degree of the patch, 2 to 4, or 2 to 6 if alpha is auto.")]
SmoothnessName = Annotated[str, typer.Option(help="third_order (consistent) or paper (the method to the letter).")]
Robust = Annotated[bool, typer.Option("--robust/--no-robust", help="Take weight from points far off their patch.")]
Color = Annotated[bool, typer.Option("--color/--no-color", help="Colour the vertices by the quality.")]
ColorMapName = Annotated[
    str, typer.Option(help="auto (Cool Warm or Viridis), Paper, or a colour map of pymeshlab: Turbo, French RGB, ...")
]
Percentile = Annotated[float, typer.Option(help="Percentage of values clipped at each end of the colours.")]
ColorRange = Annotated[
    tuple[float, float] | None,
    typer.Option(
        "--range", help="Values of the first and the last colour, instead of --percentile.", metavar="LOW HIGH"
    ),
]
Threads = Annotated[int | None, typer.Option(help="Number of threads; all cores by default.", min=1)]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing but errors.")]
Json = Annotated[bool, typer.Option("--json", help="Print the report as JSON.")]
SaveScript = Annotated[
    Path | None,
    typer.Option(help="MeshLab filter script to add this step to; made if there is none. `run` replays it."),
]
