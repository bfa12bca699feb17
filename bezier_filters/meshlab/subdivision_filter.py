"""The filter on a pymeshlab MeshSet that subdivides a mesh on the surface of its patches."""

import re

import numpy as np

from bezier_filters.arrays import BoolArray, Report
from bezier_filters.errors import InvalidMeshError, InvalidParameterError
from bezier_filters.meshlab.derived_mesh import derive_by_subdivision, exchange_mesh
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
from bezier_filters.remeshing.subdivision import subdivide
from bezier_filters.runtime.compile_time import clock_without_compilation
from bezier_filters.runtime.parallel import Progress


@checks_filter_arguments
@complete_docstring("subdivide")
def meshing_surface_subdivision_by_bezier_patch(
    ms: MeshSet,
    *,
    iterations: int | None = None,
    tolerance: Length | None = None,
    onselected: bool = False,
    move: bool | None = None,
    noise: Length | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Report:
    """Make the current mesh finer, with new vertices on the curved surface of its patches.

    Every face becomes four, or only edges are split that are farther from the surface than a tolerance. Sharp edges
    stay sharp, and the surface is free of noise. See `bezier_filters.subdivide`.

    The mesh becomes a new layer with the id ``result["id"]``. Old vertices come first, in their order. Colours,
    quality, texture coordinates and custom attributes are interpolated; faces have those of the old face, and the
    selection stays. Polygons become triangles.

    Parameters
    ----------
    ms : pymeshlab.MeshSet
        Its current mesh must have faces.
    onselected : bool
        Subdivide the selected faces only, and divide their neighbours; if none is, the faces whose vertices all are.

    Returns
    -------
    dict
        ``old_vertices``, ``vertices``, ``old_faces`` and ``faces`` (numbers before and after), ``flat_vertices``
        (number of vertices on old faces, for want of a surface), ``unresolved_faces`` (number of old faces where splits
        do not bring edges within the tolerance), ``moved`` (whether old vertices moved),
        ``chord_error`` (largest distance of the midpoint of an edge from the surface, a length, or None without a
        tolerance), ``id`` (of the layer that is the mesh now), ``noise`` (standard deviation, a length, or None),
        ``lost_attributes``, ``textured``, ``topology_before`` and ``topology_after`` (as in
        `meshing_close_holes_by_bezier_patch`), ``warnings``, ``remarks`` (texts) and ``seconds`` (read, fit, write). It
        can be written as JSON.

    Examples
    --------
    >>> from pymeshlab import MeshSet
    >>> ms = MeshSet()
    >>> ms.create_sphere(radius=1.0, subdiv=3)
    >>> result = meshing_surface_subdivision_by_bezier_patch(ms)
    >>> result["old_vertices"], result["vertices"]
    (642, 2562)
    """
    begin = clock_without_compilation()
    mesh = read_current_mesh(ms)
    if not len(mesh.faces):
        raise BezierFilterError("the current mesh has no faces, so it cannot be subdivided")
    selected = read_face_selection(mesh) if onselected else None
    start = clock_without_compilation()
    try:
        result = subdivide(
            mesh.vertices,
            mesh.faces,
            iterations=iterations,
            tolerance=absolute_length(tolerance, mesh.vertices, "tolerance"),
            selected=selected,
            move=move,
            noise=absolute_length(noise, mesh.vertices, "noise"),
            threads=threads,
            progress=progress,
        )
    except (InvalidMeshError, InvalidParameterError) as error:
        raise BezierFilterError(re.sub("^selected", "onselected", str(error))) from error
    fitted = clock_without_compilation()
    # before the MeshSet changes, as the result may be refused
    before, after = topology_of(mesh.vertices, mesh.faces), topology_of(result.vertices, result.faces)
    check_unchanged(ms, mesh)
    with preserve_filter_script(ms):
        lost_attributes, textured = exchange_mesh(ms, derive_by_subdivision(mesh, result))
    written = clock_without_compilation()
    flat, rough = len(result.flat_vertices), len(result.unresolved_faces)
    remarks = [] if not flat else [f"{flat:,} vertices lie on old faces, for want of a surface"]
    if rough:
        remarks.append(
            f"edges of {rough:,} old faces stay farther from the surface than the tolerance: it has steps there, as "
            "strong noise makes; smooth the mesh first"
        )
    return {
        "old_vertices": len(mesh.vertices),
        "vertices": len(result.vertices),
        "old_faces": len(mesh.faces),
        "faces": len(result.faces),
        "flat_vertices": flat,
        "unresolved_faces": rough,
        "moved": result.moved,
        "chord_error": result.chord_error,
        "id": ms.current_mesh_id(),
        "noise": result.noise,
        "lost_attributes": lost_attributes,
        "textured": textured,
        "topology_before": dict(before.counts),
        "topology_after": dict(after.counts),
        "warnings": [],
        "remarks": [*before.faults, *remarks],
        "seconds": {"read": start - begin, "fit": fitted - start, "write": written - fitted},
    }


def read_face_selection(mesh: CurrentMesh) -> BoolArray:
    """The selected faces (m,), or those whose vertices are all selected; refused if there are none."""
    selected = mesh.face_selection if mesh.face_selection.any() else mesh.vertex_selection[mesh.faces].all(axis=1)
    if not selected.any():
        raise BezierFilterError(
            "onselected: no face is selected. Select vertices or faces first, or pass onselected=False."
        )
    return np.asarray(selected)
