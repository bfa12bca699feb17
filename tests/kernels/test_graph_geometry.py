"""Standard errors are those of the heights, propagated through the fit by differences."""

import numpy as np
import pytest
from graph_fits import fit_over_plane_z

from bezier_filters import PatchFit

STEP, SIGMA = 1e-5, (0.3, 0.7)  # of the heights, as far as they concern the normal, and the curvatures


def fitted(x, y, z, degree):
    """The vertex 0, all others being its neighbourhood."""
    geometry = fit_over_plane_z(x, y, z, PatchFit(degree=degree, alpha=1.0), 10, np.zeros(1, np.int32), noise=SIGMA)
    assert geometry.status_counts()["OK"] == 1
    return geometry


def values(geometry):
    return np.array([*geometry.normals[0], geometry.mean_curvature[0], geometry.gaussian_curvature[0]])


@pytest.mark.parametrize("degree", [2, 3, 4])
@pytest.mark.parametrize("slope", [(0.0, 0.0), (0.6, -0.3), (-0.2, 1.1)])
def test_standard_errors_are_those_of_independent_heights(degree, slope):
    """Over a plane that is not the tangent plane; without smoothness the fit is linear in the heights."""
    rng = np.random.default_rng(degree)
    x, y = 0.4 * rng.uniform(-1.0, 1.0, (2, 60))
    x[0], y[0] = 0.05, -0.03
    z = slope[0] * x + slope[1] * y + 0.8 * x**2 - 0.5 * x * y + 0.3 * y**2 + 0.02 * rng.standard_normal(60)
    changes = []
    for k in range(60):
        heights = STEP * (np.arange(60) == k)
        ahead, behind = (values(fitted(x, y, z + side * heights, degree)) for side in (1.0, -1.0))
        changes.append((ahead - behind) / (2.0 * STEP))
    *of_normal, of_mean, of_gaussian = np.square(changes).sum(axis=0)
    found = fitted(x, y, z, degree)
    assert found.normal_std[0] == pytest.approx(SIGMA[0] * np.sqrt(sum(of_normal)), rel=1e-5)
    assert found.mean_curvature_std[0] == pytest.approx(SIGMA[1] * np.sqrt(of_mean), rel=1e-5)
    assert found.gaussian_curvature_std[0] == pytest.approx(SIGMA[1] * np.sqrt(of_gaussian), rel=1e-5)
