"""Fill a hole where the surface is smooth: triangles as large as those around it, on a surface that goes on."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.holes.implicit_surface import ImplicitSurface, fit_implicit_surface, project_point
from bezier_filters.holes.influence_region import InfluenceRegion, fitted_points
from bezier_filters.holes.loops import triangulate_loop
from bezier_filters.holes.polyharmonic_fairing import polyharmonic_continuation
from bezier_filters.holes.refinement import Fill, WorkSpace, even_out, refine, sorted_pairs, work_space
from bezier_filters.meshes.half_edges import ends_of_half_edges
from bezier_filters.runtime.jit import jit

FEWEST_POINTS = 16  # with known normals, for a surface
MOST_AT_ONCE = 200  # edges of a rim up to which the fill is faired at its final resolution
MOST_FAIRED = 60_000  # vertices of a fill up to which that is done later on, where no surface goes on
# of an edge, between rim and surface, that is worth a shift: less turns no face by more than that angle
SMALLEST_GAP = 1e-4
ROUNDS = 3  # of flips and relaxation on the surface


@dataclass(frozen=True)
class Attempt:
    """A fill, or why there is none."""

    kind: str  # see `HoleReport.method`
    fill: Fill | None  # triangles on the rim and new vertices
    reason: str = ""  # what went wrong, if there is no fill
    parts: int = 1  # sub-holes
    creases: IntArray | None = None  # (e, 2): edges of the fill that are creases


def smooth_attempts(region: InfluenceRegion, normals: FloatArray, *, noisy: bool) -> Iterator[Attempt]:
    """Fill a hole in a smooth surface, in ever simpler ways.

    `normals` (b, 3) are zero where they are not known; where it is noisy, the points are fitted, not interpolated.
    """
    fill = first_fill(region)
    if fill is None:
        yield Attempt("flat", None, "every triangulation of the rim would join vertices that are joined already")
        return
    if len(fill.points) > fill.rim_count:
        yield _continued(fill, region, normals, noisy=noisy)
        yield Attempt("variational", _smoothest(fill, region, 2 if noisy else 3))
        yield Attempt("variational", fill)
        yield Attempt("flat", _faired(fill, region, 1))
    yield Attempt("flat", _triangulated(region))


def _continued(fill: Fill, region: InfluenceRegion, normals: FloatArray, *, noisy: bool) -> Attempt:
    surface = surface_around(region, normals, noisy=noisy)
    if isinstance(surface, str):
        return Attempt("surface", None, surface)
    moved = project_to_surface(fill, region, surface)
    if moved is None:
        return Attempt("surface", None, "the surface around the hole does not continue into it")
    return Attempt("surface", meet_rim(moved, region, surface))


def _smoothest(fill: Fill, region: InfluenceRegion, order: int) -> Fill:
    """A fill faired at its final resolution, or at the finest one that time and memory allow."""
    if len(fill.points) <= MOST_FAIRED:
        return _faired(fill, region, order)
    return first_fill(region, order, coarse=float(np.sqrt(len(fill.points) / MOST_FAIRED))) or fill


def first_fill(region: InfluenceRegion, order: int = 2, coarse: float | None = None) -> Fill | None:
    """Triangulate, refine and fair a hole; None if no triangulation of its rim makes a manifold.

    `order` is the power of the Laplacian that vanishes: 2, or 1 where there are no faces beyond a part of the rim,
    whose tangent planes could be continued. Fills of large holes are faired with edges that are longer by a factor, and
    then refined.
    """
    fill = _triangulated(region)
    if fill is None:
        return None
    coarse = max(1.0, region.rim_count / MOST_AT_ONCE) if coarse is None else coarse
    fill = replace(fill, sizes=coarse * fill.sizes)
    fill = _faired(refine(fill, region.rim_edges), region, order)
    fill = refine(replace(fill, sizes=fill.sizes / coarse), region.rim_edges)
    return fill if coarse > 1.0 else _faired(fill, region, order)


def _triangulated(region: InfluenceRegion) -> Fill | None:
    """Join the vertices of the rim, or join them to one more vertex if they are joined elsewhere already."""
    polygon, normals, gaps = _polygon(region)
    points = region.rim_vertices
    faces = triangulate_loop(points[polygon], polygon, normals, gaps, region.rim_edges)
    sizes = region.sizes
    # Where islands touch, two triangles may want one edge.
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
    """Whether no edge is run through twice in one direction and no face names a vertex twice."""
    starts, ends = ends_of_half_edges(faces)
    edges = starts * (np.int64(faces.max()) + 1) + ends
    return len(np.unique(edges)) == len(edges) and bool((starts != ends).all())


def _polygon(region: InfluenceRegion) -> tuple[IntArray, FloatArray, FloatArray]:
    """All loops as one, joined by the shortest bridges, with the normals beyond its edges and the gaps."""
    polygon = region.loops[0]
    normals = region.normals_beyond(polygon)
    for loop in region.loops[1:]:
        points = region.vertices
        distances = np.linalg.norm(points[polygon][:, np.newaxis] - points[loop], axis=2)
        i, j = np.unravel_index(np.argmin(distances), distances.shape)
        beyond = region.normals_beyond(loop)
        zero = np.zeros((1, 3))
        turned, turned_normals = np.roll(loop, -j), np.roll(beyond, -j, axis=0)
        if polygon[i] == loop[j]:  # the island touches: ..., loop[j], ..., polygon[i], ...
            polygon = np.concatenate([polygon[:i], turned, polygon[i:]])
            normals = np.vstack([normals[:i], turned_normals, normals[i:]])
            continue
        # ... polygon[i], loop[j], ..., loop[j], polygon[i], ...; the normal at a corner is that of the edge after it.
        polygon = np.concatenate([polygon[: i + 1], turned, turned[:1], polygon[i:]])
        normals = np.vstack([normals[:i], zero, turned_normals, zero, normals[i:]])
    count = np.bincount(polygon, minlength=region.rim_count)
    return polygon, normals, (region.gaps / np.maximum(count, 1))[polygon]


def _faired(fill: Fill, region: InfluenceRegion, order: int) -> Fill:
    """Move the new vertices to where the Laplacian to a power vanishes, given as many rings less one around them."""
    count = int(np.searchsorted(region.rings, max(order - 1, 1), side="right"))
    faces = np.where(fill.faces < fill.rim_count, fill.faces, fill.faces + (count - fill.rim_count))
    around = region.faces[(region.faces < count).all(axis=1)]
    points = np.vstack([region.vertices[:count], fill.points[fill.rim_count :]])
    moved = polyharmonic_continuation(points, np.vstack([around, faces]), points[:count], order)
    return replace(fill, points=np.vstack([fill.points[: fill.rim_count], moved[count:]]))


def surface_around(
    region: InfluenceRegion, normals: FloatArray, *, noisy: bool, others: FloatArray | None = None
) -> ImplicitSurface | str:
    """Surface of points of the region whose normals (b, 3) are known, and of others (k, 3), or why there is none."""
    known = np.einsum("ij,ij->i", normals, normals) > 0.25
    if np.count_nonzero(known) < FEWEST_POINTS:
        return "too few vertices around the hole to fit a surface"
    ids = fitted_points(region, known, noisy=noisy)
    step = float(region.sizes.mean())
    surface = fit_implicit_surface(region.vertices[ids], normals[ids], step, noisy=noisy, others=others)
    return "the surface around the hole does not continue into it" if surface is None else surface


def project_to_surface(fill: Fill, region: InfluenceRegion, surface: ImplicitSurface) -> Fill | None:
    """Move the new vertices of a fill onto a surface and make its triangles more even; None if that does not work."""
    points, faces = fill.points.copy(), fill.faces.copy()
    is_on_it = _settle(surface, points, faces, work_space(fill), sorted_pairs(region.rim_edges), fill.rim_count)
    return replace(fill, points=points, faces=faces) if is_on_it else None


@jit()
def _settle(
    surface: ImplicitSurface, points: FloatArray, faces: IntArray, room: WorkSpace, existing: IntArray, rim_count: int
) -> bool:
    """Move new vertices to the surface and along it; return whether all of them get there."""
    for round_ in range(ROUNDS + 1):
        for i in range(rim_count, points.shape[0]):
            if not project_point(surface, points, i):
                return False
        if round_ < ROUNDS:
            even_out(points, faces, room, existing, rim_count)
    return True


def meet_rim(fill: Fill, region: InfluenceRegion, surface: ImplicitSurface) -> Fill:
    """Shift a fill on a surface so that it ends at its rim, which noise may have moved off the surface."""
    rim = fill.points[: fill.rim_count]
    on_it, found = surface.project(rim)
    shift = np.where(found[:, np.newaxis], rim - on_it, 0.0)
    if np.abs(shift).max(initial=0.0) < SMALLEST_GAP * region.sizes.mean():
        return fill
    points = fill.points + polyharmonic_continuation(fill.points, fill.faces, shift)
    points[: fill.rim_count] = rim
    return replace(fill, points=points)
