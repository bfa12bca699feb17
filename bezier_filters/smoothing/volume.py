"""Volumes of the closed components of a mesh, and how to keep them."""

from dataclasses import dataclass
from math import sqrt

import numpy as np
from scipy.sparse import csr_array

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.meshes.adjacency import Adjacency, closed_components, longest_edges
from bezier_filters.meshes.frames import face_normal
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.meshes.triangles import area_vectors
from bezier_filters.runtime.jit import jit

NEWTON_STEPS = 4  # of Newton's method; the volume is a polynomial that is nearly linear in a small offset
LOST = 0.05  # part of its volume by which a component with its volume restored may still differ
EXACT = 1e-13  # relative error at which it ends early
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
    points = mesh.vertices
    for _ in range(NEWTON_STEPS):
        current = TriangleMesh(points, mesh.faces)
        wanted = volumes - component_volumes(components, current)
        if not (np.abs(wanted) > EXACT * np.abs(volumes)).any():
            break
        steps = offset_steps(wanted, component_gains(components, current, amounts))
        points = offset_along_normals(components, current, steps, amounts)
    return points


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


def offset_steps(wanted: FloatArray, gained: FloatArray) -> FloatArray:
    """How far components move out, times their amounts, to gain volumes (c,), from what they gain per unit.

    Nothing moves farther than its amount: where that does not give the volume, faces nearly cancel, as those of a
    double sheet do, and there is none to restore.
    """
    steps = np.divide(wanted, gained, out=np.zeros(len(wanted)), where=gained > 0.0)
    return np.clip(steps, -1.0, 1.0)


def component_gains(components: ClosedComponents, mesh: TriangleMesh, amounts: FloatArray) -> FloatArray:
    """What every component gains, per unit, by moving out in proportion to amounts at vertices, (c,)."""
    return components.sums(components.of_vertex, _gradient(mesh)[1] * amounts)


def offset_along_normals(
    components: ClosedComponents, mesh: TriangleMesh, steps: FloatArray, amounts: FloatArray
) -> FloatArray:
    """Vertices moved out by the step of their component (c,) times their amount (n,)."""
    gradient, lengths = _gradient(mesh)
    distances = np.append(steps, 0.0)[components.of_vertex] * amounts
    factors = np.divide(distances, lengths, out=np.zeros(len(lengths)), where=lengths > 0.0)
    result: FloatArray = mesh.vertices + factors[:, np.newaxis] * gradient
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


def _gradient(mesh: TriangleMesh) -> tuple[FloatArray, FloatArray]:
    """Derivative of the volume by every vertex, (n, 3), and its length, (n,), 0 where the faces around it cancel."""
    gradient, areas = np.zeros_like(mesh.vertices), np.zeros(mesh.vertex_count)
    _add_gradient(mesh.vertices, mesh.faces, gradient, areas)
    lengths = np.sqrt(np.einsum("ij,ij->i", gradient, gradient))
    return gradient, np.where(lengths > FLAT * areas, lengths, 0.0)


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
