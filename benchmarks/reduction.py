"""The paper's Tables 1 and 2: how far estimates move when most of the vertices are deleted.

Vertices of the bunny are deleted at random, the survivors are remeshed in place, and everything is
estimated again, on the reduced mesh and on the same with noise. Every method is compared with its
own estimates on the full, clean model, at the survivors: normals, mean angle in degrees; H and K,
sum of the differences over sum of the references, both by absolute value. So this is stability, not
accuracy: a method that smooths over a fixed length stays where it is, right or wrong.

Prints tables; with --save, writes reduction.csv and reduction.png. What MeshLab calls curvature by normal
cycles and by PCA is not in units of curvature; it is in the tables, not in the picture.
"""

import argparse
import csv
import sys
from collections.abc import Sequence
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import pymeshlab

import bezier_filters as bf
from bezier_filters.meshes.frames import tangent_planes
from bezier_filters.meshlab.meshset import bunny_path
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

sys.path.append(str(Path(__file__).parents[1] / "tools"))
from survivors import keep_survivors

RESULTS = Path(__file__).parent / "results"
DELETED = (10, 30, 50, 70, 90)
MEASURES = ("normal", "H", "K")
NOT_PLOTTED = ("MeshLab normal cycles", "MeshLab PCA")
TITLES = {"normal": "normal, degrees", "H": "mean curvature H", "K": "Gaussian curvature K"}


def methods(*, slow: bool) -> dict[str, Method]:
    found = {
        "automatic": ours(),
        "automatic on 2 rings": ours(rings=2),
        "paper": ours(smoothness="paper"),
        "Razdan-Bae": razdan_bae("edges"),
        "Razdan-Bae, twists": razdan_bae("twists"),
        "OuYang-Feng": ouyang_feng,
        "area weights": meshlab_normals("By Area"),
        "angle weights": meshlab_normals("By Angle"),
        "N. Max weights": meshlab_normals("As defined by N. Max"),
        **libigl_quadric(2),
        **libigl_quadric(5),
        "MeshLab quadric fitting": meshlab_directions("Quadric Fitting"),
        "MeshLab discrete": meshlab_discrete,
        "MeshLab normal cycles": meshlab_directions("Normal Cycles"),
    }
    if slow:
        found["MeshLab scale-dependent"] = meshlab_directions("Scale Dependent Quadric Fitting")
        found["MeshLab PCA"] = meshlab_directions("Principal Component Analysis")
    return found


def model(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Vertices that have faces, and faces."""
    meshset = pymeshlab.MeshSet()
    meshset.load_new_mesh(str(path))
    mesh = meshset.current_mesh()
    faces = mesh.face_matrix().astype(np.int32)
    used = np.unique(faces)
    return mesh.vertex_matrix()[used], np.searchsorted(used, faces).astype(np.int32)


def deviations(estimate: Estimate, reference: Estimate, rows: np.ndarray, full_rows: np.ndarray) -> list[float]:
    """Deviations of normal, H and K at the vertices `rows`, which the full model has at `full_rows`."""
    found = [np.nan, np.nan, np.nan]
    if estimate.normals is not None:
        unit = reference.normals / np.linalg.norm(reference.normals, axis=1, keepdims=True)
        found[0] = float(angles(estimate.normals[rows], unit[full_rows]).mean())
    for k in (1, 2):
        if estimate[k] is not None:
            difference = np.abs(estimate[k][rows] - reference[k][full_rows]).sum()
            found[k] = float(difference / np.abs(reference[k][full_rows]).sum())
    return found


def measured(
    vertices: np.ndarray,
    faces: np.ndarray,
    compared: dict[str, Method],
    percentages: Sequence[int],
    levels: Sequence[float],
    seed: int,
) -> list[tuple]:
    """Rows (noise, deleted, method, normal, H, K)."""
    edges = vertices[faces] - vertices[np.roll(faces, 1, axis=1)]
    edge = np.linalg.norm(edges, axis=2).mean()
    mesh = bf.triangle_mesh(vertices, faces)
    normals = tangent_planes(mesh, bf.vertex_adjacency(mesh)).normals
    reference = {name: method(vertices, faces) for name, method in compared.items()}
    rows = []
    for deleted in percentages:
        random = np.random.default_rng([seed, deleted])
        survivors = np.ones(len(vertices), dtype=bool)
        survivors[random.permutation(len(vertices))[: round(deleted / 100 * len(vertices))]] = False
        kept, reduced = keep_survivors(vertices, faces, survivors)
        at = np.flatnonzero(survivors[kept])
        print(f"{deleted} % deleted: {len(kept):,} vertices, {len(kept) - len(at)} of them could not be deleted")
        noise = random.standard_normal(len(kept)) * edge
        for level in levels:
            points = vertices[kept] + level * noise[:, np.newaxis] * normals[kept]
            for name, method in compared.items():
                found = deviations(method(points, reduced), reference[name], at, kept[at])
                rows.append((level, deleted, name, *found))
    return rows


def print_tables(rows: list[tuple], deleted: list[int]) -> None:
    levels, names = list(dict.fromkeys(row[0] for row in rows)), list(dict.fromkeys(row[2] for row in rows))
    for k, measure_name in enumerate(MEASURES):
        for level in levels:
            print(f"\n{TITLES[measure_name]}, noise {level:g}")
            print(f"{'':26}" + "".join(f"{d:>8} %" for d in deleted))
            for name in names:
                cells = [row[3 + k] for row in rows if row[0] == level and row[2] == name]
                if not np.isnan(cells).any():
                    print(f"{name:26}" + "".join(f"{cell:10.3g}" for cell in cells))


def plot(rows: list[tuple], path: Path) -> None:
    """One panel per quantity and noise level; colours of Okabe and Ito, ours drawn thick."""
    levels = list(dict.fromkeys(row[0] for row in rows))
    names = [name for name in dict.fromkeys(row[2] for row in rows) if name not in NOT_PLOTTED]
    palette = ["#000000", "#D55E00", "#0072B2", "#56B4E9", "#009E73", "#CC79A7", "#E69F00", "#999999"]
    figure, panels = plt.subplots(3, len(levels), figsize=(11, 11), sharex=True, sharey="row", squeeze=False)
    for k, measure_name in enumerate(MEASURES):
        for panel, level in zip(panels[k], levels, strict=True):
            for place, name in enumerate(names):
                points = [(row[1], row[3 + k]) for row in rows if row[0] == level and row[2] == name]
                if not np.isnan(points).any():
                    panel.plot(
                        *zip(*points, strict=True),
                        color=palette[place % len(palette)],
                        linestyle="-" if place < len(palette) else "--",
                        marker="osD^vPX*<>phd8H"[place],
                        markersize=5,
                        linewidth=3 if name == "automatic" else 1.3,
                        label=name,
                    )
            panel.set_yscale("log")
            panel.grid(which="both", color="0.9")
            panel.set_xticks(sorted({row[1] for row in rows}))
            panel.set_title(f"{TITLES[measure_name]}, " + (f"noise {level:g} edges" if level else "clean"), fontsize=10)
    for panel in panels[-1]:
        panel.set_xlabel("vertices deleted, %")
    for panel in panels[:, 0]:
        panel.set_ylabel("deviation from the full model")
    lines = {line.get_label(): line for panel in panels.flat for line in panel.get_lines()}
    figure.legend([lines[n] for n in names], names, loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    figure.tight_layout()
    figure.savefig(path, dpi=110, bbox_inches="tight")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("mesh", type=Path, nargs="?", default=bunny_path(), help="by default pymeshlab's bunny")
    parser.add_argument("--deleted", type=int, nargs="+", default=list(DELETED), help="percentages")
    parser.add_argument("--noise", type=float, default=0.05, help="standard deviation in mean edges of the full mesh")
    parser.add_argument("--seed", type=int, default=0, help="of the deletions and of the noise")
    parser.add_argument("--slow", action="store_true", help="also MeshLab's scale-dependent fits and its PCA")
    parser.add_argument("--save", action="store_true", help="write benchmarks/results/reduction.csv and .png")
    arguments = parser.parse_args()
    vertices, faces = model(arguments.mesh)
    print(f"{arguments.mesh.name}: {len(vertices):,} vertices, seed {arguments.seed}")
    levels = 0.0, arguments.noise
    rows = measured(vertices, faces, methods(slow=arguments.slow), arguments.deleted, levels, arguments.seed)
    print_tables(rows, arguments.deleted)
    if not arguments.save:
        return
    with (RESULTS / "reduction.csv").open(newline="") as file:  # methods that have not been run stay
        kept = [tuple(row) for row in csv.reader(file)][1:]
    names = {row[2] for row in rows}
    rows += [(*map(float, row[:2]), row[2], *map(float, row[3:])) for row in kept if row[2] not in names]
    with (RESULTS / "reduction.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(
            ["noise", "deleted_percent", "method", "normal_degrees", "mean_curvature", "gaussian_curvature"]
        )
        writer.writerows([*row[:3], *(f"{value:.4g}" for value in row[3:])] for row in rows)
    plot(rows, RESULTS / "reduction.png")


if __name__ == "__main__":
    main()
