"""Smoothing a MeshSet: what changes, what stays, what is refused."""

import json

import numpy as np
import pymeshlab
import pytest
from meshset_state import changed, mesh_state
from vertex_filter_cases import array

from bezier_filters.errors import CancelledError
from bezier_filters.meshlab.meshset import BezierFilterError
from bezier_filters.meshlab.vertex_filters import apply_coord_bezier_patch_smoothing
from bezier_filters.smoothing.smooth import smooth
from bezier_filters.surfaces import sphere, torus

COLUMNS = {"bz_displacement", "bz_sharpness"}


@pytest.fixture
def noisy():
    """A noisy torus, with another layer and everything set that could get lost."""
    surface = torus(resolution=16, jitter=0.3)
    heights = 0.01 * np.random.default_rng(0).standard_normal(len(surface.vertices))
    ms = pymeshlab.MeshSet()
    ms.add_mesh(pymeshlab.Mesh(surface.vertices + heights[:, None] * surface.normals, surface.faces), "ring")
    ms.create_cube()
    ms.set_current_mesh(0)
    ms.compute_scalar_by_function_per_vertex(q="x")
    ms.compute_color_by_function_per_vertex(x="vi * 0.05", y="7", z="9")
    ms.compute_selection_by_condition_per_vertex(condselect="x > 0.5")
    ms.compute_selection_by_condition_per_face(condselect="fi < 300")
    ms.set_matrix(transformmatrix=np.diag([2.0, 2.0, 2.0, 1.0]), freeze=False)
    ms.set_mesh_visibility(0, False)
    ms.current_mesh().add_vertex_custom_scalar_attribute(np.arange(ms.current_mesh().vertex_number()), "mine")
    return ms


def arrays(ms):
    mesh = ms.current_mesh()
    return mesh.vertex_matrix(), mesh.face_matrix()


@pytest.mark.parametrize("options", [{}, {"method": "paper"}, {"method": "paper", "iterations": 2, "rings": 3}])
def test_coordinates_are_those_of_the_array_function_bit_for_bit(noisy, options):
    expected = smooth(*arrays(noisy), **options)
    apply_coord_bezier_patch_smoothing(noisy, **options)
    np.testing.assert_array_equal(noisy.current_mesh().vertex_matrix(), expected.vertices)
    np.testing.assert_array_equal(array(noisy, "bz_displacement"), expected.displacement)
    np.testing.assert_array_equal(array(noisy, "bz_sharpness"), expected.sharpness)


def test_nothing_else_changes(noisy):
    before = mesh_state(noisy)
    apply_coord_bezier_patch_smoothing(noisy)
    geometry = {"vertex_matrix", "vertex_normal_matrix", "face_normal_matrix", "bounding_box"}
    assert changed(before, mesh_state(noisy)) == {f"0: {name}" for name in geometry | COLUMNS}
    before = mesh_state(noisy)
    apply_coord_bezier_patch_smoothing(noisy, quality="displacement", color=True)
    news = geometry | COLUMNS | {"vertex_scalar_array", "vertex_color_matrix", "outlierScore"}
    assert changed(before, mesh_state(noisy)) <= {f"0: {name}" for name in news}


def test_normals_are_unit_normals_of_the_new_faces(noisy):
    apply_coord_bezier_patch_smoothing(noisy)
    normals = noisy.current_mesh().vertex_normal_matrix()
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)
    vertices = noisy.current_mesh().vertex_matrix()
    around = np.hypot(vertices[:, 0], vertices[:, 1])[:, None]
    outside = vertices - vertices * [1, 1, 0] / around
    assert np.einsum("ij,ij->i", normals, outside / np.linalg.norm(outside, axis=1)[:, None]).min() > 0.95


def test_only_the_selection_moves(noisy):
    vertices, _ = arrays(noisy)
    selected = noisy.current_mesh().vertex_selection_array()
    report = apply_coord_bezier_patch_smoothing(noisy, onselected=True, quality="displacement")
    moved = (noisy.current_mesh().vertex_matrix() != vertices).any(axis=1)
    assert report["moved"] == moved.sum() > 0
    assert not moved[~selected].any()
    np.testing.assert_array_equal(noisy.current_mesh().vertex_scalar_array()[~selected], vertices[~selected, 0])


def test_report(noisy):
    report = apply_coord_bezier_patch_smoothing(noisy, quality="displacement", color=True)
    assert json.loads(json.dumps(report)) == report
    assert report["noise_before"] == pytest.approx(0.01, rel=0.2)
    assert report["noise_after"] < 0.5 * report["noise_before"]  # what filters leave is correlated, and seen as such
    assert report["volume_ratio"] == pytest.approx(1.0, abs=1e-3)
    assert report["statistics"]["max"] == report["displacement"]["max"]
    displacement = array(noisy, "bz_displacement")
    assert report["displacement"]["rms"] == pytest.approx(np.sqrt(np.mean(displacement**2)))
    assert report["displacement"]["mean"] == pytest.approx(displacement.mean())
    assert set(report["attributes"]) == COLUMNS
    assert report["unit"] == "length"


def test_a_noise_in_percent_is_one_of_the_diagonal(noisy):
    vertices, faces = arrays(noisy)
    expected = smooth(vertices, faces, noise=0.002 * np.linalg.norm(np.ptp(vertices, axis=0)))
    apply_coord_bezier_patch_smoothing(noisy, noise=pymeshlab.PercentageValue(0.2))
    np.testing.assert_allclose(noisy.current_mesh().vertex_matrix(), expected.vertices, atol=1e-7)


def test_textures_and_seams_stay(textured_bunny):
    before = mesh_state(textured_bunny)
    apply_coord_bezier_patch_smoothing(textured_bunny, noise=0.1)
    geometry = {"vertex_matrix", "vertex_normal_matrix", "face_normal_matrix", "bounding_box"}
    assert changed(before, mesh_state(textured_bunny)) <= {f"0: {name}" for name in geometry | COLUMNS}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"method": "taubin"}, "method: got 'taubin', expected 'auto' or 'paper'"),
        ({"iterations": 0}, "iterations: got 0"),
        ({"noise": -1.0}, "noise: got -1.0"),
        ({"borders": "none"}, "borders: got 'none'"),
        ({"method": "paper", "alpha": 2.0}, "alpha: got 2.0"),
        ({"quality": "mean"}, "quality: got 'mean', expected 'displacement', 'sharpness' or None"),
        ({"color": True}, "color: there is no quality"),
        ({"threads": 0}, "threads: got 0"),
    ],
)
def test_parameters_are_refused_and_all_stays(noisy, options, message):
    before = mesh_state(noisy)
    with pytest.raises(BezierFilterError, match=message):
        apply_coord_bezier_patch_smoothing(noisy, **options)
    assert changed(before, mesh_state(noisy)) == set()


def test_a_point_cloud_is_smoothed_and_stays_a_cloud():
    ball = sphere(resolution=10)
    rng = np.random.default_rng(0)
    ms = pymeshlab.MeshSet()
    ms.add_mesh(pymeshlab.Mesh((1.0 + 0.01 * rng.standard_normal((len(ball.vertices), 1))) * ball.vertices))
    before = np.linalg.norm(ms.current_mesh().vertex_matrix(), axis=1).std()
    apply_coord_bezier_patch_smoothing(ms)
    assert ms.current_mesh().face_number() == 0
    assert np.linalg.norm(ms.current_mesh().vertex_matrix(), axis=1).std() < 0.4 * before


def test_cancelling_leaves_all_as_it_was(noisy):
    before = mesh_state(noisy)
    with pytest.raises(CancelledError):
        apply_coord_bezier_patch_smoothing(noisy, progress=lambda done, total: False)
    assert changed(before, mesh_state(noisy)) == set()


@pytest.mark.parametrize("when", ["compute_coord_linear_morphing", "compute_normal_per_vertex"])
def test_an_interrupt_while_writing_is_undone(when):
    class Interrupted(pymeshlab.MeshSet):
        armed = False

        def interrupt(self, **options):
            getattr(pymeshlab.MeshSet, when)(self, **options)
            if self.armed:
                self.armed = False
                raise KeyboardInterrupt

    setattr(Interrupted, when, Interrupted.interrupt)
    ms = Interrupted()
    ms.create_torus()
    ms.compute_normal_per_vertex()
    ms.armed = True
    before, normals = mesh_state(ms), ms.current_mesh().face_normal_matrix()
    with pytest.raises(KeyboardInterrupt):
        apply_coord_bezier_patch_smoothing(ms, method="paper")
    left = changed(before, mesh_state(ms)) - {"0: outlierScore", "0: face_normal_matrix"}
    assert all(key.startswith("0: bz_") for key in left)
    np.testing.assert_allclose(ms.current_mesh().face_normal_matrix(), normals, atol=1e-12)
