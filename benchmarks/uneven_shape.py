"""Errors on a shape of uneven curvature whose truth is known: the bunny as a Loop subdivision surface.

The bunny is remeshed on some of its vertices and subdivided; normals and curvatures of the limit are
exact. Ears and toes beside smooth flanks are what a choice for all of them finds hardest.
Noise is Gaussian, along the normal, in mean edges. Errors: normals, mean angle in degrees; H and K,
sum of the differences over sum of the truth, both by absolute value. Prints tables; with --save,
writes uneven_shape.csv.
"""

import argparse
import csv
import sys
from pathlib import Path

import numpy as np

from bezier_filters.meshlab.meshset import bunny_path
from bezier_filters.surfaces import SampledSurface
from limit_surface import limit_surface
from peers import (
    Estimate,
    Method,
    angles,
    libigl_quadric,
    meshlab_directions,
    meshlab_discrete,
    meshlab_normals,
    ours,
    ouyang_feng,
    razdan_bae,
)
from reduction import TITLES, model

sys.path.append(str(Path(__file__).parents[1] / "tools"))
from survivors import keep_survivors

RESULTS = Path(__file__).parent / "results"
SHAPES = {10: 2, 30: 1}
"""Percentage of the vertices that the control mesh keeps, and how often it is subdivided."""


def methods() -> dict[str, Method]:
    return {
        "automatic": ours(),
        **{f"automatic on {rings} rings": ours(rings=rings) for rings in (2, 3, 4, 6)},
        "paper": ours(smoothness="paper"),
        "Razdan-Bae": razdan_bae("edges"),
        "OuYang-Feng": ouyang_feng,
        "area weights": meshlab_normals("By Area"),
        "N. Max weights": meshlab_normals("As defined by N. Max"),
        **libigl_quadric(2),
        **libigl_quadric(5),
        "MeshLab quadric fitting": meshlab_directions("Quadric Fitting"),
        "MeshLab discrete": meshlab_discrete,
    }


def errors(surface: SampledSurface, regular: np.ndarray, estimate: Estimate) -> list[float]:
    """Errors of normal, H and K; NaN for what a method does not give."""
    found = [np.nan, np.nan, np.nan]
    if estimate.normals is not None:
        found[0] = float(angles(estimate.normals, surface.normals).mean())
    for k, truth in ((1, surface.mean_curvature), (2, surface.gaussian_curvature)):
        if estimate[k] is not None:
            found[k] = float(np.abs(estimate[k] - truth)[regular].sum() / np.abs(truth[regular]).sum())
    return found


def shape(share: int, subdivisions: int, seed: int) -> tuple[SampledSurface, np.ndarray, np.ndarray]:
    """The limit surface of the bunny on a percentage of its vertices, which ones are regular, and noise of one edge."""
    vertices, faces = model(bunny_path())
    random = np.random.default_rng([seed, share])
    survivors = random.permutation(len(vertices)) < share / 100 * len(vertices)
    kept, control = keep_survivors(vertices, faces, survivors)
    surface, regular = limit_surface(vertices[kept], control, subdivisions=subdivisions)
    sides = surface.vertices[surface.faces] - surface.vertices[np.roll(surface.faces, 1, axis=1)]
    edge = np.linalg.norm(sides, axis=2).mean()
    return surface, regular, random.standard_normal((len(surface.vertices), 1)) * edge * surface.normals


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--noise", type=float, nargs="+", default=[0.0, 0.01, 0.05, 0.1])
    parser.add_argument("--seed", type=int, default=0, help="of the choice of vertices and of the noise")
    parser.add_argument("--save", action="store_true", help="write benchmarks/results/uneven_shape.csv")
    arguments = parser.parse_args()
    rows = []
    for share, subdivisions in SHAPES.items():
        surface, regular, noise = shape(share, subdivisions, arguments.seed)
        print(f"\n{share} % of the vertices, subdivided {subdivisions} times: {len(noise):,} vertices")
        for level in arguments.noise:
            for name, method in methods().items():
                estimate = method(surface.vertices + level * noise, surface.faces)
                rows.append((share, level, name, *errors(surface, regular, estimate)))
        for k, title in enumerate(TITLES.values()):
            print(f"\n{title + ', noise':26}" + "".join(f"{level:>10g}" for level in arguments.noise))
            for name in methods():
                cells = [row[3 + k] for row in rows if row[0] == share and row[2] == name]
                if not np.isnan(cells).any():
                    print(f"{name:26}" + "".join(f"{cell:10.3g}" for cell in cells))
    if not arguments.save:
        return
    with (RESULTS / "uneven_shape.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["kept_percent", "noise", "method", "normal_degrees", "mean_curvature", "gaussian_curvature"])
        writer.writerows([*row[:3], *(f"{value:.4g}" for value in row[3:])] for row in rows)


if __name__ == "__main__":
    main()
