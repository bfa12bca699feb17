"""Output of the command line: reports as text or JSON, and progress.

Rich is imported on first output: that takes longer than all of the help.
"""

from __future__ import annotations  # the annotated types are slow to import

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from typing import TYPE_CHECKING, Any

from bezier_filters.cli.outcomes import describe_outcome, main_reason
from bezier_filters.display import noise_in_words, noise_level, shell_remark
from bezier_filters.inspection.deviation_status import DeviationStatus
from bezier_filters.runtime.file_names import printable_path
from bezier_filters.status import FitStatus

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from bezier_filters.arrays import Report
    from bezier_filters.runtime.parallel import Progress as ProgressCallback

MAX_LISTED_HOLES = 10  # rows of the table of holes, unless all are asked for
MAX_LISTED_REGIONS = 10  # regions that deviate
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

    The function that it yields begins a stage, given its name, and returns the callback of the bar; where stderr is no
    terminal, the callback prints a line now and then.
    """
    if quiet:
        yield lambda name: None
        return
    from bezier_filters.cli.progress import progress_bar, progress_lines

    if not err().is_terminal:
        yield progress_lines(lambda text: err().print(text, markup=False))
        return
    with progress_bar(err()) as begin:
        yield begin


def print_json(data: Report) -> None:
    """Print a report as JSON on stdout, or where text goes instead."""
    print(json.dumps(data, indent=2, ensure_ascii=False), file=out().file)


def print_status(report: Report, source: str, *, verbose: bool = False) -> None:
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
    if fit["neighbours"] is not None:
        where = f"on {fit['neighbours']} nearest points"
    out().print(f"  fitted {where}, degree {fit['degree']}, {weight}{noise}")
    if report.get("flipped") is not None:
        out().print(f"  normals oriented by viewpoints; {report['flipped']:,} contradict them")
    for name, count in report["status"].items():
        message, _, cause = FitStatus[name].message.partition(": ")
        out().print(f"  {count:>9,}  {message}" + (f": {cause} ({name})" if verbose and cause else f" ({name})"))


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


def print_smoothing(report: Report, source: str, *, verbose: bool = False) -> None:
    """Print the effect of smoothing on a mesh."""

    def edges(length: float | None) -> str:
        return f"{length / report['mean_edge']:.3g}" if length is not None and report["mean_edge"] else "unknown"

    table = _table(show_header=False, padding=(0, 2, 0, 2))
    known = report["noise_before"], report["noise_length"], report["noise_heavy"]
    noise = noise_in_words(*known, report["mean_edge"], reason=report["noise_reason"])
    table.add_row("noise", noise.removeprefix("noise "))
    moved = ", ".join(f"{name} {edges(value)}" for name, value in report["displacement"].items())
    table.add_row("displacement", f"{moved} \\[mean edges]")
    table.add_row("moved", f"{report['moved']:,} vertices")
    if not report["moved"]:
        clean = "nothing moved: the mesh is clean, smoothing would take more shape than noise"
        table.add_row("", clean if report["noise_before"] is not None else "nothing moved: the noise is not known")
    if report["volume_ratio"] is not None:
        table.add_row("volume", f"{report['volume_ratio']:.6f} times as before")
    for kind in ("flipped", "degenerate") if report["topology"] else ():  # a point cloud has no faces
        if not (verbose or report[f"{kind}_before"] or report[f"{kind}_after"]):
            continue
        table.add_row(f"{kind} faces", f"{report[f'{kind}_before']:,} before, {report[f'{kind}_after']:,} after")
    out().print(f"[bold]{escape(source)}[/]")
    _print_repaired(report)
    out().print(table)


def _print_repaired(report: Report) -> None:
    """Print the repairs of a mesh."""
    changes = {name.replace("_", " "): count for name, count in (report.get("repaired") or {}).items() if count}
    if changes:
        out().print("  repaired: " + ", ".join(f"{count:,} {name}" for name, count in changes.items()))


def _print_reason(hole: Report, *, is_filled: bool, verbose: bool) -> None:
    """Print below a row of a table why a hole is open, or what was tried before."""
    from rich.padding import Padding

    if hole["reason"] and (verbose or not is_filled):
        remark = "tried before: " * is_filled + (shell_remark(hole["reason"]) if verbose else main_reason(hole))
        out().print(Padding(escape(remark), (0, 2, 0, 11), expand=False), soft_wrap=False)


def print_holes(report: Report, source: str, *, verbose: bool = False) -> None:
    """Print how the holes of a mesh were filled, the largest first."""
    out().print(f"[bold]{escape(source)}[/]")
    _print_repaired(report)
    if not report["holes"]:
        out().print("  no holes")
        return
    out().print("    edges  diameter [length]  fill         new faces  rim angle [degrees]", markup=False)
    listed = len(report["holes"]) if verbose else MAX_LISTED_HOLES
    for hole in sorted(report["holes"], key=lambda hole: -hole["edge_count"])[:listed]:
        angle = f"{hole['rim_dihedral']:.1f}" if hole["filled"] else ""
        method = hole["method"] or "left open"
        size = f"{hole['edge_count']:>9,}  {hole['diameter']:>17.3g}"
        out().print(f"{size}  {method:<11}  {hole['new_faces']:>9,}  {angle:>19}".rstrip())
        _print_reason(hole, is_filled=hole["filled"], verbose=verbose)
    if len(report["holes"]) > listed:
        out().print(f"  and {len(report['holes']) - listed:,} smaller ones; --verbose lists all")
    used = {hole["method"] for hole in report["holes"] if hole["filled"]}
    for method, meaning in FILLS.items():
        if method in used:
            out().print(f"  {method + ':':<12} {meaning}")
    if used:
        out().print("  rim angle:   between old and new faces, the mean; small is smooth")
    if report["trimmed_faces"]:
        out().print(f"  {report['trimmed_faces']:,} old faces at rims removed, which intersected others")
    others = sum(hole["filled"] and hole["reason"].startswith("paper: ") for hole in report["holes"])
    if others:
        out().print(f"  {others:,} of them by another method than the paper's, which does not work there")


def print_replacements(report: Report, source: str, *, verbose: bool = False) -> None:
    """Print what was removed of the parts of a selection, the largest first."""
    out().print(f"[bold]{escape(source)}[/]")
    out().print("    faces  volume removed  height removed  fill         new faces", markup=False)
    listed = len(report["patches"]) if verbose else MAX_LISTED_HOLES
    for patch in sorted(report["patches"], key=lambda patch: -patch["old_faces"])[:listed]:
        hole = patch["hole"]
        measures = f"{patch['removed_volume']:>14.4g}  {patch['removed_height']:>14.4g}" if patch["replaced"] else ""
        fill = f"{hole['method'] or 'left as is':<11}  {hole['new_faces']:>9,}"
        out().print(f"{patch['old_faces']:>9,}  {measures:<30}  {fill}", markup=False)
        _print_reason(hole, is_filled=patch["replaced"], verbose=verbose)
    if len(report["patches"]) > listed:
        out().print(f"  and {len(report['patches']) - listed:,} smaller ones; --verbose lists all")
    out().print(
        f"  {report['replaced_patches']:,} replaced, {report['removed_faces']:,} faces by {report['new_faces']:,}; "
        f"{report['kept_patches']:,} left as they were; volume removed {report['removed_volume']:.4g}"
    )


def print_bridges(report: Report, source: str, *, verbose: bool = False) -> None:
    """Print which holes there were, and how pairs of them were joined."""
    from rich.padding import Padding

    bands = {number: band for band in report["bands"] for number in band["pair"]}
    out().print(f"[bold]{escape(source)}[/]")
    out().print("    hole      edges  diameter [length]  joined to  by           center", markup=False)
    listed = len(report["holes"]) if verbose else MAX_LISTED_HOLES
    for number, hole in enumerate(report["holes"][:listed]):
        band, joined = bands.get(number), ""
        if band is not None:
            (other,) = (k for k in band["pair"] if k != number)
            joined = f"{other:>9,}  {band['method'] or 'not joined':<11}"
        center = ", ".join(f"{x:.3g}" for x in hole["center"])
        out().print(
            f"{number:>8,}  {hole['edge_count']:>9,}  {hole['diameter']:>17.3g}  {joined:<22}  {center}", markup=False
        )
    if len(report["holes"]) > listed:
        out().print(f"  and {len(report['holes']) - listed:,} more; --verbose lists all")
    for band in report["bands"]:
        if band["reason"]:
            remark = f"{band['pair'][0]} and {band['pair'][1]}: {shell_remark(band['reason'])}"
            out().print(Padding(escape(remark), (0, 2, 0, 4), expand=False), soft_wrap=False)
    out().print(
        f"  {report['bridged_pairs']:,} pairs joined with {report['new_faces']:,} faces, "
        f"{report['open_pairs']:,} left open"
    )


def print_remeshing(report: Report, source: str, *, verbose: bool = False) -> None:
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


def print_deviation(report: Report, source: str) -> None:
    """Print how far a mesh is from a reference."""
    out().print(f"[bold]{escape(source)}[/]: {report['compared']:,} of {sum(report['status'].values()):,} compared")
    for name, count in report["status"].items():
        out().print(f"  {count:>9,}  {DeviationStatus[name].message} ({name})")
    if not report["compared"]:
        return
    out().print(f"  mean {report['mean']:.4g}, rms {report['rms']:.4g} \\[length]")
    for name in ("lowest", "highest"):
        end = report[name]
        place = ", ".join(f"{x:.4g}" for x in end["place"])
        out().print(f"  {name} {end['deviation']:.4g} +- {end['std']:.2g} at ({place}), vertex {end['vertex']}")
    if report["share_within"] is not None:
        out().print(f"  {report['share_within']:.2%} within the tolerance of {report['tolerance']:.4g}")
    if report["share_significant"] is not None:
        out().print(f"  {report['share_significant']:.2%} beyond three standard errors; noise alone makes 0.27%")
    for region in report["regions"][:MAX_LISTED_REGIONS]:
        place = ", ".join(f"{x:.4g}" for x in region["place"])
        out().print(
            f"  region of {region['vertices']:,} vertices around ({place}): mean deviation {region['deviation']:.4g} "
            f"+- {region['std']:.2g}, p = {region['p_value']:.1g}"
        )
    if len(report["regions"]) > MAX_LISTED_REGIONS:
        out().print(f"  and {len(report['regions']) - MAX_LISTED_REGIONS:,} regions that are less significant")


def print_measures(report: Report, source: str) -> None:
    """Print integrals over a surface and its parts."""
    out().print(f"[bold]{escape(source)}[/]")
    for part in (report["whole"], *report["parts"]):
        table = _table(padding=(0, 2, 0, 2))
        for column in ("surface" if part["label"] is None else f"label {part['label']}", "value", "+-", "bias"):
            table.add_column(column, justify="left" if column.startswith(("surface", "label")) else "right")
        for name, value in part["values"].items():
            if value is not None:
                errors = [f"{part[kind][name]:.2g}" if part[kind] else "" for kind in ("std", "bias")]
                table.add_row(name.replace("_", " "), f"{value:.6g}", *errors)
        out().print(table)
        if part["euler_characteristic"] is not None:
            out().print(
                f"  Gauss-Bonnet: {part['values']['total_gaussian_curvature']:.4g} (total gaussian curvature) + "
                f"{part['turning']:.4g} (turning of the border) should be 2 pi x {part['euler_characteristic']} (Euler "
                f"characteristic, cut along sharp edges): error {part['gauss_bonnet_error']:.2g}"
            )
    if report["whole"]["bias"]:
        out().print("  bias: mean error by the noise, which can be subtracted from the value")


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


def print_outcome(report: Report) -> None:
    """Print what matters of a report, as the last line."""
    if text := describe_outcome(report):
        out().print(text, markup=False)


def print_batch(summary: Report) -> None:
    """Print the results of a batch."""
    width = max(len(printable_path(file["input"])) for file in summary["files"])
    for file in summary["files"]:
        name = printable_path(file["input"])
        seconds = "" if file["result"] == "skipped" else f"{file['seconds']:.2f} s"
        out().print(f"{name:<{width}}  {file['result']:<7}  {seconds:>9}  {batch_remark(file)}".rstrip(), markup=False)
    numbers = ", ".join(f"{summary[result]:,} {result}" for result in ("done", "skipped", "failed"))
    out().print(f"{summary['command']}: {numbers} ({summary['seconds']:.1f} s)")
    if "index" in summary:
        out().print(f"wrote [bold]{escape(printable_path(summary['index']))}[/]; open it in a browser")


def batch_remark(file: Report) -> str:
    """Why a file of a batch failed, or the most important numbers of its report."""
    report = file["report"] or {}
    return file["error"] or "; look at: ".join(filter(None, [_remark(report), *report.get("read", [])]))


def _remark(report: Report) -> str:
    """The most important numbers of a filter's report."""
    numbers = describe_outcome(report)
    if not report.get("warnings"):
        return numbers
    return shell_remark("; look at: ".join(filter(None, [numbers, *report["warnings"]])))


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
