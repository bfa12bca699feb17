"""Volumes of the closed components of a mesh, and their restoration after smoothing.

The volume after t times the moves of the vertices is a cubic in t; Newton's method finds the t that restores it.
"""

from dataclasses import dataclass
from math import sqrt

import numpy as np
from numpy.polynomial.polynomial import polyder, polyval, polyvander
from scipy.sparse import csr_array

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.meshes.adjacency import closed_components
from bezier_filters.meshes.frames import face_normal
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.meshes.prepared_mesh import PreparedMesh, longest_edges
from bezier_filters.meshes.triangles import area_vectors
from bezier_filters.runtime.jit import jit

VOLUME_STEPS = (-1.0, 0.0, 1.0, 2.0)  # factors on the moves of vertices at which the cubic of the volume is evaluated
VOLUME_NEWTON_STEPS = 6  # iterations of Newton's method; the cubic is nearly linear
MAX_VOLUME_LOSS = 0.05  # largest relative difference of a restored volume
# Move of an outlier over the root mean square move of its neighbours. With six neighbours one vertex in 400 with normal
# noise moves so far (Student's t with six degrees of freedom); outwards as often as inwards, so volumes hardly change.
MIN_OUTLIER_RATIO = 5.0
FLAT_AREA_RATIO = 1e-9  # vector area around a vertex over its area, below which there is no outside


@dataclass(frozen=True)
class ClosedComponents:
    """Connected components without a border."""

    of_vertex: IntArray  # (n,): number of the closed component that a vertex belongs to, -1 for others
    origins: FloatArray  # (c, 3): a point of each: its first vertex

    @staticmethod
    def locate(mesh: PreparedMesh) -> "ClosedComponents":
        """Find the closed components of a mesh in memory."""
        of_vertex, first = closed_components(mesh, mesh.adjacency)
        return ClosedComponents(of_vertex, mesh.vertices[first])

    @property
    def count(self) -> int:
        """Number of components."""
        return len(self.origins)

    def sums(self, component: IntArray, values: FloatArray) -> FloatArray:
        """Sums of values over each component, (c,); `component` has the number of the component of each value."""
        return np.bincount(component + 1, values, self.count + 1)[1:].astype(np.float64)


def component_volumes(components: ClosedComponents, mesh: TriangleMesh) -> FloatArray:
    """Volume of every closed component, (c,), positive if its normals point outwards.

    The volumes from subsets of the faces add up to the volume from all faces.

    >>> from bezier_filters.meshes.mesh import triangle_mesh
    >>> from bezier_filters.meshes.prepared_mesh import prepare_mesh
    >>> from bezier_filters.surfaces import block_with_sharp_edges
    >>> block = prepare_mesh(triangle_mesh(*block_with_sharp_edges(resolution=4)))
    >>> component_volumes(ClosedComponents.locate(block), block)
    array([0.875])
    """
    volumes = np.zeros(components.count)
    _add_volumes(mesh.vertices, mesh.faces, components.of_vertex, components.origins, volumes)
    return volumes


def restore_volumes(
    components: ClosedComponents, mesh: TriangleMesh, volumes: FloatArray, amounts: FloatArray
) -> FloatArray:
    """Move vertices along the normals, in proportion to amounts (n,), so that components have the volumes (c,).

    A component whose amounts are all 0 does not change.
    """
    moves = outward_moves(mesh, amounts)
    steps = volume_steps(volumes, volumes_along(components, mesh, moves))
    return apply_moves(components, mesh.vertices, steps, moves)


def volume_not_restored(
    components: ClosedComponents, mesh: TriangleMesh, smoothed: TriangleMesh, sigma: float
) -> BoolArray:
    """Mask (n,) of the vertices of components whose volume could not be restored: mostly boxes of few faces.

    Components thinner than the noise of standard deviation `sigma`, as the two sides of a sheet, are exempt.
    """
    before, after = component_volumes(components, mesh), component_volumes(components, smoothed)
    is_unlike = np.abs(after - before) > MAX_VOLUME_LOSS * np.abs(before)
    if not is_unlike.any():
        return np.zeros(mesh.vertex_count, dtype=np.bool_)
    areas = 0.5 * np.linalg.norm(area_vectors(mesh.vertices, mesh.faces), axis=1)
    area = components.sums(components.of_vertex[mesh.faces[:, 0]], areas)
    return np.append(is_unlike & (np.abs(before) > sigma * area), False)[components.of_vertex]


def outward_moves(mesh: TriangleMesh, amounts: FloatArray) -> FloatArray:
    """Moves (n, 3) of amounts (n,) along the gradient of the volume; 0 where there is no outside.

    There is no outside where the vector areas of the faces around a vertex cancel, as at the two sides of a sheet.
    """
    gradient, areas = np.zeros_like(mesh.vertices), np.zeros(mesh.vertex_count)
    _add_gradient(mesh.vertices, mesh.faces, gradient, areas)
    lengths = np.sqrt(np.einsum("ij,ij->i", gradient, gradient))
    factors = np.divide(amounts, lengths, out=np.zeros(len(lengths)), where=lengths > FLAT_AREA_RATIO * areas)
    gradient *= factors[:, np.newaxis]
    return gradient


def volumes_along(components: ClosedComponents, mesh: TriangleMesh, moves: FloatArray) -> FloatArray:
    """Volumes (c, 4) of components after `VOLUME_STEPS` times the moves (n, 3) of their vertices.

    The volumes from subsets of the faces add up to the volumes from all faces.
    """
    moved = (TriangleMesh(mesh.vertices + step * moves, mesh.faces) for step in VOLUME_STEPS)
    return np.column_stack([component_volumes(components, one) for one in moved])


def volume_steps(volumes: FloatArray, along: FloatArray) -> FloatArray:
    """Factor (c,) on the moves that gives every component its volume, from `volumes_along`.

    The volume is a cubic in the factor, determined by four values; Newton's method finds the factor. It is bounded by
    -1 and 1: where this does not restore the volume, faces nearly cancel, as in a double sheet, and the volume is
    meaningless.

    >>> volume_steps(np.array([1.331]), np.array([[0.0, 1.0, 8.0, 27.0]])).round(6)  # locate a cube that grows
    array([0.1])
    """
    cubic = np.linalg.solve(polyvander(VOLUME_STEPS, 3), along.T)
    slope, steps = polyder(cubic), np.zeros(len(volumes))
    for _ in range(VOLUME_NEWTON_STEPS):
        gained = polyval(steps, slope, tensor=False)
        wanted = volumes - polyval(steps, cubic, tensor=False)
        steps += np.divide(wanted, gained, out=np.zeros(len(volumes)), where=gained > 0.0)
        steps = np.clip(steps, -1.0, 1.0)
    return steps


def apply_moves(components: ClosedComponents, points: FloatArray, steps: FloatArray, moves: FloatArray) -> FloatArray:
    """Apply the moves (n, 3) of vertices, times the factor (c,) of their component."""
    result: FloatArray = points + np.append(steps, 0.0)[components.of_vertex][:, np.newaxis] * moves
    return result


def omit_outliers(mesh: PreparedMesh, points: FloatArray) -> PreparedMesh:
    """The mesh before its vertices moved to points (n, 3), with those there that moved much farther than neighbours.

    They are outliers, whose volume is not that of the body: to restore it would move exact vertices around them.
    """
    moves = points - mesh.vertices
    squares, rows = np.einsum("ij,ij->i", moves, moves), mesh.adjacency.vertices
    around = _neighbour_sums(mesh, squares) / np.maximum(rows.lengths, 1.0)
    is_outlier = squares > MIN_OUTLIER_RATIO**2 * around
    return mesh.move(np.where(is_outlier[:, np.newaxis], points, mesh.vertices)) if is_outlier.any() else mesh


def _neighbour_sums(mesh: PreparedMesh, values: FloatArray) -> FloatArray:
    rows, n = mesh.adjacency.vertices, mesh.vertex_count
    ones = np.ones(len(rows.indices), np.float32)
    return np.asarray(csr_array((ones, rows.indices, rows.indptr), shape=(n, n)) @ values)


def local_movement(mesh: PreparedMesh, points: FloatArray) -> FloatArray:
    """Root mean square movement of a vertex and its neighbours, (n,), lengths; its longest edge at most."""
    moves = points - mesh.vertices
    squares = np.einsum("ij,ij->i", moves, moves)
    means: FloatArray = np.sqrt((_neighbour_sums(mesh, squares) + squares) / (mesh.adjacency.vertices.lengths + 1.0))
    bounded: FloatArray = np.minimum(means, longest_edges(mesh))
    return bounded


@jit()
def _add_volumes(
    vertices: FloatArray, faces: IntArray, part: IntArray, origins: FloatArray, volumes: FloatArray
) -> None:
    """Add the tetrahedra of the faces with a point of their component, to avoid cancellation far from the origin."""
    for f in range(len(faces)):
        a = faces[f, 0]
        k = part[a]
        if k >= 0:
            x, y, z = face_normal(vertices, faces, f)
            dx, dy, dz = vertices[a, 0] - origins[k, 0], vertices[a, 1] - origins[k, 1], vertices[a, 2] - origins[k, 2]
            volumes[k] += (dx * x + dy * y + dz * z) / 6.0


@jit()
def _add_gradient(vertices: FloatArray, faces: IntArray, gradient: FloatArray, areas: FloatArray) -> None:
    """Add the gradient of the volume, a third of the vector area around every vertex, and a third of its area."""
    for f in range(len(faces)):
        x, y, z = face_normal(vertices, faces, f)
        area = sqrt(x * x + y * y + z * z) / 6.0
        for k in range(3):
            i = faces[f, k]
            gradient[i, 0] += x / 6.0
            gradient[i, 1] += y / 6.0
            gradient[i, 2] += z / 6.0
            areas[i] += area
