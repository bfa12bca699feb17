"""Points without faces, of surfaces that are known."""

import numpy as np
from numpy.typing import ArrayLike

from bezier_filters import triangle_mesh
from bezier_filters.arrays import FloatArray
from bezier_filters.fitting.point_cloud import PointCloud, point_cloud
from bezier_filters.surfaces import SampledSurface, ellipsoid, sphere, torus

CLOSED = {"sphere": sphere(jitter=0.3), "ellipsoid": ellipsoid(jitter=0.3), "torus": torus(jitter=0.3)}


def cloud_of(points: ArrayLike, normals: FloatArray | None = None) -> PointCloud:
    """What is found of points, with given normals (n, 3)."""
    return point_cloud(triangle_mesh(points, []), normals)


def noisy(surface: SampledSurface, edges: float, seed: int = 0) -> FloatArray:
    """The vertices with noise of so many mean edges."""
    corners = surface.vertices[surface.faces]
    edge = np.linalg.norm(corners[:, 0] - corners[:, 1], axis=1).mean()
    return surface.vertices + edges * edge * np.random.default_rng(seed).normal(size=surface.vertices.shape)


def dots(a: FloatArray, b: FloatArray) -> FloatArray:
    """Inner products of rows, (n,)."""
    products: FloatArray = np.einsum("ij,ij->i", a, b)
    return products


def points_on_sphere(n: int, seed: int = 0) -> FloatArray:
    """Points at random on the unit sphere, (n, 3)."""
    points = np.random.default_rng(seed).normal(size=(n, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True)
