"""The exact geometry of Loop subdivision surfaces, the truth of a benchmark."""

import numpy as np
import pytest
from surface_cases import integrated_gaussian_curvature

from bezier_filters.surfaces import bumpy_star, sphere, torus, waves
from limit_surface import limit_surface
from survivors import keep_survivors


def coarse(make):
    surface = make(resolution=20, jitter=0.3)
    survivors = np.random.default_rng(0).random(len(surface.vertices)) < 0.3
    kept, faces = keep_survivors(surface.vertices, surface.faces, survivors)
    return surface.vertices[kept], faces


@pytest.mark.parametrize("make", [pytest.param(bumpy_star, marks=pytest.mark.slow), torus])
def test_truth_does_not_change_with_another_subdivision(make):
    """The vertices of the coarser mesh are vertices of the finer one, at the same points of the limit."""
    vertices, faces = coarse(make)
    (once, regular), (twice, _) = (limit_surface(vertices, faces, subdivisions=s) for s in (1, 2))
    assert 0.7 < regular.mean() < 1
    distance = np.linalg.norm(once.vertices[:, np.newaxis] - twice.vertices, axis=2)
    same = distance.argmin(axis=1)
    assert distance.min(axis=1).max() < 1e-14
    np.testing.assert_allclose(once.normals, twice.normals[same], atol=1e-12)
    for quantity in ("mean_curvature", "gaussian_curvature", "geodesic_torsion"):
        coarser, finer = getattr(once, quantity)[regular], getattr(twice, quantity)[same][regular]
        np.testing.assert_allclose(coarser, finer, atol=1e-9)
    lines = np.einsum("ni,ni->n", once.direction_max, twice.direction_max[same])[regular]
    distinct = once.geodesic_torsion[regular] > 1e-3
    np.testing.assert_allclose(np.abs(lines[distinct]), 1, atol=1e-9)


def test_gauss_bonnet():
    """The integral of K over the regular part of a torus tends to 0, as over the whole."""
    ring = torus(resolution=10)
    surface, regular = limit_surface(ring.vertices, ring.faces, subdivisions=2)
    assert regular.all()  # the unjittered mesh is a lattice
    assert abs(integrated_gaussian_curvature(surface)) < 1e-3


def test_subdivided_sphere_is_nearly_one():
    ball = sphere(radius=2.0, resolution=12)
    surface, regular = limit_surface(ball.vertices, ball.faces, subdivisions=1)
    np.testing.assert_allclose(np.linalg.norm(surface.vertices, axis=1), 2, rtol=0.01)
    np.testing.assert_allclose(surface.mean_curvature[regular], 0.5, rtol=0.06)
    assert np.isnan(surface.mean_curvature[~regular]).all()
    np.testing.assert_allclose(surface.normals, surface.vertices / 2, atol=0.02)


def test_meshes_with_borders_are_refused():
    sheet = waves(resolution=6)
    with pytest.raises(ValueError, match="borders"):
        limit_surface(sheet.vertices, sheet.faces, subdivisions=1)
