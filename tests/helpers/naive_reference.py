"""What happens at a vertex of a mesh, computed once more: slowly, plainly, and without the package's code.

For fits with rings=2, alpha=0.8 and third-order smoothness: whether there is a normal, whether the 2-ring folds,
whether its points determine the patch, and what its normal and mean curvature are then.
"""

from dataclasses import dataclass
from math import comb, cos, radians

import numpy as np
from high_precision import EXPONENTS

ALPHA, RINGS = 0.8, 2
FOLD_COSINE = cos(radians(89.0))
FEWEST = 6  # coefficients that smoothness leaves open
MIN_PIVOT = 1e-6
CERTAIN = 1e-6
"""Relative distance to a threshold below which rounding may decide."""
MIN_NEIGHBOURHOOD_WIDTH = 1e-60
"""Of a neighbourhood, a length: whatever is smaller is not fitted."""
FLAT = 1e-14
"""Width of a neighbourhood, as a part of its size, below which it is rounding that says where its points are."""

ROUNDED = 1e-6
"""Of the longest edge of a face: a smaller height may be rounding."""


@dataclass(frozen=True)
class ExpectedFit:
    """None stands for what rounding decides.

    Attributes
    ----------
    isolated, fits : bool or None
        Whether the vertex has no normal; whether the first attempt succeeds.
    normal : (3,) float64 or None
    curvature, tolerance : float or None
        Mean curvature, and how far rounding may take it.
    """

    isolated: bool | None
    fits: bool | None = None
    normal: np.ndarray | None = None
    curvature: float | None = None
    tolerance: float | None = None


def expected_fit(vertices, faces, vertex):
    """What has to be found at one vertex."""
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    normals = np.divide(normals, lengths[:, None], out=np.zeros_like(normals), where=lengths[:, None] > 0)
    proper = faces[(faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])]
    total, has_area = normal_of_faces(faces, normals, vertex)
    if not has_area:
        around = set(proper[(proper == vertex).any(axis=1)].ravel().tolist()) - {vertex}
        of_neighbours = [normal_of_faces(faces, normals, v)[0] for v in sorted(around)]
        sizes = [np.linalg.norm(one) for one in of_neighbours]
        if any(1e-10 < size < 1e-8 for size in sizes):
            return ExpectedFit(None)
        total = sum((one / size for one, size in zip(of_neighbours, sizes, strict=True) if size > 1e-9), np.zeros(3))
    length = np.linalg.norm(total)
    if length < 1e-8:
        return ExpectedFit(True if length < 1e-10 else None)
    z_axis = total / length
    rings = [{vertex}]
    for _ in range(RINGS):
        rings.append(rings[-1] | set(proper[np.isin(proper, list(rings[-1])).any(axis=1)].ravel().tolist()))
    if len(rings[RINGS]) < FEWEST:
        return ExpectedFit(False, False)
    inner = normals[np.isin(faces, list(rings[RINGS - 1])).any(axis=1)]
    cosines = (inner @ z_axis)[inner.any(axis=1)]
    if (cosines <= FOLD_COSINE - CERTAIN).any():
        return ExpectedFit(False, False)
    if (cosines <= FOLD_COSINE + CERTAIN).any():
        return ExpectedFit(False)
    return fitted(vertices, vertex, rings, z_axis, largest_curvature(vertices, proper, vertex))


def normal_of_faces(faces, normals, vertex):
    """Sum of the normals of the faces at a vertex, and whether one of these has an area."""
    here = normals[(faces == vertex).any(axis=1)]
    return here.sum(axis=0), bool(here.any())


def fitted(vertices, vertex, rings, z_axis, bound):
    edges = vertices[sorted(rings[RINGS])] - vertices[vertex]
    near = vertices[sorted(rings[1] - {vertex})] - vertices[vertex]
    near = near - np.outer(near @ z_axis, z_axis)
    reach = np.linalg.norm(near, axis=1)
    order = np.argsort(reach)
    if reach[order[-1]] == 0.0 or (len(order) > 1 and reach[order[-2]] > (1 - 1e-5) * reach[order[-1]]):
        return ExpectedFit(False)  # which neighbour the x axis points to is decided by finer rules
    x_axis = near[order[-1]] / reach[order[-1]]
    y_axis = np.cross(z_axis, x_axis)
    x, y, z = edges @ x_axis, edges @ y_axis, edges @ z_axis
    width = np.linalg.svd(np.column_stack([x, y]), compute_uv=False)[1] / np.sqrt(len(x))
    if width < FLAT * np.linalg.norm(edges, axis=1).max() or np.ptp(y) < 2.0 * MIN_NEIGHBOURHOOD_WIDTH:
        return ExpectedFit(False)
    radius = np.hypot(x, y).max()
    rows = np.array([(x / radius) ** a * (y / radius) ** b for a, b in EXPONENTS]).T
    weight = ((1.0 - ALPHA) / ALPHA) ** 2
    penalty = [weight / comb(a + b, a) if a + b >= 3 else 0.0 for a, b in EXPONENTS]
    matrix = rows.T @ rows + np.diag(penalty)
    share = smallest_pivot(matrix)
    if share < MIN_PIVOT * 1.01:
        return ExpectedFit(False, False if share < MIN_PIVOT * 0.99 else None)
    stacked = np.vstack([rows, np.diag(np.sqrt(penalty))])
    scale = np.linalg.norm(stacked, axis=0)
    solution = np.linalg.lstsq(stacked / scale, np.concatenate([z, np.zeros(len(scale))]), rcond=None)[0] / scale
    c = dict(zip(EXPONENTS, solution, strict=True))
    p, q = c[1, 0] / radius, c[0, 1] / radius
    r, s, t = 2 * c[2, 0] / radius**2, c[1, 1] / radius**2, 2 * c[0, 2] / radius**2
    w = np.sqrt(1 + p * p + q * q)
    curvature = -((1 + q * q) * r - 2 * p * q * s + (1 + p * p) * t) / (2 * w**3)
    condition = np.linalg.cond(stacked / scale)
    tolerance = 1e-9 * condition**2 * np.linalg.norm(edges, axis=1).max() / width**2
    largest = abs(curvature) + np.sqrt(max(curvature**2 - (r * t - s * s) / w**4, 0.0))
    if largest > bound * (1.0 - CERTAIN) - tolerance:
        return ExpectedFit(False, False if largest > bound * (1.0 + CERTAIN) + tolerance else None)
    return ExpectedFit(False, True, (z_axis - p * x_axis - q * y_axis) / w, curvature, tolerance)


def largest_curvature(vertices, faces, vertex):
    """The largest one that the faces at a vertex hold, since the surface turns by pi at most from one to the next."""
    corners = vertices[faces[(faces == vertex).any(axis=1)]]
    edges = np.roll(corners, -1, axis=1) - corners
    longest = np.linalg.norm(edges, axis=2).max(axis=1)
    heights = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)[longest > 0.0] / longest[longest > 0.0]
    heights = heights[heights > ROUNDED * longest[longest > 0.0]]
    return np.pi / heights.min() if len(heights) else np.inf


def smallest_pivot(matrix):
    """Least share of its diagonal entry that elimination leaves of a pivot."""
    rest, share = matrix.copy(), np.inf
    for k in range(len(matrix)):
        if matrix[k, k] <= 0.0:  # a term that is 0 at all points
            return 0.0
        share = min(share, rest[k, k] / matrix[k, k])
        if rest[k, k] <= 0.0:
            return share
        rest[k + 1 :, k + 1 :] -= np.outer(rest[k + 1 :, k], rest[k, k + 1 :]) / rest[k, k]
    return share
