import numpy as np
import pytest

from bezier_filters import InvalidParameterError
from bezier_filters.patches.bernstein import design_matrix
from bezier_filters.patches.smoothness import smoothness_matrix


def coefficients_of(polynomial, degree):
    """Bernstein coefficients of a polynomial in (s, t) on [-1, 1]^2, by interpolation."""
    s, t = (a.ravel() for a in np.meshgrid(np.linspace(-1, 1, 9), np.linspace(-1, 1, 9)))
    matrix = design_matrix((s + 1) / 2, (t + 1) / 2, degree)
    return np.linalg.lstsq(matrix, polynomial(s, t), rcond=None)[0]


def test_paper_rows_are_the_second_differences_of_the_four_boundary_polygons():
    # written out by hand, index 4 i + j, from the control points that each row names
    triples = ["00 01 02", "01 02 03", "00 10 20", "10 20 30", "30 31 32", "31 32 33", "03 13 23", "13 23 33"]
    expected = np.zeros((8, 16))
    for row, triple in zip(expected, triples, strict=True):
        for point, value in zip(triple.split(), (1.0, -2.0, 1.0), strict=True):
            row[4 * int(point[0]) + int(point[1])] = value
    actual = smoothness_matrix("paper", 3)
    assert {tuple(row) for row in actual} == {tuple(row) for row in expected}


def test_paper_smoothness_leaves_bilinear_and_inner_control_points_free():
    rows = smoothness_matrix("paper", 3)
    assert np.linalg.matrix_rank(rows) == 8
    for i in (1, 2):
        for j in (1, 2):
            assert not rows[:, 4 * i + j].any()
    assert np.abs(rows @ coefficients_of(lambda s, t: 1 + s - 2 * t + s * t, 3)).max() < 1e-12


def test_paper_smoothness_penalises_quadratics():
    """Why the paper's curvature is biased at every resolution."""
    assert np.abs(smoothness_matrix("paper", 3) @ coefficients_of(lambda s, t: s * s, 3)).max() > 0.1


@pytest.mark.parametrize("degree", [2, 3, 4])
def test_third_order_leaves_exactly_the_quadratics_free(degree):
    rows = smoothness_matrix("third_order", degree)
    assert rows.shape == ((degree + 1) ** 2 - 6, (degree + 1) ** 2)
    assert np.linalg.matrix_rank(rows) == len(rows)
    for quadratic in (lambda s, t: 0 * s + 1, lambda s, t: s - t, lambda s, t: s * s + 3 * s * t - t * t):
        assert np.abs(rows @ coefficients_of(quadratic, degree)).max() < 1e-11


def test_third_order_energy_of_a_cubic_does_not_change_when_the_axes_turn():
    rows = smoothness_matrix("third_order", 3)
    coefficient = np.random.default_rng(0).standard_normal(4)

    def turned(angle):
        c, s = np.cos(angle), np.sin(angle)

        def cubic(x, y):
            a, b = c * x - s * y, s * x + c * y
            return coefficient @ np.array([a**3, a * a * b, a * b * b, b**3])

        return cubic

    energies = [np.sum((rows @ coefficients_of(turned(angle), 3)) ** 2) for angle in (0.0, 0.3, 1.1, 2.5)]
    np.testing.assert_allclose(energies, energies[0], rtol=1e-10)


def test_unknown_name_is_refused():
    with pytest.raises(InvalidParameterError, match=r"smoothness: got 'thin_plate'.*third_order"):
        smoothness_matrix("thin_plate", 3)
