"""A page that a browser shows without anything else, where a mesh can be turned: for reports and in notebooks.

It is the template `page.html` next to this module, with scripts and data inserted, the latter as JSON.
"""

import json
import re
from base64 import b64encode
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from bezier_filters.arrays import BoolArray, FloatArray, IntArray, Report
from bezier_filters.display import color_range, noise_level, round_limits
from bezier_filters.errors import InvalidParameterError
from bezier_filters.estimation.estimate import estimate_vertex_geometry
from bezier_filters.feature_lines.crease_lines import Creases, edge_mesh, find_creases
from bezier_filters.fields import ESTIMATES, FIELDS, GRADE, SMOOTH, Field, columns, values_of
from bezier_filters.fitting.vertex_geometry import VertexGeometry
from bezier_filters.holes.hole_filling import HoleFillingResult, fill_holes
from bezier_filters.meshes.mesh import surface_or_points, takes_meshes
from bezier_filters.meshes.mesh_objects import MeshLike
from bezier_filters.meshlab.hole_filter import fill_warnings
from bezier_filters.meshlab.meshset import CurrentMesh, Mesh, MeshSet, current_mesh, one_at_a_time
from bezier_filters.pictures.scene import Panel, up_axis, view_axes
from bezier_filters.runtime.atomic import atomic_write
from bezier_filters.runtime.file_names import escape_unprintable
from bezier_filters.runtime.parallel import Progress
from bezier_filters.smoothing.smooth import SmoothingResult, smooth
from bezier_filters.status import FitStatus

MAX_PAGE_FACES = 200_000  # that a browser turns without jerks on any machine
# names of fields, in the order in which they can be chosen
SHOWN = ["mean_curvature", "gaussian_curvature", "k_min", "k_max", "curvedness", "shape_index", "geodesic_torsion"]
SHOWN += ["mean_curvature_std", "gaussian_curvature_std", "normal_std", "residual", "displacement", "fit_grade"]
_FIELDS = sorted((field for field in FIELDS if field.name in SHOWN), key=lambda field: SHOWN.index(field.name))
_NOISE = Field("noise", "noise, outwards, as smoothing finds it", "length", (SMOOTH,), signed=True)
_NOTEBOOK_HEIGHT_PIXELS = 640  # pixels, in a notebook

Result: TypeAlias = VertexGeometry | Creases | SmoothingResult | HoleFillingResult


@dataclass(frozen=True, repr=False)
class Page:
    """A page with a mesh, which notebooks show where it is the last line of a cell.

    Attributes
    ----------
    html : str
        The whole page.
    notes : list of str
        What it says of how the mesh is drawn.
    fields, meshes : list of str
        Names of what it shows.
    """

    html: str
    notes: list[str]
    fields: list[str]
    meshes: list[str]

    def save(self, path: str | Path) -> None:
        """Write it to a file, whole or not at all."""
        with atomic_write(path) as temporary:
            temporary.write_text(self.html, encoding="utf-8")

    def __repr__(self) -> str:
        """One line: what it shows."""
        return f"Page({'; '.join(', '.join(names) for names in (self.meshes, self.fields) if names)})"

    def _repr_html_(self) -> str:
        """The page in a frame of its own, which can do nothing outside of it."""
        size = f'width="100%" height="{_NOTEBOOK_HEIGHT_PIXELS}" style="border: 1px solid #ddd"'
        return f'<iframe srcdoc="{escape(self.html)}" sandbox="allow-scripts" {size}></iframe>'


@dataclass(frozen=True)
class _Shown:
    """How a mesh is drawn: around a centre (3,), in units of a length."""

    center: FloatArray
    radius: float

    def pack(self, points: FloatArray, indices: IntArray, **more: object) -> Report:
        """Points (k, 3) with faces (m, 3) or edges (e, 2), as the page takes them."""
        around = (points - self.center) / self.radius
        return {
            "points": _encode_array(around, "<f4"),
            "indices": _encode_array(indices, "<u4"),
            "new_from": None,
            **more,
        }


def report_page(
    title: str,
    mesh: CurrentMesh,
    facts: Sequence[tuple[str, str]],
    findings: Sequence[str],
    *,
    stage: Callable[[str], Progress | None] = lambda _: None,
    most_faces: int = MAX_PAGE_FACES,
) -> Page:
    """Compute the contents of a page, with facts and findings as text.

    `stage` begins a stage, given its name, and returns the callback for its progress.
    """
    vertices, faces = mesh.vertices, mesh.faces
    normals = None if len(faces) else np.nan_to_num(mesh.vertex_normals)
    geometry = estimate_vertex_geometry(vertices, faces, normals=normals, progress=stage("curvature"))
    creases = smoothed = filled = None
    if len(faces):
        stage("sharp edges, ridges and ravines")
        creases = find_creases(vertices, faces, geometry)
        smoothed = smooth(vertices, faces, progress=stage("smoothing"))
        filled = fill_holes(vertices, faces, progress=stage("filling holes"))
    stage("writing the page" if len(faces) <= most_faces else f"choosing {most_faces:,} faces to draw")
    results = geometry, creases, smoothed, filled
    return page_of(title, vertices, faces, *results, facts=facts, findings=findings, most_faces=most_faces)


@takes_meshes
def show(
    vertices: ArrayLike | MeshLike,
    faces: ArrayLike | None = None,
    *results: Result,
    title: str = "",
    most_faces: int = MAX_PAGE_FACES,
) -> Page:
    """Show a mesh in a notebook, to be turned with the mouse, with results for it: the page of a report.

    Fields are colours with legends and histograms, creases are lines, and what was smoothed or filled is after a slider
    whose other side is before. A line drawn on the mesh has a profile.

    Parameters
    ----------
    vertices : (n, 3) array_like, or mesh object
        The mesh that the results belong to: for smoothing and hole filling, that before. With a mesh object of another
        library, see `mesh_arrays`, no faces.
    faces : (m, 3) array_like, optional
        Its triangles; None for a point cloud.
    *results : VertexGeometry, Creases, SmoothingResult or HoleFillingResult
        What was computed from it, at most one of each.
    title : str
        Heading of the page.
    most_faces : int
        A mesh with more faces is drawn with so many, and the page says so.

    Returns
    -------
    Page
        The last line of a cell shows it; ``save`` writes it as a file for a browser.

    Raises
    ------
    InvalidMeshError
        No vertices, or faces that are not triangles of them.
    InvalidParameterError
        A result that is none of these, or belongs to another mesh.

    Examples
    --------
    >>> import bezier_filters as bf
    >>> from bezier_filters.surfaces import torus
    >>> shape = torus(resolution=12)
    >>> result = bf.smooth(shape.vertices, shape.faces, "paper")
    >>> bf.show(shape.vertices, shape.faces, result)  # in a notebook, the torus
    Page(scan, smoothed; displacement)
    """
    mesh = surface_or_points(vertices, faces)
    if not mesh.vertex_count:
        raise InvalidParameterError("vertices: got none, expected one or more")
    names = {VertexGeometry: "geometry", Creases: "creases", SmoothingResult: "smoothed", HoleFillingResult: "filled"}
    found: dict[str, Result] = {}
    for result in results:
        got, name = type(result).__name__, names.get(type(result), "")
        if not name or name in found:
            expected = ", ".join(kind.__name__ for kind in names)
            raise InvalidParameterError(f"results: got {got}, expected at most one each of {expected}")
        if not _fits(result, mesh.vertex_count):
            count = mesh.vertex_count
            raise InvalidParameterError(f"results: a {got} belongs to another mesh than these {count} vertices")
        found[name] = result
    return page_of(title, mesh.vertices, mesh.faces, **found, most_faces=most_faces)  # type: ignore[arg-type]


def _fits(result: Result, vertex_count: int) -> bool:
    """Whether a result is of a mesh with so many vertices."""
    if isinstance(result, HoleFillingResult):
        return len(result.vertices) - sum(len(hole.new_vertices) for hole in result.holes) == vertex_count
    if isinstance(result, SmoothingResult):
        return len(result.vertices) == vertex_count
    return len((result.geometry if isinstance(result, Creases) else result).status) == vertex_count


def page_of(
    title: str,
    vertices: FloatArray,
    faces: IntArray,
    geometry: VertexGeometry | None = None,
    creases: Creases | None = None,
    smoothed: SmoothingResult | None = None,
    filled: HoleFillingResult | None = None,
    *,
    facts: Sequence[tuple[str, str]] = (),
    findings: Sequence[str] = (),
    most_faces: int = MAX_PAGE_FACES,
) -> Page:
    """The page of a mesh (n, 3), (m, 3), or of points without faces, with facts and findings as text."""
    title = escape_unprintable(title)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    shown = _Shown(0.5 * (low + high), 0.5 * float(np.linalg.norm(high - low)) or 1.0)
    points, triangles, rows = decimate(vertices, faces, most_faces)
    meshes, comparisons, notes = {"scan": shown.pack(points, triangles)}, [], []
    if len(points) < len(vertices):
        what, kept, of = ("faces", triangles, faces) if len(faces) else ("points", points, vertices)
        notes.append(f"Drawn with {len(kept):,} of {len(of):,} {what}; values are those of the nearest vertices.")
    values: dict[str, FloatArray] = {}
    known = np.ones(len(vertices), dtype=np.bool_)
    if geometry is not None:
        values |= values_of([field for field in _FIELDS if set(ESTIMATES) & set(field.filters)], geometry)
        known = np.asarray(geometry.status <= FitStatus.FOLDED)
    if creases is not None:
        for kind in ("ridge", "ravine"):
            if lines := [line for line in creases.lines if line.kind == kind]:
                meshes[f"{kind}s"] = shown.pack(*edge_mesh(lines)[:2], lines=True)
    if smoothed is not None:
        values |= columns(SMOOTH, smoothed)
        if geometry is not None:
            values[_NOISE.column] = np.einsum("ij,ij->i", vertices - smoothed.vertices, geometry.normals)
        meshes["smoothed"] = shown.pack(points + (smoothed.vertices - vertices)[rows], triangles)
        after = noise_level(smoothed.noise_after, smoothed.mean_edge)
        comparisons.append(("smoothed", "smoothing", f"{smoothed.noise}; {after} after."))
    if filled is not None and filled.filled:
        meshes["filled"] = _pack_fills(filled, points, triangles, filled.faces[len(faces) :], shown)
        text = f"{filled.filled:,} of {len(filled.holes):,} holes filled, orange"
        comparisons.append(("filled", "hole filling", "; ".join([text, *fill_warnings(filled, 2 * shown.radius)])))
    fields = [field for field in (*_FIELDS, _NOISE) if field.column in values]
    data = {
        "title": title,
        "notes": notes,
        "facts": facts,
        "findings": findings,
        "fields": [_field(field, values, rows, known) for field in fields],
        "meshes": meshes,
        "radius": shown.radius,
        "comparisons": comparisons,
        "turn": view_axes("front", up_axis(Panel(vertices, faces, vertices[:, 0]))).ravel().tolist(),
    }
    return Page(_html(title, data), notes, [field.name for field in fields], list(meshes))


def _html(title: str, data: Report) -> str:
    here = Path(__file__)
    html, *scripts = (here.with_name(name).read_text("utf-8") for name in ("page.html", "profile.js", "page.js"))
    # Nothing in the texts may end the script that holds them.
    text = json.dumps(data, allow_nan=False).replace("<", "\\u003c")
    parts = {"title": escape(title), "script": "\n".join(scripts), "data": text}
    # all at once: what is put in may look like a place, too
    return re.sub(r"\{\{(title|script|data)\}\}", lambda place: parts[place[1]], html)


def _pack_fills(
    result: HoleFillingResult, points: FloatArray, triangles: IntArray, new_faces: IntArray, shown: _Shown
) -> Report:
    """Pack the mesh with filled holes: the points and triangles that are drawn of the old mesh, then all new faces."""
    used, corners = np.unique(new_faces, return_inverse=True)
    new = corners.reshape(-1, 3).astype(np.int32) + np.int32(len(points))
    return shown.pack(np.vstack([points, result.vertices[used]]), np.vstack([triangles, new]), new_from=triangles.size)


def decimate(vertices: FloatArray, faces: IntArray, most: int) -> tuple[FloatArray, IntArray, IntArray]:
    """Reduce a mesh to a number of faces, or points; also returns the nearest old vertex of each new one."""
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


def _field(field: Field, columns: dict[str, FloatArray], rows: IntArray, known: BoolArray) -> Report:
    """A field for the page: codes have names, other fields colour limits and, if available, standard errors."""
    values, errors = columns[field.column], columns.get(f"{field.column}_std")
    record = {
        "label": field.label,
        "unit": field.unit,
        "signed": field.signed,
        "values": _encode_array(values[rows], "<f4"),
    }
    if field.column == GRADE:
        names = {s.grade: {"text": s.name, "count": int((values == s.grade).sum())} for s in FitStatus}
        return record | {"names": names}
    inside = values[known] if known.any() else values
    return record | {
        "errors": None if errors is None else _encode_array(errors[rows], "<f4"),
        "limits": round_limits(*color_range(inside, signed=field.signed)),
        "range": round_limits(*color_range(inside, signed=field.signed, percentile=0.0)),
        "median": float(np.median(np.abs(inside))),
    }


def _encode_array(array: FloatArray | IntArray, kind: str) -> str:
    return b64encode(np.ascontiguousarray(array, dtype=kind).tobytes()).decode("ascii")
