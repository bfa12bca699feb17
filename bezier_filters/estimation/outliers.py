"""Puts outliers back before a surface is learned from, as they would pass for noise and for shape."""

import numpy as np

from bezier_filters.arrays import FloatArray
from bezier_filters.estimation.fallbacks import MORE_RINGS, fallback_chain, fit_with_fallbacks
from bezier_filters.estimation.vertex_geometry import empty_geometry
from bezier_filters.kernels.kernel_input import KernelMesh
from bezier_filters.patches.fitting import PatchFit

RINGS = 3
"""Of the robust fit that tells what is far off: narrow, and without a model to be misled."""
FAR = 5.0
"""Standard deviations of the noise around a vertex."""
SPREADS = 2
"""How many edges around a vertex its noise is told from."""
REACH = RINGS + MORE_RINGS + SPREADS
"""How many edges around a vertex decide whether it is far off."""
GEOMETRIC_MEAN = np.exp(-0.5 * (np.euler_gamma + np.log(2.0)))
"""Of the absolute value of a standard normal variable."""


def without_outliers(mesh: KernelMesh, *, threads: int = 1) -> KernelMesh:
    """The mesh with every vertex that is far off its own robust patch moved onto it."""
    n = len(mesh.vertices)
    every = np.arange(n, dtype=np.int32)
    own = mesh._replace(origin=every)
    geometry = empty_geometry(n)
    attempts = list(fallback_chain(RINGS, PatchFit()))
    fit_with_fallbacks(own, every, attempts, geometry, robust=True, threads=threads)
    distances = np.linalg.norm(geometry.displacements, axis=1)
    is_far = distances > FAR / GEOMETRIC_MEAN * _geometric_means(mesh, distances)
    vertices = np.where(is_far[:, np.newaxis], mesh.vertices + geometry.displacements, mesh.vertices)
    return mesh._replace(vertices=vertices)


def _geometric_means(mesh: KernelMesh, values: FloatArray) -> FloatArray:
    """Of values (n,) around every vertex: few large ones among them do not matter much."""
    valences = np.diff(mesh.ring_ptr)
    rows = np.repeat(np.arange(len(values)), valences)
    logarithms = np.log(np.maximum(values, np.finfo(np.float64).tiny))
    for _ in range(SPREADS):
        sums = logarithms + np.bincount(rows, weights=logarithms[mesh.ring_indices], minlength=len(values))
        logarithms = sums / (1 + valences)
    result: FloatArray = np.exp(logarithms)
    return result
