"""Errors of H and K next to interpolated corrected curvatures at the best of their radii, on noise of 0 to 0.6 edges.

Surfaces, noise and errors are those of accuracy.py. The peer takes the means of the face normals, weighted by area; in
the last columns it takes the normals of our estimate. Its radius, in mean edges of the noisy mesh, is the one with the
smallest error of the quantity in that row: it is chosen by the truth, ours is not. Where there is noise, errors are
geometric means over three seeds.

With --kinds, the kinds of noise of noise.py instead, on its surfaces: geometric means over these.
"""

import argparse
import csv
import itertools
from collections.abc import Callable
from pathlib import Path

import numpy as np

import noise
from accuracy import SURFACES, errors, inner_vertices, with_noise
from bezier_filters.surfaces import SampledSurface
from corrected_curvatures import corrected_curvatures
from peers import Estimate, ours

RESULTS = Path(__file__).parent / "results"
RADII = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 12.0)
"""In mean edges."""
RESOLUTIONS = (15, 30)
LEVELS = (0.0, 0.1, 0.3, 0.6)
SEEDS = (0, 1, 2)
KINDS_SEED = 5
QUANTITIES = {"H": 1, "K": 2}
"""Places in the errors of accuracy.py."""


def mean_edge(vertices: np.ndarray, faces: np.ndarray) -> float:
    """Mean length of the sides of the faces."""
    return float(np.linalg.norm(vertices[faces] - vertices[np.roll(faces, 1, axis=1)], axis=2).mean())


def corrected(vertices: np.ndarray, faces: np.ndarray, radius: float, normals: np.ndarray | None = None) -> Estimate:
    """By the measures in balls of a radius in mean edges of the mesh as it is."""
    found = corrected_curvatures(vertices, faces, radius * mean_edge(vertices, faces), normals=normals)
    return Estimate(None, found.mean_curvature, found.gaussian_curvature)


def errors_of(surface: SampledSurface, vertices: np.ndarray, inner: np.ndarray) -> list[list[float]]:
    """Errors of ours, of the peer at every radius, and of the peer by our normals at every radius."""
    own = ours()(vertices, surface.faces)
    estimates = [own]
    for normals in (None, own.normals):
        estimates += [corrected(vertices, surface.faces, radius, normals) for radius in RADII]
    return [errors(surface, estimate, inner) for estimate in estimates]


def rows_with_best_radii(samples: list[list[list[float]]], **head: object) -> list[dict[str, object]]:
    """A row for each quantity: geometric means over the samples, of the peer at the radius where that is smallest."""
    (own,), *peers = np.split(np.exp(np.log(samples).mean(axis=0)), [1, 1 + len(RADII)])
    found = []
    for quantity, place in QUANTITIES.items():
        row = head | {"quantity": quantity, "ours": own[place]}
        for column, values in zip(("corrected", "corrected_by_our_normals"), peers, strict=True):
            best = int(np.argmin(values[:, place]))
            row |= {column: values[best, place], f"radius_{column}": RADII[best]}
        found.append(row)
    return found


def rows_of(name: str, resolution: int, level: float) -> list[dict[str, object]]:
    """A row for each quantity of a surface with some noise."""
    surface = SURFACES[name](resolution)
    inner = inner_vertices(surface)
    seeds = SEEDS if level else SEEDS[:1]
    samples = [errors_of(surface, with_noise(surface, level, seed), inner) for seed in seeds]
    return rows_with_best_radii(samples, surface=name, vertices=len(surface.vertices), noise=level)


def rows_of_kind(kind: str, level: float) -> list[dict[str, object]]:
    """A row for each quantity of a kind of noise on the surfaces of noise.py."""
    samples = []
    for make in noise.SURFACES.values():
        surface = make()
        vertices = noise.displaced(kind, level, surface, KINDS_SEED)
        samples.append(errors_of(surface, vertices, np.ones(len(vertices), dtype=np.bool_)))
    return rows_with_best_radii(samples, kind=kind, level=level)


def table_row(rows: list[dict[str, object]]) -> str:
    """H and K of a surface with some noise as a line of the table; the smaller error of ours and theirs is bold."""
    cells = []
    for value in itertools.takewhile(lambda value: value not in QUANTITIES, rows[0].values()):
        cells.append(str(value) if isinstance(value, str) else f"{value:,}" if isinstance(value, int) else f"{value:g}")
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


def measured(cases: list[tuple[object, ...]], find: Callable[..., list[dict[str, object]]]) -> list[dict[str, object]]:
    """The rows of some cases, which are printed as a table meanwhile."""
    rows: list[dict[str, object]] = []
    for case in cases:
        found = find(*case)
        if not rows:
            names = list(found[0])
            parts = ("ours", "theirs", "radius", "by our normals", "radius")
            heads = [*names[: names.index("quantity")], *(f"{q}, {part}" for q in QUANTITIES for part in parts)]
            print(f"| {' | '.join(heads)} |\n|{'---|' * len(heads)}")
        print(table_row(found), flush=True)
        rows += found
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kinds", action="store_true", help="the kinds of noise of noise.py")
    parser.add_argument(
        "--save", action="store_true", help="write strongest_peer.csv, or .._kinds.csv, to benchmarks/results"
    )
    arguments = parser.parse_args()
    if arguments.kinds:
        rows = measured(noise.KINDS, rows_of_kind)
    else:
        rows = measured(list(itertools.product(SURFACES, RESOLUTIONS, LEVELS)), rows_of)
        print(
            "\n| noise | | ours / theirs | behind | ours / theirs by our normals | behind |\n|---|---|---|---|---|---|"
        )
        for level, quantity in itertools.product(LEVELS, QUANTITIES):
            print(summary(rows, level, quantity))
    if arguments.save:
        path = RESULTS / f"strongest_peer{'_kinds' if arguments.kinds else ''}.csv"
        with path.open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(rows[0])
            writer.writerows([f"{v:.4g}" if isinstance(v, float) else v for v in row.values()] for row in rows)


if __name__ == "__main__":
    main()
