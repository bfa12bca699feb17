"""The application of the command line, and the arguments and options that its commands share."""

import inspect
import re
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer

from bezier_filters._version import __version__
from bezier_filters.parameters import LENGTH, Parameter

EPILOG = """Every command explains itself: bezier-filters COMMAND --help

Exit status: 0 if all was done, 1 if files of a batch failed, 2 if the input was refused; one line on stderr says why.

BEZIER_FILTERS_THREADS sets the number of threads, as --threads does."""


def examples(*commands: str) -> str:
    """Text below the help of a command; each example is a paragraph."""
    return "\n\n".join(f"Example: bezier-filters {command}" for command in commands)


app = typer.Typer(
    name="bezier-filters",
    help="Curvature, normals, torsion, smoothing and hole filling by third-order Bezier patches, for MeshLab.",
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


Source = Annotated[
    Path, typer.Argument(help="Mesh or point cloud to read: any format that pymeshlab reads.", metavar="INPUT")
]
Target = Annotated[
    Path, typer.Argument(help="Mesh to write. PLY keeps quality, colour and all fields.", metavar="OUTPUT")
]
Percentile = Annotated[float, typer.Option(help="Percentage of values clipped at each end of the colours.")]
ColorRange = Annotated[
    tuple[float, float] | None,
    typer.Option(
        "--range", help="Values of the first and the last colour, instead of --percentile.", metavar="LOW HIGH"
    ),
]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing but errors.")]
Json = Annotated[bool, typer.Option("--json", help="Print the report as JSON.")]
SaveScript = Annotated[
    Path | None,
    typer.Option(help="MeshLab filter script to add this step to; made if there is none. `run` replays it."),
]

_Command = TypeVar("_Command", bound=Callable[..., None])


def options(*parameters: Parameter) -> Callable[[_Command], _Command]:
    """Give a command the options of a table, which it takes as keywords; in its help they come before its own."""

    def with_options(command: _Command) -> _Command:
        signature = inspect.signature(command, eval_str=True)
        own = [item for item in signature.parameters.values() if item.kind is not item.VAR_KEYWORD]
        given = [
            inspect.Parameter(item.name, inspect.Parameter.KEYWORD_ONLY, default=item.default, annotation=_option(item))
            for item in parameters
        ]
        first = next((k for k, item in enumerate(own) if item.kind is item.KEYWORD_ONLY), len(own))
        found = signature.replace(parameters=[*own[:first], *given, *own[first:]])
        command.__signature__ = found  # type: ignore[attr-defined]  # where typer looks
        return command

    return with_options


def _option(parameter: Parameter) -> object:
    """A parameter as typer wants it."""
    name = _NAMES.get(parameter.name, parameter.name.replace("_", "-"))
    words = parameter.kind.startswith("{")
    kind, parser, metavar = (str, None, None) if words else _KINDS[parameter.kind]
    return Annotated[
        kind | None if parameter.default is None and parser is None else kind,
        typer.Option(
            f"--{name}/--no-{name}" if parameter.kind == "bool" else f"--{name}",
            help=parameter.help,
            min=_LEAST.get(parameter.name) if parser is None else None,
            parser=parser,
            metavar=metavar,
        ),
    ]


def _auto_or(kind: type[int] | type[float]) -> Callable[[str], str | float]:
    """Parser of an option that is a number or 'auto'."""

    def parse(text: str) -> str | float:
        try:
            return text if text == "auto" else kind(text)
        except ValueError:
            raise typer.BadParameter(f"got {text!r}, expected a number or auto") from None

    return parse


def _length(text: str) -> object:
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


_SIZE = re.compile(r"(\d+(?:\.\d+)?)\s*([KMGT]?)(I?)B?", re.IGNORECASE)


def size_in_bytes(text: str) -> int:
    """Parse an option that is an amount of memory."""
    found = _SIZE.fullmatch(text.strip())
    if found is None:
        raise typer.BadParameter(f"got {text!r}, expected an amount of memory such as 2GB or 800MB")
    number, prefix, binary = found.groups()
    unit: int = (1024 if binary else 1000) ** " KMGT".index(prefix.upper() or " ")
    return int(float(number) * unit)


# options whose names are not those of the parameters
_NAMES = {
    "colorrange": "range",
    "keepvolume": "keep-volume",
    "maxholesize": "max-edges",
    "maxperimeter": "max-perimeter",
    "maxdiameter": "max-diameter",
    "outerrims": "outer-rims",
    "minstrength": "min-strength",
}
# numbers that typer refuses if they are smaller
_LEAST = {
    "threads": 1,
    "iterations": 1,
    "maxholesize": 3,
    "noise": 0.0,
    "minstrength": 0.0,
    "workers": 1,
    "tile_vertices": 256,
}
# types, parsers and what stands for values in the help, by what documents say
_KINDS: dict[str, tuple[Any, Callable[[str], object] | None, str | None]] = {
    "bool": (bool, None, None),
    "switch": (bool, None, None),
    "int": (int, None, None),
    "float": (float, None, None),
    "str": (str, None, None),
    "path": (Path, None, None),
    "address": (str, None, "tcp://HOST:8786"),
    "(float, float)": (tuple[float, float], None, "LOW HIGH"),
    'int or "auto"': (Any, _auto_or(int), "NUMBER|auto"),
    'float or "auto"': (Any, _auto_or(float), "NUMBER|auto"),
    LENGTH: (Any, _length, "LENGTH|PERCENT%"),
    "size": (Any, size_in_bytes, "2GB"),
}
