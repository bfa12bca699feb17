"""Fills of holes that may meet are found one after the other; groups of such holes do not depend on each other."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.holes.contrasts import WorkSpace
from bezier_filters.holes.fill_methods import Attempt, crease_attempts, paper_attempts, smooth_attempts
from bezier_filters.holes.fill_placement import Piece, count_cuts, piece_of_mesh, placed, problem_with, rim_dihedral
from bezier_filters.holes.hole_surroundings import is_noisy
from bezier_filters.holes.surroundings import Surroundings, with_joined
from bezier_filters.meshes.adjacency import Rows
from bezier_filters.meshes.mesh import TriangleMesh


@dataclass(frozen=True)
class OpenMesh:
    """A mesh with the holes that are to be filled, and what is known for that.

    Attributes
    ----------
    mesh : TriangleMesh
    surroundings : sequence of Surroundings
        Of each hole, in the order in which fills give way to earlier ones.
    boxes : (h, 2, 3) float64
        Lowest and highest corner of the box that each fill must not leave.
    near : Rows
        Faces of the mesh in each box.
    normals : (n, 3) float64
        Unit normals where surfaces are fitted, zero where they are not known.
    noise : float or None
        Of the mesh, a length.
    method : str
        ``"auto"`` or ``"paper"``.
    creases : bool
        Whether creases are continued.
    alpha : float
        Weight of the points for ``"paper"``.
    """

    mesh: TriangleMesh
    surroundings: Sequence[Surroundings]
    boxes: FloatArray
    near: Rows
    normals: FloatArray
    noise: float | None
    method: str
    creases: bool
    alpha: float


@dataclass(frozen=True)
class FilledHole:
    """The attempt that was taken, as a part of the mesh; no piece if none was.

    Attributes
    ----------
    attempt, piece : Attempt or None, Piece or None
        New vertices are numbered on from those of the mesh and of earlier holes of the group.
    first_vertex : int
        Number of the first of them.
    cuts : int
        New faces that cut others.
    reason : str
        Why better attempts were not taken.
    rim_error, rim_dihedral : float
        As in `HoleReport`.
    """

    attempt: Attempt | None = None
    piece: Piece | None = None
    first_vertex: int = 0
    cuts: int = 0
    reason: str = ""
    rim_error: float = 0.0
    rim_dihedral: float = 0.0


def groups_of_boxes(boxes: FloatArray) -> list[IntArray]:
    """Numbers, ascending, of boxes (h, 2, 3) that meet, directly or by way of others.

    Examples
    --------
    >>> [group.tolist() for group in groups_of_boxes(np.array([[[0.0], [1.0]], [[5.0], [6.0]], [[1.0], [2.0]]]))]
    [[0, 2], [1]]
    """
    low, high = boxes[:, 0], boxes[:, 1]
    order = np.argsort(low[:, 0], kind="stable")
    stops = np.searchsorted(low[order, 0], high[order, 0], side="right")
    pairs = [np.empty((2, 0), dtype=np.int64)]
    for k, stop in enumerate(stops.tolist()):
        others = order[k + 1 : stop]
        met = others[((low[others] <= high[order[k]]) & (high[others] >= low[order[k]])).all(axis=1)]
        pairs.append(np.stack([np.full(len(met), order[k]), met]))
    first, second = np.hstack(pairs)
    graph = coo_matrix((np.ones(len(first)), (first, second)), shape=(len(boxes), len(boxes)))
    count, group = connected_components(graph, directed=False)
    by_group = np.argsort(group, kind="stable")
    return np.split(by_group, np.searchsorted(group[by_group], np.arange(1, count)))


def fill_group(task: OpenMesh, group: Iterable[int], work: WorkSpace, *, threads: int = 1) -> list[FilledHole]:
    """Fill some holes of a mesh, each given that the earlier ones are filled.

    Parameters
    ----------
    task : OpenMesh
    group : iterable of int
        Numbers of the holes, ascending.
    work : WorkSpace
    threads : int
        Number of threads for each hole.
    """
    mesh = task.mesh
    pieces: dict[int, Piece] = {}
    joined: dict[int, set[int]] = {}
    result = []
    next_vertex = mesh.vertex_count
    for number in group:
        around = with_joined(task.surroundings[number], joined)
        noisy = is_noisy(around, task.noise)
        known = task.normals[around.ids]
        if task.method == "paper":
            attempts = paper_attempts(around, known, task.alpha, noisy=noisy, work=work, threads=threads)
        else:
            attempts = smooth_attempts(around, known, noisy=noisy, work=work, threads=threads)
            attempts = chain(crease_attempts(around, noisy=noisy), attempts) if task.creases else attempts
        filled = _best(attempts, task, number, around, pieces, next_vertex)
        result.append(filled)
        if filled.piece is not None:
            pieces[number] = filled.piece
            next_vertex += len(filled.piece.ids) - around.rim_count
            for a, b in filled.piece.chords(mesh.vertex_count):
                joined.setdefault(a, set()).add(b)
                joined.setdefault(b, set()).add(a)
    return result


def _best(
    attempts: Iterable[Attempt],
    task: OpenMesh,
    number: int,
    around: Surroundings,
    pieces: dict[int, Piece],
    next_vertex: int,
) -> FilledHole:
    """The first attempt that cuts nothing, or else the one that cuts least."""
    mesh, (low, high) = task.mesh, task.boxes[number]
    meeting = [
        piece for k, piece in pieces.items() if (task.boxes[k, 0] <= high).all() and (task.boxes[k, 1] >= low).all()
    ]
    obstacles = [piece_of_mesh(mesh, task.near.row(number)), *meeting]
    best = FilledHole()
    reasons: list[str] = []
    for attempt in attempts:
        problem, cuts, piece = attempt.reason, 0, None
        if attempt.fill is not None:
            piece = placed(attempt.fill, around, next_vertex)
            problem = problem_with(piece, low, high)
        if piece is not None and not problem:
            cuts = count_cuts(piece, obstacles)
            if best.piece is None or cuts < best.cuts:
                best = FilledHole(attempt, piece, next_vertex, cuts)
            if cuts == 0:
                break
            problem = f"{cuts} new faces cut others"
        reasons.append(f"{attempt.method}: {problem}")
    best = replace(best, reason="; ".join(dict.fromkeys(reasons)))
    if best.attempt is None or best.attempt.fill is None or best.piece is None:
        return best
    rim = around.vertices[: around.rim_count]
    error = float(np.abs(best.piece.points[: around.rim_count] - rim).max())
    return replace(best, rim_error=error, rim_dihedral=rim_dihedral(best.attempt.fill, around))
