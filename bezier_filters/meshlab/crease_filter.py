"""The filter that finds the creases of a mesh, and the layer of lines that it adds.

Written like the filters of fields of vertices: see `vertex_filters`.
"""

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray, Report
from bezier_filters.errors import InvalidMeshError
from bezier_filters.feature_lines.crease_lines import COLORS, Creases, crease_columns, edge_mesh, find_creases
from bezier_filters.fields import CREASES, PREFIX, column_names
from bezier_filters.meshlab.filter_run import Computed, Output, run_filter
from bezier_filters.meshlab.meshset import (
    CurrentMesh,
    Length,
    Mesh,
    MeshSet,
    checks_filter_arguments,
    current_mesh,
)
from bezier_filters.meshlab.verdicts import fit_verdict
from bezier_filters.meshlab.vertex_filters import FitArguments, fit_mesh
from bezier_filters.parameters import complete_docstring
from bezier_filters.patches.smoothness import Smoothness
from bezier_filters.runtime.parallel import Progress
from bezier_filters.status import FitStatus
from bezier_filters.surface_model.fit_options import Automatic

CREASE_COLUMNS = tuple(column_names(CREASES))
# attribute of points for the segment after each, as pymeshlab has no attributes of edges
CERTAINTY = PREFIX + "certainty"


@checks_filter_arguments
@complete_docstring(CREASES)
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
    robust: bool | None = None,
    noise: Length | None = None,
    detail: Length | None = None,
    polylines: bool = True,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Report:
    """Select the creases of the current mesh: sharp edges, and the ridges and ravines of the surface between them.

    Sharp edges are found by the angle of their faces, crest lines by the third derivatives of the Bezier patches; see
    `bezier_filters.find_creases`. pymeshlab cannot select single edges from Python, so the filter selects vertices: the
    ends of sharp edges and, where a line runs between vertices, the nearer end of every edge that it crosses. The edges
    themselves are in a new layer named ``creases``, a mesh of edges without faces on the surface: its quality is the
    strength of the lines, its attribute ``bz_certainty`` the probability that the segment after each point is not
    noise, ridges are red and ravines blue, and its transform is that of the mesh. The current mesh stays current.

    The vertex selection is replaced. Besides that and its own attributes the filter changes nothing else in the
    MeshSet: not the face selection, quality, colours, textures, other attributes or filter script. Every run adds a
    layer.

    Larger neighbourhoods give coarser lines. There are no smooth lines where the patches have a degree below 3.

    Parameters
    ----------
    ms : pymeshlab.MeshSet
        Its current mesh must have faces.
    polylines : bool
        Whether the layer of lines is added.

    Returns
    -------
    dict
        ``lines``, a dict for each with ``kind`` (``"ridge"`` or ``"ravine"``), ``is_sharp``, ``is_closed``,
        ``strength``, ``certainty`` (mean), ``length`` and ``points`` (number), the strongest first;
        ``selected_vertices`` and ``sharp_edges`` (numbers), ``crest_lines_told`` (whether the fit can find smooth
        lines), ``polylines_id`` (of the new layer, or None), ``status`` (vertices per status name), ``attributes``,
        ``quality`` (None), ``unit``, ``statistics``, ``topology`` (what pymeshlab counts, as in
        `meshing_close_holes_by_bezier_patch`) and ``seconds`` (read, fit, topology, write). It can be written as JSON.

    Examples
    --------
    >>> from pymeshlab import MeshSet
    >>> ms = MeshSet()
    >>> ms.create_cube()
    >>> result = compute_selection_by_bezier_crease_per_edge(ms)
    >>> len(result["lines"]), result["sharp_edges"], ms.current_mesh().selected_vertex_number()
    (12, 12, 8)
    """
    fit = FitArguments(rings, radius, alpha, degree, smoothness, robust, noise, detail, threads, progress)
    layers: list[int] = []

    def work(mesh: CurrentMesh, mask: BoolArray) -> Computed:
        creases = creases_of(mesh, fit, angle, minstrength)

        def select_and_add_lines() -> None:
            ms.compute_selection_by_condition_per_vertex(condselect=f"{CREASE_COLUMNS[0]} != 0")
            if polylines and creases.lines:
                layers.append(_add_polylines(ms, creases))

        report = report_of(creases, mesh)
        return Computed(crease_columns(creases), mask, report, select_and_add_lines)

    report = run_filter(ms, CREASES, work, Output())
    return report | {
        "selected_vertices": current_mesh(ms).selected_vertex_number(),
        "polylines_id": layers[0] if layers else None,
    }


def creases_of(mesh: CurrentMesh, fit: FitArguments, angle: float, min_strength: float) -> Creases:
    """Fit patches to all vertices of a mesh and find its creases."""
    if not len(mesh.faces):
        raise InvalidMeshError("the current mesh has no faces; creases need a mesh, not a point cloud")
    geometry = fit_mesh(mesh, np.ones(len(mesh.vertices), dtype=np.bool_), fit)
    return find_creases(
        mesh.vertices, mesh.faces, geometry, angle=angle, min_strength=min_strength, threads=fit.threads
    )


def _add_polylines(ms: MeshSet, creases: Creases) -> int:
    """Add the lines as a layer with the transform of the current one, which stays current; return its id."""
    source = current_mesh(ms)
    current, transform = source.id(), np.array(source.transform_matrix())
    points, edges, strengths, colors = lines_as_mesh(creases)
    opaque = np.insert(colors, 3, 1.0, axis=1)
    lines = Mesh(points, edge_matrix=edges, v_scalar_array=strengths, v_color_matrix=opaque)
    ms.add_mesh(lines, "creases", set_as_current=True)
    certainties = [np.append(line.certainties, line.certainties[-1]) for line in creases.lines]
    current_mesh(ms).add_vertex_custom_scalar_attribute(np.concatenate(certainties), CERTAINTY)
    layer = int(ms.current_mesh_id())
    ms.set_matrix(transformmatrix=transform, freeze=False)
    ms.set_current_mesh(current)
    return layer


def lines_as_mesh(creases: Creases) -> tuple[FloatArray, IntArray, FloatArray, FloatArray]:
    """Points (k, 3) and edges (e, 2) of all lines, and strength (k,) and colour (k, 3) at the points."""
    points, edges, line_of_point = edge_mesh(creases.lines)
    strengths = np.array([line.strength for line in creases.lines])
    colors = np.array([COLORS[line.kind] for line in creases.lines]).reshape(-1, 3)
    return points, edges, strengths[line_of_point], colors[line_of_point]


def report_of(creases: Creases, mesh: CurrentMesh) -> Report:
    """The creases as plain values, with the number of points of each line."""
    names = ("kind", "is_sharp", "is_closed", "strength", "length")
    lines = [
        {name: getattr(line, name) for name in names}
        | {"certainty": float(line.certainties.mean()), "points": len(line.points)}
        for line in creases.lines
    ]
    found = {"sharp_edges": len(creases.sharp_edges), "crest_lines_told": creases.tells_crest_lines}
    everywhere = np.ones(len(mesh.vertices), dtype=np.bool_)
    verdict = fit_verdict("curvature", creases.geometry, mesh, everywhere, FitStatus.FOLDED)
    if found["sharp_edges"]:  # they do not need curvature
        verdict |= {"remarks": verdict["warnings"] + verdict["remarks"], "warnings": []}
    return {"lines": lines, **found, "status": creases.geometry.status_counts(), **verdict}
