"""Point clouds as scanners write them: even, striped, graded, in lines, in sheets, with outliers, and true normals.

Points lie on surfaces given by a formula, whose normals are exact to 1e-8 degrees, or on the faces of a mesh.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from bezier_filters.meshlab.mesh_files import load_mesh

Chart = Callable[[np.ndarray, np.ndarray], np.ndarray]
STEP = 1e-5
"""Of the central differences, parameters of charts from 0 to 1."""
LOW_DENSITY = 0.05
"""Of the sparse stripes, and of the sparse end of a gradient, over the largest one."""
STRIPES = 8
VEIL_LENGTH = 0.1
"""Of flying pixels behind an edge, over the diagonal."""


@dataclass(frozen=True)
class Cloud:
    """Points (n, 3) with true normals (n, 3); of outliers, those of the places that they come from."""

    points: np.ndarray
    normals: np.ndarray
    is_outlier: np.ndarray

    @property
    def spacing(self) -> float:
        """Median distance of inliers to the sixth of their nearest points, about that of neighbours."""
        inliers = self.points[~self.is_outlier]
        return float(np.median(cKDTree(inliers).query(inliers, k=7)[0][:, 6]) / 1.5)

    @property
    def diagonal(self) -> float:
        """Of the box around the inliers."""
        return float(np.linalg.norm(np.ptp(self.points[~self.is_outlier], axis=0)))

    def shuffled(self, random: np.random.Generator) -> "Cloud":
        """The same in random order."""
        order = random.permutation(len(self.points))
        return Cloud(self.points[order], self.normals[order], self.is_outlier[order])


def cloud(points: np.ndarray, normals: np.ndarray) -> Cloud:
    return Cloud(points, normals, np.zeros(len(points), dtype=bool))


def _star(u: np.ndarray, v: np.ndarray, radius: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    z, angle = 2.0 * u - 1.0, 2.0 * np.pi * v
    across = np.sqrt(np.maximum(1.0 - z * z, 0.0))
    directions = np.stack([across * np.cos(angle), across * np.sin(angle), z], axis=-1)
    return radius(directions)[..., np.newaxis] * directions


def ellipsoid(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    return _star(u, v, lambda d: np.ones(d.shape[:-1])) * [1.0, 0.7, 0.5]


def bumpy(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    return _star(
        u, v, lambda d: 1.0 + 0.1 * np.sin(5.0 * d[..., 0]) * np.sin(4.0 * d[..., 1]) * np.cos(3.0 * d[..., 2])
    )


def gourd(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    return _star(u, v, lambda d: 1.0 - 0.45 / (1.0 + 9.0 * d[..., 2] ** 2) + 0.06 * np.cos(6.0 * d[..., 0]))


def torus(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    a, b = 2.0 * np.pi * u, 2.0 * np.pi * v
    return np.stack(
        [(1.0 + 0.4 * np.cos(b)) * np.cos(a), (1.0 + 0.4 * np.cos(b)) * np.sin(a), 0.4 * np.sin(b)], axis=-1
    )


def knot(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """A tube around a trefoil knot."""

    def line(t: np.ndarray) -> np.ndarray:
        return np.stack([np.sin(t) + 2.0 * np.sin(2.0 * t), np.cos(t) - 2.0 * np.cos(2.0 * t), -np.sin(3.0 * t)], -1)

    t, angle = 2.0 * np.pi * u, 2.0 * np.pi * v
    along = np.stack(
        [np.cos(t) + 4.0 * np.cos(2.0 * t), -np.sin(t) + 4.0 * np.sin(2.0 * t), -3.0 * np.cos(3.0 * t)], -1
    )
    along /= np.linalg.norm(along, axis=-1, keepdims=True)
    across = np.cross(along, [0.0, 0.0, 1.0])
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    up = np.cross(across, along)
    return line(t) + 0.5 * (np.cos(angle)[..., np.newaxis] * across + np.sin(angle)[..., np.newaxis] * up)


def ripples(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """An open sheet."""
    x, y = 2.0 * u - 1.0, 2.0 * v - 1.0
    return np.stack([x, y, 0.12 * np.sin(4.0 * x + 1.0) * np.cos(3.0 * y) + 0.1 * x * y], axis=-1)


def plane(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    return np.stack([2.0 * u - 1.0, 2.0 * v - 1.0, 0.0 * u], axis=-1)


ANALYTIC: dict[str, Chart] = {
    "ellipsoid": ellipsoid,
    "bumpy": bumpy,
    "gourd": gourd,
    "torus": torus,
    "knot": knot,
    "ripples": ripples,
}


def on_chart(chart: Chart, uv: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points, unit normals, outward if positive volumes are, and areas per area of the parameters."""
    u, v = np.clip(uv.T, STEP, 1.0 - STEP)
    along = (chart(u + STEP, v) - chart(u - STEP, v)) / (2.0 * STEP)
    across = (chart(u, v + STEP) - chart(u, v - STEP)) / (2.0 * STEP)
    normals = np.cross(along, across)
    areas = np.linalg.norm(normals, axis=1)
    points = chart(u, v)
    return points, normals / areas[:, np.newaxis], areas


def scattered(
    chart: Chart, count: int, random: np.random.Generator, density: Callable[[np.ndarray], np.ndarray] | None = None
) -> Cloud:
    """Independent points of uniform density by area, times a density in (0, 1] of the points."""
    parts: list[tuple[np.ndarray, np.ndarray]] = []
    largest = on_chart(chart, random.random((20000, 2)))[2].max() * 1.2
    while sum(len(points) for points, _ in parts) < count:
        points, normals, areas = on_chart(chart, random.random((2 * count, 2)))
        wanted = areas / largest * (1.0 if density is None else density(points))
        chosen = random.random(len(points)) < wanted
        parts.append((points[chosen], normals[chosen]))
    points, normals = (np.concatenate(arrays)[:count] for arrays in zip(*parts, strict=True))
    return cloud(points, outward(points, normals))


def outward(points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Normals with the sign for which the volume is positive, or most of a sheet looks towards +z."""
    mean = normals.mean(axis=0)
    volume = np.einsum("ij,ij->", points - points.mean(axis=0), normals)
    return normals if (mean[2] if np.linalg.norm(mean) > 0.5 else volume) > 0.0 else -normals


def sampled(path: Path, count: int, random: np.random.Generator) -> Cloud:
    """Points on the faces of a mesh, with the normals of the faces, as the public collections have them."""
    mesh = load_mesh(path).current_mesh()
    vertices, faces = mesh.vertex_matrix(), mesh.face_matrix()
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(normals, axis=1)
    rows = random.choice(len(faces), count, p=areas / areas.sum())
    a, b = np.sort(random.random((2, count)), axis=0)
    shares = np.stack([a, b - a, 1.0 - b], axis=1)
    points = np.einsum("ij,ijk->ik", shares, corners[rows])
    return cloud(points, normals[rows] / areas[rows, np.newaxis])


def stripes(points: np.ndarray) -> np.ndarray:
    x = (points[:, 0] - points[:, 0].min()) / np.ptp(points[:, 0])
    return np.where(np.floor(STRIPES * x) % 2 == 0, 1.0, LOW_DENSITY)


def gradient(points: np.ndarray) -> np.ndarray:
    x = (points[:, 0] - points[:, 0].min()) / np.ptp(points[:, 0])
    return LOW_DENSITY + (1.0 - LOW_DENSITY) * x


def noisy(given: Cloud, size: float, random: np.random.Generator) -> Cloud:
    """With normally distributed noise of a size in each coordinate."""
    return replace(given, points=given.points + size * random.normal(size=given.points.shape))


def lines(chart: Chart, count: int, ratio: float, random: np.random.Generator) -> Cloud:
    """Scan lines of constant u, along which points are `ratio` times as dense as the lines are apart."""
    u, v = np.indices((60, 60)).reshape(2, -1) / 59.0
    _, _, areas = on_chart(chart, np.stack([u, v], axis=1))
    gap = np.sqrt(areas.mean() * ratio / count)
    ends = chart(np.array([0.0, 1.0, *np.linspace(0.0, 1.0, 201)]), np.full(203, 0.37))[2:]
    length = np.linalg.norm(np.diff(ends, axis=0), axis=1).sum()
    parts = []
    for at in (np.arange(max(round(length / gap), 3)) + 0.5) / max(round(length / gap), 3):
        fine = np.linspace(0.0, 1.0, 401)
        line = chart(np.full(401, at), fine)
        run = np.append(0.0, np.linalg.norm(np.diff(line, axis=0), axis=1).cumsum())
        number = max(int(run[-1] / gap * ratio), 4)
        stations = (np.arange(number) + random.random() + 0.2 * random.uniform(-1.0, 1.0, number)) / number % 1.0
        parts.append(np.stack([np.full(number, at), np.interp(stations * run[-1], run, fine)], axis=1))
    points, normals, _ = on_chart(chart, np.concatenate(parts))
    return cloud(points, outward(points, normals))


def two_sheets(chart: Chart, count: int, gap: float, random: np.random.Generator) -> Cloud:
    """A sheet and its copy, `gap` spacings apart along z, that look away from each other."""
    upper, lower = (scattered(chart, count // 2, random) for _ in range(2))
    spacing = np.sqrt(4.0 / (count // 2))
    half = np.array([0.0, 0.0, 0.5 * gap * spacing])
    points = np.concatenate((upper.points + half, lower.points - half))
    return cloud(points, np.concatenate([upper.normals, -lower.normals]))


def thin_body(count: int, thickness: float, random: np.random.Generator) -> Cloud:
    """A round plate with a rounded rim, so many spacings thick."""
    half = 0.1
    for _ in range(3):

        def plate(u: np.ndarray, v: np.ndarray, half: float = half) -> np.ndarray:
            # a profile of a straight line, half a circle and a straight line
            length = 2.0 + np.pi * half
            s, angle = u * length, 2.0 * np.pi * v
            turn = np.clip((s - 1.0) / half, 0.0, np.pi)
            r = np.where(s < 1.0, s, np.where(s > 1.0 + np.pi * half, length - s, 1.0 + half * np.sin(turn)))
            return np.stack([r * np.cos(angle), r * np.sin(angle), half * np.cos(turn)], axis=-1)

        found = scattered(plate, count, random)
        half = 0.5 * thickness * np.sqrt(2.0 * np.pi / count)
    return found


def outliers(given: Cloud, share: float, kind: str, random: np.random.Generator) -> Cloud:
    """A share of the points moved: single ones, in clumps, behind an edge in a veil, anywhere, or all of these."""
    points, normals, count = given.points.copy(), given.normals, round(share * len(given.points))
    rows = random.permutation(len(points))[:count]
    kinds = {"single": rows[:0], "clumps": rows[:0], "veil": rows[:0], "anywhere": rows[:0]}
    if kind == "mixed":
        kinds = dict(zip(kinds, np.array_split(rows, 4), strict=True))
    else:
        kinds[kind] = rows
    off, spacing = given.is_outlier.copy(), given.spacing
    for name, some in kinds.items():
        if not len(some):
            continue
        if name == "single":  # 2 to 20 spacings off, along the normal
            sizes = random.uniform(2.0, 20.0, len(some)) * random.choice([-1.0, 1.0], len(some))
            points[some] += spacing * sizes[:, np.newaxis] * normals[some]
        elif name == "clumps":  # of ten points, 3 to 20 spacings off
            groups = np.arange(len(some)) // 10
            heads = some[10 * groups]
            heights = spacing * random.uniform(3.0, 20.0, groups[-1] + 1)[groups, np.newaxis] * normals[heads]
            points[some] = given.points[heads] + heights + spacing * 0.7 * random.normal(size=(len(some), 3))
        elif name == "veil":  # along the rays of a scanner far away on the z axis, behind the silhouette
            silhouette = np.flatnonzero(np.abs(normals[:, 2]) < 0.1)
            silhouette = (
                silhouette if len(silhouette) else np.argsort(-np.hypot(*given.points[:, :2].T))[: len(points) // 20]
            )
            heads = random.choice(silhouette, len(some))
            down = VEIL_LENGTH * given.diagonal * random.random(len(some))
            away = np.column_stack([normals[heads, :2], np.zeros(len(some))])
            away /= np.linalg.norm(away, axis=1, keepdims=True) + 1e-12
            points[some] = given.points[heads] + spacing * random.random((len(some), 1)) * away
            points[some, 2] -= down
        else:
            low, high = given.points.min(axis=0), given.points.max(axis=0)
            points[some] = low + (high - low) * random.random((len(some), 3))
        off[some] = True
    return Cloud(points, normals, off)
