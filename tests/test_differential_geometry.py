"""Principal curvatures from shape operators."""

import numpy as np
import pytest
from fundamental_forms import fundamental_forms, gaussian_curvature, mean_curvature, principal_curvatures, unit_normals
from hypothesis import given
from hypothesis import strategies as st

angles = st.floats(0, 2 * np.pi)


def torus_derivatives(theta, phi, major=2.0, minor=0.5):
    """First and second derivatives of a torus by (theta, phi), du x dv pointing outward."""
    c, s, C, S = np.cos(phi), np.sin(phi), np.cos(theta), np.sin(theta)
    r = major + minor * c
    du = np.array([[-r * S, r * C, 0]])
    dv = np.array([[-minor * s * C, -minor * s * S, minor * c]])
    duu = np.array([[-r * C, -r * S, 0]])
    duv = np.array([[minor * s * S, -minor * s * C, 0]])
    dvv = np.array([[-minor * c * C, -minor * c * S, -minor * s]])
    return du, dv, duu, duv, dvv


@given(angles, angles)
def test_torus(theta, phi):
    du, dv, duu, duv, dvv = torus_derivatives(theta, phi)
    forms = fundamental_forms(du, dv, duu, duv, dvv)
    parallel = np.cos(phi) / (2.0 + 0.5 * np.cos(phi))
    assert mean_curvature(forms)[0] == pytest.approx((parallel + 2.0) / 2, abs=1e-12)
    assert gaussian_curvature(forms)[0] == pytest.approx(2.0 * parallel, abs=1e-12)
    principal = principal_curvatures(du, dv, forms)
    assert (principal.k_min[0], principal.k_max[0]) == pytest.approx((parallel, 2.0))
    meridian = dv[0] / np.linalg.norm(dv)
    assert abs(principal.direction_max[0] @ meridian) == pytest.approx(1.0)
    swapped = np.cross(unit_normals(du, dv), principal.direction_max)
    np.testing.assert_allclose(principal.direction_min, swapped, atol=1e-12)
