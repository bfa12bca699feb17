"""How fast the estimates approach the truth as the mesh is refined."""

import numpy as np
import pytest

from bezier_filters import estimate_vertex_geometry
from bezier_filters.surfaces import torus, waves

RESOLUTIONS = {torus: (16, 24, 36, 54), waves: (24, 36, 54, 81)}


def errors(make, resolution, **options):
    """RMS errors of the normal (radians), H and K (relative), away from boundaries."""
    surface = make(resolution=resolution, jitter=0.3)
    geometry = estimate_vertex_geometry(surface.vertices, surface.faces, **({"rings": 2, "alpha": 0.8} | options))
    inner = np.ones(len(surface.vertices), dtype=bool)
    if make is waves:
        inner = np.abs(surface.vertices[:, :2]).max(axis=1) < 0.7
    normal = np.linalg.norm(geometry.normals - surface.normals, axis=1)[inner]
    curvatures = [
        np.sqrt(np.mean((found - truth)[inner] ** 2) / np.mean(truth[inner] ** 2))
        for found, truth in (
            (geometry.mean_curvature, surface.mean_curvature),
            (geometry.gaussian_curvature, surface.gaussian_curvature),
        )
    ]
    return np.sqrt(np.mean(normal**2)), *curvatures


def orders(make, **options):
    """Slopes of log(error) over log(edge length) for the normal, H and K."""
    resolutions = RESOLUTIONS[make]
    table = np.array([errors(make, resolution, **options) for resolution in resolutions])
    return np.polyfit(-np.log(resolutions), np.log(table), 1)[0]


@pytest.mark.parametrize("make", [torus, waves])
@pytest.mark.parametrize("alpha", [0.999, 1.0])
def test_orders_of_the_bicubic_patch_with_little_smoothing(make, alpha):
    normal, mean, _ = orders(make, alpha=alpha)
    assert normal >= 2.7
    assert mean >= 1.7


@pytest.mark.parametrize("make", [torus, waves])
def test_third_order_smoothness_is_consistent_at_the_default_alpha(make):
    normal, mean, _ = orders(make)
    assert normal >= 1.7
    assert mean >= 0.8


@pytest.mark.parametrize("make", [torus, waves])
def test_the_paper_at_alpha_08_does_not_converge(make):
    """A fact of the method: its smoothness penalises quadratics by a share that refinement leaves as it is."""
    resolutions = RESOLUTIONS[make]
    table = np.array([errors(make, r, smoothness="paper", alpha=0.8) for r in resolutions])
    assert table[-1, 1] > 0.1
    assert table[-1, 1] > 0.9 * table[-2, 1]


@pytest.mark.parametrize("make", [torus, waves])
def test_orders_of_the_automatic_choice(make):
    normal, mean, gaussian = orders(make, rings="auto", alpha="auto")
    assert normal >= 5
    assert mean >= 4
    assert gaussian >= 4
