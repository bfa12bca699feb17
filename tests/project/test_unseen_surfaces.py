"""The surfaces of benchmarks/unseen.py have exact geometry: level sets and charts agree with closed formulas."""

import numpy as np
import pytest

from unseen_surfaces import SURFACES, Chart, Jet, LevelSet, tube

NO_FACES = np.empty((0, 3), dtype=np.int32)


def test_derivatives_agree_with_finite_differences():
    def function(x, y):
        return np.sin(x * y) / (np.exp(x) + 2.0) - np.cos(y) ** 3 + (x**4 + 1.0) ** 0.5 * np.cosh(y)

    points, step = np.random.default_rng(0).uniform(-1.0, 1.0, (20, 2)), 1e-5
    jet = function(*Jet.variables(points))
    assert jet.value == pytest.approx(function(*points.T))
    for k in range(2):
        there, back = (function(*Jet.variables(points + sign * step * np.eye(2)[k])) for sign in (1.0, -1.0))
        assert jet.slope[:, k] == pytest.approx((there.value - back.value) / (2.0 * step), abs=1e-8)
        assert jet.bend[:, k] == pytest.approx((there.slope - back.slope) / (2.0 * step), abs=1e-8)


def test_a_sphere_as_a_level_set():
    ball = LevelSet(lambda x, y, z: x**2 + y**2 + z**2 - 4.0, (2.0, 2.0, 2.0))
    points = ball.nearest(np.random.default_rng(0).normal(size=(50, 3)) + 1.0)
    found = ball.sample(points, NO_FACES)
    assert found.normals == pytest.approx(points / 2.0)
    assert found.mean_curvature == pytest.approx(0.5)
    assert found.gaussian_curvature == pytest.approx(0.25)


def test_a_torus_as_a_chart():
    ring = Chart(tube(lambda u: 0.4), (2.0 * np.pi, 2.0 * np.pi), (True, True))
    parameters = np.random.default_rng(0).uniform(0.0, 6.0, (50, 2))
    found, second = ring.sample(parameters, NO_FACES), np.cos(parameters[:, 1])
    second /= 1.0 + 0.4 * second
    assert found.mean_curvature == pytest.approx(0.5 * (2.5 + second))
    assert found.gaussian_curvature == pytest.approx(2.5 * second)


@pytest.mark.parametrize("name", [name for name, one in SURFACES.items() if isinstance(one, LevelSet)])
def test_mean_curvature_is_half_the_divergence_of_the_normal(name):
    """A second formula."""
    surface, step = SURFACES[name], 1e-5
    points = np.random.default_rng(0).uniform(-1.0, 1.0, (50_000, 3)) * surface.reach
    points = surface.on_surface(points[np.argsort(np.abs(surface.value(points)))[:200]])
    assert np.abs(surface.value(points)).max() < 1e-12

    def normals(at):
        slope = surface.level(*Jet.variables(at)).slope
        return slope / np.linalg.norm(slope, axis=1)[:, np.newaxis]

    moves = step * np.eye(3)
    divergence = sum((normals(points + moves[k]) - normals(points - moves[k]))[:, k] for k in range(3)) / (2.0 * step)
    assert surface.sample(points, NO_FACES).mean_curvature == pytest.approx(0.5 * divergence, rel=1e-5, abs=1e-5)
