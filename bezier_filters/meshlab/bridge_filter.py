"""The filter on a pymeshlab MeshSet that joins holes by bands."""

from bezier_filters.arrays import Report
from bezier_filters.errors import InvalidMeshError, InvalidParameterError
from bezier_filters.holes.bridging import MAX_GAP, BridgingResult, Pairs, bridge_holes
from bezier_filters.holes.hole_filling import fill_holes
from bezier_filters.holes.hole_report import HoleReport
from bezier_filters.meshlab.hole_filter import describe_report, growth_of
from bezier_filters.meshlab.mesh_growth import grow_mesh
from bezier_filters.meshlab.meshset import (
    BezierFilterError,
    CurrentMesh,
    Length,
    MeshSet,
    absolute_length,
    check_unchanged,
    checks_filter_arguments,
    preserve_filter_script,
    read_current_mesh,
)
from bezier_filters.meshlab.topology import topology_of
from bezier_filters.parameters import complete_docstring
from bezier_filters.runtime.compile_time import clock_without_compilation
from bezier_filters.runtime.parallel import Progress


@checks_filter_arguments
@complete_docstring("bridge")
def meshing_bridge_holes_by_bezier_patch(
    ms: MeshSet,
    *,
    pairs: str = "auto",
    intersecting: bool = False,
    noise: Length | None = None,
    newfaceselected: bool = False,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Report:
    """Join pairs of holes of the current mesh by bands that continue the surface on both sides.

    A gap around a tube is closed, two halves of a body become one, and a bolt hole gets its wall, which is straight
    because the surface ends there at an angle. See `bezier_filters.bridge_holes`. The mesh becomes a new layer with the
    id ``result["id"]``, as by `meshing_close_holes_by_bezier_patch`: old vertices and faces stay the first, and new
    ones continue their textures, colours, quality and custom attributes. If nothing is joined, nothing changes.

    Parameters
    ----------
    ms : pymeshlab.MeshSet
        Its current mesh must have faces.
    newfaceselected : bool
        Whether the new faces, and nothing else, are selected afterwards.

    Returns
    -------
    dict
        ``bridged_pairs``, ``open_pairs``, ``new_vertices`` and ``new_faces`` (numbers), ``id`` (of the layer that is
        the mesh now), ``noise`` (standard deviation, a length, or None), ``lost_attributes``, ``textured``,
        ``topology_before`` and ``topology_after`` (as in `meshing_close_holes_by_bezier_patch`), ``warnings`` (texts:
        pairs that stay open), ``remarks`` (texts: why no holes were paired), ``seconds`` (read, fit, write), ``bands``,
        a dict for each pair as in the report of that filter, with ``pair``, its numbers, and ``holes``, a dict for each
        hole that there was, in the order of the numbers, with ``edge_count``, ``diameter``, ``center`` (of its
        vertices) and ``is_outer_rim``. It can be written as JSON.

    Examples
    --------
    >>> from pymeshlab import MeshSet
    >>> ms = MeshSet()
    >>> ms.create_sphere(radius=1.0, subdiv=4)
    >>> ms.compute_selection_by_condition_per_face(condselect="abs(z0) < 0.1")
    >>> ms.meshing_remove_selected_faces()
    >>> result = meshing_bridge_holes_by_bezier_patch(ms)
    >>> result["bridged_pairs"], result["bands"][0]["pair"], result["topology_after"]["components"]
    (1, [0, 1], 1)
    """
    begin = clock_without_compilation()
    mesh = read_current_mesh(ms)
    if not len(mesh.faces):
        raise BezierFilterError("the current mesh has no faces, so it has no holes")
    chosen = _read_pairs(pairs)
    start = clock_without_compilation()
    try:
        result = bridge_holes(
            mesh.vertices,
            mesh.faces,
            chosen,
            intersecting=intersecting,
            noise=absolute_length(noise, mesh.vertices, "noise"),
            threads=threads,
            progress=progress,
        )
    except (InvalidMeshError, InvalidParameterError) as error:
        raise BezierFilterError(str(error)) from error
    listed = fill_holes(mesh.vertices, mesh.faces, holes=[]).holes
    fitted = clock_without_compilation()
    check_unchanged(ms, mesh)
    lost_attributes, textured = list[str](), False
    if result.filled:
        with preserve_filter_script(ms):
            lost_attributes, textured = grow_mesh(ms, growth_of(mesh, result), select=newfaceselected)
    written = clock_without_compilation()
    before = topology_of(mesh.vertices, mesh.faces)
    after = topology_of(result.vertices, result.faces) if result.filled else before
    open_ = len(result.pairs) - result.filled
    no_pair = f"no two holes face each other across a gap of {MAX_GAP:g} edges at most; give the numbers of pairs"
    return {
        "bridged_pairs": result.filled,
        "open_pairs": open_,
        "new_vertices": len(result.vertices) - len(mesh.vertices),
        "new_faces": len(result.faces) - len(mesh.faces),
        "id": ms.current_mesh_id(),
        "noise": result.noise,
        "lost_attributes": lost_attributes,
        "textured": textured,
        "topology_before": dict(before.counts),
        "topology_after": dict(after.counts),
        "warnings": [f"{open_:,} of the pairs of holes, which could not be joined"] * bool(open_),
        "remarks": [*before.faults, *([] if result.pairs else [no_pair])],
        "bands": _describe_bands(result),
        "holes": [_describe_hole(mesh, hole) for hole in listed],
        "seconds": {"read": start - begin, "fit": fitted - start, "write": written - fitted},
    }


def _read_pairs(text: str) -> Pairs:
    """Parse ``"auto"``, or pairs of numbers such as ``"0 1, 2 3"``."""
    if text == "auto":
        return "auto"
    try:
        pairs = [tuple(map(int, pair.split())) for pair in text.split(",")]
    except ValueError:
        pairs = []
    if not pairs or any(len(pair) != 2 for pair in pairs):
        raise BezierFilterError(f"pairs: got {text!r}, expected auto, or pairs of numbers of holes such as '0 1, 2 3'")
    return [(pair[0], pair[1]) for pair in pairs]


def _describe_bands(result: BridgingResult) -> list[Report]:
    """Reports of the bands as dicts of plain values."""
    return [{"pair": list(pair)} | describe_report(hole) for pair, hole in zip(result.pairs, result.holes, strict=True)]


def _describe_hole(mesh: CurrentMesh, hole: HoleReport) -> Report:
    """How a hole can be found in the mesh."""
    return {
        "edge_count": hole.edge_count,
        "diameter": hole.diameter,
        "center": mesh.vertices[hole.rim].mean(axis=0).tolist(),
        "is_outer_rim": hole.is_outer_rim,
    }
