"""Volumes of closed parts of a mesh, and how to keep them."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.meshes.frames import face_normal
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.runtime.lean import lean_njit
from bezier_filters.smoothing.pieces import Arrays, ClosedParts, Domain, Handle, Outcome, Piece

ROUNDS = 4
"""Of Newton's method; the volume is a polynomial that is nearly linear in a small offset."""
EXACT = 1e-14
"""Relative error at which it ends early."""


@dataclass(frozen=True)
class Volumes:
    """What the closed parts enclose, and what they would gain by moving out."""

    origins: FloatArray
    rings: int = 1

    def __call__(self, piece: Piece, inputs: Mapping[str, Arrays]) -> Outcome:
        """Sums over the parts."""
        part = inputs["parts"]["part"]
        mesh = TriangleMesh(inputs["points"]["points"], piece.mesh.faces) if "points" in inputs else piece.mesh
        volumes = np.zeros(mesh.vertex_count)
        _add_volumes(mesh.vertices, mesh.faces, part, self.origins, volumes)
        sums = {"volume": (part, volumes)}
        if "amounts" in inputs:
            _, lengths = _gradient(mesh)
            sums["gained"] = part, lengths * inputs["amounts"]["amounts"]
        return Outcome(part_sums=sums)


@dataclass(frozen=True)
class Offsets:
    """Moves vertices along their normals, in proportion to their amounts."""

    steps: FloatArray
    """Of the parts, (parts,)."""
    rings: int = 1

    def __call__(self, piece: Piece, inputs: Mapping[str, Arrays]) -> Outcome:
        """Coordinates (n, 3)."""
        points, part, amounts = inputs["points"]["points"], inputs["parts"]["part"], inputs["amounts"]["amounts"]
        gradient, lengths = _gradient(TriangleMesh(points, piece.mesh.faces))
        steps = np.where(part >= 0, self.steps[part], 0.0) * amounts
        factors = np.divide(steps, lengths, out=np.zeros(len(part)), where=lengths > 0.0)
        return Outcome(vertices={"points": points + factors[:, np.newaxis] * gradient})


@dataclass(frozen=True)
class Amounts:
    """How far the surroundings of a vertex have moved."""

    rings: int = 1

    def __call__(self, piece: Piece, inputs: Mapping[str, Arrays]) -> Outcome:
        """Amounts (n,), lengths; 0 for vertices that stay."""
        rows, n = piece.adjacency.vertices, piece.mesh.vertex_count
        neighbours = csr_array((np.ones(len(rows.indices), np.float32), rows.indices, rows.indptr), shape=(n, n))
        moves = inputs["points"]["points"] - piece.mesh.vertices
        squares = np.einsum("ij,ij->i", moves, moves)
        amounts = np.sqrt((neighbours @ squares + squares) / (rows.lengths + 1.0)) * inputs["movable"]["movable"]
        return Outcome(vertices={"amounts": amounts})


def part_volumes(domain: Domain, parts: ClosedParts, **points: Handle) -> FloatArray:
    """Volume of every closed part, positive if its normals point outwards; with its vertices elsewhere, if given.

    Examples
    --------
    >>> from bezier_filters.meshes.adjacency import vertex_adjacency
    >>> from bezier_filters.meshes.mesh import triangle_mesh
    >>> from bezier_filters.surfaces import block_with_sharp_edges
    >>> from bezier_filters.smoothing.whole_mesh import WholeMesh
    >>> block = triangle_mesh(*block_with_sharp_edges(resolution=4))
    >>> domain = WholeMesh(block, vertex_adjacency(block))
    >>> part_volumes(domain, domain.closed_parts())
    array([0.875])
    """
    found = domain.run(Volumes(parts.origins), parts=parts.of_vertex, part_count=parts.count, **points)
    return found.sums["volume"]


def with_volumes(domain: Domain, parts: ClosedParts, volumes: FloatArray, points: Handle, amounts: Handle) -> Handle:
    """Move vertices along their normals, in proportion to given amounts, so that closed parts have given volumes.

    Parameters
    ----------
    domain : Domain
    parts : ClosedParts
        Of the same mesh.
    volumes : (parts,) float64
        What the parts are to enclose.
    points : Handle
        "points" (n, 3), where the vertices are.
    amounts : Handle
        "amounts" (n,), at least 0. A part whose amounts are all 0 stays as it is.

    Returns
    -------
    Handle
        "points" (n, 3).
    """
    inputs = {"parts": parts.of_vertex, "amounts": amounts}
    for _ in range(ROUNDS):
        sums = domain.run(Volumes(parts.origins), part_count=parts.count, points=points, **inputs).sums
        wanted, gained = volumes - sums["volume"], sums["gained"]
        if not (np.abs(wanted) > EXACT * np.abs(volumes)).any():
            break
        steps = np.divide(wanted, gained, out=np.zeros(parts.count), where=gained > 0.0)
        points = domain.run(Offsets(steps), points=points, **inputs).vertices
    return points


def _gradient(mesh: TriangleMesh) -> tuple[FloatArray, FloatArray]:
    """Derivative of the volume by every vertex, (n, 3), and its length, (n,)."""
    gradient = np.zeros_like(mesh.vertices)
    _add_gradient(mesh.vertices, mesh.faces, gradient)
    return gradient, np.sqrt(np.einsum("ij,ij->i", gradient, gradient))


@lean_njit()
def _add_volumes(
    vertices: FloatArray, faces: IntArray, part: IntArray, origins: FloatArray, volumes: FloatArray
) -> None:
    """Add the tetrahedra between faces and a point of their part, so that nothing cancels out far from the origin.

    Those of a face are added at its first corner.
    """
    for f in range(len(faces)):
        a = faces[f, 0]
        k = part[a]
        if k >= 0:
            x, y, z = face_normal(vertices, faces, f)
            dx, dy, dz = vertices[a, 0] - origins[k, 0], vertices[a, 1] - origins[k, 1], vertices[a, 2] - origins[k, 2]
            volumes[a] += (dx * x + dy * y + dz * z) / 6.0


@lean_njit()
def _add_gradient(vertices: FloatArray, faces: IntArray, gradient: FloatArray) -> None:
    """Add the derivative of the volume by every vertex: a third of the vector area around it."""
    for f in range(len(faces)):
        x, y, z = face_normal(vertices, faces, f)
        for k in range(3):
            i = faces[f, k]
            gradient[i, 0] += x / 6.0
            gradient[i, 1] += y / 6.0
            gradient[i, 2] += z / 6.0
