"""Holes cut from meshes whose surface is then known, and points spread over surfaces."""

from typing import NamedTuple

import numpy as np

SAMPLES = 10_000


class Case(NamedTuple):
    """A mesh with one hole, and the faces that were there."""

    name: str
    vertices: np.ndarray
    faces: np.ndarray
    removed: np.ndarray


def cut(name: str, vertices: np.ndarray, faces: np.ndarray, center: np.ndarray, radius: float) -> Case:
    """Cut the faces near a point of the surface that hang together with the nearest one."""
    centers = vertices[faces].mean(axis=1)
    near = np.linalg.norm(centers - center, axis=1) < radius
    linked = np.zeros(len(vertices), dtype=bool)
    first = np.argmin(np.linalg.norm(centers - center, axis=1))
    inside = np.zeros(len(faces), dtype=bool)
    inside[first] = True
    while True:
        linked[faces[inside]] = True
        grown = near & linked[faces].any(axis=1) | inside
        if grown.sum() == inside.sum():
            return Case(name, vertices, faces[~inside], faces[inside])
        inside = grown


def compact(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A mesh without unused vertices: fillers must not see what was cut out."""
    used, local = np.unique(faces, return_inverse=True)
    return np.ascontiguousarray(vertices[used]), local.reshape(-1, 3).astype(np.int32)


def normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    a, b, c = vertices[faces].transpose(1, 0, 2)
    return np.cross(b - a, c - a)


def surface_points(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Points spread evenly over some faces."""
    rng = np.random.default_rng(0)
    areas = np.linalg.norm(normals(vertices, faces), axis=1)
    chosen = rng.choice(len(faces), SAMPLES, p=areas / areas.sum())
    u, v = rng.random((2, SAMPLES, 1))
    root = np.sqrt(u)
    a, b, c = vertices[faces[chosen]].transpose(1, 0, 2)
    return (1 - root) * a + root * (1 - v) * b + root * v * c
