"""The application of the command line, and the arguments and options that its commands share."""

import inspect
import logging
import re
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer
import typer.core

from bezier_filters._version import __version__
from bezier_filters.cli import console
from bezier_filters.display import shell_remark
from bezier_filters.errors import InvalidParameterError
from bezier_filters.parameters import LENGTH_TYPE, PARAMETERS, Parameter
from bezier_filters.runtime.atomic import temporary_folder
from bezier_filters.runtime.file_names import name_pipe, printable_path
from bezier_filters.runtime.supervision import EXIT_INCOMPLETE

if TYPE_CHECKING:
    from bezier_filters.arrays import Report

EPILOG = """Every command explains itself: bezier-filters COMMAND --help

Exit status: 0 if all was done, 1 if files of a batch failed, 2 if the input was refused, 3 if a result was written
but needs a look; one line on stderr says why.

A mesh named - is read from the standard input, or written as PLY to the standard output, where pipes are (not on
Windows); messages go to stderr then.

BEZIER_FILTERS_THREADS sets the number of threads, as --threads does."""


def examples(*commands: str) -> str:
    """Text below the help of a command; each example is a paragraph."""
    return "\n\n".join(f"Example: bezier-filters {command}" for command in commands)


# commands by their purpose, in the order of the help
GROUPS = {
    "First steps": ("clean", "smooth", "fill-holes", "curvature", "info", "report"),
    "Measuring": ("normals", "torsion", "creases", "lines", "compare", "measure"),
    "Remodelling": ("replace", "bridge", "subdivide", "remesh"),
    "Pictures and textures": ("render", "view", "qmap", "bake", "demo"),
    "Many and large files": ("batch", "run", "watch", "scale", "compile"),
}


class GroupedCommands(typer.core.TyperGroup):
    """Commands whose help has a section for each purpose."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Names of the commands in the order of the help."""
        return [name for names in GROUPS.values() for name in names]

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the first sentences of the commands, all of which begin in the same column."""
        width = max(map(len, self.commands))
        limit = formatter.width - width - 4
        for title, names in GROUPS.items():
            with formatter.section(title):
                for name in names:
                    summary = self.commands[name].get_short_help_str(limit)
                    formatter.write(f"{'':{formatter.current_indent}}{name:<{width}}  {summary}\n")


app = typer.Typer(
    name="bezier-filters",
    cls=GroupedCommands,
    help="Curvature, normals, torsion, smoothing and hole filling by third-order Bezier patches, for MeshLab.",
    epilog=EPILOG,
    no_args_is_help=True,
    add_completion=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # panels of rich take as long to import as all else
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 120},
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


PIPE = Path("-")


def parse_path(text: str) -> Path:
    """Parse the name of a file: ``-`` is a pipe, ``./-`` a file of that name."""
    return Path(text).absolute() if text != "-" and Path(text) == PIPE else Path(text)


def read_pipe(context: typer.Context, source: Path | None) -> Path | None:
    """Write the standard input to a file if the source is ``-``; the format follows from its beginning."""
    if source != PIPE:
        return source
    data = sys.stdin.buffer.read()
    if not data:
        raise InvalidParameterError("cannot read <stdin>: it is empty, or was read before")
    is_stl = len(data) == 84 + 50 * int.from_bytes(data[80:84], "little") or data.startswith(b"solid")
    suffix = ".ply" if data.startswith(b"ply") else ".off" if b"OFF" in data[:8] else ".stl" if is_stl else ".obj"
    path = context.with_resource(temporary_folder()) / f"stdin{suffix}"
    path.write_bytes(data)
    name_pipe(path, "<stdin>")
    return path


def read_pipes(context: typer.Context, sources: list[Path]) -> list[Path]:
    """`read_pipe` for several sources, one of which may be the standard input."""
    return [read_pipe(context, source) or source for source in sources]


def pipe_callback(suffix: str) -> Callable[[typer.Context, Path | None], Path | None]:
    """Callback that replaces the target ``-`` by a file, which is sent to the standard output after the command."""

    def begin(context: typer.Context, target: Path | None) -> Path | None:
        if target != PIPE:
            return target
        path = context.with_resource(temporary_folder()) / f"stdout{suffix}"
        name_pipe(path, "<stdout>")
        console.out().stderr = True

        def send() -> None:
            console.out().stderr = False
            if path.exists():
                with path.open("rb") as stream:
                    shutil.copyfileobj(stream, sys.stdout.buffer)

        context.call_on_close(send)
        return path

    return begin


def check_target(target: Path, *sources: Path, overwrite: bool) -> None:
    """Refuse to overwrite an input or a write-protected file, unless `overwrite` is given, and missing folders."""
    if not target.parent.is_dir():
        raise InvalidParameterError(
            f"cannot write {printable_path(target)}: there is no directory {printable_path(target.parent)}"
        )
    if overwrite or not target.exists():
        return
    if any(source.exists() and target.samefile(source) for source in sources):
        raise InvalidParameterError(f"{printable_path(target)} is the input; give --overwrite to replace it")
    if not target.stat().st_mode & 0o222:
        raise InvalidParameterError(f"{printable_path(target)} is write-protected; give --overwrite to replace it")


_READABLE = "any format that pymeshlab reads, VTP, VTU, NPZ, CSV, LAS, or - for the standard input."
Source = Annotated[
    Path,
    typer.Argument(
        help=f"Mesh or point cloud to read: {_READABLE}", metavar="INPUT", parser=parse_path, callback=read_pipe
    ),
]
MeshSource = Annotated[
    Path,
    typer.Argument(
        help=f"Mesh with faces to read: {_READABLE}", metavar="INPUT", parser=parse_path, callback=read_pipe
    ),
]
Target = Annotated[
    Path,
    typer.Argument(
        help="Mesh to write, or - for the standard output. PLY, VTP, VTU and NPZ keep quality, colour and all fields, "
        "CSV all but the faces, GLB colours.",
        metavar="OUTPUT",
        parser=parse_path,
        callback=pipe_callback(".ply"),
    ),
]


def choose_scheduler(address: str | None, path: Path | None) -> str | Path | None:
    """The scheduler of --scheduler or --scheduler-file, which exclude each other."""
    if address is not None and path is not None:
        raise InvalidParameterError("scheduler: got --scheduler-file, too; give one of them")
    return address if path is None else path


Overwrite = Annotated[bool, typer.Option("--overwrite", help="Also replace the input, or a write-protected file.")]
Percentile = Annotated[float, typer.Option(help="Percentage of values clipped at each end of the colours.")]
ColorRange = Annotated[
    tuple[float, float] | None,
    typer.Option(
        "--range", help="Values of the first and the last colour, instead of --percentile.", metavar="LOW HIGH"
    ),
]
_AXIS = "auto, x, y, z, -x, -y or -z."
Up = Annotated[str, typer.Option(help=f"Axis that points up in the picture: {_AXIS}")]
Front = Annotated[str, typer.Option(help=f"Axis that faces the viewer in the front view: {_AXIS}")]
Skip = Annotated[bool, typer.Option("--skip", help="Leave vertices without finite coordinates out, and their faces.")]


def _silence(quiet: bool) -> bool:
    """Leave out the announcement that kernels are compiled, too."""
    if quiet:
        logging.getLogger("bezier_filters.compilation").setLevel(logging.ERROR)
    return quiet


Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing but errors.", callback=_silence)]
Verbose = Annotated[bool, typer.Option("--verbose", "-v", help="List all holes, and what was tried before.")]
Json = Annotated[bool, typer.Option("--json", help="Print the report as JSON.")]
SaveScript = Annotated[
    Path | None,
    typer.Option(help="MeshLab filter script to add this step to; made if there is none. `run` replays it."),
]

_Command = TypeVar("_Command", bound=Callable[..., None])


def options(*parameters: Parameter) -> Callable[[_Command], _Command]:
    """Add the options of a table to a command as keyword arguments, before its own options in the help."""

    def add_options(command: _Command) -> _Command:
        signature = inspect.signature(command, eval_str=True)
        own = [item for item in signature.parameters.values() if item.kind is not item.VAR_KEYWORD]
        given = [
            inspect.Parameter(item.name, inspect.Parameter.KEYWORD_ONLY, default=item.default, annotation=_option(item))
            for item in parameters
            if item.kind != "callable"  # progress: commands have a bar
        ]
        first = next((k for k, item in enumerate(own) if item.kind is item.KEYWORD_ONLY), len(own))
        found = signature.replace(parameters=[*own[:first], *given, *own[first:]])
        command.__signature__ = found  # type: ignore[attr-defined]  # where typer looks
        return command

    return add_options


def shell_message(message: str) -> str:
    """A message of a filter with the name of the option instead of that of the parameter, without mention of None.

    >>> shell_message("max_diameter: got 0.0, expected a positive length, or None")
    '--max-diameter: got 0.0, expected a positive length'
    """
    text = re.sub(r",? or None( to learn it)?", "", message).replace("the current mesh", "the mesh")
    text = text.replace("skip=True", "--skip")
    name, colon, rest = text.partition(": ")
    known = {item.name.replace("_", ""): item.name for table in PARAMETERS.values() for item in table}
    parameter = known.get(name.replace("_", ""))  # array functions have underscores, filters do not
    return f"{_option_of(parameter) if parameter else name}{colon}{rest}"


def end_with_remarks(target: str, report: "Report") -> None:
    """Print the remarks and warnings of a report; with warnings, exit with the status for incomplete results."""
    for remark in report.get("remarks", []):
        console.err().print(f"note: {shell_remark(shell_message(remark))}", markup=False)
    if warnings := report.get("warnings"):
        text = shell_remark("; ".join(warnings))
        console.err().print(f"look at {target}: {text}", markup=False)
        raise typer.Exit(EXIT_INCOMPLETE)


def _option_of(name: str) -> str:
    """The option that sets a parameter of a filter."""
    return f"--{_NAMES.get(name, name.replace('_', '-'))}"


def _option(parameter: Parameter) -> object:
    """Annotation of a parameter for typer."""
    name = _option_of(parameter.name)
    words = re.findall(r'"(\w+)"', parameter.kind) if parameter.kind.startswith("{") else []
    kind, parser, metavar = (str, None, None) if words else _KINDS[parameter.kind]
    return Annotated[
        kind | None if parameter.default is None and parser is None else kind,
        typer.Option(
            f"{name}/--no-{name[2:]}" if parameter.kind == "bool" else name,
            help=parameter.help,
            min=_MINIMUM.get(parameter.name) if parser is None else None,
            parser=parser,
            metavar=metavar,
            autocompletion=(lambda: words) if words else None,
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
    from bezier_filters.meshlab.meshset import length_of

    try:
        return length_of(text)
    except InvalidParameterError as error:
        raise typer.BadParameter(str(error)) from None


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
    "condselect": "where",
    "keepvolume": "keep-volume",
    "maxholesize": "max-edges",
    "maxperimeter": "max-perimeter",
    "maxdiameter": "max-diameter",
    "outerrims": "outer-rims",
    "vertexcount": "vertex-count",
    "boltholes": "bolt-holes",
    "minstrength": "min-strength",
    "texmap": "map",
    "maxerror": "max-error",
    "normalcurvature": "normal-curvature",
    "maxdistance": "max-distance",
    "refnoise": "reference-noise",
    "viewpointside": "viewpoint-side",
}
# least values that typer accepts
_MINIMUM = {
    "threads": 1,
    "iterations": 1,
    "maxholesize": 3,
    "noise": 0.0,
    "region": 1,
    "repeats": 0,
    "minstrength": 0.0,
    "workers": 1,
    "tile_vertices": 256,
}
# type, parser and placeholder in the help, by the type in documents
_KINDS: dict[str, tuple[Any, Callable[[str], object] | None, str | None]] = {
    "bool": (bool, None, None),
    "switch": (bool, None, None),
    "int": (int, None, None),
    "float": (float, None, None),
    "str": (str, None, None),
    "path": (Path, None, None),
    "location": (str, None, "FOLDER|URL"),
    "address": (str, None, "tcp://HOST:8786"),
    "(float, float)": (tuple[float, float], None, "LOW HIGH"),
    "(float, float, float)": (tuple[float, float, float], None, "X Y Z"),
    'int or "auto"': (Any, _auto_or(int), "NUMBER|auto"),
    'float or "auto"': (Any, _auto_or(float), "NUMBER|auto"),
    LENGTH_TYPE: (Any, _length, "LENGTH|PERCENT%"),
    "size": (Any, size_in_bytes, "2GB"),
}
