"""The command that runs a filter on many files."""

import glob
import io
import json as json_module
import os
import shlex
import time
from collections.abc import Mapping, Sequence
from contextlib import closing, redirect_stderr, redirect_stdout, suppress
from dataclasses import asdict, dataclass, replace
from itertools import takewhile
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from bezier_filters._version import __version__
from bezier_filters.cli import console, filters, inspection, textures
from bezier_filters.cli.app import Json, Quiet, app, choose_scheduler
from bezier_filters.cli.reading import file_remarks
from bezier_filters.errors import InvalidParameterError
from bezier_filters.fields import DEVIATION, MEASURES
from bezier_filters.parameters import PARAMETERS
from bezier_filters.runtime.atomic import atomic_write
from bezier_filters.runtime.checksums import file_checksum
from bezier_filters.runtime.file_names import printable_path
from bezier_filters.runtime.supervision import EXIT_INCOMPLETE

if TYPE_CHECKING:
    from bezier_filters.arrays import Report

# a process that runs a command loads this module alone, so that it needs those of all commands
__all__ = ["Item", "batch", "command_line", "filters", "inspection", "plan", "run_command", "textures"]

# file in the folder of the results: a line of JSON per result, with path, checksum of the input, command and options
RECORDS = ".bezier-filters-batch"
INDEX = "index.html"  # page with all files, in the folder of the results
CLEAN = "clean"  # the command of two filters


@dataclass(frozen=True)
class Item:
    """A file of a batch and its result, as the batch reports it."""

    input: str
    output: str
    result: Literal["waiting", "done", "skipped", "failed"] = "waiting"
    seconds: float = 0.0
    error: str = ""
    report: "Report | None" = None


@app.command(epilog="Example: bezier-filters batch curvature 'scans/*.ply' --out curved --options '--quality gaussian'")
def batch(
    command: Annotated[
        str,
        typer.Argument(
            help="clean, normals, curvature, torsion, smooth, fill-holes, replace, bridge, subdivide, remesh, creases, "
            "lines, bake, compare (whose reference comes first in the options).",
            metavar="COMMAND",
        ),
    ],
    sources: Annotated[
        list[str], typer.Argument(help="Files, or patterns in quotes; ** is any depth of folders.", metavar="FILES")
    ],
    out: Annotated[Path, typer.Option(help="Folder for the results; made if it does not exist.")],
    jobs: Annotated[int | None, typer.Option(help="Number of processes; all cores by default.", min=1)] = None,
    options: Annotated[str, typer.Option(help="Options of the command, in quotes.")] = "",
    suffix: Annotated[str, typer.Option(help="Format of the results.")] = ".ply",
    report: Annotated[
        bool, typer.Option("--report", help="Also write a report on every result, and index.html with all files.")
    ] = False,
    redo: Annotated[bool, typer.Option("--redo", help="Also where there is a result already.")] = False,
    scheduler: Annotated[
        str | None,
        typer.Option(
            help="Address of a Dask scheduler that sees the files under the same paths.", metavar="tcp://HOST:8786"
        ),
    ] = None,
    scheduler_file: Annotated[
        Path | None, typer.Option(help="File with the address, as written by dask scheduler --scheduler-file.")
    ] = None,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Run a command on many files, several at a time.

    Files with a result are skipped if their content, the command, the options and the reference are unchanged, so that
    an interrupted batch continues where it stopped. A file that fails does not stop the others: the table says why, and
    the exit status is 1; it is 3 where none fails but a result needs a look. Below --out, results have the names of the
    files, and the folders below the fixed part of a pattern.
    """
    from bezier_filters.runtime.parallel import usable_threads
    from bezier_filters.runtime.worker_processes import run_in_processes

    start, chosen = time.perf_counter(), choose_scheduler(scheduler, scheduler_file)
    arguments = shlex.split(options)
    reference = check_command(command, arguments)
    how = [command, *arguments, *([file_checksum(reference)] if reference else [])]
    items = plan(find_files(sources), out, suffix, [] if redo else how)
    todo = [index for index, item in enumerate(items) if item.result == "waiting"]
    cores = usable_threads()
    processes = max(1, min(jobs or cores, len(todo)))
    for index in todo:
        Path(items[index].output).parent.mkdir(parents=True, exist_ok=True)
    stamps = {index: _stamp(items[index].input) for index in todo}
    work = [command_line(command, arguments, *_absolute(items[index])) for index in todo]
    if chosen is None:
        run = run_in_processes(run_command, work, processes=processes, threads=max(1, cores // processes))
    else:
        from bezier_filters.scale.scheduling import run_on_scheduler

        run = run_on_scheduler(work, chosen, workers=processes)
    with console.stages(quiet=quiet or json) as stage, closing(run) as outcomes:
        progress = stage(f"{command}: {len(todo):,} files")
        try:
            for done, (position, outcome) in enumerate(outcomes, start=1):
                index = todo[position]
                source = items[index].input
                # A file that has changed meanwhile may have been read in either state.
                if not outcome.error and _stamp(source) == stamps[index] is not None:
                    record = [os.path.relpath(items[index].output, out), file_checksum(source), *how]
                    with (out / RECORDS).open("a", encoding="utf-8") as records:
                        print(json_module.dumps(record), file=records)
                items[index] = replace(
                    items[index],
                    result="failed" if outcome.error else "done",
                    seconds=outcome.seconds,
                    error=outcome.error,
                    report=outcome.result,
                )
                if progress is not None:
                    progress(done, len(todo))
        except KeyboardInterrupt:
            there = sum(item.result in ("done", "skipped") for item in items)
            message = f"{there:,} of {len(items):,} results are in {out}; the same command goes on"
            console.err().print(message, markup=False)
            raise
    summary = summarize(command, items, time.perf_counter() - start)
    if report:
        write_reports(out, summary, quiet=quiet or json)
    if json:
        console.print_json(summary)
    elif not quiet:
        console.print_batch(summary)
    if summary["failed"]:
        raise typer.Exit(1)
    if any((item.report or {}).get("warnings") for item in items):
        raise typer.Exit(EXIT_INCOMPLETE)


def write_reports(out: Path, summary: "Report", *, quiet: bool) -> None:
    """Write a report for each new result that is a mesh, in its folder, and one page with all files.

    Reports that are newer than their results are kept.
    """
    from bezier_filters.pictures.index_page import IndexRow, index_page

    rows = []
    with console.stages(quiet=quiet) as stage:
        progress = stage(f"reports: {len(summary['files']):,} files")
        for done, file in enumerate(summary["files"], start=1):
            target, remark, result = Path(file["output"]), console.batch_remark(file), file["result"]
            page: Path | None = target.with_suffix(".html")
            if result == "failed" or page is None:
                page = None
            elif not page.exists() or page.stat().st_mtime < target.stat().st_mtime:
                try:
                    run_command(["report", "--overwrite", "--", *map(os.path.abspath, (target, page))])
                except (ValueError, OSError) as error:
                    page, remark = None, "; ".join(filter(None, [remark, f"no report: {error}"]))
            looked = "look" if (file["report"] or {}).get("warnings") else result
            link = None if page is None else Path(os.path.relpath(page, out)).as_posix()
            rows.append(IndexRow(printable_path(file["input"]), looked, remark, link))
            if progress is not None:
                progress(done, len(summary["files"]))
    counts = [f"{summary[name]:,} {name}" for name in ("done", "skipped", "failed")]
    about = [time.strftime("%Y-%m-%d"), f"bezier-filters {__version__}", *counts]
    with atomic_write(out / INDEX) as temporary:
        temporary.write_text(index_page(f"{summary['command']}: {len(rows):,} files", about, rows), encoding="utf-8")
    summary["index"] = os.fspath(out / INDEX)


def _absolute(item: Item) -> tuple[str, str]:
    """Absolute paths of the files, valid in other folders, and never mistaken for pipes or options."""
    return os.path.abspath(item.input), os.path.abspath(item.output)


def _read_records(out: Path) -> dict[str, list[str]]:
    """Checksum of the input, command and options of the results below a folder, by their paths there.

    Truncated lines are ignored.
    """
    found = {}
    with suppress(FileNotFoundError, ValueError):
        for line in (out / RECORDS).read_text(encoding="utf-8").splitlines():
            target, *arguments = json_module.loads(line)
            found[target] = arguments
    return found


def _stamp(path: str) -> tuple[int, int] | None:
    """Modification time and size of a file; None if it does not exist."""
    with suppress(OSError):
        status = os.stat(path)
        return status.st_mtime_ns, status.st_size
    return None


def command_line(command: str, options: list[str], source: str, target: str) -> list[str]:
    """Arguments that run a command for one file; the first option of `compare` is its reference."""
    if command == DEVIATION:
        return [command, source, *options, f"--out={target}"]
    return [command, *options, "--", source, target]


def run_command(arguments: Sequence[str]) -> "Report":
    """Run a command line in this process and return its report."""
    printed = io.StringIO()
    with redirect_stdout(printed), redirect_stderr(io.StringIO()), file_remarks() as remarks:
        app([arguments[0], "--json", *arguments[1:]], standalone_mode=False)
    report: Report = json_module.loads(printed.getvalue())
    return report | {"read": [*remarks.losses]} if remarks.losses else report


def check_command(command: str, options: list[str]) -> str | None:
    """Refuse a command that does not run a filter, or options that it does not have; return the reference."""
    if command == MEASURES:
        raise InvalidParameterError("command: got 'measure', which writes no files; run it with --json for each file")
    if command not in (names := (CLEAN, *PARAMETERS)):
        others = ", ".join(name for name in names if name != MEASURES)
        raise InvalidParameterError(f"command: got {command!r}, expected one of {others}")
    group: Any = typer.main.get_command(app)
    line = command_line(command, options, "input", "output")
    parsed = group.commands[command].make_context(command, line[1:])
    for name in ("quiet", "json"):
        if parsed.params[name]:
            raise InvalidParameterError(f"options: got --{name}, which is an option of the batch itself")
    for name, option in (("picture", "picture"), ("save_script", "save-script"), ("page", "report")):
        if parsed.params.get(name):
            raise InvalidParameterError(f"options: got --{option}, which names one file for all")
    if command != DEVIATION:
        return None
    reference: Path = parsed.params["reference"]
    if not os.path.isfile(reference):
        raise InvalidParameterError(f"options: got the reference {str(reference)!r}, which is not a file")
    return str(reference)


def find_files(sources: Sequence[str]) -> dict[Path, str]:
    """Files given by name or pattern, each once, in order; a pattern without matches is refused.

    The value of each is its folder relative to the fixed part of the pattern, which does not depend on other files.
    """
    found: dict[Path, str] = {}
    for source in sources:
        if source == "-":
            raise InvalidParameterError("files: got -, but a batch reads files, not the standard input")
        if not glob.has_magic(source) or os.path.exists(source):
            found[Path(source)] = ""
            continue
        matches = sorted(path for path in glob.glob(source, recursive=True) if os.path.isfile(path))
        if not matches:
            raise InvalidParameterError(f"files: nothing matches {source!r}")
        fixed = Path(*takewhile(lambda part: not glob.has_magic(part), Path(source).parts))
        found |= {Path(path): os.path.relpath(os.path.dirname(path) or ".", fixed) for path in matches}
    return found


def plan(sources: Mapping[Path, str], out: Path, suffix: str, done: Sequence[str] = ()) -> list[Item]:
    """Paths of the results below `out`, and which of them exist already for this command and these options.

    Results have the names and the relative folders of their inputs. They must differ from each other and from inputs.
    """
    if not suffix.startswith("."):
        raise InvalidParameterError(f"suffix: got {suffix!r}, expected a suffix with its dot, such as .ply")
    items: dict[str, Item] = {}
    taken = {os.path.realpath(source) for source in sources}
    recorded = _read_records(out)
    for source, folder in sources.items():
        target = out / folder / f"{source.stem}{suffix}"
        real = os.path.realpath(target)
        if real in taken:
            raise InvalidParameterError(f"out: {target} is one of the inputs; choose another folder")
        if real in items:
            raise InvalidParameterError(
                f"files: {items[real].input} and {source} would both become {target}; a pattern in quotes from a "
                "folder above them keeps their folders"
            )
        checksum, *how = recorded.get(os.path.relpath(target, out), [""])
        there = bool(done) and how == list(done) and target.is_file() and source.is_file()
        same = there and file_checksum(source) == checksum
        items[real] = Item(str(source), str(target), "skipped" if same else "waiting")
    return list(items.values())


def summarize(command: str, items: Sequence[Item], seconds: float) -> "Report":
    """Summary of the batch as a dict that can be written as JSON."""
    count = {result: sum(item.result == result for item in items) for result in ("done", "skipped", "failed")}
    return {"command": command, **count, "seconds": seconds, "files": [asdict(item) for item in items]}
