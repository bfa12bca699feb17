"""The command that runs a MeshLab filter script."""

from pathlib import Path
from typing import Annotated

import typer

from bezier_filters.cli import console
from bezier_filters.cli.app import app
from bezier_filters.cli.options import Json, Quiet, Source, Target


@app.command(epilog="Example: bezier-filters run repair.mlx scan.ply clean.ply")
def run(
    script: Annotated[Path, typer.Argument(help="Filter script to run.", metavar="SCRIPT.mlx")],
    source: Source,
    target: Target,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Run a MeshLab filter script, whose steps may be MeshLab's filters and those of this package.

    Such a script is the .mlx file that MeshLab and pymeshlab save, or --save-script of the other commands. The name of
    a step is MeshLab's, pymeshlab's, or one of this package, such as compute_curvature_by_bezier_patch_per_vertex.
    Names are checked before the first step runs; the output is written after the last.
    """
    from dataclasses import asdict

    from bezier_filters.files.filter_scripts import read_filter_script
    from bezier_filters.meshlab.mesh_files import format_support, load_mesh, save_mesh
    from bezier_filters.meshlab.script_runner import check_steps, run_filter_script

    steps = read_filter_script(script)
    names = check_steps(steps)
    format_support(target)
    ms = load_mesh(source)
    with console.progress_bar(script.name, quiet=quiet or json) as progress:
        done = run_filter_script(ms, steps, progress=progress)
    save_mesh(ms, target)
    if json:
        summary = {"script": str(script), "input": str(source), "output": str(target)}
        console.print_json(summary | {"steps": [asdict(report) for report in done]})
    elif not quiet:
        width = max(map(len, names), default=0)
        for report in done:
            console.out.print(f"{report.filter:<{width}}  {report.by:<14}  {report.seconds:7.2f} s", markup=False)
        console.print_written({"seconds": dict(enumerate(report.seconds for report in done))}, str(target))
