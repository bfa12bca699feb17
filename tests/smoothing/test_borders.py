"""Borders: corners stay, heights become smooth, and noise across the border goes."""

import numpy as np
import pytest
from numba import config
from smoothing_cases import edge_of

from bezier_filters import smooth
from bezier_filters.meshes.adjacency import vertex_adjacency
from bezier_filters.meshes.mesh import triangle_mesh
from bezier_filters.surfaces import waves

pytestmark = pytest.mark.skipif(config.DISABLE_JIT, reason="takes too long without the compiler")


def noisy_sheet(amplitude, noise, seed=0):
    """A sheet, its noisy vertices by noise in x, y and z in mean edges, and the mask of its border."""
    sheet = waves(resolution=40, amplitude=amplitude)
    edge = edge_of(sheet.vertices, sheet.faces)
    noisy = sheet.vertices + np.array(noise) * edge * np.random.default_rng(seed).standard_normal(sheet.vertices.shape)
    return sheet, noisy, edge, vertex_adjacency(triangle_mesh(sheet.vertices, sheet.faces)).on_boundary


def corners_of(sheet):
    x, y = sheet.vertices[:, 0], sheet.vertices[:, 1]
    return [int((a * x + b * y).argmax()) for a in (-1, 1) for b in (-1, 1)]


@pytest.mark.parametrize("amplitude", [0.0, 0.05])
def test_heights_become_smooth_and_corners_stay(amplitude):
    sheet, noisy, edge, on_border = noisy_sheet(amplitude, (0.0, 0.0, 0.2))
    moved = (smooth(noisy, sheet.faces).vertices - sheet.vertices) / edge
    assert np.abs(moved[corners_of(sheet), :2]).max() < 0.2
    assert np.sqrt(np.square(moved[on_border, :2]).sum(axis=1).mean()) < 0.06
    assert np.sqrt(np.square(moved[on_border, 2]).mean()) < 0.6 * 0.2


def test_noise_across_the_border_goes_and_corners_stay_within_their_noise():
    sheet, noisy, edge, on_border = noisy_sheet(0.0, (0.2, 0.2, 0.2))
    result = smooth(noisy, sheet.faces, relax=True).vertices
    before, after = ((points - sheet.vertices) / edge for points in (noisy, result))
    x, y = sheet.vertices[:, 0], sheet.vertices[:, 1]
    on_side = on_border & (np.isclose(x, x.min()) | np.isclose(x, x.max())) & (np.abs(y - y.mean()) < 0.3 * np.ptp(y))
    assert np.square(after[on_side, 0]).mean() < 0.6 * np.square(before[on_side, 0]).mean()
    corners = corners_of(sheet)
    assert np.linalg.norm((after - before)[corners, :2], axis=1).max() < 0.6


@pytest.mark.parametrize("seed", range(2))
def test_a_ragged_border_is_not_straightened(seed):
    sheet, noisy, edge, _ = noisy_sheet(0.0, (0.0, 0.0, 0.2), seed)
    centers = sheet.vertices[sheet.faces].mean(axis=1)[:, :2]
    radii = np.linalg.norm(centers - centers.mean(axis=0), axis=1)
    kept = sheet.faces[
        radii < 0.4 * np.ptp(centers[:, 0]) + 0.5 * edge * np.random.default_rng(seed).random(len(radii))
    ]
    used, faces = np.unique(kept, return_inverse=True)
    moved = (smooth(noisy[used], faces.reshape(-1, 3)).vertices - noisy[used]) / edge
    assert np.sqrt(np.square(moved[:, :2]).sum(axis=1).mean()) < 0.05
    assert np.linalg.norm(moved[:, :2], axis=1).max() < 1.0
