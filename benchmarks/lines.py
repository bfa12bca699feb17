"""Lines of curvature of an ellipsoid against the exact ones, and its umbilics, by size of the mesh and noise.

Lines of curvature of an ellipsoid with semi-axes a_i are its intersections with the confocal quadrics

    sum x_i^2 / (a_i^2 - q) = 1

so that q is constant along each. The deviation of a line is the largest distance of its points from the quadric of
their median q, over the longest semi-axis. Figures are the median, the 90 % quantile and the largest of all lines; the
largest distance of the four umbilics from the exact ones; and the time to trace the lines.

    python benchmarks/lines.py [FILE.csv]
"""

import csv
import sys
import time
from pathlib import Path

import numpy as np

import bezier_filters as bf
from bezier_filters.arrays import FloatArray
from bezier_filters.surfaces import SampledSurface, ellipsoid

AXES = np.array([1.0, 0.8, 0.5])
RESOLUTIONS, LEVELS = (8, 16, 32, 64), (0.0, 0.01, 0.1)
SPACING = 0.1
COLUMNS = (
    "vertices",
    "noise",
    "lines",
    "closed",
    "median",
    "quantile_90",
    "largest",
    "umbilics",
    "distance",
    "seconds",
)


def deviation(points: FloatArray, *, of_max: bool) -> float:
    """Largest distance (first order) of points near the ellipsoid from the confocal quadric of their median q.

    Along lines of k_max the larger of the two roots q besides 0 is constant, along those of k_min the smaller one.
    """
    squares = AXES**2
    coefficients = np.empty((len(points), 4))
    for row, x in zip(coefficients, points**2, strict=True):
        row[:] = -np.poly(squares)
        for axis in range(3):
            row[1:] -= x[axis] * np.poly(np.delete(squares, axis))
    roots = np.sort([np.roots(row).real for row in coefficients], axis=1)
    zeros = np.abs(roots).argmin(axis=1)  # of the ellipsoid itself
    others = roots[np.arange(3) != zeros[:, np.newaxis]].reshape(-1, 2)
    gaps = squares - np.median(others[:, 1 if of_max else 0])
    value, slope = (points**2 / gaps).sum(axis=1) - 1.0, 2.0 * np.linalg.norm(points / gaps, axis=1)
    return float(np.abs(value / slope).max())


def exact_umbilics() -> FloatArray:
    """The four umbilics of the ellipsoid."""
    a, b, c = AXES**2
    x, z = np.sqrt(a * (a - b) / (a - c)), np.sqrt(c * (b - c) / (a - c))
    return np.array([[i * x, 0.0, k * z] for i in (-1, 1) for k in (-1, 1)])


def with_noise(shape: SampledSurface, level: float) -> FloatArray:
    """Vertices with noise along the true normals, in mean edges."""
    ends = shape.vertices[shape.faces]
    edge = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).mean()
    heights = level * edge * np.random.default_rng(0).standard_normal((len(shape.vertices), 1))
    return np.asarray(shape.vertices + heights * shape.normals)


def row_of(resolution: int, level: float) -> dict[str, float]:
    """Figures of one mesh."""
    shape = ellipsoid(semi_axes=tuple(AXES), resolution=resolution, jitter=0.3)
    surface = bf.fit_surface(with_noise(shape, level), shape.faces)
    begin = time.perf_counter()
    found = bf.trace_lines(surface, spacing=SPACING)
    seconds = time.perf_counter() - begin
    values = [deviation(line.points, of_max=line.kind == "max") for line in found.lines]
    positive = np.array([umbilic.point for umbilic in found.umbilics if umbilic.index > 0.0]).reshape(-1, 3)
    distances = np.linalg.norm(exact_umbilics()[:, np.newaxis] - positive, axis=2)
    numbers = (
        len(shape.vertices),
        level,
        len(found.lines),
        sum(line.is_closed for line in found.lines),
        *np.quantile(values, [0.5, 0.9, 1.0]),
        len(found.umbilics),
        distances.min(axis=1).max() if len(positive) else np.nan,
        seconds,
    )
    return dict(zip(COLUMNS, numbers, strict=True))


def main(target: Path | None) -> None:
    """Print the table, and write it as CSV."""
    row_of(8, 0.0)  # compiles
    rows = [row_of(resolution, level) for level in LEVELS for resolution in RESOLUTIONS]
    for row in rows:
        print(" ".join(f"{value:10.3g}" for value in row.values()))
    if target is not None:
        with target.open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
            writer.writeheader()
            writer.writerows({name: f"{value:.6g}" for name, value in row.items()} for row in rows)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
