"""An interrupt at any Python call of a function comes out as one, whatever library runs Python code at that moment."""

import sys

from full_meshset import punched_torus

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
