"""The filters that write the geometry of vertices into a MeshSet: normals, curvature and torsion by Bezier patches.

Like the other filters they follow pymeshlab's manner: named ``verb_what_by_how_per_element``, keyword arguments, in
place on the current mesh, a dict as result. What their docstrings do not say, the tables in `fields` and `parameters`
do; `documented` puts it there.
"""

from dataclasses import asdict, dataclass

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, Report
from bezier_filters.estimation.estimate import estimate_vertex_geometry
from bezier_filters.estimation.fit_options import Automatic
from bezier_filters.estimation.vertex_geometry import VertexGeometry
from bezier_filters.fields import CURVATURE, NORMALS, PREFIX, TORSION, columns
from bezier_filters.meshlab.filter_run import Computed, Output, run_filter
from bezier_filters.meshlab.meshset import CurrentMesh, Length, MeshSet, absolute_length
from bezier_filters.parameters import documented
from bezier_filters.patches.smoothness import Smoothness
from bezier_filters.runtime.parallel import Progress
from bezier_filters.status import FitStatus

MEASURED = 20_000  # faces whose edges are measured, at most


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


@documented(NORMALS)
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
    quality: str | None = "angle",
    onselected: bool = False,
    color: bool = False,
    colormap: str = "auto",
    percentile: float = 2.0,
    colorrange: tuple[float, float] | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Report:
    """Set the vertex normals of the current mesh to those of Bezier patches fitted to its vertices.

    The normals have unit length and point to the side from which the faces are counter-clockwise, or
    in a point cloud to that of the previous normals. Vertices where nothing could be fitted keep theirs.

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
    fit = FitArguments(rings, radius, alpha, degree, smoothness, robust, noise, detail, threads, progress)
    return _run(ms, NORMALS, fit, Output(quality, onselected, color, colormap, percentile, colorrange))


@documented(CURVATURE)
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
    quality: str | None = "mean",
    onselected: bool = False,
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
    """
    fit = FitArguments(rings, radius, alpha, degree, smoothness, robust, noise, detail, threads, progress)
    return _run(ms, CURVATURE, fit, Output(quality, onselected, color, colormap, percentile, colorrange))


@documented(TORSION)
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
    onselected: bool = False,
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
    fit = FitArguments(rings, radius, alpha, degree, smoothness, robust, noise, detail, threads, progress)
    return _run(ms, TORSION, fit, Output("torsion", onselected, color, colormap, percentile, colorrange))


def _run(ms: MeshSet, name: str, fit: FitArguments, output: Output) -> Report:
    """Run a filter on the current mesh and return its report; see `run_filter`."""
    # Normals are estimated where curvature is not.
    worst = FitStatus.NORMAL_ONLY if name == NORMALS else FitStatus.FOLDED

    def work(mesh: CurrentMesh, mask: BoolArray) -> Computed:
        geometry = fit_mesh(mesh, mask, fit)
        found, normals = columns(name, geometry), dict[str, str]()
        if name == NORMALS:
            found[f"{PREFIX}normal_angle"] = _angles_in_degrees(geometry.normals, mesh.vertex_normals)
            # The new normals where there is an estimate, the old ones elsewhere.
            estimated = f"{PREFIX}fit_status <= {int(worst)}"
            normals = {axis: f"({estimated}) ? {PREFIX}normal_{axis} : n{axis}" for axis in "xyz"}
        parts = [asdict(part) for part in geometry.fit.parts]
        report = {
            "status": geometry.status_counts(),
            "fit": asdict(geometry.fit) | {"parts": parts},
            "mean_edge": _mean_edge(mesh),
        }
        return Computed(found, geometry.status <= worst, report, normals=normals)

    return run_filter(ms, name, work, output)


def _mean_edge(mesh: CurrentMesh) -> float | None:
    """Mean length of the edges of some 10,000 faces or more, or of all; None for a point cloud."""
    n, faces = len(mesh.vertices), mesh.faces[:: 1 + len(mesh.faces) // MEASURED].astype(np.int64)
    ends = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]], axis=2).reshape(-1, 2)
    start, stop = np.divmod(np.unique(ends[:, 0] * n + ends[:, 1]), n)  # each edge once
    lengths = np.linalg.norm(mesh.vertices[start] - mesh.vertices[stop], axis=1)[start < stop]
    return float(lengths.mean()) if len(lengths) else None


def fit_mesh(mesh: CurrentMesh, mask: BoolArray, fit: FitArguments) -> VertexGeometry:
    """Fit the patches of the vertices in a mask (n,)."""
    given = vars(fit)
    lengths = {name: absolute_length(given[name], mesh.vertices, name) for name in ("radius", "noise", "detail")}
    normals = None if len(mesh.faces) else _finite(mesh.vertex_normals)
    selected = None if mask.all() else mask
    return estimate_vertex_geometry(mesh.vertices, mesh.faces, normals=normals, selected=selected, **given | lengths)


def _finite(vectors: FloatArray) -> FloatArray:
    """Vectors with zeros for those that are not finite."""
    return np.where(np.isfinite(vectors).all(axis=1, keepdims=True), vectors, 0.0)


def _angles_in_degrees(a: FloatArray, b: FloatArray) -> FloatArray:
    """Angles between vectors of any length, shape (n,); 0 where one of them is zero or not finite."""
    b = _finite(b)
    sine = np.linalg.norm(np.cross(a, b), axis=1)
    return np.asarray(np.degrees(np.arctan2(sine, np.einsum("ij,ij->i", a, b))))
