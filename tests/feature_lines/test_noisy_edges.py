"""Sharp edges under noise are found where they are, with a certainty that is right, and fits end there."""

import numpy as np
import pytest
from scanner_noise import along_normals, in_all_directions, mean_edge_of

from bezier_filters import estimate_vertex_geometry, find_creases
from bezier_filters.meshes.half_edges import mesh_edges
from bezier_filters.meshes.mesh import triangle_mesh
from bezier_filters.surfaces import block_with_sharp_edges, bumpy_star, sphere, torus

BLOCK, FACES = block_with_sharp_edges(resolution=16, jitter=0.2)


def noisy(share, seed=0):
    """The block with white noise along the normals of its vertices, in mean edges."""
    a, b, c = BLOCK[FACES].transpose(1, 0, 2)
    normals = np.zeros_like(BLOCK)
    np.add.at(normals, FACES, np.cross(b - a, c - a)[:, np.newaxis])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    heights = np.random.default_rng(seed).standard_normal((len(BLOCK), 1))
    return BLOCK + share * mean_edge_of(BLOCK, FACES) * heights * normals


def pairs(edges):
    return {tuple(edge) for edge in edges.tolist()}


def sharp_pairs(vertices, faces):
    edges = mesh_edges(triangle_mesh(vertices, faces))
    return pairs(edges.vertices[edges.angles > np.radians(30.0)])


@pytest.mark.parametrize(("share", "least"), [(0.0, 1.0), (0.1, 0.97), (0.2, 0.95), (0.3, 0.9), (0.5, 0.8)])
def test_the_edges_of_a_block(share, least):
    found = find_creases(noisy(share), FACES)
    edges, true = pairs(found.sharp_edges), sharp_pairs(BLOCK, FACES)
    assert 2.0 * len(edges & true) / (len(edges) + len(true)) >= least
    assert found.certainties.shape == (len(found.sharp_edges),)
    right = np.array([tuple(edge) in true for edge in found.sharp_edges.tolist()])
    assert found.certainties.mean() == pytest.approx(right.mean(), abs=0.05)
    assert not [line for line in found.lines if not line.is_sharp]


@pytest.mark.parametrize("make", [sphere, pytest.param(torus, marks=pytest.mark.slow), bumpy_star])
@pytest.mark.parametrize(("level", "passes"), [(0.1, 0), (0.3, 0), (0.1, 1), (0.1, 8), (0.3, None)])
def test_round_shapes_have_none(make, level, passes):
    shape = make(resolution=14, jitter=0.2)
    if passes is None:
        vertices = in_all_directions(shape.vertices, shape.faces, level)
    else:
        vertices = along_normals(shape, level, passes)
    assert len(find_creases(vertices, shape.faces).sharp_edges) == 0


def test_fits_end_at_edges_that_noise_hides():
    """Two edges away from its sharp edges a block has the normals of its planes."""
    share = 0.2
    vertices = noisy(share)
    geometry = estimate_vertex_geometry(vertices, FACES)
    inside = (np.abs(BLOCK[:, :2]) < 0.35).all(axis=1) & (BLOCK[:, 2] == -0.5)
    cosines = -geometry.normals[inside, 2]
    assert np.degrees(np.arccos(np.minimum(cosines, 1.0))).mean() < 1.0
    assert geometry.noise_free.shape == BLOCK.shape
    heights = geometry.noise_free[inside, 2] + 0.5
    assert np.sqrt(np.square(heights).mean()) < 0.5 * share * mean_edge_of(BLOCK, FACES)
    assert estimate_vertex_geometry(BLOCK, FACES).noise_free is None


def test_fits_end_at_edges_that_heavy_noise_hides():
    """Away from edges normals are about as good as where the bottom of the block is a mesh of its own."""
    is_bottom = BLOCK[:, 2] == -0.5
    used, faces = np.unique(FACES[is_bottom[FACES].all(axis=1)], return_inverse=True)
    inside, errors = (np.abs(BLOCK[used, :2]) < 0.35).all(axis=1), []
    for seed in range(6):
        vertices = noisy(0.5, seed)
        whole = estimate_vertex_geometry(vertices, FACES).normals[used]
        alone = estimate_vertex_geometry(vertices[used], faces.reshape(-1, 3)).normals
        errors.append([np.arccos(np.minimum(-normals[inside, 2], 1.0)).mean() for normals in (whole, alone)])
    ours, best = np.mean(errors, axis=0)
    assert ours < 1.3 * best


@pytest.mark.parametrize("make", [sphere, torus, bumpy_star])
def test_where_fits_leave_nothing_but_noise_no_edges_are_looked_for(make):
    """Which would cost ten times the time of the fits."""
    shape = make(resolution=30, jitter=0.2)
    assert estimate_vertex_geometry(along_normals(shape, 0.2, 0), shape.faces).noise_free is None


def test_edges_are_the_same_for_a_geometry_that_knows_nothing_of_noise():
    vertices = noisy(0.2)
    fixed = estimate_vertex_geometry(vertices, FACES, rings=2, alpha=1.0)
    assert fixed.noise_sigma is None
    expected, found = find_creases(vertices, FACES), find_creases(vertices, FACES, fixed)
    assert pairs(found.sharp_edges) == pairs(expected.sharp_edges)


def test_fits_of_the_second_degree_say_that_they_tell_no_crest_lines():
    shape = torus(resolution=10)
    for degree, told in ((2, False), (3, True)):
        geometry = estimate_vertex_geometry(shape.vertices, shape.faces, rings=2, degree=degree)
        creases = find_creases(shape.vertices, shape.faces, geometry)
        assert creases.tells_crest_lines == told
        assert ("degree 2" in repr(creases)) != told
