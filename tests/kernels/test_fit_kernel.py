"""The kernel does the same whatever the block, and how far its neighbours in it are."""

from dataclasses import fields

import numpy as np
import pytest

from bezier_filters import estimate_vertex_geometry
from bezier_filters.surfaces import torus

EVERYTHING = {"robust": True, "conditions": True}


def noisy_torus():
    surface = torus(resolution=24, jitter=0.3)
    rng = np.random.default_rng(1)
    far = np.where(rng.random((len(surface.vertices), 1)) < 0.1, 9.0, 1.0)
    steps = far * rng.standard_normal((len(surface.vertices), 1))
    return surface.vertices + 0.005 * steps * surface.normals, surface.faces


@pytest.mark.parametrize("options", [{}, EVERYTHING], ids=["plain", "everything"])
@pytest.mark.parametrize("count", [1, 7, 8, 9, 17])
def test_a_vertex_is_the_same_in_any_block(count, options):
    """Also where other vertices of the block take more rounds of reweighting."""
    vertices, faces = noisy_torus()
    options = options | {"rings": 2, "alpha": 0.8}
    every = estimate_vertex_geometry(vertices, faces, **options)
    selected = np.zeros(len(vertices), dtype=bool)
    selected[3 : 3 + 5 * count : 5] = True
    some = estimate_vertex_geometry(vertices, faces, **options, selected=selected)
    for field in fields(every):
        if isinstance(getattr(every, field.name), np.ndarray):
            np.testing.assert_array_equal(getattr(some, field.name)[selected], getattr(every, field.name)[selected])


def test_condition_numbers_change_nothing_else():
    vertices, faces = noisy_torus()
    without, found = (estimate_vertex_geometry(vertices, faces, conditions=asked) for asked in (False, True))
    assert without.condition_number is None
    assert (found.condition_number >= 6.0).all()
    for field in fields(found):
        if isinstance(getattr(without, field.name), np.ndarray):
            np.testing.assert_array_equal(getattr(found, field.name), getattr(without, field.name))
