"""How far the blended patches of a surface differ, on planes, at vertices and by the size of the mesh."""

import numpy as np

from bezier_filters import fit_surface
from bezier_filters.patch_surface.disagreement import patch_disagreement
from bezier_filters.surfaces import height_field, torus

MIDDLE = 1.0 / 3.0


def disagreement(body, place):
    surface = fit_surface(body.vertices, body.faces)
    faces = np.arange(len(body.faces), dtype=np.int32)
    return patch_disagreement(surface.arrays, faces, np.tile(place, (len(faces), 1)))


def test_patches_agree_on_planes_and_at_vertices():
    plane = height_field(lambda x, y: [0.0 * x] * 6, resolution=8, jitter=0.2)
    np.testing.assert_allclose(disagreement(plane, [MIDDLE, MIDDLE]), 0.0, atol=1e-15)
    np.testing.assert_allclose(
        disagreement(torus(resolution=16), [1.0, 0.0]), 0.0, atol=1e-9
    )  # its square is 0 to rounding


def test_it_is_the_error_of_shape_between_vertices():
    """Within a factor of three, and it vanishes as the mesh is refined."""
    found = []
    for resolution in (16, 32):
        ring = torus(resolution=resolution, jitter=0.3)
        surface = fit_surface(ring.vertices, ring.faces)
        points = surface.evaluate(np.arange(len(ring.faces)), np.full((len(ring.faces), 2), MIDDLE)).points
        x, y, z = points.T
        error = np.sqrt(np.mean(np.square(np.hypot(np.hypot(x, y) - 1.0, z) - 0.4)))
        found.append(np.sqrt(np.mean(np.square(disagreement(ring, [MIDDLE, MIDDLE])))))
        assert error / 3.0 < found[-1] < 3.0 * error
    assert found[1] < 0.1 * found[0]
