"""Meshes with too few points, or too few neighbours, to learn from."""

import numpy as np

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.surfaces import waves


def tube(edges: int, height: float, radius: float = 1.0) -> tuple[FloatArray, IntArray]:
    """A cylinder of two rows of vertices."""
    angles = 2.0 * np.pi * np.arange(edges) / edges
    ring = radius * np.column_stack([np.cos(angles), np.sin(angles), np.zeros(edges)])
    i, j = np.arange(edges), np.roll(np.arange(edges), -1)
    faces = np.concatenate([np.column_stack([i, j, j + edges]), np.column_stack([i, j + edges, i + edges])])
    return np.concatenate([ring, ring + np.array([0.0, 0.0, height])]), faces


def soup() -> tuple[FloatArray, IntArray]:
    """Triangles that share no vertices."""
    sheet = waves(resolution=30)
    return sheet.vertices[sheet.faces].reshape(-1, 3), np.arange(sheet.faces.size).reshape(-1, 3)
