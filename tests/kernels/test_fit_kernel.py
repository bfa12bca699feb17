"""The kernel does the same whatever the block, and how far its neighbours in it are."""

from dataclasses import fields

import numpy as np
import pytest

from bezier_filters import estimate_vertex_geometry
from bezier_filters.kernels.graph_geometry import bound_errors
from bezier_filters.kernels.kernel_input import prepare_kernel_mesh
from bezier_filters.meshes.mesh import triangle_mesh
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


def test_standard_errors_are_no_larger_than_what_faces_hold():
    """Over the height of a face a surface turns by pi at most."""
    vertices, faces = noisy_torus()
    arrays = prepare_kernel_mesh(triangle_mesh(vertices, faces), with_barriers=False)
    ids = np.arange(0, len(vertices), 2, dtype=np.int32)
    of_mean, of_gaussian = np.full((2, len(vertices)), 1e9)
    bound_errors(arrays, ids, of_mean, of_gaussian, 0, len(ids))
    a, b, c = vertices[faces].transpose(1, 0, 2)
    longest = np.max([np.linalg.norm(e, axis=1) for e in (a - b, b - c, c - a)], axis=0)
    of_faces = np.linalg.norm(np.cross(b - a, c - a), axis=1) / longest
    heights = np.full(len(vertices), np.inf)
    np.minimum.at(heights, faces, of_faces[:, np.newaxis])
    assert of_mean[::2] == pytest.approx(np.pi / heights[::2])
    assert of_gaussian[::2] == pytest.approx(np.square(np.pi / heights[::2]))
    assert (of_mean[1::2] == 1e9).all()
