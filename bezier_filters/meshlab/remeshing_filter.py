"""The filter on a pymeshlab MeshSet that makes a new mesh of regular triangles on the surface of the patches."""

import re

from bezier_filters.arrays import Report
from bezier_filters.errors import InvalidMeshError, InvalidParameterError
from bezier_filters.meshlab.derived_mesh import derive_by_remeshing, exchange_mesh, seam_edges
from bezier_filters.meshlab.meshset import (
    BezierFilterError,
    Length,
    MeshSet,
    absolute_length,
    check_unchanged,
    checks_filter_arguments,
    preserve_filter_script,
    read_current_mesh,
)
from bezier_filters.meshlab.subdivision_filter import read_face_selection
from bezier_filters.meshlab.topology import topology_of
from bezier_filters.parameters import complete_docstring
from bezier_filters.remeshing.remeshing import RemeshingResult, remesh
from bezier_filters.runtime.compile_time import clock_without_compilation
from bezier_filters.runtime.parallel import Progress


@checks_filter_arguments
@complete_docstring("remesh")
def meshing_remeshing_by_bezier_patch(
    ms: MeshSet,
    *,
    length: Length | None = None,
    vertexcount: int | None = None,
    tolerance: Length | None = None,
    iterations: int = 10,
    onselected: bool = False,
    noise: Length | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Report:
    """Make a new mesh of regular triangles whose vertices lie on the curved surface of the patches.

    Triangles are nearly equilateral, of one size, or smaller where the surface is curved. Sharp edges, borders, seams
    of textures and borders of the selection stay. See `bezier_filters.remesh`.

    The mesh becomes a new layer with the id ``result["id"]``. Colours, quality, texture coordinates and custom
    attributes of vertices are interpolated; faces have those of the old face below, and the selection stays in its
    place. Vertices without faces go. Polygons become triangles.

    Parameters
    ----------
    ms : pymeshlab.MeshSet
        Its current mesh must have faces.
    onselected : bool
        Remesh the selected faces only; if none is, those whose vertices all are.

    Returns
    -------
    dict
        ``old_vertices``, ``vertices``, ``old_faces`` and ``faces`` (numbers before and after), ``chord_error`` (largest
        distance of the midpoint of a new edge from the surface, a length), ``id`` (of the layer that is the mesh now),
        ``noise`` (standard deviation, a length, or None), ``lost_attributes``, ``textured``, ``topology_before`` and
        ``topology_after`` (as in `meshing_close_holes_by_bezier_patch`), ``warnings``, ``remarks`` (texts) and
        ``seconds`` (read, fit, write). It can be written as JSON.

    Examples
    --------
    >>> from pymeshlab import MeshSet
    >>> ms = MeshSet()
    >>> ms.create_sphere(radius=1.0, subdiv=4)
    >>> result = meshing_remeshing_by_bezier_patch(ms, vertexcount=1000)
    >>> bool(abs(result["vertices"] - 1000) < 30), result["topology_after"]["two_manifold"]
    (True, True)
    """
    begin = clock_without_compilation()
    mesh = read_current_mesh(ms)
    if not len(mesh.faces):
        raise BezierFilterError("the current mesh has no faces, so it cannot be remeshed")
    selected = read_face_selection(mesh) if onselected else None
    start = clock_without_compilation()
    try:
        result = remesh(
            mesh.vertices,
            mesh.faces,
            length=absolute_length(length, mesh.vertices, "length"),
            vertex_count=vertexcount,
            tolerance=absolute_length(tolerance, mesh.vertices, "tolerance"),
            selected=selected,
            edges=seam_edges(ms, mesh),
            iterations=iterations,
            noise=absolute_length(noise, mesh.vertices, "noise"),
            threads=threads,
            progress=progress,
        )
    except (InvalidMeshError, InvalidParameterError) as error:
        raise BezierFilterError(re.sub("^vertex_count", "vertexcount", str(error))) from error
    fitted = clock_without_compilation()
    # before the MeshSet changes, as the result may be refused
    before, after = topology_of(mesh.vertices, mesh.faces), topology_of(result.vertices, result.faces)
    check_unchanged(ms, mesh)
    with preserve_filter_script(ms):
        lost_attributes, textured = exchange_mesh(ms, derive_by_remeshing(mesh, result))
    written = clock_without_compilation()
    return {
        "old_vertices": len(mesh.vertices),
        "vertices": len(result.vertices),
        "old_faces": len(mesh.faces),
        "faces": len(result.faces),
        "chord_error": result.chord_error,
        "id": ms.current_mesh_id(),
        "noise": result.noise,
        "lost_attributes": lost_attributes,
        "textured": textured,
        "topology_before": dict(before.counts),
        "topology_after": dict(after.counts),
        "warnings": [],
        "remarks": [*before.faults, *([] if result.has_requested_vertices else [_few_vertices(vertexcount, result)])],
        "seconds": {"read": start - begin, "fit": fitted - start, "write": written - fitted},
    }


def _few_vertices(wanted: int | None, result: RemeshingResult) -> str:
    return (
        f"vertexcount: {wanted:,} vertices were asked for, and the mesh has {len(result.vertices):,}: larger triangles "
        "would not follow the surface, or its sharp edges and borders"
    )
