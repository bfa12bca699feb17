"""Predict height, normal and curvature at other points from the fits at the vertices of a mesh.

The nearest fit is expanded about its vertex. What its second order lacks comes from a polynomial of high degree through
the heights, normals and curvatures of the nearest fits: it is exact to 1e-9 edges on smooth surfaces.
"""

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

import bezier_filters as bf

NEAREST_FITS, DEGREE = 12, 6
"""Nearest fits, and degree of the polynomial through them; the remainder is the change by a degree more."""
MIN_NORMAL_COSINE = 0.5
"""Cosine between the normals of the nearest fits and their mean, at least."""
JET_WEIGHTS = np.array([1.0, 1.0, 1.0, 0.5, 0.7, 0.5])


class Prediction(NamedTuple):
    """What the fits predict at k points."""

    points: np.ndarray  # (k,): which of the given points these are
    heights: np.ndarray  # (k,): of the surface over the points along `frames[:, 2]`, a length
    normals: np.ndarray  # (k, 3)
    mean_curvatures: np.ndarray  # (k,)
    remainders: np.ndarray  # (3, k): bounds of the truncation errors of heights, normals and mean curvatures
    nearest: np.ndarray  # (k,): the vertex whose fit was expanded
    distances: np.ndarray  # (k,): to it in the plane
    frames: np.ndarray  # (k, 3, 3): rows are x, y and z axis


def predict(points: np.ndarray, vertices: np.ndarray, geometry: bf.VertexGeometry, usable: np.ndarray, reach: float):
    """Predict at points (m, 3) where the nearest fits surround them, are all `usable` (n,), and face the same way.

    `reach` is the largest distance to the nearest fit.
    """
    fitted = vertices + geometry.displacements
    distances, at = cKDTree(fitted).query(points, NEAREST_FITS)
    mean = geometry.normals[at].sum(axis=1)
    mean /= np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-300)
    lean = np.einsum("mki,mi->mk", geometry.normals[at], mean).min(axis=1)
    chosen = np.flatnonzero((distances[:, 0] < reach) & usable[at].all(axis=1) & (lean > MIN_NORMAL_COSINE))
    at, mean, unit = at[chosen], mean[chosen], np.maximum(distances[chosen].mean(axis=1), 1e-300)
    across = np.cross(mean, np.eye(3)[np.abs(mean).argmin(axis=1)])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    frames = np.stack([across, np.cross(mean, across), mean], axis=1)
    # the fits as graphs over the plane of their mean normal through the point, in units of their mean distance
    offsets = (fitted[at] - points[chosen, np.newaxis]) / unit[:, np.newaxis, np.newaxis]
    x, y, z = np.moveaxis(np.einsum("mij,mkj->mki", frames, offsets), 2, 0)
    normals = np.einsum("mij,mkj->mki", frames, geometry.normals[at])
    slopes = -normals[..., :2] / normals[..., 2:]
    tangents = frames[:, np.newaxis, :2] + slopes[..., np.newaxis] * mean[:, np.newaxis, np.newaxis]
    ends = (geometry.k_min, geometry.direction_min), (geometry.k_max, geometry.direction_max)
    along = [(k[at] * unit[:, np.newaxis], np.einsum("mkai,mki->amk", tangents, d[at])) for k, d in ends]
    bends = [-sum(k * d[i] * d[j] for k, d in along) / normals[..., 2] for i, j in ((0, 0), (0, 1), (1, 1))]
    jets = np.stack([z, slopes[..., 0], slopes[..., 1], *bends], axis=-1)
    (jet, is_determined), (other, _) = (_jets_at_origin(x, y, jets, degree) for degree in (DEGREE, DEGREE + 1))
    distances = np.hypot(x, y)[:, 0] * unit
    chosen, jet, other, unit, frames = (
        chosen[is_determined],
        jet[is_determined],
        other[is_determined],
        unit[is_determined],
        frames[is_determined],
    )
    (normals, curvatures), (normals7, curvatures7) = (_normals_and_curvatures(one) for one in (jet, other))
    turned = np.linalg.norm(normals - normals7, axis=1)
    remainders = np.stack([np.abs(jet[:, 0] - other[:, 0]) * unit, turned, np.abs(curvatures - curvatures7) / unit])
    normals = np.einsum("mij,mi->mj", frames, normals)
    values = jet[:, 0] * unit, normals, curvatures / unit, remainders
    return Prediction(chosen, *values, at[is_determined, 0], distances[is_determined], frames)


def _monomials(x: np.ndarray, y: np.ndarray, degree: int) -> np.ndarray:
    """Monomials, their slopes and their second derivatives xx, xy, yy at points (m, k): (m, k, 6, terms)."""
    a, b = np.array([(total - j, j) for total in range(degree + 1) for j in range(total + 1)]).T

    def derivative(i: int, j: int) -> np.ndarray:
        factor = np.prod([a - s for s in range(i)], axis=0) * np.prod([b - s for s in range(j)], axis=0)
        powers = x[..., np.newaxis] ** np.maximum(a - i, 0) * y[..., np.newaxis] ** np.maximum(b - j, 0)
        return np.asarray(factor * powers)

    return np.stack([derivative(*order) for order in ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))], axis=-2)


def _jets_at_origin(x: np.ndarray, y: np.ndarray, jets: np.ndarray, degree: int) -> tuple[np.ndarray, np.ndarray]:
    """Height, slopes and second derivatives at the origin (m, 6), and where the fits determine the height there.

    `jets` (m, k, 6) are those of the fits at x and y (m, k). The polynomial goes through them by least squares; to its
    own derivatives come those of the expansion of what the first fit differs from it.
    """
    terms = _monomials(x, y, degree)
    weights = JET_WEIGHTS / (1.0 + np.hypot(x, y)[..., np.newaxis] ** 4)
    rows = x.shape[0], x.shape[1] * len(JET_WEIGHTS)
    q, r = np.linalg.qr((terms * weights[..., np.newaxis]).reshape(*rows, terms.shape[-1]))
    diagonal = np.abs(np.diagonal(r, axis1=1, axis2=2))
    is_determined = diagonal.min(axis=1) > 1e-9 * diagonal.max(axis=1)
    r[~is_determined] = np.eye(r.shape[1])
    inverse = np.linalg.inv(r)
    found = np.einsum("mij,mj->mi", inverse, np.einsum("mij,mi->mj", q, (jets * weights).reshape(rows)))
    is_determined &= np.linalg.norm(inverse[:, 0], axis=1) < 1.0  # beyond that the height is extrapolated
    z, p, s, xx, xy, yy = (jets[:, 0] - np.einsum("mij,mj->mi", terms[:, 0], found)).T
    u, v = x[:, 0], y[:, 0]
    at_vertex = z - p * u - s * v + (xx * u * u + 2.0 * xy * u * v + yy * v * v) / 2.0
    differences = np.stack([at_vertex, p - xx * u - xy * v, s - xy * u - yy * v, xx, xy, yy], axis=1)
    return found[:, :6] * [1.0, 1.0, 1.0, 2.0, 1.0, 2.0] + differences, is_determined


def _normals_and_curvatures(jets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Normals (m, 3) and mean curvatures (m,) of graphs."""
    _, p, q, r, s, t = jets.T
    w2 = 1.0 + p * p + q * q
    normals = np.stack([-p, -q, np.ones_like(p)], axis=1) / np.sqrt(w2)[:, np.newaxis]
    return normals, -((1.0 + q * q) * r - 2.0 * p * q * s + (1.0 + p * p) * t) / (2.0 * w2**1.5)
