"""Noise as scanners make it: errors of the default, its intervals, and what smoothing leaves.

Kinds: white, in every coordinate, averaged over some rings of neighbours, white and averaged, along one direction of
view, one vertex in twenty ten times as far off, of a strength that varies tenfold, and depth in steps. Levels are
standard deviations in mean edges. Errors are root mean squares, of H relative to its own root mean square, as
geometric means over the surfaces; next to them the smallest of eight fixed settings (rings 2, 4, 7, 10, degree 2, 3).
"""

import argparse
import csv
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.sparse import csr_matrix, diags

import bezier_filters as bf
from bezier_filters.surfaces import SampledSurface, bumpy_star, ellipsoid, torus
from peers import angles

SURFACES: dict[str, Callable[[], SampledSurface]] = {
    "torus": lambda: torus(resolution=64, jitter=0.3),
    "star": lambda: bumpy_star(resolution=32, jitter=0.3),
    "ellipsoid": lambda: ellipsoid(resolution=32, jitter=0.3),
}
VIEW = np.array([0.4, -0.3, 0.87]) / np.linalg.norm([0.4, -0.3, 0.87])
FIXED = [(rings, degree) for rings in (2, 4, 7, 10) for degree in (2, 3)]


def averaged(faces: np.ndarray, values: np.ndarray, steps: int) -> np.ndarray:
    """Values after some half steps towards the mean of the neighbours, scaled to mean square 1."""
    rows, columns = faces.ravel(), np.roll(faces, 1, axis=1).ravel()
    ends = np.append(rows, columns), np.append(columns, rows)
    neighbours = csr_matrix((np.ones(len(ends[0])), ends), shape=(len(values), len(values)))
    neighbours.data[:] = 1.0
    means = diags(1.0 / np.asarray(neighbours.sum(axis=1)).ravel()) @ neighbours
    for _ in range(steps):
        values = 0.5 * (values + means @ values)
    return values / np.sqrt(np.square(values).mean())


def displaced(kind: str, level: float, surface: SampledSurface, seed: int) -> np.ndarray:
    """The vertices with noise."""
    edges = surface.vertices[surface.faces] - surface.vertices[np.roll(surface.faces, 1, axis=1)]
    edge = float(np.linalg.norm(edges, axis=2).mean())
    random, vertices = np.random.default_rng(seed), surface.vertices
    white = random.standard_normal(len(vertices))
    if kind == "all directions":
        return vertices + level * edge * random.standard_normal(vertices.shape)
    if kind == "view":
        return vertices + level * edge * white[:, np.newaxis] * VIEW
    if kind == "steps":
        step, depth = level * edge * np.sqrt(12.0), vertices @ VIEW
        return vertices + (np.floor(depth / step + random.random()) * step - depth)[:, np.newaxis] * VIEW
    if kind.startswith("averaged"):
        heights = averaged(surface.faces, white, int(kind.split()[1]))
    elif kind == "mixed":
        heights = 0.5 * white + np.sqrt(0.75) * averaged(surface.faces, random.standard_normal(len(white)), 4)
    elif kind == "impulses":
        heights = white * np.where(random.random(len(white)) < 0.05, 10.0, 1.0)
    elif kind == "varying":
        place = vertices[:, 0] - vertices[:, 0].min()
        heights = white * 10.0 ** (place / place.max() - 0.5)
    else:
        heights = white
    return vertices + level * edge * heights[:, np.newaxis] * surface.normals


KINDS = [
    ("white", 0.05),
    ("white", 0.5),
    ("all directions", 0.1),
    ("all directions", 0.3),
    ("all directions", 0.5),
    ("averaged 1", 0.1),
    ("averaged 3", 0.1),
    ("averaged 8", 0.1),
    ("mixed", 0.1),
    ("view", 0.1),
    ("impulses", 0.05),
    ("varying", 0.05),
    ("steps", 0.1),
]


def errors(geometry: bf.VertexGeometry, surface: SampledSurface) -> tuple[float, float]:
    """Of the normal, and of H relative to its own root mean square."""
    off = geometry.mean_curvature - surface.mean_curvature
    relative = np.sqrt(np.square(off).mean() / np.square(surface.mean_curvature).mean())
    return float(np.sqrt(np.square(angles(geometry.normals, surface.normals)).mean())), float(relative)


def measure(kind: str, level: float, surface: SampledSurface, seed: int) -> list[float]:
    """Errors of normal and H, those of the best fixed setting, held share, rest of the height, by one surface."""
    vertices = displaced(kind, level, surface, seed)
    found = bf.estimate_vertex_geometry(vertices, surface.faces)
    fixed = [
        errors(bf.estimate_vertex_geometry(vertices, surface.faces, rings=rings, degree=degree, alpha=1.0), surface)
        for rings, degree in FIXED
    ]
    off = np.abs(found.mean_curvature - surface.mean_curvature)
    held = float((off <= 1.96 * found.mean_curvature_std).mean())
    smoothed = bf.smooth(vertices, surface.faces).vertices
    heights = [np.einsum("ij,ij->i", points - surface.vertices, surface.normals) for points in (smoothed, vertices)]
    left = float(np.sqrt(np.square(heights[0]).mean() / np.square(heights[1]).mean()))
    return [*errors(found, surface), *np.min(fixed, axis=0), held, left]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=5)
    parser.add_argument("--save", type=Path, help="CSV to write")
    arguments = parser.parse_args()
    names = ["normal", "H", "normal, best fixed", "H, best fixed", "held", "left"]
    rows = []
    print(f"| noise | {' | '.join(names)} |\n|{'---|' * (len(names) + 1)}")
    for kind, level in KINDS:
        values = np.array([measure(kind, level, make(), arguments.seed) for make in SURFACES.values()])
        means = [*np.exp(np.log(values[:, :4]).mean(axis=0)), values[:, 4].min(), np.exp(np.log(values[:, 5]).mean())]
        rows.append((kind, level, *(f"{value:.4g}" for value in means)))
        print(f"| {kind}, {level:g} | " + " | ".join(f"{value:.3g}" for value in means) + " |", flush=True)
    if arguments.save:
        with open(arguments.save, "w", newline="") as stream:
            csv.writer(stream).writerows([("kind", "level", *names), *rows])


if __name__ == "__main__":
    main()
