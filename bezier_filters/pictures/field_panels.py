"""Panels of mesh files: their fields with names and units, principal directions and creases."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.differential_geometry import MIN_CURVATURE_DIFFERENCE, UMBILIC_RATIO
from bezier_filters.display import ColorScale, color_range, round_limits
from bezier_filters.errors import InvalidParameterError
from bezier_filters.feature_lines.crease_lines import COLORS, Creases
from bezier_filters.fields import FIELDS, GRADE, PREFIX, QUALITY, Field
from bezier_filters.meshlab.mesh_files import load_columns
from bezier_filters.meshlab.meshset import current_mesh
from bezier_filters.pictures.scene import Color, Panel
from bezier_filters.pictures.shades import shades_of
from bezier_filters.pictures.views import file_up, has_border
from bezier_filters.runtime.file_names import printable_name, printable_path
from bezier_filters.status import FitStatus

COLOR, SHAPE = "color", "shape"
NO_UNIT = "no unit"

_KNOWN = {field.column: field for field in FIELDS}
_GREY, _BROWN = 0.75, (0.69, 0.54, 0.42)
_CODES = {  # what numbers in a column stand for
    GRADE: {status.grade: status.words for status in FitStatus},
    "bz_crease": {-2: "sharp ravine", -1: "ravine", 0: "none found", 1: "ridge", 2: "sharp ridge"},
}
_GREY_WORDS = (FitStatus.OK.words, "none found")  # those of most vertices
_GREY_BELOW_LINES = 0.85
# lines along the principal directions
DIRECTIONS = [("direction of k_max", COLORS["ridge"]), ("direction of k_min", COLORS["ravine"])]
LINE_SPACING = 1.0 / 36.0  # of the lines, in diagonals of the bounding box
LINE_RADIUS = 1.0 / 700.0  # of the lines, in the same unit
_LINE_LENGTH = 0.8  # of a line, in units of the spacing


@dataclass(frozen=True)
class MeshFile:
    """A mesh file as arrays: vertices (n, 3), faces (m, 3), ``bz_*`` columns and ``quality`` (n,), colours (n, 4)."""

    path: Path
    vertices: FloatArray
    faces: IntArray
    columns: dict[str, FloatArray]
    colors: FloatArray | None

    def field(self, name: str) -> Field | None:
        """What a legend says of a field, None if it is not there. A quality that equals a column of ours is that."""
        if name not in self.columns:
            return None
        values = self.columns[name]
        known = _KNOWN.get(name)
        if name == QUALITY:
            same = (key for key, column in self.columns.items() if key in _KNOWN and _same(column, values))
            known = next((_KNOWN[key] for key in same), None)
        if known is not None:
            return replace(known, unit=known.unit or NO_UNIT)
        label = name.removeprefix(PREFIX).replace("_", " ")
        return Field(name, label, "unit unknown", (), signed=bool(values.min() < 0 < values.max()))

    def names(self) -> list[str]:
        """What there is to show; MeshLab and pymeshlab often write a quality of zeros where there is none."""
        columns = [name for name, values in self.columns.items() if name != QUALITY or values.any()]
        return [*columns, *([COLOR] if self.colors is not None else []), SHAPE]


def _same(column: FloatArray, quality: FloatArray) -> bool:
    """Whether a quality is a column, but where that has no value: in filled holes, which continue the quality."""
    there = (column != 0.0) | (quality == 0.0)
    return bool(2 * there.sum() > len(there)) and np.array_equal(column[there], quality[there])


def read_mesh_file(path: Path, *, skip: bool = False) -> MeshFile:
    """Read a mesh with its fields; vertices without finite coordinates may be skipped."""
    ms, columns = load_columns(path, skip=skip)
    mesh = current_mesh(ms)
    vertices = np.array(mesh.vertex_matrix(), dtype=np.float64)
    if mesh.has_vertex_scalar():
        columns[QUALITY] = np.array(mesh.vertex_scalar_array(), dtype=np.float64)
    colors = np.array(mesh.vertex_color_matrix()) if mesh.has_vertex_color() else None
    return MeshFile(path, vertices, np.array(mesh.face_matrix(), dtype=np.int32), columns, colors)


def default_field(files: Sequence[MeshFile]) -> str:
    """The quality if there is one, else the shape."""
    return QUALITY if any(QUALITY in file.names() for file in files) else SHAPE


def check_field(files: Sequence[MeshFile], name: str) -> None:
    """Refuse a field that no file has; the message lists the existing ones."""
    if not any(name in file.columns or name in file.names() for file in files):
        have = dict.fromkeys(other for file in files for other in file.names())
        paths = ", ".join(printable_path(file.path) for file in files)
        remedy = "; commands such as curvature give it one" if name.startswith((QUALITY, PREFIX)) else ""
        raise InvalidParameterError(f"field: {paths} has no {name!r}; it has {', '.join(have)}{remedy}")


def field_limits(
    files: Sequence[MeshFile], name: str, *, percentile: float, limits: tuple[float, float] | None
) -> tuple[float, float]:
    """Colour range of a field, the same for all files."""
    if limits is not None:
        return limits
    values = _values(files, name)
    field = next(field for file in files if (field := file.field(name)) is not None)
    low, high = color_range(values, signed=field.signed, percentile=percentile)
    return round_limits(min(low, 0.0) if field.name.endswith("_std") else low, high)


def _values(files: Sequence[MeshFile], name: str) -> FloatArray:
    return np.concatenate([file.columns[name] for file in files if name in file.columns])


def field_panels(
    files: Sequence[MeshFile],
    name: str,
    colormap: str,
    percentile: float,
    limits: tuple[float, float] | None = None,
    scale: ColorScale = "linear",
    *,
    histogram: bool = False,
) -> list[Panel]:
    """One panel per file of a field; files without it show their shape, every face in grey.

    A field is ``quality``, a ``bz_*`` column, ``color`` or ``shape``; one that no file has is refused. Where it is the
    same quantity it has the same colours: a quality is that of the column that it equals. A symmetric logarithmic scale
    has room for all values; it is linear up to their median size.
    """
    check_field(files, name)
    panels = []
    for file in files:
        field = file.field(name)
        title = printable_name(file.path) if len(files) > 1 else field.label if field else name
        if field is not None and field.column in _CODES:
            panels.append(_codes(file, file.columns[name], _CODES[field.column], title))
        elif field is not None:
            shades = shades_of(field, file.columns[name], file.faces)
            alike = [other for other in files if (it := other.field(name)) is not None and it.label == field.label]
            share = percentile if scale == "linear" else 0.0
            median = float(np.median(np.abs(_values(alike, name))))
            panels.append(
                Panel(
                    file.vertices,
                    file.faces,
                    file.columns[name] if shades is None else shades,
                    label=field.label if shades is None else f"{field.label}, means over 5 edges",
                    unit=field.unit,
                    colormap=colormap,
                    signed=field.signed,
                    limits=field_limits(alike, name, percentile=share, limits=limits),
                    histogram=histogram,
                    title=title,
                    linear_below=None if scale == "linear" else median or 1.0,
                    file_up=file_up(file.path),
                )
            )
        elif name == COLOR and file.colors is not None:
            panels.append(Panel(file.vertices, file.faces, colors=file.colors, title=title, file_up=file_up(file.path)))
        else:
            panels.append(_shape(file, title))
    return panels


def _codes(file: MeshFile, values: FloatArray, words: dict[int, str], title: str) -> Panel:
    """Each code in a colour of its own, or grey; a key has the names and counts of the codes that occur."""
    import matplotlib

    own = matplotlib.colormaps["tab10"](np.arange(len(words)))[:, :3]
    grey = (_GREY_BELOW_LINES,) * 3
    palette = {code: grey if word in _GREY_WORDS else tuple(own[k]) for k, (code, word) in enumerate(words.items())}
    codes, counts = np.unique(np.round(values).astype(int), return_counts=True)
    names = [
        (f"{words.get(code, code)}: {count:,}", palette.get(code, (0.0, 0.0, 0.0)))
        for code, count in zip(codes.tolist(), counts.tolist(), strict=True)
    ]
    colors = np.array([color for _, color in names])[np.searchsorted(codes, np.round(values))]
    return Panel(file.vertices, file.faces, colors=colors, title=title, names=names, file_up=file_up(file.path))


def _shape(file: MeshFile, title: str) -> Panel:
    """Every face flat and grey, so that nothing hides a rough surface; its back brown, which is seen through holes."""
    vertices, faces = file.vertices, file.faces
    if len(faces):
        vertices = np.ascontiguousarray(vertices[faces].reshape(-1, 3))
        faces = np.arange(len(vertices), dtype=np.int32).reshape(-1, 3)
    return Panel(
        vertices,
        faces,
        colors=np.full((len(vertices), 3), _GREY),
        back=_BROWN,
        title=title,
        names=[("inside: backs of faces", _BROWN)] if has_border(file.faces) else [],
        file_up=file_up(file.path),
    )


def crease_panel(
    vertices: FloatArray,
    faces: IntArray,
    creases: Creases,
    *,
    radius: float | None = None,
    title: str = "",
) -> Panel:
    """A surface (n, 3), (m, 3) with its ridges in red and its ravines in blue, to be drawn by `render_panels`.

    The lines are tubes of a radius, by default a 400th of the diagonal of the bounding box.
    """
    return Panel(
        vertices,
        faces,
        colors=np.full((len(vertices), 3), _GREY_BELOW_LINES),
        title=title,
        names=[(f"{kind}s", color) for kind, color in COLORS.items()],
        lines=[(line.points, COLORS[line.kind]) for line in creases.lines],
        line_radius=radius,
    )


def are_significant(columns: dict[str, FloatArray]) -> BoolArray:
    """Where the principal curvatures differ significantly, (n,), from the columns of `curvature`."""
    k_min, k_max = columns["bz_k_min"], columns["bz_k_max"]
    least = np.maximum(
        UMBILIC_RATIO * columns["bz_mean_curvature_std"],
        MIN_CURVATURE_DIFFERENCE * np.maximum(np.abs(k_min), np.abs(k_max)),
    )
    return np.asarray((columns[GRADE] >= FitStatus.FOLDED.grade) & (k_max - k_min > least))


def well_spread(points: FloatArray, distance: float) -> IntArray:
    """Rows of points (n, 3) of which no two are closer, while every other point is as close to one of them."""
    tree, free, found = cKDTree(points), np.ones(len(points), dtype=np.bool_), []
    for row in np.random.default_rng(0).permutation(len(points)):
        if free[row]:
            found.append(row)
            free[tree.query_ball_point(points[row], distance)] = False
    return np.array(found, dtype=np.int32)


def add_directions(panel: Panel, file: MeshFile) -> Panel:
    """Add lines in both principal directions to the panel of a mesh file."""
    wanted = [f"bz_direction_{kind}_{axis}" for kind in ("max", "min") for axis in "xyz"]
    wanted += ["bz_k_min", "bz_k_max", "bz_mean_curvature_std", GRADE]
    missing = [name for name in wanted if name not in file.columns]
    if missing:
        raise InvalidParameterError(
            f"directions: {printable_path(file.path)} has no column {missing[0]}; "
            "PLY files that the command curvature writes have it"
        )
    diagonal = float(np.linalg.norm(np.ptp(file.vertices, axis=0)))
    rows = np.flatnonzero(are_significant(file.columns))
    rows = rows[well_spread(file.vertices[rows], LINE_SPACING * diagonal)]
    lines: list[tuple[FloatArray, Color]] = []
    for kind, (_, color) in zip(("max", "min"), DIRECTIONS, strict=True):
        along = np.column_stack([file.columns[f"bz_direction_{kind}_{axis}"][rows] for axis in "xyz"])
        half = 0.5 * _LINE_LENGTH * LINE_SPACING * diagonal * along
        ends = np.stack([file.vertices[rows] - half, file.vertices[rows] + half], axis=1)
        lines += [(line, color) for line in ends]
    return replace(panel, names=[*panel.names, *DIRECTIONS], lines=lines, line_radius=LINE_RADIUS * diagonal)
