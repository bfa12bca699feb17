"""Predicted errors, against the errors of the kernel on surfaces drawn from the model."""

from dataclasses import replace

import numpy as np
import pytest
from random_neighbourhoods import analyse_ring, as_sample, draw, fit_stars, variances_by_degree

from bezier_filters import FitStatus, estimate_vertex_geometry
from bezier_filters.noise.noise_model import NoiseModel, ring_noise
from bezier_filters.surface_model import fit_spec as fit_spec_module
from bezier_filters.surface_model.fit_spec import (
    MIN_ERROR_DROP,
    VERTEX_TIME,
    WEIGHTED_RINGS,
    FitSpec,
    best_spec,
    best_specs,
    candidate_specs,
    predict_under_model,
    prefer_cubic,
    specs_to_first_minimum,
)
from bezier_filters.surface_model.model import RingModel, SurfaceModel
from bezier_filters.surface_model.quartic_mean import zero_quartic_mean
from bezier_filters.surfaces import height_field, sphere

RADIUS = 1.0
SIZE, COUNT = 37, 500  # points of a 3-ring
SMALL = 1e-5  # heights, so that normals and curvatures are linear in them

CALM = SMALL**2 * variances_by_degree(0.03, 0.1), SMALL
BETWEEN = SMALL**2 * variances_by_degree(0.3, 0.2), 0.3 * SMALL
ROUGH = SMALL**2 * variances_by_degree(1.0, 0.5), 0.01 * SMALL


def surface_model(points, variances, sigma, rings=3):
    """The model with the true variances."""
    analysis = analyse_ring(as_sample(points, rings), rings, len(points))
    noise = NoiseModel(sigma**2)
    return SurfaceModel(
        noise, (RingModel(analysis, ring_noise(noise, analysis), variances, variances, 0.0, zero_quartic_mean()),)
    )


def errors_of_the_kernel(spec, drawn):
    """Root mean square errors of slope and of the second derivatives, both as norms."""
    gradients, hessians = fit_stars(drawn, replace(spec, rings=1))
    x, y, c, s, r = drawn.coefficients[:, 1:6].T  # slopes; x^2 - y^2, 2 x y and x^2 + y^2
    slope = np.column_stack([x, y]) / drawn.radius
    second = 2.0 * np.array([[r + c, s], [s, r - c]]).transpose(2, 0, 1) / drawn.radius**2
    return (
        np.sqrt(np.mean(np.sum((gradients - slope) ** 2, axis=1))),
        np.sqrt(np.mean(np.sum((hessians - second) ** 2, axis=(1, 2)))),
    )


@pytest.mark.parametrize("radius", [1.0, 0.1])
@pytest.mark.parametrize(("variances", "sigma"), [CALM, BETWEEN, ROUGH], ids=["calm", "between", "rough"])
def test_predicted_errors_are_those_of_the_kernel(variances, sigma, radius, monkeypatch):
    """For every degree, prior and weight that could be tried."""
    monkeypatch.setattr(fit_spec_module, "MAX_ERROR_RATIO", np.inf)
    drawn = draw(COUNT, SIZE, variances, sigma, radius=radius, seed=4)
    model = surface_model(drawn.points, variances, sigma)
    specs = [*candidate_specs(model, model.by_rings[0]), *candidate_specs(model, model.by_rings[0], (2,))]
    for spec in specs:
        normal, curvature = errors_of_the_kernel(spec, drawn)
        assert spec.normal_error == pytest.approx(normal, rel=0.15)
        assert spec.curvature_error == pytest.approx(curvature, rel=0.15)
    assert {spec.degree for spec in specs} == {2, 3, 4, 5, 6}
    errors = [spec.error for spec in specs]
    if sigma < SMALL:  # otherwise all plans are alike
        assert max(errors) > 1.3 * min(errors), "the plans differ by more than the tolerance"


def test_weights_are_tried_where_a_degree_leaves_much_out_and_help_there(monkeypatch):
    monkeypatch.setattr(fit_spec_module, "MAX_ERROR_RATIO", np.inf)
    drawn = draw(200, SIZE, *ROUGH)
    specs = candidate_specs(model := surface_model(drawn.points, *ROUGH), model.by_rings[0])
    weighted = [spec for spec in specs if np.isfinite(spec.weight_radius)]
    assert {spec.degree for spec in weighted} == {3, 4, 5, 6}
    equal = {spec.degree: spec.error for spec in reversed(specs) if np.isinf(spec.weight_radius)}
    assert all(spec.error < equal[spec.degree] for spec in weighted)
    calm = surface_model(draw(200, SIZE, *CALM).points, *CALM)
    assert not any(
        np.isfinite(spec.weight_radius) and spec.degree > 3 for spec in candidate_specs(calm, calm.by_rings[0])
    )
    wide = surface_model(drawn.points, *ROUGH, rings=WEIGHTED_RINGS + 1)
    assert all(np.isinf(spec.weight_radius) for spec in candidate_specs(wide, wide.by_rings[0]))


@pytest.mark.parametrize(("variances", "sigma"), [CALM, BETWEEN, ROUGH], ids=["calm", "between", "rough"])
def test_degrees_that_are_not_tried_would_not_be_chosen(variances, sigma, monkeypatch):
    model = surface_model(draw(200, SIZE, variances, sigma).points, variances, sigma)
    found = best_spec(tried := candidate_specs(model, model.by_rings[0]))
    monkeypatch.setattr(fit_spec_module, "MAX_ERROR_RATIO", np.inf)
    every = candidate_specs(model, model.by_rings[0])
    assert (found.degree, found.weight_radius) == (best_spec(every).degree, best_spec(every).weight_radius)
    assert (len(tried) < len(every)) == (variances is ROUGH[0]), "only there low degrees are much worse"


def test_the_learned_prior_is_better_than_any_other_factor_of_it():
    """With degree 6, which leaves little out."""
    variances, sigma = BETWEEN
    drawn = draw(100, SIZE, variances, sigma)
    model = surface_model(drawn.points, variances, sigma)
    best = next(spec for spec in candidate_specs(model, model.by_rings[0]) if spec.degree == 6)
    for factor in (0.1, 10.0):
        other = predict_under_model(replace(best, term_prior=factor * best.term_prior), model)
        assert other.normal_error > best.normal_error
        assert other.curvature_error > best.curvature_error


def test_errors_scale_with_the_noise_and_what_it_is_asked_about():
    variances, sigma = CALM
    drawn = draw(50, SIZE, variances, sigma)
    model = surface_model(drawn.points, variances, sigma)
    spec = best_specs(model)[0]
    noise = NoiseModel(4.0 * sigma**2)
    ring = replace(model.by_rings[0], noise=ring_noise(noise, model.by_rings[0].analysis), variances=4.0 * variances)
    twice = SurfaceModel(noise, (ring,))
    assert predict_under_model(spec, twice).normal_error == pytest.approx(2.0 * spec.normal_error)
    assert predict_under_model(spec, twice).curvature_error == pytest.approx(2.0 * spec.curvature_error)
    assert predict_under_model(replace(spec, rings=7), twice) is None


def plan_with(rings, degree, error):
    return FitSpec(rings, degree, 1.0, 1.0, np.zeros(0), np.inf, error, error)


@pytest.mark.parametrize(("overhead", "ratio"), [(0.0, 1.5), (0.0, 2.0), (1e4, 1.2)])
def test_twice_the_time_must_take_a_fifth_off_the_error(overhead, ratio):
    """The time of finding the plans counts, too."""
    fast = replace(plan_with(8, 4, 1.0), overhead=overhead)
    rings = np.sqrt((ratio * fast.cost - fast.cost) / (fast.cost - overhead - VERTEX_TIME) + 1.0) * 8
    slow = replace(plan_with(rings, 4, 0.97 * 0.785 ** np.log2(ratio)), overhead=overhead)
    assert slow.cost == pytest.approx(ratio * fast.cost)
    assert best_spec([fast, slow]) is slow
    assert best_spec([fast, replace(plan_with(rings, 4, 1.03 * 0.785 ** np.log2(ratio)), overhead=overhead)]) is fast


@pytest.mark.parametrize(
    ("errors", "rings"),
    [
        ([1.3, 1.1, 1.2, 1.15, 1.0], [2]),  # a valley at 2 rings, and one that is hardly lower
        ([2.3, 2.1, 2.3, 1.15, 1.0], [2, 3, 4, 5]),  # far lower
        ([1.3, 1.1, 1.14, 1.0, 1.2], [2, 3, 4]),  # no rise between them
        ([0.5, 1.0, 0.9, 0.8, 0.7], [2, 3, 4, 5]),  # of second order, with one ring: nobody asks
    ],
)
def test_under_correlated_noise_detail_is_kept_if_it_costs_little(errors, rings):
    specs = [plan_with(k, min(k + 1, 3), error) for k, error in enumerate(errors, 1)]
    assert [spec.rings for spec in specs_to_first_minimum(specs)] == rings
    narrow = specs[:1]
    assert specs_to_first_minimum(narrow) == narrow


@pytest.mark.parametrize("sills", [(), (SMALL**2,)], ids=["white", "correlated"])
@pytest.mark.parametrize("rings", [2, 3])
def test_narrow_rings_keep_the_third_order_under_correlated_noise_unless_that_is_far_worse(rings, sills):
    """The errors of fourth order are made up; those of third order follow from the model."""
    points = draw(100, SIZE, *BETWEEN).points
    noise = NoiseModel(SMALL**2, sills=sills, lengths=tuple(0.5 for _ in sills))
    analysis = analyse_ring(as_sample(points, rings), rings, len(points))
    model = SurfaceModel(
        noise, (RingModel(analysis, ring_noise(noise, analysis), BETWEEN[0], BETWEEN[0], 0.0, zero_quartic_mean()),)
    )
    third = candidate_specs(model, model.by_rings[0], (3,))[0]
    for factor in (1.1, 0.9):
        curvature, normal = (factor / MIN_ERROR_DROP * error for error in (third.curvature_error, third.normal_error))
        fourth = replace(third, degree=4, normal_error=normal, curvature_error=curvature)
        kept = rings == 2 and bool(sills) and factor > 1.0
        assert prefer_cubic(model, fourth).degree == (3 if kept else 4)
        assert prefer_cubic(model, third) is third


def test_a_single_degree_is_taken_even_where_the_points_do_not_determine_it():
    drawn = draw(50, 9, *CALM)
    model = surface_model(drawn.points, *CALM)
    assert {spec.degree for spec in candidate_specs(model, model.by_rings[0], [6])} == {6}
    assert {spec.degree for spec in candidate_specs(model, model.by_rings[0])} == {2}


def test_a_vertex_far_away_gives_no_warning_and_finite_results():
    """It makes the neighbourhoods around it singular."""
    ball = sphere(resolution=12)
    vertices = ball.vertices.copy()
    vertices[0] *= 100.0
    geometry = estimate_vertex_geometry(vertices, ball.faces)
    for name in ("k_min", "k_max", "normals", "residual", "mean_curvature_std", "normal_std"):
        assert np.isfinite(getattr(geometry, name)).all()
    far = ball.normals @ ball.normals[0] < 0.0
    assert np.abs(geometry.mean_curvature[far] - 1.0).max() < 0.05


def test_a_flat_lattice_without_any_noise_is_flat():
    plane = height_field(lambda x, y: [0.0 * x] * 6, resolution=24)
    geometry = estimate_vertex_geometry(plane.vertices, plane.faces)
    assert geometry.noise_sigma == 0.0
    assert set(geometry.status) <= {FitStatus.OK, FitStatus.WIDER_RING}  # the latter at its rim
    assert np.abs(geometry.k_max).max() == 0.0
    assert np.isfinite(geometry.mean_curvature_std).all()
