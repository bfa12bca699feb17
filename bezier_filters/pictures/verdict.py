"""What a person decides by: noise, holes, and what stands in the way, in a sentence each with a command."""

import shlex
from collections import Counter
from collections.abc import Sequence
from typing import TypeAlias

from bezier_filters.display import MIN_NOISE_EDGES, noise_stays, shell_remark
from bezier_filters.holes.hole_filling import HoleFillingResult
from bezier_filters.smoothing.smooth import SmoothingResult

Sentence: TypeAlias = tuple[str, str]  # text, and the command that acts on it, which may be empty

_MAX_REASONS = 2  # why holes stay open


def verdict(
    source: str,
    smoothed: SmoothingResult | None,
    filled: HoleFillingResult | None,
    findings: Sequence[str],
    *,
    can_be_repaired: bool,
    cleaned: bool = False,
) -> list[Sentence]:
    """Sentences on a file: its noise, its holes, and what stands in the way of both.

    Where the file is cleaned already, they have no commands.
    """
    name = shlex.quote(source)
    if smoothed is None:
        sentences = [("The noise is not measured.", "")]
    elif filled is None:
        text, command = _noise(name, smoothed)
        sentences = [
            (text.replace(" edges", " spacings"), command),
            ("A point cloud has no faces, and so no holes.", ""),
        ]
        findings = ()  # that it has no faces
    else:
        sentences = [_noise(name, smoothed), _holes(name, filled, "is" if cleaned else "can be")]
    if cleaned:
        sentences = [(text, "") for text, _ in sentences]
    if not findings:
        is_cloud = smoothed is not None and filled is None
        jobs = "estimates and smoothing" if is_cloud else "estimates, smoothing and hole filling"
        return [*sentences, (f"Nothing stands in the way of {jobs}.", "")]
    more = f" {len(findings) - 1} more below." if len(findings) > 1 else ""
    command = f"bezier-filters clean {name} repaired.ply --repair" if can_be_repaired else ""
    return [*sentences, (f"In the way: {findings[0].rstrip('.')}.{more}", command)]


def _noise(name: str, result: SmoothingResult) -> Sentence:
    before, after, edge = result.noise_before, result.noise_after, result.mean_edge
    if before is None:
        return f"The noise is unknown: {result.noise_reason}.", ""
    if before <= MIN_NOISE_EDGES * edge:
        return f"There is no noise: less than {MIN_NOISE_EDGES:g} edges cannot be told from the shape.", ""
    if not result.displacement.any():
        return f"Noise of {_length(before, edge)} stays: smoothing would take more shape than noise.", ""
    if noise_stays(before, after):
        text = f"Noise of {_length(before, edge)}; nearly all of it stays, because it is like the shape."
        return text, ""
    left = "an unknown part" if after is None else f"about {_length(after, edge)}"
    text = f"Noise of {_length(before, edge)}, of which smoothing leaves {left}."
    return text, f"bezier-filters smooth {name} smooth.ply"


def _length(length: float, edge: float) -> str:
    return f"{length / edge:.2g} edges ({length:.3g} in the unit of the file)"


def _holes(name: str, result: HoleFillingResult, verb: str) -> Sentence:
    if not result.holes:
        return "There are no holes: the surface is closed.", ""
    left, count = len(result.holes) - result.filled, len(result.holes)
    holes = "1 hole" if count == 1 else f"{count:,} holes"
    text = f"{result.filled:,} of {holes} {'are' if verb == 'is' and result.filled != 1 else verb} filled"
    if not result.filled:
        text = f"{holes.capitalize()} {'stays' if count == 1 else 'stay'} open"
    if left:
        unfilled = [hole.reason.partition(";")[0] for hole in result.holes if not hole.filled]
        reasons = Counter(reason or "no reason known" for reason in unfilled)
        counted = {reason: f" ({n:,})" if len(reasons) > 1 else "" for reason, n in reasons.most_common(_MAX_REASONS)}
        shown = "; ".join(f"{shell_remark(reason)}{number}" for reason, number in counted.items())
        text += f": {shown}" if not result.filled else f", {left:,} {'stays' if left == 1 else 'stay'} open: {shown}"
        text += "; and others" * (len(reasons) > _MAX_REASONS)
    return f"{text}.", f"bezier-filters fill-holes {name} filled.ply" if result.filled else ""
