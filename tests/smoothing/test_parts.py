"""A part of a mesh with enough rings around it is smoothed as the whole mesh is."""

import numpy as np
import pytest
from numba import config
from test_smoothing import edge_of, face_normals, with_noise

from bezier_filters.meshes.adjacency import vertex_adjacency
from bezier_filters.meshes.mesh import TriangleMesh, triangle_mesh
from bezier_filters.smoothing.denoise import SmoothingOptions, denoise, halo_rings, learn_plan, remove_noise
from bezier_filters.smoothing.flipped_faces import repair_flipped_faces
from bezier_filters.smoothing.mesh_parts import MeshPart, sample_parts, whole_mesh
from bezier_filters.smoothing.noise import roughest_vertices, roughness
from bezier_filters.noise.noise_model import NoiseModel
from bezier_filters.surfaces import block_with_sharp_edges, bumpy_star

pytestmark = pytest.mark.skipif(config.DISABLE_JIT, reason="takes too long without the compiler")


def part_around(mesh, adjacency, inner, rings):
    """The part of a mesh with some vertices and rings around them, in another order."""
    rows, taken = adjacency.vertices, inner.copy()
    for _ in range(rings):
        taken[rows.indices[np.repeat(taken, rows.lengths)]] = True
    ids = np.random.default_rng(0).permutation(np.flatnonzero(taken)).astype(np.int32)
    number = np.full(len(taken), -1, dtype=np.int32)
    number[ids] = np.arange(len(ids), dtype=np.int32)
    part = TriangleMesh(mesh.vertices[ids], number[mesh.faces[taken[mesh.faces].all(axis=1)]])
    found = vertex_adjacency(part)
    cut = found.faces.lengths != adjacency.faces.lengths_of(ids)
    return MeshPart(part, found, ids, cut, inner[ids], mesh.vertex_count)


def noisy_star():
    star = bumpy_star(resolution=52, jitter=0.2)
    return with_noise(star.vertices, star.faces, star.normals, 0.2), star.faces


def noisy_block():
    block, faces = block_with_sharp_edges(resolution=50, jitter=0.2)
    normals = np.zeros_like(block)
    for k in range(3):
        np.add.at(normals, faces[:, k], face_normals(block, faces))
    return with_noise(block, faces, normals / np.linalg.norm(normals, axis=1, keepdims=True), 0.2), faces


@pytest.mark.parametrize("make", [noisy_star, noisy_block])
def test_parts_with_rings_around_are_smoothed_as_the_whole(make):
    mesh = triangle_mesh(*make())
    adjacency = vertex_adjacency(mesh)
    sigma = 0.2 * edge_of(mesh.vertices, mesh.faces)
    plan, _ = learn_plan(sample_parts(mesh, adjacency), NoiseModel(sigma**2), SmoothingOptions())
    whole = denoise(whole_mesh(mesh, adjacency), plan)
    learned = remove_noise(mesh, adjacency, NoiseModel(sigma**2), SmoothingOptions())
    assert np.abs(learned.points - whole.points).max() < 1e-3 * sigma  # whose filters are series of other lengths
    squares = []
    low, high = np.quantile(mesh.vertices[:, 0], (0.1, 0.9))
    for inner in (mesh.vertices[:, 0] < low, mesh.vertices[:, 0] > high):
        part = part_around(mesh, adjacency, inner, halo_rings(plan))
        assert part.cut.any()
        is_inner = inner[part.ids]
        found, expected = denoise(part, plan), part.ids[is_inner]
        distances = np.linalg.norm(found.points[is_inner] - whole.points[expected], axis=1) / sigma
        assert distances.max() < 0.01
        assert np.abs(found.sharpness[is_inner] - whole.sharpness[expected]).max() < 0.01
        squares.append(np.square(distances))
    assert np.sqrt(np.concatenate(squares).mean()) < 0.001


def test_the_roughest_place_is_at_the_corners():
    vertices, faces = noisy_block()
    mesh = triangle_mesh(vertices, faces)
    part, sigma = whole_mesh(mesh, vertex_adjacency(mesh)), 0.2 * edge_of(vertices, faces)
    found = roughness(part, sigma)
    edges = (np.abs(np.abs(vertices) - np.abs(vertices).max(axis=0)) < 0.05).sum(axis=1)
    assert edges[found.argmax()] >= 2
    inner = vertices[:, 0] > 0.2
    tile = part_around(mesh, part.adjacency, inner, 40)
    rows = inner[tile.ids]
    assert np.allclose(roughness(tile, sigma)[rows], found[tile.ids[rows]], rtol=1e-3)


@pytest.mark.parametrize("share", [1.0, 0.03, 0.0])
def test_what_is_as_rough_is_chosen_alike_from_tiles(share):
    """Although sums of tiles are others, many are as rough as the roughest, and each tile tells of a few only."""
    rng, alike, n = np.random.default_rng(0), 0, 20_000
    for _ in range(50):
        values, ids = 5.0 - share * rng.random(n), rng.permutation(n).astype(np.int32)
        expected = roughest_vertices(values, ids)[0]
        rounded, few = values * (1.0 + 1e-5 * rng.standard_normal(n)), []
        for start in range(0, n, 2000):
            tile = slice(start, start + 2000)
            few.extend(start + roughest_vertices(rounded[tile], ids[tile]))
        assert len(few) < 150
        alike += few[roughest_vertices(rounded[few], ids[few])[0]] == expected
        assert values[expected] >= 0.98 * values.max()
    assert alike >= 48


def test_faces_are_repaired_alike_in_a_part():
    star = bumpy_star(resolution=24, jitter=0.2)
    mesh = triangle_mesh(star.vertices, star.faces)
    adjacency, rng = vertex_adjacency(mesh), np.random.default_rng(0)
    moved = mesh.vertices + 0.6 * edge_of(mesh.vertices, mesh.faces) * rng.standard_normal(mesh.vertices.shape)
    whole = repair_flipped_faces(mesh, adjacency, moved)
    assert not np.array_equal(whole, moved)
    inner = mesh.vertices[:, 0] > 0.4
    part = part_around(mesh, adjacency, inner, 20)
    rows = inner[part.ids]
    found = repair_flipped_faces(part.mesh, part.adjacency, moved[part.ids])
    assert np.mean(np.abs(found[rows] - whole[part.ids[rows]]).max(axis=1) > 1e-12) < 1e-3
