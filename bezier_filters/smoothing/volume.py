"""Volumes of the closed components of a mesh, and how to keep them."""

from dataclasses import dataclass
from math import sqrt

import numpy as np
from numpy.polynomial.polynomial import polyder, polyval, polyvander
from scipy.sparse import csr_array

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.meshes.adjacency import Adjacency, closed_components, longest_edges
from bezier_filters.meshes.frames import face_normal
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.meshes.triangles import area_vectors
from bezier_filters.runtime.jit import jit

STEPS = (-1.0, 0.0, 1.0, 2.0)  # times the moves of vertices, at which volumes tell the polynomial that they follow
NEWTON_STEPS = 6  # of Newton's method; that polynomial is nearly linear
LOST = 0.05  # part of its volume by which a component with its volume restored may still differ
FLAT = 1e-9  # where the vector area around a vertex is so small a part of the area, there is no outside


@dataclass(frozen=True)
class ClosedComponents:
    """Connected components without a border."""

    of_vertex: IntArray  # (n,): number of the closed component that a vertex belongs to, -1 for others
    origins: FloatArray  # (c, 3): a point of each: its first vertex

    @staticmethod
    def of(mesh: TriangleMesh, adjacency: Adjacency) -> "ClosedComponents":
        """Those of a mesh in memory."""
        of_vertex, first = closed_components(mesh, adjacency)
        return ClosedComponents(of_vertex, mesh.vertices[first])

    @property
    def count(self) -> int:
        """How many there are."""
        return len(self.origins)

    def sums(self, component: IntArray, values: FloatArray) -> FloatArray:
        """Sums of values over each component, (c,), from the number of that of each value."""
        return np.bincount(component + 1, values, self.count + 1)[1:].astype(np.float64)


def component_volumes(components: ClosedComponents, mesh: TriangleMesh) -> FloatArray:
    """Volume of every closed component, (c,), positive if its normals point outwards.

    Those of some of the faces add up to that of all.

    >>> from bezier_filters.meshes.adjacency import vertex_adjacency
    >>> from bezier_filters.meshes.mesh import triangle_mesh
    >>> from bezier_filters.surfaces import block_with_sharp_edges
    >>> block = triangle_mesh(*block_with_sharp_edges(resolution=4))
    >>> component_volumes(ClosedComponents.of(block, vertex_adjacency(block)), block)
    array([0.875])
    """
    volumes = np.zeros(components.count)
    _add_volumes(mesh.vertices, mesh.faces, components.of_vertex, components.origins, volumes)
    return volumes


def restore_volumes(
    components: ClosedComponents, mesh: TriangleMesh, volumes: FloatArray, amounts: FloatArray
) -> FloatArray:
    """Coordinates after moves along the normals, in proportion to amounts (n,), that give components volumes (c,).

    A component whose amounts are all 0 stays as it is.
    """
    moves = outward_moves(mesh, amounts)
    steps = steps_to(volumes, volumes_along(components, mesh, moves))
    return moved_by(components, mesh.vertices, steps, moves)


def unlike_before(components: ClosedComponents, mesh: TriangleMesh, smoothed: TriangleMesh, sigma: float) -> BoolArray:
    """Which vertices belong to components whose volume could not be restored, (n,): boxes of few faces mostly.

    What is thinner than noise of standard deviation `sigma`, such as both sides of a sheet, has no volume to speak of.
    """
    before, after = component_volumes(components, mesh), component_volumes(components, smoothed)
    is_unlike = np.abs(after - before) > LOST * np.abs(before)
    if not is_unlike.any():
        return np.zeros(mesh.vertex_count, dtype=np.bool_)
    areas = 0.5 * np.linalg.norm(area_vectors(mesh.vertices, mesh.faces), axis=1)
    area = components.sums(components.of_vertex[mesh.faces[:, 0]], areas)
    return np.append(is_unlike & (np.abs(before) > sigma * area), False)[components.of_vertex]


def outward_moves(mesh: TriangleMesh, amounts: FloatArray) -> FloatArray:
    """Moves of amounts (n,) along the normals, (n, 3), by which the volume grows fastest; 0 where there is no outside.

    That is where the faces around a vertex cancel, as those of both sides of a sheet do.
    """
    gradient, areas = np.zeros_like(mesh.vertices), np.zeros(mesh.vertex_count)
    _add_gradient(mesh.vertices, mesh.faces, gradient, areas)
    lengths = np.sqrt(np.einsum("ij,ij->i", gradient, gradient))
    factors = np.divide(amounts, lengths, out=np.zeros(len(lengths)), where=lengths > FLAT * areas)
    gradient *= factors[:, np.newaxis]
    return gradient


def volumes_along(components: ClosedComponents, mesh: TriangleMesh, moves: FloatArray) -> FloatArray:
    """Volumes of components after `STEPS` times the moves (n, 3) of their vertices, (c, 4).

    Those of some of the faces add up to that of all.
    """
    moved = (TriangleMesh(mesh.vertices + step * moves, mesh.faces) for step in STEPS)
    return np.column_stack([component_volumes(components, one) for one in moved])


def steps_to(volumes: FloatArray, along: FloatArray) -> FloatArray:
    """How many times its moves every component has to go for its volume, (c,), from `volumes_along`.

    The volume is a polynomial of degree 3 in the step, which four values tell, and Newton's method finds the step.
    Nothing moves farther than once its moves: where that does not give the volume, faces nearly cancel, as those of a
    double sheet do, and there is none to restore.

    >>> steps_to(np.array([1.331]), np.array([[0.0, 1.0, 8.0, 27.0]])).round(6)  # of a cube that grows
    array([0.1])
    """
    cubic = np.linalg.solve(polyvander(STEPS, 3), along.T)
    slope, steps = polyder(cubic), np.zeros(len(volumes))
    for _ in range(NEWTON_STEPS):
        gained = polyval(steps, slope, tensor=False)
        wanted = volumes - polyval(steps, cubic, tensor=False)
        steps += np.divide(wanted, gained, out=np.zeros(len(volumes)), where=gained > 0.0)
        steps = np.clip(steps, -1.0, 1.0)
    return steps


def moved_by(components: ClosedComponents, points: FloatArray, steps: FloatArray, moves: FloatArray) -> FloatArray:
    """Vertices after as many of their moves (n, 3) as the step of their component is, (c,)."""
    result: FloatArray = points + np.append(steps, 0.0)[components.of_vertex][:, np.newaxis] * moves
    return result


def movement_around(mesh: TriangleMesh, adjacency: Adjacency, points: FloatArray) -> FloatArray:
    """How far the surroundings of a vertex have moved, (n,), lengths; by its longest edge at most."""
    rows, n = adjacency.vertices, mesh.vertex_count
    neighbours = csr_array((np.ones(len(rows.indices), np.float32), rows.indices, rows.indptr), shape=(n, n))
    moves = points - mesh.vertices
    squares = np.einsum("ij,ij->i", moves, moves)
    means: FloatArray = np.sqrt((neighbours @ squares + squares) / (rows.lengths + 1.0))
    bounded: FloatArray = np.minimum(means, longest_edges(mesh, adjacency))
    return bounded


@jit()
def _add_volumes(
    vertices: FloatArray, faces: IntArray, part: IntArray, origins: FloatArray, volumes: FloatArray
) -> None:
    """Add the tetrahedra between faces and a point of their part, so that nothing cancels out far from the origin."""
    for f in range(len(faces)):
        a = faces[f, 0]
        k = part[a]
        if k >= 0:
            x, y, z = face_normal(vertices, faces, f)
            dx, dy, dz = vertices[a, 0] - origins[k, 0], vertices[a, 1] - origins[k, 1], vertices[a, 2] - origins[k, 2]
            volumes[k] += (dx * x + dy * y + dz * z) / 6.0


@jit()
def _add_gradient(vertices: FloatArray, faces: IntArray, gradient: FloatArray, areas: FloatArray) -> None:
    """Add the derivative of the volume by every vertex: a third of the vector area around it. Areas are thirds, too."""
    for f in range(len(faces)):
        x, y, z = face_normal(vertices, faces, f)
        area = sqrt(x * x + y * y + z * z) / 6.0
        for k in range(3):
            i = faces[f, k]
            gradient[i, 0] += x / 6.0
            gradient[i, 1] += y / 6.0
            gradient[i, 2] += z / 6.0
            areas[i] += area
