"""The automatic smoothing from beginning to end, for meshes in memory and in tiles."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from bezier_filters.arrays import FloatArray
from bezier_filters.runtime.parallel import Progress
from bezier_filters.smoothing.automatic_smoothing import denoise
from bezier_filters.smoothing.extent import extent_of
from bezier_filters.smoothing.flips import face_counts, without_new_flips
from bezier_filters.smoothing.laplacian import Borders
from bezier_filters.smoothing.pieces import Arrays, Domain, Handle, Outcome, Piece
from bezier_filters.smoothing.volume import Amounts, part_volumes, with_volumes

LearnNoise = Callable[[Any], float | None]
"""Learns the standard deviation of the noise of a domain, a length; None if the mesh is too small."""


@dataclass(frozen=True)
class Finished:
    """What was done to a mesh.

    Attributes
    ----------
    points : Handle
        "points" (n, 3), the new coordinates.
    faces : dict
        Numbers of wrong faces before and after, see `face_counts`.
    volumes : (2, parts) float64
        What the closed parts enclosed before, and enclose now.
    """

    points: Handle
    faces: dict[str, int]
    volumes: FloatArray


@dataclass(frozen=True)
class Movable:
    """Vertices that may move.

    Attributes
    ----------
    fixed_borders : bool
        Whether those at borders may not.
    """

    fixed_borders: bool
    rings: int = 1

    def __call__(self, piece: Piece, inputs: Mapping[str, Arrays]) -> Outcome:
        """Whether each may, (n,)."""
        movable = np.ones(piece.mesh.vertex_count, np.bool_)
        if "selected" in inputs:
            movable = inputs["selected"]["selected"].copy()
        if self.fixed_borders:
            movable &= ~piece.adjacency.on_boundary
        return Outcome(vertices={"movable": movable})


@dataclass(frozen=True)
class Held:
    """The vertices that may not move back where they were."""

    rings: int = 0

    def __call__(self, piece: Piece, inputs: Mapping[str, Arrays]) -> Outcome:
        """Coordinates (n, 3), and the largest sharpness (n,) so far."""
        movable, found = inputs["movable"]["movable"], inputs["found"]
        points = np.where(movable[:, np.newaxis], found["points"], piece.mesh.vertices)
        if "sharpness" not in found:
            return Outcome(vertices={"points": points})
        before = inputs["before"]["sharpness"] if "before" in inputs else np.zeros(len(points))
        return Outcome(vertices={"points": points, "sharpness": np.maximum(before, found["sharpness"])})


def smoothed(
    domain: Domain,
    movable: Handle,
    noise: float | None,
    learn_noise: LearnNoise,
    borders: Borders,
    *,
    iterations: int = 1,
    threads: int = 1,
    progress: Progress | None = None,
) -> Handle:
    """Take the noise off, some times.

    Parameters
    ----------
    domain : Domain
    movable : Handle
        "movable" (n,) bool, vertices that may move.
    noise : float or None
        Standard deviation of the noise, a length; None if it is not known.
    learn_noise : callable
        Learns it anew after the first time.
    borders : {"curve", "fixed"}
        Whether border vertices are smoothed along the border, or stay.
    iterations : int
        How many times.
    threads : int
        Number of threads for what is learned from parts.
    progress : callable, optional
        Called now and then.

    Returns
    -------
    Handle
        "points" (n, 3) and "sharpness" (n,), see `denoise`.
    """
    current, before = domain, dict[str, Handle]()
    for k in range(iterations):
        sigma = noise if k == 0 else learn_noise(current)
        report = part_of(progress, k, iterations)
        found = denoise(current, sigma or 0.0, extent_of(current), borders, threads=threads, progress=report)
        result = domain.run(Held(), found=found, movable=movable, **before).vertices
        domain.free(found, *before.values())
        current, before = domain.with_points(result), {"before": result}
    return result


def finished(domain: Domain, points: Handle, movable: Handle, *, keep_volume: bool, keep_faces: bool) -> Finished:
    """Give the closed parts their volumes back, and take back what turns faces over, if wanted.

    Parameters
    ----------
    domain : Domain
        The mesh before.
    points : Handle
        "points" (n, 3), where the vertices are now.
    movable : Handle
        "movable" (n,) bool, vertices that may move.
    keep_volume, keep_faces : bool
        What is wanted.
    """
    parts = domain.closed_parts()
    before = part_volumes(domain, parts)
    if keep_volume and parts.count:
        amounts = domain.run(Amounts(), points=points, movable=movable).vertices
        points = with_volumes(domain, parts, before, points, amounts)
        domain.free(amounts)
    if keep_faces:
        points = without_new_flips(domain, points)
    counts = face_counts(domain, points)
    return Finished(points, counts, np.array([before, part_volumes(domain, parts, points=points)]))


def part_of(progress: Progress | None, k: int, total: int) -> Progress | None:
    """Progress of the k-th of several iterations as that of the whole."""
    if progress is None:
        return None
    return lambda done, of: progress(k * of + done, total * of)
