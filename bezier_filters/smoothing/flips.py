"""Triangles that face the wrong way or have no area, and how to have no more of them."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.meshes.adjacency import Adjacency
from bezier_filters.meshes.frames import face_normal, tangent_planes
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.runtime.lean import lean_njit
from bezier_filters.runtime.parallel import RangeTask, run_in_chunks
from bezier_filters.smoothing.pieces import Arrays, Domain, Handle, Outcome, Piece

THINNEST = 1e-7
"""Twice the area over the squared longest edge, from which down a triangle counts as degenerate."""
ROUNDS = 60
"""After which everything is taken back; far more than there have ever been."""
REACH = 4
"""Edges from a face that is wrong to vertices that may be the cause."""


@dataclass(frozen=True)
class BadFaces:
    """Faces that are wrong.

    Attributes
    ----------
    flipped : (m,) bool
        More than 90 degrees away from the mean normal of the faces around.
    degenerate : (m,) bool
        Without area, practically.
    """

    flipped: BoolArray
    degenerate: BoolArray

    def new_since(self, before: "BadFaces") -> BoolArray:
        """Faces that are wrong in a way in which they were not before, (m,)."""
        result: BoolArray = (self.flipped & ~before.flipped) | (self.degenerate & ~before.degenerate)
        return result


def bad_faces(mesh: TriangleMesh, adjacency: Adjacency, *, threads: int = 1) -> BadFaces:
    """Find the wrong faces of a mesh.

    Examples
    --------
    >>> from bezier_filters.meshes.adjacency import vertex_adjacency
    >>> from bezier_filters.meshes.mesh import triangle_mesh
    >>> sliver = triangle_mesh([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]])
    >>> bad_faces(sliver, vertex_adjacency(sliver)).degenerate
    array([ True])
    """
    normals = tangent_planes(mesh, adjacency, threads=threads).normals
    flipped, degenerate = np.zeros((2, mesh.face_count), dtype=np.bool_)

    def make_task() -> RangeTask:
        return lambda start, stop: _find(mesh.vertices, mesh.faces, normals, start, stop, flipped, degenerate)

    run_in_chunks(make_task, mesh.face_count, threads=threads)
    return BadFaces(flipped, degenerate)


@lean_njit()
def _find(
    vertices: FloatArray,
    faces: IntArray,
    around: FloatArray,
    start: int,
    stop: int,
    flipped: BoolArray,
    degenerate: BoolArray,
) -> None:
    """Mark the wrong ones of faces start .. stop-1."""
    for f in range(start, stop):
        x, y, z = face_normal(vertices, faces, f)
        longest, against = 0.0, 0.0
        for k in range(3):
            i, j = faces[f, k], faces[f, (k + 1) % 3]
            squared = 0.0
            for axis in range(3):
                squared += (vertices[i, axis] - vertices[j, axis]) ** 2
            longest = max(longest, squared)
            against += x * around[i, 0] + y * around[i, 1] + z * around[i, 2]
        degenerate[f] = np.sqrt(x * x + y * y + z * z) <= THINNEST * longest
        flipped[f] = against < 0.0 and not degenerate[f]


@dataclass(frozen=True)
class NewBadFaces:
    """Faces that are wrong in a way in which they were not before."""

    rings: int = 2

    def __call__(self, piece: Piece, inputs: Mapping[str, Arrays]) -> Outcome:
        """Their corners, "chosen" (n,), the largest share that one has, and numbers of wrong faces."""
        mesh, adjacency = piece.mesh, piece.adjacency
        if "bad faces" not in piece.kept:
            piece.kept["bad faces"] = bad_faces(mesh, adjacency, threads=piece.threads)
        before = piece.kept["bad faces"]
        moved = TriangleMesh(inputs["points"]["points"], mesh.faces)
        now = bad_faces(moved, adjacency, threads=piece.threads)
        new = now.new_since(before)
        chosen = np.zeros(mesh.vertex_count, dtype=np.bool_)
        chosen[mesh.faces[new]] = True
        kinds = {
            "flipped before": before.flipped,
            "flipped after": now.flipped,
            "degenerate before": before.degenerate,
            "degenerate after": now.degenerate,
            "new": new,
        }
        # A face is counted at its first corner.
        counts = {k: np.bincount(mesh.faces[bad, 0], minlength=len(chosen)) * 1.0 for k, bad in kinds.items()}
        return Outcome(vertices={"chosen": chosen}, sums=counts, largest=_share(chosen, inputs))


@dataclass(frozen=True)
class WithNeighbours:
    """Chosen vertices and those around them."""

    rings: int = 1

    def __call__(self, piece: Piece, inputs: Mapping[str, Arrays]) -> Outcome:
        """The same and their neighbours, and the largest share that one has."""
        rows, chosen = piece.adjacency.vertices, inputs["chosen"]["chosen"].copy()
        chosen[rows.indices[np.repeat(chosen, rows.lengths)]] = True
        return Outcome(vertices={"chosen": chosen}, largest=_share(chosen, inputs))


@dataclass(frozen=True)
class TakenBack:
    """Moves of which some are taken back."""

    rings: int = 0

    def __call__(self, piece: Piece, inputs: Mapping[str, Arrays]) -> Outcome:
        """Shares of the moves (n,), and where the vertices end (n, 3)."""
        chosen, moved, vertices = inputs["chosen"]["chosen"], inputs["moved"]["points"], piece.mesh.vertices
        share = inputs["share"]["share"].copy() if "share" in inputs else np.ones(len(vertices))
        share[chosen] = np.where(share[chosen] < 0.1, 0.0, 0.5 * share[chosen])
        return Outcome(vertices={"share": share, "points": vertices + share[:, np.newaxis] * (moved - vertices)})


@dataclass(frozen=True)
class AllTakenBack:
    """The vertices where they were."""

    rings: int = 0

    def __call__(self, piece: Piece, inputs: Mapping[str, Arrays]) -> Outcome:
        """Coordinates (n, 3)."""
        return Outcome(vertices={"points": piece.mesh.vertices.copy()})


def _share(chosen: BoolArray, inputs: Mapping[str, Arrays]) -> dict[str, FloatArray]:
    """What is left of the moves of chosen vertices."""
    share = inputs["share"]["share"] if "share" in inputs else np.ones(len(chosen))
    return {"share": np.where(chosen, share, 0.0)}


def without_new_flips(domain: Domain, moved: Handle) -> Handle:
    """Take back as much of the moves of vertices, "points" (n, 3), as makes faces wrong that were not.

    Returns "points" (n, 3), where they end.
    """
    result, shares = moved, dict[str, Handle]()
    for _ in range(ROUNDS):
        found = domain.run(NewBadFaces(), points=result, **shares)
        if found.sums["new"][0] == 0.0:
            return result
        # A face whose corners are back where they were is turned by those around it: on to them.
        for _ in range(REACH):
            if found.largest["share"] > 0.0:
                break
            found = domain.run(WithNeighbours(), chosen=found.vertices, **shares)
        result = domain.run(TakenBack(), chosen=found.vertices, moved=moved, **shares).vertices
        shares = {"share": result}
    return domain.run(AllTakenBack()).vertices


def face_counts(domain: Domain, points: Handle) -> dict[str, int]:
    """Numbers of wrong faces before and after a move, and of new ones."""
    sums = domain.run(NewBadFaces(), points=points).sums
    return {name: int(values[0]) for name, values in sums.items()}
