"""Errors of normal, H and K on analytic surfaces, clean and noisy, next to libigl and MeshLab.

Surfaces are sampled irregularly; noise is Gaussian, along the normal, in fractions of the mean
edge. Errors: normal, root mean square angle in degrees; H and K, root mean square difference over
root mean square truth; vertices near a boundary are left out. Prints geometric means over the
surfaces; with --save, writes accuracy.csv.
"""

import argparse
import csv
from collections.abc import Callable
from pathlib import Path

import numpy as np

import bezier_filters as bf
from bezier_filters import surfaces
from bezier_filters.surfaces import SampledSurface
from peers import (
    Estimate,
    Method,
    angles,
    libigl_quadric,
    meshlab_discrete,
    meshlab_normals,
    ours,
    ouyang_feng,
    razdan_bae,
)

RESULTS = Path(__file__).parent / "results"

SURFACES: dict[str, Callable[[int], SampledSurface]] = {
    "sphere": lambda r: surfaces.sphere(resolution=r, jitter=0.3),
    "ellipsoid": lambda r: surfaces.ellipsoid(resolution=r, jitter=0.3),
    "torus": lambda r: surfaces.torus(resolution=2 * r, jitter=0.3),
    "bumpy star": lambda r: surfaces.bumpy_star(resolution=r, jitter=0.3),
    "waves": lambda r: surfaces.waves(resolution=3 * r, jitter=0.3),
    "monkey saddle": lambda r: surfaces.monkey_saddle(resolution=3 * r, jitter=0.3),
}


def methods() -> dict[str, Method]:
    return {
        "automatic": ours(),
        "2 rings, alpha 0.8": ours(rings=2, alpha=0.8),
        "paper": ours(smoothness="paper"),
        "Razdan-Bae": razdan_bae("edges"),
        "OuYang-Feng": ouyang_feng,
        "MeshLab area weights": meshlab_normals("By Area"),
        "MeshLab N. Max weights": meshlab_normals("As defined by N. Max"),
        "MeshLab discrete": meshlab_discrete,
        **libigl_quadric(2),
        **libigl_quadric(5),
    }


def errors(surface: SampledSurface, estimate: Estimate, inner: np.ndarray) -> list[float]:
    """Errors of normal, |H| and K; peers disagree on the sign of H."""

    def relative(value: np.ndarray, truth: np.ndarray) -> float:
        return float(np.sqrt(np.mean((value - truth)[inner] ** 2) / np.mean(truth[inner] ** 2)))

    normals, mean, gaussian = estimate
    found = [np.nan, np.nan, np.nan]
    if normals is not None:
        found[0] = float(np.sqrt(np.mean(angles(normals, surface.normals)[inner] ** 2)))
    if mean is not None:
        found[1] = relative(np.abs(mean), np.abs(surface.mean_curvature))
    if gaussian is not None:
        found[2] = relative(gaussian, surface.gaussian_curvature)
    return found


def with_noise(surface: SampledSurface, level: float, seed: int) -> np.ndarray:
    """Vertices displaced along the normals, in mean edges."""
    edges = surface.vertices[surface.faces[:, 0]] - surface.vertices[surface.faces[:, 1]]
    edge = np.linalg.norm(edges, axis=1).mean()
    noise = np.random.default_rng(seed).standard_normal(len(surface.vertices)) * level * edge
    return surface.vertices + noise[:, None] * surface.normals


def inner_vertices(surface: SampledSurface) -> np.ndarray:
    """Which vertices are more than two edges away from a boundary."""
    mesh = bf.triangle_mesh(surface.vertices, surface.faces)
    adjacency = bf.vertex_adjacency(mesh)
    rows_of = bf.k_rings(adjacency, 2)
    return np.array([not adjacency.on_boundary[rows_of.row(i)].any() for i in range(mesh.vertex_count)])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--resolution", type=int, default=30, help="sampling; 30 gives about 9,000 vertices")
    parser.add_argument("--noise", type=float, nargs="+", default=[0.0, 0.01, 0.05, 0.1, 0.2])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--save", action="store_true", help="write benchmarks/results/accuracy.csv")
    arguments = parser.parse_args()
    rows = []
    for name, make in SURFACES.items():
        surface = make(arguments.resolution)
        inner = inner_vertices(surface)
        for level in arguments.noise:
            vertices = with_noise(surface, level, arguments.seed)
            for method, run in methods().items():
                rows.append((name, level, method, *errors(surface, run(vertices, surface.faces), inner)))
    if arguments.save:
        with (RESULTS / "accuracy.csv").open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(["surface", "noise", "method", "normal_degrees", "mean_curvature", "gaussian_curvature"])
            writer.writerows([*row[:3], *(f"{value:.4g}" for value in row[3:])] for row in rows)
    print(f"{'noise':>6}  {'method':26}{'normal [deg]':>14}{'H':>12}{'K':>12}")
    for level in arguments.noise:
        for method in methods():
            table = np.array([row[3:] for row in rows if row[1] == level and row[2] == method])
            means = np.exp(np.log(table).mean(axis=0))
            cells = ["-" if np.isnan(mean) else f"{mean:.4g}" for mean in means]
            print(f"{level:6.2f}  {method:26}{cells[0]:>14}{cells[1]:>12}{cells[2]:>12}")


if __name__ == "__main__":
    main()
