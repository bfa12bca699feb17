"""Smoothing of meshes so large that what holds for the whole is learned from parts; and its shortcuts."""

import numpy as np
import pytest
from numba import config
from smoothing_cases import edge_of, face_normals, large_star, mean_angle, with_noise

from bezier_filters import smooth
from bezier_filters.surfaces import block_with_sharp_edges

compiled = pytest.mark.skipif(config.DISABLE_JIT, reason="takes too long without the compiler")


@pytest.fixture(scope="module", params=[4, pytest.param(1, marks=pytest.mark.slow)])
def star(request):
    with large_star(request.param) as surface:
        yield surface


@pytest.fixture(scope="module")
def smoothed(star):
    """The star and a block beside it, as they were, with noise, and with that taken off."""
    block, faces = block_with_sharp_edges(resolution=16, jitter=0.2)
    scale = edge_of(star.vertices, star.faces) / edge_of(block, faces)
    clean = np.vstack([star.vertices, block * scale + [5.0, 0.0, 0.0]])
    both = np.vstack([star.faces, faces + len(star.vertices)])
    normals = np.zeros_like(clean)
    for k in range(3):
        np.add.at(normals, both[:, k], face_normals(clean, both))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    noisy = with_noise(clean, both, normals, 0.2)
    return clean, faces, (noisy, both), smooth(noisy, both, threads=2)


@compiled
def test_large_meshes_become_smooth(star, smoothed):
    *_, result = smoothed
    assert mean_angle(result.vertices[: len(star.vertices)], star.vertices, star.faces) < 1.0
    assert result.volume_ratio == pytest.approx(1.0, abs=1e-9)


@compiled
def test_the_number_of_threads_does_not_matter(smoothed):
    """On a mesh of several chunks of vertices."""
    *_, noisy, two = smoothed
    one = smooth(*noisy, threads=1)
    assert np.array_equal(one.vertices, two.vertices)
    assert np.array_equal(one.sharpness, two.sharpness)


@compiled
def test_edges_that_no_part_need_have_met_stay_sharp(star, smoothed):
    clean, faces, _, result = smoothed
    rest = slice(len(star.vertices), None)
    assert result.sharpness[rest].mean() > 0.5
    assert mean_angle(result.vertices[rest], clean[rest], faces) < 3.0
