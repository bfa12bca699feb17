"""The analytic surfaces under test, and what is measured on their meshes."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from bezier_filters import surfaces
from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.surfaces import SampledSurface
from evans_fung import red_blood_cell

IRREGULAR = 0.3


@dataclass(frozen=True)
class Case:
    """A surface with what topology says about its mesh."""

    make: Callable[..., SampledSurface]
    resolution: int
    euler_characteristic: int
    rims: int


CASES = {
    "sphere": Case(surfaces.sphere, 8, 2, 0),
    "ellipsoid": Case(surfaces.ellipsoid, 8, 2, 0),
    "bumpy_star": Case(surfaces.bumpy_star, 10, 2, 0),
    "red_blood_cell": Case(red_blood_cell, 12, 2, 0),
    "torus": Case(surfaces.torus, 16, 0, 0),
    "cylinder": Case(surfaces.cylinder, 24, 0, 2),
    "monkey_saddle": Case(surfaces.monkey_saddle, 20, 1, 1),
    "waves": Case(surfaces.waves, 28, 1, 1),
    "punched_patch": Case(surfaces.punched_patch, 28, -2, 4),
}
CLOSED = ["sphere", "ellipsoid", "bumpy_star", "red_blood_cell", "torus"]
each_surface = pytest.mark.parametrize("name", CASES)
each_jitter = pytest.mark.parametrize("jitter", [0.0, IRREGULAR])


def make(name: str, jitter: float, refinement: int = 1) -> SampledSurface:
    case = CASES[name]
    return case.make(resolution=case.resolution * refinement, jitter=jitter, seed=3)


def directed_edges(faces: IntArray) -> IntArray:
    return np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])


def border_edges(faces: IntArray) -> IntArray:
    edges = directed_edges(faces)
    there = edges[:, 0].astype(np.int64) * (faces.max() + 1) + edges[:, 1]
    back = edges[:, 1].astype(np.int64) * (faces.max() + 1) + edges[:, 0]
    return edges[~np.isin(there, back)]


def rim_count(faces: IntArray) -> int:
    """Number of closed loops that the border edges form."""
    following = dict(border_edges(faces).tolist())
    count = 0
    while following:
        vertex = next(iter(following))
        while vertex in following:
            vertex = following.pop(vertex)
        count += 1
    return count


def area_vectors(vertices: FloatArray, faces: IntArray) -> FloatArray:
    a, b, c = vertices[faces].transpose(1, 0, 2)
    return 0.5 * np.cross(b - a, c - a)


def integrated_gaussian_curvature(surface: SampledSurface) -> float:
    face_areas = np.linalg.norm(area_vectors(surface.vertices, surface.faces), axis=1)
    return float((face_areas * surface.gaussian_curvature[surface.faces].mean(axis=1)).sum())


def volume(vertices: FloatArray, faces: IntArray) -> float:
    return float(np.linalg.det(vertices[faces]).sum() / 6)


def corner_angles(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Angles in degrees, shape (m, 3)."""
    corners = vertices[faces]
    ahead, behind = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    sine = np.linalg.norm(np.cross(ahead, behind), axis=2)
    return np.degrees(np.arctan2(sine, (ahead * behind).sum(axis=2)))


def assert_valid_mesh(vertices: FloatArray, faces: IntArray, euler_characteristic: int, rims: int) -> None:
    """Edge-manifold, consistently oriented, no unused vertex, right topology."""
    assert vertices.dtype == np.float64
    assert faces.dtype == np.int32
    np.testing.assert_array_equal(np.unique(faces), np.arange(len(vertices)))
    edges = directed_edges(faces)
    assert len(np.unique(edges, axis=0)) == len(edges), "an edge is passed twice in the same direction"
    edge_count = len(np.unique(np.sort(edges, axis=1), axis=0))
    assert len(vertices) - edge_count + len(faces) == euler_characteristic
    border_starts = border_edges(faces)[:, 0]
    assert len(np.unique(border_starts)) == len(border_starts), "rims touch"
    assert rim_count(faces) == rims
