"""The filters that write fields of vertices into a MeshSet: normals, curvature, torsion, smoothing.

Like the other filters they follow pymeshlab's conventions: named ``verb_what_by_how_per_element``, keyword arguments,
in place on the current mesh, a dict as result. `complete_docstring` completes their docstrings from the tables in
`fields` and `parameters`.
"""

from dataclasses import asdict, dataclass, replace

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, Report
from bezier_filters.estimation.estimate import estimate_vertex_geometry
from bezier_filters.fields import CURVATURE, GRADE, NORMALS, PREFIX, SMOOTH, TORSION, columns
from bezier_filters.fitting.vertex_geometry import VertexGeometry
from bezier_filters.fitting.viewpoints import ViewpointSide
from bezier_filters.meshlab.direction_columns import Direction, check_direction, direction_columns
from bezier_filters.meshlab.filter_run import Computed, Output, run_filter
from bezier_filters.meshlab.mesh_attributes import write_coordinates
from bezier_filters.meshlab.meshset import (
    CurrentMesh,
    Length,
    MeshSet,
    absolute_length,
    checks_filter_arguments,
)
from bezier_filters.meshlab.topology import topology_of
from bezier_filters.meshlab.verdicts import fit_verdict, remark_flipped, smoothing_warnings
from bezier_filters.parameters import complete_docstring
from bezier_filters.patches.smoothness import Smoothness
from bezier_filters.runtime.parallel import Progress
from bezier_filters.smoothing.smooth import SmoothedBorders, SmoothingMethod, SmoothingResult, smooth
from bezier_filters.status import FitStatus
from bezier_filters.surface_model.fit_options import Automatic


@dataclass(frozen=True)
class FitArguments:
    """Arguments of `estimate_vertex_geometry`, by their names there; lengths may be percentages."""

    rings: int | Automatic
    radius: Length | None
    alpha: float | Automatic
    degree: int | Automatic
    smoothness: Smoothness
    robust: bool | None
    noise: Length | None
    detail: Length | None
    threads: int | None
    progress: Progress | None
    neighbours: int | None = None
    viewpoint: tuple[float, float, float] | FloatArray | None = None
    viewpoint_side: ViewpointSide = "toward"


@checks_filter_arguments
@complete_docstring(NORMALS)
def compute_normal_by_bezier_patch_per_vertex(
    ms: MeshSet,
    *,
    rings: int | Automatic = "auto",
    radius: Length | None = None,
    alpha: float | Automatic = "auto",
    degree: int | Automatic = "auto",
    smoothness: Smoothness = "third_order",
    robust: bool | None = None,
    noise: Length | None = None,
    detail: Length | None = None,
    neighbours: int | None = None,
    viewpoint: tuple[float, float, float] | None = None,
    viewpointside: ViewpointSide = "toward",
    quality: str | None = "angle",
    onselected: bool = False,
    repair: bool = False,
    color: bool = False,
    colormap: str = "auto",
    percentile: float = 2.0,
    colorrange: tuple[float, float] | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Report:
    """Set the vertex normals of the current mesh to those of Bezier patches fitted to its vertices.

    The normals have unit length and point to the side from which the faces are counter-clockwise, or
    in a point cloud to that of the viewpoint or of the previous normals. Vertices where nothing could be fitted keep
    theirs.

    Examples
    --------
    >>> from pymeshlab import MeshSet
    >>> ms = MeshSet()
    >>> ms.create_sphere(radius=1.0, subdiv=4)
    >>> result = compute_normal_by_bezier_patch_per_vertex(ms)
    >>> result["status"], result["unit"]
    ({'OK': 2562}, 'degrees')
    >>> bool(abs(ms.current_mesh().vertex_normal_matrix() - ms.current_mesh().vertex_matrix()).max() < 1e-3)
    True
    """
    fit = FitArguments(
        rings,
        radius,
        alpha,
        degree,
        smoothness,
        robust,
        noise,
        detail,
        threads,
        progress,
        neighbours,
        viewpoint,
        viewpointside,
    )
    return _run(ms, NORMALS, fit, Output(quality, onselected, color, colormap, percentile, colorrange, repair))


@checks_filter_arguments
@complete_docstring(CURVATURE)
def compute_curvature_by_bezier_patch_per_vertex(
    ms: MeshSet,
    *,
    rings: int | Automatic = "auto",
    radius: Length | None = None,
    alpha: float | Automatic = "auto",
    degree: int | Automatic = "auto",
    smoothness: Smoothness = "third_order",
    robust: bool | None = None,
    noise: Length | None = None,
    detail: Length | None = None,
    neighbours: int | None = None,
    viewpoint: tuple[float, float, float] | None = None,
    viewpointside: ViewpointSide = "toward",
    direction: tuple[float, float, float] | None = None,
    quality: str | None = "mean",
    onselected: bool = False,
    repair: bool = False,
    color: bool = False,
    colormap: str = "auto",
    percentile: float = 2.0,
    colorrange: tuple[float, float] | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Report:
    """Compute the curvature of the current mesh from Bezier patches fitted to its vertices.

    Curvatures are positive on a convex body with outward normals, as in pymeshlab, and have the unit
    1/length; the Gaussian curvature has 1/length^2.

    Where a direction is given, the report has ``without_direction``: the number of vertices that have an estimate, but
    whose normals are along it, as on level land under gravity.

    Examples
    --------
    >>> from pymeshlab import MeshSet
    >>> ms = MeshSet()
    >>> ms.create_sphere(radius=2.0, subdiv=4)
    >>> result = compute_curvature_by_bezier_patch_per_vertex(ms, quality="mean", color=True)
    >>> result["unit"], bool(abs(result["statistics"]["median"] - 0.5) < 0.01)
    ('1/length', True)
    >>> bool(abs(ms.current_mesh().vertex_scalar_array() - 0.5).max() < 0.01)
    True

    Profile curvature of a terrain, along gravity:

    >>> from pymeshlab import Mesh
    >>> from bezier_filters.surfaces import waves
    >>> hills = waves()
    >>> ms.add_mesh(Mesh(hills.vertices, hills.faces))
    >>> result = compute_curvature_by_bezier_patch_per_vertex(ms, direction=(0, 0, -1), quality="along")
    >>> result["without_direction"], [name for name in result["attributes"] if "along" in name]
    (0, ['bz_curvature_along'])
    """
    fit = FitArguments(
        rings,
        radius,
        alpha,
        degree,
        smoothness,
        robust,
        noise,
        detail,
        threads,
        progress,
        neighbours,
        viewpoint,
        viewpointside,
    )
    output = Output(quality, onselected, color, colormap, percentile, colorrange, repair)
    return _run(ms, CURVATURE, fit, output, check_direction(direction, quality))


@checks_filter_arguments
@complete_docstring(TORSION)
def compute_torsion_by_bezier_patch_per_vertex(
    ms: MeshSet,
    *,
    rings: int | Automatic = "auto",
    radius: Length | None = None,
    alpha: float | Automatic = "auto",
    degree: int | Automatic = "auto",
    smoothness: Smoothness = "third_order",
    robust: bool | None = None,
    noise: Length | None = None,
    detail: Length | None = None,
    neighbours: int | None = None,
    viewpoint: tuple[float, float, float] | None = None,
    viewpointside: ViewpointSide = "toward",
    onselected: bool = False,
    repair: bool = False,
    color: bool = False,
    colormap: str = "auto",
    percentile: float = 2.0,
    colorrange: tuple[float, float] | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Report:
    """Set the quality of the current mesh to the principal geodesic torsion of fitted Bezier patches.

    The principal geodesic torsion t_max = (k_max - k_min) / 2 >= 0, in 1/length, is the largest torsion
    of the geodesics through a vertex; -t_max is the smallest. They are reached along the two bisectors
    of the principal directions.

    Examples
    --------
    >>> from pymeshlab import MeshSet
    >>> ms = MeshSet()
    >>> ms.create_torus(hradius=3.0, vradius=1.0, hsubdiv=96, vsubdiv=48)
    >>> result = compute_torsion_by_bezier_patch_per_vertex(ms)
    >>> bool(abs(result["statistics"]["max"] - 0.75) < 0.02)  # inner equator: (1 - (-1/2)) / 2
    True
    """
    fit = FitArguments(
        rings,
        radius,
        alpha,
        degree,
        smoothness,
        robust,
        noise,
        detail,
        threads,
        progress,
        neighbours,
        viewpoint,
        viewpointside,
    )
    return _run(ms, TORSION, fit, Output("torsion", onselected, color, colormap, percentile, colorrange, repair))


def _run(ms: MeshSet, name: str, fit: FitArguments, output: Output, direction: Direction | None = None) -> Report:
    """Run a filter on the current mesh and return its report; see `run_filter`."""
    # Normals are estimated where curvature is not.
    worst = FitStatus.NORMAL_ONLY if name == NORMALS else FitStatus.FOLDED

    def work(mesh: CurrentMesh, mask: BoolArray) -> Computed:
        geometry = fit_mesh(mesh, mask, fit)
        found = columns(name, geometry)
        if name == NORMALS:
            found[f"{PREFIX}normal_angle"] = _angles_in_degrees(geometry.normals, mesh.vertex_normals)
        directed = direction_columns(geometry, direction, geometry.status <= worst, output.quality)
        found |= directed.columns
        parts = [asdict(part) for part in geometry.fit.parts]
        verdict = fit_verdict("normal" if name == NORMALS else "curvature", geometry, mesh, mask, worst)
        report = {
            "status": geometry.status_counts(),
            "fit": asdict(geometry.fit) | {"parts": parts},
            "flipped": geometry.flipped,
            "mean_edge": mesh.mean_edge(),
            **directed.report,
            **verdict,
            "remarks": verdict["remarks"] + directed.remarks + remark_flipped(geometry),
        }
        return Computed(found, directed.known, report, set_normals if name == NORMALS else lambda: None)

    def set_normals() -> None:
        """Set the new normals where there is an estimate."""
        estimated = f"{GRADE} >= {worst.grade}"
        new = {axis: f"({estimated}) ? {PREFIX}normal_{axis} : n{axis}" for axis in "xyz"}
        ms.compute_normal_by_function_per_vertex(**new, onselected=output.onselected)

    return run_filter(ms, name, work, output)


def fit_mesh(mesh: CurrentMesh, mask: BoolArray, fit: FitArguments) -> VertexGeometry:
    """Fit the patches of the vertices in a mask (n,)."""
    lengths = {name: absolute_length(getattr(fit, name), mesh.vertices, name) for name in ("radius", "noise", "detail")}
    normals = None if len(mesh.faces) else _finite(mesh.vertex_normals)
    if normals is not None and fit.viewpoint is None and mesh.viewpoints is not None and not normals.any():
        fit = replace(fit, viewpoint=mesh.viewpoints)
    if fit.viewpoint is not None:
        normals = None
    given = vars(fit)
    selected = None if mask.all() else mask
    return estimate_vertex_geometry(mesh.vertices, mesh.faces, normals=normals, selected=selected, **given | lengths)


def _finite(vectors: FloatArray) -> FloatArray:
    """Replace vectors that are not finite by zeros."""
    return np.where(np.isfinite(vectors).all(axis=1, keepdims=True), vectors, 0.0)


def _angles_in_degrees(a: FloatArray, b: FloatArray) -> FloatArray:
    """Angles between vectors of any length, shape (n,); 0 where one of them is zero or not finite."""
    b = _finite(b)
    sine = np.linalg.norm(np.cross(a, b), axis=1)
    return np.asarray(np.degrees(np.arctan2(sine, np.einsum("ij,ij->i", a, b))))


@checks_filter_arguments
@complete_docstring(SMOOTH)
def apply_coord_bezier_patch_smoothing(
    ms: MeshSet,
    *,
    method: SmoothingMethod = "auto",
    iterations: int = 1,
    noise: Length | None = None,
    borders: SmoothedBorders = "curve",
    keepvolume: bool | None = None,
    detail: Length | None = None,
    relax: bool = False,
    rings: int | None = None,
    alpha: float | None = None,
    quality: str | None = None,
    onselected: bool = False,
    repair: bool = False,
    color: bool = False,
    colormap: str = "auto",
    percentile: float = 2.0,
    colorrange: tuple[float, float] | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Report:
    """Remove the noise of the current mesh and keep its shape, its volume and its edges.

    It needs no options: the noise is learned from the mesh, and a clean mesh does not change; round parts are smoothed
    like a scan, edges and corners are kept sharp. See `bezier_filters.smooth`.

    The vertices move, and vertex and face normals are those of the new faces. Attributes of other filters, such as
    ``bz_k_min``, stay and describe the mesh before. Besides its own attributes the filter changes nothing else in the
    MeshSet: not the selections, colours (unless asked for), textures or filter script; the id of the next new layer
    increases by one more.

    Parameters
    ----------
    ms : pymeshlab.MeshSet
        Its current mesh; without faces it is a point cloud, whose points move along the normals of its surface, and
        where points whose vertex normals are opposite are no neighbours.
    onselected : bool
        Only selected vertices move, or, if there are none, the vertices of the selected faces.

    Returns
    -------
    dict
        ``moved`` (number of vertices), ``displacement`` (mean, rms and max, lengths), ``noise_before`` and
        ``noise_after`` (standard deviation along the normal, lengths, or None; after, the error expected to be left),
        ``noise_length`` (over which that before is correlated, or 0), ``noise_heavy`` (whether it flips single
        normals), ``iterations`` (that moved vertices), ``remarks`` (texts),
        ``warnings`` (texts: why nothing could be smoothed), ``repaired`` (as in
        `meshing_close_holes_by_bezier_patch`, or None), ``volume_before``, ``volume_after``
        (length^3) and ``volume_ratio`` (None if nothing is closed), ``topology`` (what pymeshlab
        counts, as in `meshing_close_holes_by_bezier_patch`; it says which vertices are on the border, or on edges of
        more than two faces, which the paper's method holds), ``mean_edge``, ``flipped_before``, ``flipped_after``,
        ``degenerate_before``, ``degenerate_after``, ``new_bad_faces`` and ``new_intersecting_faces`` (numbers of
        faces), ``attributes`` (names written), ``quality``, ``unit``, ``statistics`` (min, median, max and mean of the
        quality), ``seconds`` (read, fit, topology, write, color) and, if coloured, ``color_range`` and ``colormap``.
        It can be written as JSON.

    Examples
    --------
    >>> from pymeshlab import MeshSet, PureValue
    >>> ms = MeshSet()
    >>> ms.create_sphere(radius=1.0, subdiv=4)
    >>> ms.apply_coord_random_displacement(displacement=PureValue(0.01))
    >>> result = apply_coord_bezier_patch_smoothing(ms)
    >>> bool(result["noise_after"] < 0.5 * result["noise_before"])
    True
    >>> round(result["volume_ratio"], 4)
    1.0
    """

    def work(mesh: CurrentMesh, mask: BoolArray) -> Computed:
        topology, movable = topology_of(mesh.vertices, mesh.faces), mask.copy()
        if borders == "fixed":
            movable &= ~topology.on_border
        if method == "paper":  # it has no patches at non-manifold vertices
            movable &= ~topology.not_manifold
        result = smooth(
            mesh.vertices,
            mesh.faces,
            method,
            normals=None if len(mesh.faces) else _finite(mesh.vertex_normals),
            iterations=iterations,
            noise=absolute_length(noise, mesh.vertices, "noise"),
            borders=borders,
            keep_volume=keepvolume,
            detail=absolute_length(detail, mesh.vertices, "detail"),
            relax=relax,
            rings=rings,
            alpha=alpha,
            selected=None if movable.all() else movable,
            threads=threads,
            progress=progress,
        )
        remark = f"iterations: {result.iterations} of {iterations} moved something, then nothing was left to do"
        report = _smoothing_report(result) | {
            "remarks": [remark] if 0 < result.iterations < iterations else [],
            "warnings": smoothing_warnings(result, mesh, method),
        }
        return Computed(columns(SMOOTH, result), mask, report, lambda: write_coordinates(ms, result.vertices))

    return run_filter(ms, SMOOTH, work, Output(quality, onselected, color, colormap, percentile, colorrange, repair))


def _smoothing_report(result: SmoothingResult) -> Report:
    """The result without its arrays, with statistics of these."""
    return {name: value for name, value in vars(result).items() if not isinstance(value, np.ndarray)} | {
        "moved": int(np.count_nonzero(result.displacement)),
        "displacement": {
            "mean": result.mean_displacement,
            "rms": result.rms_displacement,
            "max": result.max_displacement,
        },
        "volume_ratio": result.volume_ratio,
    }
