"""Times of the filters on the fitted surface, next to peers that do the same job on facets.

    python benchmarks/surface_speed.py

Best of three warm runs on arrays, or as a filter of pymeshlab; ours with the fit and without it. The scan is the bunny
that pymeshlab ships, with every face divided into four.
"""

import time
from collections.abc import Callable

import numpy as np
import pymeshlab

import bezier_filters as bf
from bezier_filters.surfaces import torus
from peers import loaded
from speed import subdivided_bunny

QUERIES, REPEATS = 1_000_000, 3


def seconds(call: Callable[[], object], repeats: int = REPEATS) -> float:
    """Best wall time of a call."""
    times = []
    for _ in range(repeats):
        started = time.perf_counter()
        call()
        times.append(time.perf_counter() - started)
    return min(times)


def row(job: str, ours: float, peer: str, theirs: float | None) -> None:
    """Print a row of the table."""
    ratio = "" if theirs is None else f"{theirs:6.2f} s   {theirs / ours:6.2f}"
    print(f"{job:40} {ours:6.2f} s   {peer:32} {ratio}", flush=True)


def by_pymeshlab(vertices: np.ndarray, faces: np.ndarray, name: str, **options: object) -> float:
    """Best time of a filter, without the time to load the mesh."""
    times = []
    for _ in range(REPEATS):
        ms = loaded(vertices, faces)
        started = time.perf_counter()
        getattr(ms, name)(**options)
        times.append(time.perf_counter() - started)
    return min(times)


def distances(points: np.ndarray, vertices: np.ndarray, faces: np.ndarray) -> float:
    """Best time of the distances of points from the facets of a mesh."""
    times = []
    for _ in range(REPEATS):
        ms = loaded(vertices, faces)
        ms.add_mesh(pymeshlab.Mesh(points))
        started = time.perf_counter()
        ms.compute_scalar_by_distance_from_another_mesh_per_vertex(measuremesh=1, refmesh=0)
        times.append(time.perf_counter() - started)
    return min(times)


def query() -> None:
    """Nearest places of a million points on a torus of half a million vertices."""
    body = torus(minor_radius=0.35, resolution=422, jitter=0.3, seed=1)
    surface = bf.fit_surface(body.vertices, body.faces)
    rng = np.random.default_rng(3)
    near = body.vertices[rng.integers(0, len(body.vertices), QUERIES)]
    points = near + 0.004 * rng.standard_normal((QUERIES, 3))
    row(
        f"fit_surface, {len(body.vertices):,} vertices",
        seconds(lambda: bf.fit_surface(body.vertices, body.faces)),
        "",
        None,
    )
    row(
        "a million nearest places",
        seconds(lambda: surface.query(points)),
        "pymeshlab, distances from facets",
        distances(points, body.vertices, body.faces),
    )


def main() -> None:
    """Print the table."""
    query()
    vertices, faces = subdivided_bunny(0)
    edge = float(np.linalg.norm(np.diff(vertices[faces[:, :2]], axis=1), axis=2).mean())
    everything = pymeshlab.PercentageValue(0)
    row(
        f"subdivide, {len(vertices):,} vertices",
        seconds(lambda: bf.subdivide(vertices, faces)),
        "pymeshlab, LS3",
        by_pymeshlab(vertices, faces, "meshing_surface_subdivision_ls3_loop", iterations=1, threshold=everything),
    )
    length = pymeshlab.PureValue(edge)
    row(
        "remesh, as many vertices",
        seconds(lambda: bf.remesh(vertices, faces, length=edge)),
        "pymeshlab, isotropic, 10 iterations",
        by_pymeshlab(vertices, faces, "meshing_isotropic_explicit_remeshing", iterations=10, targetlen=length),
    )
    row("lines of curvature", seconds(lambda: bf.trace_lines(bf.fit_surface(vertices, faces))), "none", None)
    rng = np.random.default_rng(5)
    other = vertices + 0.1 * edge * rng.standard_normal(vertices.shape)
    row(
        "compare with a noisy copy",
        seconds(lambda: bf.compare(other, faces, vertices, faces)),
        "pymeshlab, distances from facets",
        distances(other, vertices, faces),
    )
    row(
        "measure",
        seconds(lambda: bf.measure(vertices, faces)),
        "pymeshlab, facets",
        by_pymeshlab(vertices, faces, "get_geometric_measures"),
    )


if __name__ == "__main__":
    main()
