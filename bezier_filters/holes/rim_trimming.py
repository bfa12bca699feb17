"""Removal of spikes and flaps: faces at the rim of a hole that intersect others, so that every fill would, too.

A hole loses at most its first ring of faces, and only if it is filled afterwards.
"""

from collections.abc import Callable, Sequence

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from bezier_filters.arrays import BoolArray, IntArray
from bezier_filters.holes.hole_report import HoleReport
from bezier_filters.holes.remaining_mesh import RemainingMesh, remove_faces
from bezier_filters.meshes.half_edges import faces_at, half_edge_twins
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.meshes.self_intersections import cut_faces


def trim_rims(
    mesh: TriangleMesh, holes: Sequence[HoleReport], fill: Callable[[RemainingMesh], Sequence[HoleReport]]
) -> RemainingMesh | None:
    """Remove faces at the rims of open holes, if the holes are filled afterwards: few, else their first rings.

    `fill` fills the holes of the remaining mesh. None if no more holes are filled without such faces.
    """
    rims = [hole.rim for hole in holes if hole.self_intersections and not hole.filled]
    choices = [choice for choice in _removable_faces(mesh, rims) if choice]
    while choices:
        removed = np.zeros(mesh.face_count, dtype=np.bool_)
        removed[np.concatenate([choice[0] for choice in choices])] = True
        rest = remove_faces(mesh, removed)
        reports = fill(rest)
        good = [_is_filled(reports, _mark_vertices(mesh, rest, choice[0])) for choice in choices]
        if all(good):
            return rest
        choices = [choice if ok else choice[1:] for choice, ok in zip(choices, good, strict=True)]
        choices = [choice for choice in choices if choice]
    return None


def _is_filled(reports: Sequence[HoleReport], touched: BoolArray) -> bool:
    """Whether there are holes at touched vertices, and all of them are filled."""
    filled = [report.filled for report in reports if touched[report.rim].any()]
    return bool(filled) and all(filled)


def _mark_vertices(mesh: TriangleMesh, trimmed: RemainingMesh, faces: IntArray) -> BoolArray:
    """Vertices of a trimmed mesh that belonged to some of the removed faces."""
    rows = trimmed.place[mesh.faces[faces].ravel()]
    touched = np.zeros(trimmed.mesh.vertex_count, dtype=np.bool_)
    touched[rows[rows >= 0]] = True
    return touched


def _removable_faces(mesh: TriangleMesh, rims: Sequence[IntArray]) -> list[list[IntArray]]:
    """For each rim, the faces at it that intersect others, then all faces at it; nothing if none intersects another.

    Faces that would have no common edge with the rest go with them.
    """
    on_rim = np.zeros(mesh.vertex_count, dtype=np.bool_)
    for rim in rims:
        on_rim[rim] = True
    near = faces_at(mesh.faces, on_rim)
    others = np.setdiff1d(np.arange(mesh.face_count), near)
    cut = cut_faces(mesh.vertices, mesh.faces[np.concatenate([others, near])], len(near))
    choices = []
    for rim in rims:
        at_rim = np.zeros(mesh.vertex_count, dtype=np.bool_)
        at_rim[rim] = True
        here = at_rim[mesh.faces[near]].any(axis=1)
        ring, goes = near[here], cut[here]
        choices.append([ring[goes | _is_loose(mesh, ring, goes)], ring] if goes.any() else [])
    return choices


def _is_loose(mesh: TriangleMesh, faces: IntArray, goes: BoolArray) -> BoolArray:
    """Which faces at a rim, (k,), have no chain of common edges to the rest of the mesh without the marked ones."""
    marked = np.zeros(mesh.vertex_count, dtype=np.bool_)
    marked[mesh.faces[faces]] = True
    around = faces_at(mesh.faces, marked)
    twins = half_edge_twins(mesh.faces[around], mesh.vertex_count)
    own, stays = np.searchsorted(around, faces), np.ones(len(around), dtype=np.bool_)
    stays[own[goes]] = False
    first, second = np.flatnonzero(twins >= 0) // 3, twins[twins >= 0] // 3
    joined = stays[first] & stays[second]
    graph = coo_array((np.ones(np.count_nonzero(joined)), (first[joined], second[joined])), (len(around),) * 2)
    part = connected_components(graph, directed=False)[1]
    beyond = np.setdiff1d(np.arange(len(around)), own)
    return ~np.isin(part[own], part[beyond])
