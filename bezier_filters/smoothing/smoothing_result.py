"""What smoothing gives: a mesh, and what was done to it."""

from dataclasses import dataclass

import numpy as np

from bezier_filters.arrays import FloatArray
from bezier_filters.display import html_table, noise_in_words, noise_level


@dataclass(frozen=True, repr=False)
class SmoothingResult:
    """A smoothed mesh, and what was done to it.

    Attributes
    ----------
    vertices : (n, 3) float64
        The new coordinates; the faces are the same.
    displacement : (n,) float64
        How far each vertex moved, a length.
    sharpness : (n,) float64
        From 0, where the surface was smoothed like a scan of something round, to 1, where edges were kept as sharp
        as can be; 0 with ``method="paper"``.
    noise_before, noise_after : float or None
        Standard deviation of the noise along the normal, a length; None if the mesh is too small to learn it.
    noise_length : float or None
        Distance over which the noise before is correlated; 0 if it is independent from vertex to vertex.
    noise_heavy : bool
        Whether the noise before turns single normals so far that they mean nothing, as noise in all directions does.
    iterations : int
        How often it was smoothed: as asked for, or until nothing was left to do.
    mean_edge : float
        Mean length of the edges before.
    volume_before, volume_after : float or None
        What the closed parts enclose in all, length^3; None if there are none.
    flipped_before, flipped_after : int
        Faces more than 90 degrees away from the mean normal around them.
    degenerate_before, degenerate_after : int
        Faces without area.
    new_bad_faces : int
        Faces that are flipped or degenerate, and were not before; none but where four times as many were mended.
    """

    vertices: FloatArray
    displacement: FloatArray
    sharpness: FloatArray
    noise_before: float | None
    noise_after: float | None
    noise_length: float | None
    noise_heavy: bool
    iterations: int
    mean_edge: float
    volume_before: float | None
    volume_after: float | None
    flipped_before: int
    flipped_after: int
    degenerate_before: int
    degenerate_after: int
    new_bad_faces: int

    @property
    def volume_ratio(self) -> float | None:
        """Volume after over volume before; None if there is none to compare with."""
        if not self.volume_before or self.volume_after is None:
            return None
        return self.volume_after / self.volume_before

    @property
    def noise(self) -> str:
        """The noise before, in words."""
        return noise_in_words(self.noise_before, self.noise_length, self.noise_heavy, self.mean_edge)

    @property
    def mean_displacement(self) -> float:
        """Mean distance that a vertex moved, a length."""
        return float(self.displacement.mean()) if len(self.displacement) else 0.0

    @property
    def rms_displacement(self) -> float:
        """Root mean square of the same."""
        return float(np.sqrt(np.square(self.displacement).mean())) if len(self.displacement) else 0.0

    @property
    def max_displacement(self) -> float:
        """Largest distance that a vertex moved, a length."""
        return float(self.displacement.max(initial=0.0))

    def __repr__(self) -> str:
        """One line with the noise and the volume, without the arrays."""
        return (
            f"SmoothingResult({len(self.vertices)} vertices: {self.noise}; "
            f"{noise_level(self.noise_after, self.mean_edge)} after; volume ratio {self.volume_ratio}, "
            f"{self.new_bad_faces} new bad faces)"
        )

    def _repr_html_(self) -> str:
        """Tables for notebooks."""
        rows: list[list[object]] = [
            ["noise", "length", self.noise_before, self.noise_after],
            ["volume", "length³", self.volume_before, self.volume_after],
            ["flipped faces", "", self.flipped_before, self.flipped_after],
            ["degenerate faces", "", self.degenerate_before, self.degenerate_after],
        ]
        moved = [["displacement", "length", self.mean_displacement, self.rms_displacement, self.max_displacement]]
        title = f"Smoothing of {len(self.vertices):,} vertices: {self.noise}"
        return html_table(title, ["", "unit", "before", "after"], rows) + html_table(
            "Vertices moved by", ["", "unit", "mean", "rms", "max"], moved
        )
