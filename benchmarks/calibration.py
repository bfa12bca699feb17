"""Whether the standard errors hold on meshes whose true surface nobody knows.

    python benchmarks/calibration.py FOLDER --save table.csv      every mesh file below a folder
    python benchmarks/calibration.py                              surfaces that are known, with and without noise

A tenth of the vertices of a mesh are taken out, and the rest is remeshed in place and estimated with the defaults. From
the nearest fits follows where each missing vertex lay (see `tools/fit_predictions.py`). Expected is an error of the
root of the sum of squares of the noise of the missing vertex; the noise of the fitted height, by the leverage of an
unweighted fit of that degree and ring; the standard error of the normal times the distance, and that of H times half
its square, in one direction; the remainder of the prediction; and rounding. Error over expected error has a `spread`
(median size over .6745) and a 90 % point (`spread90`, over 1.645), which are 1 if the standard errors hold.

On noisy meshes the noise of the missing vertices decides. So the vertices are also divided into two meshes, each
estimated by itself. Normals and H of one half, predicted at the vertices of the other, differ by their standard errors:
`spread_n` (median angle over .833) and `spread_h`. What both halves have wrong alike is not seen.

More than 1 says that standard errors are too small. On clean meshes they are upper bounds, and less than 1 is no fault.
Points count where no vertex within reach is on a sharp edge or border, or faces elsewhere: edges are not judged.
"""

import argparse
import csv
import sys
from collections import Counter
from collections.abc import Callable
from contextlib import nullcontext, suppress
from pathlib import Path

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order

import bezier_filters as bf
from bezier_filters import surfaces
from bezier_filters.fitting.mesh_neighbourhoods import mesh_neighbourhoods
from bezier_filters.meshes.prepared_mesh import prepare_mesh
from bezier_filters.surfaces import SampledSurface
from strongest_peer import mean_edge

sys.path.append(str(Path(__file__).parents[1] / "tools"))
from corpus import SUFFIXES
from fit_predictions import predict
from half_edges import cut_to_manifold
from survivors import keep_survivors

LEFT_OUT_SHARE, MAX_COMPARED = 0.1, 3000
"""Share of the vertices to leave out, and largest number of vertices at which two halves are compared."""
TARGET_PREDICTIONS, MAX_ROUNDS, MIN_PREDICTIONS = 300, 10, 20
"""Predictions that are enough, rounds of leaving vertices out at most, and predictions that a result needs."""
MIN_VERTICES, MAX_VERTICES, CROPPED_VERTICES, MAX_DISTANCE, ROUNDING = 60, 60_000, 30_000, 1.5, 1e-9
"""Vertices of a mesh, at least, before it is cropped, and after; largest distance from a point to the nearest fit and
rounding error of predictions, mean edges."""
GOOD_SPREADS, BAD_SPREAD = (0.7, 1.4), 2.5
"""Spreads for which the standard errors hold, and beyond which they are useless."""
SPREADS = ["spread", "spread90", "spread_n", "spread_h"]
COLUMNS = ["file", "vertices", "predictions", "error", "expected", "remainder", *SPREADS, "rings", "degree", "noise"]
KNOWN: dict[str, Callable[[], SampledSurface]] = {
    "torus": lambda: surfaces.torus(resolution=64, jitter=0.3),
    "coarse torus": lambda: surfaces.torus(resolution=36, jitter=0.3),
    "star": lambda: surfaces.bumpy_star(resolution=32, jitter=0.3),
    "ellipsoid": lambda: surfaces.ellipsoid(resolution=32, jitter=0.3),
    "sphere": lambda: surfaces.sphere(resolution=24, jitter=0.2),
    "waves": lambda: surfaces.waves(resolution=60, jitter=0.3),
    "tube": lambda: surfaces.cylinder(resolution=48, jitter=0.3),
}


class Unfit(Exception):
    """Why a mesh cannot be judged."""


def crop(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A connected part around a random vertex."""
    sides = faces.ravel(), np.roll(faces, 1, axis=1).ravel()
    graph = coo_array((np.ones(faces.size), sides), shape=(len(vertices), len(vertices))).tocsr()
    start = faces.ravel()[np.random.default_rng(0).integers(faces.size)]
    chosen = breadth_first_order(graph, start, directed=False, return_predecessors=False)[:CROPPED_VERTICES]
    return cut_to_manifold(vertices, faces[np.isin(faces, chosen).all(axis=1)])


def at_edges(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Vertices at which neighbourhoods end, (n,) bool: on sharp edges, unless these are stairs, and on borders."""
    result = mesh_neighbourhoods(prepare_mesh(bf.triangle_mesh(vertices, faces))).mesh.barriers.copy()
    sides = np.sort(np.stack([faces.ravel(), np.roll(faces, 1, axis=1).ravel()], axis=1), axis=1)
    found, counts = np.unique(sides, axis=0, return_counts=True)
    result[found[counts == 1]] = True
    return result


def estimate(vertices: np.ndarray, faces: np.ndarray) -> tuple[bf.VertexGeometry, np.ndarray]:
    """The geometry, and the vertices (n,) away from edges that have a fit of some degree."""
    geometry = bf.estimate_vertex_geometry(vertices, faces)
    if geometry.fit.noise_sigma is None:
        raise Unfit("no noise learned, so no standard errors")
    return geometry, (geometry.status <= bf.FitStatus.ONE_RING) & ~at_edges(vertices, faces)


def noise_of(geometry: bf.VertexGeometry) -> tuple[np.ndarray, np.ndarray]:
    """Noise at every vertex, and leverage of its fit; of several regions with its rings, that of the nearest noise."""
    parts = geometry.fit.parts or (geometry.fit,)
    rings, degrees, sigmas = np.array([(part.rings, part.degree, part.noise_sigma) for part in parts]).T
    logarithms = (np.log(np.maximum(values, 1e-300)) for values in (geometry.residual[:, np.newaxis], sigmas))
    unlike = np.abs(np.subtract(*logarithms)) + 1e6 * (geometry.rings_used[:, np.newaxis] != rings)
    part = unlike.argmin(axis=1)
    points = 1 + 3 * geometry.rings_used * (geometry.rings_used + 1)
    return sigmas[part], np.minimum((degrees[part] // 2 + 1) ** 2 / points, 1.0)


def left_out(vertices: np.ndarray, faces: np.ndarray, edges: np.ndarray, seed: int) -> tuple[np.ndarray, tuple]:
    """Errors, expected errors and remainders (3, k) of a tenth of the vertices, in mean edges; rings, degree, noise."""
    survivors = np.ones(len(vertices), dtype=bool)
    chosen = np.random.default_rng(seed).permutation(len(vertices))[: max(int(LEFT_OUT_SHARE * len(vertices)), 1)]
    survivors[chosen] = False
    kept, reduced = keep_survivors(vertices, faces, survivors)
    geometry, usable = estimate(vertices[kept], reduced)
    gone = np.setdiff1d(chosen, kept)
    gone, edge = gone[~edges[gone]], mean_edge(vertices, faces)
    found = predict(vertices[gone], vertices[kept], geometry, usable, MAX_DISTANCE * edge)
    sigma, leverage = (values[found.nearest] for values in noise_of(geometry))
    expected = np.sqrt(
        sigma**2 * (1.0 + leverage)
        + (geometry.normal_std[found.nearest] * found.distances) ** 2 / 2.0
        # the normal curvature of a direction varies 1.5 times as much as H if a disc of points is fitted
        + 1.5 * (geometry.mean_curvature_std[found.nearest] * found.distances**2 / 2.0) ** 2
        + found.remainders[0] ** 2
        + (ROUNDING * edge) ** 2
    )
    fit = geometry.fit.rings, geometry.fit.degree, geometry.fit.noise_sigma / edge
    return np.stack([np.abs(found.heights), expected, found.remainders[0]]) / edge, fit


def halves(vertices: np.ndarray, faces: np.ndarray, seed: int) -> np.ndarray:
    """Differences of normals and of H between two halves over their standard errors, (2, k)."""
    random = np.random.default_rng(seed)
    survivors = np.argsort(random.permutation(len(vertices))) < len(vertices) // 2
    (kept, first), (others, second) = (keep_survivors(vertices, faces, part) for part in (survivors, ~survivors))
    (geometry, usable), (other, judged) = estimate(vertices[kept], first), estimate(vertices[others], second)
    rows = random.permutation(np.flatnonzero(judged & ~survivors[others]))[:MAX_COMPARED]
    edge = mean_edge(vertices[kept], first)
    points = vertices[others[rows]] + other.displacements[rows]
    found = predict(points, vertices[kept], geometry, usable, MAX_DISTANCE * edge)
    rows, near = rows[found.points], found.nearest
    turned = np.linalg.norm(found.normals - other.normals[rows], axis=1)
    bent = np.abs(found.mean_curvatures - other.mean_curvature[rows])
    tilt, bend = geometry.normal_std[near], geometry.mean_curvature_std[near]
    variances = np.stack([tilt**2 + 2.0 * (bend * found.distances) ** 2, bend**2]) + found.remainders[1:] ** 2
    variances += np.square([other.normal_std[rows], other.mean_curvature_std[rows]])
    return np.stack([turned, bent]) / np.sqrt(variances + np.square([[ROUNDING], [ROUNDING / edge]]))


def rounds(judge: Callable[[int], tuple[np.ndarray, tuple]]) -> tuple[np.ndarray, tuple]:
    """Results of several seeds together, and what the first says of the fit."""
    found = [judge(0)]
    while len(found) < MAX_ROUNDS and sum(values.shape[1] for values, _ in found) < TARGET_PREDICTIONS:
        found.append(judge(len(found)))
    values = np.concatenate([values for values, _ in found], axis=1)
    if values.shape[1] < MIN_PREDICTIONS:
        raise Unfit("too few vertices away from edges")
    return values, found[0][1]


def row_of(name: str, vertices: np.ndarray, faces: np.ndarray) -> dict[str, str | float]:
    """Row of the table; raises `Unfit`."""
    edges = at_edges(vertices, faces)
    values, fit = rounds(lambda seed: left_out(vertices, faces, edges, seed))
    if np.median(values[0]) < ROUNDING:
        raise Unfit("flat, or exact to rounding")
    ratios, of_halves = values[0] / values[1], (np.nan, np.nan)
    with suppress(Unfit):
        medians = np.median(rounds(lambda seed: (halves(vertices, faces, seed), ()))[0], axis=1)
        of_halves = medians / [np.sqrt(np.log(2.0)), 0.6745]
    spreads = np.median(ratios) / 0.6745, np.percentile(ratios, 90) / 1.645, *of_halves
    numbers = len(vertices), values.shape[1], *np.sqrt(np.square(values).mean(axis=1)), *spreads, *fit
    return dict(zip(COLUMNS, [name, *(float(f"{number:.4g}") for number in numbers)], strict=True))


def row_of_file(path: Path, name: str) -> dict[str, str | float]:
    try:
        meshset = bf.load_mesh(path)  # its meshes go with it
    except (bf.BezierFilterError, ValueError) as error:
        raise Unfit("unreadable") from error
    vertices, faces = meshset.current_mesh().vertex_matrix(), meshset.current_mesh().face_matrix()
    vertices, faces = cut_to_manifold(vertices, faces) if len(faces) else (vertices[:0], faces)
    if len(vertices) > MAX_VERTICES:
        vertices, faces = crop(vertices, faces)
    if len(vertices) < MIN_VERTICES:
        raise Unfit(f"fewer than {MIN_VERTICES} vertices with faces")
    try:
        return row_of(name, vertices, faces)
    except (bf.InvalidMeshError, ValueError, ArithmeticError) as error:
        raise Unfit(f"{type(error).__name__}: {error}") from error


def judge_known_surfaces() -> None:
    """Print spreads on surfaces that are known, next to those of the true errors of normals and H."""
    print("| surface | noise | " + " | ".join([*SPREADS, "true_n", "true_h"]) + " |\n|---|---|" + "---|" * 6)
    for name, make in KNOWN.items():
        for level in (0.0, 0.001, 0.05, 0.2):
            surface = make()
            noise = np.random.default_rng(1).standard_normal((len(surface.vertices), 1)) * surface.normals
            vertices = surface.vertices + level * mean_edge(surface.vertices, surface.faces) * noise
            row, geometry = row_of(name, vertices, surface.faces), bf.estimate_vertex_geometry(vertices, surface.faces)
            turned = np.linalg.norm(geometry.normals - surface.normals, axis=1) / geometry.normal_std
            bent = np.abs(geometry.mean_curvature - surface.mean_curvature) / geometry.mean_curvature_std
            true = np.median(turned) / np.sqrt(np.log(2.0)), np.median(bent) / 0.6745
            figures = " | ".join(f"{value:.2f}" for value in (*(row[column] for column in SPREADS), *true))
            print(f"| {name} | {level:g} | {figures} |", flush=True)


def summarize(rows: list[dict[str, str | float]], skipped: Counter[str]) -> None:
    print(f"{len(rows)} files; skipped: " + (", ".join(f"{k} {n}" for k, n in skipped.most_common()) or "none"))
    for column in SPREADS if rows else ():
        values = np.array([row[column] for row in rows], dtype=np.float64)
        values = values[~np.isnan(values)]
        low, high = GOOD_SPREADS
        below, good = np.mean(values < low), np.mean((values >= low) & (values <= high))
        bad = np.mean(values > BAD_SPREAD)
        print(f"{column} of {len(values)}: median {np.median(values):.2f}, {good:.1%} from {low} to {high}", end="")
        print(f", {below:.1%} below, {bad:.1%} above {BAD_SPREAD}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, nargs="?", help="without one: surfaces that are known")
    parser.add_argument("--save", type=Path, help="CSV file, written as the run goes on")
    arguments = parser.parse_args()
    if arguments.folder is None:
        judge_known_surfaces()
        return
    rows, skipped = [], Counter()
    with arguments.save.open("w", newline="") if arguments.save else nullcontext() as file:
        for path in sorted(p for p in arguments.folder.rglob("*") if p.suffix.lower() in SUFFIXES):
            name = path.relative_to(arguments.folder).as_posix()
            try:
                rows.append(row_of_file(path, name))
            except Unfit as reason:
                skipped[str(reason)] += 1
                print(f"{name}: skipped, {reason}", flush=True)
                continue
            print(" ".join(f"{column} {value}" for column, value in rows[-1].items()), flush=True)
            if file:
                csv.writer(file).writerows([COLUMNS] * (len(rows) == 1) + [list(rows[-1].values())])
                file.flush()
    summarize(rows, skipped)


if __name__ == "__main__":
    main()
