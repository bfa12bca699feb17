"""Real holes, of meshes that the pymeshlab wheel ships, all of which are closed."""

import pytest
from conftest import pymeshlab_sample
from hole_cases import assert_filled

from bezier_filters import fill_holes


@pytest.mark.parametrize(
    ("name", "holes", "rims"),
    [("bunny10k_textured.obj", 5, 0), pytest.param("rangemaps/face000.ply", 23, 22, marks=pytest.mark.slow)],
)
def test_every_hole_is_closed(name, holes, rims):
    """The range map has 22 sheets, each with one outer rim."""
    vertices, faces = pymeshlab_sample(name)
    result = fill_holes(vertices, faces)
    assert_filled(vertices, faces, result)
    assert [sum(hole.is_outer_rim == outer for hole in result.holes) for outer in (False, True)] == [holes, rims]
    assert all(hole.filled != hole.is_outer_rim for hole in result.holes)
