"""Triangulations of the rim of a hole, without new vertices or with one for each loop.

Islands are joined to the rim by shortest bridges, so that one loop remains.
"""

import numpy as np

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.holes.band_triangulation import triangulate_band
from bezier_filters.holes.influence_region import InfluenceRegion
from bezier_filters.holes.loops import simple_loops, triangulate_loop
from bezier_filters.holes.refinement import Fill
from bezier_filters.meshes.half_edges import ends_of_half_edges
from bezier_filters.meshes.triangles import area_vectors


def rim_fill(region: InfluenceRegion) -> Fill | None:
    """Triangulate the rim or, if every triangulation would repeat an existing edge, connect it to new vertices."""
    return triangulate_rim(region) or connect_to_hubs(region)


def triangulate_rim(region: InfluenceRegion, *, least_area: bool = False) -> Fill | None:
    """Triangulate the rim with the least largest dihedral angle, or with the least area; None if that is impossible."""
    if region.is_band:
        first, second = region.loops
        faces = triangulate_band(region.rim_vertices, first, second, region.rim_edges)
        if faces is None or not _is_manifold(faces):
            return None
        return Fill(region.rim_vertices, region.sizes, faces, region.rim_count)
    polygon, normals, gaps = _join_loops(region)
    points = region.rim_vertices
    faces = triangulate_loop(points[polygon], polygon, normals, gaps, region.rim_edges, least_area=least_area)
    # Where islands touch the rim, two triangles may share a half-edge.
    if faces is None or not (region.has_simple_rim or _is_manifold(faces)):
        return None
    return Fill(points, region.sizes, faces, region.rim_count)


def connect_to_hubs(region: InfluenceRegion) -> Fill | None:
    """Connect the rim, or each part of one that touches itself, to a new vertex; None if there are islands."""
    if len(region.loops) > 1:
        return None
    parts = simple_loops(region.loops[0])
    points, sizes, faces = [region.rim_vertices], [region.sizes], list[IntArray]()
    for hub, part in enumerate(parts, start=region.rim_count):
        faces.append(np.column_stack([part, np.roll(part, -1), np.full(len(part), hub)]).astype(np.int32))
        points.append(region.rim_vertices[part].mean(axis=0, keepdims=True))
        sizes.append(region.sizes[part].mean(keepdims=True))
    if sum(len(part) for part in parts) < len(region.loops[0]):
        return None  # a part of two edges has no triangles
    return Fill(np.vstack(points), np.concatenate(sizes), np.vstack(faces), region.rim_count)


def face_area(points: FloatArray, faces: IntArray) -> float:
    """Sum of the areas of faces."""
    return 0.5 * float(np.linalg.norm(area_vectors(points, faces), axis=1).sum())


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
