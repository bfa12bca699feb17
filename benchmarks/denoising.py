"""Smoothing on a test set that denoisers are compared on: angles, heights, sliding, volume, faces turned over, time.

    python benchmarks/denoising.py DIRECTORY --save

The directory has files MODEL.npz with `clean`, `faces` and noisy vertices `n1`, `n2`, `n3`, and files released_NAME.npz
with `clean`, `faces`, `noisy` and `released`, what the authors of a method published with their code, tuned or trained.
Scores: mean angle between the normals of the faces and the clean ones, degrees; root mean square distance of each
vertex to its own clean place along the clean normal (height) and along the surface (sliding), mean edges; volume over
the clean one; share of the faces turned by more than 90 degrees. The default of `bezier_filters.smooth`, one thread.
"""

import argparse
import csv
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

import bezier_filters as bf
from smoothing import RESULTS, face_normals, mean_edge
from smoothing_peers import volume

WORST = 3  # models of which pictures are drawn


class Case(NamedTuple):
    """A model with noise, and what others have made of it."""

    name: str
    level: str
    clean: np.ndarray
    faces: np.ndarray
    noisy: np.ndarray
    released: np.ndarray | None = None


def cases(folder: Path) -> Iterator[Case]:
    for path in sorted(folder.glob("*.npz")):
        with np.load(path) as data:
            clean, faces = data["clean"].astype(np.float64), data["faces"].astype(np.int32)
            if "released" in data:
                yield Case(path.stem, "", clean, faces, data["noisy"].astype(float), data["released"].astype(float))
            else:
                for level in ("n1", "n2", "n3"):
                    yield Case(path.stem, level, clean, faces, data[level].astype(np.float64))


def vertex_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    areas, normals = np.cross(b - a, c - a), np.zeros_like(vertices)
    for k in range(3):
        np.add.at(normals, faces[:, k], areas)
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)


def scores(vertices: np.ndarray, case: Case) -> dict[str, float]:
    cosines = (face_normals(vertices, case.faces) * face_normals(case.clean, case.faces)).sum(axis=1)
    errors = (vertices - case.clean) / mean_edge(case.clean, case.faces)
    normals = vertex_normals(case.clean, case.faces)
    heights = (errors * normals).sum(axis=1)
    along = errors - heights[:, None] * normals
    return {
        "angle": float(np.degrees(np.arccos(np.clip(cosines, -1.0, 1.0))).mean()),
        "height": float(np.sqrt(np.square(heights).mean())),
        "sliding": float(np.sqrt(np.square(along).sum(axis=1).mean())),
        "volume": volume(vertices, case.faces) / volume(case.clean, case.faces),
        "turned": float((cosines < 0.0).mean()),
    }


def rows_of(case: Case) -> tuple[list[dict[str, object]], np.ndarray]:
    """A row each for the noise, our result and the released one, and the result."""
    start = time.perf_counter()
    result = bf.smooth(case.noisy, case.faces, threads=1).vertices
    seconds = time.perf_counter() - start
    found = {"noisy": case.noisy, "automatic": result, "released": case.released}
    rows = [
        {"case": case.name, "level": case.level, "method": method}
        | {name: f"{value:.4g}" for name, value in scores(vertices, case).items()}
        | {"seconds": f"{seconds:.2f}" if method == "automatic" else ""}
        for method, vertices in found.items()
        if vertices is not None
    ]
    return rows, result


def draw(case: Case, result: np.ndarray, path: Path) -> None:
    """Faces drawn flat, one by one, so that nothing hides what is left of the noise."""
    from bezier_filters.pictures.render import render_panels
    from bezier_filters.pictures.scene import Panel

    panels = []
    for title, vertices in {"clean": case.clean, f"noisy {case.level}": case.noisy, "automatic": result}.items():
        corners = np.ascontiguousarray(vertices[case.faces].reshape(-1, 3))
        triangles = np.arange(case.faces.size, dtype=np.int32).reshape(-1, 3)
        panels.append(Panel(corners, triangles, colors=np.full((len(corners), 3), 0.75), title=title))
    render_panels(path, panels)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="cases as files")
    parser.add_argument("--save", action="store_true", help="keep the table and the pictures in benchmarks/results")
    options = parser.parse_args()
    bf.smooth(*bf.surfaces.block_with_sharp_edges(resolution=8))  # kernels are loaded
    rows, worst = list[dict[str, object]](), list[tuple[float, Case, np.ndarray]]()
    for case in cases(options.folder):
        of_case, result = rows_of(case)
        for row in of_case:
            print("  ".join(f"{value:>10}" for value in row.values()), flush=True)
        rows += of_case
        left = float(str(of_case[1]["angle"])) / float(str(of_case[0]["angle"]))
        worst = sorted([*worst, (left, case, result)], key=lambda one: -one[0])[:WORST]
    if options.save:
        with (RESULTS / "denoising.csv").open("w", newline="", encoding="utf-8") as stream:
            writer = csv.DictWriter(stream, list(rows[0]))
            writer.writeheader()
            writer.writerows(rows)
        for k, (_, case, result) in enumerate(worst):
            draw(case, result, RESULTS / f"denoising_worst_{k + 1}.png")


if __name__ == "__main__":
    main()
