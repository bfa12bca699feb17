import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bezier_filters import BezierPatch, InvalidParameterError, ParameterRectangle, PatchFit, fit_patch


def random_patch(degree, seed):
    rng = np.random.default_rng(seed)
    axes = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    axes[2] *= np.linalg.det(axes)
    rectangle = ParameterRectangle(-1.3, 0.4, 2.0, 3.0)
    return BezierPatch(rng.standard_normal(3), axes, rectangle, rng.standard_normal((degree + 1, degree + 1)))


def de_casteljau(net, u, v):
    """A second way to evaluate: repeated interpolation of the control net."""
    while net.shape[0] > 1:
        net = (1 - u) * net[:-1] + u * net[1:]
    while net.shape[1] > 1:
        net = (1 - v) * net[:, :-1] + v * net[:, 1:]
    return net[0, 0]


patches = st.builds(random_patch, st.sampled_from([2, 3, 4]), st.integers(0, 99))
unit = st.floats(0, 1)


@given(patches, unit, unit)
def test_evaluate_agrees_with_de_casteljau(patch, u, v):
    point = patch.evaluate(np.array([u]), np.array([v]))[0]
    np.testing.assert_allclose(point, de_casteljau(patch.control_net, u, v), atol=1e-12)


@given(patches, st.floats(0.1, 0.9), st.floats(0.1, 0.9), st.sampled_from([(1, 0), (0, 1), (1, 1), (2, 0)]))
def test_derivatives_agree_with_differences(patch, u, v, order):
    h = 1e-3
    stencil = {0: ([0.0], [1.0]), 1: ([-h, h], [-0.5 / h, 0.5 / h]), 2: ([-h, 0.0, h], [h**-2, -2 * h**-2, h**-2])}
    (us, wu), (vs, wv) = stencil[order[0]], stencil[order[1]]
    expected = sum(
        a * b * patch.evaluate(np.array([u + du]), np.array([v + dv]))
        for du, a in zip(us, wu, strict=True)
        for dv, b in zip(vs, wv, strict=True)
    )
    np.testing.assert_allclose(patch.evaluate(np.array([u]), np.array([v]), order), expected, atol=2e-3)


@given(patches, unit, unit)
def test_parameters_invert_evaluate(patch, u, v):
    found = patch.parameters(patch.evaluate(np.array([u]), np.array([v])))
    np.testing.assert_allclose(np.ravel(found), [u, v], atol=1e-12)


@given(patches)
def test_world_and_local_coordinates_are_inverse(patch):
    points = np.random.default_rng(1).standard_normal((5, 3))
    np.testing.assert_allclose(patch.to_world(patch.to_local(points)), points, atol=1e-12)


def test_corners_of_the_control_net_lie_on_the_patch():
    patch = random_patch(3, 4)
    corners = patch.evaluate(np.array([0.0, 0.0, 1.0, 1.0]), np.array([0.0, 1.0, 0.0, 1.0]))
    np.testing.assert_allclose(corners, patch.control_net[[0, 0, -1, -1], [0, -1, 0, -1]])


def bicubic(x, y, coefficients):
    return np.polynomial.polynomial.polyval2d(x, y, coefficients)


@pytest.mark.parametrize("smoothness", ["paper", "third_order"])
def test_bicubic_heights_are_reproduced_without_smoothing(smoothness):
    rng = np.random.default_rng(2)
    x, y = rng.uniform(-1, 1, (2, 40))
    coefficients = rng.standard_normal((4, 4))
    points = np.column_stack([x, y, bicubic(x, y, coefficients)])
    patch = fit_patch(points, np.zeros(3), np.eye(3), PatchFit(alpha=1.0, smoothness=smoothness))
    np.testing.assert_allclose(patch.evaluate(*patch.parameters(points)), points, atol=1e-9)


@given(st.floats(0.01, 1.0), st.sampled_from([2, 3, 4]), st.integers(0, 50))
def test_quadratic_heights_are_reproduced_at_every_alpha(alpha, degree, seed):
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-1, 1, (2, 60))
    points = np.column_stack([x, y, 1 + x - 2 * y + 3 * x * x - x * y + 0.5 * y * y])
    patch = fit_patch(points, np.zeros(3), np.eye(3), PatchFit(degree, alpha))
    np.testing.assert_allclose(patch.evaluate(*patch.parameters(points)), points, atol=1e-9)


def test_too_few_points_are_refused_with_a_remedy():
    points = np.random.default_rng(0).standard_normal((5, 3))
    with pytest.raises(InvalidParameterError, match="5 points determine only 15 of 16"):
        fit_patch(points, np.zeros(3), np.eye(3))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"degree": 5}, "degree: got 5"),
        ({"alpha": 0.0}, r"alpha: got 0.0, expected a number in \(0, 1\]"),
        ({"alpha": 1.001}, "alpha: got 1.001"),
        ({"alpha": float("nan")}, "alpha: got nan"),
        ({"smoothness": "none"}, "smoothness: got 'none'"),
    ],
)
def test_settings_out_of_range_are_refused(options, message):
    with pytest.raises(InvalidParameterError, match=message):
        PatchFit(**options)


@pytest.mark.parametrize("smoothness", ["paper", "third_order"])
@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_fits_move_turn_and_grow_with_their_points(size, smoothness):
    rng = np.random.default_rng(3)
    local = rng.uniform(-1, 1, (40, 3))
    patch = fit_patch(local, np.zeros(3), np.eye(3), PatchFit(smoothness=smoothness))
    axes, origin = np.linalg.qr(rng.standard_normal((3, 3)))[0], 5.0 * size * rng.standard_normal(3)
    other = fit_patch(origin + size * local @ axes, origin, axes, PatchFit(smoothness=smoothness))
    u, v = rng.uniform(size=(2, 20))
    np.testing.assert_allclose(other.evaluate(u, v), origin + size * patch.evaluate(u, v) @ axes, atol=1e-9 * size)


def test_the_square_of_a_patch_holds_its_points_in_every_direction_of_its_axes():
    x, y = np.array([0.3, 0.0, -0.1]), np.array([0.4, -0.2, 0.1])
    square = ParameterRectangle.centred(x, y)
    assert (square.x, square.y, square.width, square.height) == pytest.approx((-0.5, -0.5, 1.0, 1.0))
