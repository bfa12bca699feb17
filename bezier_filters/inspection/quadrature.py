"""Integrals over the blended surface, by Gauss points over each face.

Over the barycentric coordinates a, b of a face the surface is S(a, b) = x(a, b) + t(a, b) n(a, b), where x and n are
the interpolated vertices and normals. Its tangents have the heights t_a and t_b for which they are orthogonal to the
unit normal N of the surface, and its area element is |S_a x S_b| da db. Total curvatures are those of this surface:

    H dA = N . (N_a x S_b + S_a x N_b) / 2 da db,   K dA = N . (N_a x N_b) da db,

with derivatives of the normals by differences; K dA is the area of their image on the unit sphere. So they follow from
positions and normals, which are far more accurate under noise than the second derivatives of the patches.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.special import roots_jacobi, roots_legendre

from bezier_filters.arrays import FloatArray
from bezier_filters.patch_surface.blending import MIN_RAY_SLOPE
from bezier_filters.patch_surface.projection import ON_FACE
from bezier_filters.patch_surface.surface import Surface, SurfacePoints
from bezier_filters.runtime.parallel import Progress, report

RULE_ORDER = 3  # points along each coordinate: 9 over a face, exact for polynomials of total degree 5
STEP = 1e-7  # of differences, in barycentric coordinates; points are farther inside of their faces
CHUNK_FACES = 1 << 15  # faces at a time: some 200 MB


def triangle_rule(order: int) -> tuple[FloatArray, FloatArray]:
    """Places (k, 2) and weights (k,) over the triangle a, b >= 0, a + b <= 1, exact to the degree 2 order - 1.

    Gauss rules of Legendre and Jacobi on a square that is collapsed to the triangle (Stroud, "Approximate calculation
    of multiple integrals", 1971).

    >>> places, weights = triangle_rule(2)
    >>> round(float(weights.sum()), 15), round(float(weights @ places[:, 0] ** 2), 15)
    (0.5, 0.083333333333333)
    """
    x, x_weights = roots_jacobi(order, 1.0, 0.0)
    y, y_weights = roots_legendre(order)
    a = np.repeat(0.5 * (1.0 + x), order)
    b = (1.0 - a) * np.tile(0.5 * (1.0 + y), order)
    return np.column_stack([a, b]), np.outer(x_weights, y_weights).ravel() / 8.0


@dataclass(frozen=True)
class QuadraturePoints:
    """Gauss points of some faces, in the order of the faces; integrands have the weights in them."""

    places: SurfacePoints  # q of them
    shares: FloatArray  # (q, 3): barycentric coordinates of the corners
    areas: FloatArray  # (q,)
    volumes: FloatArray  # (q,): of the cones from the middle of the mesh, signed
    mean_curvatures: FloatArray  # (q,): H dA of the surface itself, whose normals turn between the patches, too
    gaussian_curvatures: FloatArray  # (q,): K dA, the signed area of the image on the unit sphere


def quadrature_points(surface: Surface, *, progress: Progress | None = None) -> Iterator[QuadraturePoints]:
    """The Gauss points over all faces, in chunks."""
    places, weights = triangle_rule(RULE_ORDER)
    count = len(surface.mesh.faces)
    # Gaps at sharp edges would count with their distance from the origin.
    middle = np.ldexp(0.5 * (surface.mesh.vertices.min(axis=0) + surface.mesh.vertices.max(axis=0)), surface.exponent)
    for start in range(0, count, CHUNK_FACES):
        faces = np.arange(start, min(start + CHUNK_FACES, count), dtype=np.int32)
        rows, where = np.repeat(faces, len(weights)), np.tile(places, (len(faces), 1))
        found = surface.evaluate(rows, where)
        first, second = tangents(surface, found)
        ahead = [surface.evaluate(rows, where + STEP * shift).normals for shift in np.eye(2)]
        turn_first, turn_second = ((normals - found.normals) / STEP for normals in ahead)
        weight, area = np.tile(weights, len(faces)), np.cross(first, second)
        bent = 0.5 * _dot(np.cross(turn_first, second) + np.cross(first, turn_second), found.normals)
        yield QuadraturePoints(
            found,
            np.column_stack([1.0 - where.sum(axis=1), where]),
            weight * np.linalg.norm(area, axis=1),
            weight * _dot(found.points - middle, area) / 3.0,
            weight * bent,
            weight * _dot(np.cross(turn_first, turn_second), found.normals),
        )
        report(progress, start + len(faces), count)


def tangents(surface: Surface, found: SurfacePoints) -> tuple[FloatArray, FloatArray]:
    """The tangents S_a and S_b at places of faces, (q, 3) each."""
    scale = np.ldexp(1.0, surface.exponent)
    corners = surface.cut.faces[found.faces]
    v, n = scale * surface.cut.vertices[corners], surface.geometry.normals[corners]
    shares = np.column_stack([1.0 - found.coordinates.sum(axis=1), found.coordinates])
    ray = np.einsum("qk,qkd->qd", shares, n)
    height = _dot(found.points - np.einsum("qk,qkd->qd", shares, v), ray)
    height /= np.maximum(_dot(ray, ray), np.finfo(np.float64).tiny)
    along_ray = _dot(ray, found.normals)
    is_flat = (found.outcome == ON_FACE) | (along_ray < MIN_RAY_SLOPE)
    height[is_flat] = 0.0
    sides = v[:, 1:] - v[:, :1] + height[:, np.newaxis, np.newaxis] * (n[:, 1:] - n[:, :1])
    rise = np.einsum("qkd,qd->qk", sides, found.normals) / np.where(is_flat, 1.0, along_ray)[:, np.newaxis]
    rise[is_flat] = 0.0
    both = sides - rise[:, :, np.newaxis] * ray[:, np.newaxis]
    return both[:, 0], both[:, 1]


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("ij,ij->i", a, b))
