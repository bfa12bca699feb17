"""Parts of a mesh on disk have what lies within some rings, and all faces that belong to it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scale_cases import clean, pipe, save_arrays, shuffled

from bezier_filters import k_rings
from bezier_filters.meshes.adjacency import vertex_adjacency
from bezier_filters.meshes.mesh import triangle_mesh
from bezier_filters.meshes.spatial_order import sort_spatially
from bezier_filters.scale.halo import part_around, part_around_samples
from bezier_filters.scale.source import open_source
from bezier_filters.scale.store import build_store


def stored(folder, vertices, faces, tile=256):
    """A store with a mesh, and the mesh in the order of the store."""
    store = build_store(open_source(save_arrays(folder, vertices, faces)), folder, tile)
    return store, sort_spatially(triangle_mesh(vertices, faces)).mesh


def assert_is_part(part, mesh, seeds, rings):
    """What `k_rings` finds around the seeds, and the faces at all of it but the last ring."""
    adjacency = vertex_adjacency(mesh)
    around = (k_rings(adjacency, k) for k in (rings - 1, rings))
    within = [np.unique(np.concatenate([rows.row(i) for i in seeds])) for rows in around]
    assert np.array_equal(part.ids, within[1])
    is_inner = np.isin(mesh.faces, within[0]).any(axis=1)
    assert np.array_equal(part.ids[part.mesh.faces], mesh.faces[is_inner])
    assert np.array_equal(part.mesh.vertices, mesh.vertices[part.ids])
    assert np.array_equal(part.ids[part.local(seeds)], seeds)


@pytest.mark.parametrize("rings", [1, 2, 5])
def test_a_part_has_all_faces_at_its_inner_vertices(rings, tmp_path):
    store, mesh = stored(tmp_path, *shuffled(*clean()))
    seeds = np.arange(256, 512, dtype=np.int32)
    assert_is_part(part_around(store, seeds, rings), mesh, seeds, rings)
    assert_is_part(part_around_samples(store, seeds[::-1], rings), mesh, seeds, rings)


@settings(max_examples=25)
@given(
    seed=st.integers(0, 10**6),
    length=st.integers(2, 400),
    rings=st.integers(1, 500),
    missing=st.sampled_from([0.0, 0.01, 0.2]),
)
def test_parts_are_what_k_rings_finds(seed, length, rings, missing, tmp_path_factory):
    """Far beyond 254 rings, and with faces that are missing or join what is far apart."""
    rng = np.random.default_rng(seed)
    vertices, faces = pipe(3, length)
    faces = faces[rng.random(len(faces)) >= missing][: len(faces) - 1]
    far = rng.integers(0, len(vertices), (int(rng.integers(0, 3)), 3))
    faces = np.concatenate([faces, far[[len(set(face)) == 3 for face in far.tolist()]]])
    store, mesh = stored(tmp_path_factory.mktemp("store"), *shuffled(vertices, faces))
    seeds = np.unique(rng.integers(0, len(vertices), int(rng.integers(1, 20)))).astype(np.int32)
    assert_is_part(part_around(store, seeds, rings), mesh, seeds, rings)


def test_parts_of_a_long_pipe_reach_as_far_as_they_should(tmp_path):
    vertices, faces = pipe(12, 5200)
    store, mesh = stored(tmp_path, vertices, faces, 4096)
    start = int(store.rank.read(0, 1)[0])
    for rings in (254, 255, 256, 1000):
        part = part_around(store, np.array([start], dtype=np.int32), rings)
        assert part.mesh.vertex_count > 12 * (rings - 6)
        assert part.mesh.vertex_count <= 12 * (rings + 1)
        assert part.mesh.faces.min() >= 0
        assert np.array_equal(part.mesh.vertices, mesh.vertices[part.ids])
