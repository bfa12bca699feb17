"""Output of the command line: reports as text or JSON, and progress.

Rich is imported on first output: that takes longer than all of the help.
"""

from __future__ import annotations  # the annotated types are slow to import

import json
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from typing import TYPE_CHECKING, Any

from bezier_filters.display import noise_in_words, noise_level
from bezier_filters.fields import CURVATURE, qualities
from bezier_filters.runtime.file_names import printable_path
from bezier_filters.status import FitStatus

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from bezier_filters.arrays import Report
    from bezier_filters.runtime.parallel import Progress as ProgressCallback

MAX_LISTED_HOLES = 20  # rows of the table of holes
FILLS = {
    "surface": "on the surface that continues the one around the hole",
    "creases": "smooth between sharp edges, which go on through the hole",
    "variational": "bent as little as the rim allows, where no surface was found to go on",
    "flat": "in the plane of the rim, where the surface ends in it; else a membrane, where nothing smoother fits",
    "straight": "on the straight band between two rims, where the surface ends at an angle",
    "paper": "on bicubic patches over the plane of the hole",
}


@cache
def out() -> Console:
    """Console for reports: stdout."""
    return _console(stderr=False)


@cache
def err() -> Console:
    """Console for remarks and progress: stderr."""
    return _console(stderr=True)


def _console(*, stderr: bool) -> Console:
    from rich.console import Console

    return Console(stderr=stderr, highlight=False, soft_wrap=True, emoji=False)


def escape(text: str) -> str:
    """Escape text for printing without markup."""
    from rich.markup import escape

    return escape(text)


def _table(**options: Any) -> Table:
    from rich.table import Table

    return Table(box=None, **options)


Stage = Callable[[str], "ProgressCallback | None"]  # begins one, see `stages`


@contextmanager
def stages(*, quiet: bool) -> Iterator[Stage]:
    """Show progress on stderr while the block runs.

    The function that it yields begins a stage, given its name, and returns the callback of the bar, or None if stderr
    is not a terminal.
    """
    if quiet or not err().is_terminal:
        yield lambda name: None
        return
    from bezier_filters.cli.progress import progress_bar

    with progress_bar(err()) as begin:
        yield begin


def print_json(data: Report) -> None:
    """Print a report as JSON on stdout, or where text goes instead."""
    print(json.dumps(data, indent=2, ensure_ascii=False), file=out().file)


def print_status(report: Report, source: str) -> None:
    """Print the outcome of the fits of a mesh."""
    out().print(f"[bold]{escape(source)}[/]: {sum(report['status'].values()):,} vertices")
    _print_repaired(report)
    fit = report["fit"]
    weight = "weights learned from the mesh" if fit["alpha"] is None else f"alpha {fit['alpha']:g}"
    noise = ""
    if fit["noise_sigma"] is not None or fit["noise_reason"]:
        known, edge = (fit["noise_sigma"], fit["noise_length"], fit["noise_heavy"]), report.get("mean_edge")
        noise = f"; {noise_in_words(*known, edge, reason=fit['noise_reason'])}"
    where = f"on {fit['rings']} rings" if fit["radius"] is None else f"within a radius of {fit['radius']:.4g} (length)"
    out().print(f"  fitted {where}, degree {fit['degree']}, {weight}{noise}")
    for name, count in report["status"].items():
        out().print(f"  {count:>9,}  {FitStatus[name].message} ({name})")


def print_tiles(report: Report) -> None:
    """Print statistics of the tiles of a large mesh."""
    there = report["tiles"] * report["rounds"] - report["computed_tiles"]
    rounds = f" in {report['rounds']} rounds" if report["rounds"] > 1 else ""
    out().print(
        f"  {report['tiles']:,} tiles of {report['tile_vertices']:,} vertices{rounds}, {report['halo']:.0%} read "
        f"around them; {there:,} existed already; {report['peak_bytes']['worker'] / 1e9:.2f} GB per worker at most"
    )
    dashboard = f", dashboard {report['dashboard']}" if report["dashboard"] else ""
    out().print(f"  scheduler {report['scheduler']}{dashboard}", markup=False)
    if report["damaged_tiles"]:
        out().print(f"  damaged, and computed again: tiles {', '.join(map(str, report['damaged_tiles']))}")


def print_noise(report: Report) -> None:
    """Print the noise of a large mesh before and after smoothing."""
    if "noise" not in report:  # the paper's method ignores it
        return
    noise = report["noise"]
    before, after = noise_in_words(noise["before"], noise["length"], noise["heavy"]), noise_level(noise["after"])
    out().print(f"  {before}; {after} after; {report['faces']['new']:,} new wrong faces")


def _noise_change(report: Report) -> str:
    """The noise before and after smoothing."""
    edge = report["mean_edge"]
    known = report["noise_before"], report["noise_length"], report["noise_heavy"]
    before = noise_in_words(*known, edge, reason=report["noise_reason"])
    return f"{before}; {noise_level(report['noise_after'], edge)} after"


def print_smoothing(report: Report, source: str) -> None:
    """Print the effect of smoothing on a mesh."""

    def edges(length: float | None) -> str:
        return f"{length / report['mean_edge']:.3g}" if length is not None and report["mean_edge"] else "unknown"

    table = _table(show_header=False, padding=(0, 2, 0, 2))
    table.add_row("noise", _noise_change(report).removeprefix("noise "))
    moved = ", ".join(f"{name} {edges(value)}" for name, value in report["displacement"].items())
    table.add_row("displacement", f"{moved} \\[mean edges]; {report['moved']:,} vertices moved")
    if not report["moved"]:
        clean = "nothing moved: the mesh is clean, smoothing would take more shape than noise"
        table.add_row("", clean if report["noise_before"] is not None else "nothing moved: the noise is not known")
    if report["volume_ratio"] is not None:
        table.add_row("volume", f"{report['volume_ratio']:.6f} times as before")
    for kind in ("flipped", "degenerate") if report["topology"] else ():  # a point cloud has no faces
        table.add_row(f"{kind} faces", f"{report[f'{kind}_before']:,} before, {report[f'{kind}_after']:,} after")
    out().print(f"[bold]{escape(source)}[/]")
    _print_repaired(report)
    out().print(table)


def _print_repaired(report: Report) -> None:
    """Print the repairs of a mesh."""
    changes = {name.replace("_", " "): count for name, count in (report.get("repaired") or {}).items() if count}
    if changes:
        out().print("  repaired: " + ", ".join(f"{count:,} {name}" for name, count in changes.items()))


def shell_remark(text: str) -> str:
    """A remark on holes with names of options instead of parameters.

    >>> shell_remark("the outer rim of an open sheet; outer_rims=True fills it, too")
    'the outer rim of an open sheet; --outer-rims fills it, too'
    """
    return re.sub(r"(\w+)=True( of the filter)?", lambda found: f"--{found[1].replace('_', '-')}", text)


def print_holes(report: Report, source: str) -> None:
    """Print how the holes of a mesh were filled."""
    from rich.padding import Padding

    out().print(f"[bold]{escape(source)}[/]")
    _print_repaired(report)
    if not report["holes"]:
        out().print("  no holes")
        return
    out().print("    edges  diameter [length]  fill         new faces  rim angle [degrees]", markup=False)
    for hole in sorted(report["holes"], key=lambda hole: -hole["edge_count"])[:MAX_LISTED_HOLES]:
        angle = f"{hole['rim_dihedral']:.1f}" if hole["filled"] else ""
        method = hole["method"] or "left open"
        size = f"{hole['edge_count']:>9,}  {hole['diameter']:>17.3g}"
        out().print(f"{size}  {method:<11}  {hole['new_faces']:>9,}  {angle:>19}".rstrip())
        if hole["reason"]:
            remark = "tried before: " * hole["filled"] + shell_remark(hole["reason"])
            out().print(Padding(escape(remark), (0, 2, 0, 11), expand=False), soft_wrap=False)
    if len(report["holes"]) > MAX_LISTED_HOLES:
        out().print(f"  and {len(report['holes']) - MAX_LISTED_HOLES:,} smaller ones")
    used = {hole["method"] for hole in report["holes"] if hole["filled"]}
    for method, meaning in FILLS.items():
        if method in used:
            out().print(f"  {method + ':':<12} {meaning}")
    if used:
        out().print("  rim angle:   between old and new faces, the mean; small is smooth")
    out().print(
        f"  {report['closed_holes']:,} filled with {report['new_faces']:,} faces, {report['open_holes']:,} left open"
    )
    if report["trimmed_faces"]:
        out().print(f"  {report['trimmed_faces']:,} old faces at rims removed, which intersected others")
    others = sum(hole["filled"] and hole["reason"].startswith("paper: ") for hole in report["holes"])
    if others:
        out().print(f"  {others:,} of them by another method than the paper's, which does not work there")


def print_replacements(report: Report, source: str) -> None:
    """Print what was removed of the parts of a selection."""
    from rich.padding import Padding

    out().print(f"[bold]{escape(source)}[/]")
    out().print("    faces  volume removed  height removed  fill         new faces", markup=False)
    for patch in sorted(report["patches"], key=lambda patch: -patch["old_faces"])[:MAX_LISTED_HOLES]:
        hole = patch["hole"]
        measures = f"{patch['removed_volume']:>14.4g}  {patch['removed_height']:>14.4g}" if patch["replaced"] else ""
        fill = f"{hole['method'] or 'left as is':<11}  {hole['new_faces']:>9,}"
        out().print(f"{patch['old_faces']:>9,}  {measures:<30}  {fill}", markup=False)
        if hole["reason"]:
            remark = "tried before: " * patch["replaced"] + shell_remark(hole["reason"])
            out().print(Padding(escape(remark), (0, 2, 0, 11), expand=False), soft_wrap=False)
    if len(report["patches"]) > MAX_LISTED_HOLES:
        out().print(f"  and {len(report['patches']) - MAX_LISTED_HOLES:,} smaller ones")
    out().print(
        f"  {report['replaced_patches']:,} replaced, {report['removed_faces']:,} faces by {report['new_faces']:,}; "
        f"{report['kept_patches']:,} left as they were; volume removed {report['removed_volume']:.4g}"
    )


def print_bridges(report: Report, source: str) -> None:
    """Print which holes there were, and how pairs of them were joined."""
    from rich.padding import Padding

    bands = {number: band for band in report["bands"] for number in band["pair"]}
    out().print(f"[bold]{escape(source)}[/]")
    out().print("    hole      edges  diameter [length]  joined to  by           center", markup=False)
    for number, hole in enumerate(report["holes"][:MAX_LISTED_HOLES]):
        band, joined = bands.get(number), ""
        if band is not None:
            (other,) = (k for k in band["pair"] if k != number)
            joined = f"{other:>9,}  {band['method'] or 'not joined':<11}"
        center = ", ".join(f"{x:.3g}" for x in hole["center"])
        out().print(
            f"{number:>8,}  {hole['edge_count']:>9,}  {hole['diameter']:>17.3g}  {joined:<22}  {center}", markup=False
        )
    if len(report["holes"]) > MAX_LISTED_HOLES:
        out().print(f"  and {len(report['holes']) - MAX_LISTED_HOLES:,} more")
    for band in report["bands"]:
        if band["reason"]:
            remark = f"{band['pair'][0]} and {band['pair'][1]}: {shell_remark(band['reason'])}"
            out().print(Padding(escape(remark), (0, 2, 0, 4), expand=False), soft_wrap=False)
    out().print(
        f"  {report['bridged_pairs']:,} pairs joined with {report['new_faces']:,} faces, "
        f"{report['open_pairs']:,} left open"
    )


def print_remeshing(report: Report, source: str) -> None:
    """Print how many vertices and faces there were and are."""
    out().print(f"[bold]{escape(source)}[/]")
    for name in ("vertices", "faces"):
        out().print(f"  {report[f'old_{name}']:,} {name} before, {report[name]:,} after", markup=False)
    if report["chord_error"] is not None:
        out().print(f"  edges are within {report['chord_error']:.3g} of the surface", markup=False)


def print_creases(report: Report, source: str) -> None:
    """Print number, length and strength of the lines of each kind."""
    out().print(f"[bold]{escape(source)}[/]")
    table = _table(padding=(0, 2, 0, 2))
    for column in ("", "lines", "length", "strongest", "least certain"):
        table.add_column(column, justify="right" if column else "left")
    for kind in ("ridge", "ravine"):
        for is_sharp in (True, False):
            lines = [line for line in report["lines"] if (line["kind"], line["is_sharp"]) == (kind, is_sharp)]
            length = sum(line["length"] for line in lines)
            strongest = max((line["strength"] for line in lines), default=0)
            certain = f"{min(line['certainty'] for line in lines):.1%}" if lines else ""
            name = f"{'sharp ' * is_sharp}{kind}s"
            table.add_row(name, f"{len(lines):,}", f"{length:.4g}", f"{strongest:.3g}", certain)
    out().print(table)
    if not report["crest_lines_told"]:
        out().print("  ridges and ravines that are not sharp need patches of degree 3; these have 2")


def print_texture(report: Report, source: str) -> None:
    """Print what an image over the texture coordinates of a mesh shows."""
    print_status(report, source)
    scale = "" if report["scale"] is None else f", saturated at a radius of curvature of {report['scale']:.4g} (length)"
    out().print(
        f"  {report['texmap']} map of {report['size']:,} x {report['size']:,} texels, {report['bits']} bits, "
        f"{report['covered']:.0%} in faces{scale}"
    )


def print_lines(report: Report, source: str) -> None:
    """Print number and length of the lines of each kind, umbilics, and why lines end."""
    out().print(f"[bold]{escape(source)}[/]")
    table = _table(padding=(0, 2, 0, 2))
    for column in ("", "lines", "length"):
        table.add_column(column, justify="right" if column else "left")
    for kind, found in report["kinds"].items():
        table.add_row(kind, f"{found['lines']:,}", f"{found['length']:.4g}")
    out().print(table)
    reasons = ", ".join(f"{count:,} {name.lower().replace('_', ' ')}" for name, count in report["ends"].items())
    out().print(
        f"  {len(report['umbilics']):,} umbilics, sum of indices {report['index_sum']:g}; ends: {reasons or 'none'}"
    )


def print_statistics(report: Report, label: str) -> None:
    """Print statistics of a quality, if there are any."""
    if report["statistics"] is None:
        return
    unit = f" [{report['unit']}]" if report["unit"] else ""
    numbers = ", ".join(f"{name} {value:.4g}" for name, value in report["statistics"].items())
    out().print(f"{label}{escape(unit)}: {numbers}")


def print_written(report: Report, target: str) -> None:
    """Print the name of the written file and the time of the filter."""
    out().print(f"wrote [bold]{escape(target)}[/] ({sum(report['seconds'].values()):.2f} s)")


def print_batch(summary: Report) -> None:
    """Print the results of a batch."""
    width = max(len(printable_path(file["input"])) for file in summary["files"])
    for file in summary["files"]:
        name = printable_path(file["input"])
        seconds = "" if file["result"] == "skipped" else f"{file['seconds']:.2f} s"
        report = file["report"] or {}
        remark = file["error"] or "; look at: ".join(filter(None, [_remark(report), *report.get("read", [])]))
        out().print(f"{name:<{width}}  {file['result']:<7}  {seconds:>9}  {remark}".rstrip(), markup=False)
    numbers = ", ".join(f"{summary[result]:,} {result}" for result in ("done", "skipped", "failed"))
    out().print(f"{summary['command']}: {numbers} ({summary['seconds']:.1f} s)")


def _remark(report: Report) -> str:
    """The most important numbers of a filter's report."""
    numbers = _numbers(report)
    if not report.get("warnings"):
        return numbers
    return shell_remark("; look at: ".join(filter(None, [numbers, *report["warnings"]])))


def _numbers(report: Report) -> str:
    if "sharp_edges" in report:
        return f"{len(report['lines']):,} lines, {report['sharp_edges']:,} sharp edges"
    if "index_sum" in report:
        return f"{report['lines']:,} lines, {len(report['umbilics']):,} umbilics"
    if "closed_holes" in report:
        return f"{report['closed_holes']:,} holes filled, {report['open_holes']:,} left open"
    if "old_faces" in report:
        return f"{report['old_faces']:,} faces before, {report['faces']:,} after"
    if "bridged_pairs" in report:
        return f"{report['bridged_pairs']:,} pairs of holes joined, {report['open_pairs']:,} left open"
    if "replaced_patches" in report:
        return f"{report['replaced_patches']:,} patches replaced, {report['kept_patches']:,} left as they were"
    if "texmap" in report:
        return f"{report['texmap']} map, {report['covered']:.0%} of {report['size']:,} x {report['size']:,} texels"
    if "noise_before" in report:
        return _noise_change(report)
    if report.get("statistics"):
        unit = f" [{report['unit']}]" if report["unit"] else ""
        known = qualities(CURVATURE).get(report["quality"])
        return f"{known.label if known else report['quality']}: median {report['statistics']['median']:.4g}{unit}"
    return ""


def summary_rows(summary: Report) -> list[tuple[str, str]]:
    """Contents of a mesh, in words."""
    low, high = summary["bounding_box"]

    def number(key: str) -> str:
        return "undefined (not a manifold)" if summary[key] is None else f"{summary[key]:,}"

    rows = [
        ("vertices, faces", f"{summary['vertices']:,}, {summary['faces']:,}"),
        ("size", " x ".join(f"{b - a:.6g}" for a, b in zip(low, high, strict=True))),
    ]
    if summary["faces"]:
        rows += [
            ("mean edge", f"{summary['mean_edge_length']:.6g}"),
            ("components", number("components")),
            ("genus", number("genus")),
            ("boundary loops", f"{number('boundary_loops')}, {summary['boundary_edges']:,} edges"),
            ("non-manifold", f"{summary['non_manifold_edges']:,} edges, {number('non_manifold_vertices')} vertices"),
        ]
    if summary["noise"]:
        words = noise_in_words(**summary["noise"], edge=summary["mean_edge_length"])
        rows.append(("noise", words.removeprefix("noise ")))
    return [*rows, ("carries", "; ".join(summary["contents"]) or "nothing but its shape")]


def print_mesh_summary(summary: Report, source: str) -> None:
    """Print the contents of a mesh and whether it can be fitted."""
    table = _table(show_header=False, padding=(0, 2, 0, 0))
    for row in summary_rows(summary):
        table.add_row(*map(escape, row))
    out().print(f"[bold]{escape(source)}[/]")
    out().print(table)
    if not summary["findings"]:
        out().print("Fit for fitting: nothing stands in the way.")
        return
    out().print("Fit for fitting, but note:" if summary["fit_for_fitting"] else "[bold]Not fit for fitting:[/]")
    for finding in summary["findings"]:
        out().print(f"  - {finding}")
    if summary["can_be_repaired"]:
        out().print("--repair of normals, curvature, torsion, smooth and fill-holes repairs some of it.")
