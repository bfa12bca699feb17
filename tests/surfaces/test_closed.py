"""Closed surfaces against textbook curvatures and volumes, in every size."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from surface_cases import CLOSED, each_jitter, make, volume

from bezier_filters import surfaces
from evans_fung import red_blood_cell


@each_jitter
def test_torus_has_the_textbook_curvatures_and_directions(jitter: float) -> None:
    ring = surfaces.torus(major_radius=2.0, minor_radius=0.5, resolution=14, jitter=jitter)
    axis_distance = np.hypot(ring.vertices[:, 0], ring.vertices[:, 1])
    cosine = (axis_distance - 2.0) / 0.5
    np.testing.assert_allclose((axis_distance - 2.0) ** 2 + ring.vertices[:, 2] ** 2, 0.25, atol=1e-14)
    np.testing.assert_allclose(ring.k_max, 2.0, rtol=1e-12)
    np.testing.assert_allclose(ring.k_min, cosine / axis_distance, atol=1e-12)
    np.testing.assert_allclose(ring.mean_curvature, (2.0 + 2 * 0.5 * cosine) / (2 * 0.5 * axis_distance), rtol=1e-12)
    parallel = np.stack([-ring.vertices[:, 1], ring.vertices[:, 0], np.zeros_like(cosine)], axis=1)
    along = np.einsum("ni,ni->n", ring.direction_min, parallel / axis_distance[:, None])
    np.testing.assert_allclose(np.abs(along), 1, atol=1e-13)


def test_the_dimples_of_the_red_blood_cell_are_hollow_seen_from_outside() -> None:
    cell = red_blood_cell()
    middle = np.hypot(cell.vertices[:, 0], cell.vertices[:, 1]).argmin()
    assert cell.mean_curvature[middle] < 0.0 < cell.gaussian_curvature[middle]


@each_jitter
def test_ellipsoid_has_the_textbook_curvatures(jitter: float) -> None:
    axes = np.array([1.3, 0.6, 0.9])
    egg = surfaces.ellipsoid(semi_axes=(1.3, 0.6, 0.9), resolution=6, jitter=jitter)
    squares = egg.vertices**2
    np.testing.assert_allclose((squares / axes**2).sum(axis=1), 1, atol=1e-14)
    support = (squares / axes**4).sum(axis=1)
    gaussian = 1 / (axes.prod() ** 2 * support**2)
    mean = np.abs(squares.sum(axis=1) - (axes**2).sum()) / (2 * axes.prod() ** 2 * support**1.5)
    np.testing.assert_allclose(egg.gaussian_curvature, gaussian, rtol=1e-12)
    np.testing.assert_allclose(egg.mean_curvature, mean, rtol=1e-12)


def star_volume() -> float:
    """One third of the integral of r^3 over the unit sphere: Gauss rule in z, equal angles around it."""
    z, weights = np.polynomial.legendre.leggauss(60)
    angle = 2 * np.pi * np.arange(120) / 120
    x, y = np.sqrt(1 - z**2)[:, None] * np.cos(angle), np.sqrt(1 - z**2)[:, None] * np.sin(angle)
    radius = 1 + 0.08 * (np.sin(4 * x) + np.sin(5 * y) + np.sin(6 * z)[:, None])
    return float((weights[:, None] * radius**3).sum() * (2 * np.pi / 120) / 3)


VOLUMES = {
    "sphere": 4 / 3 * np.pi,
    "ellipsoid": 4 / 3 * np.pi * 1.0 * 0.7 * 0.5,
    "bumpy_star": star_volume(),
    # pi times the integral of sqrt(1 - t) (0.2072 + 2.0026 t - 1.1228 t^2) over [0, 1]
    "red_blood_cell": np.pi * (0.2072 * 2 / 3 + 2.0026 * 4 / 15 - 1.1228 * 16 / 105),
    "torus": 2 * np.pi**2 * 1.0 * 0.4**2,
}


@pytest.mark.parametrize("name", CLOSED)
@each_jitter
def test_enclosed_volume_converges_from_an_outward_mesh(name: str, jitter: float) -> None:
    volumes = []
    for refinement in (1, 2, 4):
        surface = make(name, jitter, refinement)
        volumes.append(volume(surface.vertices, surface.faces))
    errors = np.abs(np.array(volumes) - VOLUMES[name])
    assert volumes[-1] == pytest.approx(VOLUMES[name], rel=5e-3)
    assert np.log2(errors[0] / errors[2]) / 2 > 1.8


@given(radius=st.floats(1e-6, 1e6), jitter=st.floats(0.0, 0.34), seed=st.integers(0, 10**6))
@settings(max_examples=30, deadline=None)
def test_sphere_of_any_radius(radius: float, jitter: float, seed: int) -> None:
    ball = surfaces.sphere(radius=radius, resolution=3, jitter=jitter, seed=seed)
    np.testing.assert_allclose(np.linalg.norm(ball.vertices, axis=1), radius, rtol=1e-14)
    np.testing.assert_allclose(ball.normals, ball.vertices / radius, atol=1e-14)
    np.testing.assert_allclose(ball.mean_curvature, 1 / radius, rtol=1e-12)
    np.testing.assert_allclose(ball.gaussian_curvature, 1 / radius**2, rtol=1e-12)
    np.testing.assert_allclose(ball.geodesic_torsion, 0, atol=1e-12 / radius)


@given(scale=st.floats(1e-4, 1e4), minor=st.floats(0.1, 0.9))
@settings(max_examples=25, deadline=None)
def test_curvatures_scale_inversely_with_length(scale: float, minor: float) -> None:
    unit = surfaces.torus(minor_radius=minor, resolution=8, jitter=0.2)
    scaled = surfaces.torus(major_radius=scale, minor_radius=scale * minor, resolution=8, jitter=0.2)
    if unit.vertices.shape != scaled.vertices.shape:
        return  # the number of samples around the axis was rounded the other way
    np.testing.assert_allclose(scaled.vertices, scale * unit.vertices, rtol=1e-9, atol=1e-9 * scale)
    np.testing.assert_allclose(scaled.mean_curvature * scale, unit.mean_curvature, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(scaled.gaussian_curvature * scale**2, unit.gaussian_curvature, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(scaled.geodesic_torsion * scale, unit.geodesic_torsion, rtol=1e-9, atol=1e-9)


@given(axes=st.tuples(*[st.floats(0.2, 3.0)] * 3))
@settings(max_examples=25, deadline=None)
def test_ellipsoids_are_convex_and_outward(axes: tuple[float, float, float]) -> None:
    egg = surfaces.ellipsoid(semi_axes=axes, resolution=6, jitter=0.2)
    assert (egg.k_min > 0).all()
    assert (np.einsum("ni,ni->n", egg.normals, egg.vertices) > 0).all()
    assert 0 < volume(egg.vertices, egg.faces) < 4 / 3 * np.pi * np.prod(axes)
