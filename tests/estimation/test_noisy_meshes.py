"""Estimates and their standard errors under noise: correlated, on slivers, on a part of the surface."""

import numpy as np
import pytest
from numba import config
from scanner_noise import along_normals, mean_edge_of

from bezier_filters import FitStatus, estimate_vertex_geometry
from bezier_filters.surfaces import bumpy_star, ellipsoid, torus, waves

pytestmark = pytest.mark.skipif(config.DISABLE_JIT, reason="takes too long without the compiler")

SURFACES = {
    "torus": torus(resolution=36, jitter=0.3),
    "ellipsoid": ellipsoid(resolution=16, jitter=0.2),
    "star": bumpy_star(resolution=20, jitter=0.2),
}


@pytest.mark.parametrize(
    ("name", "passes", "options"),
    [("torus", 3, {}), ("ellipsoid", 1, {}), ("star", 3, {"rings": 4})],
)
def test_intervals_hold_the_truth_under_averaged_noise(name, passes, options):
    """Those of 95 %, for the mean curvature, over some draws of the noise."""
    surface, held, sigmas = SURFACES[name], [], []
    for seed in range(3):
        geometry = estimate_vertex_geometry(along_normals(surface, 0.1, passes, seed), surface.faces, **options)
        error = np.abs(geometry.mean_curvature - surface.mean_curvature)
        held.append((error < 1.96 * geometry.mean_curvature_std).mean())
        sigmas.append(geometry.noise_sigma)
    assert np.mean(sigmas) == pytest.approx(0.1 * mean_edge_of(surface.vertices, surface.faces), rel=0.15)
    assert 0.85 < np.mean(held) < 0.995


def test_averaged_noise_takes_a_wider_fit_than_white_noise_and_has_larger_errors():
    surface = SURFACES["ellipsoid"]
    white, averaged = (
        estimate_vertex_geometry(along_normals(surface, 0.1, passes), surface.faces, rings=4, degree=4)
        for passes in (0, 3)
    )
    ratio = np.median(averaged.mean_curvature_std / white.mean_curvature_std)
    truth = (
        np.square(averaged.mean_curvature - surface.mean_curvature).mean()
        / np.square(white.mean_curvature - surface.mean_curvature).mean()
    )
    assert ratio > 1.3
    assert ratio == pytest.approx(np.sqrt(truth), rel=0.25)


def test_coarse_detail_under_noise_is_not_noise():
    """It looks like long waves of noise, of which there are none elsewhere."""
    pyvista = pytest.importorskip("pyvista")
    for seed in (0, 2):
        points, faces, normals = blob(pyvista, 30)
        noise = 0.1 * mean_edge_of(points, faces) * np.random.default_rng(seed).normal(size=(len(points), 1))
        errors = []
        for rings in ("auto", 3):
            found = estimate_vertex_geometry(points + noise * normals, faces, rings=rings).normals
            cosines = np.abs(np.einsum("ij,ij->i", found, normals))
            errors.append(np.sqrt(np.square(np.arccos(np.minimum(cosines, 1.0))).mean()))
        assert errors[0] < 1.1 * errors[1]


def blob(pyvista, resolution):
    """Points, faces and normals of a ball with bumps a few edges across, by marching cubes."""

    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]  # so that no face lies in the grid

    def height(p):
        x, y, z = 4.0 * turn @ p.T
        return np.square(p).sum(axis=1) + 0.45 * np.sin(x) * np.sin(y) * np.sin(z) - 0.8

    def slopes(p):
        steps = 1e-5 * np.eye(3)
        return np.column_stack([height(p + step) - height(p - step) for step in steps]) / 2e-5

    grid = pyvista.ImageData(dimensions=(resolution,) * 3, spacing=(2.6 / (resolution - 1),) * 3, origin=(-1.3,) * 3)
    grid["height"] = height(grid.points)
    mesh = grid.contour([0.0], scalars="height", method="marching_cubes").triangulate()
    points = np.asarray(mesh.points, dtype=np.float64)
    for _ in range(5):  # onto the surface
        gradient = slopes(points)
        points -= (height(points) / np.square(gradient).sum(axis=1))[:, np.newaxis] * gradient
    gradient = slopes(points)
    faces = mesh.faces.reshape(-1, 4)[:, 1:].astype(np.int32)
    return points, faces, gradient / np.linalg.norm(gradient, axis=1, keepdims=True)


def test_noise_that_is_alike_along_edges_is_averaged_on_stretched_meshes_too():
    """Where edges are three times as long one way as the other, so is what noise is alike over."""
    surface = ellipsoid(semi_axes=(1.0, 0.5, 0.3), resolution=45, jitter=0.25)
    for seed in range(2):
        points = along_normals(surface, 0.1, 5, seed)
        errors = []
        for rings in ("auto", 2):
            geometry = estimate_vertex_geometry(points, surface.faces, rings=rings)
            cosines = np.einsum("ij,ij->i", geometry.normals, surface.normals)
            errors.append(np.sqrt(np.square(np.arccos(np.clip(cosines, -1.0, 1.0))).mean()))
        assert errors[0] < 0.4 * errors[1]


def test_no_residual_exceeds_the_heights_of_the_points():
    """Distance weights let the polynomial leave far points by many edges; the residual weighs them as the fit does."""
    vertices = torus(resolution=36).vertices
    vertices[::97] *= 1.02  # some 28 spikes of the height of an edge: a fit beside them weighs them down
    geometry = estimate_vertex_geometry(vertices, torus(resolution=36).faces, rings=4, degree=6, noise=0.0)
    fitted = geometry.status == FitStatus.OK
    assert fitted.sum() > 500
    assert geometry.residual[fitted].max() < mean_edge_of(vertices, torus(resolution=36).faces)


def torus_of_slivers():
    """Marching cubes of a torus of radii 1 and 0.4: vertices on it, its faces, normals and mean curvature."""
    pyvista = pytest.importorskip("pyvista")
    axis = np.linspace(-1.6, 1.6, 28)
    grid = pyvista.ImageData(dimensions=(28, 28, 28), spacing=[axis[1] - axis[0]] * 3, origin=[-1.6] * 3)
    x, y, z = grid.points.T
    found = grid.contour([0.0], np.hypot(np.hypot(x, y) - 1.0, z) - 0.4, method="flying_edges")
    points = np.asarray(found.points, dtype=np.float64)
    ring = points * [1.0, 1.0, 0.0]
    ring /= np.linalg.norm(ring, axis=1, keepdims=True)
    normals = (points - ring) / np.linalg.norm(points - ring, axis=1, keepdims=True)
    across = (normals * ring).sum(axis=1)
    curvature = 0.5 * (2.5 + across / (1.0 + 0.4 * across))
    return ring + 0.4 * normals, found.faces.reshape(-1, 4)[:, 1:].astype(np.int32), normals, curvature


def test_slivers_with_noise_in_all_directions_keep_their_neighbourhoods():
    """Noise flips the normals of thin faces, and narrow neighbourhoods of such vertices are mostly noise."""
    exact, faces, normals, curvature = torus_of_slivers()
    noise = 0.2 * mean_edge_of(exact, faces) * np.random.default_rng(0).normal(size=exact.shape)
    found = estimate_vertex_geometry(exact + noise, faces)
    sign = np.sign((found.normals * normals).sum())
    error = np.abs(sign * found.mean_curvature - curvature) / curvature.mean()
    assert error.max() < 2.0
    assert np.sqrt(np.mean(error**2)) < 0.3
    assert (found.status == FitStatus.OTHER_PLANE).sum() > 50


@pytest.mark.parametrize("seed", range(2))
def test_noise_on_a_part_at_a_border(seed):
    """The wide neighbourhoods of the part have few points there."""
    sheet = waves(resolution=45, jitter=0.2)
    distance = np.linalg.norm(sheet.vertices - sheet.vertices.min(axis=0) * [1.0, 1.0, 0.0], axis=1)
    is_noisy, edge = distance < np.quantile(distance, 0.2), mean_edge_of(sheet.vertices, sheet.faces)
    heights = 0.3 * edge * np.random.default_rng(seed).normal(size=len(distance))
    errors = []
    for of_vertices in (is_noisy, np.full(len(distance), True)):
        vertices = sheet.vertices + (heights * of_vertices)[:, np.newaxis] * sheet.normals
        found = estimate_vertex_geometry(vertices, sheet.faces).mean_curvature
        errors.append(np.sqrt(np.mean((found - sheet.mean_curvature)[is_noisy] ** 2)))
    assert errors[0] < 2.5 * errors[1]
