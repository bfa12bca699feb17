"""The fast kernel does what the reference does, whatever the fit, the block and the number of threads."""

from dataclasses import fields

import numpy as np
import pytest
from numba import config

from bezier_filters import estimate_vertex_geometry
from bezier_filters.estimation import fallbacks
from bezier_filters.kernels.scalar_kernel import scalar_task
from bezier_filters.surfaces import block_with_sharp_edges, torus, waves

pytestmark = pytest.mark.skipif(config.DISABLE_JIT, reason="lanes are compiled code only")

OPTIONS = [
    {"rings": 2, "alpha": 0.8},
    {"rings": 1, "alpha": 1.0},
    {"smoothness": "paper"},
    {"smoothness": "twists", "degree": 2, "alpha": 0.5, "rings": 2},
    {"degree": 4, "alpha": 0.9, "rings": 3},
    {},
    {"rings": 6},
    {"radius": 0.3},
]


def noisy(surface, noise):
    steps = np.random.default_rng(1).standard_normal((len(surface.vertices), 1))
    return surface.vertices + noise * steps * surface.normals, surface.faces


MESHES = {
    "torus": noisy(torus(resolution=24, jitter=0.3), 0.0),
    "noisy torus": noisy(torus(resolution=24, jitter=0.3), 0.005),
    "waves": noisy(waves(resolution=20, jitter=0.3), 0.0),
    "block": block_with_sharp_edges(resolution=6),
}


@pytest.mark.parametrize("options", OPTIONS, ids=str)
@pytest.mark.parametrize("mesh", MESHES)
def test_lanes_agree_with_the_reference(mesh, options, monkeypatch):
    found = estimate_vertex_geometry(*MESHES[mesh], **options)
    monkeypatch.setattr(fallbacks, "lane_task", scalar_task)
    expected = estimate_vertex_geometry(*MESHES[mesh], **options)
    assert found.fit == expected.fit
    np.testing.assert_array_equal(found.status, expected.status)
    np.testing.assert_array_equal(found.rings_used, expected.rings_used)
    size = np.ptp(MESHES[mesh][0], axis=0).max()
    for name, degree in {"normals": 0, "k_min": -1, "k_max": -1, "residual": 1, "normal_std": 0}.items():
        scale = max(np.abs(getattr(expected, name)).max(), size**degree)
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), rtol=0, atol=1e-8 * scale)
    curved = np.abs(expected.k_max - expected.k_min) > 1e-2 * np.abs(expected.k_max).max()
    for name in ("direction_min", "direction_max", "extremality_min", "extremality_max"):
        values = getattr(expected, name)[curved]
        atol = 1e-7 * np.abs(values).max(initial=1.0)
        # Both signs of a direction are right, and that of the extremality goes with it.
        same = np.einsum("ij,ij->i", found.direction_max, expected.direction_max)[curved] > 0.0
        sign = np.where(same, 1.0, -1.0).reshape((-1,) + (1,) * (values.ndim - 1))
        np.testing.assert_allclose(getattr(found, name)[curved] * sign, values, rtol=0, atol=atol)


@pytest.mark.parametrize("count", [1, 7, 8, 9, 17])
def test_a_vertex_is_the_same_in_any_block(count):
    vertices, faces = MESHES["noisy torus"]
    every = estimate_vertex_geometry(vertices, faces, rings=2, alpha=0.8)
    selected = np.zeros(len(vertices), dtype=bool)
    selected[3 : 3 + 5 * count : 5] = True
    some = estimate_vertex_geometry(vertices, faces, rings=2, alpha=0.8, selected=selected)
    for field in fields(every):
        if isinstance(getattr(every, field.name), np.ndarray):
            np.testing.assert_array_equal(getattr(some, field.name)[selected], getattr(every, field.name)[selected])
