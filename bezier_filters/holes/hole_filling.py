"""Hole filling: the public function `fill_holes` and its result.

The steps: detect border loops, choose holes, collect influence regions of five rings, estimate normals and noise around
them, and try the filling methods for each hole. Holes whose bounding boxes overlap are filled one after the other,
others in parallel.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.holes.fill_choice import FaceSet
from bezier_filters.holes.fill_methods import (
    FillingMethod,
    FillOptions,
    MeshTask,
    box_groups,
    fill_group,
    hole_box,
    overlapping_boxes,
)
from bezier_filters.holes.hole import Hole
from bezier_filters.holes.hole_detection import HoleChoice, find_holes
from bezier_filters.holes.hole_report import HoleReport, describe_hole, hole_columns
from bezier_filters.holes.influence_region import hole_surroundings, influence_regions
from bezier_filters.holes.planar_fill import Correction
from bezier_filters.holes.remaining_mesh import RemainingMesh
from bezier_filters.holes.rim_trimming import trim_rims
from bezier_filters.meshes.mesh import check_selection, takes_meshes, triangle_mesh
from bezier_filters.meshes.mesh_objects import MeshLike
from bezier_filters.meshes.prepared_mesh import PreparedMesh, prepare_mesh
from bezier_filters.meshes.self_intersections import faces_in_boxes
from bezier_filters.meshes.unit_size import LENGTH, normalizes_size
from bezier_filters.result_tables import Table, TabularResult
from bezier_filters.runtime.parallel import Progress, report, run_kernel, runs_on_threads
from bezier_filters.surface_model.fit_options import check_noise

if TYPE_CHECKING:
    from bezier_filters import Page


class _HoleCounts:
    """What follows from the reports of holes; fields of a `HoleFillingResult` of these names."""

    holes: tuple[HoleReport, ...]

    @property
    def filled(self) -> int:
        """Number of holes that were filled."""
        return sum(hole.filled for hole in self.holes)


@dataclass(frozen=True, repr=False)
class HoleFillingResult(_HoleCounts, TabularResult):
    """A mesh with filled holes.

    Attributes
    ----------
    vertices : (n + added, 3) float64
        The old vertices, unchanged and without the vertices of trimmed faces alone, and the new ones after.
    faces : (m + added, 3) int32
        The old faces, unchanged and without trimmed ones, and the new ones after them, with the orientation of the
        faces around them.
    holes : tuple of HoleReport
        One for every hole and every outer rim, ordered by the smallest vertex of the rim.
    noise : float or None
        Standard deviation of the noise along the normal that the fills assume, a length; None if it could not be
        estimated.
    old_vertices, old_faces : (n,) and (m,) int32
        Rows of the old vertices and faces in the given mesh: all of them, unless some were trimmed.
    filled : int
        Derived: number of holes that were filled.
    """

    vertices: FloatArray = field(metadata=LENGTH)
    faces: IntArray
    holes: tuple[HoleReport, ...]
    noise: float | None = field(metadata=LENGTH)
    old_vertices: IntArray
    old_faces: IntArray
    filled: int = field(init=False)

    def show(self) -> "Page":
        """Show the mesh before and after in a notebook, as `bezier_filters.show` does."""
        from bezier_filters import show  # by its public name: `pictures` imports `holes`, not the reverse

        vertices, faces = len(self.old_vertices), len(self.old_faces)
        return show(self.vertices[:vertices], self.faces[:faces], self)

    def __repr__(self) -> str:
        """One line: how many holes there were, and how many were filled."""
        return (
            f"{type(self).__name__}({len(self.vertices)} vertices, {len(self.faces)} faces, "
            f"{self.filled} of {len(self.holes)} holes filled)"
        )

    def _tables(self) -> list[Table]:
        header = ["edges", "diameter [length]", "fill", "new faces", "rim angle [degrees]", "remarks"]
        rows = [
            [
                hole.edge_count,
                hole.diameter,
                hole.method or "left open",
                len(hole.new_faces),
                hole.rim_dihedral if hole.filled else None,
                hole.reason,
            ]
            for hole in self.holes
        ]
        return [Table(f"{self.filled:,} of {len(self.holes):,} holes filled", header, rows)]

    def _columns(self) -> dict[str, list[object]]:
        return hole_columns(self.holes)


@takes_meshes
@normalizes_size("max_perimeter", "max_diameter", "noise")
@runs_on_threads
def fill_holes(
    vertices: ArrayLike | MeshLike,
    faces: ArrayLike | None = None,
    method: FillingMethod = "auto",
    *,
    max_edges: int | None = None,
    max_perimeter: float | None = None,
    max_diameter: float | None = None,
    holes: Sequence[int] | None = None,
    selected: BoolArray | None = None,
    outer_rims: bool = False,
    bolt_holes: bool = False,
    trim: bool = False,
    intersecting: bool = False,
    creases: bool = True,
    noise: float | None = None,
    alpha: float | None = None,
    correction: Correction = "harmonic",
    refine: bool = True,
    on_border: BoolArray | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> HoleFillingResult:
    """Fill the holes of a mesh.

    The new triangles are about as large as those around the hole, and larger far from the rim of a large one. By
    default they lie in the plane of the rim where the surface ends in one, and elsewhere on the zero set of a
    polyharmonic spline. It interpolates the points of five rings and the normals
    of their Bezier patches; on noisy meshes it smooths them, with a smoothing parameter estimated by restricted maximum
    likelihood (REML). If there is no such surface, or if its fill intersects the mesh, simpler fills are tried, and the
    report says so. Sharp edges that run into a hole are continued through it. A hole whose fills all intersect other
    faces stays open unless `intersecting` is set. The old vertices and faces do not change. Borders that coincide have
    no width and stay open, and so do borders that meet a non-manifold edge, with more than two faces or with two of
    opposite orientation; `reason` says where.

    ``method="paper"`` lifts the Delaunay triangulation of the rim in the plane of the hole to one bicubic patch and
    corrects it to pass through the rim (Li, Barsky, Jin, "An effective third-order local fitting patch and its
    application", IEEE SMI 2009). Sharp edges that end at the rim are joined by cubic curves, which cut the hole into
    sub-holes; each has its own patch.

    Parameters
    ----------
    vertices : (n, 3) array_like of float, or mesh object
        Coordinates; or a mesh of another library, see `mesh_arrays`, and no faces.
    faces : (m, 3) array_like of int
        Triangles, counter-clockwise seen from outside.
    method : {"auto", "surface", "flat", "paper"}
        ``"surface"`` continues the surface around a hole, and ``"flat"`` fills it in the plane of its rim, or with the
        membrane in its rim if that leaves the plane. ``"auto"`` takes ``"flat"`` where the surface ends in a plane, as
        at a cut tube or a box without its lid: the rim lies in a plane, apart from noise and rounding, and the faces at
        it are at more than 60 degrees to the plane, in the mean. ``"paper"`` is the paper's method, see above.
    max_edges : int, optional
        Fill only holes with at most this many edges, including those of islands; at least 3.
    max_perimeter, max_diameter : float, optional
        Fill only holes up to this size, lengths.
    holes : sequence of int, optional
        Fill only the holes with these numbers in the result; outer rims may be among them.
    selected : (n,) bool, optional
        Fill only holes with a selected vertex on their rim.
    outer_rims : bool
        Whether to fill the outer rims of open sheets, too: loops whose total geodesic curvature, seen from the
        sheet, exceeds pi. It is 2 pi around a flat sheet, 0 at the ends of a tube and -2 pi around a hole.
    bolt_holes : bool
        Whether to fill circles in flat parts of open sheets, too, which are left open like the holes for bolts in a
        part. Those in `holes` or selected are filled in any case.
    trim : bool
        Whether to remove spikes and flaps where all fills of a hole intersect others: faces at its rim that intersect
        others themselves, or all faces at the rim if that is not enough. They stay if the hole
        cannot be filled without them, either.
    intersecting : bool
        Whether to fill a hole whose fills all intersect other faces or themselves, by the one with the fewest
        intersecting faces.
    creases : bool
        Whether to continue sharp edges that end at a hole through it.
    noise : float, optional
        Standard deviation of the noise along the normal, a length; by default it is estimated. 0 interpolates.
    alpha : float, optional
        Weight of the points against the smoothness of the patch, in (0, 1], by default 0.8, for ``"paper"`` only.
    correction : {"harmonic", "lagrange", "lagrange_pieces"}
        Displacement that makes the patch pass through the rim, for ``"paper"`` only: harmonic functions; the paper's
        products of Lagrange polynomials, which are infinite if two rim vertices share a parameter; or such products
        in pieces of the plane with at most four rim vertices, which are discontinuous between the pieces.
    refine : bool
        Whether the patch gets new vertices, so that its triangles are as large as those around the hole. False, for
        ``"paper"`` only, gives the Delaunay triangulation of the rim alone, as in the paper. Curves that continue sharp
        edges have vertices in any case, and fills by other methods, if there is no patch, are refined.
    on_border : (n,) bool, optional
        Vertices on an edge of one face only, if another program has determined them; computed by default.
    threads : int, optional
        Number of threads; by default BEZIER_FILTERS_THREADS or all usable cores. The result
        does not depend on it.
    progress : callable, optional
        ``progress(done, total)`` is called from this thread at intervals; if it returns False the call is
        cancelled.

    Returns
    -------
    HoleFillingResult

    Raises
    ------
    InvalidMeshError
        If the arrays are not a mesh with finite coordinates.
    InvalidParameterError
        If a parameter is out of range.
    CancelledError
        If `progress` returned False.

    Examples
    --------
    >>> from bezier_filters.surfaces import sphere
    >>> ball = sphere(resolution=16)
    >>> cap = ball.vertices[ball.faces].mean(axis=1)[:, 2] > 0.9
    >>> result = fill_holes(ball.vertices, ball.faces[~cap])
    >>> result.filled, result.holes[0].method
    (1, 'surface')
    >>> new = result.vertices[len(ball.vertices):]
    >>> bool(np.abs(np.linalg.norm(new, axis=1) - 1.0).max() < 1e-3)
    True
    """
    mesh = prepare_mesh(triangle_mesh(vertices, faces))
    check_noise(noise)
    options = FillOptions(method, creases, intersecting, alpha, correction, refine)
    choice = HoleChoice(max_edges, max_perimeter, max_diameter, holes, selected, bolt_holes, outer_rims)
    if on_border is not None:
        border = check_selection(on_border, mesh.vertex_count, "on_border")
        mesh = replace(mesh, adjacency=replace(mesh.adjacency, on_boundary=border))
    found = find_holes(mesh)
    choice.check(mesh.vertex_count, len(found))
    refusals = [choice.refusal(k, hole) for k, hole in enumerate(found)]
    result = _fill_found(mesh, found, refusals, noise, options, progress)
    return _fill_trimmed(mesh, result, noise, options, progress) if trim else result


def _fill_trimmed(
    mesh: PreparedMesh,
    result: HoleFillingResult,
    noise: float | None,
    options: FillOptions,
    progress: Progress | None,
) -> HoleFillingResult:
    """Fill again without spikes and flaps at the rims of holes that stayed open because of them."""
    reasons = {
        vertex: hole.reason
        for hole in result.holes
        if not (hole.filled or hole.self_intersections)
        for vertex in hole.rim.tolist()
    }
    filled = result

    def fill(rest: RemainingMesh) -> Sequence[HoleReport]:
        nonlocal filled
        found = find_holes(rest.mesh)
        rims = [rest.old_vertices[hole.rim].tolist() for hole in found]
        refusals = [next((reasons[vertex] for vertex in rim if vertex in reasons), "") for rim in rims]
        filled = _fill_found(rest.mesh, found, refusals, noise, options, progress)
        return filled.holes

    trimmed = trim_rims(mesh, result.holes, fill)
    if trimmed is None:
        return result
    return replace(filled, old_vertices=trimmed.old_vertices, old_faces=trimmed.old_faces)


def _fill_found(
    mesh: PreparedMesh,
    found: Sequence[Hole],
    refusals: Sequence[str],
    noise: float | None,
    options: FillOptions,
    progress: Progress | None,
) -> HoleFillingResult:
    """Fill the holes that are not refused; the reports have the order of all of them."""
    # The fill of the outer rim of a curved sheet may intersect the fills of its holes, which have priority.
    numbers = [k for k, refusal in enumerate(refusals) if not refusal]
    numbers.sort(key=lambda k: found[k].is_outer_rim)
    filled = fill_chosen(mesh, [found[k] for k in numbers], noise, options, progress)
    reports = [describe_hole(hole, refusal) for hole, refusal in zip(found, refusals, strict=True)]
    for number, hole in zip(numbers, filled.holes, strict=True):
        reports[number] = hole
    return replace(filled, holes=tuple(reports))


def fill_chosen(
    mesh: PreparedMesh, holes: Sequence[Hole], noise: float | None, options: FillOptions, progress: Progress | None
) -> HoleFillingResult:
    """Fill holes in the order of their priority, in which the result lists them."""
    regions = influence_regions(mesh, [hole.loops for hole in holes])
    regions = [replace(region, is_band=hole.is_band) for region, hole in zip(regions, holes, strict=True)]
    surroundings = hole_surroundings(mesh, regions, noise)
    boxes = np.array([hole_box(mesh, hole) for hole in holes]).reshape(-1, 2, 3)
    nearby_faces = faces_in_boxes(mesh.vertices, mesh.faces, boxes[:, 0], boxes[:, 1])
    is_end = np.array([hole.is_end for hole in holes], dtype=np.bool_)
    open_ = [describe_hole(hole) for hole in holes]
    task = MeshTask(mesh, surroundings, open_, is_end, boxes, overlapping_boxes(boxes), nearby_faces, options)
    points, triangles, reports = [mesh.vertices], [mesh.faces], list[HoleReport]()
    vertex_count, face_count = mesh.vertex_count, mesh.face_count
    for described, fill in _fill_all(task, progress):
        if fill is None:
            reports.append(described)
            continue
        ids, is_new = fill.ids.copy(), fill.ids >= mesh.vertex_count
        new_vertices = range(vertex_count, vertex_count + np.count_nonzero(is_new))
        new_faces = range(face_count, face_count + len(fill.faces))
        ids[is_new] = new_vertices  # numbered within their group until here
        edges = ids[described.creases].astype(np.int32)
        reports.append(replace(described, creases=edges, new_vertices=new_vertices, new_faces=new_faces))
        points.append(fill.points[is_new])
        triangles.append(ids[fill.faces].astype(np.int32))
        vertex_count, face_count = new_vertices.stop, new_faces.stop
    old = (np.arange(count, dtype=np.int32) for count in (mesh.vertex_count, mesh.face_count))
    return HoleFillingResult(np.vstack(points), np.vstack(triangles), tuple(reports), surroundings.noise, *old)


def _fill_all(task: MeshTask, progress: Progress | None) -> list[tuple[HoleReport, FaceSet | None]]:
    """Fill all holes; groups of overlapping boxes run on several threads."""
    groups = box_groups(task.boxes)
    results: dict[int, tuple[HoleReport, FaceSet | None]] = {}
    total = len(task.reports)
    report(progress, 0, total)

    def fill_groups(start: int, stop: int) -> None:
        for group in (numbers.tolist() for numbers in groups[start:stop]):
            fills = fill_group(task, group)
            results.update(zip(group, fills, strict=True))

    hole_progress = None if progress is None else lambda _, __: progress(len(results), total)
    run_kernel(fill_groups, len(groups), progress=hole_progress, chunk=1)
    return [results[k] for k in range(total)]
