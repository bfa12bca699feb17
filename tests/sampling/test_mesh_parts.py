"""Parts of a large mesh from which its parameters are learned."""

import numpy as np
import pytest
from numba import config
from smoothing_cases import large_star

from bezier_filters.meshes.mesh import triangle_mesh
from bezier_filters.meshes.prepared_mesh import prepare_mesh
from bezier_filters.sampling import mesh_parts
from bezier_filters.sampling.mesh_parts import sample_parts
from bezier_filters.surfaces import sphere

compiled = pytest.mark.skipif(config.DISABLE_JIT, reason="takes too long without the compiler")


@pytest.fixture(scope="module", params=[4, pytest.param(1, marks=pytest.mark.slow)])
def star(request):
    with large_star(request.param) as surface:
        yield surface


@compiled
def test_parts_are_of_one_piece_with_a_margin(star):
    mesh = prepare_mesh(triangle_mesh(star.vertices, star.faces))
    parts = sample_parts(mesh)
    assert mesh_parts.PART_VERTICES < parts.mesh.vertex_count < mesh.vertex_count
    assert parts.core.sum() > mesh_parts.PART_CORE_VERTICES
    assert np.array_equal(parts.mesh.vertices, star.vertices[parts.ids])
    # Nothing is missing around the vertices that count.
    inside = parts.mesh.adjacency.vertices.lengths[parts.core]
    assert np.array_equal(inside, mesh.adjacency.vertices.lengths[parts.ids[parts.core]])
    assert not parts.cut[parts.core].any()


def test_small_meshes_are_their_own_sample():
    ball = sphere(resolution=6)
    mesh = prepare_mesh(triangle_mesh(ball.vertices, ball.faces))
    parts = sample_parts(mesh)
    assert parts.mesh is mesh
    assert parts.core.all()
