"""The filter on a pymeshlab MeshSet that finds creases."""

from typing import Any

import numpy as np

from bezier_filters.arrays import BoolArray
from bezier_filters.errors import InvalidMeshError
from bezier_filters.estimation.fit_options import Automatic
from bezier_filters.feature_lines.crease_lines import COLORS, CreaseLine, Creases, edge_mesh, find_creases
from bezier_filters.files.fields import ScalarField
from bezier_filters.meshlab.meshset import CurrentMesh, Length, Mesh, MeshSet, current_mesh
from bezier_filters.meshlab.vertex_filter import FitOptions, fitted
from bezier_filters.meshlab.vertex_output import Columns, Computed, Output, run_filter
from bezier_filters.patches.smoothness import Smoothness
from bezier_filters.runtime.parallel import Progress

KIND_CODES = {"ridge": 1.0, "ravine": -1.0}
SHARP_FACTOR = 2.0
CREASE_FIELDS = {
    field.name: field
    for field in (
        ScalarField("crease", "crease", "crease: ridge above 0, ravine below", "", signed=True),
        ScalarField("strength", "crease_strength", "strength of creases", "radii of curvature", signed=False),
    )
}
COLUMNS = tuple(field.mesh_attribute for field in CREASE_FIELDS.values())


def compute_selection_by_bezier_crease_per_edge(
    ms: MeshSet,
    *,
    angle: float = 40.0,
    minstrength: float = 2.0,
    rings: int | Automatic = "auto",
    radius: Length | None = None,
    alpha: float | Automatic = "auto",
    degree: int | Automatic = "auto",
    smoothness: Smoothness = "third_order",
    robust: bool = False,
    polylines: bool = True,
    threads: int | None = None,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Select the creases of the current mesh: sharp edges, and the ridges and ravines of the surface between them.

    Sharp edges are told by the angle of their faces, crest lines by the third derivatives of the Bezier patches; see
    `bezier_filters.find_creases`. pymeshlab lets nobody select single edges from Python, so the filter selects
    vertices: the ends of sharp edges and, where a line runs between vertices, the nearer end of every edge that it
    crosses. The edges themselves are in a new layer named ``creases``, a mesh of edges and no faces that lies on the
    surface: its quality is the strength of the lines, ridges are red and ravines are blue. The current mesh stays the
    current one.

    The custom scalar attributes ``bz_crease`` (0 away from creases, 1 at a ridge, -1 at a ravine, 2 and -2 at sharp
    edges of these kinds) and ``bz_crease_strength`` are added or overwritten, and the vertex selection is replaced.
    Nothing else in the MeshSet changes: not the face selection, quality, colours, textures, other attributes or filter
    script. Running it again adds a layer again.

    Coordinates are used as stored, like in pymeshlab's own filters: the transform matrix is ignored, and the new layer
    has the same one.

    Parameters
    ----------
    ms : pymeshlab.MeshSet
        Its current mesh must have faces.
    angle : float
        Angle between faces in degrees, from which on an edge may be sharp.
    minstrength : float
        Weaker smooth lines are left out. The strength is the length in radii of the curvature across the line, less
        where that hardly changes across it.
    rings : int or "auto"
        Size of the fitted neighbourhood in edges, at least 1. By default the data choose this and
        the next three, for the smallest predicted error at the noise that they have.
    radius : pymeshlab.PercentageValue, pymeshlab.PureValue or float, optional
        Size of the neighbourhood as a length, or as a percentage of the diagonal of the bounding box,
        instead of `rings`: coarser lines for larger ones.
    alpha : float or "auto"
        Weight of the points against the smoothness of the patch, in (0, 1].
    degree : int or "auto"
        Degree of the patch in each parameter, 2 to 4, or with ``alpha="auto"`` its total degree, 2 to 6. There are no
        smooth lines below 3.
    smoothness : {"third_order", "paper"}
        What alpha is weighed against.
    robust : bool
        Take weight from points far off their patch.
    polylines : bool
        Whether the layer of lines is added.
    threads : int, optional
        Number of threads; by default all usable cores. The result does not depend on it.
    progress : callable, optional
        ``progress(done, total)`` is called now and then; if it returns False, the filter stops.

    Returns
    -------
    dict
        ``lines``, a dict for each with ``kind`` (``"ridge"`` or ``"ravine"``), ``is_sharp``, ``is_closed``,
        ``strength``, ``length`` and ``points`` (number), the strongest first; ``selected_vertices`` and ``sharp_edges``
        (numbers), ``polylines_id`` (of the new layer, or None), ``status`` (vertices per status name), ``attributes``,
        ``quality`` (None), ``unit``, ``statistics`` and ``seconds`` (read, fit, write). It can be written as JSON.

    Raises
    ------
    BezierFilterError
        If the mesh, an attribute on it or a parameter is refused; the MeshSet is as it was.
    CancelledError
        If `progress` returned False; the MeshSet is as it was.

    Examples
    --------
    >>> from pymeshlab import MeshSet
    >>> ms = MeshSet()
    >>> ms.create_cube()
    >>> result = compute_selection_by_bezier_crease_per_edge(ms)
    >>> len(result["lines"]), result["sharp_edges"], ms.current_mesh().selected_vertex_number()
    (12, 12, 8)
    """
    fit = FitOptions(rings, radius, alpha, degree, smoothness, robust, threads, progress)
    layers: list[int] = []

    def work(mesh: CurrentMesh, mask: BoolArray) -> Computed:
        creases = creases_of(mesh, fit, angle, minstrength)

        def select_and_add_lines() -> None:
            ms.compute_selection_by_condition_per_vertex(condselect=f"{COLUMNS[0]} != 0")
            if polylines and creases.lines:
                layers.append(_add_polylines(ms, creases))

        report = {
            "status": creases.geometry.status_counts(),
            "lines": [described(line) for line in creases.lines],
            "sharp_edges": len(creases.sharp_edges),
        }
        return Computed(_columns(creases, len(mask)), mask, report, write_more=select_and_add_lines)

    report = run_filter(ms, list(COLUMNS), work, Output(None, False, False, "Turbo", 0.0))
    return report | {
        "selected_vertices": current_mesh(ms).selected_vertex_number(),
        "polylines_id": layers[0] if layers else None,
    }


def creases_of(mesh: CurrentMesh, fit: FitOptions, angle: float, min_strength: float) -> Creases:
    """Fit patches to all vertices of a mesh and find its creases.

    Raises
    ------
    InvalidMeshError, InvalidParameterError
        As `find_creases` does, but before anything is fitted if there are no faces.
    """
    if not len(mesh.faces):
        raise InvalidMeshError("the current mesh has no faces; creases need a mesh, not a point cloud")
    geometry = fitted(mesh, np.ones(len(mesh.vertices), dtype=np.bool_), fit)
    return find_creases(
        mesh.vertices, mesh.faces, geometry, angle=angle, min_strength=min_strength, threads=fit.threads
    )


def _columns(creases: Creases, n: int) -> Columns:
    """Code and strength of the strongest line at each vertex."""
    codes, strengths = np.zeros(n), np.zeros(n)
    for line in reversed(creases.lines):
        ids = line.nearest_vertices
        codes[ids] = KIND_CODES[line.kind] * (SHARP_FACTOR if line.is_sharp else 1.0)
        strengths[ids] = line.strength
    return dict(zip(COLUMNS, (codes, strengths), strict=True))


def _add_polylines(ms: MeshSet, creases: Creases) -> int:
    """Add the lines as a layer with the transform of the current one, which stays current; return its id."""
    source = current_mesh(ms)
    current, transform = source.id(), np.array(source.transform_matrix())
    points, edges, line_of_point = edge_mesh(creases.lines)
    strengths = np.array([line.strength for line in creases.lines])
    colors = np.array([(*COLORS[line.kind], 1.0) for line in creases.lines])
    lines = Mesh(
        points, edge_matrix=edges, v_scalar_array=strengths[line_of_point], v_color_matrix=colors[line_of_point]
    )
    ms.add_mesh(lines, "creases", set_as_current=True)
    layer = int(ms.current_mesh_id())
    ms.set_matrix(transformmatrix=transform, freeze=False)
    ms.set_current_mesh(current)
    return layer


def described(line: CreaseLine) -> dict[str, Any]:
    """A line as a dict of plain values, with a number in the place of its points."""
    return {
        "kind": line.kind,
        "is_sharp": line.is_sharp,
        "is_closed": line.is_closed,
        "strength": line.strength,
        "length": line.length,
        "points": len(line.points),
    }
