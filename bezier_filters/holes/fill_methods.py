"""Filling methods, and the order in which holes with overlapping boxes are filled.

A method is a generator of attempts, the best first. The first attempt whose faces intersect no other face is used.
To add a method, write a function of a `HoleTask` and add it to `FILL_METHODS`.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal, get_args

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.errors import InvalidParameterError
from bezier_filters.holes.band_fill import straight_attempts
from bezier_filters.holes.crease_fill import crease_attempts
from bezier_filters.holes.fill_choice import FaceSet, FillPlace, choose_attempt, face_set
from bezier_filters.holes.hole import Hole
from bezier_filters.holes.hole_report import HoleReport
from bezier_filters.holes.influence_region import HoleSurroundings, InfluenceRegion, vertex_pairs
from bezier_filters.holes.planar_fill import Correction, flat_fill, paper_fill
from bezier_filters.holes.rim_noise import normals_beyond_noisy_rim
from bezier_filters.holes.rim_planes import rim_plane
from bezier_filters.holes.smooth_fill import Attempt, membrane_attempts, smooth_attempts
from bezier_filters.meshes.adjacency import Rows
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.meshes.self_intersections import faces_in_boxes
from bezier_filters.patches.patch_fit import PatchFit
from bezier_filters.runtime.cached_property import cached_property

FillingMethod = Literal["auto", "surface", "flat", "paper"]

DEFAULT_WEIGHT = 0.8  # of the points of the paper's patches against their smoothness
MAX_BULGE = 0.5  # of a fill beyond the bounding box of its rim, in diameters of the hole


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
        loops = [self.region.vertices[loop] for loop in self.region.loops]
        plane = rim_plane(loops) if self.is_end and not self.region.is_band else None
        if plane is None:
            return False
        # The rims of one face may end at slightly different heights.
        return plane.is_flat(self.mesh.surroundings.noise) or (len(loops) > 1 and plane.is_nearly_flat)

    @property
    def continues_creases(self) -> bool:
        """Whether sharp edges at the rim are looked for: not if noise makes them."""
        return self.mesh.options.creases and not (self.mesh.surroundings.is_smooth or self.rim_is_noisy)

    @cached_property
    def _reliable_normals(self) -> FloatArray | None:
        return normals_beyond_noisy_rim(self.region, self.normals, self.mesh.surroundings.noise)

    @property
    def rim_is_noisy(self) -> bool:
        """Whether the rim has noise that its surroundings do not have."""
        return self._reliable_normals is not None

    def smooth_attempts(self) -> Iterator[Attempt]:
        """Fills of a smooth surface, which follow the rim if neither it nor the mesh is noisy."""
        normals = self.normals if self._reliable_normals is None else self._reliable_normals
        follows_rim = not (self.noisy or self.rim_is_noisy)
        return smooth_attempts(self.region, normals, noisy=self.noisy, follows_rim=follows_rim)


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
        yield from task.smooth_attempts()
        task = replace(task, region=replace(task.region, is_band=False))
    if task.continues_creases:
        yield from crease_attempts(task.region, noisy=task.noisy)
    yield from task.smooth_attempts()


def _paper_attempts(task: HoleTask) -> Iterator[Attempt]:
    """The paper's fills: a patch for each sub-hole between creases, then one patch; then smooth fills."""
    options = task.mesh.options
    fill_sub_hole = partial(paper_fill, alpha=options.weight, correction=options.correction, refined=options.refine)
    if task.continues_creases:
        for attempt in crease_attempts(task.region, noisy=task.noisy, fill_sub_hole=fill_sub_hole):
            yield replace(attempt, kind="paper")
    fill = fill_sub_hole(task.region)
    yield Attempt("paper", None, fill) if isinstance(fill, str) else Attempt("paper", fill)
    yield from task.smooth_attempts()


# generators of attempts, the best first; the first fill without intersections is used
FILL_METHODS: dict[FillingMethod, Callable[[HoleTask], Iterator[Attempt]]] = {
    "auto": _auto_attempts,
    "surface": _surface_attempts,
    "flat": _flat_attempts,
    "paper": _paper_attempts,
}


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
        faces = task.mesh.faces[task.nearby_faces.row(number)]
        around = [face_set(task.mesh, faces), *(placed[k] for k in overlapping)]
        place = FillPlace(region, task.boxes[number], around, next_vertex)
        attempts = FILL_METHODS[task.options.method](hole)
        report, fill = choose_attempt(attempts, place, task.reports[number], intersecting=task.options.intersecting)
        result.append((report, fill))
        if fill is not None:
            placed[number] = fill
            next_vertex += len(fill.ids) - region.rim_count
            joined[number] = vertex_pairs(fill.ids[fill.faces], task.mesh.vertex_count)
    return result
