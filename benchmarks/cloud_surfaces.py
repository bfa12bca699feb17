"""Clouds of surfaces with known distances: smooth and with sharp edges, closed and with borders.

Points are random, with at least half a spacing between them. The spacing is the edge of the regular triangulation with
as many points per area: sqrt(2 area / (sqrt(3) n)).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

Distance = Callable[[np.ndarray], np.ndarray]
MIN_GAP = 0.6  # of any two points, in spacings
WAVE, TALL = 0.15, 4.0  # height and wave number of the sheet
RADIUS, TUBE = 1.0, 0.4  # of the torus


@dataclass(frozen=True)
class CloudCase:
    """A cloud without noise, unit normals of its surface, the spacing, and distances of points to the true surface."""

    points: np.ndarray
    normals: np.ndarray
    spacing: float
    distance: Distance


def spread(points: np.ndarray, normals: np.ndarray, area: float, count: int, distance: Distance) -> CloudCase:
    """Some `count` of many random points, with gaps between them."""
    spacing = float(np.sqrt(2.0 * area / (np.sqrt(3.0) * count)))
    kept, taken = [], np.zeros(len(points), dtype=bool)
    near = cKDTree(points).query_ball_point(points, MIN_GAP * spacing)
    for i in range(len(points)):
        if not taken[near[i]].any():
            kept.append(i)
            taken[i] = True
        if len(kept) == count:
            break
    spacing *= float(np.sqrt(count / len(kept)))
    return CloudCase(points[kept], normals[kept], spacing, distance)


def torus(count: int, random: np.random.Generator) -> CloudCase:
    u, v, w = random.random((3, 60 * count))
    u, v = 2.0 * np.pi * u, 2.0 * np.pi * v
    keep = w * (RADIUS + TUBE) < RADIUS + TUBE * np.cos(v)
    u, v = u[keep], v[keep]
    normals = np.column_stack([np.cos(u) * np.cos(v), np.sin(u) * np.cos(v), np.sin(v)])
    points = RADIUS * np.column_stack([np.cos(u), np.sin(u), 0.0 * u]) + TUBE * normals

    def distance(p: np.ndarray) -> np.ndarray:
        return np.abs(np.hypot(np.hypot(p[:, 0], p[:, 1]) - RADIUS, p[:, 2]) - TUBE)

    return spread(points, normals, 4.0 * np.pi**2 * RADIUS * TUBE, count, distance)


def sheet(count: int, random: np.random.Generator) -> CloudCase:
    """Waves over a square with a straight border; points beyond the border have their distance from it."""

    def height(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        z = WAVE * np.sin(TALL * x) * np.cos(TALL * y)
        return z, TALL * WAVE * np.cos(TALL * x) * np.cos(TALL * y), -TALL * WAVE * np.sin(TALL * x) * np.sin(TALL * y)

    x, y = random.uniform(-1.0, 1.0, (2, 60 * count))
    z, p, q = height(x, y)
    stretch = np.sqrt(1.0 + p * p + q * q)
    keep = random.random(len(x)) * stretch.max() < stretch
    normals = np.column_stack([-p, -q, np.ones_like(p)]) / stretch[:, None]

    def distance(points: np.ndarray) -> np.ndarray:
        at = np.clip(points[:, :2], -1.0, 1.0)
        for _ in range(60):  # the nearest place over the square, by projected gradient steps
            z, p, q = height(*at.T)
            rise = points[:, 2] - z
            step = points[:, :2] - at + np.column_stack([p, q]) * rise[:, None]
            at = np.clip(at + 0.6 * step / (1.0 + p * p + q * q)[:, None], -1.0, 1.0)
        return np.linalg.norm(points - np.column_stack([at, height(*at.T)[0]]), axis=1)

    area = 4.0 * float(stretch.mean())
    return spread(np.column_stack([x, y, z])[keep], normals[keep], area, count, distance)


def half_pipe(count: int, random: np.random.Generator) -> CloudCase:
    """Half of a cylinder of radius 1 and length 3 that is open at all four sides."""
    angle, y = np.pi * random.random(60 * count), random.uniform(-1.5, 1.5, 60 * count)
    normals = np.column_stack([np.cos(angle), 0.0 * y, np.sin(angle)])

    def distance(p: np.ndarray) -> np.ndarray:
        across = np.where(
            p[:, 2] >= 0.0, np.abs(np.hypot(p[:, 0], p[:, 2]) - 1.0), np.hypot(np.abs(p[:, 0]) - 1.0, p[:, 2])
        )
        return np.hypot(across, np.maximum(np.abs(p[:, 1]) - 1.5, 0.0))

    return spread(normals + y[:, None] * [0.0, 1.0, 0.0], normals, 3.0 * np.pi, count, distance)


def prism(corners: np.ndarray, height: float, count: int, random: np.random.Generator) -> CloudCase:
    """A right prism over a convex polygon whose corners (k, 2) are counter-clockwise."""
    middle = corners.mean(axis=0)
    after = np.roll(corners, -1, axis=0)
    lengths = np.linalg.norm(after - corners, axis=1)
    triangles = np.abs(np.linalg.det(np.stack([corners - middle, after - middle], axis=1))) / 2.0
    areas = np.concatenate([lengths * height, triangles, triangles])
    of = random.choice(len(areas), 60 * count, p=areas / areas.sum())
    u, v = random.random((2, len(of)))
    k = of % len(corners)
    is_side, is_top = of < len(corners), of >= 2 * len(corners)
    turned = u + v > 1.0
    a, b = np.where(turned, 1.0 - u, u)[:, None], np.where(turned, 1.0 - v, v)[:, None]
    flat = middle + a * (corners[k] - middle) + b * (after[k] - middle)
    side = corners[k] + u[:, None] * (after[k] - corners[k])
    points = np.column_stack(
        [np.where(is_side[:, None], side, flat), np.where(is_side, height * (v - 0.5), height * (is_top - 0.5))]
    )
    outward = ((after - corners) @ np.array([[0.0, -1.0], [1.0, 0.0]])) / lengths[:, None]
    normals = np.column_stack(
        [np.where(is_side[:, None], outward[k], 0.0), np.where(is_side, 0.0, np.where(is_top, 1.0, -1.0))]
    )

    def distance(p: np.ndarray) -> np.ndarray:
        depths = np.column_stack([((p[:, :2] - c) * m).sum(axis=1) for c, m in zip(corners, outward, strict=True)])
        edges = []
        for c, d in zip(corners, after, strict=True):
            t = np.clip(((p[:, :2] - c) * (d - c)).sum(axis=1) / ((d - c) ** 2).sum(), 0.0, 1.0)
            edges.append(np.linalg.norm(p[:, :2] - c - t[:, None] * (d - c), axis=1))
        sideways, upward = np.where((depths <= 0.0).all(axis=1), -1.0, 1.0) * np.min(edges, axis=0), np.abs(p[:, 2])
        return body_distance(sideways, upward - height / 2.0)

    return spread(points, normals, float(areas.sum()), count, distance)


def body_distance(sideways: np.ndarray, upward: np.ndarray) -> np.ndarray:
    """Distance to the surface of a body that is a base times an interval, by the signed distances to both."""
    inside = (sideways <= 0.0) & (upward <= 0.0)
    return np.where(
        inside, np.minimum(-sideways, -upward), np.hypot(np.maximum(sideways, 0.0), np.maximum(upward, 0.0))
    )


def box(count: int, random: np.random.Generator) -> CloudCase:
    return prism(np.array([[-1.0, -0.7], [1.0, -0.7], [1.0, 0.7], [-1.0, 0.7]]), 1.0, count, random)


def wedge(count: int, random: np.random.Generator) -> CloudCase:
    """A prism with dihedral angles of 30, 60 and 90 degrees."""
    return prism(np.array([[0.0, 0.0], [np.sqrt(3.0), 0.0], [0.0, 1.0]]) - [0.6, 0.3], 1.5, count, random)


def can(count: int, random: np.random.Generator) -> CloudCase:
    """A cylinder of radius .6 and height 1.2 with caps."""
    angle, u, v = random.random((3, 60 * count))
    angle *= 2.0 * np.pi
    is_side = u < 2.0 / 3.0  # 2 pi r h against 2 pi r^2
    is_top = u > 5.0 / 6.0
    radius = np.where(is_side, 0.6, 0.6 * np.sqrt(v))
    points = np.column_stack(
        [radius * np.cos(angle), radius * np.sin(angle), np.where(is_side, 1.2 * (v - 0.5), 1.2 * (is_top - 0.5))]
    )
    normals = np.column_stack(
        [is_side * np.cos(angle), is_side * np.sin(angle), np.where(is_side, 0.0, np.where(is_top, 1.0, -1.0))]
    )

    def distance(p: np.ndarray) -> np.ndarray:
        return body_distance(np.hypot(p[:, 0], p[:, 1]) - 0.6, np.abs(p[:, 2]) - 0.6)

    return spread(points, normals, 2.0 * np.pi * 0.6 * 1.8, count, distance)


SURFACES: dict[str, Callable[[int, np.random.Generator], CloudCase]] = {
    "torus": torus,
    "sheet": sheet,
    "half pipe": half_pipe,
    "box": box,
    "wedge": wedge,
    "can": can,
}


def with_noise(case: CloudCase, noise: float, random: np.random.Generator, *, along: bool = True) -> np.ndarray:
    """Points with normal noise of so many spacings, along the normals or in all directions."""
    draws = (
        random.normal(size=(len(case.points), 1)) * case.normals if along else random.normal(size=(len(case.points), 3))
    )
    return case.points + noise * case.spacing * draws
