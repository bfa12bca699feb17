"""Errors on the red blood cell over triangulations of 1,280 to 46,080 triangles, next to published ones.

The surface and the sizes are those of the curvature test of curvpack; its own triangulations, if
at hand as mesh0.npz, mesh1.npz, ... with the arrays vertices and faces, can be given as a
directory. Errors: normal in degrees; H and K as differences over the largest exact value, by
absolute value; mean and maximum over the vertices. Prints a table; with --save, writes red_blood_cell.csv and
red_blood_cell.png.
"""

import argparse
import csv
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from bezier_filters.surfaces import SampledSurface
from evans_fung import red_blood_cell, red_blood_cell_at
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

RESULTS = Path(__file__).parent / "results"
RESOLUTIONS = (8, 12, 16, 24, 32, 48)
PUBLISHED = {
    "H": (1.2e-2, 5.4e-3, 3.1e-3, 1.4e-3, 7.7e-4, 3.4e-4),
    "K": (1.4e-2, 6.4e-3, 3.6e-3, 1.6e-3, 9.1e-4, 4.0e-4),
}
"""Mean errors that curvpack publishes for its own triangulations of these sizes: the best of its six methods."""
TITLES = {"normal": "normal, degrees", "H": "mean curvature H, relative", "K": "Gaussian curvature K, relative"}


def methods() -> dict[str, Method]:
    return {
        "automatic": ours(),
        "paper": ours(smoothness="paper"),
        "Razdan-Bae": razdan_bae("edges"),
        "Razdan-Bae, twists": razdan_bae("twists"),
        "OuYang-Feng": ouyang_feng,
        "area weights": meshlab_normals("By Area"),
        "N. Max weights": meshlab_normals("As defined by N. Max"),
        **libigl_quadric(2),
        **libigl_quadric(5),
        "MeshLab quadric fitting": meshlab_directions("Quadric Fitting"),
        "MeshLab discrete": meshlab_discrete,
    }


def sampled(directory: Path | None, finest: int) -> list[SampledSurface]:
    """The triangulations of a directory, or our own up to the finest resolution."""
    if directory is None:
        return [red_blood_cell(resolution=resolution) for resolution in RESOLUTIONS if resolution <= finest]
    found = []
    for path in sorted(directory.glob("mesh*.npz")):
        with np.load(path) as arrays:
            found.append(red_blood_cell_at(arrays["vertices"], arrays["faces"].astype(np.int32)))
    return found


def errors(surface: SampledSurface, estimate: Estimate) -> dict[str, tuple[float, float]]:
    """Mean and maximum per quantity, for those that the method gives."""
    found = {}
    if estimate.normals is not None:
        found["normal"] = angles(estimate.normals, surface.normals)
    exact = {"H": surface.mean_curvature, "K": surface.gaussian_curvature}
    for (name, truth), value in zip(exact.items(), estimate[1:], strict=True):
        if value is not None:
            found[name] = np.abs(value - truth) / np.abs(truth).max()
    return {name: (float(error.mean()), float(error.max())) for name, error in found.items()}


def print_tables(rows: list[tuple], sizes: list[int]) -> None:
    for quantity, title in TITLES.items():
        for column, kind in ((3, "mean"), (4, "maximum")):
            print(f"\n{title}, {kind} error")
            print(f"{'triangles':26}" + "".join(f"{size:>10,}" for size in sizes))
            for method in dict.fromkeys(row[1] for row in rows if row[2] == quantity):
                cells = [row[column] for row in rows if row[1] == method and row[2] == quantity]
                print(f"{method:26}" + "".join(f"{cell:10.2g}" for cell in cells))
            if kind == "mean" and quantity in PUBLISHED:
                print(f"{'curvpack, published':26}" + "".join(f"{cell:10.2g}" for cell in PUBLISHED[quantity]))


def plot(rows: list[tuple], path: Path) -> None:
    """Mean errors over the number of triangles; colours of Okabe and Ito, ours drawn thick."""
    palette = ["#000000", "#D55E00", "#0072B2", "#56B4E9", "#009E73", "#CC79A7", "#E69F00", "#999999"]
    names = list(dict.fromkeys(row[1] for row in rows))
    figure, panels = plt.subplots(1, 3, figsize=(14, 5.2))
    for (quantity, title), panel in zip(TITLES.items(), panels, strict=True):
        for place, name in enumerate(names):
            points = [(row[0], row[3]) for row in rows if row[1] == name and row[2] == quantity]
            if points:
                panel.loglog(
                    *zip(*points, strict=True),
                    color=palette[place % len(palette)],
                    linestyle="-" if place < len(palette) else "--",
                    marker="osD^vPX*<>p"[place],
                    markersize=5,
                    linewidth=3 if name == "automatic" else 1.3,
                    label=name,
                )
        if quantity in PUBLISHED:
            published = [20 * resolution**2 for resolution in RESOLUTIONS]
            panel.plot(published, PUBLISHED[quantity], "k*:", markersize=10, label="curvpack, published")
        panel.set_title(f"{title}, mean error", fontsize=10)
        panel.set_xlabel("triangles")
        sizes = sorted({row[0] for row in rows})
        panel.set_xticks(sizes, [f"{size:,}" for size in sizes], rotation=45)
        panel.minorticks_off()
        panel.grid(color="0.9")
    lines = {line.get_label(): line for panel in panels for line in panel.get_lines()}
    figure.legend(lines.values(), lines.keys(), loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    figure.tight_layout()
    figure.savefig(path, dpi=110, bbox_inches="tight")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("directory", type=Path, nargs="?", help="triangulations to use; by default, ours")
    parser.add_argument("--finest", type=int, default=max(RESOLUTIONS), help="resolution; 48 has 46,080 triangles")
    parser.add_argument("--save", action="store_true", help="write benchmarks/results/red_blood_cell.csv and .png")
    arguments = parser.parse_args()
    rows, sizes = [], []
    for surface in sampled(arguments.directory, arguments.finest):
        sizes.append(len(surface.faces))
        for method, run in methods().items():
            for quantity, (mean, largest) in errors(surface, run(surface.vertices, surface.faces)).items():
                rows.append((sizes[-1], method, quantity, mean, largest))
    print_tables(rows, sizes)
    if not arguments.save:
        return
    with (RESULTS / "red_blood_cell.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["triangles", "method", "quantity", "mean_error", "max_error"])
        writer.writerows([*row[:3], *(f"{value:.4g}" for value in row[3:])] for row in rows)
    plot(rows, RESULTS / "red_blood_cell.png")


if __name__ == "__main__":
    main()
