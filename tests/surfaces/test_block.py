"""The block with sharp edges."""

import numpy as np
import pytest
from surface_cases import area_vectors, assert_valid_mesh, corner_angles, directed_edges, each_jitter, volume

from bezier_filters import surfaces


@each_jitter
def test_block_is_a_closed_cube_without_an_octant(jitter: float) -> None:
    vertices, faces = surfaces.block_with_sharp_edges(size=2.0, resolution=8, jitter=jitter)
    assert_valid_mesh(vertices, faces, euler_characteristic=2, rims=0)
    assert volume(vertices, faces) == pytest.approx(7.0)
    areas = area_vectors(vertices, faces)
    assert np.linalg.norm(areas, axis=1).sum() == pytest.approx(24.0)
    assert corner_angles(vertices, faces).min() > (5.0 if jitter else 44.9)


@each_jitter
def test_block_has_exactly_sharp_edges(jitter: float) -> None:
    vertices, faces = surfaces.block_with_sharp_edges(size=2.0, resolution=8, jitter=jitter)
    areas = area_vectors(vertices, faces)
    normals = areas / np.linalg.norm(areas, axis=1, keepdims=True)
    np.testing.assert_allclose(np.sort(np.abs(normals), axis=1), np.broadcast_to([0, 0, 1], normals.shape), atol=1e-12)
    edges = directed_edges(faces)
    owner = np.tile(np.arange(len(faces)), 3)
    order = np.lexsort(np.sort(edges, axis=1).T)
    pairs = owner[order].reshape(-1, 2)
    sharp = np.abs(np.einsum("mi,mi->m", normals[pairs[:, 0]], normals[pairs[:, 1]])) < 0.5
    sharp_edges = edges[order].reshape(-1, 2, 2)[sharp, 0]
    length = np.linalg.norm(vertices[sharp_edges[:, 0]] - vertices[sharp_edges[:, 1]], axis=1).sum()
    # Twelve edges of length 2; the notch shortens three of them to 1 and adds nine of length 1.
    assert length == pytest.approx(12 * 2 - 3 + 9)
