"""Neighbourhoods of a mesh in a store are those of the mesh in memory."""

import numpy as np
import pytest
from scale_cases import broken, noisy, save_arrays, shuffled

from bezier_filters.fitting.mesh_neighbourhoods import MeshNeighbourhoods
from bezier_filters.kernels.kernel_input import prepare_kernel_mesh
from bezier_filters.meshes.mesh import triangle_mesh
from bezier_filters.meshes.spatial_order import sort_spatially
from bezier_filters.scale.learn import StoreNeighbourhoods
from bezier_filters.scale.source import open_source
from bezier_filters.scale.store import build_store


@pytest.mark.parametrize("make", [noisy, broken])
@pytest.mark.parametrize("mode", ["plain", "smoothed", "tolerant"])
@pytest.mark.parametrize("is_clean", [False, True])
def test_samples_are_the_same_to_the_last_bit(make, mode, is_clean, tmp_path):
    vertices, faces = shuffled(*make())
    store = build_store(open_source(save_arrays(tmp_path, vertices, faces)), tmp_path, 256)
    ordered = sort_spatially(triangle_mesh(vertices, faces))
    memory = MeshNeighbourhoods(prepare_kernel_mesh(ordered.mesh, ordered, with_barriers=True))
    stored = StoreNeighbourhoods(store)
    assert stored.vertex_count == memory.vertex_count == len(vertices)
    drawn = memory.draw(40)
    np.testing.assert_array_equal(stored.draw(40), drawn)
    if is_clean:
        memory, stored = memory.clean, stored.clean
    for one, other in zip(memory.sample(drawn, 3, mode), stored.sample(drawn, 3, mode), strict=True):
        np.testing.assert_array_equal(one, other)


def test_clean_neighbourhoods_have_no_outliers(tmp_path):
    """A vertex far off lies on the surface around it in the clean mesh; the mesh itself stays."""
    vertices, faces = noisy()
    far = vertices.copy()
    far[100] *= 1.3
    memory = MeshNeighbourhoods(prepare_kernel_mesh(triangle_mesh(far, faces), with_barriers=True))
    assert np.linalg.norm(memory.clean.mesh.vertices[100] - vertices[100]) < 0.2 * np.linalg.norm(
        far[100] - vertices[100]
    )
    np.testing.assert_array_equal(memory.mesh.vertices, far)
    assert memory.clean is memory.clean
