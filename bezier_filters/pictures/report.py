"""A report on one mesh: everything that the package knows of it, on a page for a browser."""

from collections.abc import Callable, Sequence

import numpy as np

from bezier_filters.estimation.estimate import estimate_vertex_geometry
from bezier_filters.feature_lines.crease_lines import find_creases
from bezier_filters.holes.hole_filling import fill_holes
from bezier_filters.meshlab.meshset import CurrentMesh
from bezier_filters.pictures.page import MOST_FACES, Page, Results, page_of
from bezier_filters.runtime.parallel import Progress
from bezier_filters.smoothing.smooth import smooth


def report_page(
    title: str,
    mesh: CurrentMesh,
    facts: Sequence[tuple[str, str]],
    findings: Sequence[str],
    *,
    stage: Callable[[str], Progress | None] = lambda _: None,
    most_faces: int = MOST_FACES,
) -> Page:
    """Compute all that a page shows, with facts and findings as text.

    The stages are told by their names; their callbacks say how far each has come.
    """
    vertices, faces = mesh.vertices, mesh.faces
    normals = None if len(faces) else np.nan_to_num(mesh.vertex_normals)
    geometry = estimate_vertex_geometry(vertices, faces, normals=normals, progress=stage("curvature"))
    results = Results(geometry)
    if len(faces):
        stage("sharp edges, ridges and ravines")
        creases = find_creases(vertices, faces, geometry)
        smoothed = smooth(vertices, faces, progress=stage("smoothing"))
        filled = fill_holes(vertices, faces, progress=stage("filling holes"))
        results = Results(geometry, creases, smoothed, filled)
    stage("writing the page" if len(faces) <= most_faces else f"choosing {most_faces:,} faces to draw")
    return page_of(title, vertices, faces, results, facts=facts, findings=findings, most_faces=most_faces)
