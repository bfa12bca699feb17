"""Impulses: mixtures that are known, noise that is none, and surfaces that are found without them."""

import numpy as np
import pytest
from mesh_mutations import mutated
from scanner_noise import along_normals, mean_edge_of
from scipy.spatial.transform import Rotation
from scipy.stats import norm

from bezier_filters import estimate_vertex_geometry, smooth
from bezier_filters.meshes.mesh import TriangleMesh, triangle_mesh
from bezier_filters.meshes.prepared_mesh import prepare_mesh
from bezier_filters.sampling.mesh_parts import sample_parts
from bezier_filters.smoothing.impulses import Impulses, has_settled, learn_impulses, remove_impulses
from bezier_filters.surfaces import bumpy_star, sphere, torus


@pytest.fixture(scope="module")
def ball():
    """A sphere and its mesh."""
    surface = sphere(resolution=30, jitter=0.2)
    return surface, prepare_mesh(triangle_mesh(surface.vertices, surface.faces))


def mixture(count, share, hit, others, seed=0):
    """Normal heights of two strengths, and which are the strong ones."""
    random = np.random.default_rng(seed)
    is_hit = random.random(count) < share
    return random.standard_normal(count) * np.where(is_hit, hit, others), is_hit


def measured_at(ball, heights):
    """What is learned of heights in mean edges over a sphere."""
    surface, mesh = ball
    edge = mean_edge_of(mesh.vertices, mesh.faces)
    points = mesh.vertices + (edge * heights)[:, np.newaxis] * surface.normals
    return learn_impulses(points, sample_parts(mesh)), edge


@pytest.mark.parametrize(("share", "hit", "others"), [(0.6, 0.6, 0.1), (0.05, 0.5, 0.05), (0.3, 0.2, 0.03)])
def test_a_mixture_is_found(ball, share, hit, others):
    heights, _ = mixture(ball[1].vertex_count, share, hit, others)
    found, edge = measured_at(ball, heights)
    assert found.share == pytest.approx(share, rel=0.15)
    assert found.impulse_sigma / edge == pytest.approx(hit, rel=0.1)
    assert found.inlier_sigma / edge == pytest.approx(others, rel=0.1)


def test_one_distribution_is_none(ball):
    random, count = np.random.default_rng(1), ball[1].vertex_count
    assert measured_at(ball, np.zeros(count))[0] is None
    assert measured_at(ball, 0.3 * random.standard_normal(count))[0] is None
    assert measured_at(ball, 0.3 * random.uniform(-1.0, 1.0, count))[0] is None


def test_what_lies_side_by_side_is_none(ball):
    """The same heights are impulses where they are scattered, and noise of another strength where they are not."""
    heights, is_hit = mixture(ball[1].vertex_count, 0.3, 0.5, 0.05)
    assert measured_at(ball, heights)[0] is not None
    upwards = np.argsort(ball[1].vertices[:, 2])
    sorted_heights = np.empty_like(heights)
    sorted_heights[upwards] = heights[np.argsort(is_hit, kind="stable")]
    assert measured_at(ball, sorted_heights)[0] is None


@pytest.mark.parametrize("scale", [1e-30, 1e-3, 1e30])
def test_lengths_have_no_unit(ball, scale):
    surface, mesh = ball
    heights, _ = mixture(mesh.vertex_count, 0.2, 0.02, 0.002)
    points, other = (
        mesh.vertices + heights[:, np.newaxis] * surface.normals,
        TriangleMesh(scale * mesh.vertices, mesh.faces),
    )
    found = learn_impulses(points, sample_parts(mesh))
    scaled = learn_impulses(scale * points, sample_parts(prepare_mesh(other)))
    assert scaled.share == pytest.approx(found.share, rel=1e-6)
    assert scaled.impulse_sigma == pytest.approx(scale * found.impulse_sigma, rel=1e-6)


def test_probabilities_are_those_of_bayes():
    impulses, heights = Impulses(0.3, 0.5, 0.04), np.linspace(-3.0, 3.0, 101)
    others, hit = 0.7 * norm.pdf(heights, scale=0.04), 0.3 * norm.pdf(heights, scale=0.5)
    assert np.allclose(impulses.inlier_probability(heights), others / (others + hit), rtol=1e-12, atol=1e-300)


def test_vertices_that_were_hit_go_onto_the_surface(ball):
    surface, mesh = ball
    heights, is_hit = mixture(mesh.vertex_count, 0.1, 0.5, 0.001)
    is_hit &= np.abs(heights) > 0.1
    points = mesh.vertices + heights[:, np.newaxis] * surface.normals
    found = remove_impulses(points, mesh, Impulses(0.1, 0.5, 0.001, tangential_sigma=0.5))
    assert np.abs(found - mesh.vertices)[is_hit].max() < 1e-12
    sound = np.abs(heights) < 0.002
    assert np.abs(found - points)[sound].max() < 0.001
    assert has_settled(mesh.vertices, mesh.vertices + 1e-5, Impulses(0.1, 0.5, 0.001))
    assert not has_settled(mesh.vertices, points, Impulses(0.1, 0.5, 0.001))


@pytest.mark.parametrize(("along", "least", "most"), [(True, 0.0, 0.25), (False, 0.75, 1.25)])
def test_impulses_along_the_normals_are_told_from_others(ball, along, least, most):
    surface, mesh = ball
    edge, (heights, is_hit) = mean_edge_of(mesh.vertices, mesh.faces), mixture(mesh.vertex_count, 0.2, 0.5, 0.02)
    moves = heights[:, np.newaxis] * surface.normals
    if not along:
        moves = np.where(is_hit[:, np.newaxis], np.random.default_rng(2).normal(scale=0.5, size=moves.shape), moves)
    found = learn_impulses(mesh.vertices + edge * moves, sample_parts(mesh))
    assert least <= found.tangential_sigma / found.impulse_sigma < most


def test_impulses_along_the_normals_do_not_slide(ball):
    """On a smooth mesh that has slid away they go back to where their normals lead; sound vertices stay."""
    surface, mesh = ball
    edge, (heights, is_hit) = mean_edge_of(mesh.vertices, mesh.faces), mixture(mesh.vertex_count, 0.1, 0.5, 0.001)
    is_hit &= np.abs(heights) > 0.1
    points = mesh.vertices + (edge * heights)[:, np.newaxis] * surface.normals
    slid = Rotation.from_rotvec([0.0, 0.0, 0.3 * edge]).apply(mesh.vertices)
    found = remove_impulses(
        points, prepare_mesh(TriangleMesh(slid, mesh.faces)), Impulses(0.1, 0.5 * edge, 0.01 * edge)
    )

    def along_surface(where):
        off = (where - mesh.vertices)[is_hit]
        off -= np.einsum("ij,ij->i", off, surface.normals[is_hit])[:, np.newaxis] * surface.normals[is_hit]
        return np.sqrt(np.square(off).sum(axis=1).mean()) / edge

    assert along_surface(slid) > 0.2
    assert along_surface(found) < 0.1
    assert np.abs(np.linalg.norm(found, axis=1) - 1.0)[is_hit].max() < 0.1 * edge
    assert np.abs(found - points)[np.abs(heights) < 0.002].max() < 0.1 * edge


@pytest.mark.parametrize(("share", "size", "base", "left"), [(0.6, 0.6, 0.0, 0.055), (0.1, 0.5, 0.1, 0.033)])
@pytest.mark.parametrize("make", [bumpy_star, pytest.param(torus, marks=pytest.mark.slow)])
def test_the_surface_is_found_without_them(make, share, size, base, left):
    """In mean edges: what filters leave is mostly what impulses have drawn them to."""
    shape = make(resolution=24, jitter=0.2)
    edge = mean_edge_of(shape.vertices, shape.faces)
    heights = edge * (
        mixture(len(shape.vertices), share, size, 0.0)[0] + mixture(len(shape.vertices), 0.0, 0.0, base, 1)[0]
    )
    noisy = shape.vertices + heights[:, np.newaxis] * shape.normals
    found = smooth(noisy, shape.faces)
    errors = np.einsum("ij,ij->i", found.vertices - shape.vertices, shape.normals) / edge
    assert np.sqrt(np.square(errors).mean()) < left
    assert found.new_bad_faces == 0


def test_other_noise_is_smoothed_once(monkeypatch):
    """Correlated noise, and noise that varies from place to place, is no mixture of scattered vertices."""
    shape = torus(resolution=20, jitter=0.2)
    learned = []
    monkeypatch.setattr(
        "bezier_filters.smoothing.rounds.learn_impulses",
        lambda *arguments: learned.append(learn_impulses(*arguments)) or learned[-1],
    )
    place = shape.vertices[:, 0] - shape.vertices[:, 0].min()
    white = mean_edge_of(shape.vertices, shape.faces) * np.random.default_rng(0).standard_normal(len(place))
    for noisy in (
        along_normals(shape, 0.1, 3),
        shape.vertices + (0.05 * 10.0 ** (place / place.max() - 0.5) * white)[:, np.newaxis] * shape.normals,
        shape.vertices + (0.3 * white)[:, np.newaxis] * shape.normals,
    ):
        smooth(noisy, shape.faces)
    assert learned == [None] * 3


def test_where_no_two_neighbours_differ_there_are_no_impulses():
    """Their correlation is not defined; a warning is an error here."""
    estimate_vertex_geometry(*mutated(5059769))
