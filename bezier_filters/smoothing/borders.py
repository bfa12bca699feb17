"""Moves of border vertices: along the normal of the surface as others, and across the border by its own noise only.

The noise of a border within the surface is not that along the normal: maps of heights have none there, and borders of
scans are ragged. A filter that suits the surface would round their corners. So the border has its own filter there, a
weak one, and a move d by it is shrunk to d times s^2 / (mean of d^2 nearby), where s is the standard deviation of the
noise across the border: moves that remove noise are kept, larger ones would change the shape (as a Wiener filter).
"""

from typing import NamedTuple

import numpy as np

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.meshes.frames import smooth_normals
from bezier_filters.meshes.half_edges import border_edges
from bezier_filters.meshes.prepared_mesh import PreparedMesh
from bezier_filters.noise.outliers import NORMAL_MEDIAN_DEVIATION
from bezier_filters.sampling.mesh_parts import MeshPart

SECOND_DIFFERENCE_DEVIATION = np.sqrt(1.5)  # of x less the mean of two neighbours, for independent noise of variance 1
BORDER_AVERAGES = 4  # means over the neighbours on the border, so over some five edges


class _Border(NamedTuple):
    """The vertices on the border, and its directed edges."""

    vertices: IntArray  # (b,): in ascending order
    # (e,): places of their ends in `vertices`
    starts: IntArray
    ends: IntArray

    def neighbour_means(self, values: FloatArray) -> FloatArray:
        """Means of values (b, c) over the neighbours on the border."""
        sums, counts = np.zeros_like(values), np.zeros(len(values))
        for here, there in ((self.starts, self.ends), (self.ends, self.starts)):
            np.add.at(sums, here, values[there])
            np.add.at(counts, here, 1.0)
        result: FloatArray = sums / np.maximum(counts, 1.0)[:, np.newaxis]
        return result

    def filter(self, values: FloatArray) -> FloatArray:
        """Values (b, c) after a weak filter f = 2 s - s^2 of means s along the border, which keeps its curvature."""
        once = self.smooth(values)
        return np.asarray(once + self.smooth(values - once))

    def smooth(self, values: FloatArray) -> FloatArray:
        """Means (b, c) of values over some five vertices."""
        for _ in range(BORDER_AVERAGES):
            values = 0.5 * (values + self.neighbour_means(values))
        return values

    def conormals(self, points: FloatArray, normals: FloatArray) -> FloatArray:
        """Unit vectors across the border within the surface, (b, 3), by its points and normals (b, 3)."""
        along = np.zeros_like(points)
        for here in (self.starts, self.ends):
            np.add.at(along, here, points[self.ends] - points[self.starts])
        vectors = np.cross(normals, along)
        return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), np.finfo(float).tiny))


def learn_border_noise(part: MeshPart, sigma: float) -> float:
    """Standard deviation of the noise across the border, within the surface, a length; at most `sigma`.

    It is the median of the distances from the mean of both neighbours, over that of normal noise.
    """
    mesh, border = part.mesh, _locate(part.mesh)
    is_known = (part.core & ~part.cut)[border.vertices]
    if not is_known.any():
        return 0.0
    points = mesh.vertices[border.vertices]
    bends = points - border.neighbour_means(points)
    distances = np.einsum("ij,ij->i", bends, border.conormals(points, mesh.planes.normals[border.vertices]))[is_known]
    found = np.median(np.abs(distances)) / (NORMAL_MEDIAN_DEVIATION * SECOND_DIFFERENCE_DEVIATION)
    return min(float(found), sigma)


def project_border_moves(mesh: PreparedMesh, points: FloatArray) -> FloatArray:
    """Points (n, 3) of a cloud, whose border points move along the mean normals around them.

    The border is ragged, but not by noise, and has narrow triangles, whose normals are uncertain.
    """
    rows, result, at = mesh.adjacency.vertices, points.copy(), mesh.adjacency.on_boundary
    no_barriers = np.zeros(mesh.vertex_count, dtype=np.bool_)
    normals = smooth_normals(mesh.move(points).planes.normals, rows.indptr, rows.indices, no_barriers)
    result[at] = mesh.vertices[at] + _project(points[at] - mesh.vertices[at], normals[at])
    return result


def restrict_borders(mesh: PreparedMesh, points: FloatArray, sigma: float, *, slides: bool) -> FloatArray:
    """Points (n, 3) whose border vertices move along the normal, and across the border by noise of `sigma`, a length.

    Along the border they move only if all vertices slide.
    """
    border = _locate(mesh)
    if not len(border.vertices):
        return points
    result, at = points.copy(), border.vertices
    moves = points[at] - mesh.vertices[at]
    normals = mesh.move(points).planes.normals[at]
    upward = _project(moves, normals)
    within = border.filter(mesh.vertices[at]) - mesh.vertices[at]
    within = within - _project(within, normals) if slides else _project(within, border.conormals(points[at], normals))
    around = np.square(within).sum(axis=1, keepdims=True)
    around = border.smooth(around)
    share = np.minimum(sigma**2 / np.maximum(around, np.finfo(np.float64).tiny), 1.0)
    result[at] = mesh.vertices[at] + upward + share * within
    return result


def _project(moves: FloatArray, normals: FloatArray) -> FloatArray:
    """Components of moves along normals, both (b, 3)."""
    return np.asarray(np.einsum("ij,ij->i", moves, normals)[:, np.newaxis] * normals)


def _locate(mesh: PreparedMesh) -> _Border:
    found = border_edges(mesh, mesh.adjacency.on_boundary)
    vertices, places = np.unique(np.concatenate([found.start, found.end]), return_inverse=True)
    starts, ends = places.astype(np.int32).reshape(2, -1)
    return _Border(vertices.astype(np.int32), starts, ends)
