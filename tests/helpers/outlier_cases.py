"""Surfaces with vertices far off them, and how far results are from the surfaces."""

from typing import TypeAlias

import numpy as np
from scanner_noise import mean_edge_of

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.meshes.triangles import area_vectors
from bezier_filters.surfaces import block_with_sharp_edges, bumpy_star, torus

Shape: TypeAlias = tuple[FloatArray, IntArray, FloatArray]
"""Vertices, faces and unit normals of the vertices."""


def block() -> Shape:
    """A block, its faces and vertex normals."""
    vertices, faces = block_with_sharp_edges(resolution=30, jitter=0.25)
    normals = np.zeros_like(vertices)
    for k in range(3):
        np.add.at(normals, faces[:, k], area_vectors(vertices, faces))
    return vertices, faces, normals / np.linalg.norm(normals, axis=1, keepdims=True)


def star() -> Shape:
    """A star with soft bumps."""
    surface = bumpy_star(resolution=24, jitter=0.2)
    return surface.vertices, surface.faces, surface.normals


def bent_torus() -> Shape:
    """A torus."""
    surface = torus(resolution=30, jitter=0.2)
    return surface.vertices, surface.faces, surface.normals


def with_heights(shape: Shape, heights: FloatArray) -> tuple[FloatArray, IntArray]:
    """A mesh with vertices off it by heights in mean edges."""
    vertices, faces, normals = shape
    return vertices + mean_edge_of(vertices, faces) * heights[:, np.newaxis] * normals, faces


def spikes(count: int, share: float, size: float, seed: int = 0) -> tuple[FloatArray, BoolArray]:
    """Heights of which a share is normally distributed, and which those are; the others are 0."""
    random = np.random.default_rng(seed)
    hit = random.random(count) < share
    return hit * size * random.standard_normal(count), hit


def with_spikes(shape: Shape, share: float, size: float, seed: int = 77) -> tuple[FloatArray, BoolArray]:
    """A mesh of which some vertices are off along the normal, and which those are."""
    heights, hit = spikes(len(shape[0]), share, size, seed)
    return with_heights(shape, heights)[0], hit


def height_errors(shape: Shape, vertices: FloatArray) -> FloatArray:
    """Heights over the surface along its normals, mean edges."""
    true, faces, normals = shape
    return np.einsum("ij,ij->i", vertices - true, normals) / mean_edge_of(true, faces)


def off_in_all_directions(shape: Shape, share: float, size: float, seed: int = 77) -> tuple[FloatArray, BoolArray]:
    """A mesh of which some vertices are off in all directions, and which those are."""
    vertices, faces, _ = shape
    random = np.random.default_rng(seed)
    hit = random.random((len(vertices), 1)) < share
    return vertices + size * mean_edge_of(vertices, faces) * hit * random.standard_normal(vertices.shape), hit[:, 0]
