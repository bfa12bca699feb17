"""The filter that measures the surface of the current mesh, and of its parts."""

from dataclasses import asdict

import numpy as np

from bezier_filters.arrays import IntArray, Report
from bezier_filters.errors import InvalidMeshError, InvalidParameterError
from bezier_filters.fields import MEASURES
from bezier_filters.inspection.measures import REPEATS, measure
from bezier_filters.meshlab.mesh_attributes import custom_attribute
from bezier_filters.meshlab.meshset import (
    BezierFilterError,
    CurrentMesh,
    Length,
    MeshSet,
    absolute_length,
    check_unchanged,
    checks_filter_arguments,
    current_mesh,
    read_current_mesh,
)
from bezier_filters.parameters import complete_docstring
from bezier_filters.runtime.compile_time import clock_without_compilation
from bezier_filters.runtime.parallel import Progress

FACE_SCALARS = "__ca_fs__"  # kind of the custom attributes of faces
QUALITY_LABELS = "quality"


@checks_filter_arguments
@complete_docstring(MEASURES)
def get_surface_measures_by_bezier_patch(
    ms: MeshSet,
    *,
    labels: str | None = None,
    onselected: bool = False,
    noise: Length | None = None,
    repeats: int = REPEATS,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Report:
    """Measure area, volume, total curvatures and bending energies of the current mesh, with standard errors.

    Integrals are over the surface of the Bezier patches, not over flat triangles; see `bezier_filters.measure`. Nothing
    in the MeshSet changes.

    Parameters
    ----------
    ms : pymeshlab.MeshSet
        Its current mesh must have faces.
    onselected : bool
        Measure the selected faces and the others by themselves, too.

    Returns
    -------
    dict
        ``whole`` and ``parts`` (a dict for each label, in ascending order; label 1 is the selection): ``label``,
        ``values``, ``std`` and ``bias`` (dicts: ``area``, ``volume``, or None unless closed, ``total_mean_curvature``,
        ``total_gaussian_curvature``, ``willmore_energy``, ``bending_energy``), ``euler_characteristic``, ``turning``
        and ``gauss_bonnet_error`` (see `PartMeasures`); ``repeats``, ``noise`` (a length, or None),
        ``faces_without_surface`` (number), ``warnings``, ``remarks`` (texts) and ``seconds`` (measure). It can be
        written as JSON.

    Examples
    --------
    >>> from pymeshlab import MeshSet
    >>> ms = MeshSet()
    >>> ms.create_sphere(radius=1.0, subdiv=4)
    >>> report = get_surface_measures_by_bezier_patch(ms, repeats=0)
    >>> round(report["whole"]["values"]["area"] / np.pi, 5), report["whole"]["euler_characteristic"]
    (4.0, 2)
    """
    mesh = read_current_mesh(ms)
    if labels is not None and onselected:
        raise BezierFilterError("labels: there is a selection to be measured, too; choose one of them")
    of_faces = _selection(mesh) if onselected else None
    of_vertices = None
    if labels is not None:
        of_faces, of_vertices = _read_labels(ms, labels)
    begin = clock_without_compilation()
    try:
        found = measure(
            mesh.vertices,
            mesh.faces,
            face_labels=of_faces,
            vertex_labels=of_vertices,
            noise=absolute_length(noise, mesh.vertices, "noise"),
            repeats=repeats,
            threads=threads,
            progress=progress,
        )
    except (InvalidMeshError, InvalidParameterError) as error:
        raise BezierFilterError(str(error)) from error
    check_unchanged(ms, mesh)
    remarks = []
    if found.noise is None:
        remarks.append("the noise could not be learned, so that there are no standard errors")
    if found.faces_without_surface:
        remarks.append(
            f"{found.faces_without_surface:,} of {len(mesh.faces):,} faces have places without patches, which count as "
            "flat"
        )
    return {
        "whole": asdict(found.whole),
        "parts": [asdict(part) for part in found.parts],
        "repeats": found.repeats,
        "noise": found.noise,
        "faces_without_surface": found.faces_without_surface,
        "warnings": [],
        "remarks": remarks,
        "seconds": {"measure": clock_without_compilation() - begin},
    }


def _selection(mesh: CurrentMesh) -> IntArray:
    """Label 1 for the selected faces, or, if there are none, for those between selected vertices."""
    selected = mesh.face_selection
    if not selected.any():
        selected = np.asarray(mesh.selection_mask()[mesh.faces].all(axis=1), dtype=np.bool_)
    return selected.astype(np.int32)


def _read_labels(ms: MeshSet, name: str) -> tuple[IntArray | None, IntArray | None]:
    """Labels of faces, or of vertices, from a custom attribute or the quality of the vertices."""
    mesh = current_mesh(ms)
    of_faces = custom_attribute(mesh, name, FACE_SCALARS)
    of_vertices = custom_attribute(mesh, name)
    if name == QUALITY_LABELS and of_faces is None and of_vertices is None and mesh.has_vertex_scalar():
        of_vertices = np.array(mesh.vertex_scalar_array())
    values = of_vertices if of_faces is None else of_faces
    if values is None:
        raise BezierFilterError(f"labels: the mesh has no scalar attribute {name!r} of faces or vertices")
    if not (np.isfinite(values) & (values == np.round(values))).all():
        raise BezierFilterError(f"labels: the values of {name!r} are not all integers")
    numbers = values.astype(np.int32)
    return (None, numbers) if of_faces is None else (numbers, None)
