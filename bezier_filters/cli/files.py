"""What every command that filters a file does around the filter: load, save, report."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from bezier_filters.cli import console


def filter_file(
    run: Callable[..., dict[str, Any]],
    source: Path,
    target: Path,
    options: dict[str, Any],
    *,
    save_script: Path | None,
    quiet: bool,
    json: bool,
    label: str = "",
    verb: str = "fitting",
    show: Callable[[dict[str, Any], str], None] = console.print_status,
    needs_quality: bool = True,
) -> None:
    """Load, filter, save and report."""
    from bezier_filters.meshlab.mesh_files import format_support, load_mesh, save_mesh

    support = format_support(target)
    ms = load_mesh(source)
    with console.progress_bar(f"{verb} {source.name}", quiet=quiet or json) as progress:
        report = run(ms, progress=progress, **options)
    save_mesh(ms, target)
    if save_script is not None:
        _add_step(save_script, run.__name__, options)
    if json:
        console.print_json({"input": str(source), "output": str(target), **report})
    elif not quiet:
        show(report, str(source))
        if report.get("statistics"):
            console.print_statistics(report, label)
        console.print_written(report, str(target))
    if needs_quality and not support.quality:
        console.err.print(
            f"note: {target.suffix} files hold no quality and no bz_* columns; write a PLY file to keep them"
        )


def _add_step(script: Path, name: str, options: dict[str, Any]) -> None:
    """Write a filter script with one step more; threads are a matter of the machine, not of the script."""
    from bezier_filters.files.filter_scripts import read_filter_script, save_filter_script
    from bezier_filters.meshlab.script_values import script_step

    before = read_filter_script(script) if script.exists() else []
    save_filter_script(script, [*before, script_step(name, **(options | {"threads": None}))])
