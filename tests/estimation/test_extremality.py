"""Derivatives of the principal curvatures along their directions, against several other ways to get them."""

import numpy as np
import pytest
from fundamental_forms import fundamental_forms, principal_curvatures
from graph_fits import fit_over_plane_z, geometry_of_graph
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from bezier_filters import FitStatus, PatchFit, estimate_vertex_geometry
from bezier_filters.surfaces import ellipsoid, sphere, torus

CUBIC = [(a, b) for a in range(4) for b in range(4 - a)]
EXTREMALITIES = ("extremality_min", "extremality_max")


def polynomial(coefficients, x, y, dx=0, dy=0):
    """Derivatives of sum c_ab x^a y^b."""
    c = np.zeros((4, 4))
    c[tuple(np.transpose(CUBIC))] = coefficients
    for axis, order in enumerate((dx, dy)):
        c = np.polynomial.polynomial.polyder(c, order, axis=axis)
    return np.polynomial.polynomial.polyval2d(x, y, c)


def curvatures_of_graph(coefficients, x, y):
    """k_min and k_max of the graph at points (x, y), by the fundamental forms."""
    d = {o: polynomial(coefficients, x, y, *o) for o in [(1, 0), (0, 1), (2, 0), (1, 1), (0, 2)]}
    one, zero = np.ones_like(x), np.zeros_like(x)
    du, dv = np.stack([one, zero, d[1, 0]], axis=1), np.stack([zero, one, d[0, 1]], axis=1)
    second = [np.stack([zero, zero, d[o]], axis=1) for o in [(2, 0), (1, 1), (0, 2)]]
    principal = principal_curvatures(du, dv, fundamental_forms(du, dv, *second))
    return principal.k_min, principal.k_max


def derivative_along(curvature, x, y, direction):
    """Derivative of a function of (x, y) along world directions (n, 3), by differences of sixth order.

    The curvature is a function on the surface, so moving (x, y) by the direction's own x and y is
    moving along the surface.
    """
    h = 2e-3
    weights = np.array([-1, 9, -45, 45, -9, 1]) / (60 * h)
    steps = h * np.array([-3, -2, -1, 1, 2, 3])
    return sum(
        w * curvature(x + s * direction[:, 0], y + s * direction[:, 1]) for w, s in zip(weights, steps, strict=True)
    )


@settings(max_examples=40)
@given(st.tuples(*[st.floats(-1, 1)] * 10), st.floats(-0.5, 0.5), st.floats(-0.5, 0.5))
def test_formula_equals_numerical_differentiation_of_the_curvature_of_a_graph(coefficients, x, y):
    """The gradient is not zero: the terms with Christoffel symbols matter."""
    jet = np.zeros((4, 4))
    for r, q in CUBIC:
        jet[r, q] = polynomial(coefficients, x, y, r, q)
    result = geometry_of_graph(jet)
    assume(result.k_max - result.k_min > 0.5)  # near umbilics the differences are not accurate
    at = np.array([x]), np.array([y])
    for k, (value, direction) in enumerate(
        [(result.extremality_min, result.direction_min), (result.extremality_max, result.direction_max)]
    ):
        expected = derivative_along(
            lambda a, b, k=k: curvatures_of_graph(coefficients, a, b)[k], *at, direction[np.newaxis]
        )
        assert value == pytest.approx(expected[0], abs=1e-6)


@settings(max_examples=40)
@given(st.tuples(*[st.floats(-0.7, 0.7)] * 10), st.integers(0, 20), st.sampled_from([3, 4]))
def test_cubics_have_exact_extremalities(coefficients, seed, degree):
    """Fitted over the plane z = 0, which is not tangent anywhere."""
    x, y = np.random.default_rng(seed).uniform(-1, 1, (2, 150))
    z = polynomial(coefficients, x, y)
    geometry = fit_over_plane_z(x, y, z, PatchFit(degree, 1.0), 5)
    rows = (geometry.status == FitStatus.OK) & (geometry.geodesic_torsion > 0.25)
    assert (geometry.status == FitStatus.OK).mean() > 0.5
    for k, end in enumerate(("min", "max")):
        expected = derivative_along(
            lambda a, b, k=k: curvatures_of_graph(coefficients, a, b)[k],
            x[rows],
            y[rows],
            getattr(geometry, f"direction_{end}")[rows],
        )
        np.testing.assert_allclose(getattr(geometry, f"extremality_{end}")[rows], expected, atol=2e-6)


def ellipsoid_extremalities(surface, axes):
    """Both extremalities of an ellipsoid at its vertices, along the directions of the surface.

    The curvatures of the level sets of F = |x / axes|^2 are functions in space; a step along a
    tangent leaves the level set only to second order, so their derivatives are those on the surface.
    """
    h = 1e-4 * min(axes)

    def curvatures(points):
        gradients = 2 * points / np.square(axes)
        hessians = np.broadcast_to(np.diag(2 / np.square(axes)), (len(points), 3, 3))
        return type(surface).from_level_set(points, surface.faces, gradients, hessians)

    return {
        f"extremality_{end}": (
            getattr(curvatures(surface.vertices + h * getattr(surface, f"direction_{end}")), f"k_{end}")
            - getattr(curvatures(surface.vertices - h * getattr(surface, f"direction_{end}")), f"k_{end}")
        )
        / (2 * h)
        for end in ("min", "max")
    }


def ellipsoid_errors(resolution, **options):
    """Root mean square errors of both extremalities away from the umbilics, relative to their size."""
    axes = (1.0, 0.8, 0.5)
    surface = ellipsoid(semi_axes=axes, resolution=resolution, jitter=0.3)
    geometry = estimate_vertex_geometry(surface.vertices, surface.faces, **options)
    expected = ellipsoid_extremalities(surface, axes)
    rows = surface.geodesic_torsion > 0.2 * surface.geodesic_torsion.max()
    errors = []
    for end in ("min", "max"):
        found, true = getattr(geometry, f"extremality_{end}"), expected[f"extremality_{end}"]
        lines = np.einsum("ij,ij->i", getattr(geometry, f"direction_{end}"), getattr(surface, f"direction_{end}"))
        errors.append(np.linalg.norm((found * np.sign(lines) - true)[rows]) / np.linalg.norm(true[rows]))
    return errors


@pytest.mark.parametrize(
    ("options", "order", "finest"),
    [({"rings": 2, "alpha": 1.0}, 0.8, 0.4), ({}, 3.0, 0.001)],
    ids=["bicubic", "automatic"],
)
def test_convergence_on_an_ellipsoid(options, order, finest):
    resolutions = (10, 15, 22, 32)
    table = np.array([ellipsoid_errors(resolution, **options) for resolution in resolutions])
    slopes = np.polyfit(-np.log(resolutions), np.log(table), 1)[0]
    assert slopes.min() >= order
    assert table[-1].max() <= finest


@pytest.mark.parametrize("make", [sphere, torus])
def test_cyclides_have_none(make):
    """Cyclides of Dupin, of which spheres and tori are special ones: both curvatures are constant along their lines."""
    surface = make(resolution=50, jitter=0.3)
    geometry = estimate_vertex_geometry(surface.vertices, surface.faces)
    for name in EXTREMALITIES:
        assert np.sqrt(np.mean(getattr(geometry, name) ** 2)) < 0.01 * surface.k_max.max() ** 2


class TestTransformations:
    surface = ellipsoid(semi_axes=(1.0, 0.8, 0.5), resolution=10, jitter=0.3)

    def estimate(self, vertices, faces):
        return estimate_vertex_geometry(vertices, faces, rings=2, alpha=0.9)

    def test_orientation_flip_swaps_them(self):
        surface = self.surface
        before = self.estimate(surface.vertices, surface.faces)
        after = self.estimate(surface.vertices, surface.faces[:, ::-1])
        distinct = before.geodesic_torsion > 1e-3
        along = np.einsum("ij,ij->i", after.direction_max, before.direction_min)  # +1 or -1
        np.testing.assert_allclose(
            after.extremality_max[distinct], (-along * before.extremality_min)[distinct], atol=1e-9
        )

    def test_motion_and_scale(self):
        surface = self.surface
        turn = np.linalg.qr(np.random.default_rng(0).standard_normal((3, 3)))[0]
        turn *= np.linalg.det(turn)
        before = self.estimate(surface.vertices, surface.faces)
        after = self.estimate(100.0 * surface.vertices @ turn.T + 7.0, surface.faces)
        distinct = before.geodesic_torsion > 1e-3
        for end in ("min", "max"):
            along = np.einsum(
                "ij,ij->i", getattr(after, f"direction_{end}"), getattr(before, f"direction_{end}") @ turn.T
            )
            expected = along * getattr(before, f"extremality_{end}")
            np.testing.assert_allclose(
                1e4 * getattr(after, f"extremality_{end}")[distinct], expected[distinct], atol=1e-8
            )


def test_where_nothing_is_known_of_third_derivatives_they_are_zero():
    surface = ellipsoid(resolution=6)
    quadratic = estimate_vertex_geometry(surface.vertices, surface.faces, rings=2, degree=2, alpha=1.0)
    assert quadratic.mean_curvature.all()
    triangle = estimate_vertex_geometry(np.eye(3), [[0, 1, 2]])
    for name in EXTREMALITIES:
        assert not getattr(quadratic, name).any()
        assert not getattr(triangle, name).any()
