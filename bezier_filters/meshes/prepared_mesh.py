"""A mesh with its adjacency, and with quantities of it that several steps need, each computed once."""

from dataclasses import dataclass

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray
from bezier_filters.meshes.adjacency import Adjacency, edge_lengths, vertex_adjacency
from bezier_filters.meshes.frames import TangentPlanes, tangent_planes
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.meshes.sharp_edges import sharp_edge_vertices
from bezier_filters.runtime.cached_property import cached_property


@dataclass(frozen=True)
class PreparedMesh(TriangleMesh):
    """A mesh with its adjacency; make it with `prepare_mesh`.

    Planes, barriers and the mean edge are computed on first use and kept.

    Attributes
    ----------
    adjacency : Adjacency
        Faces and neighbours of every vertex.
    """

    adjacency: Adjacency

    @cached_property
    def planes(self) -> TangentPlanes:
        """Tangent planes of all vertices, from the normals of their faces."""
        return tangent_planes(self, self.adjacency)

    @cached_property
    def barriers(self) -> BoolArray:
        """Vertices (n,) on sharp edges, across which neighbourhoods do not extend."""
        return sharp_edge_vertices(self, self.adjacency, self.planes)

    @cached_property
    def mean_edge(self) -> float:
        """Mean length of the edges; 0 if there are none."""
        lengths = edge_lengths(self, self.adjacency)
        return float(lengths.mean()) if len(lengths) else 0.0

    def move(self, vertices: FloatArray) -> "PreparedMesh":
        """The mesh with other vertices (n, 3) and the same adjacency."""
        return PreparedMesh(vertices, self.faces, self.adjacency)


def prepare_mesh(mesh: TriangleMesh) -> PreparedMesh:
    """Find the adjacency of a mesh, unless it has one.

    >>> from bezier_filters.meshes.mesh import triangle_mesh
    >>> square = prepare_mesh(triangle_mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]]))
    >>> square.adjacency.vertices.row(1), square.planes.normals[0]
    (array([0, 2], dtype=int32), array([0., 0., 1.]))
    >>> square.move(2.0 * square.vertices).mean_edge / square.mean_edge
    2.0
    """
    return mesh if isinstance(mesh, PreparedMesh) else PreparedMesh(mesh.vertices, mesh.faces, vertex_adjacency(mesh))


def longest_edges(mesh: PreparedMesh) -> FloatArray:
    """Length of the longest edge at every vertex, (n,); 0 without any."""
    rows, longest = mesh.adjacency.vertices, np.zeros(mesh.vertex_count)
    has_edges = np.flatnonzero(rows.lengths)
    if len(has_edges):
        longest[has_edges] = np.maximum.reduceat(edge_lengths(mesh, mesh.adjacency), rows.indptr[has_edges])
    return longest


def mean_square_edges(mesh: PreparedMesh) -> FloatArray:
    """Mean squared length of the edges at every vertex, (n,); 0 without any."""
    rows, result = mesh.adjacency.vertices, np.zeros(mesh.vertex_count)
    has_edges = np.flatnonzero(rows.lengths)
    if len(has_edges):
        sums = np.add.reduceat(np.square(edge_lengths(mesh, mesh.adjacency)), rows.indptr[has_edges])
        result[has_edges] = sums / rows.lengths[has_edges]
    return result
