"""Lines of curvature, of torsion and of given normal curvature on the surface of the patches of a mesh."""

from dataclasses import dataclass, field
from math import degrees, radians
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.errors import InvalidParameterError, is_real
from bezier_filters.feature_lines.crease_lines import COLORS as CREASE_COLORS
from bezier_filters.meshes.unit_size import CURVATURE, LENGTH
from bezier_filters.patch_surface.projection import ON_SURFACE, WORK_SIZE
from bezier_filters.patch_surface.query_arguments import check_points
from bezier_filters.patch_surface.surface import Surface, check_surface, empty_places
from bezier_filters.result_tables import Table, TabularResult
from bezier_filters.runtime.parallel import Progress, report, runs_on_threads
from bezier_filters.status import MessageEnum
from bezier_filters.surface_lines.coordinate_rounding import include_rounding
from bezier_filters.surface_lines.direction_field import (
    MAX_DIRECTION_STD,
    MAX_FIELD,
    MIN_FIELD,
    NORMAL_MINUS,
    NORMAL_PLUS,
    TORSION_MINUS,
    TORSION_PLUS,
)
from bezier_filters.surface_lines.line_store import (
    LINE_ARC,
    LINE_COORDINATES,
    LINE_COUNT,
    LINE_STD,
    LINE_TANGENT,
    POINT_COUNT,
    LineStore,
    enlarge_store,
    line_store,
)
from bezier_filters.surface_lines.tracing import (
    ALL_TRACED,
    AT_LINE,
    CLOSED_LINE,
    END_OF_FIELD,
    END_OF_SURFACE,
    NO_PATCH,
    SCRATCH_SIZE,
    STORE_IS_FULL,
    TOO_LONG,
    Tracer,
    trace_field,
)
from bezier_filters.surface_lines.umbilics import Umbilic, find_umbilics

Family = Literal["curvature", "max", "min", "torsion", "asymptotic", "normal"]
LineKind = Literal["max", "min", "plus", "minus"]
# red, green and blue of the lines, and of umbilics by whether their index is positive, wherever they are drawn
LINE_COLORS: dict[str, tuple[float, float, float]] = {
    "max": CREASE_COLORS["ridge"],
    "min": CREASE_COLORS["ravine"],
    "plus": (0.85, 0.45, 0.05),
    "minus": (0.1, 0.5, 0.45),
}
UMBILIC_COLORS: dict[bool, tuple[float, float, float]] = {True: (0.0, 0.0, 0.0), False: (0.95, 0.75, 0.0)}
FIELDS_OF: dict[str, dict[LineKind, int]] = {
    "curvature": {"max": MAX_FIELD, "min": MIN_FIELD},
    "max": {"max": MAX_FIELD},
    "min": {"min": MIN_FIELD},
    "torsion": {"plus": TORSION_PLUS, "minus": TORSION_MINUS},
    "asymptotic": {"plus": NORMAL_PLUS, "minus": NORMAL_MINUS},
    "normal": {"plus": NORMAL_PLUS, "minus": NORMAL_MINUS},
}
MAX_DIRECTION_ERROR = round(degrees(MAX_DIRECTION_STD), 1)
DEFAULT_SPACING = 1.0 / 60.0  # of lines, in diagonals of the bounding box
# Steps in mean edges of a face, and at most in spacings. Halved, lines on an ellipsoid of 2,252 vertices come out
# as accurate; doubled, they are a half less so.
STEP_OF_EDGE, STEP_OF_SPACING = 0.5, 0.2
# Of lines, in diagonals of the bounding box: at a thousandth they have millions of points; beyond the whole, nearly all
# are shorter than twice the spacing.
MIN_SPACING, MAX_SPACING = 1e-3, 1.0
MAX_DIAGONALS = 30.0  # length of each half of a line, in diagonals of the bounding box
FIRST_CAPACITY, STEPS_PER_CALL = 4096, 4096  # a step takes some 20 microseconds
MAX_POINTS = 1 << 24  # of the lines of a kind, 128 bytes each while they are traced


class LineEnd(MessageEnum):
    """Why a line ends."""

    CLOSED = CLOSED_LINE, "it is closed"
    NEAR_LINE = AT_LINE, "another line, or itself, is nearer than half the spacing"
    UNDEFINED = END_OF_FIELD, "the direction is not known: an umbilic, a plane, noise, or none has that curvature"
    BORDER = END_OF_SURFACE, "the border of the mesh, or a sharp edge"
    NO_SURFACE = NO_PATCH, "no patches, or folded ones"
    LENGTH = TOO_LONG, "longer than 30 diagonals of the bounding box"


ENDS = tuple(LineEnd)  # by code


class _LineMeasures:
    """What follows from the points of a line."""

    points: FloatArray
    ends: tuple[LineEnd, LineEnd]

    @property
    def is_closed(self) -> bool:
        """Whether the line is closed."""
        return self.ends[1] == LineEnd.CLOSED

    @property
    def length(self) -> float:
        """Length of the polyline."""
        return float(np.linalg.norm(np.diff(self.points, axis=0), axis=1).sum())


@dataclass(frozen=True, repr=False)
class SurfaceLine(_LineMeasures):
    """A line on a surface, as a polyline of k points.

    Attributes
    ----------
    kind : {"max", "min", "plus", "minus"}
        Line of k_max or k_min; or, for torsion and given normal curvature, which of the two: plus is the direction
        counter-clockwise from that of k_max, seen from outside.
    points : (k, 3) float64
        Points on the surface in order; a closed line repeats its first point at the end.
    tangents : (k, 3) float64
        Unit directions of the field, from the first point of the line to the last.
    normals : (k, 3) float64
        Unit normals of the surface.
    normal_curvature, geodesic_torsion : (k,) float64
        Of the surface in the direction of the line, 1/length; signs as in `VertexGeometry.curvature_along` and
        `VertexGeometry.torsion_along`.
    normal_curvature_std, geodesic_torsion_std : (k,) float64
        Their standard errors in a given direction.
    direction_std : (k,) float64
        Standard error of the angle of the direction, in radians.
    faces : (k,) int32
        Face of the mesh below each point.
    coordinates : (k, 2) float64
        Barycentric coordinates of its second and third corner.
    ends : (LineEnd, LineEnd)
        Why the line ends at its first and last point.
    is_closed : bool
        Derived from `ends`.
    length : float
        Derived: length of the polyline.
    """

    kind: LineKind
    points: FloatArray = field(metadata=LENGTH)
    tangents: FloatArray
    normals: FloatArray
    normal_curvature: FloatArray = field(metadata=CURVATURE)
    geodesic_torsion: FloatArray = field(metadata=CURVATURE)
    normal_curvature_std: FloatArray = field(metadata=CURVATURE)
    geodesic_torsion_std: FloatArray = field(metadata=CURVATURE)
    direction_std: FloatArray
    faces: IntArray
    coordinates: FloatArray
    ends: tuple[LineEnd, LineEnd]
    is_closed: bool = field(init=False)
    length: float = field(init=False, metadata=LENGTH)

    def __repr__(self) -> str:
        """Kind and length, on one line."""
        closed = "closed, " * self.is_closed
        return f"SurfaceLine({self.kind}, {closed}{len(self.points)} points, length {self.length:.4g})"


@dataclass(frozen=True, repr=False)
class SurfaceLines(TabularResult):
    """Lines on a surface, the result of `trace_lines`.

    Attributes
    ----------
    family : str
        As given.
    lines : tuple of SurfaceLine
        Those of the first kind come first.
    umbilics : tuple of Umbilic
        Places where the principal directions are not defined, and turn around.
    spacing : float or None
        The distance between lines of a kind, a length; None for lines that may cross.
    default_spacing : float
        What it would be by default: a 60th of the diagonal of the bounding box.
    """

    family: Family
    lines: tuple[SurfaceLine, ...]
    umbilics: tuple[Umbilic, ...]
    spacing: float | None = field(metadata=LENGTH)
    default_spacing: float = field(metadata=LENGTH)

    @property
    def mark_radius(self) -> float:
        """Radius of the rings that mark umbilics, a length: a quarter of the spacing, or of the default one."""
        return 0.25 * (self.spacing or self.default_spacing)

    def of_kind(self, kind: LineKind) -> tuple[SurfaceLine, ...]:
        """Lines of one kind."""
        return tuple(line for line in self.lines if line.kind == kind)

    def __repr__(self) -> str:
        """Numbers of lines and umbilics, on one line."""
        return f"SurfaceLines({self.family}: {len(self.lines)} lines, {len(self.umbilics)} umbilics)"

    def _tables(self) -> list[Table]:
        """The lines by kind."""
        rows = []
        for kind in FIELDS_OF[self.family]:
            lines = self.of_kind(kind)
            ends = [sum(line.ends.count(end) for line in lines) for end in LineEnd]
            rows.append([kind, len(lines), sum((line.length for line in lines), 0.0), *ends])
        header = ["", "lines", "length [length]", *(end.name.lower() for end in LineEnd)]
        title = f"{len(self.lines):,} lines, {len(self.umbilics):,} umbilics; and how many ends are"
        return [Table(title, header, rows)]

    def _columns(self) -> dict[str, list[object]]:
        """A row for each line."""
        names = ("kind", "is_closed", "length")
        columns: dict[str, list[object]] = {"points": [len(line.points) for line in self.lines]}
        columns |= {name: [getattr(line, name) for line in self.lines] for name in names}
        return columns | {f"end_{k + 1}": [line.ends[k].name for line in self.lines] for k in (0, 1)}


@runs_on_threads
def trace_lines(
    surface: Surface,
    family: Family = "curvature",
    *,
    normal_curvature: float | None = None,
    spacing: float | None = None,
    seeds: ArrayLike | None = None,
    max_error: float = MAX_DIRECTION_ERROR,
    threads: int | None = None,
    progress: Progress | None = None,
) -> SurfaceLines:
    """Trace lines on a surface along its principal directions, or at given angles to them.

    With the principal curvatures, the mean curvature H, and theta the angle from the direction of k_max, the normal
    curvature of the surface is ``k_max cos^2 theta + k_min sin^2 theta`` and its geodesic torsion
    ``(k_max - k_min) / 2 sin 2 theta`` (Li, Barsky, Jin, SMI 2009). Two families of lines follow from every choice:

    - lines of curvature, theta = 0 and 90 degrees, along which there is no torsion;
    - torsion lines, theta = 45 and -45 degrees, of extreme geodesic torsion and the normal curvature H;
    - lines of given normal curvature k, cos 2 theta = (2 k - k_max - k_min) / (k_max - k_min), where k is between the
      principal curvatures; asymptotic lines are those of k = 0, where the Gaussian curvature is negative.

    Lines lie on the surface. Directions have no signs, and are not defined at umbilics: lines end where the standard
    error of the angle, which follows from that of the mean curvature, is 9.4 degrees or more (there the principal
    curvatures differ by less than 4.3 standard errors, as they do by noise alone 99 times in a hundred), and where the
    principal curvatures differ by less than 2 %. Detail counts, too: fur has lines of its own. For those of the shape
    below it, smooth the mesh first.

    Evenly spaced lines of each kind grow from each other (Jobard, Lefer, 1997), the first one from where the direction
    is known best; a line ends where it comes nearer to another one than half the spacing, and lines shorter than
    twice the spacing are dropped.

    Parameters
    ----------
    surface : Surface
        From `fit_surface`.
    family : {"curvature", "max", "min", "torsion", "asymptotic", "normal"}
        The lines: of curvature, both or those of k_max or k_min only; of torsion; asymptotic; or of a given normal
        curvature.
    normal_curvature : float, optional
        The normal curvature for ``"normal"``, 1/length, positive where convex.
    spacing : float, optional
        Distance between neighbouring lines of a kind, a length from a thousandth of the diagonal of the bounding box to
        the whole; by default a 60th of it, or with seeds none, so that lines may come as near to each other as they do.
    seeds : (s, 3) array_like of float, optional
        Points, each of whose nearest places on the surface gets a line of each kind, and there are no others. With a
        spacing, seeds near a line are omitted.
    max_error : float
        Standard error of the angle in degrees at which lines end, above 0 and up to 45.
    threads : int, optional
        Number of threads for what follows from the lines; tracing itself takes one.
    progress : callable, optional
        ``progress(done, total)`` as in `estimate_vertex_geometry`; the total is an estimate.

    Returns
    -------
    SurfaceLines

    Raises
    ------
    InvalidParameterError
        If a parameter is out of range, or the lines of a kind have more than 16,777,216 points.
    CancelledError
        If `progress` returned False.

    Examples
    --------
    On an ellipsoid lines of curvature are closed, but for those between two umbilics.

    >>> from bezier_filters import fit_surface
    >>> from bezier_filters.surfaces import ellipsoid
    >>> shape = ellipsoid(semi_axes=(1.0, 0.8, 0.5), resolution=16)
    >>> found = trace_lines(fit_surface(shape.vertices, shape.faces), spacing=0.2)
    >>> [umbilic.index for umbilic in found.umbilics]
    [0.5, 0.5, 0.5, 0.5]
    >>> sum(line.is_closed for line in found.lines) > len(found.lines) / 2
    True
    """
    check_surface(surface)
    surface = include_rounding(surface)
    fields = _fields(family, normal_curvature)
    diagonal = float(np.linalg.norm(np.ptp(surface.mesh.vertices, axis=0)))
    default_spacing = float(np.ldexp(DEFAULT_SPACING * diagonal, surface.exponent))
    if spacing is None and seeds is None:
        spacing = default_spacing
    if spacing is not None and not (is_real(spacing) and 0.0 < spacing < np.inf):
        raise InvalidParameterError(f"spacing: got {spacing!r}, expected a positive length")
    distance = 0.0 if spacing is None else float(np.ldexp(spacing, -surface.exponent))
    if spacing is not None and not MIN_SPACING * diagonal <= distance <= MAX_SPACING * diagonal:
        least, most = np.ldexp(diagonal * np.array([MIN_SPACING, MAX_SPACING]), surface.exponent)
        raise InvalidParameterError(
            f"spacing: got {spacing!r}, expected {least:.3g} to {most:.3g}, a thousandth of the diagonal of the "
            "bounding box to the whole"
        )
    if not (is_real(max_error) and 0.0 < max_error <= 45.0):
        raise InvalidParameterError(f"max_error: got {max_error!r}, expected degrees above 0 and up to 45")
    if seeds is None:
        faces, coordinates = _best_places(surface)
    else:
        found = surface.query(check_points(seeds, "seeds"))
        known = found.faces >= 0
        faces, coordinates = found.faces[known], found.coordinates[known]
    value = 0.0 if normal_curvature is None else float(np.ldexp(normal_curvature, surface.exponent))
    area = _area(surface)
    total = max(1, int(len(fields) * area / (STEP_OF_SPACING * distance**2))) if distance else len(faces)
    lines: list[SurfaceLine] = []
    for kind, code in fields.items():
        tracer = _tracer(surface, code, value, radians(max_error), distance, MAX_DIAGONALS * diagonal)
        store = line_store(FIRST_CAPACITY, distance or diagonal)
        done = sum(len(line.points) for line in lines)
        while True:
            outcome = trace_field(tracer, store, faces, coordinates, seeds is None, STEPS_PER_CALL)
            report(progress, min(done + int(store.counts[POINT_COUNT]), total), total)
            if outcome == ALL_TRACED:
                break
            if outcome == STORE_IS_FULL:
                if len(store.rows) >= MAX_POINTS:
                    raise InvalidParameterError(
                        f"{'spacing' if seeds is None else 'seeds'}: the lines have more than {MAX_POINTS:,} points; "
                        f"give {'a larger spacing' if seeds is None else 'fewer seeds, or a spacing'}"
                    )
                store = enlarge_store(store)
        lines += _lines(surface, store, kind)
    report(progress, total, total)
    return SurfaceLines(family, tuple(lines), find_umbilics(surface), spacing, default_spacing)


def _fields(family: str, normal_curvature: float | None) -> dict[LineKind, int]:
    """Codes of the fields of a family by kind."""
    if family not in get_args(Family):
        raise InvalidParameterError(f"family: got {family!r}, expected {', '.join(map(repr, get_args(Family)))}")
    if (normal_curvature is not None) != (family == "normal"):
        raise InvalidParameterError("normal_curvature: is for the family 'normal', which needs it, and no other")
    if normal_curvature is not None and not (is_real(normal_curvature) and np.isfinite(normal_curvature)):
        raise InvalidParameterError(f"normal_curvature: got {normal_curvature!r}, expected a finite number, 1/length")
    return FIELDS_OF[family]


def _tracer(surface: Surface, code: int, value: float, max_std: float, spacing: float, max_length: float) -> Tracer:
    return Tracer(
        surface.arrays,
        empty_places(1),
        empty_places(1),
        np.zeros(WORK_SIZE),
        np.zeros(SCRATCH_SIZE),
        code,
        value,
        max_std,
        STEP_OF_EDGE,
        STEP_OF_SPACING * spacing if spacing else np.inf,
        spacing,
        max_length,
        np.zeros(len(surface.mesh.faces), dtype=np.bool_),
    )


def _area(surface: Surface) -> float:
    corners = surface.cut.vertices[surface.cut.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return 0.5 * float(np.linalg.norm(normals, axis=1).sum())


def _best_places(surface: Surface) -> tuple[IntArray, FloatArray]:
    """Middles of all faces with a direction, first those where it is known best."""
    faces = np.arange(len(surface.mesh.faces), dtype=np.int32)
    there = surface.evaluate(faces, np.full((len(faces), 2), 1.0 / 3.0))
    with np.errstate(over="ignore"):  # no direction: last
        error = there.mean_curvature_std / np.maximum(there.geodesic_torsion, np.finfo(np.float64).tiny)
    order = np.argsort(error, kind="stable")
    order = order[there.outcome[order] == ON_SURFACE]
    return faces[order], np.full((len(order), 2), 1.0 / 3.0)


def _lines(surface: Surface, store: LineStore, kind: LineKind) -> list[SurfaceLine]:
    """The lines of a store in the unit of the mesh."""
    count, lines = int(store.counts[LINE_COUNT]), list[SurfaceLine]()
    rows_of = []
    for k in range(count):
        rows = np.arange(store.starts[k], store.starts[k + 1])
        rows = rows[np.argsort(store.rows[rows, LINE_ARC], kind="stable")]
        rows_of.append(np.append(rows, rows[0]) if store.ends[k, 1] == CLOSED_LINE else rows)
    rows = np.concatenate([np.empty(0, np.int64), *rows_of])
    there = surface.evaluate(store.faces[rows], np.clip(store.rows[rows, LINE_COORDINATES:LINE_ARC], 0.0, 1.0))
    sides = np.where(store.rows[rows, LINE_ARC] < 0.0, -1.0, 1.0)  # the first half was traced backward
    tangents = sides[:, np.newaxis] * store.rows[rows, LINE_TANGENT:LINE_COORDINATES]
    cosine = np.einsum("ij,ij->i", tangents, there.direction_max)
    sine = np.einsum("ij,ij->i", tangents, there.direction_min)
    values = {
        "points": there.points,
        "tangents": tangents,
        "normals": there.normals,
        "normal_curvature": there.k_max * cosine**2 + there.k_min * sine**2,
        "geodesic_torsion": 2.0 * there.geodesic_torsion * cosine * sine,
        "normal_curvature_std": np.sqrt(1.5) * there.mean_curvature_std,
        "geodesic_torsion_std": np.sqrt(0.5) * there.mean_curvature_std,
        "direction_std": store.rows[rows, LINE_STD],
        "faces": there.faces,
        "coordinates": there.coordinates,
    }
    stops = np.cumsum([0, *map(len, rows_of)])
    for k in range(count):
        part = {name: array[stops[k] : stops[k + 1]] for name, array in values.items()}
        ends = (ENDS[store.ends[k, 0]], ENDS[store.ends[k, 1]])
        lines.append(SurfaceLine(kind=kind, ends=ends, **part))
    return lines
