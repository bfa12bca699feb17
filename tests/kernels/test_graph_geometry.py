"""Curvature and standard errors of a graph, by the textbook and by differences of the heights."""

import numpy as np
import pytest
from fundamental_forms import fundamental_forms, gaussian_curvature, mean_curvature, principal_curvatures, unit_normals
from graph_fits import fit_over_plane_z, geometry_of_graph
from hypothesis import given
from hypothesis import strategies as st

from bezier_filters import PatchFit

STEP, SIGMA = 1e-5, (0.3, 0.7, 0.0)  # of the heights, as far as they concern the normal, the curvatures, and position


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


@given(st.tuples(*[st.floats(-3, 3)] * 5))
def test_graph_formulas_of_the_kernel_agree_with_the_fundamental_forms(jet):
    p, q, r, s, t = jet
    result = geometry_of_graph([[0, q, t, 0], [p, s, 0, 0], [r, 0, 0, 0], [0, 0, 0, 0]])
    du, dv, duu, duv, dvv = np.array([[1, 0, p], [0, 1, q], [0, 0, r], [0, 0, s], [0, 0, t]])[:, None]
    forms = fundamental_forms(du, dv, duu, duv, dvv)
    principal = principal_curvatures(du, dv, forms)
    np.testing.assert_allclose(result.normal, unit_normals(du, dv)[0], atol=1e-12)
    assert result.k_min == pytest.approx(principal.k_min[0], abs=1e-9)
    assert result.k_max == pytest.approx(principal.k_max[0], abs=1e-9)
    assert result.k_min + result.k_max == pytest.approx(2 * mean_curvature(forms)[0], abs=1e-9)
    assert result.k_min * result.k_max == pytest.approx(gaussian_curvature(forms)[0], abs=1e-9)
    if result.k_max - result.k_min > 1e-3:
        assert abs(result.direction_max @ principal.direction_max[0]) == pytest.approx(1.0, abs=1e-6)
