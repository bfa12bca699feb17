"""Islands: rims that bound one fill together with the rim around them.

A sheet inside a hole, near its plane and with the same orientation, is an island of that hole. Where walls of both
orientations end in one plane, as those of a cup or of a plate with bolt holes, the missing face lies between them.
"""

from dataclasses import replace

import numpy as np

from bezier_filters.arrays import FloatArray
from bezier_filters.holes.hole import Hole
from bezier_filters.holes.loops import plane_axes, points_in_polygon, vector_area
from bezier_filters.holes.rim_planes import MAX_ROUGH_DISTANCE, RimPlane, rim_plane
from bezier_filters.meshes.adjacency import Rows
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.meshes.self_intersections import faces_in_boxes

MAX_ISLAND_HEIGHT = 0.25  # distance of an island from the plane of its hole, in diameters of the hole


def assign_islands(mesh: TriangleMesh, holes: list[Hole]) -> list[Hole]:
    """Assign each outer rim that lies in a hole to the smallest such hole, as an island."""
    around = [j for j, hole in enumerate(holes) if not (hole.is_outer_rim or hole.obstacle)]
    sheets = [k for k, hole in enumerate(holes) if hole.is_outer_rim and not hole.obstacle]
    if not around or not sheets:
        return holes
    boxes = np.array([_island_box(mesh, holes[j]) for j in around])
    near = _rims_in_boxes(mesh, [holes[k] for k in sheets], boxes)
    smallest: dict[int, int] = {}  # smallest hole that contains each outer rim; ties go to the first
    for place in sorted(range(len(around)), key=lambda place: holes[around[place]].diameter):
        hole = holes[around[place]]
        for sheet in near.row(place).tolist():
            if sheet not in smallest and _is_island_of(mesh, holes[sheets[sheet]], hole):
                smallest[sheet] = around[place]
    return _join_islands(holes, {sheets[sheet]: hole for sheet, hole in smallest.items()})


def join_rims_of_faces(mesh: TriangleMesh, holes: list[Hole]) -> list[Hole]:
    """Join the rims of ends in one plane, of which one surrounds the others, to one hole: that of a missing face.

    Inner rims have the opposite orientation. Each belongs to the smallest rim around it that is no inner one itself.
    """
    ends = [k for k, hole in enumerate(holes) if hole.is_end and not hole.is_outer_rim and not hole.obstacle]
    planes = {k: rim_plane([mesh.vertices[holes[k].rim]]) for k in ends}
    flat = {k: plane for k, plane in planes.items() if plane and plane.is_nearly_flat}
    if len(flat) < 2:
        return holes
    order = sorted(flat, key=lambda k: -holes[k].diameter)
    boxes = np.array([_island_box(mesh, holes[k]) for k in order])
    inside = _rims_in_boxes(mesh, [holes[k] for k in order], boxes)
    smallest: dict[int, int] = {}  # rim around each inner rim
    for place, outer in enumerate(order):  # a later rim around an inner one is smaller
        if outer in smallest:
            continue
        for inner in (order[k] for k in inside.row(place).tolist() if k > place):
            if _bound_one_face(
                mesh.vertices[holes[inner].rim], flat[inner], mesh.vertices[holes[outer].rim], flat[outer]
            ):
                smallest[inner] = outer
    return _join_islands(holes, smallest)


def _bound_one_face(inner: FloatArray, island: RimPlane, outer: FloatArray, plane: RimPlane) -> bool:
    """Whether a rim lies inside another one, in its plane and with the opposite orientation."""
    heights = (np.concatenate([inner, outer]) - plane.origin) @ plane.axes[2]
    return bool(
        island.axes[2] @ plane.axes[2] < 0.0
        and np.sqrt(np.square(heights).mean()) <= MAX_ROUGH_DISTANCE * min(island.edge, plane.edge)
        and points_in_polygon(plane.project(inner), plane.project(outer)).all()
    )


def _rims_in_boxes(mesh: TriangleMesh, holes: list[Hole], boxes: FloatArray) -> Rows:
    """Holes whose first vertex lies in each of the boxes (b, 2, 3)."""
    firsts = np.array([mesh.vertices[hole.rim[0]] for hole in holes])
    points = np.arange(len(holes), dtype=np.int32)[:, np.newaxis].repeat(3, axis=1)  # degenerate faces
    return faces_in_boxes(firsts, points, boxes[:, 0], boxes[:, 1])


def _join_islands(holes: list[Hole], around: dict[int, int]) -> list[Hole]:
    """Join islands to the holes around them, given the number of that of each."""
    islands: dict[int, list[Hole]] = {}
    for island in sorted(around):
        islands.setdefault(around[island], []).append(holes[island])
    return [_add_islands(hole, islands.get(k, [])) for k, hole in enumerate(holes) if k not in around]


def _add_islands(hole: Hole, islands: list[Hole]) -> Hole:
    """Add the rims of islands to the loops of a hole."""
    loops = sum((island.loops for island in islands), ())
    length = sum((island.perimeter for island in islands), hole.perimeter)
    return replace(hole, loops=hole.loops + loops, perimeter=length)


def _island_box(mesh: TriangleMesh, hole: Hole) -> tuple[FloatArray, FloatArray]:
    """Lowest and highest corner of the box that contains the islands of a hole, each (3,)."""
    rim, margin = mesh.vertices[hole.rim], MAX_ISLAND_HEIGHT * hole.diameter
    return rim.min(axis=0) - margin, rim.max(axis=0) + margin


def _is_island_of(mesh: TriangleMesh, sheet: Hole, hole: Hole) -> bool:
    """Whether an outer rim is that of an island of a hole."""
    rim, points = mesh.vertices[hole.rim], mesh.vertices[sheet.rim]
    low, high = _island_box(mesh, hole)
    if sheet.diameter >= hole.diameter or not ((points > low) & (points < high)).all():
        return False
    normal = vector_area(rim)
    if not normal.any() or normal @ vector_area(points) >= 0.0:
        return False
    axes = plane_axes(normal)
    local = (points - rim.mean(axis=0)) @ axes.T
    near = np.abs(local[:, 2]) <= MAX_ISLAND_HEIGHT * hole.diameter
    return bool((near & points_in_polygon(local[:, :2], (rim - rim.mean(axis=0)) @ axes[:2].T)).all())
