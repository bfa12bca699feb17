"""Normals of point clouds as scanners write them, beside planes (PCA) and jets at their best size in hindsight.

`python benchmarks/scanned_clouds.py GROUP...` prints a table of groups of cases: protocol (after PCPNet: noise and
density), sampled (the same of meshes), lines, sheets, thin, outliers, clean. Printed are the root mean square angle to
the true normal without regard to its sign, over points that are no outliers, the share of such points within 5 and 10
degrees, the same angle of the best peer, their ratio, and the share of normals on the wrong side.
"""

import argparse
import csv
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

import bezier_filters as bf
import cloud_cases as cases
from cloud_cases import Cloud

SIZES = (8, 12, 18, 30, 50, 75, 112, 200, 300, 450, 700, 1000)
"""Of the neighbourhoods of peers, in points."""
JET_DEGREES = (2, 3)
JUDGED = 2000
"""Points of each cloud at which normals are compared; PCPNet's protocol has 5,000."""
CHUNK = 200_000
"""Points of neighbourhoods at a time."""
NOISES = (0.0, 0.00125, 0.006, 0.012)
"""Over the diagonal, as in PCPNet's protocol."""
COLUMNS = ("group", "case", "rmse", "within_5", "within_10", "best", "peer", "ratio", "flipped", "seconds")
MESHES = Path(__file__).parents[2] / "shared" / "meshes"


def planes(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Principal axes, shortest first, as columns (m, 3, 3), of neighbourhoods (m, k, 3), and their means."""
    means = points.mean(axis=1, keepdims=True)
    away = points - means
    return np.linalg.eigh(np.einsum("mki,mkj->mij", away, away))[1], means


def jets(points: np.ndarray, axes: np.ndarray, degree: int) -> np.ndarray:
    """Normals (m, 3) of polynomials over the planes through the first point of each neighbourhood (m, k, 3)."""
    local = (points - points[:, :1]) @ axes
    scale = np.abs(local[..., 1:]).max(axis=(1, 2))[:, np.newaxis]
    z, x, y = np.moveaxis(local, 2, 0) / np.maximum(scale, 1e-300)
    design = np.stack([x**a * y**b for a in range(degree + 1) for b in range(degree + 1 - a)], axis=2)
    order = [(a, b) for a in range(degree + 1) for b in range(degree + 1 - a)]
    normal_matrices = design.transpose(0, 2, 1) @ design + 1e-10 * np.eye(design.shape[2])
    found = np.linalg.solve(normal_matrices, design.transpose(0, 2, 1) @ z[..., np.newaxis])[..., 0]
    slopes = np.stack([np.ones(len(z)), -found[:, order.index((1, 0))], -found[:, order.index((0, 1))]], axis=1)
    slopes /= np.linalg.norm(slopes, axis=1, keepdims=True)
    return np.einsum("mij,mj->mi", axes, slopes)


def peers(points: np.ndarray, rows: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    """Normals at some rows by planes and jets of all sizes."""
    tree = cKDTree(points)
    for size in SIZES:
        if size > len(points):
            return
        found: dict[str, list[np.ndarray]] = {}
        for some in np.array_split(rows, max(1, len(rows) * size // CHUNK)):
            near = points[tree.query(points[some], k=size, workers=2)[1]]
            axes, _ = planes(near)
            found.setdefault(f"PCA {size}", []).append(axes[:, :, 0])
            for degree in JET_DEGREES:
                if size > (degree + 1) * (degree + 2):
                    found.setdefault(f"jets {degree}, {size}", []).append(jets(near, axes, degree))
        yield from ((name, np.concatenate(parts)) for name, parts in found.items())


def angles(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Between lines, in degrees, exact for small ones."""
    sines, cosines = np.linalg.norm(np.cross(a, b), axis=1), np.abs(np.einsum("ij,ij->i", a, b))
    return np.degrees(np.where((sines == 0.0) & (cosines == 0.0), 0.5 * np.pi, np.arctan2(sines, cosines)))


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.square(values).mean()))


def judge(group: str, name: str, cloud: Cloud, *, given: np.ndarray | None = None, with_peers: bool = True) -> dict:
    inliers = np.flatnonzero(~cloud.is_outlier)
    rows = np.sort(np.random.default_rng(5).permutation(inliers)[:JUDGED])
    start = time.perf_counter()
    geometry = bf.estimate_vertex_geometry(cloud.points, None, normals=given)
    seconds = time.perf_counter() - start
    ours, truth = geometry.normals[rows], cloud.normals[rows]
    off = angles(ours, truth)
    best, peer = np.inf, ""
    if with_peers:
        best, peer = min((rms(angles(found, truth)), name) for name, found in peers(cloud.points, rows))
    has_normal = ours.any(axis=1)
    flipped = float((np.einsum("ij,ij->i", ours, truth)[has_normal] < 0.0).mean())
    row = [group, name, rms(off), (off < 5.0).mean(), (off < 10.0).mean(), best, peer, rms(off) / best]
    return dict(zip(COLUMNS, [*row, flipped, seconds], strict=True))


def protocol(count: int, seed: int) -> Iterator[dict]:
    for name, chart in cases.ANALYTIC.items():
        for size in NOISES:
            random = np.random.default_rng(seed)
            clean = cases.scattered(chart, count, random)
            yield judge("protocol", f"{name}, noise {size}", cases.noisy(clean, size * clean.diagonal, random))
        for word, density in (("striped", cases.stripes), ("gradient", cases.gradient)):
            random = np.random.default_rng(seed)
            yield judge("protocol", f"{name}, {word}", cases.scattered(chart, count, random, density))


def sampled(count: int, seed: int) -> Iterator[dict]:
    for path in sorted(MESHES.glob("*.obj")):
        if "noise" in path.name and "clean" not in path.name:
            continue
        dense = cases.sampled(path, 6 * count, np.random.default_rng(seed))
        for size in NOISES:
            random = np.random.default_rng(seed)
            even = cases.cloud(dense.points[:count], dense.normals[:count])
            yield judge("sampled", f"{path.stem}, noise {size}", cases.noisy(even, size * even.diagonal, random))
        for word, density in (("striped", cases.stripes), ("gradient", cases.gradient)):
            chosen = np.flatnonzero(np.random.default_rng(seed).random(6 * count) < density(dense.points))[:count]
            yield judge("sampled", f"{path.stem}, {word}", cases.cloud(dense.points[chosen], dense.normals[chosen]))


def lines(count: int, seed: int) -> Iterator[dict]:
    for name, chart in cases.ANALYTIC.items():
        for ratio in (5, 10, 20, 30):
            for size in (0.0, 0.1):
                random = np.random.default_rng(seed)
                clean = cases.lines(chart, count, ratio, random)
                gap = np.sqrt(ratio) * np.sqrt(clean.diagonal**2 / count)
                noisy = cases.noisy(clean, size * gap / np.sqrt(ratio), random).shuffled(random)
                yield judge("lines", f"{name}, ratio {ratio}, noise {size}", noisy)


def sheets(count: int, seed: int) -> Iterator[dict]:
    for name, chart in (("plane", cases.plane), ("ripples", cases.ripples)):
        for gap in (4.0, 2.0, 1.0):
            random = np.random.default_rng(seed)
            cloud = cases.two_sheets(chart, count, gap, random).shuffled(random)
            yield judge("sheets", f"{name}, gap {gap}, normals given", cloud, given=cloud.normals)
            yield judge("sheets", f"{name}, gap {gap}", cloud)


def thin(count: int, seed: int) -> Iterator[dict]:
    for thickness in (8.0, 4.0, 3.0, 2.0):
        for size in (0.0, 0.1):
            random = np.random.default_rng(seed)
            plate = cases.thin_body(count, thickness, random)
            yield judge(
                "thin", f"plate, {thickness} spacings, noise {size}", cases.noisy(plate, size * plate.spacing, random)
            )


def outliers(count: int, seed: int) -> Iterator[dict]:
    for name, chart in cases.ANALYTIC.items():
        for share in (0.005, 0.01, 0.05, 0.1):
            for kind in ("single", "clumps", "veil", "anywhere", "mixed"):
                random = np.random.default_rng(seed)
                clean = cases.scattered(chart, count, random)
                noisy = cases.noisy(clean, 0.1 * clean.spacing, random)
                yield judge("outliers", f"{name}, {share} {kind}", cases.outliers(noisy, share, kind, random))


def clean(count: int, seed: int) -> Iterator[dict]:
    for name, chart in cases.ANALYTIC.items():
        for size in (0.0, 0.05, 0.2, 0.5, 1.0):
            random = np.random.default_rng(seed)
            exact = cases.scattered(chart, count, random)
            yield judge("clean", f"{name}, {size} spacings", cases.noisy(exact, size * exact.spacing, random))


GROUPS = {
    "clean": (clean, 12_000),
    "lines": (lines, 12_000),
    "sheets": (sheets, 8_000),
    "thin": (thin, 8_000),
    "outliers": (outliers, 12_000),
    "protocol": (protocol, 100_000),
    "sampled": (sampled, 100_000),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("groups", nargs="*", default=list(GROUPS), choices=list(GROUPS))
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", help="cases whose name has this text")
    parser.add_argument("--count", type=int)
    arguments = parser.parse_args()
    writer = csv.DictWriter(sys.stdout, COLUMNS)
    writer.writeheader()
    for group in arguments.groups:
        make, count = GROUPS[group]
        for row in make(arguments.count or count, arguments.seed):
            writer.writerow({k: f"{v:.4g}" if isinstance(v, float) else v for k, v in row.items()})
            sys.stdout.flush()


if __name__ == "__main__":
    main()
