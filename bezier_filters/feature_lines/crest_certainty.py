"""Whether a crest line is more than what noise makes of a surface without one.

Noise that passes through fits makes lines wherever curvature is nearly constant, as on a torus. But on their sides
the curvature falls off by no more than the standard errors of what was fitted there.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import ndtr

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.estimation.vertex_geometry import VertexGeometry
from bezier_filters.feature_lines.crest_segments import CurvatureAlongLines

# standard errors by which curvature falls off beside the lines that noise makes, at most: those are found because it
# does. On tori and cylinders with noise of 0.1 to 0.3 edges 2 in 150 lines have more.
BY_CHANCE = 3.0
HEIGHT = np.sqrt(0.75)  # of an equilateral triangle over its side: a ring is so many edges wide


@dataclass(frozen=True)
class Sides:
    """Where curvature is compared with that on a line, in a neighbourhood's distance from it."""

    normals: FloatArray  # (n, 3): of the vertices
    errors: FloatArray  # (n,): standard errors of curvatures, 1/length
    reach: FloatArray  # (n,): radius of the neighbourhood of each vertex, a length
    tree: cKDTree  # of the vertices

    @staticmethod
    def of(vertices: FloatArray, geometry: VertexGeometry, edge: float) -> "Sides":
        """Those of a mesh with some mean edge."""
        reach = HEIGHT * edge * geometry.rings_used
        return Sides(geometry.normals, geometry.mean_curvature_std, reach, cKDTree(vertices))

    def certainty(self, field: CurvatureAlongLines, points: FloatArray) -> float:
        """Probability that curvature falls off on both sides of a line (k, 3), on average, by more than noise makes it.

        The mean of both sides has 3/2 of the variance of one value, as the line's own has an error, too; along the line
        errors are independent of each other every two radii of a neighbourhood.
        """
        lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
        middle = 0.5 * (points[1:] + points[:-1])
        at: IntArray = self.tree.query(middle)[1].astype(np.int32)
        error = float(np.sqrt(1.5 * np.square(self.errors[at]).mean()))
        if error == 0.0:
            return 1.0
        across, reach = field.directions[at], self.reach[at][:, np.newaxis]
        beside = [self._along(field, middle + side * reach * across, across) for side in (1.0, -1.0)]
        fall = float(np.average(field.largest[at] - 0.5 * (beside[0] + beside[1]), weights=lengths + 1e-300))
        independent = max(1.0, float(lengths.sum()) / (2.0 * float(reach.mean())))
        return float(ndtr(fall / error * np.sqrt(independent) - BY_CHANCE))

    def _along(self, field: CurvatureAlongLines, points: FloatArray, directions: FloatArray) -> FloatArray:
        """Curvature in directions (k, 3) at the vertices nearest to points (k, 3), (k,): by Euler's formula."""
        at: IntArray = self.tree.query(points)[1].astype(np.int32)
        normals = self.normals[at]
        tangents = directions - np.einsum("ij,ij->i", directions, normals)[:, np.newaxis] * normals
        squares = np.square(np.einsum("ij,ij->i", tangents, field.directions[at]))
        share = np.divide(squares, np.square(tangents).sum(axis=1), out=np.zeros(len(at)), where=squares > 0.0)
        result: FloatArray = share * field.largest[at] + (1.0 - share) * field.other[at]
        return result
