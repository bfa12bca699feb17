"""A report on one mesh: a page that a browser shows without anything else, where the mesh can be turned.

The page is `report.html` beside this module, with everything that it shows put into it as JSON.
"""

import json
from base64 import b64encode
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from bezier_filters.arrays import BoolArray, FloatArray, IntArray, Report
from bezier_filters.display.colors import color_range, round_limits
from bezier_filters.display.summaries import noise_level
from bezier_filters.estimation.estimate import estimate_vertex_geometry
from bezier_filters.feature_lines.crease_lines import Creases, edge_mesh, find_creases
from bezier_filters.fields import ESTIMATES, SMOOTH, Field, columns, fields_of, values_of
from bezier_filters.holes.hole_filling import HoleFillingResult, fill_holes
from bezier_filters.meshlab.hole_filter import fill_warnings
from bezier_filters.meshlab.meshset import CurrentMesh, Mesh, MeshSet, current_mesh, one_at_a_time
from bezier_filters.pictures.scene import Panel, up_axis, view_axes
from bezier_filters.runtime.atomic import atomic_write
from bezier_filters.smoothing.smooth import smooth
from bezier_filters.status import FitStatus

MOST_FACES = 200_000  # that a browser turns without jerks on any machine
SHOWN = {"mean_curvature", "gaussian_curvature", "k_min", "k_max", "curvedness", "shape_index", "geodesic_torsion"}
SHOWN |= {"mean_curvature_std", "gaussian_curvature_std", "residual", "fit_status", "displacement"}
STAGES = 4

Stages = Callable[[str, int, int], object]  # ``progress(stage, done, total)``


@dataclass(frozen=True)
class _Shown:
    """How a mesh is drawn: with no more faces than this, around a centre (3,), in units of a length."""

    most_faces: int
    center: FloatArray
    radius: float

    def packed(self, points: FloatArray, indices: IntArray, **more: object) -> Report:
        """Points (k, 3) with faces (m, 3) or edges (e, 2), as the page takes them."""
        around = (points - self.center) / (self.radius or 1.0)
        return {"points": _packed(around, "<f4"), "indices": _packed(indices, "<u4"), "new_from": None, **more}


def save_report(
    path: Path,
    title: str,
    mesh: CurrentMesh,
    facts: Sequence[tuple[str, str]],
    findings: Sequence[str],
    *,
    progress: Stages | None = None,
    most_faces: int = MOST_FACES,
) -> Report:
    """Write the page, with facts and findings as text; return its ``notes`` and the names of what it shows."""
    vertices, faces = mesh.vertices, mesh.faces
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    shown = _Shown(most_faces, 0.5 * (low + high), 0.5 * float(np.linalg.norm(high - low)))
    done = progress or (lambda *_: None)
    done("curvature", 0, STAGES)
    normals = None if len(faces) else np.nan_to_num(mesh.vertex_normals)
    geometry = estimate_vertex_geometry(vertices, faces, normals=normals)
    values = values_of([field for field in fields_of(*ESTIMATES) if field.name in SHOWN], geometry)
    points, triangles, rows = reduced(vertices, faces, most_faces)
    meshes, comparisons, notes = {"scan": shown.packed(points, triangles)}, [], []
    if len(points) < len(vertices):
        what, kept, of = ("faces", triangles, faces) if len(faces) else ("points", points, vertices)
        notes.append(f"Drawn with {len(kept):,} of {len(of):,} {what}; values are those of the nearest vertices.")
    if len(faces):
        done("sharp edges", 1, STAGES)
        meshes |= _lines(find_creases(vertices, faces, geometry), shown)
        done("smoothing", 2, STAGES)
        smoothed = smooth(vertices, faces)
        values |= columns(SMOOTH, smoothed)
        meshes["smoothed"] = shown.packed(points + (smoothed.vertices - vertices)[rows], triangles)
        after = noise_level(smoothed.noise_after, smoothed.mean_edge)
        comparisons.append(("smoothed", "smoothing", f"{smoothed.noise}; {after} after."))
        done("filling holes", 3, STAGES)
        filled = fill_holes(vertices, faces)
        if filled.filled:
            meshes["filled"] = _filled(filled, len(faces), shown)
            text = f"{filled.filled:,} of {len(filled.holes):,} holes filled, orange"
            comparisons.append(("filled", "hole filling", "; ".join([text, *fill_warnings(filled, 2 * shown.radius)])))
    fields = [field for field in fields_of(*ESTIMATES, SMOOTH) if field.name in SHOWN and field.column in values]
    known = geometry.status <= FitStatus.FOLDED
    page = {
        "title": title,
        "notes": notes,
        "facts": facts,
        "findings": findings,
        "fields": [_field(field, values[field.column], rows, known) for field in fields],
        "meshes": meshes,
        "comparisons": comparisons,
        "turn": view_axes("front", up_axis(Panel(vertices, faces, vertices[:, 0]))).ravel().tolist(),
    }
    template = Path(__file__).with_name("report.html").read_text(encoding="utf-8")
    with atomic_write(path) as temporary:
        # Nothing in the texts may end the script that holds them.
        text = json.dumps(page, allow_nan=False).replace("<", "\\u003c")
        temporary.write_text(template.replace("{{title}}", escape(title)).replace("{{data}}", text), encoding="utf-8")
    return {"notes": notes, "fields": [field.name for field in fields], "meshes": list(meshes)}


def _filled(result: HoleFillingResult, face_count: int, shown: _Shown) -> Report:
    """The mesh with filled holes: its old faces, of which there were so many, reduced, and then all of the new ones."""
    points, triangles, _ = reduced(result.vertices, result.faces[:face_count], shown.most_faces)
    used, corners = np.unique(result.faces[face_count:], return_inverse=True)
    new = corners.reshape(-1, 3).astype(np.int32) + np.int32(len(points))
    return shown.packed(
        np.vstack([points, result.vertices[used]]), np.vstack([triangles, new]), new_from=triangles.size
    )


def reduced(vertices: FloatArray, faces: IntArray, most: int) -> tuple[FloatArray, IntArray, IntArray]:
    """A mesh of no more faces, or points, and the nearest vertex of the old one to each of its own."""
    if not len(faces):
        rows = np.arange(0, len(vertices), 1 + (len(vertices) - 1) // most, dtype=np.int32)
        return vertices[rows], faces, rows
    if len(faces) <= most:
        return vertices, faces, np.arange(len(vertices), dtype=np.int32)
    with one_at_a_time():
        ms = MeshSet()
        ms.add_mesh(Mesh(vertices, faces))
        ms.meshing_decimation_quadric_edge_collapse(targetfacenum=most, preserveboundary=True, selected=False)
        mesh = current_mesh(ms)
        points, triangles = np.array(mesh.vertex_matrix()), np.array(mesh.face_matrix(), dtype=np.int32)
    return points, triangles, cKDTree(vertices).query(points)[1].astype(np.int32)


def _lines(creases: Creases, shown: _Shown) -> dict[str, Report]:
    """The lines of each kind as meshes of edges."""
    found = {}
    for kind in ("ridge", "ravine"):
        lines = [line for line in creases.lines if line.kind == kind]
        if lines:
            points, edges, _ = edge_mesh(lines)
            found[f"{kind}s"] = shown.packed(points, edges, lines=True)
    return found


def _field(field: Field, values: FloatArray, rows: IntArray, known: BoolArray) -> Report:
    """A field as the page takes it: codes have names, others limits, of what is known."""
    told = {"label": field.label, "unit": field.unit, "signed": field.signed, "values": _packed(values[rows], "<f4")}
    if field.name == "fit_status":
        names = {int(status): {"text": status.name, "count": int((values == status).sum())} for status in FitStatus}
        return told | {"names": names}
    inside = values[known] if known.any() else values
    return told | {
        "limits": round_limits(*color_range(inside, signed=field.signed)),
        "range": round_limits(*color_range(inside, signed=field.signed, percentile=0.0)),
        "median": float(np.median(np.abs(inside))),
    }


def _packed(array: FloatArray | IntArray, kind: str) -> str:
    return b64encode(np.ascontiguousarray(array, dtype=kind).tobytes()).decode("ascii")
