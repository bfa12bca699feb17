"""A page that a browser shows without anything else, where a mesh can be turned: for reports and in notebooks.

It is the template `page.html` next to this module, with scripts and data inserted, the latter as JSON.
"""

import json
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from bezier_filters.arrays import FloatArray, IntArray, Report
from bezier_filters.display import noise_level, shell_remark
from bezier_filters.errors import InvalidParameterError
from bezier_filters.estimation.estimate import estimate_vertex_geometry
from bezier_filters.feature_lines.crease_lines import Creases, find_creases
from bezier_filters.fields import DEVIATION, ESTIMATES, SMOOTH, columns, values_of
from bezier_filters.fitting.vertex_geometry import VertexGeometry
from bezier_filters.holes.hole_filling import HoleFillingResult, fill_holes
from bezier_filters.inspection.deviation import Deviation
from bezier_filters.meshes.mesh import TriangleMesh, surface_or_points, takes_meshes
from bezier_filters.meshes.mesh_objects import MeshLike
from bezier_filters.meshlab.hole_filter import fill_warnings
from bezier_filters.meshlab.meshset import CurrentMesh
from bezier_filters.pictures.page_deviation import DeviationFields, deviation_fields
from bezier_filters.pictures.page_fields import (
    NOISE,
    PAGE_FIELDS,
    encode_array,
    field_record,
    field_table,
    group_members,
)
from bezier_filters.pictures.page_lines import crease_layers, line_layers
from bezier_filters.pictures.page_meshes import Frame, decimate, frame_of
from bezier_filters.pictures.shades import shades_of
from bezier_filters.pictures.verdict import Sentence, verdict
from bezier_filters.pictures.views import AUTO_AXIS, Orientation, check_axes, has_border
from bezier_filters.runtime.atomic import atomic_write
from bezier_filters.runtime.file_names import escape_unprintable
from bezier_filters.runtime.parallel import Progress
from bezier_filters.smoothing.smooth import SmoothingResult, smooth
from bezier_filters.status import FitStatus
from bezier_filters.surface_lines.lines import SurfaceLines

DEFAULT_ORIENTATION = Orientation()
MAX_PAGE_FACES = 200_000  # that a browser turns without jerks on any machine
MAX_PAGE_HOLES = 100  # rows of the table of holes
_NOTEBOOK_HEIGHT_PIXELS = 640  # pixels, in a notebook

Result: TypeAlias = VertexGeometry | Creases | SmoothingResult | HoleFillingResult | Deviation | SurfaceLines


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
        allowed = 'sandbox="allow-scripts allow-downloads allow-modals"'  # to save and to print
        size = f'width="100%" height="{_NOTEBOOK_HEIGHT_PIXELS}" style="border: 1px solid #ddd"'
        return f'<iframe srcdoc="{escape(self.html)}" {allowed} {size}></iframe>'


def report_page(
    title: str,
    mesh: CurrentMesh,
    facts: Sequence[tuple[str, str]],
    findings: Sequence[str],
    *,
    source: str = "",
    about: Sequence[str] = (),
    can_be_repaired: bool = False,
    cleaned: bool = False,
    oriented: Orientation = DEFAULT_ORIENTATION,
    stage: Callable[[str], Progress | None] = lambda _: None,
    most_faces: int = MAX_PAGE_FACES,
) -> Page:
    """Compute the contents of a page, with facts and findings as text, from a file with the name `source`.

    `about` is what stands below the title. `cleaned` says that the file has been filled and smoothed already. `stage`
    begins a stage, given its name, and returns the callback for its progress.
    """
    vertices, faces = mesh.vertices, mesh.faces
    normals = None if len(faces) else np.nan_to_num(mesh.vertex_normals)
    geometry = estimate_vertex_geometry(vertices, faces, normals=normals, progress=stage("curvature"))
    creases = filled = None
    if len(faces):
        stage("sharp edges, ridges and ravines")
        creases = find_creases(vertices, faces, geometry)
    smoothed = smooth(vertices, faces, progress=stage("smoothing"))
    if len(faces):
        filled = fill_holes(vertices, faces, progress=stage("filling holes"))
    stage("writing the page" if len(faces) <= most_faces else f"choosing {most_faces:,} faces to draw")
    sentences = verdict(source or title, smoothed, filled, findings, can_be_repaired=can_be_repaired, cleaned=cleaned)
    return page_of(
        title,
        vertices,
        faces,
        geometry,
        creases,
        smoothed,
        filled,
        facts=facts,
        findings=findings,
        sentences=sentences,
        about=about,
        oriented=oriented,
        most_faces=most_faces,
    )


@takes_meshes
def show(
    vertices: ArrayLike | MeshLike,
    faces: ArrayLike | None = None,
    *results: Result,
    title: str = "",
    up: str = AUTO_AXIS,
    front: str = AUTO_AXIS,
    most_faces: int = MAX_PAGE_FACES,
) -> Page:
    """Show a mesh in a notebook, to be turned with the mouse, with results for it: the page of a report.

    What was smoothed or filled is after a slider whose other side is before. Fields are colours with legends and
    histograms, whose values stand under the pointer; creases, and lines of curvature or torsion, are lines. A line
    drawn on the mesh has a profile.

    Parameters
    ----------
    vertices : (n, 3) array_like, or mesh object
        The mesh that the results belong to: for smoothing and hole filling, that before. With a mesh object of another
        library, see `mesh_arrays`, no faces.
    faces : (m, 3) array_like, optional
        Its triangles; None for a point cloud.
    *results : VertexGeometry, Creases, SmoothingResult, HoleFillingResult, Deviation or SurfaceLines
        What was computed from it, at most one of each.
    title : str
        Heading of the page.
    up, front : str
        Axes that point up and towards the viewer at first, as those of `render_panels`.
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
    names |= {Deviation: "deviation", SurfaceLines: "lines"}
    found: dict[str, Result | DeviationFields] = {}
    for result in results:
        got, name = type(result).__name__, names.get(type(result), "")
        if not name or name in found:
            expected = ", ".join(kind.__name__ for kind in names)
            raise InvalidParameterError(f"results: got {got}, expected at most one each of {expected}")
        if not _fits(result, mesh):
            count = mesh.vertex_count
            raise InvalidParameterError(f"results: a {got} belongs to another mesh than these {count} vertices")
        found[name] = deviation_fields(result) if isinstance(result, Deviation) else result
    check_axes(up, front)
    oriented = Orientation(up, front)
    return page_of(title, mesh.vertices, mesh.faces, **found, oriented=oriented, most_faces=most_faces)  # type: ignore[arg-type]


def _fits(result: Result, mesh: TriangleMesh) -> bool:
    """Whether a result is of a mesh with so many vertices, or faces."""
    vertex_count = mesh.vertex_count
    if isinstance(result, SurfaceLines):
        return all(line.faces.max(initial=-1) < mesh.face_count for line in result.lines)
    if isinstance(result, HoleFillingResult):
        new = sum(len(hole.new_vertices) for hole in result.holes)
        return len(result.vertices) - new == len(result.old_vertices) == vertex_count
    if isinstance(result, SmoothingResult):
        return len(result.vertices) == vertex_count
    if isinstance(result, Deviation):
        return len(result.status) == vertex_count
    return len((result.geometry if isinstance(result, Creases) else result).status) == vertex_count


def page_of(
    title: str,
    vertices: FloatArray,
    faces: IntArray,
    geometry: VertexGeometry | None = None,
    creases: Creases | None = None,
    smoothed: SmoothingResult | None = None,
    filled: HoleFillingResult | None = None,
    deviation: DeviationFields | None = None,
    lines: SurfaceLines | None = None,
    *,
    facts: Sequence[tuple[str, str]] = (),
    findings: Sequence[str] = (),
    sentences: Sequence[Sentence] = (),
    about: Sequence[str] = (),
    tables: Sequence[Report] = (),
    oriented: Orientation = DEFAULT_ORIENTATION,
    most_faces: int = MAX_PAGE_FACES,
) -> Page:
    """The page of a mesh (n, 3), (m, 3), or of points without faces, with its texts."""
    title = escape_unprintable(title)
    frame = frame_of(vertices)
    points, triangles, rows = decimate(vertices, faces, most_faces)
    known_normals = {} if len(faces) or geometry is None else {"normals": encode_array(geometry.normals[rows], "<f4")}
    meshes, comparisons, notes = {"scan": frame.pack(points, triangles, **known_normals)}, [], []
    if len(points) < len(vertices):
        what, kept, of = ("faces", triangles, faces) if len(faces) else ("points", points, vertices)
        notes.append(f"Drawn with {len(kept):,} of {len(of):,} {what}; values are those of the nearest vertices.")
    values: dict[str, FloatArray] = {}
    known = np.ones(len(vertices), dtype=np.bool_)
    if geometry is not None:
        values |= values_of([field for field in PAGE_FIELDS if set(ESTIMATES) & set(field.filters)], geometry)
        known = np.asarray(geometry.status <= FitStatus.FOLDED)
    if deviation is not None:
        values |= deviation.values
        known &= deviation.compared
    drawn = [*(() if creases is None else crease_layers(creases)), *(() if lines is None else line_layers(lines))]
    meshes |= {layer.key: frame.pack(layer.points, layer.edges, lines=True) for layer in drawn}
    start = ""
    if filled is not None and filled.filled:
        meshes["filled"] = frame.pack_fills(filled, points, triangles)
        text = "; ".join([f"{filled.filled:,} of {len(filled.holes):,} holes filled", *_remarks(filled, frame)])
        comparisons.append(("filled", "hole filling", f"{text}."))
        start = "filled"
    if smoothed is not None:
        values |= columns(SMOOTH, smoothed)
        if geometry is not None:
            values[NOISE.column] = np.einsum("ij,ij->i", vertices - smoothed.vertices, geometry.normals)
        meshes["smoothed"] = frame.pack(points + (smoothed.vertices - vertices)[rows], triangles, **known_normals)
        after = noise_level(smoothed.noise_after, smoothed.mean_edge)
        text = f"{smoothed.noise}; {after} after.".capitalize()
        comparisons.insert(0, ("smoothed", "smoothing", text if len(faces) else text.replace("edges", "spacings")))
        start = "smoothed" if smoothed.displacement.any() else start
    fields = [field for field in PAGE_FIELDS if field.column in values]
    shades = {field.column: shades_of(field, values[field.column], faces) for field in fields}
    tables = [*tables, *([{"title": "The mesh", "header": ["quantity", "value"], "rows": facts}] if facts else [])]
    tables += [field_table(fields, values, known)] if fields else []
    tables += [_hole_table(filled)] if filled is not None and filled.holes else []
    data = {
        "title": title,
        "about": about,
        "verdict": sentences,
        "notes": notes,
        "tables": tables,
        "findings": findings,
        "fields": [
            field_record(
                field, values, rows, known, shades[field.column], deviation if DEVIATION in field.filters else None
            )
            for field in fields
        ],
        "groups": group_members(fields),
        "meshes": meshes,
        "whole": len(points) == len(vertices),
        "open": bool(len(faces)) and has_border(faces),
        "center": frame.center.tolist(),
        "radius": frame.radius,
        "comparisons": comparisons,
        "start": start,
        "lines": [{"mesh": layer.key, "name": layer.name, "color": layer.color} for layer in drawn],
        "lines_label": "Edges, ridges, ravines" if lines is None else "Lines",
        "lines_first": lines is not None,
        "turn": oriented.first_view(vertices, faces).ravel().tolist(),
    }
    return Page(_html(title, data), notes, [field.name for field in fields], list(meshes))


def _remarks(filled: HoleFillingResult, frame: Frame) -> list[str]:
    return [shell_remark(text) for text in fill_warnings(filled, 2 * frame.radius)]


def _hole_table(filled: HoleFillingResult) -> Report:
    """Table of the holes, the largest first."""
    header = ["fill", "edges", "diameter", "new faces", "rim angle [degrees]", "remark"]
    holes = sorted(filled.holes, key=lambda hole: -hole.edge_count)[:MAX_PAGE_HOLES]
    rows = [
        [
            hole.method or "left open",
            hole.edge_count,
            float(hole.diameter),
            len(hole.new_faces),
            round(float(hole.rim_dihedral), 1) if hole.filled else "",
            shell_remark(hole.reason),
        ]
        for hole in holes
    ]
    places = [filled.vertices[hole.rim].mean(axis=0).tolist() for hole in holes]
    more = f", the largest {MAX_PAGE_HOLES}" if len(filled.holes) > MAX_PAGE_HOLES else ""
    return {"title": f"Holes: {len(filled.holes):,}{more}", "header": header, "rows": rows, "places": places}


def _html(title: str, data: Report) -> str:
    # Nothing in the texts may end the script that holds them.
    text = json.dumps(data, allow_nan=False).replace("<", "\\u003c")
    scripts = "\n".join(map(read_template, ("viewer.js", "profile.js", "page.js")))
    return fill_template("page.html", title=escape(title), style=read_template("page.css"), script=scripts, data=text)


def fill_template(name: str, **parts: str) -> str:
    """A template with its parts."""
    # all at once: what is put in may look like a place, too
    return re.sub(r"\{\{(\w+)\}\}", lambda place: parts[place[1]], read_template(name))


def read_template(name: str) -> str:
    """The text of a template or script of this package."""
    return Path(__file__).with_name(name).read_text("utf-8")
