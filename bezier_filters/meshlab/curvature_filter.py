"""The filters that write curvature or torsion by Bezier patches into a pymeshlab MeshSet.

Like the other filters they follow pymeshlab's manner: named ``verb_what_by_how_per_element``, keyword arguments, in
place on the current mesh, a dict as result.
"""

from typing import Any

from bezier_filters.arrays import FloatArray
from bezier_filters.estimation.fit_options import Automatic
from bezier_filters.estimation.vertex_geometry import VertexGeometry
from bezier_filters.files.fields import CURVATURE_FIELDS, TORSION_FIELD, curvature_columns, torsion_columns
from bezier_filters.meshlab.meshset import Length, MeshSet
from bezier_filters.meshlab.vertex_filter import FitOptions, VertexFilter, run_vertex_filter
from bezier_filters.meshlab.vertex_output import Columns, Output, choose_field
from bezier_filters.patches.smoothness import Smoothness
from bezier_filters.runtime.parallel import Progress
from bezier_filters.status import FitStatus


def compute_curvature_by_bezier_patch_per_vertex(
    ms: MeshSet,
    *,
    rings: int | Automatic = "auto",
    radius: Length | None = None,
    alpha: float | Automatic = "auto",
    degree: int | Automatic = "auto",
    smoothness: Smoothness = "third_order",
    robust: bool = False,
    quality: str | None = "mean",
    onselected: bool = False,
    color: bool = False,
    colormap: str = "auto",
    percentile: float = 2.0,
    colorrange: tuple[float, float] | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Compute the curvature of the current mesh from Bezier patches fitted to its vertices.

    Curvatures are positive on a convex body with outward normals, as in pymeshlab, and have the unit
    1/length; the Gaussian curvature has 1/length^2. The custom scalar attributes
    ``bz_mean_curvature``, ``bz_gaussian_curvature``, ``bz_k_min``, ``bz_k_max``, ``bz_curvedness``,
    ``bz_shape_index``, the standard errors ``bz_mean_curvature_std`` and ``bz_gaussian_curvature_std`` (0 where
    alpha is given), the unit principal directions ``bz_direction_min_x``, ``_y``, ``_z`` and
    ``bz_direction_max_x``, ``_y``, ``_z`` (of arbitrary sign), ``bz_extremality_min`` and
    ``bz_extremality_max`` (the derivatives of the principal curvatures along their directions,
    1/length^2, whose signs go with those of the directions), ``bz_fit_status`` (`FitStatus` codes),
    ``bz_rings_used`` and ``bz_residual`` (length) are added or overwritten. Where there is no estimate they
    hold 0. Nothing else in the MeshSet changes: not its normals, selections, colours (unless asked for),
    textures, other attributes or filter script. Running it again overwrites the columns and leaves an
    attribute ``outlierScore`` of zeros.

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
        ``"paper"`` is the method of Li, Barsky, Jin (2009) to the letter, whose curvature is biased; see
        `estimate_vertex_geometry`.
    robust : bool
        Whether points far off their patch lose their weight, for scans with outliers.
    quality : {"mean", "gaussian", "min", "max", "curvedness", "shape_index", "std"} or None
        What the vertex quality becomes; "std" is the standard error of the mean curvature. None
        leaves the quality alone.
    onselected : bool
        Only selected vertices get new quality and columns; if there are none, the vertices of the
        selected faces. The others keep theirs, or get 0 where a column or the quality is new.
    color : bool
        Colour all vertices by the quality; zero gets the middle colour, except for the curvedness.
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
    >>> ms.create_sphere(radius=2.0, subdiv=4)
    >>> result = compute_curvature_by_bezier_patch_per_vertex(ms, quality="mean", color=True)
    >>> result["unit"], bool(abs(result["statistics"]["median"] - 0.5) < 0.01)
    ('1/length', True)
    >>> bool(abs(ms.current_mesh().vertex_scalar_array() - 0.5).max() < 0.01)
    True
    """
    return run_vertex_filter(
        ms,
        VertexFilter(_curvature_columns, FitStatus.FOLDED),
        FitOptions(rings, radius, alpha, degree, smoothness, robust, threads, progress),
        Output(choose_field(quality, CURVATURE_FIELDS), onselected, color, colormap, percentile, colorrange),
    )


def compute_torsion_by_bezier_patch_per_vertex(
    ms: MeshSet,
    *,
    rings: int | Automatic = "auto",
    radius: Length | None = None,
    alpha: float | Automatic = "auto",
    degree: int | Automatic = "auto",
    smoothness: Smoothness = "third_order",
    robust: bool = False,
    onselected: bool = False,
    color: bool = False,
    colormap: str = "auto",
    percentile: float = 2.0,
    colorrange: tuple[float, float] | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Set the quality of the current mesh to the principal geodesic torsion of fitted Bezier patches.

    The principal geodesic torsion t_max = (k_max - k_min) / 2 >= 0, in 1/length, is the largest torsion
    of the geodesics through a vertex; -t_max is the smallest. They are reached along the two bisectors
    of the principal directions. The custom scalar attributes ``bz_geodesic_torsion``,
    ``bz_torsion_direction_plus_x``, ``_y``, ``_z`` and ``bz_torsion_direction_minus_x``, ``_y``, ``_z`` (unit
    directions of +t_max and -t_max, of arbitrary sign), ``bz_fit_status`` (`FitStatus` codes),
    ``bz_rings_used`` and ``bz_residual`` (length) are added or overwritten. Where there is no estimate they
    hold 0. Nothing else in the MeshSet changes: not its normals, selections, colours (unless asked for),
    textures, other attributes or filter script. Running it again overwrites the columns and leaves an
    attribute ``outlierScore`` of zeros.

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
        ``"paper"`` is the method of Li, Barsky, Jin (2009) to the letter, whose curvature is biased; see
        `estimate_vertex_geometry`.
    robust : bool
        Whether points far off their patch lose their weight, for scans with outliers.
    onselected : bool
        Only selected vertices get new quality and columns; if there are none, the vertices of the
        selected faces. The others keep theirs, or get 0 where a column or the quality is new.
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
    >>> ms.create_torus(hradius=3.0, vradius=1.0, hsubdiv=96, vsubdiv=48)
    >>> result = compute_torsion_by_bezier_patch_per_vertex(ms)
    >>> bool(abs(result["statistics"]["max"] - 0.75) < 0.02)  # inner equator: (1 - (-1/2)) / 2
    True
    """
    return run_vertex_filter(
        ms,
        VertexFilter(_torsion_columns, FitStatus.FOLDED),
        FitOptions(rings, radius, alpha, degree, smoothness, robust, threads, progress),
        Output(TORSION_FIELD, onselected, color, colormap, percentile, colorrange),
    )


def _curvature_columns(geometry: VertexGeometry, _previous_normals: FloatArray) -> Columns:
    return curvature_columns(geometry)


def _torsion_columns(geometry: VertexGeometry, _previous_normals: FloatArray) -> Columns:
    return torsion_columns(geometry)
