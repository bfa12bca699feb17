"""What must hold for every function on any mesh: a finite result whose status tells the truth, or a clear error.

`CHECKS` are functions of vertices and faces that raise AssertionError if it does not.
"""

from collections import Counter
from dataclasses import fields, replace

import numpy as np
import pymeshlab
from filter_options import GIVEN_FIT, QUICK_OPTIONS, WITHOUT_NOISE
from meshset_state import changed, mesh_state
from naive_reference import expected_fit, largest_curvature

from baselines import ouyang_feng_normals, razdan_bae
from bezier_filters import (
    boundary_loops,
    diagnose,
    estimate_vertex_geometry,
    fill_holes,
    find_creases,
    inspect_mesh,
    smooth,
    triangle_mesh,
    vertex_adjacency,
    vertex_patch,
)
from bezier_filters.errors import InvalidMeshError, InvalidParameterError
from bezier_filters.fitting.outlier_removal import move_outliers
from bezier_filters.kernels.kernel_input import prepare_kernel_mesh
from bezier_filters.meshes.mesh import MAX_COORDINATE, MIN_COORDINATE
from bezier_filters.meshlab.meshset import BezierFilterError
from bezier_filters.meshlab.scripts import FILTERS
from bezier_filters.smoothing.flipped_faces import NEW_BAD_FACE_WEIGHT
from bezier_filters.status import FitStatus

ESTIMATES = {
    "automatic": {},
    "fixed": GIVEN_FIT,
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
    return bool(np.isfinite(vertices).all() and (largest == 0.0 or MIN_COORDINATE <= largest <= MAX_COORDINATE))


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
    if len(faces):
        mesh = triangle_mesh(vertices, faces)
        check_curvatures(meshes_fitted(mesh, geometry, mode), geometry)
    if mode == "fixed" and len(faces):
        check_statuses(np.asarray(vertices, dtype=float), np.asarray(faces), geometry)


def meshes_fitted(mesh, geometry, mode):
    """The meshes that the fits may be of: where an outlier comes back, faces are lower and hold more.

    A share of outliers is learned only with a noise; neither is learned where the fit is given.
    """
    if geometry.fit.noise_sigma is None:
        return [mesh]
    arrays = prepare_kernel_mesh(mesh, with_barriers=True)
    cleaned = replace(mesh, vertices=move_outliers(arrays).vertices)
    return [cleaned] if mode == "robust" else [mesh, cleaned]


def check_curvatures(meshes, geometry):
    """No curvature, nor its standard error, exceeds what the faces at a vertex can hold."""
    a, b, c = meshes[0].faces.T
    proper = meshes[0].faces[(a != b) & (b != c) & (c != a)]
    for vertex in range(0, meshes[0].vertex_count, 1 + meshes[0].vertex_count // 50):
        sizes = [-geometry.k_min[vertex], geometry.k_max[vertex], geometry.mean_curvature_std[vertex]]
        largest = max(largest_curvature(mesh.vertices, proper, vertex) for mesh in meshes)
        assert max(sizes) <= 1.000001 * largest, vertex


def check_statuses(vertices, faces, geometry):
    """A few vertices of every status, looked at once more."""
    statuses = {int(status) for status in geometry.status}
    for vertex in (
        v for status in statuses for v in np.flatnonzero(geometry.status == status)[:: 1 + len(vertices) // 4]
    ):
        status, other = FitStatus(geometry.status[vertex]), expected_fit(vertices, faces, int(vertex))
        assert other.isolated in (None, status == FitStatus.ISOLATED), (vertex, status)
        assert other.fits in (None, status == FitStatus.OK), (vertex, status)
        if other.fits and other.tolerance * np.ptp(vertices, axis=0).max() < 1e-3:
            assert abs(geometry.mean_curvature[vertex] - other.curvature) <= other.tolerance, (vertex, other)
            np.testing.assert_allclose(geometry.normals[vertex], other.normal, atol=1e-5)


def check_smoothing(vertices, faces, method):
    result, refusal = attempt(smooth, vertices, faces, method, **(GIVEN_FIT if method == "paper" else {}))
    if result is None:
        assert not are_sound(vertices), refusal
        return
    assert np.isfinite(result.vertices).all()
    assert result.vertices.shape == vertices.shape
    assert np.isfinite(result.displacement).all()
    if method == "auto":
        # A face that becomes wrong is paid for by more that are mended.
        before, after = result.flipped_before + result.degenerate_before, result.flipped_after + result.degenerate_after
        assert after + NEW_BAD_FACE_WEIGHT * result.new_bad_faces <= before


def check_holes(vertices, faces, method):
    result, refusal = attempt(fill_holes, vertices, faces, method)
    if result is None:
        assert not are_sound(vertices), refusal
        return
    assert np.isfinite(result.vertices).all()
    np.testing.assert_array_equal(result.vertices[: len(vertices)], np.asarray(vertices, dtype=float))
    np.testing.assert_array_equal(result.faces[: len(faces)], faces)
    assert all(hole.filled or hole.reason for hole in result.holes)


def check_topology(vertices, faces):
    """Border, adjacency and the report of a mesh, with a second count of its edges."""
    mesh, refusal = attempt(triangle_mesh, vertices, faces)
    if mesh is None:
        assert not are_sound(vertices), refusal
        return
    report = inspect_mesh(mesh)
    proper = [face for face in mesh.faces.tolist() if len(set(face)) == 3]
    edges = Counter(frozenset(pair) for a, b, c in proper for pair in ((a, b), (b, c), (c, a)))
    assert report.boundary_edges == sum(count == 1 for count in edges.values())
    assert report.non_manifold_edges == sum(count > 2 for count in edges.values())
    assert report.unreferenced_vertices == mesh.vertex_count - len(set(mesh.faces.ravel().tolist()))
    assert all(isinstance(line, str) for line in diagnose(mesh, report))
    loops = boundary_loops(mesh)
    for loop in loops:
        assert all(edges[frozenset(pair)] == 1 for pair in zip(loop.tolist(), np.roll(loop, -1).tolist(), strict=True))
    neighbours = vertex_adjacency(mesh).vertices
    for vertex in range(0, mesh.vertex_count, 1 + mesh.vertex_count // 8):
        found = {other for edge in edges if vertex in edge for other in edge} - {vertex}
        assert set(neighbours.row(vertex).tolist()) == found


def check_one_patch(vertices, faces):
    """The patch at a vertex: finite, or a clear refusal."""
    for vertex in range(0, len(vertices), 1 + len(vertices) // 4):
        patch, refusal = attempt(vertex_patch, vertices, faces, vertex)
        assert refusal or np.isfinite(patch.control_net).all()


def check_baselines(vertices, faces):
    for function in (razdan_bae, ouyang_feng_normals):
        result, refusal = attempt(function, vertices, faces)
        if result is None:
            assert not are_sound(vertices), refusal
            continue
        parts = (
            [result] if isinstance(result, np.ndarray) else [getattr(result, field.name) for field in fields(result)]
        )
        assert all(np.isfinite(part).all() for part in parts if isinstance(part, np.ndarray))


def check_creases(vertices, faces):
    creases, refusal = attempt(find_creases, vertices, faces)
    if creases is None:
        assert not len(faces) or not are_sound(vertices), refusal
        return
    for line in creases.lines:
        assert np.isfinite(line.strength)
        assert np.isfinite(line.points).all()
        assert line.edges.max() < len(vertices)
        rounding = 1e-15 * np.abs(vertices).max(axis=0)
        assert (line.points >= vertices.min(axis=0) - rounding).all()
        assert (line.points <= vertices.max(axis=0) + rounding).all()


def check_filter(vertices, faces, function, options):
    ms = meshset_with(vertices, faces)
    before = mesh_state(ms)
    report, _ = attempt(function, ms, **options)
    if report is None:
        assert changed(before, mesh_state(ms)) == set()
        return
    mesh = ms.current_mesh()
    assert np.isfinite(mesh.vertex_matrix()).all()
    if mesh.has_vertex_scalar():
        assert np.isfinite(mesh.vertex_scalar_array()).all()
    for attribute in report.get("attributes", []):
        assert np.isfinite(mesh.vertex_custom_scalar_attribute_array(attribute)).all()


def check_refusal(vertices, faces, name):
    """Rows that no mesh has are refused by every function, which names their array and leaves both as they were."""
    before = vertices.copy(), faces.copy()
    for function in REFUSING:
        result, refusal = attempt(function, vertices, faces)
        assert result is None, function.__name__
        assert refusal.startswith(f"{name}: "), refusal
    for old, new in zip(before, (vertices, faces), strict=True):
        np.testing.assert_array_equal(old, new)


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


def _check(function, *arguments):
    return lambda vertices, faces: function(vertices, faces, *arguments)


REFUSING = (
    triangle_mesh,
    inspect_mesh,
    boundary_loops,
    vertex_adjacency,
    estimate_vertex_geometry,
    smooth,
    fill_holes,
    find_creases,
    razdan_bae,
    ouyang_feng_normals,
)
CHECKS = {f"estimate, {mode}": _check(check_estimate, mode) for mode in ESTIMATES}
CHECKS |= {f"smooth, {method}": _check(check_smoothing, method) for method in ("auto", "paper")}
CHECKS |= {f"fill_holes, {method}": _check(check_holes, method) for method in ("auto", "paper")}
CHECKS |= {"topology": check_topology, "vertex_patch": check_one_patch, "baselines": check_baselines}
CHECKS |= {"find_creases": check_creases}
# The filters choose fits and noise alike: these do, as do the functions above, that of smoothing among them.
OPTIONS = QUICK_OPTIONS | {
    "apply_coord_bezier_patch_smoothing": WITHOUT_NOISE,
    "compute_curvature_by_bezier_patch_per_vertex": {},
    "compute_selection_by_bezier_crease_per_edge": {},
    "get_surface_measures_by_bezier_patch": {"repeats": 2},
}
CHECKS |= {function.__name__: _check(check_filter, function, OPTIONS[function.__name__]) for function in FILTERS}
