"""The filter on a pymeshlab MeshSet that takes the noise off a mesh."""

from dataclasses import fields

import numpy as np

from bezier_filters.arrays import BoolArray, Report
from bezier_filters.fields import SMOOTH, columns
from bezier_filters.meshlab.filter_run import Computed, Output, run_filter
from bezier_filters.meshlab.meshset import BezierFilterError, CurrentMesh, Length, MeshSet, absolute_length
from bezier_filters.meshlab.topology import topology_of
from bezier_filters.parameters import documented
from bezier_filters.runtime.parallel import Progress
from bezier_filters.smoothing.smooth import SmoothedBorders, SmoothingMethod, SmoothingResult, smooth


@documented(SMOOTH)
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
    color: bool = False,
    colormap: str = "auto",
    percentile: float = 2.0,
    colorrange: tuple[float, float] | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Report:
    """Take the noise off the current mesh and keep its shape, its volume and its edges.

    By default nothing is to be chosen: the noise is learned from the mesh, and what has none stays as it
    is; round parts are smoothed like a scan, edges and corners are kept sharp. See `bezier_filters.smooth`.

    The vertices move, and vertex and face normals are those of the new faces. Attributes of other filters, such as
    ``bz_k_min``, stay as they are and describe the mesh before. Besides its own attributes the filter changes nothing
    else in the MeshSet: not the selections, colours (unless asked for), textures or filter script; the id of the next
    new layer skips one.

    Parameters
    ----------
    ms : pymeshlab.MeshSet
        Its current mesh must have faces.
    onselected : bool
        Only selected vertices move, or, if there are none, the vertices of the selected faces.

    Returns
    -------
    dict
        ``moved`` (number of vertices), ``displacement`` (mean, rms and max, lengths), ``noise_before`` and
        ``noise_after`` (standard deviation along the normal, lengths, or None), ``noise_length`` (over which that
        before is correlated, or 0), ``noise_heavy`` (whether it turns single normals), ``iterations`` (that moved
        something: after those there is nothing left to do), ``remarks`` (texts), ``volume_before``,
        ``volume_after`` (length^3) and ``volume_ratio`` (None if nothing is closed), ``topology`` (what pymeshlab
        counts, as in `meshing_close_holes_by_bezier_patch`), ``mean_edge``, ``flipped_before``, ``flipped_after``,
        ``degenerate_before``, ``degenerate_after`` and ``new_bad_faces`` (numbers of faces), ``attributes`` (names
        written), ``quality``, ``unit``, ``statistics`` (min, median, max and mean of the quality), ``seconds`` (read,
        fit, write, color) and, if coloured, ``color_range`` and ``colormap``. It can be written as JSON.

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
            noise=absolute_length(noise, mesh.vertices, "noise"),
            borders=borders,
            keep_volume=keepvolume,
            detail=absolute_length(detail, mesh.vertices, "detail"),
            relax=relax,
            rings=rings,
            alpha=alpha,
            selected=None if mask.all() else mask,
            threads=threads,
            progress=progress,
        )
        report = _report(result) | {
            "topology": topology_of(mesh.vertices, mesh.faces).counts,
            "remarks": _remarks(result.iterations, iterations),
        }
        return Computed(columns(SMOOTH, result), mask, report, vertices=result.vertices)

    return run_filter(ms, SMOOTH, work, Output(quality, onselected, color, colormap, percentile, colorrange))


def _remarks(done: int, asked: int) -> list[str]:
    return [f"iterations: {done} of {asked} moved something, then nothing was left to do"] if 0 < done < asked else []


def _report(result: SmoothingResult) -> Report:
    """The result without its arrays, and what follows from them."""
    every = {field.name: getattr(result, field.name) for field in fields(result)}
    return {name: value for name, value in every.items() if not isinstance(value, np.ndarray)} | {
        "moved": int(np.count_nonzero(result.displacement)),
        "displacement": {
            "mean": result.mean_displacement,
            "rms": result.rms_displacement,
            "max": result.max_displacement,
        },
        "volume_ratio": result.volume_ratio,
    }
