"""Meshes on disk in tiles: time, memory and truth at growing sizes, next to the same in memory.

A torus is written straight to disk by its formula, some rows at a time, and estimated file to file by two
workers of this machine with 2 GB each. Up to a size that fits, the same file is also read, estimated and written
in one process with as many threads. The model at the end says what a billion vertices would take on 64 workers: the
tasks with their measured times are handed out to workers one by one, as a scheduler does; the same simulation of
the run on this machine is set next to what that took.

With ``--smooth`` the torus has noise of a fifth of an edge, and is smoothed in place of being estimated; its distance
from the true torus tells how well.
"""

import argparse
import filecmp
import heapq
import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from bezier_filters import estimate_vertex_geometry, smooth
from bezier_filters.fields import QUALITY, qualities
from bezier_filters.fields import columns as columns_of
from bezier_filters.scale import estimate_file, smooth_file
from bezier_filters.scale.run import peak_bytes
from bezier_filters.scale.smooth import DISPLACEMENT, SHARPNESS
from bezier_filters.scale.source import open_source
from bezier_filters.scale.tiles import FACE, open_tile, ply_head, table_of

MAJOR, MINOR = 1.0, 0.4
SIZES = (1_000_000, 7_000_000, 50_000_000)
LARGEST_IN_MEMORY = 8_000_000
WORKERS, MEMORY_LIMIT = 2, 2_000_000_000
ROWS = 1 << 18
FAR, FAR_WORKERS = 1_000_000_000, 64
NOISE = 0.2
"""Times the edge, of the torus that is smoothed."""


def torus_size(n: int) -> tuple[int, int]:
    """An even number of rows around the axis, and of vertices in each: about n in all, edges of about one length."""
    minor = max(3, round(np.sqrt(n * MINOR / MAJOR)))
    return 2 * max(2, round(0.5 * n / minor)), minor


def angles(ids: np.ndarray, rows: int, minor: int) -> tuple[np.ndarray, np.ndarray]:
    """Where vertices are on the torus; every row is turned by half an edge."""
    i, j = np.divmod(ids, minor)
    return 2.0 * np.pi * i / rows, 2.0 * np.pi * (j + 0.5 * (i % 2)) / minor


def write_torus(path: Path, rows: int, minor: int, noise: float = 0.0) -> None:
    """Write a torus to a binary PLY file without ever holding it, with noise of some standard deviation."""
    n = rows * minor
    dtype = np.dtype([(axis, "<f8") for axis in "xyz"])
    with path.open("wb") as stream:
        stream.write(ply_head(dtype, n, 2 * n))
        for start in range(0, n, ROWS):
            u, v = angles(np.arange(start, min(start + ROWS, n)), rows, minor)
            table = np.empty(len(u), dtype=dtype)
            tube = MINOR + noise * np.random.default_rng(start).standard_normal(len(u)) if noise else MINOR
            table["x"], table["y"] = (MAJOR + tube * np.cos(v)) * np.cos(u), (MAJOR + tube * np.cos(v)) * np.sin(u)
            table["z"] = tube * np.sin(v)
            table.tofile(stream)
        for start in range(0, n, ROWS):
            i, j = np.divmod(np.arange(start, min(start + ROWS, n)), minor)
            right, above = (j + 1) % minor, (i + 1) % rows
            a, b, c, d = i * minor + j, above * minor + j, above * minor + right, i * minor + right
            odd = (i % 2).astype(bool)
            first = np.where(odd, [a, b, c], [a, b, d])
            second = np.where(odd, [a, c, d], [b, c, d])
            table = np.empty(2 * len(i), dtype=FACE)
            table["corners"] = 3
            table["vertex_indices"] = np.stack([first.T, second.T], axis=1).reshape(-1, 3)
            table.tofile(stream)


def errors(path: Path, rows: int, minor: int) -> dict[str, float]:
    """RMS of the error of H and K over RMS of the truth, some rows at a time."""
    found, n = open_source(path), rows * minor
    sums = np.zeros(4)
    for start in range(0, n, ROWS):
        stop = min(start + ROWS, n)
        table = found.vertex_rows.read(start, stop)
        _, v = angles(np.arange(start, stop), rows, minor)
        outer = MAJOR + MINOR * np.cos(v)
        k_max, k_min = 1.0 / MINOR, np.cos(v) / outer
        for k, (name, truth) in enumerate(
            (("bz_mean_curvature", 0.5 * (k_min + k_max)), ("bz_gaussian_curvature", k_min * k_max))
        ):
            sums[2 * k : 2 * k + 2] += np.square(table[name] - truth).sum(), np.square(truth).sum()
    return {"error_mean": float(np.sqrt(sums[0] / sums[1])), "error_gaussian": float(np.sqrt(sums[2] / sums[3]))}


def distances(path: Path) -> dict[str, float]:
    """RMS distance from the true torus, some rows at a time."""
    found, squares = open_source(path), 0.0
    for start in range(0, found.vertex_count, ROWS):
        x, y, z = found.vertices(start, min(start + ROWS, found.vertex_count)).T
        squares += np.square(np.hypot(np.hypot(x, y) - MAJOR, z) - MINOR).sum()
    return {"distance": float(np.sqrt(squares / found.vertex_count))}


def difference(path: Path, other: Path, noise: float) -> dict[str, float]:
    """How far the vertices of two files are apart, in standard deviations of the noise, some rows at a time."""
    ours, theirs, largest, squares = open_source(path), open_source(other), 0.0, 0.0
    for start in range(0, ours.vertex_count, ROWS):
        stop = min(start + ROWS, ours.vertex_count)
        apart = np.square(ours.vertices(start, stop) - theirs.vertices(start, stop)).sum(axis=1) / noise**2
        largest, squares = max(largest, float(np.sqrt(apart.max()))), squares + float(apart.sum())
    return {"largest": largest, "rms": float(np.sqrt(squares / ours.vertex_count))}


def in_memory(source: Path, target: Path, *, smoothing: bool = False) -> dict[str, object]:
    """The same file to file in this process, by the same reader and writer."""
    start = time.perf_counter()
    opened = open_source(source)
    vertices, faces = opened.vertices(0, opened.vertex_count), opened.faces(0, opened.face_count)
    read = time.perf_counter()
    if smoothing:
        result = smooth(vertices, faces, threads=WORKERS)
        vertices, moved = result.vertices, result.displacement
        columns = {QUALITY: moved, DISPLACEMENT: moved, SHARPNESS: result.sharpness}
    else:
        columns = columns_of("curvature", estimate_vertex_geometry(vertices, faces, threads=WORKERS))
        columns = {QUALITY: columns[qualities("curvature")["mean"].column]} | columns
    fitted = time.perf_counter()
    table = table_of(vertices, columns)
    rows = np.empty(len(faces), dtype=FACE)
    rows["corners"], rows["vertex_indices"] = 3, faces
    with target.open("wb") as stream:
        stream.write(ply_head(table.dtype, len(vertices), len(faces)))
        table.tofile(stream)
        rows.tofile(stream)
    end = time.perf_counter()
    seconds = {"read": read - start, "fit": fitted - read, "write": end - fitted, "all": end - start}
    return {"seconds": seconds, "peak_bytes": peak_bytes()}


def tiled(source: Path, target: Path) -> dict[str, object]:
    """In tiles, on workers of this machine."""
    start, store = time.perf_counter(), target.with_suffix(".tiles")
    report = estimate_file(source, target, workers=WORKERS, memory_limit=MEMORY_LIMIT, store=store, keep_store=True)
    report["seconds"]["all"] = time.perf_counter() - start
    del report["input"], report["output"]
    (results,) = store.glob("results-*")
    report["seconds_of_tiles"] = [open_tile(results, tile).report.seconds for tile in range(report["tiles"])]
    return report


def tiled_smoothing(source: Path, target: Path) -> dict[str, object]:
    """The smoothing in tiles, on workers of this machine."""
    start = time.perf_counter()
    report = smooth_file(source, target, workers=WORKERS, memory_limit=MEMORY_LIMIT)
    report["seconds"]["all"] = time.perf_counter() - start
    del report["input"], report["output"]
    return report


def smoothing_in_memory(source: Path, target: Path) -> dict[str, object]:
    """The smoothing in this process."""
    return in_memory(source, target, smoothing=True)


KINDS = {"tiled": tiled, "memory": in_memory, "smooth-tiled": tiled_smoothing, "smooth-memory": smoothing_in_memory}


def measured(kind: str, source: Path, target: Path) -> dict[str, object]:
    """In a process of its own, with its seconds of processor time, those of its workers among them."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [sys.executable, __file__, "--measure", kind, str(source), str(target)]
    done = subprocess.run(command, capture_output=True, text=True, env=os.environ, check=False)
    if done.returncode:
        raise SystemExit(done.stderr)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return json.loads(done.stdout.splitlines()[-1]) | {"cpu_seconds": cpu}


def makespan(seconds: Sequence[float], workers: int) -> float:
    """When the last of some tasks ends that are handed out in order, each to the first worker that is free."""
    free = [0.0] * workers
    for task in seconds:
        heapq.heappush(free, heapq.heappop(free) + task)
    return max(free)


def modelled(run: dict[str, object], n: int, workers: int) -> dict[str, float]:
    """Seconds of the stages for n vertices on some workers, after what a run has measured.

    Sorting and writing are those of one process and grow with n; learning takes the same for every mesh; tiles take
    what they took, drawn at random.
    """
    tiles, seconds = run["tiled"], run["tiled"]["seconds"]
    ratio = n / run["vertices"]
    count = -(-n // tiles["tile_vertices"])
    drawn = np.random.default_rng(0).choice(tiles["seconds_of_tiles"], count)
    drawn *= n / (drawn.sum() / sum(tiles["seconds_of_tiles"]) * run["vertices"])  # the last tile is not full
    found = {"sort": seconds["sort"] * ratio, "learn": seconds["learn"], "write": seconds["write"] * ratio}
    found["fit"] = makespan(drawn, workers)
    return found | {"all": sum(found.values())}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--vertices", type=int, nargs="+", default=list(SIZES[:2]), help="sizes")
    parser.add_argument("--folder", type=Path, help="where the files go: 600 bytes per vertex at most")
    parser.add_argument("--save", type=Path, help="file for the results")
    parser.add_argument("--smooth", action="store_true", help="smooth a torus with noise")
    parser.add_argument("--measure", nargs=3, metavar=("KIND", "SOURCE", "TARGET"), help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.measure:
        kind, source, target = options.measure
        print(json.dumps(KINDS[kind](Path(source), Path(target))))
        return
    runs: list[dict[str, object]] = []
    with tempfile.TemporaryDirectory(dir=options.folder) as name:
        for size in options.vertices:
            runs.append(one_size(Path(name), size, "smooth-" if options.smooth else ""))
            show(runs[-1])
            if options.save:
                options.save.write_text(json.dumps(runs, indent=1) + "\n", encoding="utf-8")
    if not options.smooth:
        show_model(runs)


def one_size(folder: Path, size: int, prefix: str = "") -> dict[str, object]:
    """Everything that is measured at one size."""
    start = time.perf_counter()
    rows, minor = torus_size(size)
    noise = NOISE * 2.0 * np.pi * MINOR / minor if prefix else 0.0
    write_torus(folder / "torus.ply", rows, minor, noise)
    n = rows * minor
    run: dict[str, object] = {"vertices": n, "generated": time.perf_counter() - start}
    if n <= LARGEST_IN_MEMORY:
        run["in_memory"] = measured(prefix + "memory", folder / "torus.ply", folder / "whole.ply")
    run["tiled"] = measured(prefix + "tiled", folder / "torus.ply", folder / "tiled.ply")
    run.update(distances(folder / "tiled.ply") if prefix else errors(folder / "tiled.ply", rows, minor))
    if n <= LARGEST_IN_MEMORY:
        files = folder / "tiled.ply", folder / "whole.ply"
        if prefix:
            run["difference"] = difference(*files, noise)
        else:
            run["same"] = filecmp.cmp(*files, shallow=False)
    for path in folder.iterdir():
        shutil.rmtree(path) if path.is_dir() else path.unlink()
    return run


def show(run: dict[str, object]) -> None:
    n, tiles, whole = run["vertices"], run["tiled"], run.get("in_memory")
    print(f"\n{n:,} vertices, {tiles['tiles']} tiles, {tiles['halo']:.1%} read around them")
    stages = ", ".join(f"{name} {value:.1f}" for name, value in tiles["seconds"].items())
    peak = tiles["peak_bytes"]
    print(f"  tiles      {stages} s; {tiles['cpu_seconds']:.1f} s of processor time")
    print(f"             {peak['worker'] / 1e9:.2f} GB per worker, {peak['driver'] / 1e9:.2f} GB in the driver")
    if whole:
        stages = ", ".join(f"{name} {value:.1f}" for name, value in whole["seconds"].items())
        print(f"  in memory  {stages} s; {whole['cpu_seconds']:.1f} s of processor time")
        apart = run.get("difference")
        told = f"the files are {'' if run.get('same') else 'NOT '}the same"
        if apart:
            told = f"{apart['largest']:.1e} sigma apart at the most, {apart['rms']:.1e} in the root mean square"
        print(f"             {whole['peak_bytes'] / 1e9:.2f} GB; {told}")
        times = tiles["seconds"]["all"] / whole["seconds"]["all"], tiles["cpu_seconds"] / whole["cpu_seconds"]
        print(f"  overhead   {times[0]:.2f} times the time, {times[1]:.2f} times the processor time")
    if "distance" in run:
        print(f"  distance   {run['distance']:.2e} from the truth", flush=True)
    else:
        print(f"  error      H {run['error_mean']:.1e}, K {run['error_gaussian']:.1e}", flush=True)


def show_model(runs: list[dict[str, object]]) -> None:
    for source in runs:
        for target in runs:
            found, seconds = modelled(source, target["vertices"], WORKERS), target["tiled"]["seconds"]
            stages = ", ".join(f"{name} {found[name]:.1f} ({seconds[name]:.1f})" for name in found)
            print(f"{target['vertices']:,} after {source['vertices']:,}: {stages} s, modelled (measured)")
    found = modelled(runs[-1], FAR, FAR_WORKERS)
    stages = ", ".join(f"{name} {value:.0f}" for name, value in found.items())
    print(f"{FAR:,} after {runs[-1]['vertices']:,}, on {FAR_WORKERS} workers: {stages} s, modelled")


if __name__ == "__main__":
    main()
