"""Methods to fill a hole, which of their attempts is taken, and in which order holes that may meet are filled.

A further method to fill holes is a function of a task, and a line in the table.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from math import degrees
from typing import Literal

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.holes.crease_fill import crease_attempts
from bezier_filters.holes.hole_detection import Hole
from bezier_filters.holes.influence_region import InfluenceRegion, KnownSurface, vertex_pairs
from bezier_filters.holes.planar_fill import Correction, paper_fill
from bezier_filters.holes.polyharmonic_fairing import polyharmonic_continuation
from bezier_filters.holes.smooth_fill import Attempt, smooth_attempts
from bezier_filters.meshes.adjacency import Rows
from bezier_filters.meshes.half_edges import dihedral_angles, half_edge_lists, normals_along
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.meshes.self_intersections import cut_faces, faces_in_boxes
from bezier_filters.meshes.unit_size import LENGTH

FillingMethod = Literal["auto", "paper"]

BULGE = 0.5  # times the diameter of a hole: how far its fill may leave the bounding box of the rim
CUTTING = "every fill would cut other faces, intersecting=True takes the one that cuts least"
LIMITED = "its triangles stay larger than those around it, as there would be too many"
# faces that cut others, the same as a share of all, and rings around them, up to which a fill is flattened there
MOST_FREED, LARGEST_SHARE, RINGS_FREED = 16, 0.04, 4


@dataclass(frozen=True)
class HoleReport:
    """A hole and its fill.

    Attributes
    ----------
    rim : (k,) int32
        Vertices of the rim, in the direction of the faces that fill the hole; ascending where that is unclear.
    islands : int
        Separate sheets within the hole, which the fill is joined to.
    edge_count : int
        Edges of the rim, and of those of the islands.
    perimeter : float
        Their length.
    diameter : float
        Largest distance between two vertices of the rim, a length.
    is_outer_rim : bool
        Whether this is where an open sheet ends, rather than a hole in it.
    filled : bool
        Whether the hole was filled; otherwise `reason` says why not, and nothing of it was changed.
    method : str
        ``"surface"``: triangles on the surface that continues the points and normals around the hole.
        ``"creases"``: sharp edges were continued through the hole, and its parts filled like that.
        ``"variational"``: no such surface; a fill without tension. ``"flat"``: triangles between the
        vertices of the rim, and some more in between, of little area. ``"paper"``: the paper's patch, or one for each
        part. Empty if open.
    reason : str
        Why the hole was left open, why better methods were not used, or that triangles stay larger than those around
        the hole as there would be too many; empty if there is nothing to say.
    parts : int
        Sub-holes that creases cut the hole into, 1 without creases, 0 if it was left open.
    creases : (e, 2) int32
        Edges of the new mesh, within the hole, that are creases.
    new_vertices, new_faces : range
        Rows of the result that belong to the fill. Outer rims are filled last: theirs are the last rows.
    rim_error : float
        Largest distance between a rim vertex before and after: 0.
    rim_dihedral : float
        Mean angle between the faces on both sides of the rim, in degrees.
    self_intersections : int
        New faces that cut another face; if all fills have such and the hole was left open, those of the best.
    """

    rim: IntArray
    islands: int
    edge_count: int
    perimeter: float = field(metadata=LENGTH)
    diameter: float = field(metadata=LENGTH)
    is_outer_rim: bool
    filled: bool = False
    method: str = ""
    reason: str = ""
    parts: int = 0
    creases: IntArray = field(default_factory=lambda: np.empty((0, 2), dtype=np.int32))
    new_vertices: range = range(0)
    new_faces: range = range(0)
    rim_error: float = field(default=0.0, metadata=LENGTH)
    rim_dihedral: float = 0.0
    self_intersections: int = 0


@dataclass(frozen=True)
class OpenMesh:
    """A mesh with the holes that are to be filled, and what is known for that."""

    mesh: TriangleMesh
    known: KnownSurface  # with the region of each hole, in the order in which fills give way to earlier ones
    reports: list[HoleReport]  # of these holes, still open
    boxes: FloatArray  # (h, 2, 3): lowest and highest corner of the box that each fill must not leave
    meeting: Rows  # boxes that each box meets, itself among them
    near: Rows  # faces of the mesh in each box
    method: FillingMethod
    creases: bool  # whether creases are continued
    intersecting: bool  # whether fills may cut other faces, if all do
    # for ``"paper"``
    alpha: float  # weight of the points
    correction: Correction  # how patches are made to end at the rim
    refine: bool  # whether there are new vertices between those of the rim


@dataclass(frozen=True)
class FillTask:
    """A hole to fill."""

    mesh: OpenMesh
    region: InfluenceRegion  # what surrounds it
    normals: FloatArray  # (b, 3): unit normals of the vertices of the region, zero where they are not known
    noisy: bool  # whether these vertices have errors that should not be followed


def _automatic(task: FillTask) -> Iterator[Attempt]:
    """With the creases that run into the hole, if there are any, or else smooth, in ever simpler ways."""
    if task.mesh.creases:
        yield from crease_attempts(task.region, noisy=task.noisy)
    yield from smooth_attempts(task.region, task.normals, noisy=task.noisy)


def _paper(task: FillTask) -> Iterator[Attempt]:
    """In the paper's way: a patch for each part that creases cut the hole into, or one patch; or else smooth."""
    mesh = task.mesh
    fill_part = partial(paper_fill, alpha=mesh.alpha, correction=mesh.correction, refined=mesh.refine)
    if mesh.creases:
        for attempt in crease_attempts(task.region, noisy=task.noisy, fill_part=fill_part):
            yield replace(attempt, kind="paper")
    fill = fill_part(task.region)
    yield Attempt("paper", None, fill) if isinstance(fill, str) else Attempt("paper", fill)
    yield from smooth_attempts(task.region, task.normals, noisy=task.noisy)


# what each one tries, the best first: the first fill that cuts nothing is taken
FILL_METHODS: dict[FillingMethod, Callable[[FillTask], Iterator[Attempt]]] = {"auto": _automatic, "paper": _paper}


@dataclass(frozen=True)
class FaceSet:
    """Some faces of a mesh with their vertices."""

    ids: IntArray  # (k,): the vertices, by their rows in the mesh that results; one may be there several times
    points: FloatArray  # (k, 3): their coordinates
    faces: IntArray  # (m, 3): places in `ids`


def hole_box(mesh: TriangleMesh, hole: Hole) -> tuple[FloatArray, FloatArray]:
    """Lowest and highest corner of the box that a fill must not leave, each (3,)."""
    rim = mesh.vertices[np.concatenate(hole.loops)]
    return rim.min(axis=0) - BULGE * hole.diameter, rim.max(axis=0) + BULGE * hole.diameter


def meeting_boxes(boxes: FloatArray) -> Rows:
    """Numbers, ascending, of the boxes (h, 2, 3) that each of them meets."""
    faces = np.arange(2 * len(boxes), dtype=np.int32).reshape(-1, 2)[:, [0, 1, 1]]  # from corner to corner of each
    return faces_in_boxes(boxes.reshape(-1, 3), faces, boxes[:, 0], boxes[:, 1])


def groups_of_boxes(boxes: FloatArray) -> list[IntArray]:
    """Numbers, ascending, of boxes (h, 2, 3) that meet, directly or by way of others.

    Fills of holes whose boxes do not meet do not depend on each other.

    >>> boxes = np.array([[0.0, 1.0], [5.0, 6.0], [1.0, 2.0]])[:, :, np.newaxis] * np.ones(3)
    >>> [group.tolist() for group in groups_of_boxes(boxes)]
    [[0, 2], [1]]
    """
    met = meeting_boxes(boxes)
    graph = csr_array((np.ones(len(met.indices)), met.indices, met.indptr), shape=(len(boxes), len(boxes)))
    count, group = connected_components(graph, directed=False)
    by_group = np.argsort(group, kind="stable")
    return np.split(by_group, np.searchsorted(group[by_group], np.arange(1, count)))


def fill_group(task: OpenMesh, group: Iterable[int]) -> list[tuple[HoleReport, FaceSet | None]]:
    """Fill some holes of a mesh, given by ascending numbers, each given that the earlier ones are filled.

    New vertices are numbered on from those of the mesh and of earlier holes. Of the rows of the result, reports know
    the creases only, by their places in the fill.
    """
    placed: dict[int, FaceSet] = {}
    joined: dict[int, IntArray] = {}  # pairs of vertices of the mesh that each fill joins
    result = []
    next_vertex = task.mesh.vertex_count
    for number in group:
        region, meeting = task.known.regions[number], [k for k in task.meeting.row(number).tolist() if k in placed]
        if meeting:
            region = region.with_joined(np.concatenate([joined[k] for k in meeting]))
        hole = FillTask(task, region, task.known.normals[region.ids], region.is_noisy(task.known.noise))
        report, fill = _first_without_cuts(hole, number, [placed[k] for k in meeting], next_vertex)
        result.append((report, fill))
        if fill is not None:
            placed[number] = fill
            next_vertex += len(fill.ids) - region.rim_count
            joined[number] = vertex_pairs(fill.ids[fill.faces], task.mesh.vertex_count)
    return result


def _first_without_cuts(
    hole: FillTask, number: int, meeting: Sequence[FaceSet], next_vertex: int
) -> tuple[HoleReport, FaceSet | None]:
    """The first attempt that cuts nothing, or else none; if fills may cut others, the first of those that cut least."""
    task, region, report = hole.mesh, hole.region, hole.mesh.reports[number]
    low, high = task.boxes[number]
    ids = task.mesh.faces[task.near.row(number)].ravel()
    of_mesh = FaceSet(ids, task.mesh.vertices[ids], np.arange(len(ids), dtype=np.int32).reshape(-1, 3))
    least, taken, placed = 0, None, None  # faces that cut others, in the best attempt so far and its place in the mesh
    reasons: list[tuple[Attempt, str]] = []
    for attempt in FILL_METHODS[task.method](hole):
        fill, problem = attempt.fill, attempt.reason
        if fill is not None and not np.isfinite(fill.points).all():
            problem = "coordinates are not finite"
        elif fill is not None and not ((fill.points >= low) & (fill.points <= high)).all():
            problem = "bulges too far from the rim"
        elif fill is not None:
            new = np.arange(next_vertex, next_vertex + len(fill.points) - fill.rim_count)
            faces = FaceSet(np.concatenate([region.ids[: fill.rim_count], new]), fill.points, fill.faces)
            faces, cuts = _with_fewer_cuts(faces, region.rim_count, [of_mesh, *meeting])
            if taken is None or cuts < least:  # of equals the earlier: methods come best first
                least, taken, placed = cuts, attempt, faces
            if cuts == 0:
                break
            problem = f"{cuts} of its faces would cut others"
        reasons.append((attempt, f"{attempt.kind}: {problem}"))
    if taken is None or placed is None or (least and not task.intersecting):
        told = [CUTTING] if least else []
        told += [text for _, text in reasons]
        return replace(report, reason="; ".join(dict.fromkeys(told)), self_intersections=least), None
    told = [text for attempt, text in reasons if attempt is not taken]
    if taken.fill is not None and taken.fill.is_limited:
        told.append(f"{LIMITED} ({len(placed.faces)} new faces)")
    if least:
        told.append(f"{taken.kind}: taken, though {least} of its faces cut others, the fewest")
    return replace(
        report,
        filled=True,
        method=taken.kind,
        reason="; ".join(dict.fromkeys(told)),
        parts=taken.parts,
        creases=report.creases if taken.creases is None else taken.creases,
        rim_error=float(np.abs(placed.points[: region.rim_count] - region.rim_vertices).max()),
        rim_dihedral=_rim_dihedral(placed, region),
        self_intersections=least,
    ), placed


def _with_fewer_cuts(placed: FaceSet, rim_count: int, others: Sequence[FaceSet]) -> tuple[FaceSet, int]:
    """A fill, and how many of its faces cut others; where they are few, flattened around them if that frees them.

    Around means with so many rings: the vertices there go to where they are harmonic.
    """
    is_cut = _cuts(placed, others)
    if not 0 < np.count_nonzero(is_cut) <= min(MOST_FREED, LARGEST_SHARE * len(is_cut)):
        return placed, int(np.count_nonzero(is_cut))
    near: BoolArray = is_cut
    for _ in range(RINGS_FREED):
        moving = np.unique(placed.faces[near])
        moving = moving[moving >= rim_count]
        order = np.concatenate([np.setdiff1d(np.arange(len(placed.points)), moving), moving])
        points = placed.points.copy()
        faces = np.argsort(order)[placed.faces].astype(np.int32)
        points[order] = polyharmonic_continuation(points[order], faces, points[order[: len(order) - len(moving)]])
        freed = replace(placed, points=points)
        if not _cuts(freed, others).any():
            return freed, 0
        near = np.asarray(np.isin(placed.faces, placed.faces[near]).any(axis=1))
    return placed, int(np.count_nonzero(is_cut))


def _cuts(placed: FaceSet, others: Sequence[FaceSet]) -> BoolArray:
    """Which faces of a fill cut one of the others or each other."""
    sets = (*others, placed)
    first = np.cumsum([0, *(len(part.points) for part in others)], dtype=np.int32)
    faces = np.concatenate([part.faces + start for part, start in zip(sets, first, strict=True)])
    names = np.concatenate([part.ids[part.faces] for part in sets])
    return cut_faces(np.concatenate([part.points for part in sets]), faces, len(placed.faces), names)


def _rim_dihedral(fill: FaceSet, region: InfluenceRegion) -> float:
    """Mean angle between the faces on both sides of the rim, in degrees."""
    lists = half_edge_lists(fill.faces, len(fill.points))
    own = [normals_along(fill.points, fill.faces, lists, loop, beyond=False) for loop in region.loops]
    beyond = [region.normals_beyond(loop) for loop in region.loops]
    return degrees(float(dihedral_angles(np.concatenate(own), np.concatenate(beyond)).mean()))
