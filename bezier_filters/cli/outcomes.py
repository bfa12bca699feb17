"""What matters of a report, in one line of plain words."""

from collections import Counter
from typing import TYPE_CHECKING

from bezier_filters.display import noise_in_words, noise_level, noise_stays, shell_remark
from bezier_filters.fields import CURVATURE, qualities
from bezier_filters.status import FitStatus

if TYPE_CHECKING:
    from bezier_filters.arrays import Report


def main_reason(hole: "Report") -> str:
    """Why a hole is open, and the option that fills it, without what was tried."""
    reason, _, remedy = shell_remark(hole["reason"]).partition("; ")
    return f"{reason}; {remedy}" if remedy.startswith("--") else reason


def _noise_change(report: "Report") -> str:
    """The noise before and after smoothing."""
    edge = report["mean_edge"]
    if not report["moved"]:
        known = report["noise_before"], report["noise_length"], report["noise_heavy"]
        return f"{noise_in_words(*known, edge, reason=report['noise_reason'])}; nothing moved"
    before, after = report["noise_before"], report["noise_after"]
    if noise_stays(before, after):
        return f"noise {noise_level(before, edge)}, nearly all of which stays: it is like the shape"
    return f"noise {noise_level(before, edge)} before, {noise_level(after, edge)} after"


def describe_outcome(report: "Report") -> str:
    """The most important numbers of a filter's report; empty if it has none."""
    if "fill" in report and "smooth" in report:
        return "; ".join(filter(None, (describe_outcome(report[name]) for name in ("fill", "smooth"))))
    if "sharp_edges" in report:
        return f"{len(report['lines']):,} lines, {report['sharp_edges']:,} sharp edges"
    if "index_sum" in report:
        return f"{report['lines']:,} lines, {len(report['umbilics']):,} umbilics"
    if "closed_holes" in report:
        count = report["closed_holes"]
        filled = f"{count:,} hole{'s' * (count != 1)} filled, {report['open_holes']:,} left open"
        reasons = Counter(main_reason(hole) for hole in report["holes"] if not hole["filled"])
        if not reasons:
            return filled
        ((reason, count),) = reasons.most_common(1)
        return f"{filled}{f', {count:,} of them' if len(reasons) > 1 else ''}: {reason}"
    if "old_faces" in report:
        return f"{report['old_faces']:,} faces before, {report['faces']:,} after"
    if "bridged_pairs" in report:
        return f"{report['bridged_pairs']:,} pairs of holes joined, {report['open_pairs']:,} left open"
    if "replaced_patches" in report:
        return f"{report['replaced_patches']:,} patches replaced, {report['kept_patches']:,} left as they were"
    if "compared" in report:
        count = len(report["regions"])
        regions = "no region deviates" if not count else f"{count:,} region{' deviates' if count == 1 else 's deviate'}"
        return f"deviation: rms {report['rms']:.4g}, {regions}" if report["compared"] else ""
    if "texmap" in report:
        return f"{report['texmap']} map, {report['covered']:.0%} of {report['size']:,} x {report['size']:,} texels"
    if "noise_before" in report:
        return _noise_change(report)
    if report.get("statistics"):
        unit = f" [{report['unit']}]" if report["unit"] else ""
        known = qualities(CURVATURE).get(report["quality"])
        median = f"{known.label if known else report['quality']}: median {report['statistics']['median']:.4g}{unit}"
        return f"{median}{_reliable_part(report)}"
    return ""


def _reliable_part(report: "Report") -> str:
    """At how many vertices there is an estimate that is not of a folded neighbourhood."""
    if "status" not in report:
        return ""
    counts = {FitStatus[name]: count for name, count in report["status"].items() if name != FitStatus.SKIPPED.name}
    reliable, total = sum(count for status, count in counts.items() if status < FitStatus.FOLDED), sum(counts.values())
    return "; reliable everywhere" if reliable == total else f"; reliable at {reliable:,} of {total:,} vertices"
