"""Neighbourhoods drawn from the model that is learned: random terms of known variances, and noise."""

from dataclasses import dataclass, replace

import numpy as np

from bezier_filters.arrays import FloatArray
from bezier_filters.fitting.fallbacks import fit_with_fallbacks, spec_chain
from bezier_filters.fitting.vertex_geometry import empty_geometry
from bezier_filters.kernels.kernel_input import KernelMesh
from bezier_filters.patches.harmonics import HIGHEST_DEGREE, harmonic_basis
from bezier_filters.patches.polynomials import total_degree_space
from bezier_filters.sampling.neighbourhood_samples import NeighbourhoodSample
from bezier_filters.sampling.ring_analysis import analyse_rings


@dataclass(frozen=True)
class Drawn:
    """N neighbourhoods of the same number of points; point 0 is the vertex itself, at the origin.

    Attributes
    ----------
    points : (N, n, 3) float64
        Coordinates over the tangent plane.
    coefficients : (N, M) float64
        Of the terms of `harmonic_basis`, for lengths in units of `radius`.
    radius : float
        Unit of x and y.
    """

    points: FloatArray
    coefficients: FloatArray
    radius: float


def terms_at(xy):
    """Values of all terms of `harmonic_basis` at points (..., 2)."""
    a, b = total_degree_space(HIGHEST_DEGREE).exponents.T
    powers = np.cumprod(np.stack([np.ones_like(xy), *[xy] * HIGHEST_DEGREE], axis=-1), axis=-1)
    return (powers[..., 0, a] * powers[..., 1, b]) @ harmonic_basis().monomials


def variances_by_degree(first, ratio):
    """Variances of the terms: `first` at degree 3, and `ratio` times as much for every degree more; 0 below 3."""
    degrees = harmonic_basis().degrees
    return np.where(degrees < 3, 0.0, first * ratio ** (degrees - 3.0))


def draw(count, size, variances, sigma, *, radius=1.0, seed=0):
    """Points spread over discs like those of a mesh, heights from the terms with the given variances, and noise."""
    rng = np.random.default_rng(seed)
    r = np.sqrt(np.arange(size) / (size - 1.0))
    phi = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(size) + rng.uniform(0, 2 * np.pi, (count, 1))  # a sunflower's
    xy = np.stack([r * np.cos(phi), r * np.sin(phi)], axis=2)
    xy[:, 1:-1] += rng.normal(0.0, 0.3 / np.sqrt(size), (count, size - 2, 2))
    xy /= np.maximum(np.linalg.norm(xy, axis=2, keepdims=True), 1.0)
    coefficients = rng.standard_normal((count, len(variances))) * np.sqrt(variances)
    z = np.einsum("npk,nk->np", terms_at(xy), coefficients) + sigma * rng.standard_normal((count, size))
    return Drawn(np.concatenate([radius * xy, z[..., np.newaxis]], axis=2), coefficients, radius)


def as_sample(points, rings=3):
    """A sample whose neighbourhoods, given as (N, n, 3) points, are all k-rings."""
    count, size, _ = points.shape
    every = np.ones((count, rings + 1), dtype=np.bool_)
    sizes = np.full((count, rings + 1), size, dtype=np.int32)
    return NeighbourhoodSample(np.arange(count, dtype=np.int32), points, sizes, every, every, np.zeros(count))


def analyse_ring(sample, rings, most):
    """The analysis of one ring of a large mesh, or None."""
    return next(iter(analyse_rings(sample, {rings: most}, vertex_count=10**6)), None)


def fit_stars(drawn, plan):
    """What the kernel makes of the neighbourhoods with one plan, over the plane z = 0; `plan.rings` must be 1.

    Every vertex is the middle of a star of its own. Returns gradients (N, 2) and Hessians (N, 2, 2),
    which for small heights follow from normal and curvature.
    """
    count, size, _ = drawn.points.shape
    vertices = drawn.points.copy()
    vertices[..., 2] -= vertices[:, :1, 2]
    total = count * size
    centers = np.arange(0, total, size, dtype=np.int32)
    lengths = np.zeros(total, dtype=np.int32)
    lengths[centers] = size - 1
    empty = np.zeros(0, dtype=np.int32)
    mesh = KernelMesh(
        vertices.reshape(-1, 3),
        np.zeros((0, 3), dtype=np.int32),
        np.zeros(total + 1, dtype=np.int32),
        empty,
        np.concatenate([[0], np.cumsum(lengths)]).astype(np.int32),
        np.setdiff1d(np.arange(total), centers).astype(np.int32),
        np.zeros(total, dtype=np.bool_),
        np.tile([0.0, 0.0, 1.0], (total, 1)),
        np.full(total, 2.0, dtype=np.float32),
        np.zeros(total, dtype=np.bool_),
        np.arange(total, dtype=np.int32),
        np.empty((0, 3)),
        empty,
        empty,
    )
    geometry = empty_geometry(total)
    fit_with_fallbacks(mesh, centers, list(spec_chain([plan], plan)), geometry)
    assert (geometry.status[centers] == 0).all()
    normals = geometry.normals[centers]
    low, high = geometry.direction_min[centers, :2], geometry.direction_max[centers, :2]
    outer = low[:, :, None] * low[:, None] * geometry.k_min[centers, None, None]
    outer += high[:, :, None] * high[:, None] * geometry.k_max[centers, None, None]
    return -normals[:, :2] / normals[:, 2:], -outer


def with_correlated_noise(drawn, noise, seed=0):
    """The same neighbourhoods with Gaussian noise of a `NoiseModel` added to the heights, which have to be small."""
    distances = np.linalg.norm(drawn.points[:, :, np.newaxis, :2] - drawn.points[:, np.newaxis, :, :2], axis=3)
    covariances = np.zeros(distances.shape) + noise.white * np.eye(distances.shape[1])
    for sill, length in zip(noise.sills, noise.lengths, strict=True):
        covariances += sill * np.exp(-(distances**2) / (2.0 * length**2))
    factors = np.linalg.cholesky(covariances)
    normal = np.random.default_rng(seed).standard_normal((*distances.shape[:2], 1))
    points = drawn.points.copy()
    points[..., 2:] += factors @ normal
    return replace(drawn, points=points)
