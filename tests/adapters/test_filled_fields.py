"""Fields after holes were filled: old rows stay, new ones go on from the rims, and what is new is marked."""

import numpy as np
import pytest
from hole_cases import sheet, without_faces_near, without_squares

from bezier_filters.surfaces import torus
from bezier_filters_adapters.filled_fields import NEW, Fill
from bezier_filters_adapters.filters import FILL_HOLES, run


@pytest.fixture(scope="module")
def flat():
    """A flat sheet whose hole is filled, where linear fields are continued exactly."""
    vertices, faces = sheet(12, 10)
    faces = without_squares(vertices, faces, lambda x, y: np.hypot(x - 6.0, y - 5.0) < 3.0)
    result = run(FILL_HOLES, vertices, faces, {})
    assert len(result.vertices) > len(vertices)
    return vertices, faces, result


def test_marks(flat):
    vertices, faces, result = flat
    assert result.fill == Fill(result.vertices, result.faces, len(vertices), len(faces))
    assert list(result.fields) == [NEW] == ["bz_new"]
    np.testing.assert_array_equal(result.fields[NEW], np.arange(len(result.vertices)) >= len(vertices))


@pytest.mark.parametrize("kind", [np.float64, np.float32])
@pytest.mark.parametrize("columns", [(), (2,), (2, 2)])
def test_numbers_are_continued(flat, kind, columns):
    vertices, _, result = flat
    slopes = np.arange(1.0, 1.0 + 2 * np.prod(columns, dtype=int)).reshape(2, *columns)
    values = np.tensordot(vertices[:, :2], slopes, 1).astype(kind)
    found = result.fill.new_vertex_rows("mine", values)
    assert found.dtype == kind
    np.testing.assert_allclose(found, np.tensordot(result.vertices[len(vertices) :, :2], slopes, 1), rtol=1e-5)


def test_colours_are_continued_and_rounded(flat):
    vertices, _, result = flat
    values = np.rint(20.0 * vertices).astype(np.uint8)
    found = result.fill.new_vertex_rows("RGB", values)
    assert found.dtype == np.uint8
    np.testing.assert_allclose(found, 20.0 * result.vertices[len(vertices) :], atol=0.5001)


@pytest.mark.parametrize("values", [np.arange, lambda n: np.arange(n) % 2 == 0, lambda n: np.arange(n).astype(str)])
def test_codes_and_labels_are_those_of_the_nearest_rim_vertices(flat, values):
    vertices, _, result = flat
    given = values(len(vertices))
    found = result.fill.new_vertex_rows("mine", given)
    rim = np.unique(result.fill.new_faces[result.fill.new_faces < len(vertices)])
    distances = np.linalg.norm(result.vertices[len(vertices) :, np.newaxis] - vertices[rim], axis=2)
    assert found.dtype == given.dtype
    np.testing.assert_array_equal(found, given[rim[distances.argmin(axis=1)]])


def test_numbers_that_are_not_finite_are_not_spread(flat):
    vertices, _, result = flat
    values = np.where(vertices[:, 0] < 6.0, np.nan, 1.0)
    found = result.fill.new_vertex_rows("mine", values)
    assert set(np.isnan(found)) == {True, False}


def test_columns_of_this_package_are_0_in_fills(flat):
    vertices, faces, result = flat
    assert not result.fill.new_vertex_rows("bz_k_min", np.ones(len(vertices))).any()
    like = result.fill.like_face()
    assert not result.fill.new_face_rows("bz_certainty", np.ones(len(faces)), like).any()


def test_faces_are_like_old_ones_that_share_an_edge(flat):
    _, faces, result = flat
    like = result.fill.like_face()
    found = result.fill.new_face_rows("mine", np.arange(len(faces)), like)
    np.testing.assert_array_equal(found, like)
    edges = [{(face[k], face[k - 1]) for k in range(3)} for face in faces.tolist()]
    across = [{(face[k - 1], face[k]) for k in range(3)} for face in result.fill.new_faces.tolist()]
    at_rim = [bool(own & set().union(*edges)) for own in across]
    assert 0 < sum(at_rim) < len(at_rim)
    assert at_rim == [bool(own & edges[old]) for own, old in zip(across, like.tolist(), strict=True)]


def test_without_holes_there_are_no_new_rows():
    shape = torus(resolution=12)
    fill = run(FILL_HOLES, shape.vertices, shape.faces, {}).fill
    assert len(fill.new_vertex_rows("mine", np.ones((len(shape.vertices), 3)))) == 0
    assert len(fill.new_vertex_rows("mine", np.arange(len(shape.vertices)))) == 0
    assert len(fill.like_face()) == 0
    assert not fill.marks()[NEW].any()


def test_triangulated_holes_have_no_new_vertices():
    """The hole of one face has a fill of one face."""
    shape = torus(resolution=12)
    fill = run(FILL_HOLES, shape.vertices, shape.faces[1:], {}).fill
    assert len(fill.new_faces) == 1
    assert len(fill.new_vertex_rows("mine", np.ones(len(shape.vertices)))) == 0
    assert len(fill.like_face()) == 1


def test_a_curved_field_is_close_to_the_truth():
    shape = torus(resolution=24)
    faces = without_faces_near(shape.vertices, shape.faces, np.array([1.0, 0.0, 0.4]), 0.3)
    fill = run(FILL_HOLES, shape.vertices, faces, {}).fill
    heights = fill.new_vertex_rows("height", shape.vertices[:, 2])
    np.testing.assert_allclose(heights, fill.vertices[fill.old_vertices :, 2], atol=0.06)
