"""The paper's method with its fallbacks, vertex by vertex: dense least squares, no code of the package.

Neighbourhoods, planes and the order of the fallbacks are as `estimate_vertex_geometry` documents for
``fallbacks="paper"``; S is whatever rows are given.
"""

from typing import NamedTuple

import numpy as np
from numpy.polynomial.polynomial import polyvander2d
from reference import design, fit_in_frame, one_ring

FOLD = np.cos(np.radians(89.0))
ROUNDING = 1e-9  # of cosines and lengths: nearer to a limit than this, either side of it may be taken
WELL_POSED, SINGULAR = 1e3, 1e9  # condition numbers up to and from which that is beyond doubt
"""No pivot of a system with columns of unit length is below one by the square of its condition number, so up to the
first of these none is below the 1e-6 at which fits are refused."""
GRID = np.repeat(np.linspace(0.0, 1.0, 4), 4), np.tile(np.linspace(0.0, 1.0, 4), 4)
FROM_MONOMIALS = np.linalg.solve(design(*GRID), polyvander2d(2.0 * GRID[0] - 1.0, 2.0 * GRID[1] - 1.0, [3, 3]))
"""Heights of the control points from coefficients of monomials on [-1, 1]^2, by which fits are solved."""
ILL_POSED, FOLDED = "ill posed", "folded"


class Doubt(Exception):
    """Rounding decides."""


class Fit(NamedTuple):
    """What a fit gives; the mean curvature has MeshLab's sign."""

    status: str
    normal: np.ndarray
    mean: float
    gaussian: float


class PaperFits:
    """A mesh, rows S, alpha, rings, x axes: (3,), or None for the farthest neighbour, and what counts as a fold."""

    def __init__(self, vertices, faces, rows, alpha, rings, x_axis=None, fold_test="angle"):
        self.fold_test = fold_test
        self.vertices, self.faces, self.rows, self.alpha, self.rings = vertices, faces, rows, alpha, rings
        self.x_axis = x_axis
        a, b, c = vertices[faces].transpose(1, 0, 2)
        normals = np.cross(b - a, c - a)
        self.face_normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
        sums = np.array([self.face_normals[(faces == i).any(axis=1)].sum(axis=0) for i in range(len(vertices))])
        self.normals = sums / np.linalg.norm(sums, axis=1, keepdims=True)
        self.around = [one_ring(faces, i) for i in range(len(vertices))]

    def members(self, vertex, rings):
        """The vertex and all within so many edges."""
        found = {vertex}
        for _ in range(rings):
            found = found.union(*(self.around[i] for i in found))
        return [vertex, *sorted(found - {vertex})]

    def folds(self, vertex, rings, normal):
        """Whether a neighbourhood is folded over a plane, by the test that was chosen."""
        return (self.leans if self.fold_test == "angle" else self.crosses)(vertex, rings, normal)

    def crosses(self, vertex, rings, normal):
        """Whether two edges between vertices of the neighbourhood, without a common end, meet in the plane."""
        members = self.members(vertex, rings)
        edges = np.array([(i, j) for i in members for j in self.around[i] if i < j and j in members])
        flat = (self.vertices - self.vertices[vertex]) @ np.linalg.svd(normal[np.newaxis])[2][1:].T
        first, second = np.triu_indices(len(edges), 1)
        apart = (edges[first][:, :, np.newaxis] != edges[second][:, np.newaxis, :]).all(axis=(1, 2))
        a, b = flat[edges[first[apart]]].transpose(1, 0, 2)
        c, d = flat[edges[second[apart]]].transpose(1, 0, 2)
        # a + s (b - a) = c + t (d - c)
        size = np.linalg.det(np.stack([b - a, c - d], axis=2))
        lengths = np.linalg.norm(b - a, axis=1) * np.linalg.norm(d - c, axis=1)
        if (np.abs(size) < ROUNDING * lengths).any():
            raise Doubt  # parallel
        places = np.linalg.solve(np.stack([b - a, c - d], axis=2), (c - a)[:, :, np.newaxis])[:, :, 0]
        beyond = np.maximum(-places, places - 1.0).max(axis=1, initial=-np.inf)
        if (np.abs(beyond) < ROUNDING).any():
            raise Doubt
        return bool((beyond < 0.0).any())

    def leans(self, vertex, rings, normal):
        """Whether a face at the neighbourhood, without its last ring, leans 89 degrees or more."""
        touching = np.isin(self.faces, self.members(vertex, rings - 1)).any(axis=1)
        least = (self.face_normals[touching] @ normal).min()
        if abs(least - FOLD) < ROUNDING:
            raise Doubt
        return least < FOLD

    def frame(self, vertex, normal):
        """Rows x, y and z."""
        edges = self.vertices[sorted(self.around[vertex])] - self.vertices[vertex]
        x = edges if self.x_axis is None else self.x_axis[np.newaxis]
        x = x - np.outer(x @ normal, normal)
        lengths = np.sort(np.linalg.norm(x, axis=1))
        if len(lengths) > 1 and lengths[-2] > (1.0 - 1e-5) * lengths[-1]:
            raise Doubt
        x = x[np.argmax(np.linalg.norm(x, axis=1))] / lengths[-1]
        return np.array([x, np.cross(normal, x), normal])

    def other_normal(self, vertex):
        """That of the neighbour, the closest one, over whose plane nothing folds, or None."""
        cosines = {j: self.normals[j] @ self.normals[vertex] for j in self.around[vertex]}
        for j in sorted(cosines, key=lambda j: -cosines[j]):
            if not self.folds(vertex, self.rings, self.normals[j]):
                return self.normals[j]
        return None

    def patch(self, vertex, rings, normal):
        """The bicubic patch, or ILL_POSED."""
        edges = self.vertices[self.members(vertex, rings)] - self.vertices[vertex]
        if len(edges) + np.linalg.matrix_rank(self.rows) * (self.alpha < 1.0) < 16:
            return ILL_POSED
        frame = self.frame(vertex, normal)
        flat = (edges @ frame.T)[:, :2]
        u, v = ((flat - flat.min(axis=0)) / np.ptp(flat, axis=0)).T
        if not well_posed(np.vstack([self.alpha * design(u, v), (1.0 - self.alpha) * self.rows]) @ FROM_MONOMIALS):
            return ILL_POSED
        return fit_in_frame(edges, frame, self.alpha, 3, self.rows)

    def quadratic(self, vertex, rings, normal):
        """Terms s^a t^b, a and b up to 2, with alpha = 0.1 against those of degree 3 and 4; or ILL_POSED."""
        edges = self.vertices[self.members(vertex, rings)] - self.vertices[vertex]
        if len(edges) < 6:
            return ILL_POSED
        frame = self.frame(vertex, normal)
        x, y, z = (edges @ frame.T).T
        radius = np.sqrt((x * x + y * y).max())
        exponents = [(a, b) for a in range(3) for b in range(3)]
        terms = np.stack([(x / radius) ** a * (y / radius) ** b for a, b in exponents], axis=1)
        weights = {(2, 1): 3.0**-0.5, (1, 2): 3.0**-0.5, (2, 2): 6.0**-0.5}
        high = np.array([[weights.get(pair, 0.0) * (pair == row) for pair in exponents] for row in weights])
        system = np.vstack([0.1 * terms, 0.9 * high])
        if not well_posed(system):
            return ILL_POSED
        solution = dict(zip(exponents, np.linalg.lstsq(system, np.append(0.1 * z, np.zeros(3)))[0], strict=True))
        p, q = solution[1, 0] / radius, solution[0, 1] / radius
        r, s, t = (c / radius**2 for c in (2 * solution[2, 0], solution[1, 1], 2 * solution[0, 2]))
        w = np.sqrt(1 + p * p + q * q)
        mean = -((1 + q * q) * r - 2 * p * q * s + (1 + p * p) * t) / (2 * w**3)
        return np.array([-p, -q, 1.0]) / w @ frame, mean, (r * t - s * s) / w**4

    def fit(self, vertex):
        """The first fallback that gives something, in the documented order; None if rounding decides."""
        try:
            return self._fit(vertex)
        except Doubt:
            return None

    def _fit(self, vertex):
        k, own, both = self.rings, self.normals[vertex], (ILL_POSED, FOLDED)
        chain = [
            ("OK", both, k, own, self.patch),
            *(("WIDER_RING", (ILL_POSED,), k + more, own, self.patch) for more in (1, 2, 3)),
            ("OTHER_PLANE", (FOLDED,), k, None, self.patch),
            ("ONE_RING", (FOLDED,), 1, own, self.patch),
            ("LOWER_DEGREE", (ILL_POSED,), 1, own, self.quadratic),
            ("ONE_RING", (FOLDED,), 1, own, self.quadratic),
            ("LOWER_DEGREE", (ILL_POSED,), max(k, 2), own, self.quadratic),
            ("LOWER_DEGREE", (ILL_POSED,), k + 3, own, self.quadratic),
        ]
        outcome = ILL_POSED
        for status, after, rings, normal, solve in chain:
            if outcome not in after:
                continue
            normal = self.other_normal(vertex) if normal is None else normal
            too_few = len(self.members(vertex, rings)) < 6
            if normal is None or (not too_few and self.folds(vertex, rings, normal)):
                outcome = FOLDED
                continue
            found = solve(vertex, rings, normal)
            if found is not ILL_POSED and self.is_held(vertex, *found[1:]):
                return Fit(status, *found)
            outcome = ILL_POSED
        mean = self.normals[self.members(vertex, max(k, 2))].sum(axis=0)
        found = self.quadratic(vertex, max(k, 2), mean / np.linalg.norm(mean))
        if found is ILL_POSED or not self.is_held(vertex, *found[1:]):
            return Fit("NORMAL_ONLY", own, 0.0, 0.0)
        return Fit("FOLDED", *found)

    def is_held(self, vertex, mean, gaussian):
        """Whether the faces at a vertex can hold its curvature: they turn by pi at most over the height of a face."""
        a, b, c = self.vertices[self.faces[(self.faces == vertex).any(axis=1)]].transpose(1, 0, 2)
        sides = np.linalg.norm([b - a, c - b, a - c], axis=2).max(axis=0)
        height = (np.linalg.norm(np.cross(b - a, c - a), axis=1) / sides).min()
        turn = (abs(mean) + np.sqrt(max(mean**2 - gaussian, 0.0))) * height
        if abs(turn - np.pi) < ROUNDING * turn:
            raise Doubt
        return turn < np.pi


def well_posed(system):
    """Whether there is one solution."""
    values = np.linalg.svd(system / np.linalg.norm(system, axis=0), compute_uv=False)
    condition = values[0] / max(values[-1], 1e-300) if len(system) >= system.shape[1] else np.inf
    if WELL_POSED < condition < SINGULAR:
        raise Doubt
    return condition <= WELL_POSED
