"""Smoothing next to other filters: errors of normals and places, volume, flips and time.

Noise is Gaussian along the normals of the vertices, in fractions of the mean edge. Scores: mean angle between the
normals of the faces and the clean ones, degrees; root mean square distance of the vertices to the clean surface
in mean edges (needs libigl); volume in per cent of the clean one's; faces turned by more than 90 degrees.
Surfaces are made here; meshes in a directory (files CASE_NOISE.npz with `clean`, `noisy` and `faces`) come on top.
"""

import argparse
import csv
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np

from bezier_filters import surfaces
from smoothing_peers import smoothers, volume

RESULTS = Path(__file__).parent / "results"


class Case(NamedTuple):
    """A clean mesh, and noise to be added, or the noisy mesh itself."""

    clean: np.ndarray
    faces: np.ndarray
    noise: float
    noisy: np.ndarray | None = None


def made_cases() -> dict[str, Case]:
    """Analytic surfaces, irregularly sampled, and a block."""
    ball = surfaces.sphere(resolution=29, jitter=0.25)
    ring = surfaces.torus(resolution=55, jitter=0.25)
    star = surfaces.bumpy_star(resolution=29, jitter=0.25)
    block, faces = surfaces.block_with_sharp_edges(resolution=30, jitter=0.25)
    return {
        "sphere": Case(ball.vertices, ball.faces, 0.2),
        "torus": Case(ring.vertices, ring.faces, 0.2),
        "bumpy star": Case(star.vertices, star.faces, 0.2),
        **{f"block {level}": Case(block, faces, level) for level in (0.1, 0.2, 0.3)},
    }


def stored_cases(folder: Path) -> dict[str, Case]:
    """Cases in a directory."""
    found = {}
    for path in sorted(folder.glob("*_*.npz")):
        with np.load(path) as data:
            name, level = path.stem.rsplit("_", 1)
            found[f"{name} {level}"] = Case(data["clean"], data["faces"].astype(np.int32), float(level), data["noisy"])
    return found


def face_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)


def mean_edge(vertices: np.ndarray, faces: np.ndarray) -> float:
    return float(np.mean([np.linalg.norm(vertices[faces[:, k - 1]] - vertices[faces[:, k]], axis=1) for k in range(3)]))


def with_noise(case: Case, seed: int) -> np.ndarray:
    """The noisy vertices; seed 0 is the stored noise, if there is any."""
    if seed == 0 and case.noisy is not None:
        return case.noisy
    normals = np.zeros_like(case.clean)
    for k in range(3):
        np.add.at(normals, case.faces[:, k], face_normals(case.clean, case.faces))
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    heights = np.random.default_rng(seed).standard_normal(len(normals)) * case.noise
    return case.clean + heights[:, None] * mean_edge(case.clean, case.faces) * normals


def scores(vertices: np.ndarray, case: Case) -> dict[str, float]:
    cosines = (face_normals(vertices, case.faces) * face_normals(case.clean, case.faces)).sum(axis=1)
    return {
        "angle": float(np.degrees(np.arccos(np.clip(cosines, -1.0, 1.0))).mean()),
        "distance": distance(vertices, case) / mean_edge(case.clean, case.faces),
        "volume": 100.0 * volume(vertices, case.faces) / volume(case.clean, case.faces),
        "flipped": float((cosines < 0.0).sum()),
    }


def distance(vertices: np.ndarray, case: Case) -> float:
    """Root mean square distance to the clean surface; NaN without libigl."""
    try:
        import igl
    except ImportError:
        return float("nan")
    squared = igl.point_mesh_squared_distance(np.ascontiguousarray(vertices), case.clean, case.faces.astype(np.int64))[
        0
    ]
    return float(np.sqrt(squared.mean()))


def with_stored(rows: list[dict[str, object]]) -> list[dict[str, object]]:
    """Rows after the stored ones of other methods and cases, case by case."""
    new = {(row["case"], row["method"]) for row in rows}
    with (RESULTS / "smoothing.csv").open(newline="") as file:
        kept = [row for row in csv.DictReader(file) if (row["case"], row["method"]) not in new]
    scored = [{key: v if key in ("case", "method", "seed") else float(v) for key, v in row.items()} for row in kept]
    cases = list(dict.fromkeys(row["case"] for row in scored + rows))
    return sorted([*scored, *rows], key=lambda row: cases.index(row["case"]))


def plot(rows: list[dict[str, object]], path: Path) -> None:
    """Angles and distances of all methods, case by case."""
    from matplotlib.figure import Figure

    cases, methods = (list(dict.fromkeys(row[key] for row in rows)) for key in ("case", "method"))
    figure = Figure(figsize=(11.0, 7.0), layout="constrained")
    for axes, score in zip(figure.subplots(2, 1, sharex=True), ("angle", "distance"), strict=True):
        for k, method in enumerate(methods):
            values = [np.mean([r[score] for r in rows if r["case"] == c and r["method"] == method]) for c in cases]
            styles = {
                "automatic": {"color": "black", "marker": "o", "zorder": 3},
                "noisy": {"color": "gray", "marker": "x"},
            }
            style = styles.get(method, {"marker": "."})
            axes.semilogy(np.arange(len(cases)) + 0.04 * (k - 4), values, linestyle="", label=method, **style)
        axes.set(ylabel={"angle": "mean angle [deg]", "distance": "RMS distance [edges]"}[score])
        axes.grid(alpha=0.3)
    axes.set_xticks(range(len(cases)), cases, rotation=30, ha="right")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside right center", fontsize=8)
    figure.savefig(path, dpi=110)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("directory", nargs="?", type=Path, help="of further cases")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--only", default="", help="methods whose name contains this; stored rows of others stay")
    parser.add_argument("--save", action="store_true", help="write benchmarks/results/smoothing.csv and .png")
    options = parser.parse_args()
    cases = made_cases() | (stored_cases(options.directory) if options.directory else {})
    rows: list[dict[str, object]] = []
    methods = {"noisy": lambda vertices, _: vertices, **smoothers()}
    methods = {name: smooth for name, smooth in methods.items() if options.only in name}
    first = next(iter(cases.values()))
    for smooth in methods.values():
        smooth(first.clean, first.faces)  # loads or compiles the code
    print(f"{'case':14}{'method':30}{'angle':>8}{'distance':>10}{'volume %':>10}{'flipped':>9}{'seconds':>9}")
    for name, case in cases.items():
        for method, smooth in methods.items():
            found = []
            for seed in range(options.seeds):
                noisy = with_noise(case, seed)
                start = time.perf_counter()
                result = smooth(noisy, case.faces)
                seconds = time.perf_counter() - start
                found.append({"case": name, "method": method, "seed": seed, **scores(result, case), "seconds": seconds})
            rows += found
            mean = {key: np.mean([row[key] for row in found]) for key in list(found[0])[3:]}
            print(
                f"{name:14}{method:30}{mean['angle']:8.2f}{mean['distance']:10.4f}{mean['volume']:10.2f}"
                f"{mean['flipped']:9.1f}{mean['seconds']:9.2f}",
                flush=True,
            )
    if options.save:
        if options.only:
            rows = with_stored(rows)
        with (RESULTS / "smoothing.csv").open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(rows[0])
            writer.writerows([f"{x:.5g}" if isinstance(x, float) else x for x in row.values()] for row in rows)
        plot(rows, RESULTS / "smoothing.png")


if __name__ == "__main__":
    main()
