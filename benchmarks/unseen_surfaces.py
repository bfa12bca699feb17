"""Surfaces of unseen.py, with exact normals, H and K: level sets, and images of rectangles.

Derivatives come from arithmetic with Taylor polynomials of degree 2, so that a formula is all that a surface needs.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

NEWTON_STEPS = 30
GRID = 300
"""Samples along each side of a rectangle among which Newton's method finds its start."""


class Jet:
    """Values (n,) of a function of k variables, with gradients (n, k) and Hessians (n, k, k)."""

    def __init__(self, value: np.ndarray, slope: np.ndarray, bend: np.ndarray) -> None:
        self.value, self.slope, self.bend = value, slope, bend

    @classmethod
    def variables(cls, points: np.ndarray) -> list["Jet"]:
        """The k coordinates of points (n, k)."""
        n, k = points.shape
        return [
            cls(points[:, i], np.broadcast_to(np.eye(k)[i], (n, k)), np.broadcast_to(0.0, (n, k, k))) for i in range(k)
        ]

    def chain(self, value: np.ndarray, first: np.ndarray, second: np.ndarray) -> "Jet":
        """A function of this one, by its value and derivatives here."""
        square = self.slope[:, :, np.newaxis] * self.slope[:, np.newaxis, :]
        bend = first[:, np.newaxis, np.newaxis] * self.bend + second[:, np.newaxis, np.newaxis] * square
        return Jet(value, first[:, np.newaxis] * self.slope, bend)

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: object, **options: object) -> "Jet":
        x = self.value
        derivatives = {np.exp: (np.exp, np.exp), np.sin: (np.cos, lambda t: -np.sin(t)), np.cosh: (np.sinh, np.cosh)}
        derivatives[np.cos] = (lambda t: -np.sin(t), lambda t: -np.cos(t))
        if method != "__call__" or ufunc not in derivatives or options:
            return NotImplemented
        first, second = derivatives[ufunc]
        return self.chain(ufunc(x), first(x), second(x))

    def __add__(self, other: object) -> "Jet":
        if isinstance(other, Jet):
            return Jet(self.value + other.value, self.slope + other.slope, self.bend + other.bend)
        return Jet(self.value + other, self.slope, self.bend)

    def __mul__(self, other: object) -> "Jet":
        if not isinstance(other, Jet):
            return Jet(self.value * other, self.slope * other, self.bend * other)
        a, b = self.value[:, np.newaxis], other.value[:, np.newaxis]
        mixed = self.slope[:, :, np.newaxis] * other.slope[:, np.newaxis, :]
        bend = a[:, np.newaxis] * other.bend + b[:, np.newaxis] * self.bend + mixed + mixed.transpose(0, 2, 1)
        return Jet(self.value * other.value, a * other.slope + b * self.slope, bend)

    def __pow__(self, power: float) -> "Jet":
        x = self.value
        if power == 2:
            return self * self
        return self.chain(x**power, power * x ** (power - 1), power * (power - 1) * x ** (power - 2))

    def __neg__(self) -> "Jet":
        return self * -1.0

    def __sub__(self, other: object) -> "Jet":
        return self + (-other)

    def __rsub__(self, other: float) -> "Jet":
        return -self + other

    def __truediv__(self, other: object) -> "Jet":
        return self * other**-1.0

    __radd__, __rmul__ = __add__, __mul__


class Sample(NamedTuple):
    """A mesh with the exact geometry of the surface that its vertices lie on, or are nearest to."""

    vertices: np.ndarray
    faces: np.ndarray
    normals: np.ndarray
    mean_curvature: np.ndarray
    gaussian_curvature: np.ndarray


@dataclass(frozen=True)
class LevelSet:
    """The closed surface F = 0 of a function that is negative inside; all of it lies in a box about the origin."""

    level: Callable[..., object]
    reach: tuple[float, float, float]
    count: int = 3000
    is_star: bool = False
    """Whether every ray from the origin meets it once."""

    def value(self, points: np.ndarray) -> np.ndarray:
        """F at points (.., 3)."""
        return np.asarray(self.level(*np.moveaxis(points, -1, 0)))

    def on_surface(self, points: np.ndarray) -> np.ndarray:
        """Points of the surface near to given ones."""
        for _ in range(NEWTON_STEPS):
            level = self.level(*Jet.variables(points))
            slope = level.slope
            points = points - (level.value / np.square(slope).sum(axis=1))[:, np.newaxis] * slope
        return points

    def nearest(self, points: np.ndarray) -> np.ndarray:
        """The nearest points of the surface, where the segment to the given one is along the normal."""
        found = self.on_surface(points)
        for _ in range(NEWTON_STEPS):
            normals = self.level(*Jet.variables(found)).slope
            normals /= np.linalg.norm(normals, axis=1)[:, np.newaxis]
            offset = points - found
            along = offset - np.einsum("ij,ij->i", offset, normals)[:, np.newaxis] * normals
            found = self.on_surface(found + 0.7 * along)
        return found

    def sample(self, points: np.ndarray, faces: np.ndarray) -> Sample:
        """Mesh with exact geometry, after Goldman, "Curvature formulas for implicit curves and surfaces", 2005."""
        level = self.level(*Jet.variables(points))
        g, m = level.slope, level.bend
        square = np.square(g).sum(axis=1)
        along = np.einsum("ij,ijk,ik->i", g, m, g)
        mean = (square * np.trace(m, axis1=1, axis2=2) - along) / (2.0 * square**1.5)
        rows = m.transpose(1, 0, 2)
        adjugate = np.stack([np.cross(rows[i - 2], rows[i - 1]) for i in range(3)], axis=1)
        gaussian = np.einsum("ij,ijk,ik->i", g, adjugate, g) / square**2
        return Sample(points, faces, g / np.sqrt(square)[:, np.newaxis], mean, gaussian)


@dataclass(frozen=True)
class Chart:
    """The image of a rectangle [0, width] x [0, height] of u and v; x_u x x_v points outward."""

    position: Callable[..., tuple[object, object, object]]
    size: tuple[float, float]
    wrapped: tuple[bool, bool] = (False, False)
    count: int = 3000

    def points(self, parameters: np.ndarray) -> np.ndarray:
        """Points (n, 3) of the surface at parameters (n, 2)."""
        return np.stack([x.value for x in self.position(*Jet.variables(parameters))], axis=1)

    def tangents(self, parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Points (n, 3) and tangents (n, 3, 2)."""
        jets = self.position(*Jet.variables(parameters))
        return np.stack([x.value for x in jets], axis=1), np.stack([x.slope for x in jets], axis=1)

    @cached_property
    def lattice(self) -> tuple[np.ndarray, cKDTree]:
        """Parameters of a grid and a tree of its points."""
        parameters = np.indices((GRID, GRID)).reshape(2, -1).T * np.array(self.size) / (GRID - 1)
        return parameters, cKDTree(self.points(parameters))

    def nearest(self, points: np.ndarray) -> np.ndarray:
        """Parameters of the nearest points of the surface, which may lie a little beyond the border."""
        lattice, tree = self.lattice
        found = lattice[tree.query(points)[1]]
        for _ in range(NEWTON_STEPS):
            at, tangents = self.tangents(found)
            normal = np.einsum("nij,nik->njk", tangents, tangents)
            right = np.einsum("nij,ni->nj", tangents, points - at)
            found = found + np.linalg.solve(normal, right[:, :, np.newaxis])[:, :, 0]
        return found

    def sample(self, parameters: np.ndarray, faces: np.ndarray) -> Sample:
        """Mesh with exact geometry from the two fundamental forms."""
        jets = self.position(*Jet.variables(parameters))
        tangents = np.stack([x.slope for x in jets], axis=2)
        second = np.stack([x.bend for x in jets], axis=3)
        normals = np.cross(tangents[:, 0], tangents[:, 1])
        normals /= np.linalg.norm(normals, axis=1)[:, np.newaxis]
        first = np.einsum("nik,njk->nij", tangents, tangents)
        shape = -np.linalg.solve(first, np.einsum("nijk,nk->nij", second, normals))
        points = np.stack([x.value for x in jets], axis=1)
        return Sample(points, faces, normals, 0.5 * np.trace(shape, axis1=1, axis2=2), np.linalg.det(shape))


def tangle(x, y, z):
    """Goursat's surface of genus 5."""
    return sum(t**4 - 5.0 * t**2 for t in (x, y, z)) + 11.8


def double_ring(x, y, z):
    """A thin body of genus 2 around Gerono's lemniscate."""
    return (x**4 - x**2 + y**2) ** 2 + 4.0 * z**2 - 0.03


def metaballs(x, y, z):
    centres = ((0.0, 0.0, 0.0), (1.1, 0.2, 0.0), (-0.6, 0.9, 0.3), (0.2, -0.8, 0.7))
    return -sum(np.exp(((x - a) ** 2 + (y - b) ** 2 + (z - c) ** 2) * -2.8) for a, b, c in centres) + 0.4


def peanut(x, y, z):
    """Cassini's oval, turned about its axis."""
    return ((x - 1.0) ** 2 + y**2 + z**2) * ((x + 1.0) ** 2 + y**2 + z**2) - 1.05**4


def egg(x, y, z):
    return (x**2 + y**2) * np.exp(z * 0.4) + z**2 * 0.5 - 1.0


def round_cube(x, y, z):
    return x**4 + y**4 + z**4 - 1.0


def tube(radius, growth=0.0, pitch=0.0):
    """Circles in half planes about the z axis, around points at the distance 1; `radius` is a function of the angle."""

    def position(u, v):
        scale, r = np.exp(u * growth), radius(u)
        return (
            scale * (r * np.cos(v) + 1.0) * np.cos(u),
            scale * (r * np.cos(v) + 1.0) * np.sin(u),
            scale * (r * np.sin(v) + pitch * (1.0 if growth else u)),
        )

    return position


def trefoil(v, u):
    """A tube around a knot, with Frenet's frame."""
    curve = (np.sin(u) + 2.0 * np.sin(2 * u), np.cos(u) - 2.0 * np.cos(2 * u), -np.sin(3 * u))
    speed = (np.cos(u) + 4.0 * np.cos(2 * u), 4.0 * np.sin(2 * u) - np.sin(u), -3.0 * np.cos(3 * u))
    bend = (-np.sin(u) - 8.0 * np.sin(2 * u), 8.0 * np.cos(2 * u) - np.cos(u), 9.0 * np.sin(3 * u))
    binormal = unit(cross(speed, bend))
    normal = unit(cross(binormal, speed))
    return tuple(c + 0.5 * (np.cos(v) * n + np.sin(v) * b) for c, n, b in zip(curve, normal, binormal, strict=True))


def cross(a, b):
    return tuple(a[i - 2] * b[i - 1] - a[i - 1] * b[i - 2] for i in range(3))


def unit(a):
    length = (a[0] ** 2 + a[1] ** 2 + a[2] ** 2) ** 0.5
    return tuple(x / length for x in a)


def cyclide(u, v):
    """Dupin's cyclide, a ring."""
    a, c, d = 1.0, 0.5, 0.75
    b = np.sqrt(a * a - c * c).item()
    below = a - c * np.cos(u) * np.cos(v)
    x = (d * (c - a * np.cos(u) * np.cos(v)) + b * b * np.cos(u)) / below
    return x, b * np.sin(u) * (a - d * np.cos(v)) / below, b * np.sin(v) * (c * np.cos(u) - d) / below


def catenoid(u, v):
    return np.cosh(v - 1.2) * np.cos(u), np.cosh(v - 1.2) * np.sin(u), v - 1.2


def helicoid(u, v):
    return (v - 1.2) * np.cos(u), (v - 1.2) * np.sin(u), 0.6 * u


def enneper(u, v):
    u, v = u - 1.1, v - 1.1
    return u - u**3 / 3.0 + u * v**2, v - v**3 / 3.0 + v * u**2, u**2 - v**2


def hills(u, v):
    x, y = u - 1.0, v - 1.0
    peaks = ((0.4, 0.3, 0.4, 0.45), (-0.5, 0.4, -0.2, 0.25), (-0.2, -0.5, 0.3, 0.3), (0.6, -0.5, 0.12, 0.15))
    return x, y, sum(h * np.exp(((x - a) ** 2 + (y - b) ** 2) / -(w * w)) for a, b, h, w in peaks)


def four_saddle(u, v):
    x, y = u - 1.0, v - 1.0
    return x, y, 0.25 * (x**4 - 6.0 * x**2 * y**2 + y**4)


TURN = 2.0 * np.pi
SURFACES: dict[str, LevelSet | Chart] = {
    "round cube": LevelSet(round_cube, (1.0, 1.0, 1.0), is_star=True),
    "egg": LevelSet(egg, (1.15, 1.15, 1.45), 2000, is_star=True),
    "peanut": LevelSet(peanut, (1.5, 0.6, 0.6), is_star=True),
    "metaballs": LevelSet(metaballs, (2.0, 2.0, 2.0), 4000),
    "tangle": LevelSet(tangle, (2.3, 2.3, 2.3), 5000),
    "double ring": LevelSet(double_ring, (1.2, 0.8, 0.2), 5000),
    "cyclide": Chart(cyclide, (TURN, TURN), (True, True)),
    "trefoil": Chart(trefoil, (TURN, TURN), (True, True), 5000),
    "beads": Chart(tube(lambda u: 0.3 + 0.1 * np.cos(5 * u)), (TURN, TURN), (True, True), 4000),
    "spring": Chart(tube(lambda u: 0.3, pitch=0.15), (2.0 * TURN, TURN), (False, True), 4000),
    "shell": Chart(tube(lambda u: 0.4, growth=0.12, pitch=1.0), (1.5 * TURN, TURN), (False, True), 4000),
    "catenoid": Chart(catenoid, (TURN, 2.4), (True, False)),
    "helicoid": Chart(helicoid, (TURN, 2.4)),
    "Enneper": Chart(enneper, (2.2, 2.2), count=2000),
    "hills": Chart(hills, (2.0, 2.0)),
    "four saddle": Chart(four_saddle, (2.0, 2.0), count=2000),
}
