"""The filter that compares the current mesh with another layer.

Written like the filters of fields of vertices: see `vertex_filters`.
"""

from dataclasses import replace

import numpy as np

from bezier_filters.arrays import BoolArray, Report
from bezier_filters.display import AUTO, TOLERANCE, TOLERANCES_SHOWN
from bezier_filters.fields import DEVIATION, columns
from bezier_filters.inspection.deviation import Deviation, Measured, compare
from bezier_filters.inspection.deviation_status import DeviationStatus
from bezier_filters.meshlab.filter_run import Computed, Output, run_filter
from bezier_filters.meshlab.meshset import (
    BezierFilterError,
    CurrentMesh,
    Length,
    MeshSet,
    absolute_length,
    checks_filter_arguments,
    current_mesh,
    preserve_filter_script,
    read_current_mesh,
)
from bezier_filters.parameters import complete_docstring
from bezier_filters.runtime.parallel import Progress

# Share of the squares of deviations that a rigid motion makes from which on meshes are not registered, if any region
# deviates: on noisy tori, ellipsoids and stars 0.05 without a motion, 0.2 with a dent, 0.55 with a tenth of an edge
MIN_RIGID_SHARE = 0.5
GREY = 166  # of vertices that were not compared, from 0 to 255


@checks_filter_arguments
@complete_docstring(DEVIATION)
def compute_deviation_by_bezier_patch_per_vertex(
    ms: MeshSet,
    *,
    refmesh: int | None = None,
    measured: Measured = "auto",
    tolerance: Length | None = None,
    maxdistance: Length | None = None,
    region: int = 200,
    noise: Length | None = None,
    refnoise: Length | None = None,
    quality: str | None = "deviation",
    onselected: bool = False,
    color: bool = False,
    colormap: str = "auto",
    percentile: float = 2.0,
    colorrange: tuple[float, float] | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Report:
    """Compute the signed distance of the current mesh from the surface of another layer, with its significance.

    Both layers must be in the same position, as their transform matrices place them: nothing is registered. The
    reference is the surface of the Bezier patches fitted to its vertices; the current mesh, which may be a point cloud,
    is compared by its own patches or its points. See `bezier_filters.compare`.

    Vertices that cannot be compared have 0, are grey, and have a grade below 6 in ``bz_deviation_grade``. Nothing else
    in the MeshSet changes.

    Parameters
    ----------
    ms : pymeshlab.MeshSet
        Its current mesh is the one that is inspected.
    refmesh : int, optional
        Id of the layer of the reference, which must have faces; the other layer where there are two.
    onselected : bool
        Only selected vertices are compared, or, if there are none, the vertices of the selected faces.

    Returns
    -------
    dict
        ``status`` (number of vertices per status name, see `DeviationStatus`), ``compared`` (number of vertices),
        ``measured``, ``mean`` and ``rms`` (of the deviation, lengths), ``lowest`` and ``highest`` (dicts: ``vertex``,
        ``deviation``, ``std``, ``place``), ``tolerance``, ``share_within`` (or None), ``share_significant`` (beyond
        three standard errors; .0027 under noise alone, or None), ``rigid_share`` (of the sum of squares, that a rigid
        motion makes; half and more is a remark if there are regions), ``regions`` (a dict for each region that deviates
        significantly, the most significant first: ``vertex``, ``vertices`` (number), ``place``, ``deviation``, ``std``,
        ``p_value``), ``noise`` and ``reference_noise`` (lengths, or None), ``mean_edge``, ``warnings`` (texts: why
        nothing was compared), ``remarks``, ``topology`` (what pymeshlab counts, as in
        `meshing_close_holes_by_bezier_patch`), ``attributes``, ``quality``, ``unit``, ``statistics`` (of the quality),
        ``seconds`` and, if coloured, ``color_range`` and ``colormap``. It can be written as JSON.

    Examples
    --------
    >>> from pymeshlab import MeshSet
    >>> ms = MeshSet()
    >>> ms.create_sphere(radius=1.0, subdiv=4)
    >>> ms.create_sphere(radius=1.01, subdiv=3)
    >>> report = compute_deviation_by_bezier_patch_per_vertex(ms, tolerance=0.02)
    >>> round(report["mean"], 3), report["share_within"], report["status"]
    (0.01, 1.0, {'OK': 642})
    """
    given = read_current_mesh(ms)  # whose faults are reported first
    reference = _read_reference(ms, refmesh)
    if color and tolerance is not None:
        half = TOLERANCES_SHOWN * (absolute_length(tolerance, given.vertices, "tolerance") or 0.0)
        colormap = TOLERANCE if colormap == AUTO and quality != "z" else colormap
        colorrange = (-half, half) if colorrange is None and quality != "z" else colorrange
    output = Output(quality, onselected, color, colormap, percentile, colorrange)

    def work(mesh: CurrentMesh, mask: BoolArray) -> Computed:
        lengths = {"tolerance": tolerance, "max_distance": maxdistance, "noise": noise, "reference_noise": refnoise}
        found = compare(
            mesh.vertices,
            mesh.faces if len(mesh.faces) else None,
            reference.vertices,
            reference.faces,
            measured=measured,
            region=region,
            selected=None if mask.all() else mask,
            threads=threads,
            progress=progress,
            **{name: absolute_length(value, mesh.vertices, name) for name, value in lengths.items()},
        )
        report = deviation_report(found) | {"mean_edge": mesh.mean_edge()}
        return Computed(columns(DEVIATION, found), found.compared, report)

    report = run_filter(ms, DEVIATION, work, output)
    if color:
        with preserve_filter_script(ms):
            known = f"bz_deviation_grade >= {DeviationStatus.ON_FACE.grade}"
            channels = {axis: f"({known}) ? {channel} : {GREY}" for axis, channel in zip("xyz", "rgb", strict=True)}
            ms.compute_color_by_function_per_vertex(**channels, a="a", onselected=False)
    return report


def _read_reference(ms: MeshSet, layer: int | None) -> CurrentMesh:
    """Read the reference, another layer, in the coordinates of the current one, which stays current."""
    own = current_mesh(ms).id()
    others = [mesh.id() for mesh in ms if mesh.id() != own]
    if layer is None and len(others) != 1:
        raise BezierFilterError(
            f"refmesh: there are {len(others)} layers besides the current one; "
            + ("give the id of the reference" if others else "load the reference, and make the scan the current mesh")
        )
    wanted = others[0] if layer is None else layer
    if wanted not in others:
        raise BezierFilterError(
            f"refmesh: got {layer!r}, expected the id of another layer: {', '.join(map(str, others))}"
        )
    transform = np.array(current_mesh(ms).transform_matrix())
    ms.set_current_mesh(wanted)
    try:
        reference = read_current_mesh(ms)
        transform = np.linalg.solve(transform, np.array(current_mesh(ms).transform_matrix()))
    except np.linalg.LinAlgError as error:
        raise BezierFilterError("the transform matrix of the current mesh has no inverse; reset it first") from error
    finally:
        ms.set_current_mesh(own)
    if not len(reference.faces):
        raise BezierFilterError("refmesh: the reference has no faces, and a surface is needed; it is a point cloud")
    if not np.array_equal(transform, np.eye(4)):
        reference = replace(reference, vertices=reference.vertices @ transform[:3, :3].T + transform[:3, 3])
    return reference


def deviation_report(found: Deviation) -> Report:
    """A deviation as plain values."""
    ends = {"lowest": found.lowest, "highest": found.highest}
    regions = [
        {
            "vertex": region.vertex,
            "vertices": len(region.vertices),
            "place": region.place.tolist(),
            "deviation": region.distance,
            "std": region.std,
            "p_value": region.p_value,
        }
        for region in found.regions
    ]
    count, n = int(found.compared.sum()), len(found.status)
    warnings = [] if count else [f"no vertex could be compared: {_describe_most(found)}"]
    remarks = [f"{n - count:,} of {n:,} vertices were not compared; most: {_describe_most(found)}"] if count < n else []
    if found.regions and (found.rigid_share or 0.0) > MIN_RIGID_SHARE:
        remarks.append(f"of the deviation, {found.rigid_share:.0%} is a rigid motion: register the meshes first")
    for name, noise in (("mesh", found.noise), ("reference", found.reference_noise)):
        if noise is None:
            remarks.append(f"the noise of the {name} could not be learned, so that there are no standard errors")
    return {
        "status": found.status_counts(),
        "compared": count,
        "measured": found.measured,
        "mean": found.mean,
        "rms": found.rms,
        **{name: None if row is None else _describe_vertex(found, row) for name, row in ends.items()},
        "tolerance": found.tolerance,
        "share_within": found.share_within,
        "share_significant": found.share_significant,
        "rigid_share": found.rigid_share,
        "regions": regions,
        "noise": found.noise,
        "reference_noise": found.reference_noise,
        "warnings": warnings,
        "remarks": remarks if count else [],
    }


def _describe_vertex(found: Deviation, row: int) -> Report:
    return {
        "vertex": row,
        "deviation": float(found.distances[row]),
        "std": float(found.distance_std[row]),
        "place": found.places[row].tolist(),
    }


def _describe_most(found: Deviation) -> str:
    """The message of the most frequent status of vertices that were not compared."""
    status = found.status[~found.compared]
    return list(DeviationStatus)[int(np.bincount(status).argmax())].message
