"""The filter that sets the vertex normals of a pymeshlab MeshSet to those of Bezier patches."""

from typing import Any

import numpy as np

from bezier_filters.arrays import FloatArray
from bezier_filters.estimation.fit_options import Automatic
from bezier_filters.estimation.vertex_geometry import VertexGeometry
from bezier_filters.files.fields import PREFIX, ScalarField, normal_columns
from bezier_filters.meshlab.meshset import Length, MeshSet
from bezier_filters.meshlab.vertex_filter import FitOptions, VertexFilter, run_vertex_filter
from bezier_filters.meshlab.vertex_output import Columns, Output, choose_field
from bezier_filters.patches.smoothness import Smoothness
from bezier_filters.runtime.parallel import Progress
from bezier_filters.status import FitStatus

_ANGLE = ScalarField("angle", "normal_angle", "angle to the previous normal", "degrees", signed=False)
NORMAL_FIELDS = {
    "angle": _ANGLE,
    "x": ScalarField("x", "normal_x", "x of the normal", "", signed=True),
    "y": ScalarField("y", "normal_y", "y of the normal", "", signed=True),
    "z": ScalarField("z", "normal_z", "z of the normal", "", signed=True),
}
"""Fields that the normal filter can make the quality; `ScalarField.values` knows only some of them."""


def compute_normal_by_bezier_patch_per_vertex(
    ms: MeshSet,
    *,
    rings: int | Automatic = "auto",
    radius: Length | None = None,
    alpha: float | Automatic = "auto",
    degree: int | Automatic = "auto",
    smoothness: Smoothness = "third_order",
    robust: bool = False,
    quality: str | None = "angle",
    onselected: bool = False,
    color: bool = False,
    colormap: str = "auto",
    percentile: float = 2.0,
    colorrange: tuple[float, float] | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Set the vertex normals of the current mesh to those of Bezier patches fitted to its vertices.

    The normals have unit length and point to the side from which the faces are counter-clockwise, or
    in a point cloud to that of the previous normals.
    Vertices where nothing could be fitted keep theirs. The custom scalar attributes ``bz_normal_x``,
    ``_y``, ``_z``, ``bz_normal_angle`` (degrees), ``bz_normal_std`` (standard error, radians),
    ``bz_fit_status`` (`FitStatus` codes), ``bz_rings_used`` and
    ``bz_residual`` (length) are added or overwritten. Nothing else in the MeshSet changes: not its
    selections, colours (unless asked for), textures, other attributes or filter script. Running it again
    overwrites the columns and leaves an attribute ``outlierScore`` of zeros.

    Coordinates are used as stored, like in pymeshlab's own filters: the transform matrix is ignored.

    Parameters
    ----------
    ms : pymeshlab.MeshSet
        Its current mesh may be a point cloud, whose vertex normals tell the outside where they are
        not zero (see `estimate_vertex_geometry`).
    rings : int or "auto"
        Size of the fitted neighbourhood in edges, at least 1. By default the data choose this and
        the next two, for the smallest predicted error at the noise that they have.
    radius : pymeshlab.PercentageValue, pymeshlab.PureValue or float, optional
        Size of the neighbourhood as a length, or as a percentage of the diagonal of the bounding box,
        instead of `rings`: one scale for all vertices, whatever the density of the mesh.
    alpha : float or "auto"
        Weight of the points against the smoothness of the patch, in (0, 1].
    degree : int or "auto"
        Degree of the patch in each parameter, 2 to 4, or with ``alpha="auto"`` its total degree, 2 to 6.
    smoothness : {"third_order", "paper"}
        ``"paper"`` is the method of Li, Barsky, Jin (2009) to the letter; see `estimate_vertex_geometry`.
    robust : bool
        Whether points far off their patch lose their weight, for scans with outliers.
    quality : {"angle", "x", "y", "z"} or None
        What the vertex quality becomes: the angle in degrees, 0 to 180, between the new and the
        previous vertex normal, or a component of the new one. None leaves the quality alone.
    onselected : bool
        Only selected vertices get new normals, quality and columns; if there are none, the vertices of
        the selected faces. The others keep theirs, or get 0 where a column or the quality is new.
    color : bool
        Colour all vertices by the quality.
    colormap : str
        ``"auto"``: Cool Warm where zero is in the middle, else Viridis. Paper: red high, blue medium, green low. Or
        any colour map of pymeshlab, in any case; red or bright is high (see `color_by_quality`).
    percentile : float
        Percentage of the values that may lie beyond each end of the colours, in [0, 50).
    colorrange : (float, float), optional
        Qualities of the first and the last colour, instead of those that follow from `percentile`.
    threads : int, optional
        Number of threads; by default all usable cores. The result does not depend on it.
    progress : callable, optional
        ``progress(done, total)`` is called now and then; if it returns False, the filter stops.

    Returns
    -------
    dict
        ``status`` (number of vertices per status name), ``fit`` (the ``rings`` or ``radius``, ``degree`` and
        ``alpha`` that were used, and the ``noise_sigma`` that was found, a length), ``attributes`` (names
        written), ``quality`` and ``unit``, ``statistics`` (min, median, max and mean of the quality over
        the vertices with an estimate), ``seconds`` (read, fit, write, color) and, if coloured,
        ``color_range`` and ``colormap``. It can be written as JSON.

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
    >>> ms.create_sphere(radius=1.0, subdiv=4)
    >>> result = compute_normal_by_bezier_patch_per_vertex(ms)
    >>> result["status"], result["unit"]
    ({'OK': 2562}, 'degrees')
    >>> bool(abs(ms.current_mesh().vertex_normal_matrix() - ms.current_mesh().vertex_matrix()).max() < 1e-3)
    True
    """
    return run_vertex_filter(
        ms,
        VertexFilter(_normal_columns, FitStatus.NORMAL_ONLY, sets_normals=True),
        FitOptions(rings, radius, alpha, degree, smoothness, robust, threads, progress),
        Output(choose_field(quality, NORMAL_FIELDS), onselected, color, colormap, percentile, colorrange),
    )


def _normal_columns(geometry: VertexGeometry, previous_normals: FloatArray) -> Columns:
    angles = _angles_in_degrees(geometry.normals, previous_normals)
    return normal_columns(geometry) | {PREFIX + _ANGLE.attribute: angles}


def _angles_in_degrees(a: FloatArray, b: FloatArray) -> FloatArray:
    """Angles between vectors of any length, shape (n,); 0 where one of them is zero or not finite."""
    b = np.where(np.isfinite(b).all(axis=1, keepdims=True), b, 0.0)
    sine = np.linalg.norm(np.cross(a, b), axis=1)
    angles: FloatArray = np.degrees(np.arctan2(sine, np.einsum("ij,ij->i", a, b)))
    return angles
