"""Regions whose mean deviation is more than noise explains."""

from dataclasses import dataclass, field

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components
from scipy.special import ndtr, ndtri

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.meshes.adjacency import Adjacency
from bezier_filters.meshes.unit_size import LENGTH

FALSE_ALARM = 0.05  # probability that noise alone makes any region deviate
# Means over regions that overlap are correlated. Under white noise on spheres and a torus of 1,440 to 7,842 vertices,
# the largest of all is exceeded as that of 41 to 70 independent means per region of 200 vertices.
TESTS_PER_REGION = 70


@dataclass(frozen=True)
class DeviatingRegion:
    """A connected part of a mesh whose regional means deviate significantly, all to the same side.

    Attributes
    ----------
    vertices : (k,) int32
        Vertices with a significant mean around them.
    vertex : int
        The most significant of these.
    place : (3,) float64
        Its place on the reference.
    distance, std : float
        Mean deviation around it and its standard error, lengths.
    p_value : float
        Probability that noise alone makes such a deviation anywhere on the mesh.
    """

    vertices: IntArray
    vertex: int
    place: FloatArray = field(metadata=LENGTH)
    distance: float = field(metadata=LENGTH)
    std: float = field(metadata=LENGTH)
    p_value: float


def find_deviating_regions(
    means: FloatArray, std: FloatArray, places: FloatArray, adjacency: Adjacency, region: int
) -> tuple[DeviatingRegion, ...]:
    """Find the regions, given means over about `region` vertices and their standard errors, both (n,), 0 if unknown.

    The significance of a single mean follows from the number of independent ones (Sidak), at most that of vertices.
    """
    known = std > 0.0
    tests = max(min(TESTS_PER_REGION / region, 1.0) * known.sum(), 1.0)
    scores = np.divide(means, std, out=np.zeros_like(means), where=known)
    threshold = -float(ndtri(-0.5 * np.expm1(np.log1p(-FALSE_ALARM) / tests)))
    rows, found = adjacency.vertices, []
    graph = csr_array((np.ones(len(rows.indices), np.bool_), rows.indices, rows.indptr), shape=(len(means), len(means)))
    for side in (1.0, -1.0):
        beyond = np.flatnonzero(side * scores > threshold)
        count, labels = connected_components(graph[beyond][:, beyond], directed=False)
        for label in range(count):
            vertices = beyond[labels == label]
            worst = int(vertices[np.argmax(np.abs(scores[vertices]))])
            p_value = -np.expm1(tests * np.log1p(-2.0 * ndtr(-abs(scores[worst]))))
            found.append(
                DeviatingRegion(
                    vertices.astype(np.int32),
                    worst,
                    places[worst],
                    float(means[worst]),
                    float(std[worst]),
                    float(p_value),
                )
            )
    return tuple(sorted(found, key=lambda one: -abs(scores[one.vertex])))
