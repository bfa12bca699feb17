"""The command line ``bezier-filters``."""

import sys
from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from bezier_filters.arrays import Report
from bezier_filters.cli import batch, console, filters, pictures, scale
from bezier_filters.cli.app import Json, Quiet, Source, app
from bezier_filters.meshes.mesh import TriangleMesh

__all__ = ["app", "batch", "filters", "pictures", "scale", "serve_command_line"]


@app.command(epilog="Example: bezier-filters info scan.ply")
def info(source: Source, json: Json = False) -> None:
    """Say what is in a mesh or point cloud, how much noise there is, and whether it is fit for fitting."""
    from bezier_filters.meshes.diagnosis import inspect_mesh
    from bezier_filters.meshes.mesh import triangle_mesh
    from bezier_filters.meshlab.mesh_files import load_mesh
    from bezier_filters.meshlab.meshset import current_mesh
    from bezier_filters.meshlab.topology import topology_of

    ms = load_mesh(source)
    loaded = current_mesh(ms)
    mesh = triangle_mesh(loaded.vertex_matrix(), loaded.face_matrix())
    topology = topology_of(mesh.vertices, mesh.faces).counts
    summary = console.mesh_summary(mesh, inspect_mesh(mesh), topology, _noise_of(mesh) if mesh.face_count else None)
    if json:
        console.print_json({"file": str(source), **summary})
    else:
        console.print_mesh_summary(summary, str(source))


def _noise_of(mesh: TriangleMesh) -> Report:
    """The noise of a mesh, learned as for fitting and smoothing."""
    from bezier_filters.estimation.first_call import first_call
    from bezier_filters.estimation.noise_free import learn_noise
    from bezier_filters.meshes.adjacency import vertex_adjacency
    from bezier_filters.runtime.parallel import thread_count

    threads = thread_count(None)
    with first_call():
        found = learn_noise(mesh, vertex_adjacency(mesh, threads=threads), threads=threads)
    if found is None:
        return {"sigma": None, "length": None, "heavy": False}
    return {"sigma": found.sigma, "length": found.length, "heavy": found.heavy}


@app.command(epilog="Example: bezier-filters demo my_scan.ply --out pictures")
def demo(
    source: Annotated[
        Path | None, typer.Argument(help="Any mesh; the bunny that pymeshlab ships if left out.", metavar="MESH")
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder for the files.")] = Path("out"),
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Write normals, mean and Gaussian curvature and torsion of a mesh as coloured PLYs and one picture."""
    from bezier_filters.pictures.demo import picture_path, run_demo

    files = []
    for number, step in enumerate(run_demo(out, source)):
        files.append({"output": str(step.path), **step.report})
        if quiet or json:
            continue
        if number == 0:
            console.print_status(step.report, str(source or "bunny"))
        console.print_statistics(step.report, step.field.label)
        console.print_written(step.report, str(step.path))
    if json:
        console.print_json({"files": files, "picture": str(picture_path(out, source))})
    elif not quiet:
        console.out.print(f"wrote [bold]{escape(str(picture_path(out, source)))}[/]; open the PLY files in MeshLab")


def serve_command_line() -> None:
    """Run the command line in a child process, and end that."""
    from bezier_filters.runtime.supervision import serve

    sys.argv[0] = "bezier-filters"  # as which it is named in the help
    serve(_run)


def _run() -> str:
    """Run the command line; return why it failed, in one line."""
    from bezier_filters.errors import CancelledError

    try:
        app()
    except (ValueError, OSError, ImportError, CancelledError) as error:
        return _in_one_line(error)
    except MemoryError:
        return "there is not enough memory for this mesh; nothing was written"
    except Exception as error:
        # pymeshlab's exceptions share no base but Exception, and importing it here would be slow.
        if not any(base.__name__ == "PyMeshLabException" for base in type(error).__mro__):
            raise
        return _in_one_line(error)
    return ""


def _in_one_line(error: Exception) -> str:
    if isinstance(error, OSError) and error.strerror and error.filename:
        return f"{error.filename}: {error.strerror}"
    return " ".join(str(error).split()) or type(error).__name__
