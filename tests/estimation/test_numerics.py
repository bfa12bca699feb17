"""The kernels against the same fits to 150 digits, on neighbourhoods that are as bad as they come."""

import mpmath
import numpy as np
import pytest
from bad_meshes import MAKERS, ball
from high_precision import exact_fit
from mesh_mutations import mutated

from bezier_filters import estimate_vertex_geometry
from bezier_filters.status import FitStatus

ROUNDOFF = 2.0**-53
MESHES = ("ball", "needle", "tiny", "far_away", "spikes", "slivers", "moebius_strip")
ALPHAS = (0.8, 1.0, 1e-6, 1.0 - 1e-9)


def errors(vertices, faces, alpha, count, rng):
    """Errors of normals and curvatures as parts of the bound, and condition numbers found and exact."""
    geometry = estimate_vertex_geometry(vertices, faces, rings=2, alpha=alpha)
    conditions = estimate_vertex_geometry(vertices, faces, rings=2, alpha=alpha, conditions=True).condition_number
    fitted = np.flatnonzero(geometry.status == FitStatus.OK)
    if not len(fitted):
        return
    worst = fitted[np.argmax(conditions[fitted])]
    for i in {int(worst), *rng.choice(fitted, min(count, len(fitted)), replace=False).tolist()}:
        try:
            normal, k_min, k_max, condition, (far, width, sharpest) = exact_fit(vertices, faces, i, 2, alpha)
        except ValueError:  # several directions of the x axis are as good
            continue
        bound = condition**2 * ROUNDOFF * sharpest * far / width
        turned = mpmath.sqrt(sum((a - float(b)) ** 2 for a, b in zip(normal, geometry.normals[i], strict=True)))
        bent = max(abs(k_min - float(geometry.k_min[i])), abs(k_max - float(geometry.k_max[i])))
        yield float(turned / bound), float(bent * width / bound), conditions[i], float(condition)


def check(vertices, faces, alpha, count, rng):
    found = list(errors(np.asarray(vertices, dtype=float), np.asarray(faces), alpha, count, rng))
    for of_normal, of_curvature, condition, exact_condition in found:
        assert of_normal < 1.0
        assert of_curvature < 1.0
        if alpha > 1e-3:  # where smoothness is nearly all, it follows from the direction of the x axis
            assert condition == pytest.approx(exact_condition, rel=1e-5)
    return found


@pytest.mark.parametrize("name", MESHES)
def test_rounding_errors_stay_within_the_bound(name):
    rng = np.random.default_rng(0)
    vertices, faces = MAKERS[name]()
    assert sum(len(check(vertices, faces, alpha, 1, rng)) for alpha in ALPHAS)


@pytest.mark.slow
def test_rounding_errors_of_hundreds_of_damaged_meshes():
    rng = np.random.default_rng(0)
    found = []
    for seed in range(400):
        vertices, faces = mutated(seed)
        if len(faces) and np.isfinite(vertices).all() and 1e-40 < np.abs(vertices).max() < 1e40:
            found += check(vertices, faces, ALPHAS[seed % 4], 2, rng)
    assert len(found) > 400
    print(f"{len(found)} fits; largest parts of the bound: {np.max(found, axis=0)[:2]}; largest condition: ", end="")
    print(max(condition for *_, condition in found))


class TestConditionNumbers:
    @pytest.mark.parametrize(
        "options", [{}, {"rings": 2, "alpha": 0.8}, {"smoothness": "paper"}, {"radius": 0.6}, {"robust": True}]
    )
    def test_every_fit_has_one(self, options):
        vertices, faces = MAKERS["unreferenced_vertices"]()
        geometry = estimate_vertex_geometry(vertices, faces, conditions=True, **options)
        fitted = geometry.status <= FitStatus.FOLDED
        assert (geometry.condition_number[fitted] >= 6).all()  # the number of coefficients, or more
        assert np.isfinite(geometry.condition_number).all()
        assert not geometry.condition_number[~fitted].any()

    def test_scale_does_not_matter(self):
        vertices, faces = ball()
        found, scaled = (
            estimate_vertex_geometry(v, faces, conditions=True).condition_number for v in (vertices, 1e9 * vertices)
        )
        np.testing.assert_allclose(found, scaled, rtol=1e-6)

    def test_asking_for_them_changes_the_rest_by_rounding_only(self):
        vertices, faces = ball()
        without, with_them = (estimate_vertex_geometry(vertices, faces, conditions=asked) for asked in (False, True))
        assert without.condition_number is None
        np.testing.assert_allclose(with_them.normals, without.normals, atol=1e-10)
        np.testing.assert_allclose(with_them.mean_curvature, without.mean_curvature, atol=1e-8)

    def test_vertices_that_are_not_selected_have_none(self):
        vertices, faces = ball()
        selected = np.arange(len(vertices)) % 3 == 0
        found = estimate_vertex_geometry(vertices, faces, selected=selected, conditions=True).condition_number
        np.testing.assert_array_equal(found > 0, selected)
