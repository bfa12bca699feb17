"""Meshes, noise and files of the figures of docs/mathematics."""

from pathlib import Path
from typing import Any

import matplotlib
import numpy as np

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.fitting.mesh_neighbourhoods import MeshNeighbourhoods
from bezier_filters.kernels.kernel_input import prepare_kernel_mesh
from bezier_filters.meshes.adjacency import Adjacency
from bezier_filters.meshes.mesh import triangle_mesh
from bezier_filters.meshes.prepared_mesh import PreparedMesh, prepare_mesh
from bezier_filters.surface_model.fit_options import FitOptions
from bezier_filters.surface_model.learn import learn_surface
from bezier_filters.surface_model.model_tree import Leaf

matplotlib.use("agg")
from matplotlib import pyplot

FOLDER = Path(__file__).parent
BLUE, ORANGE, GREEN, RED, GREY = "#1f77b4", "#ff7f0e", "#2ca02c", "#d62728", "0.55"


def save(figure: Any, name: str) -> None:
    """Write a figure in this folder."""
    figure.savefig(FOLDER / f"mathematics_{name}.png", dpi=100)
    pyplot.close(figure)


def prepare(vertices: FloatArray, faces: IntArray) -> PreparedMesh:
    """A mesh with its adjacency."""
    return prepare_mesh(triangle_mesh(vertices, faces))


def white_noise(count: int, seed: int = 0) -> FloatArray:
    """Noise of variance 1 that is independent from vertex to vertex."""
    return np.random.default_rng(seed).standard_normal(count)


def correlated_noise(adjacency: Adjacency, count: int, averages: int = 2) -> FloatArray:
    """Noise of variance 1: white noise averaged with the neighbours, and a tenth of white noise."""
    rows, values = adjacency.vertices, white_noise(count)
    start = np.repeat(np.arange(count), rows.lengths)
    for _ in range(averages):
        values = (values + np.bincount(start, values[rows.indices], count)) / (1.0 + rows.lengths)
    return np.sqrt(0.9) * values / values.std() + np.sqrt(0.1) * white_noise(count, 1)


def learn(vertices: FloatArray, faces: IntArray) -> Leaf:
    """The surface model of a mesh, with its fit specifications."""
    arrays = prepare_kernel_mesh(triangle_mesh(vertices, faces), with_barriers=True)
    leaf = learn_surface(MeshNeighbourhoods(arrays), FitOptions())
    if leaf is None:
        raise ValueError("the mesh determines no surface model")
    return leaf
