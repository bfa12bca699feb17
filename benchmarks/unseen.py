"""Where the default does worse than the best of other methods' settings, on surfaces that nothing else here uses.

    python benchmarks/unseen.py --sample 40

A cell is a surface, a triangulation and a kind of data. Errors are root mean squares: of the normal as an angle, of H
and K relative to their own size. Vertices less than three edges from a border are left out. For each of the three
quantities the peer is the method, with the setting and the sign, whose error in that cell is smallest: it is chosen by
the truth, ours is the default. On minimal surfaces, where an estimate that is too flat would win, errors of H are
relative to the principal curvatures, and the peer is the one with the best K. `held` is the share of vertices whose
95 % interval of H holds the truth, `tail` the share that one vertex in a hundred has in the squared errors of H,
`parts` are regions with a fit of their own, `noise` is the learned one in mean edges.
"""

import argparse
import csv
import itertools
import multiprocessing
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from functools import lru_cache
from pathlib import Path
from zlib import crc32

import numpy as np
import pymeshlab

import bezier_filters as bf
from accuracy import inner_vertices
from noise import VIEW, averaged
from peers import (
    Estimate,
    Method,
    angles,
    libigl_quadric,
    loaded,
    meshlab_directions,
    meshlab_discrete,
    meshlab_normals,
    ouyang_feng,
    razdan_bae,
)
from strongest_peer import RADII, corrected, mean_edge
from unseen_meshes import quiet, sample, triangulations, voxels
from unseen_surfaces import SURFACES, LevelSet, Sample

RESULTS = Path(__file__).parent / "results"
QUANTITIES = ("normal", "H", "K")
QUADRIC_RADII = (2, 3, 4, 6, 8, 12)
"""In mean edges."""
NEIGHBOURS = (8, 16, 32, 64, 128, 256)
"""Of a point, for the normal of a plane through them."""
FLAT = 0.1
"""Share of the principal curvatures below which H nearly vanishes."""
NEGLIGIBLE = (1e-3, 1e-4, 1e-4)
"""Errors of normal (degrees), H and K that count as this much in ratios."""
Displacement = Callable[[Sample, float, np.random.Generator], np.ndarray]
"""Vertices with errors, by the mesh, its mean edge and a generator."""


def along_normals(heights: np.ndarray, mesh: Sample) -> np.ndarray:
    return heights[:, np.newaxis] * mesh.normals


def white(level: float) -> Displacement:
    def displace(mesh: Sample, edge: float, random: np.random.Generator) -> np.ndarray:
        return mesh.vertices + along_normals(level * edge * random.standard_normal(len(mesh.vertices)), mesh)

    return displace


def all_directions(level: float) -> Displacement:
    def displace(mesh: Sample, edge: float, random: np.random.Generator) -> np.ndarray:
        return mesh.vertices + level * edge * random.standard_normal(mesh.vertices.shape)

    return displace


def averaged_twice(level: float) -> Displacement:
    def displace(mesh: Sample, edge: float, random: np.random.Generator) -> np.ndarray:
        heights = averaged(mesh.faces, random.standard_normal(len(mesh.vertices)), 2)
        return mesh.vertices + along_normals(level * edge * heights, mesh)

    return displace


def depth_camera(mesh: Sample, edge: float, random: np.random.Generator) -> np.ndarray:
    """Depths in steps of .2 edges, with noise of .02 edges in front that grows with their square to .09."""
    along = mesh.vertices @ VIEW
    depths = (along - along.min()) / np.ptp(along) + 1.0
    seen = along + 0.05 * edge * np.square(depths / 1.5) * random.standard_normal(len(along))
    step = 0.2 * edge
    return mesh.vertices + (np.round(seen / step) * step - along)[:, np.newaxis] * VIEW


def three_digits(mesh: Sample, edge: float, random: np.random.Generator) -> np.ndarray:
    """Three significant decimals of every coordinate."""
    return np.array([float(f"{x:.2e}") for x in mesh.vertices.ravel()]).reshape(-1, 3)


def partial(level: float) -> Displacement:
    """On 10 to 40 % of the vertices, those next to one of them."""

    def displace(mesh: Sample, edge: float, random: np.random.Generator) -> np.ndarray:
        distances = np.linalg.norm(mesh.vertices - mesh.vertices[random.integers(len(mesh.vertices))], axis=1)
        is_noisy = distances < np.quantile(distances, random.uniform(0.1, 0.4))
        return mesh.vertices + along_normals(level * edge * is_noisy * random.standard_normal(len(is_noisy)), mesh)

    return displace


def varying(mesh: Sample, edge: float, random: np.random.Generator) -> np.ndarray:
    """From .03 to .3 edges along the longest axis."""
    place = mesh.vertices[:, int(np.argmax(np.ptp(mesh.vertices, axis=0)))]
    levels = 0.03 * 10.0 ** ((place - place.min()) / np.ptp(place))
    return mesh.vertices + along_normals(edge * levels * random.standard_normal(len(place)), mesh)


def outliers(mesh: Sample, edge: float, random: np.random.Generator) -> np.ndarray:
    """One vertex in a hundred is displaced by 2 to 5 edges."""
    is_outlier = random.random(len(mesh.vertices)) < 0.01
    heights = is_outlier * random.choice([-1.0, 1.0], len(is_outlier)) * random.uniform(2.0, 5.0, len(is_outlier))
    return mesh.vertices + along_normals(edge * heights, mesh)


def both(one: Displacement, other: Displacement) -> Displacement:
    def displace(mesh: Sample, edge: float, random: np.random.Generator) -> np.ndarray:
        return one(mesh, edge, random) + other(mesh, edge, random) - mesh.vertices

    return displace


VOXELS = ("voxels", "turned voxels")
"""Boundaries of masks whose voxels lie askew in the body, along the axes of the mesh or of the body."""
KINDS: dict[str, Displacement] = {
    "clean": lambda mesh, edge, random: mesh.vertices,
    "white .05": white(0.05),
    "white .2": white(0.2),
    "all .2": all_directions(0.2),
    "averaged .1": averaged_twice(0.1),
    "depth camera": depth_camera,
    "float16": lambda mesh, edge, random: mesh.vertices.astype(np.float16).astype(np.float64),
    "3 digits": three_digits,
    "partial .3": partial(0.3),
    "varying": varying,
    "outliers": outliers,
    "white + outliers": both(white(0.05), outliers),
    "partial + all": both(partial(0.3), all_directions(0.1)),
}


def quadric(radius: float) -> Method:
    """MeshLab's quadric fit in balls, the one of libigl; the radius is in mean edges."""

    def estimate(vertices: np.ndarray, faces: np.ndarray) -> Estimate:
        meshset, fields = loaded(vertices, faces), []
        for curvature in ("Mean Curvature", "Gaussian Curvature"):
            meshset.compute_curvature_principal_directions_per_vertex(
                method="Scale Dependent Quadric Fitting",
                curvcolormethod=curvature,
                scale=pymeshlab.PureValue(radius * mean_edge(vertices, faces)),
                autoclean=False,
            )
            fields.append(meshset.current_mesh().vertex_scalar_array().copy())
        return Estimate(None, *fields)

    return estimate


def planes(count: int) -> Method:
    """MeshLab's normals of point clouds, on the side of the mean face normal."""

    def estimate(vertices: np.ndarray, faces: np.ndarray) -> Estimate:
        meshset = loaded(vertices, faces)
        meshset.compute_normal_per_vertex(weightmode="By Area")
        sides = meshset.current_mesh().vertex_normal_matrix().copy()
        meshset.compute_normal_for_point_clouds(k=count)
        normals = meshset.current_mesh().vertex_normal_matrix()
        return Estimate(np.where((normals * sides).sum(axis=1, keepdims=True) < 0.0, -normals, normals), None, None)

    return estimate


@lru_cache
def peers() -> dict[str, Method]:
    found: dict[str, Method] = {f"corrected, radius {r:g}": lambda v, f, r=r: corrected(v, f, r) for r in RADII}
    for radius in range(2, 13):
        found |= libigl_quadric(radius)
        if not any("libigl" in name for name in found):
            break
    found |= {f"MeshLab quadric, radius {r}": quadric(r) for r in QUADRIC_RADII}
    found |= {f"MeshLab planes, {k} points": planes(k) for k in NEIGHBOURS}
    weights = ("Simple Average", "By Area", "By Angle", "As defined by N. Max")
    found |= {f"MeshLab normals, {weight}": meshlab_normals(weight) for weight in weights}
    found |= {f"MeshLab {kind}": meshlab_directions(kind) for kind in ("Quadric Fitting", "Taubin approximation")}
    return found | {
        "MeshLab discrete": meshlab_discrete,
        "Razdan-Bae": razdan_bae("edges"),
        "Razdan-Bae, twists": razdan_bae("twists"),
        "OuYang-Feng": ouyang_feng,
    }


def estimate_by(name: str, vertices: np.ndarray, faces: np.ndarray) -> Estimate | None:
    """By one of the peers; None where a filter refuses the mesh."""
    try:
        with quiet():
            return peers()[name](vertices, faces)
    except pymeshlab.PyMeshLabException:
        return None


def estimates(vertices: np.ndarray, faces: np.ndarray) -> Iterator[tuple[str, Estimate]]:
    """Names and estimates of the peers; MeshLab's run in another process, which some of them end on bad triangles."""
    for name in peers():
        if not name.startswith("MeshLab"):
            yield name, peers()[name](vertices, faces)
            continue
        try:
            found = child().submit(estimate_by, name, vertices, faces).result()
        except BrokenProcessPool:
            child.cache_clear()
            print(f"{name}: the process ended")
            continue
        if found is not None:
            yield name, found


@lru_cache(maxsize=1)
def child() -> ProcessPoolExecutor:
    return ProcessPoolExecutor(1, multiprocessing.get_context("spawn"))


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.square(values).mean()))


def size_of_curvature(mesh: Sample, inner: np.ndarray) -> float:
    """Root mean square principal curvature."""
    return rms(np.sqrt(np.maximum(2.0 * mesh.mean_curvature**2 - mesh.gaussian_curvature, 0.0))[inner])


def is_flat(mesh: Sample, inner: np.ndarray) -> bool:
    """Whether H nearly vanishes."""
    return rms(mesh.mean_curvature[inner]) < FLAT * size_of_curvature(mesh, inner)


def errors(mesh: Sample, estimate: Estimate, inner: np.ndarray, *, any_sign: bool = False) -> list[float]:
    """Of normal, H and K; infinite where there is no estimate, or one that is not finite."""
    h, k = mesh.mean_curvature[inner], mesh.gaussian_curvature[inner]
    size = size_of_curvature(mesh, inner) if is_flat(mesh, inner) else rms(h)
    signs = (1.0, -1.0) if any_sign else (1.0,)
    found = [np.inf, np.inf, np.inf]
    if estimate.normals is not None:
        found[0] = rms(angles(estimate.normals, mesh.normals)[inner])
    if estimate.mean_curvature is not None:
        found[1] = min(rms(sign * estimate.mean_curvature[inner] - h) for sign in signs) / size
    if estimate.gaussian_curvature is not None:
        found[2] = rms(estimate.gaussian_curvature[inner] - k) / rms(k)
    return [error if np.isfinite(error) else np.inf for error in found]


@lru_cache(maxsize=8)
def mesh_of(surface: str, triangulation: str, seed: int) -> tuple[Sample, np.ndarray]:
    """A mesh on the surface and its inner vertices; those of voxels are off it and have the nearest geometry."""
    shape = SURFACES[surface]
    random = np.random.default_rng(crc32(f"{surface} {triangulation.split()[-1]} {seed}".encode()))
    if triangulation in VOXELS:
        vertices, faces, rotation = voxels(shape, random)
        mesh = shape.sample(shape.nearest(vertices @ rotation), faces)
        if triangulation == "voxels":
            mesh = mesh._replace(vertices=vertices, normals=mesh.normals @ rotation.T)
        else:
            mesh = mesh._replace(vertices=vertices @ rotation)
    else:
        mesh = sample(shape, triangulation, random)
    return mesh, inner_vertices(mesh)


def all_cells(kinds: list[str], surfaces: list[str], seeds: int, count: int | None) -> list[tuple[str, str, str, int]]:
    """Kinds, surfaces, triangulations and seeds; `count` of them, equally often of every kind, always the same ones."""
    found = []
    for kind in kinds:
        of_kind = [
            (kind, surface, triangulation, seed)
            for surface in surfaces
            for triangulation in ([kind] if kind in VOXELS else triangulations(SURFACES[surface]))
            for seed in range(seeds)
            if kind not in VOXELS or isinstance(SURFACES[surface], LevelSet)
        ]
        found.append([of_kind[i] for i in np.random.default_rng(crc32(kind.encode())).permutation(len(of_kind))])
    in_turn = [cell for cells in itertools.zip_longest(*found) for cell in cells if cell]
    return sorted(in_turn[:count], key=lambda cell: kinds.index(cell[0]))


def measure(kind: str, surface: str, triangulation: str, seed: int, with_peers: bool) -> dict[str, object]:
    """A row of the table."""
    mesh, inner = mesh_of(surface, triangulation, seed)
    random = np.random.default_rng(crc32(f"{kind} {surface} {triangulation} {seed}".encode()))
    edge = mean_edge(mesh.vertices, mesh.faces)
    vertices = mesh.vertices if kind in VOXELS else KINDS[kind](mesh, edge, random)
    start = time.perf_counter()
    found = bf.estimate_vertex_geometry(vertices, mesh.faces)
    seconds = time.perf_counter() - start
    own = errors(mesh, Estimate(found.normals, found.mean_curvature, found.gaussian_curvature), inner)
    off = np.abs(found.mean_curvature - mesh.mean_curvature)[inner]
    std, squares = found.mean_curvature_std[inner], np.sort(off**2)
    row = {"kind": kind, "surface": surface, "mesh": triangulation, "seed": seed, "vertices": len(vertices)}
    row |= dict(zip(QUANTITIES, own, strict=True))
    if with_peers:
        others = {
            name: errors(mesh, estimate, inner, any_sign=True) for name, estimate in estimates(vertices, mesh.faces)
        }
        for place, quantity in enumerate(QUANTITIES):
            judged = 2 if quantity == "H" and is_flat(mesh, inner) else place
            best = min(others, key=lambda name: others[name][judged])
            ratio = np.divide(*np.maximum([own[place], others[best][place]], NEGLIGIBLE[place])).item()
            row |= {f"{quantity} / peer": ratio, f"{quantity} peer": best}
    fit = found.fit
    row |= {"held": float((off <= 1.96 * std).mean()), "tail": float(squares[-len(off) // 100 :].sum() / squares.sum())}
    row |= {"rings": fit.rings, "degree": fit.degree, "parts": len(fit.parts)}
    row |= {"noise": np.nan if fit.noise_sigma is None else fit.noise_sigma / edge, "seconds": seconds}
    return row


def text(value: object) -> str:
    return value if isinstance(value, str) else f"{value:.3g}" if isinstance(value, float) else str(value)


def print_table(rows: Iterator[dict[str, object]]) -> list[dict[str, object]]:
    """The rows, printed meanwhile, without the names of the peers of normal and K."""
    kept = []
    for row in rows:
        shown = {name: value for name, value in row.items() if name not in ("normal peer", "K peer")}
        if not kept:
            print(f"| {' | '.join(shown)} |\n|{'---|' * len(shown)}")
        print(f"| {' | '.join(map(text, shown.values()))} |", flush=True)
        kept.append(row)
    return kept


def print_summary(rows: list[dict[str, object]], by: str, with_peers: bool) -> None:
    """Geometric means of the ratios, numbers of cells above 1 and 2, and the intervals."""
    heads = [f"{q}{part}" for q in QUANTITIES for part in (" / peer", " > 1", " > 2")] if with_peers else []
    heads = [by, "cells", *heads, "held, least", "median"]
    print(f"\n| {' | '.join(heads)} |\n|{'---|' * len(heads)}")
    for name in [*dict.fromkeys(row[by] for row in rows), "all"]:
        chosen = [row for row in rows if name in (row[by], "all")]
        cells = [name, str(len(chosen))]
        for quantity in QUANTITIES if with_peers else ():
            ratios = np.array([row[f"{quantity} / peer"] for row in chosen])
            cells += [
                text(float(np.exp(np.log(ratios).mean()))),
                text(int((ratios > 1).sum())),
                text(int((ratios > 2).sum())),
            ]
        held = [row["held"] for row in chosen]
        print(f"| {' | '.join([*cells, f'{min(held):.2f}', f'{np.median(held):.2f}'])} |")


def print_worst(rows: list[dict[str, object]], count: int = 15) -> None:
    """The cells where H or K or the normal is farthest behind the best peer."""
    worst = sorted(((row[f"{q} / peer"], q, row) for row in rows for q in QUANTITIES), key=lambda found: -found[0])
    heads = ("ratio", "of", "peer", "kind", "surface", "mesh", "seed")
    print(f"\n| {' | '.join(heads)} |\n|{'---|' * len(heads)}")
    for ratio, quantity, row in worst[:count]:
        print(
            f"| {ratio:.3g} | {quantity} | {row[f'{quantity} peer']} | "
            + " | ".join(str(row[n]) for n in heads[3:])
            + " |"
        )


def write_table(rows: list[dict[str, object]], path: Path) -> None:
    """Rows as a CSV file."""
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(rows[0])
        writer.writerows([f"{v:.4g}" if isinstance(v, float) else v for v in row.values()] for row in rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kinds", nargs="+", choices=[*KINDS, *VOXELS], default=[*KINDS, *VOXELS])
    parser.add_argument("--surfaces", nargs="+", choices=SURFACES, default=list(SURFACES))
    parser.add_argument("--seeds", type=int, default=1, help="how many")
    parser.add_argument("--sample", type=int, help="measure so many of the cells; all by default")
    parser.add_argument("--peers", action=argparse.BooleanOptionalAction, default=True, help="compare with others")
    parser.add_argument("--save", action="store_true", help="write benchmarks/results/unseen.csv")
    arguments = parser.parse_args()
    cells = all_cells(arguments.kinds, arguments.surfaces, arguments.seeds, arguments.sample)
    if arguments.peers:
        peers()  # says first what is not installed
    rows = print_table(measure(*cell, arguments.peers) for cell in cells)
    for by in ("kind", "mesh", "surface"):
        print_summary(rows, by, arguments.peers)
    if arguments.peers:
        print_worst(rows)
    if arguments.save:
        write_table(rows, RESULTS / "unseen.csv")


if __name__ == "__main__":
    main()
