"""The application of the command line, which other modules add commands to."""

from typing import Annotated

import typer

from bezier_filters._version import __version__

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
