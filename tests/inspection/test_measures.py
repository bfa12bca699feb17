"""Integrals over surfaces whose areas, volumes and curvatures are known."""

import numpy as np
import pytest

from bezier_filters import InvalidMeshError, InvalidParameterError, measure
from bezier_filters.inspection.quadrature import triangle_rule
from bezier_filters.surfaces import block_with_sharp_edges, ellipsoid, height_field, sphere, torus

PI = np.pi


def whole(body):
    return measure(body.vertices, body.faces, repeats=0).whole


def edge_ratio(coarse, fine):
    return np.sqrt(len(fine.faces) / len(coarse.faces))


@pytest.mark.parametrize("order", [1, 2, 3])
def test_rules_are_exact_to_their_degree(order):
    places, weights = triangle_rule(order)
    factorial = [1.0, 1.0, 2.0, 6.0, 24.0, 120.0, 720.0, 5040.0]
    for i in range(2 * order):
        for j in range(2 * order - i):
            exact = factorial[i] * factorial[j] / factorial[i + j + 2]
            assert abs(weights @ (places[:, 0] ** i * places[:, 1] ** j) - exact) < 1e-14


@pytest.mark.parametrize(
    ("make", "resolutions", "exact"),
    [
        (sphere, (6, 12), {"area": 4 * PI, "volume": 4 / 3 * PI, "total_mean_curvature": 4 * PI}),
        (torus, (24, 48), {"area": 1.6 * PI**2, "volume": 0.32 * PI**2, "total_mean_curvature": 2 * PI**2}),
    ],
)
def test_integrals_converge_faster_than_those_over_flat_triangles(make, resolutions, exact):
    coarse, fine = (make(resolution=resolution, jitter=0.2) for resolution in resolutions)
    rough, good = whole(coarse).values, whole(fine).values
    for name, value in exact.items():
        errors = [abs(getattr(found, name) / value - 1.0) for found in (rough, good)]
        assert np.log(errors[0] / errors[1]) / np.log(edge_ratio(coarse, fine)) > 3.5
        assert errors[1] < (1e-5 if name == "total_mean_curvature" else 1e-6)  # curvature loses an order


def test_energies_of_a_torus():
    """Willmore's is pi^2 R^2 / (r sqrt(R^2 - r^2)); with K of integral 0 the bending energy is twice that."""
    found = whole(torus(resolution=48, jitter=0.2))
    exact = PI**2 / (0.4 * np.sqrt(1.0 - 0.16))
    assert abs(found.values.willmore_energy / exact - 1.0) < 1e-3
    assert abs(found.values.bending_energy / (2.0 * exact) - 1.0) < 1e-3


def test_the_theorem_of_gauss_and_bonnet_holds_for_closed_open_and_cut_surfaces():
    ring = torus(resolution=24, jitter=0.2)
    labels = (ring.vertices[ring.faces].mean(axis=1)[:, 0] > 0.2).astype(int)
    found = measure(ring.vertices, ring.faces, face_labels=labels, repeats=0)
    assert found.whole.euler_characteristic == 0
    assert [part.euler_characteristic for part in found.parts] == [0, 0]
    assert all(part.volume is None for part in (found.parts[0].values, found.parts[1].values))
    for part in (found.whole, *found.parts):
        assert abs(part.gauss_bonnet_error) < 0.05
    bowl = height_field(lambda x, y: [0.3 * x * x + 0.1 * y * y, 0.6 * x, 0.2 * y, 0.6 + 0 * x, 0 * x, 0.2 + 0 * x])
    sheet = whole(bowl)
    assert sheet.euler_characteristic == 1
    assert sheet.values.volume is None
    assert abs(sheet.gauss_bonnet_error) < 1e-4
    vertices, faces = block_with_sharp_edges(resolution=6)
    block = measure(vertices, faces, repeats=0).whole
    assert block.euler_characteristic == 9  # its faces
    np.testing.assert_allclose([block.values.area, block.values.volume], [6.0, 0.875], atol=1e-9)
    assert abs(block.turning - 9 * 2.0 * PI) < 1e-9


@pytest.mark.parametrize("of", ["face_labels", "vertex_labels"])
def test_labels_share_the_whole(of):
    ball = sphere(resolution=10, jitter=0.2)
    heights = ball.vertices[ball.faces].mean(axis=1)[:, 2] if of == "face_labels" else ball.vertices[:, 2]
    found = measure(ball.vertices, ball.faces, **{of: np.where(heights > 0.0, 7, -2)}, repeats=0)
    assert [part.label for part in found.parts] == [-2, 7]
    for name in ("area", "total_mean_curvature", "total_gaussian_curvature", "willmore_energy"):
        total = sum(getattr(part.values, name) for part in found.parts)
        assert abs(total / getattr(found.whole.values, name) - 1.0) < 1e-12
    assert abs(found.parts[1].values.area / (2.0 * PI) - 1.0) < 0.03


def test_standard_errors_of_area_and_volume_are_the_spread_of_repeated_measurements():
    body = ellipsoid(resolution=6, jitter=0.2)
    corners = body.vertices[body.faces]
    step = 0.1 * np.linalg.norm(corners[:, 0] - corners[:, 1], axis=1).mean()
    measured, stated = [], []
    for seed in range(8):
        heights = step * np.random.default_rng(seed).standard_normal((len(body.vertices), 1))
        found = measure(body.vertices + heights * body.normals, body.faces, noise=step, repeats=2, seed=seed).whole
        measured.append(list(vars(found.values).values())[:2])
        stated.append(list(vars(found.std).values())[:2])
    ratios = np.std(measured, axis=0, ddof=1) / np.sqrt(np.square(stated).mean(axis=0))
    assert (ratios > 0.5).all()  # eight measurements know their spread to a quarter
    assert (ratios < 1.7).all()


def test_the_standard_error_of_the_total_gaussian_curvature_includes_the_error_of_shape():
    """A torus, whose total is 0, under noise for which patches take as many rings as its tube allows."""
    body = torus(resolution=24)
    corners = body.vertices[body.faces]
    step = 0.1 * np.linalg.norm(corners[:, 0] - corners[:, 1], axis=1).mean()
    heights = step * np.random.default_rng(0).standard_normal((len(body.vertices), 1))
    found = measure(body.vertices + heights * body.normals, body.faces, repeats=2).whole
    assert found.gauss_bonnet_error == pytest.approx(found.values.total_gaussian_curvature)
    assert abs(found.values.total_gaussian_curvature) <= found.std.total_gaussian_curvature


def test_it_follows_the_scale():
    ball = sphere(resolution=8)
    plain, large = (measure(s * ball.vertices, ball.faces, repeats=0).whole.values for s in (1.0, 1e30))
    for name, power in (("area", 2), ("volume", 3), ("total_mean_curvature", 1), ("willmore_energy", 0)):
        assert abs(getattr(large, name) / (getattr(plain, name) * 1e30**power) - 1.0) < 1e-6


def test_the_volume_of_a_body_with_noisy_edges_does_not_depend_on_its_place():
    vertices, faces = block_with_sharp_edges(resolution=6)
    vertices = vertices + 0.005 * np.random.default_rng(0).standard_normal(vertices.shape)
    volumes = [measure(vertices + offset, faces, repeats=0).whole.values.volume for offset in (0.0, 1000.0)]
    assert abs(volumes[0] / 0.875 - 1.0) < 0.02
    assert abs(volumes[1] / volumes[0] - 1.0) < 1e-4


def test_results_are_tables():
    ball = sphere(resolution=6)
    found = measure(ball.vertices, ball.faces, vertex_labels=ball.vertices[:, 0] > 0.0, repeats=0)
    assert "label 1" in str(found)
    assert found.to_dict()["whole"]["values"]["area"] == found.whole.values.area


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"repeats": 1}, "repeats"),
        ({"face_labels": [1, 2]}, "face_labels"),
        ({"vertex_labels": np.zeros(386)}, "vertex_labels"),
        ({"face_labels": [1], "vertex_labels": [1]}, "vertex_labels"),
        ({"noise": -1.0}, "noise"),
        ({"seed": -1}, "seed"),
        ({"seed": "a"}, "seed"),
        ({"face_labels": np.full(720, 2**63, dtype=np.uint64)}, "2\\^63"),
    ],
)
def test_wrong_parameters_are_refused(options, message):
    ball = sphere(resolution=6)
    with pytest.raises(InvalidParameterError, match=message):
        measure(ball.vertices, ball.faces, **options)


def test_a_cloud_is_refused():
    with pytest.raises(InvalidMeshError, match="needs a"):
        measure(sphere(resolution=6).vertices, None)
