"""Every function on every bad mesh."""

import numpy as np
import pytest
from bad_meshes import MAKERS
from hypothesis import given, settings
from hypothesis import strategies as st
from invariants import CHECKS, check_refusal
from mesh_mutations import mutated, spoil_rows

from bezier_filters import estimate_vertex_geometry


@pytest.mark.parametrize("name", MAKERS)
def test_bad_meshes(name):
    for check, function in CHECKS.items():
        try:
            function(*MAKERS[name]())
        except Exception as error:
            raise AssertionError(f"{check}: {error}") from error


@pytest.mark.parametrize("check", CHECKS)
@settings(max_examples=4, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_mutated_meshes(check, seed):
    CHECKS[check](*mutated(seed))


@pytest.mark.parametrize(
    ("check", "seed"),
    [
        ("smooth, auto", 212),  # so noisy that every way to have no new bad face leaves more bad ones
        ("fill_holes, auto", 64),  # a crease with too few faces beside it, at coordinates of 1e25
        ("fill_holes, auto", 95),  # a crease whose only edge at its tip is that of two faces that disagree
        ("estimate, robust", 242),  # an outlier at a crease, whose faces are lower once it is back
        ("fill_holes, auto", 1350),  # a side of a crease of coordinates below 1e-40
        ("generate_polyline_by_bezier_patch_direction", 9161),  # a coordinate of 1e300, and a spacing in percent
    ],
)
def test_mutated_meshes_that_once_failed(check, seed):
    CHECKS[check](*mutated(seed))


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_rows_that_no_mesh_has_are_refused_by_every_function(seed):
    check_refusal(*spoil_rows(seed))


@pytest.mark.parametrize("name", ["tiny", "huge", "far_away"])
def test_size_and_place_do_not_matter(name):
    vertices, faces = MAKERS[name]()
    plain = estimate_vertex_geometry(*MAKERS["ring"](), rings=2, alpha=0.8)
    scale = {"tiny": 1e30, "huge": 1e-30, "far_away": 1.0}[name]
    geometry = estimate_vertex_geometry(vertices, faces, rings=2, alpha=0.8)
    # A billion away, coordinates are rounded to a ten-millionth.
    tolerance = 1e-4 if name == "far_away" else 1e-9
    np.testing.assert_allclose(geometry.mean_curvature / scale, plain.mean_curvature, rtol=tolerance, atol=tolerance)
