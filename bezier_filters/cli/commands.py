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

from bezier_filters._version import __version__
from bezier_filters.cli import batch, console, filters, inspection, pictures, scale, textures
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
from bezier_filters.cli.reading import file_remarks
from bezier_filters.errors import InvalidParameterError
from bezier_filters.runtime.file_names import (
    escape_unprintable,
    printable_name,
    printable_path,
    replace_pipe_paths,
    user_path,
)
from bezier_filters.runtime.process_end import child_environment
from bezier_filters.runtime.supervision import EXIT_INCOMPLETE

if TYPE_CHECKING:
    from bezier_filters.arrays import Report
    from bezier_filters.meshes.prepared_mesh import PreparedMesh
    from bezier_filters.meshlab.meshset import CurrentMesh

__all__ = ["app", "batch", "filters", "inspection", "pictures", "scale", "serve_command_line", "textures"]

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
    """Run a command whenever MeshLab, or another program, saves the mesh; reload the result there to see it.

    It also runs at the start. Errors are printed, and the command waits for the next save. Ctrl-C ends it.
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
    """Show the contents of a mesh or point cloud, its noise, and whether it is fit for fitting."""
    with console.stages(quiet=json) as stage:
        _, summary = _inspect(source, stage, skip=skip)
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
    """Write a page with a verdict on the mesh, the mesh in 3D and its measurements: one file, no network.

    It begins with the noise, the holes and what stands in the way, each with the command that acts on it, and the mesh
    before and after smoothing and filling. Then come curvature, torsion, standard errors and status, whose values stand
    under the pointer, sharp edges, profiles, and the output of info. Pictures and tables can be saved and printed.
    """
    from bezier_filters.pictures.page import report_page
    from bezier_filters.pictures.views import Orientation, check_axes, file_up

    page = Path(source.name).with_suffix(".html") if page is None else page
    if page.suffix.lower() not in (".html", ".htm"):
        raise typer.BadParameter(f"PAGE: got {str(page)!r}, expected a file name that ends in .html")
    check_target(page, source, overwrite=overwrite)
    check_axes(up, front)
    with console.stages(quiet=quiet or json) as stage:
        mesh, summary = _inspect(source, stage, skip=skip)
        made = report_page(
            printable_name(source),
            mesh,
            console.summary_rows(summary),
            summary["findings"],
            source=printable_path(source),
            about=file_facts(source),
            can_be_repaired=summary["can_be_repaired"],
            oriented=Orientation(up, front, file_up(source)),
            stage=stage,
        )
        made.save(page)
    if json:
        shown = {"notes": made.notes, "fields": made.fields, "meshes": made.meshes}
        console.print_json({"input": user_path(source), "output": user_path(page), **shown})
    elif not quiet:
        for note in made.notes:
            console.out().print(note)
        console.out().print(f"wrote [bold]{console.escape(printable_path(page))}[/]; open it in a browser")


def file_facts(source: Path) -> list[str]:
    """Date, version, and size of a file."""
    size, unit = float(source.stat().st_size), "bytes"
    for larger in ("kB", "MB", "GB"):
        if size >= 1000.0:
            size, unit = size / 1000.0, larger
    return [time.strftime("%Y-%m-%d"), f"bezier-filters {__version__}", f"{size:.3g} {unit}"]


def _inspect(source: Path, stage: console.Stage, *, skip: bool) -> tuple["CurrentMesh", "Report"]:
    """A mesh, and the report of `info`."""
    from bezier_filters.meshes.diagnosis import can_be_repaired, diagnose, inspect_mesh, is_fit
    from bezier_filters.meshes.mesh import triangle_mesh
    from bezier_filters.meshes.prepared_mesh import prepare_mesh
    from bezier_filters.meshlab.mesh_files import contents_of, load_mesh
    from bezier_filters.meshlab.meshset import read_current_mesh
    from bezier_filters.meshlab.topology import topology_of
    from bezier_filters.noise.rounded_coordinates import describe_rounding

    stage(f"reading {printable_name(source)}")
    ms = load_mesh(source, skip=skip)
    stage(f"inspecting {printable_name(source)}")
    loaded = read_current_mesh(ms)
    mesh = triangle_mesh(loaded.vertices, loaded.faces)
    topology = topology_of(mesh.vertices, mesh.faces).counts
    faults, prepared = inspect_mesh(mesh), prepare_mesh(mesh)
    stage("learning the noise")
    return loaded, {
        "vertices": mesh.vertex_count,
        "faces": mesh.face_count,
        **topology,
        **asdict(faults),
        "bounding_box": [mesh.vertices.min(axis=0).tolist(), mesh.vertices.max(axis=0).tolist()],
        "noise": _noise_of(prepared) if mesh.face_count else None,
        "fit_for_fitting": is_fit(mesh, faults),
        "findings": [*diagnose(mesh, faults), *filter(None, [describe_rounding(prepared)])],
        "can_be_repaired": can_be_repaired(faults),
        "contents": contents_of(ms),
    }


def _noise_of(mesh: "PreparedMesh") -> "Report":
    """Noise of a mesh, learned as for fitting and smoothing, as arguments of `noise_in_words`."""
    from bezier_filters.fitting.first_call import first_call
    from bezier_filters.fitting.noise_level import explain_unknown_noise, learn_mesh_noise
    from bezier_filters.runtime.parallel import use_threads

    with use_threads(), first_call():
        found = learn_mesh_noise(mesh)
        if found is None:
            reason = explain_unknown_noise(mesh)
            return {"sigma": None, "length": None, "heavy": False, "reason": reason}
    return {"sigma": found.sigma, "length": found.length, "heavy": found.heavy, "reason": ""}


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
    """Write normals, mean and Gaussian curvature and torsion of a mesh as coloured PLYs and one picture."""
    from bezier_filters.pictures.demo import paths, run_demo

    *_, picture = written = paths(out, source)
    for path in written:
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
    """Compile all kernels, so that no other command has to: for containers, and for programs that must not wait.

    Code that is there already, for example in the package itself, is not compiled again. NUMBA_CACHE_DIR is the folder
    for the code; by default it is in the package, or in the user's cache folder.
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
