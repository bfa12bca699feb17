"""Axes chosen for eight neighbourhoods at a time are those that the reference chooses for each."""

import numpy as np
import pytest
from compiled import from_python

from bezier_filters.estimation.fallbacks import FitAttempt, kernel_fit
from bezier_filters.kernels.fit_frames import point_to_farthest
from bezier_filters.kernels.fit_workspace import fit_workspace
from bezier_filters.meshes.frames import farthest_direction
from bezier_filters.patches.fitting import PatchFit
from bezier_filters.runtime.lanes import LANES
from bezier_filters.status import FitStatus

STRIDE = 16


def scattered(rng):
    """Points anywhere, a few of them neighbours."""
    count = int(rng.integers(8, STRIDE))
    return np.vstack([np.zeros(3), rng.standard_normal((count - 1, 3))]), int(rng.integers(3, 7))


def lattice(rng):
    """Four neighbours at the same distance, and points that tell them apart."""
    square = [[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]]
    extra = 1.2 * rng.standard_normal((int(rng.integers(1, 6)), 3))
    turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    return np.vstack([np.zeros(3), rng.permutation(square), extra]) @ turn.T, 4


def on_the_normal(rng):
    """Neighbours that all project onto the vertex, for the normal (0, 0, 1)."""
    return np.array([[0, 0, 0], [0, 0, 1], [0, 0, -2]], dtype=np.float64), 2


@pytest.mark.parametrize("kinds", [[scattered] * 8, [lattice] * 8, [scattered, lattice, on_the_normal, scattered] * 2])
@pytest.mark.parametrize("seed", range(5))
def test_every_lane_has_the_axes_of_the_reference(kinds, seed):
    rng = np.random.default_rng(seed)
    work = fit_workspace(kernel_fit(FitAttempt(FitStatus.OK, frozenset(), 1, PatchFit())), 1, STRIDE)
    points, frame = work.points.reshape(4, STRIDE, LANES), work.frame.reshape(3, 3, LANES)
    expected = []
    for lane, kind in enumerate(kinds):
        edges, near = kind(rng)
        normal = np.array([0.0, 0.0, 1.0])
        if kind is not on_the_normal:
            normal = np.linalg.qr(np.column_stack([np.cross(edges[1], edges[2]), *np.eye(2, 3)]))[0][:, 0]
        work.counts[lane], work.neighbours[lane] = len(edges), near
        points[:3, : len(edges), lane] = edges.T
        frame[2, :, lane] = normal
        x = np.array(farthest_direction(edges, np.arange(len(edges), dtype=np.int32), near, len(edges), *normal))
        expected.append([x, np.cross(normal, x), normal])
    from_python(point_to_farthest)(STRIDE, work)
    np.testing.assert_allclose(frame, np.moveaxis(expected, 0, 2), atol=1e-9)
