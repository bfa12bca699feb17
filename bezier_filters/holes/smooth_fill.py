"""Smooth fills: a refined triangulation of the hole, faired or projected to the implicit surface around it.

The initial fill is the least-area triangulation of the rim, refined to the target edge lengths and faired by the
bi-Laplacian. It is projected to the zero set of a polyharmonic spline, alternating with tangential relaxation. Where no
such surface exists, simpler fills follow: tri-Laplacian or bi-Laplacian fairing (continuous curvature or tangent
planes), the membrane (Laplacian), and the bare triangulation.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.holes.band_triangulation import triangulate_band
from bezier_filters.holes.implicit_surface import ImplicitSurface, fit_implicit_surface, project_point
from bezier_filters.holes.influence_region import InfluenceRegion, select_surface_points
from bezier_filters.holes.loops import triangulate_loop
from bezier_filters.holes.polyharmonic_fairing import polyharmonic_continuation
from bezier_filters.holes.refinement import (
    Fill,
    RelaxationWorkspace,
    refine,
    relax_tangentially,
    relaxation_workspace,
    sort_pairs,
)
from bezier_filters.meshes.half_edges import ends_of_half_edges
from bezier_filters.runtime.jit import jit

MIN_ORIENTED_POINTS = 16  # points with known normals that a surface is fitted to
MAX_DIRECT_RIM_EDGES = 200  # edges of a rim up to which the initial fill is faired at its final resolution
MAX_FAIRED_VERTICES = 60_000  # vertices of a fill that is faired at its final resolution, if there is no surface
# distance between rim and surface that is corrected, in edges: a smaller one turns no face by more than this angle
MIN_RIM_GAP = 1e-4
RELAXATION_ROUNDS = 3  # of edge flips, relaxation and projection
UNTRIANGULATED = "every triangulation of the rim would join vertices that are joined already"


@dataclass(frozen=True)
class Attempt:
    """A fill, or the reason for a failure."""

    kind: str  # see `HoleReport.method`
    fill: Fill | None
    reason: str = ""  # of the failure, if there is no fill
    sub_hole_count: int = 1
    creases: IntArray | None = None  # (e, 2): edges of the fill that are creases


def smooth_attempts(region: InfluenceRegion, normals: FloatArray, *, noisy: bool) -> Iterator[Attempt]:
    """Fill a hole in a smooth surface; each attempt is simpler than the one before.

    `normals` (b, 3) are zero where they are unknown. Noisy points are smoothed, not interpolated.
    """
    fill = initial_fill(region)
    if fill is None:
        yield Attempt("flat", None, UNTRIANGULATED)
        return
    if len(fill.points) > fill.rim_count:
        yield _surface_attempt(fill, region, normals, noisy=noisy)
        yield Attempt("variational", _fairest_fill(fill, region, 2 if noisy else 3))
        yield Attempt("variational", fill)
    yield from membrane_attempts(region, fill)


def membrane_attempts(region: InfluenceRegion, fill: Fill | None = None) -> Iterator[Attempt]:
    """The harmonic fill, on the triangulation of another fill if there is one, and the triangulation of the rim."""
    fill = fill or initial_fill(region, order=1)
    if fill is None:
        yield Attempt("flat", None, UNTRIANGULATED)
        return
    if len(fill.points) > fill.rim_count:
        yield Attempt("flat", _fair(fill, region, 1))
    yield Attempt("flat", triangulate_rim(region))


def _surface_attempt(fill: Fill, region: InfluenceRegion, normals: FloatArray, *, noisy: bool) -> Attempt:
    surface = fit_surrounding_surface(region, normals, noisy=noisy)
    if isinstance(surface, str):
        return Attempt("surface", None, surface)
    projected = project_to_surface(fill, region, surface)
    if projected is None:
        return Attempt("surface", None, "the surface around the hole does not continue into it")
    # in noise the rim does not lie on the surface, and a fill that follows it would have its noise
    return Attempt("surface", projected if noisy else attach_to_rim(projected, region, surface))


def _fairest_fill(fill: Fill, region: InfluenceRegion, order: int) -> Fill:
    """A fill faired at its final resolution, or at a coarser one if it has too many vertices."""
    if len(fill.points) <= MAX_FAIRED_VERTICES:
        return _fair(fill, region, order)
    return initial_fill(region, order, coarse=float(np.sqrt(len(fill.points) / MAX_FAIRED_VERTICES))) or fill


def initial_fill(region: InfluenceRegion, order: int = 2, coarse: float | None = None) -> Fill | None:
    """Triangulate, refine and fair a hole; None if no triangulation of its rim is a manifold.

    `order` is the power of the Laplacian that vanishes: 2, or 1 where faces beyond some of the rim are missing, so that
    there are no tangent planes to continue. Fills of large holes are faired with edges longer by the factor `coarse`
    and then refined.
    """
    fill = triangulate_rim(region)
    if fill is None:
        return None
    coarse = max(1.0, region.rim_count / MAX_DIRECT_RIM_EDGES) if coarse is None else coarse
    fill = replace(fill, sizes=coarse * fill.sizes)
    fill = _fair(refine(fill, region.rim_edges), region, order)
    fill = refine(replace(fill, sizes=fill.sizes / coarse), region.rim_edges)
    return fill if coarse > 1.0 else _fair(fill, region, order)


def triangulate_rim(region: InfluenceRegion) -> Fill | None:
    """Triangulate the rim, or connect it to one new vertex if every triangulation would repeat an existing edge."""
    if region.is_band:
        first, second = region.loops
        faces = triangulate_band(region.rim_vertices, first, second, region.rim_edges)
        if faces is None or not _is_manifold(faces):
            return None
        return Fill(region.rim_vertices, region.sizes, faces, region.rim_count)
    polygon, normals, gaps = _join_loops(region)
    points = region.rim_vertices
    faces = triangulate_loop(points[polygon], polygon, normals, gaps, region.rim_edges)
    sizes = region.sizes
    # Where islands touch the rim, two triangles may share a half-edge.
    if faces is not None and not region.has_simple_rim and not _is_manifold(faces):
        faces = None
    if faces is None and len(polygon) > region.rim_count:
        return None
    if faces is None:
        hub = np.full(len(polygon), region.rim_count)
        faces = np.stack([polygon, np.roll(polygon, -1), hub], axis=1).astype(np.int32)
        points = np.vstack([points, points[polygon].mean(axis=0)])
        sizes = np.append(sizes, sizes.mean())
    return Fill(points, sizes, faces, region.rim_count)


def _is_manifold(faces: IntArray) -> bool:
    """Whether no half-edge occurs twice and no face repeats a vertex."""
    starts, ends = ends_of_half_edges(faces)
    edges = starts * (np.int64(faces.max()) + 1) + ends
    return len(np.unique(edges)) == len(edges) and bool((starts != ends).all())


def _join_loops(region: InfluenceRegion) -> tuple[IntArray, FloatArray, FloatArray]:
    """All loops as one polygon, connected by shortest bridges, with the face normals and gap angles along it."""
    polygon = region.loops[0]
    normals = region.rim_face_normals(polygon)
    for loop in region.loops[1:]:
        points = region.vertices
        distances = np.linalg.norm(points[polygon][:, np.newaxis] - points[loop], axis=2)
        i, j = np.unravel_index(np.argmin(distances), distances.shape)
        beyond = region.rim_face_normals(loop)
        zero = np.zeros((1, 3))
        rotated, rotated_normals = np.roll(loop, -j), np.roll(beyond, -j, axis=0)
        if polygon[i] == loop[j]:  # the island touches: ..., loop[j], ..., polygon[i], ...
            polygon = np.concatenate([polygon[:i], rotated, polygon[i:]])
            normals = np.vstack([normals[:i], rotated_normals, normals[i:]])
            continue
        # ... polygon[i], loop[j], ..., loop[j], polygon[i], ...; each corner has the normal of the edge after it.
        polygon = np.concatenate([polygon[: i + 1], rotated, rotated[:1], polygon[i:]])
        normals = np.vstack([normals[:i], zero, rotated_normals, zero, normals[i:]])
    count = np.bincount(polygon, minlength=region.rim_count)
    return polygon, normals, (region.gaps / np.maximum(count, 1))[polygon]


def _fair(fill: Fill, region: InfluenceRegion, order: int) -> Fill:
    """Solve Delta^order x = 0 for the new vertices, with order - 1 rings around the rim as boundary conditions."""
    count = int(np.searchsorted(region.rings, max(order - 1, 1), side="right"))
    faces = np.where(fill.faces < fill.rim_count, fill.faces, fill.faces + (count - fill.rim_count))
    around = region.faces[(region.faces < count).all(axis=1)]
    points = np.vstack([region.vertices[:count], fill.points[fill.rim_count :]])
    faired = polyharmonic_continuation(points, np.vstack([around, faces]), points[:count], order)
    return replace(fill, points=np.vstack([fill.points[: fill.rim_count], faired[count:]]))


def fit_surrounding_surface(
    region: InfluenceRegion, normals: FloatArray, *, noisy: bool, others: FloatArray | None = None
) -> ImplicitSurface | str:
    """Surface through points of the region with known normals (b, 3) and others (k, 3), or the reason for a failure."""
    known = np.einsum("ij,ij->i", normals, normals) > 0.25
    if np.count_nonzero(known) < MIN_ORIENTED_POINTS:
        return "too few vertices around the hole to fit a surface"
    ids = select_surface_points(region, known, noisy=noisy)
    step = float(region.sizes.mean())
    surface = fit_implicit_surface(region.vertices[ids], normals[ids], step, noisy=noisy, others=others)
    return "the surface around the hole does not continue into it" if surface is None else surface


def project_to_surface(fill: Fill, region: InfluenceRegion, surface: ImplicitSurface) -> Fill | None:
    """Project the new vertices of a fill to a surface and relax them tangentially; None if a projection fails."""
    points, faces = fill.points.copy(), fill.faces.copy()
    is_projected = _project_and_relax(
        surface, points, faces, relaxation_workspace(fill), sort_pairs(region.rim_edges), fill.rim_count
    )
    return replace(fill, points=points, faces=faces) if is_projected else None


@jit()
def _project_and_relax(
    surface: ImplicitSurface,
    points: FloatArray,
    faces: IntArray,
    work: RelaxationWorkspace,
    existing: IntArray,
    rim_count: int,
) -> bool:
    """Alternate projection to the surface and tangential relaxation; return whether all projections converged."""
    for round_ in range(RELAXATION_ROUNDS + 1):
        for i in range(rim_count, points.shape[0]):
            if not project_point(surface, points, i):
                return False
        if round_ < RELAXATION_ROUNDS:
            relax_tangentially(points, faces, work, existing, rim_count)
    return True


def attach_to_rim(fill: Fill, region: InfluenceRegion, surface: ImplicitSurface) -> Fill:
    """Displace a fill harmonically so that it meets its rim, whose noisy vertices do not lie on the surface."""
    rim = fill.points[: fill.rim_count]
    feet, found = surface.project(rim)
    shift = np.where(found[:, np.newaxis], rim - feet, 0.0)
    if np.abs(shift).max(initial=0.0) < MIN_RIM_GAP * region.sizes.mean():
        return fill
    points = fill.points + polyharmonic_continuation(fill.points, fill.faces, shift)
    points[: fill.rim_count] = rim
    return replace(fill, points=points)
