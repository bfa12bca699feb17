import threading
from pathlib import Path

import numpy as np
import pytest
from conftest import pymeshlab_sample
from graph_fits import fit_over_plane_z
from hypothesis import given, settings
from hypothesis import strategies as st
from plyfile import PlyData
from reference import paper_fit
from scipy.spatial import Delaunay

from bezier_filters import (
    CancelledError,
    FitStatus,
    InvalidMeshError,
    InvalidParameterError,
    PatchFit,
    estimate_vertex_geometry,
    triangle_mesh,
    vertex_adjacency,
)
from bezier_filters.surfaces import sphere, torus

SAMPLES = Path(__file__).parents[2] / "sample_meshes"
PAPER = {"rings": 2, "alpha": 0.8, "smoothness": "paper"}
FIXED = {"rings": 2, "alpha": 0.8}


def load_ply(path):
    vertex, face = PlyData.read(path)["vertex"], PlyData.read(path)["face"]
    return np.column_stack([vertex[axis] for axis in "xyz"]), np.vstack(face["vertex_indices"])


@pytest.mark.parametrize("name", ["bunny", *sorted(path.stem for path in SAMPLES.glob("*.ply"))])
def test_literal_mode_equals_the_dense_least_squares_of_the_paper(name):
    vertices, faces = pymeshlab_sample("bunny.obj") if name == "bunny" else load_ply(SAMPLES / f"{name}.ply")
    geometry = estimate_vertex_geometry(vertices, faces, **PAPER)
    full_rank = np.flatnonzero(geometry.status == FitStatus.OK)
    assert len(full_rank) > (0.5 if name in ("block", "fan") else 0.9) * len(vertices)
    sample = np.random.default_rng(0).choice(full_rank, 60, replace=False)
    expected = [paper_fit(vertices, faces, vertex, geometry.normals[vertex]) for vertex in sample]
    normals, mean, gaussian = (np.array(values) for values in zip(*expected, strict=True))
    scale = max(np.abs(mean).max(), 1.0)
    np.testing.assert_allclose(geometry.normals[sample], normals, atol=1e-9)
    np.testing.assert_allclose(geometry.mean_curvature[sample], mean, atol=1e-9 * scale)
    np.testing.assert_allclose(geometry.gaussian_curvature[sample], gaussian, atol=1e-9 * scale**2)


def graph_truth(p, q, r, s, t):
    """Normal, H and K of a graph z(x, y), H positive where it is convex towards +z."""
    w = np.sqrt(1 + p * p + q * q)
    mean = -((1 + q * q) * r - 2 * p * q * s + (1 + p * p) * t) / (2 * w**3)
    normal = np.stack([-p / w, -q / w, 1 / w], axis=-1)
    return normal, mean, (r * t - s * s) / w**4


def assert_reproduces(geometry, truth, at_least, where=True):
    normals, mean, gaussian = truth
    fitted = geometry.status == FitStatus.OK
    assert fitted.mean() >= at_least
    fitted &= where
    np.testing.assert_allclose(geometry.normals[fitted], normals[fitted], atol=1e-9)
    np.testing.assert_allclose(geometry.mean_curvature[fitted], mean[fitted], atol=1e-9)
    np.testing.assert_allclose(geometry.gaussian_curvature[fitted], gaussian[fitted], atol=1e-9)
    assert geometry.residual[fitted].max() < 1e-9


@settings(max_examples=12)
@given(
    alpha=st.floats(0.05, 1.0),
    degree=st.sampled_from([2, 3, 4]),
    coefficients=st.tuples(*[st.floats(-1, 1)] * 5),
    seed=st.integers(0, 20),
)
def test_quadratics_are_reproduced_at_every_alpha(alpha, degree, coefficients, seed):
    x, y = np.random.default_rng(seed).uniform(-1, 1, (2, 120))
    a, b, c, d, e = coefficients
    z = a * x + b * y + c * x * x + d * x * y + e * y * y
    one = np.ones_like(x)
    truth = graph_truth(a + 2 * c * x + d * y, b + d * x + 2 * e * y, 2 * c * one, d * one, 2 * e * one)
    inner = np.maximum(abs(x), abs(y)) < 0.7  # at the rim, points on one side determine degree 4 to eight digits
    assert_reproduces(fit_over_plane_z(x, y, z, PatchFit(degree, alpha), rings=4), truth, at_least=0.3, where=inner)


@pytest.mark.parametrize("smoothness", ["paper", "third_order"])
@pytest.mark.parametrize("degree", [2, 3, 4])
def test_polynomials_of_full_bidegree_are_reproduced_without_smoothing(smoothness, degree):
    """Heights that are a bicubic in a vertex's own axes: x points to its farthest neighbour."""
    rng = np.random.default_rng(degree)
    x, y = rng.uniform(-1, 1, (2, 300))
    neighbours = vertex_adjacency(
        triangle_mesh(np.column_stack([x, y, 0 * x]), Delaunay(np.column_stack([x, y])).simplices)
    ).vertices
    coefficients = rng.uniform(-1, 1, (degree + 1, degree + 1))
    checked = 0
    for vertex in np.flatnonzero(np.hypot(x, y) < 0.5)[:25]:
        dx, dy = x - x[vertex], y - y[vertex]
        row = neighbours.row(vertex)
        far = row[np.argmax(np.hypot(dx[row], dy[row]))]
        axis = np.array([dx[far], dy[far]]) / np.hypot(dx[far], dy[far])
        a, b = dx * axis[0] + dy * axis[1], -dx * axis[1] + dy * axis[0]
        z = np.polynomial.polynomial.polyval2d(a, b, coefficients)
        ids = np.array([vertex], dtype=np.int32)
        geometry = fit_over_plane_z(x, y, z, PatchFit(degree, 1.0, smoothness), 4, ids)
        if geometry.status[vertex] != FitStatus.OK:
            continue
        checked += 1
        c = coefficients
        along, mean, gaussian = graph_truth(c[1, 0], c[0, 1], 2 * c[2, 0], c[1, 1], 2 * c[0, 2])
        normal = [along[0] * axis[0] - along[1] * axis[1], along[0] * axis[1] + along[1] * axis[0], along[2]]
        np.testing.assert_allclose(geometry.normals[vertex], normal, atol=1e-9)
        assert geometry.mean_curvature[vertex] == pytest.approx(mean, abs=1e-9)
        assert geometry.gaussian_curvature[vertex] == pytest.approx(gaussian, abs=1e-9)
        assert geometry.residual[vertex] < 1e-9
    assert checked >= 20


def surface_arrays(surface):
    return surface.vertices, surface.faces


def rotation(seed):
    q = np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))[0]
    return q * np.sign(np.linalg.det(q))


@pytest.mark.parametrize(
    "options", [FIXED, PAPER, FIXED | {"degree": 4, "rings": 3}], ids=["fixed", "paper", "degree_4"]
)
class TestInvariance:
    """The same shape in another place, size, numbering or orientation has the same geometry."""

    def estimates(self, options, transform, faces=None):
        surface = torus(jitter=0.3, resolution=14)
        before = estimate_vertex_geometry(surface.vertices, surface.faces, **options)
        after = estimate_vertex_geometry(
            transform(surface.vertices), surface.faces if faces is None else faces(surface.faces), **options
        )
        return before, after

    def test_rotation(self, options):
        turn = rotation(5)
        before, after = self.estimates(options, lambda v: v @ turn.T)
        np.testing.assert_allclose(after.normals, before.normals @ turn.T, atol=1e-9)
        np.testing.assert_allclose(after.mean_curvature, before.mean_curvature, atol=1e-9)
        np.testing.assert_allclose(after.gaussian_curvature, before.gaussian_curvature, atol=1e-8)
        lines = np.abs(np.einsum("ij,ij->i", after.direction_max, before.direction_max @ turn.T))
        distinct = before.geodesic_torsion > 1e-3
        np.testing.assert_allclose(lines[distinct], 1.0, atol=1e-9)

    def test_translation_by_a_million_edges(self, options):
        # the translated coordinates themselves are rounded by 1e6 edges * 1e-16
        edge = 0.1
        before, after = self.estimates(options, lambda v: v + 1e6 * edge * np.array([1.0, -1.0, 1.0]))
        np.testing.assert_allclose(after.normals, before.normals, atol=1e-7)
        np.testing.assert_allclose(after.mean_curvature, before.mean_curvature, atol=1e-6)
        np.testing.assert_array_equal(after.status, before.status)

    def test_scale(self, options):
        before, after = self.estimates(options, lambda v: 1000.0 * v)
        np.testing.assert_allclose(after.normals, before.normals, atol=1e-9)
        np.testing.assert_allclose(after.mean_curvature * 1e3, before.mean_curvature, atol=1e-9)
        np.testing.assert_allclose(after.gaussian_curvature * 1e6, before.gaussian_curvature, atol=1e-8)
        np.testing.assert_allclose(after.residual / 1e3, before.residual, atol=1e-12)

    def test_relabelling(self, options):
        surface = torus(jitter=0.3, resolution=14)
        order = np.random.default_rng(0).permutation(len(surface.vertices))
        new_index = np.argsort(order)
        before, after = self.estimates(
            options, lambda v: v[order], lambda f: new_index[np.random.default_rng(1).permutation(f)]
        )
        np.testing.assert_allclose(after.normals, before.normals[order], atol=1e-9)
        np.testing.assert_allclose(after.k_min, before.k_min[order], atol=1e-9)
        np.testing.assert_allclose(after.k_max, before.k_max[order], atol=1e-9)
        np.testing.assert_array_equal(after.status, before.status[order])

    def test_orientation_flip(self, options):
        before, after = self.estimates(options, lambda v: v, lambda f: f[:, ::-1])
        np.testing.assert_allclose(after.normals, -before.normals, atol=1e-9)
        np.testing.assert_allclose(after.k_min, -before.k_max, atol=1e-9)
        np.testing.assert_allclose(after.k_max, -before.k_min, atol=1e-9)
        np.testing.assert_allclose(after.gaussian_curvature, before.gaussian_curvature, atol=1e-9)
        np.testing.assert_allclose(after.geodesic_torsion, before.geodesic_torsion, atol=1e-9)

    def test_thread_count_changes_nothing(self, options, monkeypatch):
        monkeypatch.setattr("bezier_filters.runtime.parallel.MIN_CHUNK", 100)
        surface = torus(jitter=0.3, resolution=14)
        one, three = (
            estimate_vertex_geometry(surface.vertices, surface.faces, threads=threads, **options) for threads in (1, 3)
        )
        np.testing.assert_array_equal(one.normals, three.normals)
        np.testing.assert_array_equal(one.k_max, three.k_max)


def test_frames_are_right_handed_and_orthonormal(bunny):
    geometry = estimate_vertex_geometry(*bunny)
    frame = np.stack([geometry.direction_max, geometry.direction_min, geometry.normals], axis=1)
    np.testing.assert_allclose(frame @ frame.transpose(0, 2, 1), np.broadcast_to(np.eye(3), frame.shape), atol=1e-12)
    swapped = np.cross(geometry.normals, geometry.direction_max)
    np.testing.assert_allclose(geometry.direction_min, swapped, atol=1e-12)


def test_principal_directions_of_a_torus_are_its_meridians_and_parallels():
    surface = torus(resolution=30)
    geometry = estimate_vertex_geometry(surface.vertices, surface.faces)
    lines = np.abs(np.einsum("ij,ij->i", geometry.direction_max, surface.direction_max))
    assert np.degrees(np.arccos(np.minimum(lines, 1.0))).max() < 1.0


def test_selected_vertices_alone_are_estimated(bunny):
    vertices, faces = bunny
    selected = np.zeros(len(vertices), dtype=bool)
    selected[100:200] = True
    part = estimate_vertex_geometry(vertices, faces, selected=selected)
    whole = estimate_vertex_geometry(vertices, faces)
    np.testing.assert_array_equal(part.k_max[selected], whole.k_max[selected])
    assert (part.status[~selected] == FitStatus.SKIPPED).all()
    assert not part.k_max[~selected].any()


def test_progress_reaches_the_total_and_may_cancel(bunny):
    calls = []
    estimate_vertex_geometry(*bunny, progress=lambda done, total: calls.append((done, total)))
    assert calls[-1] == (len(bunny[0]), len(bunny[0]))
    assert [done for done, _ in calls] == sorted(done for done, _ in calls)
    with pytest.raises(CancelledError):
        estimate_vertex_geometry(*bunny, progress=lambda done, total: False)


def test_two_python_threads_may_estimate_at_once(bunny):
    expected = estimate_vertex_geometry(*bunny, threads=1).k_max
    results = {}

    def work(name):
        results[name] = estimate_vertex_geometry(*bunny, threads=2).k_max

    workers = [threading.Thread(target=work, args=(name,)) for name in range(2)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    for name in range(2):
        np.testing.assert_array_equal(results[name], expected)


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"rings": 0}, InvalidParameterError, "rings: got 0, expected an integer from 1 to 1000"),
        ({"rings": 1.5}, InvalidParameterError, "rings: got 1.5"),
        ({"rings": True}, InvalidParameterError, "rings: got True"),
        ({"alpha": None}, InvalidParameterError, "alpha: got None"),
        ({"threads": "a"}, InvalidParameterError, "threads: got 'a'"),
        ({"alpha": 1.5}, InvalidParameterError, "alpha: got 1.5"),
        ({"degree": 2.0}, InvalidParameterError, "degree: got 2.0"),
        ({"degree": 2.0, "alpha": 0.5}, InvalidParameterError, "degree: got 2.0"),
        ({"degree": 7}, InvalidParameterError, "degree: got 7"),
        ({"degree": 6, "alpha": 0.5}, InvalidParameterError, "degree: got 6"),
        ({"smoothness": "none"}, InvalidParameterError, "smoothness: got 'none'"),
        ({"threads": 0}, InvalidParameterError, "threads: got 0"),
        ({"selected": np.ones(3)}, InvalidParameterError, "selected: got float64"),
        ({"faces": [[0, 1, 9999]]}, InvalidMeshError, "faces: indices run from 0 to 9999"),
    ],
)
def test_bad_arguments_are_refused_by_name(options, error, message):
    surface = sphere(resolution=3)
    arguments = {"vertices": surface.vertices, "faces": surface.faces} | options
    with pytest.raises(error, match=message):
        estimate_vertex_geometry(**arguments)


def test_threads_variable_is_read_and_checked(monkeypatch):
    surface = sphere(resolution=3)
    monkeypatch.setenv("BEZIER_FILTERS_THREADS", "two")
    with pytest.raises(InvalidParameterError, match="BEZIER_FILTERS_THREADS: got 'two'"):
        estimate_vertex_geometry(surface.vertices, surface.faces)
    monkeypatch.setenv("BEZIER_FILTERS_THREADS", "1")
    estimate_vertex_geometry(surface.vertices, surface.faces)
