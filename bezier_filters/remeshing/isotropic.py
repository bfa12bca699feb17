"""Isotropic remeshing on a surface: splits, collapses, flips and relaxation, as Botsch and Kobbelt do.

"A remeshing approach to multiresolution modeling", SGP 2004, with every vertex projected onto the surface of patches
after it has moved, and curves that are kept.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.errors import InvalidParameterError
from bezier_filters.meshes.triangles import area_vectors
from bezier_filters.patch_surface.surface import Surface, SurfacePoints
from bezier_filters.remeshing.edge_lengths import LONG, SHORT, Sizing
from bezier_filters.remeshing.edge_operations import choose_collapses, collapse_edges, flip_edges
from bezier_filters.remeshing.edge_splitting import face_edges, nest_faces, split_edges
from bezier_filters.remeshing.kept_curves import (
    CurveEdges,
    CurvePlaces,
    divide,
    merge_ends,
    relax_along,
)
from bezier_filters.remeshing.step_progress import StepProgress
from bezier_filters.remeshing.surface_places import check_places

FREE, ON_CURVE, FIXED = 0, 1, 2  # how a vertex may move
# Most faces after splitting, for each old one and for each that the area has room for: jittered and graded meshes have
# 2 at most. Doubled or halved, only the errors for meshes with single huge faces or needles come later or earlier.
MAX_FACE_GROWTH = 16
STEPS = 3  # of an iteration, for its progress: splits, collapses, and relaxation after flips
MAX_SPLITS = 3  # of edges in one iteration, before others become relaxed
MAX_OPERATION_PASSES = 10  # of collapses, or flips, that do not touch the same faces
MIN_PROGRESS = 500  # vertices for each collapse of a pass from which there is another pass
RELAXATION = 0.8  # part of the way to the mean of the neighbours
INNER_VALENCE, BORDER_VALENCE = 6, 4
VERTEX_ARRAYS = ("points", "kind", "place_face", "place", "normals", "curvature", "old", "lengths")


@dataclass
class WorkingMesh:
    """A mesh on a surface that is being remeshed."""

    surface: Surface
    curves: CurveEdges
    curve_places: CurvePlaces
    points: FloatArray  # (n, 3)
    faces: IntArray  # (m, 3)
    kind: IntArray  # (n,): `FREE`, `ON_CURVE` or `FIXED`
    place_face: IntArray  # (n,): face of the old mesh below each vertex
    place: FloatArray  # (n, 2): barycentric coordinates in it
    normals: FloatArray  # (n, 3): of the surface; of faces on curves
    curvature: FloatArray  # (n,): largest absolute one
    old: IntArray  # (n,): old vertex that each is, -1 for new ones
    progress: StepProgress
    lengths: FloatArray = field(default_factory=lambda: np.zeros(0))  # (n,): wanted ones of edges

    def copy(self) -> "WorkingMesh":
        """The same mesh with arrays of its own."""
        return replace(self, **{name: getattr(self, name).copy() for name in ("faces", *VERTEX_ARRAYS)})

    def keys(self, ends: IntArray) -> IntArray:
        """Numbers of edges (e, 2)."""
        return np.asarray(
            ends.min(axis=1, initial=len(self.points)).astype(np.int64) * len(self.points) + ends.max(axis=1, initial=0)
        )

    def split_long(self) -> bool:
        """Split edges that are too long at their midpoints; return whether there were any."""
        n = len(self.points)
        edges = face_edges(self.faces, n)
        a, b = edges.ends.T
        wanted = np.minimum(self.lengths[a], self.lengths[b])
        marked = np.linalg.norm(self.points[a] - self.points[b], axis=1) > LONG * wanted
        of_curve = self._curve_of(edges.ends)
        is_curve = of_curve >= 0
        marked &= ~self._are_frozen(of_curve)
        if not marked.any():
            return False
        middle = np.where(marked, n + np.cumsum(marked) - 1, -1)
        middles = 0.5 * (self.points[a] + self.points[b])[marked]
        self.faces = split_edges(nest_faces(self.faces), self.points, edges, middle).faces
        chosen = np.zeros(len(self.curves.ends), dtype=np.bool_)
        chosen[of_curve[marked & is_curve]] = True
        place_of = np.full(len(chosen), -1)
        place_of[of_curve[marked & is_curve]] = middle[marked & is_curve]
        self.curves = divide(self.curves, chosen, place_of[chosen])
        self._append(middles, np.where(is_curve[marked], ON_CURVE, FREE))
        return True

    def collapse_short(self) -> None:
        """Collapse edges that are too short, if the mesh stays a manifold and no face turns over."""
        for _ in range(MAX_OPERATION_PASSES):
            n = len(self.points)
            ends = face_edges(self.faces, n).ends
            a, b = ends.T
            wanted = np.minimum(self.lengths[a], self.lengths[b])
            size = np.linalg.norm(self.points[a] - self.points[b], axis=1)
            of_curve = self._curve_of(ends)
            both = (self.kind[a] != FREE) & (self.kind[b] != FREE)
            frozen = self._are_frozen(of_curve)
            fixed = (self.kind[a] == FIXED) & (self.kind[b] == FIXED)
            ends = ends[(size < SHORT * wanted) & ~fixed & ~frozen & ~(both & (of_curve < 0))]
            if not len(ends):
                return
            ends = np.where((self.kind[ends[:, 0]] > self.kind[ends[:, 1]])[:, np.newaxis], ends[:, ::-1], ends)
            a, b = ends.T  # a goes into b
            free = self.kind[b] == FREE
            goal = np.where(free[:, np.newaxis], 0.5 * (self.points[a] + self.points[b]), self.points[b])
            longest = LONG * np.minimum(self.lengths[a], self.lengths[b])
            chosen = choose_collapses(self.points, self.normals, self.faces, ends, goal, longest)
            ends, goal = ends[chosen], goal[chosen]
            if not len(ends):
                return
            target = np.arange(n, dtype=np.int32)
            target[ends[:, 0]] = ends[:, 1]
            self.points[ends[:, 1]] = goal
            self.curves = merge_ends(self.curves, target, n)
            self.faces = collapse_edges(self.faces, target)
            self.drop_unused()
            if len(ends) * MIN_PROGRESS < n:  # the rest waits until others have become relaxed
                return

    def flip(self, valences: IntArray) -> None:
        """Flip edges for better numbers of neighbours."""
        for _ in range(MAX_OPERATION_PASSES):
            self.faces, count = flip_edges(self.points, self.faces, self.curves.ends, valences)
            if not count:
                return

    def relax(self) -> None:
        """Move vertices towards their neighbours along the surface, and onto it."""
        n = len(self.points)
        center = self.points[self.faces].mean(axis=1)
        weight = np.linalg.norm(area_vectors(self.points, self.faces), axis=1)
        # areas over the wanted ones, so that triangles of graded meshes do not become equal
        weight /= np.square(self.lengths[self.faces].mean(axis=1))
        corner = self.faces.ravel()
        sums = np.stack([np.bincount(corner, np.repeat(weight * center[:, k], 3), n) for k in range(3)], axis=1)
        total = np.bincount(corner, np.repeat(weight, 3), n)
        step = sums / np.maximum(total, 1e-300)[:, np.newaxis] - self.points
        step[total == 0.0] = 0.0
        step -= np.einsum("nd,nd->n", step, self.normals)[:, np.newaxis] * self.normals
        free = self.kind == FREE
        self.points[free] += RELAXATION * step[free]
        self.curves = relax_along(self.curves, self.kind == ON_CURVE, RELAXATION)
        self.project()

    def project(self, first: int = 0) -> None:
        """Find the places on the surface of free vertices, and those of vertices on curves, from the first one on."""
        free = (first + np.flatnonzero(self.kind[first:] == FREE)).astype(np.int32)
        self._write(free, self.surface.query(self.points[free], progress=self.progress.within))
        starts = self.curves.ends[:, 0]
        rows = np.flatnonzero((self.kind[starts] == ON_CURVE) & (starts >= first))
        vertex = starts[rows]
        found = self.curve_places.find(self.curves.chain[rows], self.curves.interval[rows, 0])
        self.points[vertex], self.place_face[vertex], self.place[vertex], self.curvature[vertex] = found

    def _write(self, rows: IntArray, found: SurfacePoints) -> None:
        self.points[rows], self.curvature[rows], _ = check_places(self.surface, found)
        self.place_face[rows], self.place[rows] = found.faces, found.coordinates
        self.normals[rows] = found.normals

    def _curve_of(self, ends: IntArray) -> IntArray:
        """Edge of a curve that each of the edges (e, 2) is, -1 if none."""
        own = self.keys(self.curves.ends)
        if not len(own):
            return np.full(len(ends), -1)
        order, keys = np.argsort(own), self.keys(ends)
        place = np.minimum(np.searchsorted(own[order], keys), len(own) - 1)
        return np.where(own[order][place] == keys, order[place], -1)

    def _are_frozen(self, of_curve: IntArray) -> BoolArray:
        return np.asarray(np.append(self.curves.frozen, False)[of_curve])

    def _append(self, points: FloatArray, kind: IntArray) -> None:
        k = len(points)
        self.points = np.vstack([self.points, points])
        self.kind = np.concatenate([self.kind, kind])
        self.place_face = np.concatenate([self.place_face, np.zeros(k, np.int32)])
        self.place = np.vstack([self.place, np.zeros((k, 2))])
        self.normals = np.vstack([self.normals, np.zeros((k, 3))])
        self.curvature = np.concatenate([self.curvature, np.zeros(k)])
        self.old = np.concatenate([self.old, np.full(k, -1, np.int32)])
        self.project(len(self.points) - k)  # the others have not moved

    def drop_unused(self) -> None:
        """Drop vertices without faces that are not fixed."""
        used = np.zeros(len(self.points), dtype=np.bool_)
        used[self.faces] = True
        used[self.kind == FIXED] = True
        number = np.cumsum(used) - 1
        self.faces = number[self.faces].astype(np.int32)
        self.curves = CurveEdges(
            number[self.curves.ends].astype(np.int32), self.curves.chain, self.curves.interval, self.curves.frozen
        )
        for name in VERTEX_ARRAYS:
            setattr(self, name, getattr(self, name)[used])


def remesh_surface(mesh: WorkingMesh, sizing: Sizing, iterations: int) -> None:
    """Give the edges of a working mesh the wanted lengths.

    Refused if that makes many times the faces that its area has room for, as where its patches are far from it.
    """
    wanted = sizing(mesh.points, mesh.faces, mesh.curvature)[mesh.faces].mean(axis=1)
    areas = np.linalg.norm(area_vectors(mesh.points, mesh.faces), axis=1)
    most = MAX_FACE_GROWTH * (len(mesh.faces) + (areas / np.square(wanted)).sum())
    for _ in range(iterations):
        for _ in range(MAX_SPLITS):
            mesh.lengths = sizing(mesh.points, mesh.faces, mesh.curvature)
            if not mesh.split_long():
                break
            if len(mesh.faces) > most:
                raise InvalidParameterError(
                    f"length: edges of that length make more than {most:,.0f} faces, many times what the area of the "
                    "mesh has room for: its faces are needles, or far from the surface; repair it, or give a length"
                )
        mesh.lengths = sizing(mesh.points, mesh.faces, mesh.curvature)
        mesh.progress.advance()
        mesh.collapse_short()
        mesh.progress.advance()
        mesh.flip(_valences(mesh))
        mesh.lengths = sizing(mesh.points, mesh.faces, mesh.curvature)
        mesh.relax()
        mesh.progress.advance(STEPS - 2)


def _valences(mesh: WorkingMesh) -> IntArray:
    """Best numbers of half-edges at each vertex."""
    n = len(mesh.points)
    edges = face_edges(mesh.faces, n)
    single = np.bincount(edges.of_face.ravel(), minlength=len(edges.ends)) == 1
    valences = np.full(n, INNER_VALENCE)
    valences[edges.ends[single].ravel()] = BORDER_VALENCE - 1  # half-edges that start there are one less than edges
    return valences
