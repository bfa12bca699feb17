"""The filter that adds lines on the surface of a mesh as a layer: of curvature, torsion or given normal curvature."""

from dataclasses import dataclass

import numpy as np

from bezier_filters.arrays import FloatArray, IntArray, Report
from bezier_filters.errors import InvalidMeshError, InvalidParameterError
from bezier_filters.feature_lines.polylines import join_polylines
from bezier_filters.fields import PREFIX
from bezier_filters.fitting.vertex_geometry import VertexGeometry
from bezier_filters.meshlab.meshset import (
    BezierFilterError,
    CurrentMesh,
    Length,
    Mesh,
    MeshSet,
    absolute_length,
    check_unchanged,
    checks_filter_arguments,
    current_mesh,
    preserve_filter_script,
    read_current_mesh,
)
from bezier_filters.meshlab.verdicts import fit_verdict
from bezier_filters.parameters import complete_docstring
from bezier_filters.patch_surface.surface_fit import fit_surface
from bezier_filters.runtime.compile_time import clock_without_compilation
from bezier_filters.runtime.parallel import Progress
from bezier_filters.status import FitStatus
from bezier_filters.surface_lines.lines import (
    LINE_COLORS,
    UMBILIC_COLORS,
    Family,
    LineEnd,
    SurfaceLines,
    trace_lines,
)
from bezier_filters.surface_lines.umbilics import ring_around

# attributes of points: along the line; and of the rings around umbilics
CURVATURE_ALONG, TORSION_ALONG = PREFIX + "curvature_along", PREFIX + "torsion_along"
DIRECTION_STD, INDEX = PREFIX + "direction_std", PREFIX + "umbilic_index"


@dataclass(frozen=True)
class LineArguments:
    """Arguments of the filter; lengths may be percentages."""

    family: Family
    normalcurvature: float | None
    spacing: Length | None
    seeds: str | None
    maxerror: float
    noise: Length | None
    threads: int | None
    progress: Progress | None


@checks_filter_arguments
@complete_docstring("lines")
def generate_polyline_by_bezier_patch_direction(
    ms: MeshSet,
    *,
    family: Family = "curvature",
    normalcurvature: float | None = None,
    spacing: Length | None = None,
    seeds: str | None = None,
    maxerror: float = 9.4,
    noise: Length | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Report:
    """Add lines on the surface of the current mesh as a layer: lines of curvature, of torsion, asymptotic lines.

    The lines lie on the surface of the patches, see `bezier_filters.trace_lines`. They are in a new layer named
    ``lines``, a mesh of edges without faces: its quality is the normal curvature along the line, or the geodesic
    torsion along torsion lines; its attributes are both, ``bz_curvature_along`` and ``bz_torsion_along``, and the
    standard error of the direction, ``bz_direction_std``, in radians. Lines of k_max are red, of k_min blue; others are
    orange where they are counter-clockwise from k_max, else green. Small rings mark umbilics, black with the index 1/2,
    else yellow; the attribute ``bz_umbilic_index`` has their indices, and is 0 on lines. The transform is that of the
    mesh, which stays current and does not change.

    Parameters
    ----------
    ms : pymeshlab.MeshSet
        Its current mesh must have faces.

    Returns
    -------
    dict
        ``lines`` and ``closed_lines`` (numbers), ``length`` (of all lines), ``umbilics`` (a dict for each with
        ``point``, ``normal``, ``index`` and ``radius``), ``index_sum`` (of these), ``spacing`` (a length, or None),
        ``ends`` (number of ends for each reason: ``NEAR_LINE``, ``UNDEFINED``, ``BORDER``, ...), ``kinds`` (number and
        length of the lines of each kind), ``polylines_id`` (of the new layer, or None), ``status`` (vertices per status
        name), ``warnings`` and ``remarks`` (texts) and ``seconds`` (read, fit, trace, write). It can be written as
        JSON.

    Examples
    --------
    >>> from pymeshlab import MeshSet
    >>> ms = MeshSet()
    >>> ms.create_torus()
    >>> result = generate_polyline_by_bezier_patch_direction(ms, spacing="10%")
    >>> result["umbilics"], result["lines"] > 10, ms.mesh(result["polylines_id"]).label()
    ([], True, 'lines')
    """
    arguments = LineArguments(family, normalcurvature, spacing, seeds, maxerror, noise, threads, progress)
    begin = clock_without_compilation()
    mesh = read_current_mesh(ms)
    read = clock_without_compilation()
    try:
        found, geometry, fitted = lines_of(mesh, arguments)
    except (InvalidMeshError, InvalidParameterError) as error:
        raise BezierFilterError(str(error)) from error
    traced = clock_without_compilation()
    check_unchanged(ms, mesh)
    layer = None
    if found.lines or found.umbilics:
        with preserve_filter_script(ms):
            layer = _add_lines(ms, found)
    written = clock_without_compilation()
    seconds = {"read": read - begin, "fit": fitted - read, "trace": traced - fitted, "write": written - traced}
    return report_of(found, geometry, mesh) | {"polylines_id": layer, "seconds": seconds}


def lines_of(mesh: CurrentMesh, given: LineArguments) -> tuple[SurfaceLines, VertexGeometry, float]:
    """Fit the surface of a mesh and trace lines on it; also its geometry, and the time between both."""
    if not len(mesh.faces):
        raise InvalidMeshError("the current mesh has no faces; lines need a mesh, not a point cloud")
    seeds = None if given.seeds is None else read_points(given.seeds)
    spacing = absolute_length(given.spacing, mesh.vertices, "spacing")
    noise = absolute_length(given.noise, mesh.vertices, "noise")
    surface = fit_surface(mesh.vertices, mesh.faces, noise=noise, threads=given.threads, progress=given.progress)
    fitted = clock_without_compilation()
    found = trace_lines(
        surface,
        given.family,
        normal_curvature=given.normalcurvature,
        spacing=spacing,
        seeds=seeds,
        max_error=given.maxerror,
        threads=given.threads,
        progress=given.progress,
    )
    return found, surface.geometry, fitted


def read_points(text: str) -> FloatArray:
    """Parse points such as ``"0 0 1, 0.5 0 1"``."""
    try:
        rows = [[float(number) for number in point.split()] for point in text.split(",")]
    except ValueError:
        rows = []
    if not rows or any(len(row) != 3 for row in rows) or not np.isfinite(rows).all():
        raise InvalidParameterError(f"seeds: got {text!r}, expected coordinates of points such as '0 0 1, 0.5 0 1'")
    return np.array(rows)


def _add_lines(ms: MeshSet, found: SurfaceLines) -> int:
    """Add the lines as a layer with the transform of the current one, which stays current; return its id."""
    source = current_mesh(ms)
    current, transform = source.id(), np.array(source.transform_matrix())
    points, edges, quality, colors, columns = lines_as_mesh(found)
    opaque = np.insert(colors, 3, 1.0, axis=1)
    lines = Mesh(points, edge_matrix=edges, v_scalar_array=quality, v_color_matrix=opaque)
    ms.add_mesh(lines, "lines", set_as_current=True)
    for name, values in columns.items():
        current_mesh(ms).add_vertex_custom_scalar_attribute(values, name)
    layer = int(ms.current_mesh_id())
    ms.set_matrix(transformmatrix=transform, freeze=False)
    ms.set_current_mesh(current)
    return layer


def lines_as_mesh(
    found: SurfaceLines,
) -> tuple[FloatArray, IntArray, FloatArray, FloatArray, dict[str, FloatArray]]:
    """Points (k, 3) and edges (e, 2), with quality (k,), colours (k, 3) and columns (k,).

    Closed lines repeat their first point. The last ones are rings around umbilics.
    """
    lines, umbilics = found.lines, found.umbilics
    rings = [ring_around(umbilic, found.mark_radius) for umbilic in umbilics]
    parts = [*(line.points for line in lines), *rings]
    points, edges, number = join_polylines(parts)
    none = [np.zeros(len(ring)) for ring in rings]
    columns = {
        CURVATURE_ALONG: np.concatenate([np.empty(0), *(line.normal_curvature for line in lines), *none]),
        TORSION_ALONG: np.concatenate([np.empty(0), *(line.geodesic_torsion for line in lines), *none]),
        DIRECTION_STD: np.concatenate([np.empty(0), *(line.direction_std for line in lines), *none]),
        INDEX: np.array([0.0] * len(lines) + [umbilic.index for umbilic in umbilics])[number],
    }
    palette = [LINE_COLORS[line.kind] for line in lines] + [UMBILIC_COLORS[each.index > 0.0] for each in umbilics]
    colors = np.array(palette).reshape(-1, 3)[number]
    quality = columns[TORSION_ALONG if found.family == "torsion" else CURVATURE_ALONG]
    return points, edges, quality, colors, columns


def report_of(found: SurfaceLines, geometry: VertexGeometry, mesh: CurrentMesh) -> Report:
    """The lines as plain values."""
    ends = [end for line in found.lines for end in line.ends]
    kinds = dict.fromkeys(line.kind for line in found.lines)
    everywhere = np.ones(len(geometry.status), dtype=np.bool_)
    verdict = fit_verdict("curvature", geometry, mesh, everywhere, FitStatus.FOLDED)
    if not found.lines and not verdict["warnings"]:
        verdict = verdict | {
            "warnings": [
                "there are no lines: no direction is known, none has that curvature, or all are short for the spacing"
            ]
        }
    return {
        "family": found.family,
        "lines": len(found.lines),
        "closed_lines": sum(line.is_closed for line in found.lines),
        "length": sum((line.length for line in found.lines), 0.0),
        "spacing": found.spacing,
        "umbilics": [
            vars(umbilic) | {"point": umbilic.point.tolist(), "normal": umbilic.normal.tolist()}
            for umbilic in found.umbilics
        ],
        "index_sum": sum((umbilic.index for umbilic in found.umbilics), 0.0),
        "kinds": {
            kind: {"lines": len(found.of_kind(kind)), "length": sum(line.length for line in found.of_kind(kind))}
            for kind in kinds
        },
        "ends": {end.name: ends.count(end) for end in LineEnd if end in ends},
        "status": geometry.status_counts(),
        **verdict,
    }
