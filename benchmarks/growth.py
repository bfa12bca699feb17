"""How time, memory and new faces grow with the size of meshes that ask for more work than their size tells.

Each size is twice the one before and runs in a process of its own, which has compiled before: peaks of memory are
those of the process, in which the package alone takes some 200 MB. The exponent is that of time over the number of
vertices, between the two largest sizes that take longer than a few hundredths of a second.
"""

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Callable

import numpy as np

import bezier_filters as bf

Mesh = tuple[np.ndarray, np.ndarray]
SHORTEST = 0.05
"""Seconds of process time below which an exponent says nothing."""


def sheet(columns: int, rows: int, height: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None) -> Mesh:
    """A grid of squares, each cut in two."""
    x, y = np.meshgrid(np.arange(columns + 1.0), np.arange(rows + 1.0))
    vertices = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size) if height is None else height(x, y).ravel()])
    corner = (np.arange(rows)[:, np.newaxis] * (columns + 1) + np.arange(columns)).ravel()
    above = corner + columns + 1
    lower, upper = np.stack([corner, corner + 1, above + 1], 1), np.stack([corner, above + 1, above], 1)
    return vertices, np.vstack([lower, upper]).astype(np.int32)


def ring(count: int, rows: int = 8) -> Mesh:
    """A flat ring around a round hole of so many edges, of triangles with equal sides."""
    turn = 2.0 * np.pi / count
    rows_of = [
        (1.0 + turn) ** k * np.exp(1j * (np.arange(count) + 0.5 * k) * turn) * count / (2 * np.pi) for k in range(rows)
    ]
    points = np.concatenate(rows_of)
    i = np.arange(count)
    j = (i + 1) % count
    faces = []
    for k in range(rows - 1):
        a, b = k * count, (k + 1) * count
        faces += [np.stack([a + i, b + i, a + j], 1), np.stack([a + j, b + i, b + j], 1)]
    return np.column_stack([points.real, points.imag, np.zeros(len(points))]), np.vstack(faces).astype(np.int32)


def band(count: int) -> Mesh:
    """A ring around a sphere, with two holes."""
    flat, faces = ring(count)
    x, y = flat[:, :2].T * (2 * np.pi / count)
    square = x * x + y * y
    vertices = np.column_stack([2 * x, 2 * y, square - 1]) / (1 + square)[:, np.newaxis]
    return vertices * count / (2 * np.pi), faces


def wavy_ring(count: int) -> Mesh:
    """A ring whose surface does not continue into its hole."""
    vertices, faces = ring(count)
    vertices[:, 2] = 0.1 * count * np.cos(5 * np.arctan2(vertices[:, 1], vertices[:, 0]))
    return vertices, faces


def fan(count: int) -> Mesh:
    angle, i = 2 * np.pi * np.arange(count) / count, np.arange(count)
    rim = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(count)])
    return np.vstack([[0.0, 0.0, 0.3], rim]), np.stack([0 * i, 1 + i, 1 + (i + 1) % count], 1).astype(np.int32)


def soup(count: int) -> Mesh:
    rng = np.random.default_rng(0)
    vertices = rng.random((count, 1, 3)) * np.cbrt(count) + 0.3 * rng.normal(size=(count, 3, 3))
    return vertices.reshape(-1, 3), np.arange(3 * count, dtype=np.int32).reshape(-1, 3)


def components(count: int) -> Mesh:
    """Tetrahedra."""
    side = int(np.ceil(np.cbrt(count)))
    places = 3.0 * np.stack(np.meshgrid(*3 * [np.arange(side)]), -1).reshape(-1, 3)[:count]
    corners = np.vstack([np.zeros(3), np.eye(3)])
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    vertices = (places[:, np.newaxis] + corners).reshape(-1, 3)
    return vertices, (4 * np.arange(count)[:, np.newaxis, np.newaxis] + faces).reshape(-1, 3).astype(np.int32)


def tiny_holes(count: int) -> Mesh:
    """A wavy sheet with holes of three edges."""
    side = int(np.ceil(np.sqrt(count)))
    vertices, faces = sheet(6 * side, 6 * side, lambda x, y: 2 * np.sin(0.2 * x) * np.cos(0.2 * y))
    place = 6 * np.arange(side) + 3
    keep = np.ones(len(faces), dtype=bool)
    keep[(place[:, np.newaxis] * 6 * side + place).ravel()[:count]] = False
    return vertices, faces[keep]


def touching_holes(count: int) -> Mesh:
    """A chessboard whose black squares are holes."""
    side = 2 * int(np.ceil(np.sqrt(0.5 * count)))
    vertices, faces = sheet(side + 4, side + 4)
    x, y = np.floor(vertices[faces].mean(axis=1)).astype(int).T[:2]
    black = (x >= 2) & (x < side + 2) & (y >= 2) & (y < side + 2) & ((x + y) % 2 == 0)
    return vertices, faces[~black]


def islands(count: int) -> Mesh:
    """A square hole with squares in it."""
    side = 4 * int(np.ceil(np.sqrt(count)))
    vertices, faces = sheet(side + 8, side + 8)
    place = np.floor(vertices[faces].mean(axis=1)[:, :2]).astype(int) - 4
    inside = ((place >= 0) & (place < side)).all(axis=1)
    used, local = np.unique(faces[~inside | (place % 4 == 1).all(axis=1)], return_inverse=True)
    return vertices[used], local.reshape(-1, 3).astype(np.int32)


def strip(count: int) -> Mesh:
    return sheet(count // 2, 1, lambda x, y: 0.3 * np.sin(0.1 * x))


def folds(count: int) -> Mesh:
    side = int(np.sqrt(count))
    return sheet(side, side, lambda x, y: 30 * np.abs((x / 4) % 2 - 1))


def isolated(count: int) -> Mesh:
    vertices, faces = sheet(30, 30)
    return np.vstack([vertices, np.random.default_rng(0).normal(size=(count, 3))]), faces


KINDS: dict[str, tuple[Callable[[int], Mesh], int]] = {
    "rim": (ring, 500),
    "band": (band, 500),
    "wavy rim": (wavy_ring, 500),
    "tiny holes": (tiny_holes, 500),
    "touching holes": (touching_holes, 1_000),
    "islands": (islands, 100),
    "soup": (soup, 5_000),
    "fan": (fan, 10_000),
    "strip": (strip, 50_000),
    "folds": (folds, 25_000),
    "components": (components, 5_000),
    "isolated": (isolated, 25_000),
}
"""Meshes of a size, and the first size."""

FILTERS: dict[str, Callable[[np.ndarray, np.ndarray], object]] = {
    "fill_holes": lambda v, f: bf.fill_holes(v, f, bolt_holes=True, threads=1),
    "estimate": lambda v, f: bf.estimate_vertex_geometry(v, f, threads=1),
    "smooth": lambda v, f: bf.smooth(v, f, threads=1),
    "creases": lambda v, f: bf.find_creases(v, f, threads=1),
}


def measure(name: str, kind: str, size: int) -> dict[str, float]:
    """Run a filter in this process."""
    import resource  # not on Windows

    make, first = KINDS[kind]
    FILTERS[name](*make(first // 20))  # compile
    vertices, faces = make(size)
    start = time.process_time()
    result = FILTERS[name](vertices, faces)
    seconds = time.process_time() - start
    new = len(result.faces) - len(faces) if isinstance(result, bf.HoleFillingResult) else 0
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1 << (20 if sys.platform == "darwin" else 10))
    return {"vertices": len(vertices), "seconds": seconds, "peak": peak, "new": new}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--filters", nargs="+", default=list(FILTERS), choices=FILTERS)
    parser.add_argument("--kinds", nargs="+", default=list(KINDS), choices=KINDS)
    parser.add_argument("--doublings", type=int, default=3)
    parser.add_argument("--run", nargs=3, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.run:
        print(json.dumps(measure(options.run[0], options.run[1], int(options.run[2]))))
        return
    print(
        f"{'filter':12}{'kind':16}{'size':>9}{'vertices':>10}{'new faces':>11}{'seconds':>9}{'MB':>7}{'exponent':>10}"
    )
    for name in options.filters:
        for kind in options.kinds:
            before = None
            for size in (KINDS[kind][1] << k for k in range(options.doublings + 1)):
                command = [sys.executable, __file__, "--run", name, kind, str(size)]
                row = json.loads(subprocess.run(command, stdout=subprocess.PIPE, check=True).stdout.splitlines()[-1])
                exponent = ""
                if before and before["seconds"] > SHORTEST:
                    ratio = np.log(row["seconds"] / before["seconds"])
                    exponent = f"{ratio / np.log(row['vertices'] / before['vertices']):.2f}"
                print(
                    f"{name:12}{kind:16}{size:>9}{row['vertices']:>10}{row['new']:>11}{row['seconds']:>9.2f}"
                    f"{row['peak']:>7.0f}{exponent:>10}",
                    flush=True,
                )
                before = row


if __name__ == "__main__":
    main()
