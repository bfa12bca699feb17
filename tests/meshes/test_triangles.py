"""Formulas for triangles next to trigonometry."""

import numpy as np
import pytest
from compiled import from_python
from hypothesis import given
from hypothesis import strategies as st

from bezier_filters.meshes.triangles import (
    angle_parts,
    area_vectors,
    cosine_between,
    cotangent_and_area,
    longest_squared,
    next_corner,
    unit_normal,
)

lengths, angles = st.floats(0.1, 10.0), st.floats(0.1, 3.0)


def triangle(left, right, angle, seed):
    """A tip with two sides of given lengths and the angle between them, turned at random, and its unit normal."""
    turn = np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))[0]
    points = np.array([[0.0, 0.0, 0.0], [left, 0.0, 0.0], [right * np.cos(angle), right * np.sin(angle), 0.0]])
    return points @ turn.T + turn[0], turn[:, 2] * np.linalg.det(turn)


@given(lengths, lengths, angles, st.integers(0, 20))
def test_corners_have_their_angles_and_areas(left, right, angle, seed):
    points, normal = triangle(left, right, angle, seed)
    area = 0.5 * left * right * np.sin(angle)
    cosine, sine = from_python(angle_parts)(points, 0, 1, 2)
    assert np.arctan2(sine, cosine) == pytest.approx(angle, abs=1e-9)
    assert from_python(cotangent_and_area)(points, 0, 1, 2) == pytest.approx((1.0 / np.tan(angle), area), abs=1e-9)
    faces = np.array([[0, 1, 2]])
    np.testing.assert_allclose(area_vectors(points, faces)[0], 2.0 * area * normal, atol=1e-9)
    np.testing.assert_allclose(from_python(unit_normal)(points, 0, 1, 2), [*normal, 2.0 * area], atol=1e-9)
    opposite = left**2 + right**2 - 2.0 * left * right * np.cos(angle)
    assert from_python(longest_squared)(points, faces, 0) == pytest.approx(max(left**2, right**2, opposite))


@given(st.floats(0.0, np.pi), lengths)
def test_the_angle_between_two_faces_is_that_of_their_fold(angle, length):
    points = np.array([[0, 0, 0], [length, 0, 0], [0.2, 1, 0], [0.7, -np.cos(angle), np.sin(angle)]], dtype=float)
    found = from_python(cosine_between)(points, 0, 1, 2, 1, 0, 3, 7.0)
    assert found == pytest.approx(np.cos(angle), abs=1e-12)
    assert from_python(cosine_between)(points, 0, 1, 1, 1, 0, 3, 7.0) == 7.0


def test_without_an_area_there_is_no_normal():
    points = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0]], dtype=float)
    assert from_python(unit_normal)(points, 0, 1, 2) == (0.0, 0.0, 0.0, 0.0)


def test_the_corner_after_each_is_the_next_one():
    faces = np.array([[7, 3, 5]])
    assert [from_python(next_corner)(faces, 0, i) for i in (7, 3, 5)] == [3, 5, 7]
