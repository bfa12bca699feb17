"""The command that runs a filter again whenever another program saves the mesh."""

import shlex
import subprocess
import sys
import time
from pathlib import Path
from typing import Annotated

import typer

from bezier_filters.cli import console
from bezier_filters.cli.app import NEEDS_A_LOOK, Overwrite, app, check_target, examples
from bezier_filters.cli.batch import check_command
from bezier_filters.errors import InvalidParameterError

POLL = 0.25  # seconds between looks; a file that is the same at two of them has been written whole

Stamp = tuple[int, int]


@app.command(epilog=examples("watch part.ply shown.ply --run 'curvature --quality gaussian'"))
def watch(
    source: Annotated[Path, typer.Argument(help="Mesh that another program saves.", metavar="INPUT")],
    target: Annotated[
        Path | None,
        typer.Argument(help="Mesh to write; if left out, the input itself, with --overwrite.", metavar="OUTPUT"),
    ] = None,
    run: Annotated[
        str, typer.Option(help="Command with its options, in quotes: curvature, smooth, fill-holes, ...")
    ] = "curvature",
    overwrite: Overwrite = False,
) -> None:
    """Run a command whenever MeshLab, or another program, saves the mesh; reload the result there to see it.

    It is run at once, too. What cannot be read or computed is told, and the next save is waited for. Ctrl-C ends it.
    """
    command, *arguments = shlex.split(run) or [""]
    check_command(command, arguments)
    target = target or source
    check_target(target, source, overwrite=overwrite)
    if not source.exists():
        raise InvalidParameterError(f"INPUT: there is no file {source}")
    work = [sys.executable, "-m", "bezier_filters", command, str(source), str(target), *arguments, "--overwrite"]
    seen: Stamp | None = None
    while True:
        seen = _next_stamp(source, seen)
        # In a process of its own, so that a file that is only half there ends nothing.
        status = subprocess.run(work, check=False).returncode
        if target.exists() and source.exists() and target.samefile(source):
            seen = _stamp(source)  # this save was ours
        told = f"done: reload {target} in MeshLab" if status in (0, NEEDS_A_LOOK) else "could not be run"
        console.out.print(f"{time.strftime('%X')}  {command} {told}; waiting for {source} to be saved", markup=False)


def _next_stamp(path: Path, seen: Stamp | None) -> Stamp:
    """Wait until a file is there, is another one than that seen last, and is no longer written to."""
    before = seen
    while True:
        now = _stamp(path)
        if now is not None and now != seen and now == before:
            return now
        before = now
        time.sleep(POLL)


def _stamp(path: Path) -> Stamp | None:
    """What changes when a file is written: its time and size; None while it is not there."""
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_mtime_ns, status.st_size
