"""Lines on pages: kinds, umbilics, and meshes that they do not belong to."""

import pytest

import bezier_filters as bf
from bezier_filters.errors import InvalidParameterError
from bezier_filters.surfaces import ellipsoid


def test_lines_of_curvature_are_shown_with_their_umbilics():
    shape = ellipsoid(resolution=12)
    found = bf.trace_lines(bf.fit_surface(shape.vertices, shape.faces), spacing=0.2)
    page = bf.show(shape.vertices, shape.faces, found)
    assert page.meshes == ["scan", "lines_max", "lines_min", "umbilics_plus"]
    with pytest.raises(InvalidParameterError, match="belongs to another mesh"):
        bf.show(shape.vertices, shape.faces[:3], found)
