"""The filter on a pymeshlab MeshSet that takes the noise off a mesh."""

from typing import Any

import numpy as np

from bezier_filters.arrays import BoolArray
from bezier_filters.files.fields import ScalarField
from bezier_filters.meshlab.meshset import BezierFilterError, CurrentMesh, Length, MeshSet, absolute_length
from bezier_filters.meshlab.vertex_output import Computed, Output, choose_field, run_filter
from bezier_filters.runtime.parallel import Progress
from bezier_filters.smoothing.smooth import SmoothedBorders, SmoothingMethod, smooth
from bezier_filters.smoothing.smoothing_result import SmoothingResult

SMOOTHING_FIELDS = {
    "displacement": ScalarField("displacement", "displacement", "displacement", "length", signed=False),
    "sharpness": ScalarField("sharpness", "sharpness", "sharpness", "", signed=False),
}


def apply_coord_bezier_patch_smoothing(
    ms: MeshSet,
    *,
    method: SmoothingMethod = "auto",
    iterations: int = 1,
    noise: Length | None = None,
    borders: SmoothedBorders = "curve",
    keepvolume: bool | None = None,
    rings: int = 2,
    alpha: float = 0.8,
    quality: str | None = None,
    onselected: bool = False,
    color: bool = False,
    colormap: str = "auto",
    percentile: float = 2.0,
    colorrange: tuple[float, float] | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Take the noise off the current mesh and keep its shape, its volume and its edges.

    By default nothing is to be chosen: the noise is learned from the mesh, and what has none stays as it
    is; round parts are smoothed like a scan, edges and corners are kept sharp. See `bezier_filters.smooth`.

    The vertices move, and vertex and face normals are those of the new faces. The custom scalar attributes
    ``bz_displacement`` (how far each vertex moved, a length) and ``bz_sharpness`` (0 where the surface was
    taken for smooth, 1 where edges were kept) are added or overwritten. Attributes of other filters, such as
    ``bz_k_min``, stay as they are and describe the mesh before. Nothing else in the MeshSet changes: not its
    selections, colours (unless asked for), textures or filter script; the id of the next new layer skips one.

    Coordinates are used as stored, like in pymeshlab's own filters: the transform matrix is ignored.

    Parameters
    ----------
    ms : pymeshlab.MeshSet
        Its current mesh must have faces.
    method : {"auto", "paper"}
        ``"paper"`` moves every vertex onto its patch, as Li, Barsky, Jin (2009) do; it loses volume and
        rounds edges.
    iterations : int
        How often to smooth, at least 1. With ``"auto"`` once is enough.
    noise : pymeshlab.PercentageValue, pymeshlab.PureValue or float, optional
        Standard deviation of the noise along the normal, a length or a percentage of the diagonal of the
        bounding box; by default it is learned. Only for ``"auto"``.
    borders : {"curve", "fixed"}
        Whether border vertices are smoothed along the border, or stay. Only for ``"auto"``.
    keepvolume : bool, optional
        Whether closed parts keep the volume that they enclose; by default with ``"auto"`` they do, with
        ``"paper"`` not.
    rings, alpha : int, float
        Size of the neighbourhoods and weight of the points, in (0, 1]. Only for ``"paper"``.
    quality : {"displacement", "sharpness"} or None
        What the vertex quality becomes; None leaves it alone.
    onselected : bool
        Only selected vertices move, or, if there are none, the vertices of the selected faces.
    color : bool
        Colour all vertices by the quality, which must not be None.
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
        ``moved`` (number of vertices), ``displacement`` (mean, rms and max, lengths), ``noise_before`` and
        ``noise_after`` (standard deviation along the normal, lengths, or None), ``volume_before``,
        ``volume_after`` (length^3) and ``volume_ratio`` (None if nothing is closed), ``mean_edge``, ``flipped_before``,
        ``flipped_after``, ``degenerate_before``, ``degenerate_after`` and ``new_bad_faces`` (numbers of faces),
        ``attributes`` (names written), ``quality``, ``unit``, ``statistics`` (min, median, max and mean of
        the quality), ``seconds`` (read, fit, write, color) and, if coloured, ``color_range`` and
        ``colormap``. It can be written as JSON.

    Raises
    ------
    BezierFilterError
        If the mesh, an attribute on it or a parameter is refused; the MeshSet is as it was.
    CancelledError
        If `progress` returned False; the MeshSet is as it was.

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
        if not len(mesh.faces):
            raise BezierFilterError(
                "the current mesh has no faces, and smoothing needs a surface; make one first, for example with "
                "generate_surface_reconstruction_screened_poisson"
            )
        result = smooth(
            mesh.vertices,
            mesh.faces,
            method,
            iterations=iterations,
            noise=None if noise is None else absolute_length(noise, mesh.vertices, "noise"),
            borders=borders,
            keep_volume=keepvolume,
            rings=rings,
            alpha=alpha,
            selected=None if mask.all() else mask,
            threads=threads,
            progress=progress,
        )
        fields = SMOOTHING_FIELDS.values()
        columns = {field.mesh_attribute: getattr(result, field.attribute) for field in fields}
        return Computed(columns, mask, _report(mesh, result), vertices=result.vertices)

    names = [field.mesh_attribute for field in SMOOTHING_FIELDS.values()]
    return run_filter(
        ms,
        names,
        work,
        Output(choose_field(quality, SMOOTHING_FIELDS), onselected, color, colormap, percentile, colorrange),
    )


def _report(mesh: CurrentMesh, result: SmoothingResult) -> dict[str, Any]:
    edges = mesh.vertices[mesh.faces[:, 1]] - mesh.vertices[mesh.faces[:, 0]]
    return {
        "mean_edge": float(np.linalg.norm(edges, axis=1).mean()),
        "moved": int(np.count_nonzero(result.displacement)),
        "displacement": {
            "mean": result.mean_displacement,
            "rms": result.rms_displacement,
            "max": result.max_displacement,
        },
        "noise_before": result.noise_before,
        "noise_after": result.noise_after,
        "volume_before": result.volume_before,
        "volume_after": result.volume_after,
        "volume_ratio": result.volume_ratio,
        "flipped_before": result.flipped_before,
        "flipped_after": result.flipped_after,
        "degenerate_before": result.degenerate_before,
        "degenerate_after": result.degenerate_after,
        "new_bad_faces": result.new_bad_faces,
    }
