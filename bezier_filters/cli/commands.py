"""The command line ``bezier-filters``."""

import os
import shlex
import subprocess
import sys
import time
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bezier_filters.cli import batch, cleaning, console, filters, inspection, pictures, scale, textures
from bezier_filters.cli.app import (
    Front,
    Json,
    Overwrite,
    Quiet,
    Skip,
    Source,
    Up,
    app,
    check_target,
    end_with_remarks,
    examples,
    parse_path,
    pipe_callback,
    read_pipe,
    shell_message,
)
from bezier_filters.cli.pages import check_page, inspect_file, write_page
from bezier_filters.cli.reading import file_remarks
from bezier_filters.errors import InvalidParameterError
from bezier_filters.runtime.file_names import (
    escape_unprintable,
    printable_path,
    replace_pipe_paths,
    user_path,
)
from bezier_filters.runtime.process_end import child_environment
from bezier_filters.runtime.supervision import EXIT_INCOMPLETE

if TYPE_CHECKING:
    from bezier_filters.arrays import Report

__all__ = ["app", "batch", "cleaning", "filters", "inspection", "pictures", "scale", "serve_command_line", "textures"]

POLL_SECONDS = 0.25  # interval between checks; a file that is unchanged after one is complete

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
    """Run a command whenever another program saves the mesh.

    Reload the result in MeshLab to see it. The command also runs at the start. Errors are printed, and the command
    waits for the next save. Ctrl-C ends it.
    """
    command, *arguments = shlex.split(run) or [""]
    batch.check_command(command, arguments)
    target = target or source
    check_target(target, source, overwrite=overwrite)
    if not source.exists():
        raise InvalidParameterError(f"INPUT: there is no file {printable_path(source)}")
    work = [
        sys.executable,
        "-m",
        "bezier_filters",
        command,
        *arguments,
        "--overwrite",
        "--",
        os.path.abspath(source),
        os.path.abspath(target),
    ]
    seen: Stamp | None = None
    while True:
        seen = _next_stamp(source, seen)
        # In a child process, so that an incomplete file does not end this one.
        status = subprocess.run(work, env=child_environment(), check=False).returncode
        if target.exists() and source.exists() and target.samefile(source):
            seen = _stamp(source)  # this save was ours
        outcome = (
            f"done: reload {printable_path(target)} in MeshLab"
            if status in (0, EXIT_INCOMPLETE)
            else "could not be run"
        )
        console.out().print(
            f"{time.strftime('%X')}  {command} {outcome}; waiting for {printable_path(source)} to be saved",
            markup=False,
        )


def _next_stamp(path: Path, seen: Stamp | None) -> Stamp:
    """Wait until a file exists, differs from the last one seen, and is complete."""
    before = seen
    while True:
        now = _stamp(path)
        if now is not None and now != seen and now == before:
            return now
        before = now
        time.sleep(POLL_SECONDS)


def _stamp(path: Path) -> Stamp | None:
    """Modification time and size of a file; None while it does not exist."""
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_mtime_ns, status.st_size


@app.command(epilog="Example: bezier-filters info scan.ply")
def info(source: Source, skip: Skip = False, json: Json = False) -> None:
    """Show what a mesh contains, its noise, and what is wrong with it."""
    with console.stages(quiet=json) as stage:
        _, summary = inspect_file(source, stage, skip=skip)
    if json:
        console.print_json({"file": user_path(source), **summary})
    else:
        console.print_mesh_summary(summary, printable_path(source))


@app.command(epilog="Example: bezier-filters report scan.ply")
def report(
    source: Source,
    page: Annotated[
        Path | None,
        typer.Argument(
            help="Page to write, or - for the standard output; by default in this folder, with the name of the mesh.",
            metavar="PAGE.html",
            parser=parse_path,
            callback=pipe_callback(".html"),
        ),
    ] = None,
    up: Up = "auto",
    front: Front = "auto",
    skip: Skip = False,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Write a page with a verdict on a mesh, and its measurements.

    It is one file for a browser, and needs no network. It begins with the noise, the holes and what stands in the way,
    each with the command that acts on it, and the mesh before and after smoothing and filling. Then come curvature,
    torsion, standard errors and status, whose values stand under the pointer, sharp edges, profiles, and the output of
    info. Pictures and tables can be saved and printed.
    """
    from bezier_filters.pictures.views import check_axes

    page = Path(source.name).with_suffix(".html") if page is None else page
    check_page(page)
    check_target(page, source, overwrite=overwrite)
    check_axes(up, front)
    with console.stages(quiet=quiet or json) as stage:
        made = write_page(source, page, stage, up=up, front=front, skip=skip)
    if json:
        shown = {"notes": made.notes, "fields": made.fields, "meshes": made.meshes}
        console.print_json({"input": user_path(source), "output": user_path(page), **shown})
    elif not quiet:
        for note in made.notes:
            console.out().print(note)
        console.out().print(f"wrote [bold]{console.escape(printable_path(page))}[/]; open it in a browser")


@app.command(epilog="Example: bezier-filters demo my_scan.ply --out pictures")
def demo(
    source: Annotated[
        Path | None,
        typer.Argument(
            help="Any mesh; the bunny that pymeshlab ships if left out.",
            metavar="MESH",
            parser=parse_path,
            callback=read_pipe,
        ),
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder for the files.")] = Path("out"),
    skip: Skip = False,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Write normals, curvature and torsion of a mesh in colour.

    There are four PLY files, with normals, mean and Gaussian curvature and torsion, and one picture of them.
    """
    from bezier_filters.pictures.demo import paths, run_demo

    *_, picture = written = paths(out, source)
    for path in filter(Path.exists, written):  # the folder is made
        check_target(path, *filter(None, [source]), overwrite=overwrite)
    files: list[Report] = []
    warnings: list[str] = []
    with console.stages(quiet=quiet or json) as stage:
        for label, path, outcome in run_demo(out, source, stage, skip=skip):
            if not (quiet or json):
                if not files:
                    console.print_status(outcome, printable_path(source or "bunny"))
                console.print_statistics(outcome, label)
                console.print_written(outcome, printable_path(path))
            warnings += outcome["warnings"]
            files.append({"output": user_path(path), **outcome})
    if json:
        console.print_json({"files": files, "picture": user_path(picture)})
    elif not quiet:
        console.out().print(f"wrote [bold]{console.escape(printable_path(picture))}[/]; open the PLY files in MeshLab")
    end_with_remarks(printable_path(out), {"warnings": list(dict.fromkeys(warnings))})


@app.command("compile", epilog="Example: bezier-filters compile --jobs 2")
def compile_all(
    jobs: Annotated[int | None, typer.Option(help="Number of processes; all cores by default.", min=1)] = None,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Compile all kernels, so that no other command has to.

    This is for containers, and for programs that must not wait. Code that is there already, for example in the package
    itself, is not compiled again. NUMBA_CACHE_DIR is the folder for the code; by default it is in the package, or in
    the user's cache folder.
    """
    from bezier_filters.compilation import compile_kernels

    with console.stages(quiet=quiet or json) as stage:
        done = compile_kernels(processes=jobs, progress=stage("compiling"))
    if json:
        folder = None if done.folder is None else str(done.folder)
        console.print_json(asdict(done) | {"folder": folder})
    elif not quiet:
        console.out().print(
            f"{done.functions:,} compiled functions are there, {done.size / 1e6:.1f} MB; "
            f"this took {done.seconds:.1f} s in {done.processes} processes"
        )


_TOO_LITTLE_MEMORY = "there is not enough memory for this mesh; nothing was written"
_NO_THREAD = "can't start new thread"  # Python's message


def serve_command_line() -> None:
    """Run the command line in a child process, and end that."""
    from bezier_filters.runtime.supervision import serve

    if sys.stdout is not None and hasattr(sys.stdout, "reconfigure"):
        sys.stdout.reconfigure(errors="backslashreplace")  # as of stderr: names of files may be no text
    sys.argv[0] = "bezier-filters"  # as which it is named in the help
    serve(_run)


def _run() -> str:
    """Run the command line; return why it failed, in one line."""
    from bezier_filters.errors import CancelledError

    try:
        with file_remarks() as remarks:
            try:
                app()
            except SystemExit as end:
                if end.code in (None, 0, EXIT_INCOMPLETE):
                    remarks.show()
                    if remarks.losses:
                        raise SystemExit(EXIT_INCOMPLETE) from None
                raise
    except (ValueError, OSError, ImportError, CancelledError) as error:
        return _one_line_message(error)
    except MemoryError:
        return _TOO_LITTLE_MEMORY
    except Exception as error:
        if isinstance(error, RuntimeError) and str(error) == _NO_THREAD:  # for want of memory for its stack
            return _TOO_LITTLE_MEMORY
        # pymeshlab's exceptions share no base but Exception, and importing it here would be slow.
        if not any(base.__name__ == "PyMeshLabException" for base in type(error).__mro__):
            raise
        return _one_line_message(error)
    return ""


def _one_line_message(error: Exception) -> str:
    if isinstance(error, OSError) and error.strerror and error.filename:
        return f"{printable_path(error.filename)}: {error.strerror}"
    text = shell_message(" ".join(replace_pipe_paths(str(error)).split())) or type(error).__name__
    return escape_unprintable(text)
