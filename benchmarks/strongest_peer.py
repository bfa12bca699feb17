"""Errors of H and K next to interpolated corrected curvatures at the best of their radii, on noise of 0 to 0.6 edges.

Surfaces, noise and errors are those of accuracy.py. The peer takes the means of the face normals, weighted by area; in
the last columns it takes the normals of our estimate. Its radius, in mean edges of the noisy mesh, is the one with the
smallest error of the quantity in that row: it is chosen by the truth, ours is not. Where there is noise, errors are
geometric means over three seeds.
"""

import argparse
import csv
from pathlib import Path

import numpy as np

from accuracy import SURFACES, errors, inner_vertices, with_noise
from corrected_curvatures import corrected_curvatures
from peers import Estimate, ours

RESULTS = Path(__file__).parent / "results"
RADII = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 12.0)
"""In mean edges."""
RESOLUTIONS = (15, 30)
LEVELS = (0.0, 0.1, 0.3, 0.6)
SEEDS = (0, 1, 2)
QUANTITIES = {"H": 1, "K": 2}
"""Places in the errors of accuracy.py."""


def mean_edge(vertices: np.ndarray, faces: np.ndarray) -> float:
    """Mean length of the sides of the faces."""
    return float(np.linalg.norm(vertices[faces] - vertices[np.roll(faces, 1, axis=1)], axis=2).mean())


def corrected(vertices: np.ndarray, faces: np.ndarray, radius: float, normals: np.ndarray | None = None) -> Estimate:
    """By the measures in balls of a radius in mean edges of the mesh as it is."""
    found = corrected_curvatures(vertices, faces, radius * mean_edge(vertices, faces), normals=normals)
    return Estimate(None, found.mean_curvature, found.gaussian_curvature)


def rows_of(name: str, resolution: int, level: float) -> list[dict[str, object]]:
    """A row for each quantity of a surface with some noise: errors of ours and of the peer, and its radii."""
    surface = SURFACES[name](resolution)
    inner = inner_vertices(surface)
    samples = []
    for seed in SEEDS if level else SEEDS[:1]:
        vertices = with_noise(surface, level, seed)
        own = ours()(vertices, surface.faces)
        estimates = [own]
        for normals in (None, own.normals):
            estimates += [corrected(vertices, surface.faces, radius, normals) for radius in RADII]
        samples.append([errors(surface, estimate, inner) for estimate in estimates])
    (own_errors,), *peers = np.split(np.exp(np.log(samples).mean(axis=0)), [1, 1 + len(RADII)])
    found = []
    for quantity, place in QUANTITIES.items():
        row = {"surface": name, "vertices": len(surface.vertices), "noise": level, "quantity": quantity}
        row["ours"] = own_errors[place]
        for column, values in zip(("corrected", "corrected_by_our_normals"), peers, strict=True):
            best = int(np.argmin(values[:, place]))
            row |= {column: values[best, place], f"radius_{column}": RADII[best]}
        found.append(row)
    return found


def table_row(rows: list[dict[str, object]]) -> str:
    """H and K of a surface with some noise as a line of the page's table, the smaller error of ours and theirs in bold."""
    first = rows[0]
    cells = [first["surface"], f"{first['vertices']:,}", f"{first['noise']:g}"]
    for row in rows:
        pair = [f"{row[name]:.2g}" for name in ("ours", "corrected")]
        better = int(row["corrected"] < row["ours"])
        pair[better] = f"**{pair[better]}**"
        others = f"{row['radius_corrected']:g}", f"{row['corrected_by_our_normals']:.2g}"
        cells += [*pair, *others, f"{row['radius_corrected_by_our_normals']:g}"]
    return f"| {' | '.join(cells)} |"


def summary(rows: list[dict[str, object]], level: float, quantity: str) -> str:
    """How ours compares with the peer at some noise, over all surfaces and resolutions."""
    chosen = [row for row in rows if (row["noise"], row["quantity"]) == (level, quantity)]
    cells = []
    for column in ("corrected", "corrected_by_our_normals"):
        ratios = np.array([row["ours"] / row[column] for row in chosen])
        cells += [f"{np.exp(np.log(ratios).mean()):.2g}", f"{(ratios > 1.0).sum()} of {len(ratios)}"]
    return f"| {level:g} | {quantity} | {' | '.join(cells)} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--save", action="store_true", help="write benchmarks/results/strongest_peer.csv")
    arguments = parser.parse_args()
    parts = ("ours", "theirs", "radius", "by our normals", "radius")
    heads = ["surface", "vertices", "noise", *(f"{quantity}, {part}" for quantity in QUANTITIES for part in parts)]
    print(f"| {' | '.join(heads)} |\n|{'---|' * len(heads)}")
    rows = []
    for name in SURFACES:
        for resolution in RESOLUTIONS:
            for level in LEVELS:
                found = rows_of(name, resolution, level)
                rows += found
                print(table_row(found), flush=True)
    print("\n| noise | | ours / theirs | behind | ours / theirs by our normals | behind |\n|---|---|---|---|---|---|")
    for level in LEVELS:
        for quantity in QUANTITIES:
            print(summary(rows, level, quantity))
    if arguments.save:
        with (RESULTS / "strongest_peer.csv").open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(rows[0])
            writer.writerows([f"{v:.4g}" if isinstance(v, float) else v for v in row.values()] for row in rows)


if __name__ == "__main__":
    main()
