"""A report on one mesh: everything that the package knows of it, on a page for a browser."""

from collections.abc import Callable, Sequence

import numpy as np

from bezier_filters.estimation.estimate import estimate_vertex_geometry
from bezier_filters.feature_lines.crease_lines import find_creases
from bezier_filters.holes.hole_filling import fill_holes
from bezier_filters.meshlab.meshset import CurrentMesh
from bezier_filters.pictures.page import MOST_FACES, Page, Results, page_of
from bezier_filters.smoothing.smooth import smooth

STAGES = 4

Stages = Callable[[str, int, int], object]  # ``progress(stage, done, total)``


def report_page(
    title: str,
    mesh: CurrentMesh,
    facts: Sequence[tuple[str, str]],
    findings: Sequence[str],
    *,
    progress: Stages | None = None,
    most_faces: int = MOST_FACES,
) -> Page:
    """Compute all that a page shows, with facts and findings as text."""
    vertices, faces = mesh.vertices, mesh.faces
    done = progress or (lambda *_: None)
    done("curvature", 0, STAGES)
    normals = None if len(faces) else np.nan_to_num(mesh.vertex_normals)
    geometry = estimate_vertex_geometry(vertices, faces, normals=normals)
    results = Results(geometry)
    if len(faces):
        done("sharp edges", 1, STAGES)
        creases = find_creases(vertices, faces, geometry)
        done("smoothing", 2, STAGES)
        smoothed = smooth(vertices, faces)
        done("filling holes", 3, STAGES)
        results = Results(geometry, creases, smoothed, fill_holes(vertices, faces))
    return page_of(title, vertices, faces, results, facts=facts, findings=findings, most_faces=most_faces)
