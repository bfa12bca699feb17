"""Filling methods, the choice among their attempts, and the order in which holes with overlapping boxes are filled.

A method is a generator of attempts, the best first. The first attempt whose faces intersect no other face is used.
To add a method, write a function of a `HoleTask` and add it to `FILL_METHODS`.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from math import degrees
from typing import Literal, get_args

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.errors import InvalidParameterError
from bezier_filters.holes.band_fill import straight_attempts
from bezier_filters.holes.crease_fill import crease_attempts
from bezier_filters.holes.hole import Hole
from bezier_filters.holes.influence_region import HoleSurroundings, InfluenceRegion, vertex_pairs
from bezier_filters.holes.planar_fill import Correction, flat_fill, paper_fill
from bezier_filters.holes.polyharmonic_fairing import polyharmonic_continuation
from bezier_filters.holes.rim_planes import rim_plane
from bezier_filters.holes.smooth_fill import Attempt, membrane_attempts, smooth_attempts
from bezier_filters.meshes.adjacency import Rows
from bezier_filters.meshes.half_edges import dihedral_angles, half_edge_lists, normals_along
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.meshes.self_intersections import cut_faces, faces_in_boxes
from bezier_filters.meshes.unit_size import LENGTH
from bezier_filters.patches.patch_fit import PatchFit
from bezier_filters.runtime.cached_property import cached_property

FillingMethod = Literal["auto", "surface", "flat", "paper"]

DEFAULT_WEIGHT = 0.8  # of the points of the paper's patches against their smoothness
MAX_BULGE = 0.5  # of a fill beyond the bounding box of its rim, in diameters of the hole
INTERSECTING = "every fill would cut other faces, intersecting=True takes the one that cuts least"
SIZE_LIMITED = "its triangles stay larger than those around it, as there would be too many"
# A fill is flattened around its intersecting faces if there are at most this number and fraction of them, within at
# most this number of rings.
MAX_INTERSECTING_FACES, MAX_INTERSECTING_FRACTION, MAX_FLATTENED_RINGS = 16, 0.04, 4


@dataclass(frozen=True)
class HoleReport:
    """A hole and its fill.

    Attributes
    ----------
    rim : (k,) int32
        Vertices of the rim, in the direction of the faces that fill the hole; ascending if the border is not manifold.
    islands : int
        Number of separate sheets inside the hole, to which the fill is joined.
    edge_count : int
        Edges of the rim, and of those of the islands.
    perimeter : float
        Total length of these edges.
    diameter : float
        Largest distance between two vertices of the rim, a length.
    is_outer_rim : bool
        Whether this is the outer border of an open sheet, rather than a hole.
    filled : bool
        Whether the hole was filled; otherwise `reason` says why not.
    method : str
        ``"surface"``: triangles on the implicit surface that continues the points and normals around the hole.
        ``"creases"``: sharp edges were continued through the hole, and the sub-holes between them filled.
        ``"variational"``: no such surface; a polyharmonic fill of order 2 or more. ``"flat"``: in the plane of the rim,
        a harmonic fill or a triangulation of the rim alone, of little area. ``"paper"``: the paper's patch, or one for
        each sub-hole. ``"straight"``: a straight band between two rims, at which the surface ends at an angle. Empty if
        open.
    reason : str
        Why the hole stays open, why better methods failed, or that triangles stay larger than those around the hole
        because of the limit on their number; empty otherwise.
    parts : int
        Number of sub-holes that creases cut the hole into; 1 without creases, 0 if it stays open.
    creases : (e, 2) int32
        Edges of the new mesh, within the hole, that are creases.
    new_vertices, new_faces : range
        Rows of the fill in the result. Outer rims are filled last and have the last rows.
    rim_error : float
        Largest distance between a rim vertex before and after: 0.
    rim_dihedral : float
        Mean angle between the faces on both sides of the rim, in degrees.
    self_intersections : int
        Number of new faces that intersect another face; of the best fill if the hole stays open for that reason.
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


def describe_hole(hole: Hole, reason: str = "") -> HoleReport:
    """The report of an open hole, with the reason why it is not to be filled, if there is one."""
    islands = len(hole.loops) - 1
    return HoleReport(
        hole.rim, islands, hole.edge_count, hole.perimeter, hole.diameter, hole.is_outer_rim, reason=reason
    )


@dataclass(frozen=True)
class FillOptions:
    """Options of the filling methods; InvalidParameterError if a value is out of range."""

    method: FillingMethod = "auto"
    creases: bool = True  # whether creases are continued
    intersecting: bool = False  # whether the least intersecting fill is used if all fills intersect other faces
    # for ``"paper"``
    alpha: float | None = None  # weight of the points
    correction: Correction = "harmonic"  # displacement that makes patches pass through the rim
    refine: bool = True  # whether the patch gets new vertices inside the rim

    def __post_init__(self) -> None:
        if self.method not in FILL_METHODS:
            raise InvalidParameterError(f"method: got {self.method!r}, expected one of {tuple(FILL_METHODS)}")
        if self.method != "paper" and self.alpha is not None:
            raise InvalidParameterError(f"alpha: method={self.method!r} does not use it; leave it out")
        PatchFit(alpha=self.weight)
        if self.correction not in get_args(Correction):
            raise InvalidParameterError(f"correction: got {self.correction!r}, expected one of {get_args(Correction)}")
        if self.method != "paper" and not self.refine:
            raise InvalidParameterError(f"refine: method={self.method!r} always refines; leave it out")

    @property
    def weight(self) -> float:
        """Weight of the points of the paper's patches."""
        return DEFAULT_WEIGHT if self.alpha is None else self.alpha


@dataclass(frozen=True)
class MeshTask:
    """A mesh, its holes to be filled, and the options of the method."""

    mesh: TriangleMesh
    surroundings: HoleSurroundings  # regions in order of priority: a fill must not intersect earlier fills
    reports: list[HoleReport]  # of these holes, still open
    is_end: BoolArray  # (h,): whether the surface arrives at the rim of each like a tube
    boxes: FloatArray  # (h, 2, 3): lowest and highest corner of the box that contains each fill
    overlapping: Rows  # boxes that overlap each box, itself included
    nearby_faces: Rows  # faces of the mesh in each box
    options: FillOptions


@dataclass(frozen=True)
class HoleTask:
    """A hole to fill."""

    mesh: MeshTask
    region: InfluenceRegion  # rings of the mesh around it
    normals: FloatArray  # (b, 3): unit normals of the vertices of the region, zero where they are unknown
    noisy: bool  # whether the vertices are smoothed rather than interpolated
    is_end: bool  # whether the surface arrives at the rim like a tube

    @cached_property
    def is_flat_end(self) -> bool:
        """Whether the surface ends at the rim, and the rim lies in a plane, apart from noise and rounding."""
        plane = rim_plane([self.region.vertices[loop] for loop in self.region.loops]) if self.is_end else None
        return plane is not None and plane.is_flat(self.mesh.surroundings.noise)

    @property
    def continues_creases(self) -> bool:
        """Whether sharp edges at the rim are looked for: not if noise makes them."""
        return self.mesh.options.creases and not self.mesh.surroundings.is_smooth


def _auto_attempts(task: HoleTask) -> Iterator[Attempt]:
    """A flat fill, if the surface ends at the rim and the rim lies in a plane; then fills that continue the surface."""
    if task.is_flat_end:
        yield _flat_attempt(task)
    yield from _surface_attempts(task)


def _flat_attempts(task: HoleTask) -> Iterator[Attempt]:
    """A fill in the plane of the rim, then membranes."""
    yield _flat_attempt(task)
    yield from membrane_attempts(task.region)


def _flat_attempt(task: HoleTask) -> Attempt:
    fill = flat_fill(task.region, task.mesh.surroundings.noise)
    return Attempt("flat", None, fill) if isinstance(fill, str) else Attempt("flat", fill)


def _surface_attempts(task: HoleTask) -> Iterator[Attempt]:
    """Fills that continue creases, if creases run into the hole; then smooth fills, each simpler than the last.

    Bands between rims at which the surface ends at an angle are straight. If no band fits, the second rim is that of an
    island.
    """
    if task.region.is_band:
        yield from straight_attempts(task.region, noisy=task.noisy)
        yield from smooth_attempts(task.region, task.normals, noisy=task.noisy)
        task = replace(task, region=replace(task.region, is_band=False))
    if task.continues_creases:
        yield from crease_attempts(task.region, noisy=task.noisy)
    yield from smooth_attempts(task.region, task.normals, noisy=task.noisy)


def _paper_attempts(task: HoleTask) -> Iterator[Attempt]:
    """The paper's fills: a patch for each sub-hole between creases, then one patch; then smooth fills."""
    options = task.mesh.options
    fill_sub_hole = partial(paper_fill, alpha=options.weight, correction=options.correction, refined=options.refine)
    if task.continues_creases:
        for attempt in crease_attempts(task.region, noisy=task.noisy, fill_sub_hole=fill_sub_hole):
            yield replace(attempt, kind="paper")
    fill = fill_sub_hole(task.region)
    yield Attempt("paper", None, fill) if isinstance(fill, str) else Attempt("paper", fill)
    yield from smooth_attempts(task.region, task.normals, noisy=task.noisy)


# generators of attempts, the best first; the first fill without intersections is used
FILL_METHODS: dict[FillingMethod, Callable[[HoleTask], Iterator[Attempt]]] = {
    "auto": _auto_attempts,
    "surface": _surface_attempts,
    "flat": _flat_attempts,
    "paper": _paper_attempts,
}


@dataclass(frozen=True)
class FaceSet:
    """Faces with their vertices."""

    ids: IntArray  # (k,): vertices as rows of the resulting mesh; may repeat
    points: FloatArray  # (k, 3): their coordinates
    faces: IntArray  # (m, 3): indices into `ids`


def hole_box(mesh: TriangleMesh, hole: Hole) -> tuple[FloatArray, FloatArray]:
    """Lowest and highest corner of the box that must contain a fill, each (3,)."""
    rim = mesh.vertices[np.concatenate(hole.loops)]
    return rim.min(axis=0) - MAX_BULGE * hole.diameter, rim.max(axis=0) + MAX_BULGE * hole.diameter


def overlapping_boxes(boxes: FloatArray) -> Rows:
    """Numbers, ascending, of the boxes (h, 2, 3) that overlap each box."""
    faces = np.arange(2 * len(boxes), dtype=np.int32).reshape(-1, 2)[:, [0, 1, 1]]  # a degenerate face on the diagonal
    return faces_in_boxes(boxes.reshape(-1, 3), faces, boxes[:, 0], boxes[:, 1])


def box_groups(boxes: FloatArray) -> list[IntArray]:
    """Connected components of the overlap graph of boxes (h, 2, 3): ascending numbers of each.

    Fills of holes in different components do not depend on each other.

    >>> boxes = np.array([[0.0, 1.0], [5.0, 6.0], [1.0, 2.0]])[:, :, np.newaxis] * np.ones(3)
    >>> [group.tolist() for group in box_groups(boxes)]
    [[0, 2], [1]]
    """
    overlaps = overlapping_boxes(boxes)
    shape = (len(boxes), len(boxes))
    graph = csr_array((np.ones(len(overlaps.indices)), overlaps.indices, overlaps.indptr), shape=shape)
    count, group = connected_components(graph, directed=False)
    by_group = np.argsort(group, kind="stable")
    return np.split(by_group, np.searchsorted(group[by_group], np.arange(1, count)))


def fill_group(task: MeshTask, group: Iterable[int]) -> list[tuple[HoleReport, FaceSet | None]]:
    """Fill holes of a mesh, given by ascending numbers, one after the other: later fills respect earlier ones.

    New vertices are numbered consecutively after those of the mesh. Reports give creases as row indices of the fill;
    their rows in the result are not known yet.
    """
    placed: dict[int, FaceSet] = {}
    joined: dict[int, IntArray] = {}  # pairs of mesh vertices that each fill joins by an edge
    result = []
    next_vertex = task.mesh.vertex_count
    for number in group:
        region, overlapping = (
            task.surroundings.regions[number],
            [k for k in task.overlapping.row(number).tolist() if k in placed],
        )
        if overlapping:
            region = region.add_joined_pairs(np.concatenate([joined[k] for k in overlapping]))
        normals, noisy = task.surroundings.normals[region.ids], region.is_noisy(task.surroundings.noise)
        hole = HoleTask(task, region, normals, noisy, bool(task.is_end[number]))
        report, fill = _best_attempt(hole, number, [placed[k] for k in overlapping], next_vertex)
        result.append((report, fill))
        if fill is not None:
            placed[number] = fill
            next_vertex += len(fill.ids) - region.rim_count
            joined[number] = vertex_pairs(fill.ids[fill.faces], task.mesh.vertex_count)
    return result


def _best_attempt(
    hole: HoleTask, number: int, overlapping: Sequence[FaceSet], next_vertex: int
) -> tuple[HoleReport, FaceSet | None]:
    """The first attempt without intersections, else none; if fills may intersect, the one with the fewest of them."""
    task, region, report = hole.mesh, hole.region, hole.mesh.reports[number]
    low, high = task.boxes[number]
    ids = task.mesh.faces[task.nearby_faces.row(number)].ravel()
    mesh_faces = FaceSet(ids, task.mesh.vertices[ids], np.arange(len(ids), dtype=np.int32).reshape(-1, 3))
    least, best, placed = 0, None, None  # number of intersecting faces of the best attempt so far, with its faces
    reasons: list[tuple[Attempt, str]] = []
    for attempt in FILL_METHODS[task.options.method](hole):
        fill, problem = attempt.fill, attempt.reason
        if fill is not None and not np.isfinite(fill.points).all():
            problem = "coordinates are not finite"
        elif fill is not None and not ((fill.points >= low) & (fill.points <= high)).all():
            problem = "bulges too far from the rim"
        elif fill is not None:
            new = np.arange(next_vertex, next_vertex + len(fill.points) - fill.rim_count)
            faces = FaceSet(np.concatenate([region.ids[: fill.rim_count], new]), fill.points, fill.faces)
            faces, count = _flatten_intersections(faces, region.rim_count, [mesh_faces, *overlapping])
            if best is None or count < least:  # ties go to the earlier, better attempt
                least, best, placed = count, attempt, faces
            if count == 0:
                break
            problem = f"{count} of its faces would cut others"
        reasons.append((attempt, f"{attempt.kind}: {problem}"))
    if best is None or placed is None or (least and not task.options.intersecting):
        remarks = [INTERSECTING] if least else []
        remarks += [text for _, text in reasons]
        return replace(report, reason="; ".join(dict.fromkeys(remarks)), self_intersections=least), None
    remarks = [text for attempt, text in reasons if attempt is not best]
    if best.fill is not None and best.fill.is_limited:
        remarks.append(f"{SIZE_LIMITED} ({len(placed.faces)} new faces)")
    if least:
        remarks.append(f"{best.kind}: taken, though {least} of its faces cut others, the fewest")
    return replace(
        report,
        filled=True,
        method=best.kind,
        reason="; ".join(dict.fromkeys(remarks)),
        parts=best.sub_hole_count,
        creases=report.creases if best.creases is None else best.creases,
        rim_error=float(np.abs(placed.points[: region.rim_count] - region.rim_vertices).max()),
        rim_dihedral=_rim_dihedral(placed, region),
        self_intersections=least,
    ), placed


def _flatten_intersections(placed: FaceSet, rim_count: int, others: Sequence[FaceSet]) -> tuple[FaceSet, int]:
    """Remove few intersections by local flattening; return the fill and the number of its intersecting faces.

    Vertices in growing rings around the intersecting faces get harmonic coordinates, until no face intersects another.
    """
    is_cut = _intersecting_faces(placed, others)
    if not 0 < np.count_nonzero(is_cut) <= min(MAX_INTERSECTING_FACES, MAX_INTERSECTING_FRACTION * len(is_cut)):
        return placed, int(np.count_nonzero(is_cut))
    near: BoolArray = is_cut
    for _ in range(MAX_FLATTENED_RINGS):
        moving = np.unique(placed.faces[near])
        moving = moving[moving >= rim_count]
        order = np.concatenate([np.setdiff1d(np.arange(len(placed.points)), moving), moving])
        points = placed.points.copy()
        faces = np.argsort(order)[placed.faces].astype(np.int32)
        points[order] = polyharmonic_continuation(points[order], faces, points[order[: len(order) - len(moving)]])
        flattened = replace(placed, points=points)
        if not _intersecting_faces(flattened, others).any():
            return flattened, 0
        near = np.asarray(np.isin(placed.faces, placed.faces[near]).any(axis=1))
    return placed, int(np.count_nonzero(is_cut))


def _intersecting_faces(placed: FaceSet, others: Sequence[FaceSet]) -> BoolArray:
    """Faces of a fill that intersect one of the others or each other, (m,) bool."""
    sets = (*others, placed)
    first = np.cumsum([0, *(len(some.points) for some in others)], dtype=np.int32)
    faces = np.concatenate([some.faces + start for some, start in zip(sets, first, strict=True)])
    names = np.concatenate([some.ids[some.faces] for some in sets])
    return cut_faces(np.concatenate([some.points for some in sets]), faces, len(placed.faces), names)


def _rim_dihedral(fill: FaceSet, region: InfluenceRegion) -> float:
    """Mean dihedral angle along the rim, in degrees."""
    lists = half_edge_lists(fill.faces, len(fill.points))
    own = [normals_along(fill.points, fill.faces, lists, loop, beyond=False) for loop in region.loops]
    beyond = [region.rim_face_normals(loop) for loop in region.loops]
    return degrees(float(dihedral_angles(np.concatenate(own), np.concatenate(beyond)).mean()))
