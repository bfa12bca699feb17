"""The filter on a pymeshlab MeshSet that replaces selected faces by the continuation of their surroundings."""

import re

import numpy as np

from bezier_filters.arrays import BoolArray, Report
from bezier_filters.errors import InvalidMeshError, InvalidParameterError
from bezier_filters.holes.fill_methods import FillingMethod
from bezier_filters.holes.selection_replacement import ReplacedPatch, replace_selection
from bezier_filters.meshlab.hole_filter import describe_report, growth_of
from bezier_filters.meshlab.mesh_attributes import add_attribute, read_attributes
from bezier_filters.meshlab.mesh_growth import grow_mesh
from bezier_filters.meshlab.meshset import (
    BezierFilterError,
    CurrentMesh,
    Length,
    MeshSet,
    PyMeshLabException,
    absolute_length,
    check_unchanged,
    checks_filter_arguments,
    current_mesh,
    preserve_filter_script,
    read_current_mesh,
    reason_of,
)
from bezier_filters.meshlab.topology import topology_of
from bezier_filters.parameters import complete_docstring
from bezier_filters.runtime.compile_time import clock_without_compilation
from bezier_filters.runtime.parallel import Progress


@checks_filter_arguments
@complete_docstring("replace")
def meshing_replace_selection_by_bezier_patch(
    ms: MeshSet,
    *,
    condselect: str | None = None,
    rings: int = 0,
    method: FillingMethod = "auto",
    intersecting: bool = False,
    creases: bool = True,
    noise: Length | None = None,
    newfaceselected: bool = False,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Report:
    """Replace the selected faces by the continuation of the surface around them.

    A bump, a scar, the mark of a support or embossed text is removed with its vertices, and the hole filled as by
    `meshing_close_holes_by_bezier_patch`; noise and sharp edges are learned from the rest of the mesh. See
    `bezier_filters.replace_selection`. If no face is selected, those are replaced whose vertices are all selected. A
    connected part of the selection is replaced completely, or stays as it is and is reported.

    The mesh becomes a new layer with the id ``result["id"]``, as by the filter that fills holes: what stays keeps its
    order, textures, colours, quality, selection and custom attributes, and new vertices and faces, after the old ones,
    continue them. Polygons become triangles. If nothing is replaced, nothing changes.

    Parameters
    ----------
    ms : pymeshlab.MeshSet
        Its current mesh must have faces.
    newfaceselected : bool
        Whether the new faces, and nothing else, are selected afterwards.

    Returns
    -------
    dict
        ``replaced_patches``, ``kept_patches``, ``removed_vertices``, ``removed_faces``, ``new_vertices`` and
        ``new_faces`` (numbers), ``removed_volume`` (of all patches), ``id`` (of the layer that is the mesh now),
        ``noise`` (standard deviation, a length, or None), ``lost_attributes``, ``textured``, ``topology_before`` and
        ``topology_after`` (as in `meshing_close_holes_by_bezier_patch`), ``warnings`` (texts: patches that stay),
        ``remarks`` (texts), ``seconds`` (read, fit, write) and ``patches``, a dict for each with ``replaced``,
        ``removed_volume`` (positive if material was removed), ``removed_height`` (the largest distance of an old vertex
        from the new patch, positive outside of it), ``area`` (of the new patch), ``old_faces`` (a number) and ``hole``,
        as in the report of that filter. It can be written as JSON.

    Examples
    --------
    >>> from pymeshlab import MeshSet
    >>> ms = MeshSet()
    >>> ms.create_sphere(radius=1.0, subdiv=4)
    >>> ms.compute_coord_by_function(x="x", y="y", z="z > 0.95 ? z + 0.1 : z")
    >>> ms.compute_selection_by_condition_per_face(condselect="max(z0, max(z1, z2)) > 0.95")
    >>> result = meshing_replace_selection_by_bezier_patch(ms)
    >>> result["replaced_patches"], round(result["patches"][0]["removed_height"], 2)
    (1, 0.1)
    """
    begin = clock_without_compilation()
    mesh = read_current_mesh(ms)
    if not len(mesh.faces):
        raise BezierFilterError("the current mesh has no faces, so none can be replaced")
    selected = _read_selection(mesh) if condselect is None else _faces_where(ms, condselect)
    start = clock_without_compilation()
    try:
        result = replace_selection(
            mesh.vertices,
            mesh.faces,
            selected,
            rings=rings,
            method=method,
            intersecting=intersecting,
            creases=creases,
            noise=absolute_length(noise, mesh.vertices, "noise"),
            threads=threads,
            progress=progress,
        )
    except (InvalidMeshError, InvalidParameterError) as error:
        raise BezierFilterError(re.sub("^selected", "condselect", str(error))) from error
    fitted = clock_without_compilation()
    check_unchanged(ms, mesh)
    lost_attributes, textured = list[str](), False
    if result.replaced:
        with preserve_filter_script(ms):
            lost_attributes, textured = grow_mesh(ms, growth_of(mesh, result), select=newfaceselected)
    written = clock_without_compilation()
    before = topology_of(mesh.vertices, mesh.faces)
    after = topology_of(result.vertices, result.faces) if result.replaced else before
    kept = [patch for patch in result.patches if not patch.replaced]
    return {
        "replaced_patches": result.replaced,
        "kept_patches": len(kept),
        "removed_vertices": len(mesh.vertices) - len(result.old_vertices),
        "removed_faces": len(mesh.faces) - len(result.old_faces),
        "new_vertices": len(result.vertices) - len(result.old_vertices),
        "new_faces": len(result.faces) - len(result.old_faces),
        "removed_volume": sum(patch.removed_volume for patch in result.patches),
        "id": ms.current_mesh_id(),
        "noise": result.noise,
        "lost_attributes": lost_attributes,
        "textured": textured,
        "topology_before": dict(before.counts),
        "topology_after": dict(after.counts),
        "warnings": [f"{len(kept):,} of the parts of the selection, which could not be replaced"] * bool(kept),
        "remarks": before.faults,
        "patches": [_describe_patch(patch) for patch in result.patches],
        "seconds": {"read": start - begin, "fit": fitted - start, "write": written - fitted},
    }


def _read_selection(mesh: CurrentMesh) -> BoolArray:
    """The selected faces (m,), or those whose vertices are all selected; refused if there are none."""
    if mesh.face_selection.any():
        return mesh.face_selection
    selected = mesh.vertex_selection[mesh.faces].all(axis=1)
    if not selected.any():
        raise BezierFilterError("no face is selected: select the faces to replace, or give their condition condselect")
    return np.asarray(selected)


def _faces_where(ms: MeshSet, condition: str) -> BoolArray:
    """Faces of the current mesh, (m,), that satisfy a condition of MeshLab, found on a copy."""
    wanted = ms.current_mesh_id()
    with preserve_filter_script(ms):
        attributes, _ = read_attributes(ms)
        ms.generate_copy_of_current_mesh()
        copy = ms.current_mesh_id()
        try:
            for attribute in attributes:
                add_attribute(current_mesh(ms), attribute)
            ms.compute_selection_by_condition_per_face(condselect=condition)
            selected = np.array(current_mesh(ms).face_selection_array(), dtype=np.bool_)
        except (PyMeshLabException, RuntimeError) as error:
            raise BezierFilterError(
                f"condselect: got {condition!r}, expected a condition on faces in MeshLab's syntax, such as "
                f"'z0 > 1 && z1 > 1 && z2 > 1'; {reason_of(error).removeprefix('Details: ')}"
            ) from error
        finally:
            ms.set_selection_none()  # after a filter that failed another must succeed, see `check_writable`
            ms.set_current_mesh(copy)
            ms.delete_current_mesh()
            ms.set_current_mesh(wanted)
    if not selected.any():
        raise BezierFilterError(f"condselect: no face satisfies {condition!r}")
    return selected


def _describe_patch(patch: ReplacedPatch) -> Report:
    """A report as a dict of plain values, with counts instead of lists."""
    return {
        "replaced": patch.replaced,
        "removed_volume": patch.removed_volume,
        "removed_height": patch.removed_height,
        "area": patch.area,
        "old_faces": len(patch.old_faces),
        "hole": describe_report(patch.hole),
    }
