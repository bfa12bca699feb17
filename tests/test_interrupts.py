"""An interrupt at any Python call of a function comes out as one, whatever library runs Python code at that moment."""

import sys

import numpy as np
import pytest
from full_meshset import punched_torus

from bezier_filters.arrays import unique_rows
from bezier_filters.meshes.adjacency import vertex_adjacency
from bezier_filters.meshes.half_edges import border_edges, coincident_border_edges
from bezier_filters.meshes.mesh import triangle_mesh


def interrupt_at_every_call(function):
    """Raise KeyboardInterrupt where a handler of signals would; returns the number of places."""
    place = 0
    while True:
        calls = 0

        def trace(_frame, event, _argument):
            nonlocal calls
            calls += event == "call"
            if event == "call" and calls > place:  # noqa: B023
                raise KeyboardInterrupt

        before = sys.gettrace()
        sys.settrace(trace)
        try:
            function()
        except KeyboardInterrupt:
            place += 1
        else:
            return place
        finally:
            sys.settrace(before)


def test_an_interrupt_while_borders_are_welded_is_no_type_error():
    mesh = triangle_mesh(*punched_torus())
    border = border_edges(mesh, vertex_adjacency(mesh).on_boundary)
    assert interrupt_at_every_call(lambda: coincident_border_edges(mesh, border)) > 20


@pytest.mark.parametrize("columns", [1, 2, 3])
@pytest.mark.parametrize("dtype", [np.int32, np.float64])
def test_unique_rows_are_those_of_numpy(columns, dtype):
    rows = np.random.default_rng(0).integers(0, 4, (50, columns)).astype(dtype)
    expected, place = np.unique(rows, axis=0, return_inverse=True)
    got = unique_rows(rows)
    np.testing.assert_array_equal(got[0], expected)
    np.testing.assert_array_equal(got[1], place.ravel())
    assert len(unique_rows(rows[:0])[0]) == 0
