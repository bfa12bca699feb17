"""The patch of one vertex next to that of the kernel."""

import numpy as np
import pytest

from bezier_filters import FitStatus, estimate_vertex_geometry, vertex_patch
from bezier_filters.surfaces import waves


@pytest.mark.parametrize("smoothness", ["paper", "third_order"])
@pytest.mark.parametrize("degree", [2, 3, 4])
def test_kernel_agrees_with_the_patch_of_one_vertex(smoothness, degree):
    """The compiled normal equations against QR of the design matrix, for every degree."""
    surface = waves(jitter=0.3, resolution=14)
    options = {"rings": 3, "degree": degree, "alpha": 0.7, "smoothness": smoothness}
    geometry = estimate_vertex_geometry(surface.vertices, surface.faces, **options)
    for vertex in np.flatnonzero(geometry.status == FitStatus.OK)[::17]:
        patch = vertex_patch(surface.vertices, surface.faces, int(vertex), **options)
        u, v = patch.parameters(surface.vertices[vertex : vertex + 1])
        normal = np.cross(patch.evaluate(u, v, (1, 0))[0], patch.evaluate(u, v, (0, 1))[0])
        np.testing.assert_allclose(geometry.normals[vertex], normal / np.linalg.norm(normal), atol=1e-9)
