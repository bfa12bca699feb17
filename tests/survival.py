"""What must hold for every function on any mesh: a finite result whose status tells the truth, or a clear error.

`CHECKS` are functions of vertices and faces that raise AssertionError if it does not.
"""

from dataclasses import fields

import numpy as np
import pymeshlab
from meshset_state import changed, mesh_state

from bezier_filters import estimate_vertex_geometry, fill_holes, smooth
from bezier_filters.errors import InvalidMeshError, InvalidParameterError
from bezier_filters.mesh import LARGEST, SMALLEST
from bezier_filters.meshset import BezierFilterError
from bezier_filters.registration import FILTERS
from bezier_filters.status import FitStatus

ESTIMATES = {
    "automatic": {},
    "fixed": {"rings": 2, "alpha": 0.8},
    "paper": {"smoothness": "paper"},
    "radius": {"radius": 0.5},
    "robust": {"robust": True},
}
WITHOUT_ESTIMATE = [FitStatus.NORMAL_ONLY, FitStatus.ISOLATED, FitStatus.SKIPPED]


def attempt(function, *arguments, **options):
    """A result and no message, or no result and the message of an error that tells what is wrong."""
    try:
        return function(*arguments, **options), ""
    except (InvalidMeshError, InvalidParameterError, BezierFilterError) as error:
        return None, str(error)


def are_sound(vertices):
    largest = np.abs(vertices).max(initial=0.0)
    return bool(np.isfinite(vertices).all() and (largest == 0.0 or SMALLEST <= largest <= LARGEST))


def check_estimate(vertices, faces, mode):
    geometry, refusal = attempt(estimate_vertex_geometry, vertices, faces, **ESTIMATES[mode])
    if geometry is None:
        assert not are_sound(vertices), refusal
        return
    for field in fields(geometry):
        values = getattr(geometry, field.name)
        if isinstance(values, np.ndarray):
            assert np.isfinite(values).all(), field.name
    lengths = np.linalg.norm(geometry.normals, axis=1)
    has_normal = ~np.isin(geometry.status, [FitStatus.ISOLATED, FitStatus.SKIPPED])
    np.testing.assert_allclose(lengths, has_normal.astype(float), atol=1e-9)
    nothing = np.isin(geometry.status, WITHOUT_ESTIMATE)
    assert not geometry.k_min[nothing].any()
    assert not geometry.k_max[nothing].any()
    assert (geometry.k_min <= geometry.k_max).all()


def check_smoothing(vertices, faces, method):
    result, refusal = attempt(smooth, vertices, faces, method)
    if result is None:
        assert not are_sound(vertices), refusal
        return
    assert np.isfinite(result.vertices).all()
    assert result.vertices.shape == vertices.shape
    assert np.isfinite(result.displacement).all()
    if method == "auto":
        assert result.new_bad_faces == 0


def check_holes(vertices, faces, method):
    result, refusal = attempt(fill_holes, vertices, faces, method)
    if result is None:
        assert "faces:" in refusal or not are_sound(vertices), refusal
        return
    assert np.isfinite(result.vertices).all()
    np.testing.assert_array_equal(result.vertices[: len(vertices)], np.asarray(vertices, dtype=float))
    np.testing.assert_array_equal(result.faces[: len(faces)], faces)
    assert all(hole.filled or hole.reason for hole in result.holes)


def check_filter(vertices, faces, function):
    ms = meshset_with(vertices, faces)
    before = mesh_state(ms)
    report, _ = attempt(function, ms)
    if report is None:
        assert changed(before, mesh_state(ms)) == set()
        return
    mesh = ms.current_mesh()
    assert np.isfinite(mesh.vertex_matrix()).all()
    if mesh.has_vertex_scalar():
        assert np.isfinite(mesh.vertex_scalar_array()).all()
    for attribute in report.get("attributes", []):
        assert np.isfinite(mesh.vertex_custom_scalar_attribute_array(attribute)).all()


def meshset_with(vertices, faces):
    """A MeshSet with one mesh, which may be empty."""
    ms = pymeshlab.MeshSet()
    if len(vertices):
        ms.add_mesh(pymeshlab.Mesh(*(np.asarray(part) for part in (vertices.astype(float), faces) if len(part))))
        return ms
    ms.create_cube()  # there is no other way to a mesh without vertices
    ms.compute_selection_by_condition_per_vertex(condselect="1")
    ms.meshing_remove_selected_vertices()
    return ms


def _check(function, argument):
    return lambda vertices, faces: function(vertices, faces, argument)


CHECKS = {f"estimate, {mode}": _check(check_estimate, mode) for mode in ESTIMATES}
CHECKS |= {f"smooth, {method}": _check(check_smoothing, method) for method in ("auto", "paper")}
CHECKS |= {f"fill_holes, {method}": _check(check_holes, method) for method in ("auto", "paper")}
CHECKS |= {function.__name__: _check(check_filter, function) for function in FILTERS}
