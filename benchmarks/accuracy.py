"""Errors of normal, H and K on analytic surfaces, clean and noisy, next to libigl and MeshLab.

Surfaces are sampled irregularly; noise is Gaussian, along the normal, in fractions of the mean
edge. Errors: normal, root mean square angle in degrees; H and K, root mean square difference over
root mean square truth; vertices near a boundary are left out. Writes the table as CSV beside
itself and prints geometric means over the surfaces.
"""

import argparse
import csv
from collections.abc import Callable
from pathlib import Path
from typing import TypeAlias

import numpy as np
import pymeshlab

import bezier_filters as bf
from bezier_filters import surfaces
from bezier_filters.surfaces import SampledSurface

Estimate: TypeAlias = tuple[np.ndarray | None, np.ndarray, np.ndarray]
Method: TypeAlias = Callable[[np.ndarray, np.ndarray], Estimate]
RESULTS = Path(__file__).parent / "results"

SURFACES: dict[str, Callable[[int], SampledSurface]] = {
    "sphere": lambda r: surfaces.sphere(resolution=r, jitter=0.3),
    "ellipsoid": lambda r: surfaces.ellipsoid(resolution=r, jitter=0.3),
    "torus": lambda r: surfaces.torus(resolution=2 * r, jitter=0.3),
    "bumpy star": lambda r: surfaces.bumpy_star(resolution=r, jitter=0.3),
    "waves": lambda r: surfaces.waves(resolution=3 * r, jitter=0.3),
    "monkey saddle": lambda r: surfaces.monkey_saddle(resolution=3 * r, jitter=0.3),
}


def ours(**options: object) -> Method:
    def estimate(vertices: np.ndarray, faces: np.ndarray) -> Estimate:
        geometry = bf.estimate_vertex_geometry(vertices, faces, **options)
        return geometry.normals, geometry.mean_curvature, geometry.gaussian_curvature

    return estimate


def libigl(radius: int) -> Method:
    import igl

    def estimate(vertices: np.ndarray, faces: np.ndarray) -> Estimate:
        _, _, k1, k2, *_ = igl.principal_curvature(vertices, faces, radius)
        return None, 0.5 * (k1 + k2), k1 * k2

    return estimate


def meshlab_discrete(vertices: np.ndarray, faces: np.ndarray) -> Estimate:
    meshset = pymeshlab.MeshSet()
    meshset.add_mesh(pymeshlab.Mesh(vertices, faces))
    fields = []
    for kind in ("Mean Curvature", "Gaussian Curvature"):
        meshset.compute_scalar_by_discrete_curvature_per_vertex(curvaturetype=kind)
        fields.append(meshset.current_mesh().vertex_scalar_array().copy())
    return meshset.current_mesh().vertex_normal_matrix(), fields[0], fields[1]


def methods() -> dict[str, Method]:
    found: dict[str, Method] = {
        "automatic": ours(),
        "2 rings, alpha 0.8": ours(rings=2, alpha=0.8),
        "paper": ours(smoothness="paper"),
        "MeshLab discrete": meshlab_discrete,
    }
    try:
        found |= {"libigl radius 2": libigl(2), "libigl radius 5": libigl(5)}
    except ImportError:
        print("libigl is not installed: left out (pip install 'bezier-filters[bench]')")
    return found


def errors(surface: SampledSurface, estimate: Estimate, inner: np.ndarray) -> list[float]:
    """Errors of normal, |H| and K; peers disagree on the sign of H."""

    def relative(value: np.ndarray, truth: np.ndarray) -> float:
        return float(np.sqrt(np.mean((value - truth)[inner] ** 2) / np.mean(truth[inner] ** 2)))

    normals, mean, gaussian = estimate
    angle = np.nan
    if normals is not None:
        unit = normals / np.linalg.norm(normals, axis=1, keepdims=True)
        chord = np.linalg.norm(unit - surface.normals, axis=1)[inner]
        angle = float(np.degrees(np.sqrt(np.mean(chord**2))))
    return [
        angle,
        relative(np.abs(mean), np.abs(surface.mean_curvature)),
        relative(gaussian, surface.gaussian_curvature),
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--resolution", type=int, default=30, help="sampling; 30 gives about 9,000 vertices")
    parser.add_argument("--noise", type=float, nargs="+", default=[0.0, 0.01, 0.05, 0.1, 0.2])
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    rows = []
    for name, make in SURFACES.items():
        surface = make(arguments.resolution)
        edges = surface.vertices[surface.faces[:, 0]] - surface.vertices[surface.faces[:, 1]]
        edge = np.linalg.norm(edges, axis=1).mean()
        mesh = bf.triangle_mesh(surface.vertices, surface.faces)
        adjacency = bf.vertex_adjacency(mesh)
        rows_of = bf.k_rings(adjacency, 2)
        inner = np.array([not adjacency.on_boundary[rows_of.row(i)].any() for i in range(mesh.vertex_count)])
        for level in arguments.noise:
            noise = np.random.default_rng(arguments.seed).standard_normal(mesh.vertex_count) * level * edge
            vertices = surface.vertices + noise[:, None] * surface.normals
            for method, run in methods().items():
                rows.append((name, level, method, *errors(surface, run(vertices, surface.faces), inner)))
    RESULTS.mkdir(exist_ok=True)
    with (RESULTS / "accuracy.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["surface", "noise", "method", "normal_degrees", "mean_curvature", "gaussian_curvature"])
        writer.writerows([*row[:3], *(f"{value:.4g}" for value in row[3:])] for row in rows)
    print(f"{'noise':>6}  {'method':22}{'normal [deg]':>14}{'H':>12}{'K':>12}")
    for level in arguments.noise:
        for method in methods():
            table = np.array([row[3:] for row in rows if row[1] == level and row[2] == method])
            means = np.exp(np.log(table).mean(axis=0))
            angle = "-" if np.isnan(means[0]) else f"{means[0]:.4g}"
            print(f"{level:6.2f}  {method:22}{angle:>14}{means[1]:12.4g}{means[2]:12.4g}")


if __name__ == "__main__":
    main()
