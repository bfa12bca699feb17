"""The choice among attempts to fill a hole: the first that intersects no face, bulges little and is no fin."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from math import degrees

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.holes.hole_report import HoleReport
from bezier_filters.holes.influence_region import InfluenceRegion
from bezier_filters.holes.loops import vector_area
from bezier_filters.holes.polyharmonic_fairing import polyharmonic_continuation
from bezier_filters.holes.refinement import Fill
from bezier_filters.holes.rim_triangulation import face_area, triangulate_rim
from bezier_filters.holes.smooth_fill import Attempt
from bezier_filters.meshes.half_edges import dihedral_angles, half_edge_lists, normals_along
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.meshes.self_intersections import cut_faces

# Area of a fill over the least one with the same rim. A hemisphere over its circle has 2, the corner of a cube 1.7, and
# fins over slits of range scans up to 22. Of 385 fills of real holes 11 have more than 2, and none more than 4.
MAX_AREA_RATIO = 4.0
INTERSECTING = "every fill would cut other faces, intersecting=True takes the one that cuts least"
SIZE_LIMITED = "its triangles stay larger than those around it, as there would be too many"
# A fill is flattened around its intersecting faces if there are at most this number and fraction of them, within at
# most this number of rings.
MAX_INTERSECTING_FACES, MAX_INTERSECTING_FRACTION, MAX_FLATTENED_RINGS = 16, 0.04, 4


@dataclass(frozen=True)
class FaceSet:
    """Faces with their vertices."""

    ids: IntArray  # (k,): vertices as rows of the resulting mesh; may repeat
    points: FloatArray  # (k, 3): their coordinates
    faces: IntArray  # (m, 3): indices into `ids`


@dataclass(frozen=True)
class FillPlace:
    """A hole and what is around it."""

    region: InfluenceRegion
    box: FloatArray  # (2, 3): lowest and highest corner of the box that a fill must not leave
    around: Sequence[FaceSet]  # faces in the box: those of the mesh, then those of other fills
    next_vertex: int  # row of the first new vertex


def face_set(mesh: TriangleMesh, faces: IntArray) -> FaceSet:
    """Some faces (m, 3) of a mesh."""
    ids = faces.ravel()
    return FaceSet(ids, mesh.vertices[ids], np.arange(len(ids), dtype=np.int32).reshape(-1, 3))


def choose_attempt(
    attempts: Iterable[Attempt], place: FillPlace, report: HoleReport, *, intersecting: bool
) -> tuple[HoleReport, FaceSet | None]:
    """The first attempt without intersections, else none; if fills may intersect, the one with the fewest of them."""
    region = place.region
    least, best, placed = 0, None, None  # number of intersecting faces of the best attempt so far, with its faces
    reasons: list[tuple[Attempt, str]] = []
    for attempt in attempts:
        fill, problem = attempt.fill, attempt.reason
        if fill is not None:
            problem = _shape_problem(fill, place)
        if fill is not None and not problem:
            new = np.arange(place.next_vertex, place.next_vertex + len(fill.points) - fill.rim_count)
            faces = FaceSet(np.concatenate([region.ids[: fill.rim_count], new]), fill.points, fill.faces)
            faces, count = _flatten_intersections(faces, region.rim_count, place.around)
            if best is None or count < least:  # ties go to the earlier, better attempt
                least, best, placed = count, attempt, faces
            if count == 0:
                break
            problem = f"{count} of its faces would cut others"
        reasons.append((attempt, f"{attempt.kind}: {problem}"))
    if best is None or placed is None or (least and not intersecting):
        remarks = [_obstacle(place)] if least else []
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


def _shape_problem(fill: Fill, place: FillPlace) -> str:
    """Why the shape of a fill is impossible; empty if it is not."""
    if not np.isfinite(fill.points).all():
        return "coordinates are not finite"
    if not ((fill.points >= place.box[0]) & (fill.points <= place.box[1])).all():
        return "bulges too far from the rim"
    return f"its area is more than {MAX_AREA_RATIO:g} times the least one" if _is_fin(fill, place.region) else ""


def _obstacle(place: FillPlace) -> str:
    """Why every fill would cut faces, and what to do about it."""
    mesh = place.around[0]
    corners = mesh.ids[mesh.faces]
    at_rim = np.isin(corners, place.region.ids[: place.region.rim_count]).any(axis=1)
    order = np.argsort(at_rim, kind="stable")
    cut = cut_faces(mesh.points, mesh.faces[order], int(np.count_nonzero(at_rim)), corners[order])
    if not cut.any():
        return INTERSECTING
    a, b, c = corners[order][len(order) - len(cut) :][cut][0]
    return (
        f"{INTERSECTING}; {np.count_nonzero(cut)} of the faces at its rim intersect others already, as that with the "
        f"vertices {a}, {b} and {c}: trim=True removes them if that helps"
    )


def _is_fin(fill: Fill, region: InfluenceRegion) -> bool:
    """Whether a fill has much more area than its rim needs, as a fin over a slit does."""
    area = face_area(fill.points, fill.faces)
    flat = float(np.linalg.norm(np.sum([vector_area(region.vertices[loop]) for loop in region.loops], axis=0)))
    if area <= MAX_AREA_RATIO * flat or len(fill.points) == fill.rim_count:
        return False  # no fill has less area than the length of the vector area
    least = triangulate_rim(region, least_area=True)
    return least is not None and area > MAX_AREA_RATIO * face_area(least.points, least.faces)


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
