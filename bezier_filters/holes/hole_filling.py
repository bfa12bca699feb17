"""Hole filling: the function that users call, and what it gives."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, get_args

import numpy as np
from numpy.typing import ArrayLike

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.display import html_table
from bezier_filters.errors import InvalidParameterError
from bezier_filters.estimation.fit_options import check_noise
from bezier_filters.holes.fill_methods import (
    FILL_METHODS,
    FaceSet,
    FillingMethod,
    HoleReport,
    OpenMesh,
    fill_group,
    groups_of_boxes,
    hole_box,
    meeting_boxes,
)
from bezier_filters.holes.hole_detection import HoleChoice, find_holes
from bezier_filters.holes.influence_region import influence_regions, known_surface
from bezier_filters.holes.planar_fill import Correction
from bezier_filters.meshes.adjacency import vertex_adjacency
from bezier_filters.meshes.mesh import checked_selection, takes_arrays, triangle_mesh
from bezier_filters.meshes.self_intersections import faces_in_boxes
from bezier_filters.meshes.unit_size import LENGTH, normalizes_size
from bezier_filters.patches.fitting import PatchFit
from bezier_filters.runtime.parallel import Progress, on_threads, report, run_kernel

if TYPE_CHECKING:
    from bezier_filters import Page


@dataclass(frozen=True, repr=False)
class HoleFillingResult:
    """A mesh with filled holes.

    Attributes
    ----------
    vertices : (n + added, 3) float64
        The old vertices, unchanged, and the new ones after them.
    faces : (m + added, 3) int32
        The old faces, unchanged, and the new ones after them, oriented as those around them.
    holes : tuple of HoleReport
        One for every hole and every outer rim, ordered by the smallest vertex of the rim.
    noise : float or None
        Standard deviation of the noise along the normal that fills were fitted with, a length; None if it could not be
        learned.
    """

    vertices: FloatArray = field(metadata=LENGTH)
    faces: IntArray
    holes: tuple[HoleReport, ...]
    noise: float | None = field(metadata=LENGTH)

    @property
    def filled(self) -> int:
        """Number of holes that were filled."""
        return sum(hole.filled for hole in self.holes)

    def show(self) -> "Page":
        """Show the mesh before and after in a notebook, as `bezier_filters.show` does."""
        from bezier_filters import show  # by its public name: pictures know holes, not the other way around

        vertices = len(self.vertices) - sum(len(hole.new_vertices) for hole in self.holes)
        faces = len(self.faces) - sum(len(hole.new_faces) for hole in self.holes)
        return show(self.vertices[:vertices], self.faces[:faces], self)

    def __repr__(self) -> str:
        """One line: how many holes there were, and how many were filled."""
        return (
            f"HoleFillingResult({len(self.vertices)} vertices, {len(self.faces)} faces, "
            f"{self.filled} of {len(self.holes)} holes filled)"
        )

    def _repr_html_(self) -> str:
        """Table of the holes for notebooks."""
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
        return html_table(f"{self.filled:,} of {len(self.holes):,} holes filled", header, rows)


@takes_arrays
@normalizes_size("max_perimeter", "max_diameter", "noise")
@on_threads
def fill_holes(
    vertices: ArrayLike,
    faces: ArrayLike,
    method: FillingMethod = "auto",
    *,
    max_edges: int | None = None,
    max_perimeter: float | None = None,
    max_diameter: float | None = None,
    holes: Sequence[int] | None = None,
    selected: BoolArray | None = None,
    outer_rims: bool = False,
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
    default they lie on the surface which continues the one around the hole: the zero set of a polyharmonic spline that
    interpolates points of five rings and the normals of their Bezier patches, or fits them on noisy meshes, where the
    smoothness of the spline follows from the data. Where that is not possible, or cuts the mesh, simpler fills are
    tried, and the report says so. A hole whose fills all cut other faces is left open, unless `intersecting` asks for
    it. The old vertices and faces stay as they are. Left open are borders that lie on each other, which have no width,
    and those that meet an edge with more than two faces or with two that run through it the same way; `reason` says
    where.

    ``method="paper"`` lifts the Delaunay triangulation of the rim in the plane of the hole to one bicubic patch and
    corrects it to pass through the rim (Li, Barsky, Jin, "An effective third-order local fitting patch and its
    application", IEEE SMI 2009). Sharp edges that end at the rim are joined by cubic curves, which cut the hole into
    parts; each has a patch of its own.

    Parameters
    ----------
    vertices : (n, 3) array_like of float
        Coordinates.
    faces : (m, 3) array_like of int
        Triangles, counter-clockwise seen from outside.
    method : {"auto", "paper"}
        How to fill.
    max_edges : int, optional
        Fill only holes with no more edges, those of islands included; at least 3.
    max_perimeter, max_diameter : float, optional
        Fill only holes that are no larger, lengths.
    holes : sequence of int, optional
        Fill only these, as they are numbered in the result; outer rims may be among them.
    selected : (n,) bool, optional
        Fill only holes with a selected vertex on their rim.
    outer_rims : bool
        Whether to fill the outer rims of open sheets, too: loops whose total geodesic curvature, as the sheet
        sees it, exceeds pi. It is 2 pi around a flat sheet, 0 at the ends of a tube and -2 pi around a hole.
    intersecting : bool
        Whether to fill holes, too, whose fills all cut other faces or themselves: by the one that cuts least.
    creases : bool
        Whether sharp edges that end at a hole are continued through it.
    noise : float, optional
        Standard deviation of the noise along the normal, a length, if it is known better than it can be
        learned; 0 interpolates.
    alpha : float, optional
        Weight of the points against the smoothness of the patch, in (0, 1], by default 0.8, for ``"paper"`` only.
    correction : {"harmonic", "lagrange", "lagrange_pieces"}
        How the patch is made to end at the rim, for ``"paper"`` only: by harmonic functions, by the paper's products of
        Lagrange polynomials, which are infinite where two vertices of the rim share a parameter, or by such products
        in pieces of the plane with four vertices of the rim at most, which do not meet between these.
    refine : bool
        Whether the patch gets new vertices, so that its triangles are as large as those around the hole. False, for
        ``"paper"`` only, is the Delaunay triangulation of the rim alone, as in the paper; a curve that continues a
        sharp edge has vertices all the same, and fills by other methods, where there is no patch, are refined.
    on_border : (n,) bool, optional
        Vertices on an edge of one face only, if another program has found them; by default they are found here.
    threads : int, optional
        Number of threads; by default BEZIER_FILTERS_THREADS or all usable cores. The result
        does not depend on it.
    progress : callable, optional
        ``progress(done, total)`` is called from this thread now and then; if it returns False
        the call is cancelled.

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
    mesh = triangle_mesh(vertices, faces)
    if method not in FILL_METHODS:
        raise InvalidParameterError(f"method: got {method!r}, expected one of {tuple(FILL_METHODS)}")
    check_noise(noise)
    if method != "paper" and alpha is not None:
        raise InvalidParameterError(f"alpha: method={method!r} does not use it; leave it out")
    alpha = 0.8 if alpha is None else alpha
    PatchFit(alpha=alpha)
    if correction not in get_args(Correction):
        raise InvalidParameterError(f"correction: got {correction!r}, expected one of {get_args(Correction)}")
    if method != "paper" and not refine:
        raise InvalidParameterError(f"refine: method={method!r} always refines; leave it out")
    choice = HoleChoice(max_edges, max_perimeter, max_diameter, holes, selected, outer_rims)
    adjacency = vertex_adjacency(mesh)
    if on_border is not None:
        adjacency = replace(adjacency, on_boundary=checked_selection(on_border, mesh.vertex_count, "on_border"))
    found = find_holes(mesh, adjacency)
    choice.check(mesh.vertex_count, len(found))
    refusals = [choice.refusal(k, hole) for k, hole in enumerate(found)]
    # The lid of a sheet that is not flat may go through the holes in it: it must give way to their fills.
    numbers = sorted(np.flatnonzero([not refusal for refusal in refusals]), key=lambda k: found[k].is_outer_rim)
    chosen = [found[k] for k in numbers]
    regions = influence_regions(mesh, adjacency, [hole.loops for hole in chosen])
    known = known_surface(mesh, adjacency, regions, noise)
    boxes = np.array([hole_box(mesh, hole) for hole in chosen]).reshape(-1, 2, 3)
    near = faces_in_boxes(mesh.vertices, mesh.faces, boxes[:, 0], boxes[:, 1])
    reports = [
        HoleReport(h.rim, len(h.loops) - 1, h.edge_count, h.perimeter, h.diameter, h.is_outer_rim, reason=refusal)
        for h, refusal in zip(found, refusals, strict=True)
    ]
    open_ = [reports[k] for k in numbers]
    meeting = meeting_boxes(boxes)
    task = OpenMesh(
        mesh, known, open_, boxes, meeting, near, method, creases, intersecting, float(alpha), correction, refine
    )
    points, triangles = [mesh.vertices], [mesh.faces]
    vertex_count, face_count = mesh.vertex_count, mesh.face_count
    for number, (described, fill) in zip(numbers, _filled(task, progress), strict=True):
        reports[number] = described
        if fill is None:
            continue
        ids, is_new = fill.ids.copy(), fill.ids >= mesh.vertex_count
        new_vertices = range(vertex_count, vertex_count + np.count_nonzero(is_new))
        new_faces = range(face_count, face_count + len(fill.faces))
        ids[is_new] = new_vertices  # which were numbered within their group
        edges = ids[described.creases].astype(np.int32)
        reports[number] = replace(described, creases=edges, new_vertices=new_vertices, new_faces=new_faces)
        points.append(fill.points[is_new])
        triangles.append(ids[fill.faces].astype(np.int32))
        vertex_count, face_count = new_vertices.stop, new_faces.stop
    return HoleFillingResult(np.vstack(points), np.vstack(triangles), tuple(reports), known.noise)


def _filled(task: OpenMesh, progress: Progress | None) -> list[tuple[HoleReport, FaceSet | None]]:
    """Fill all holes, on several threads if there are several groups of them."""
    groups = groups_of_boxes(task.boxes)
    results: dict[int, tuple[HoleReport, FaceSet | None]] = {}
    total = len(task.reports)
    report(progress, 0, total)

    def fill_groups(start: int, stop: int) -> None:
        for group in (part.tolist() for part in groups[start:stop]):
            fills = fill_group(task, group)
            results.update(zip(group, fills, strict=True))

    of_holes = None if progress is None else lambda _, __: progress(len(results), total)
    run_kernel(fill_groups, len(groups), progress=of_holes, chunk=1)
    return [results[k] for k in range(total)]
