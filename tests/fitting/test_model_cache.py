"""What was learned of a mesh is used again for the same arrays and options, and for nothing else."""

import dataclasses
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from numba import config

import bezier_filters as bf
from bezier_filters.estimation.estimate import geometry_where
from bezier_filters.fitting import model_cache
from bezier_filters.fitting.region_fits import SurfaceFit
from bezier_filters.fitting.vertex_geometry import FitChoice
from bezier_filters.meshes.mesh import triangle_mesh
from bezier_filters.meshes.prepared_mesh import prepare_mesh
from bezier_filters.surfaces import block_with_sharp_edges, bumpy_star


def arrays_of(geometry):
    return {field.name: getattr(geometry, field.name) for field in dataclasses.fields(geometry)}


@pytest.fixture
def empty_cache(monkeypatch):
    monkeypatch.setattr(model_cache, "_recent", type(model_cache._recent)())


@pytest.fixture(params=["star", "block"])
def mesh(request):
    if request.param == "star":
        star = bumpy_star(resolution=8)
        vertices, faces = star.vertices, star.faces
    else:
        vertices, faces = block_with_sharp_edges(resolution=8)
    edge = np.linalg.norm(vertices[faces[:, 0]] - vertices[faces[:, 1]], axis=1).mean()
    return vertices + np.random.default_rng(5).normal(0.0, 0.1 * edge, vertices.shape), faces


def test_the_second_call_gives_the_same_to_the_last_bit(empty_cache, mesh):
    first, second = (arrays_of(bf.estimate_vertex_geometry(*mesh)) for _ in range(2))
    assert len(model_cache._recent) == 1
    for name, values in first.items():
        np.testing.assert_array_equal(second[name], values, err_msg=name)


def test_so_does_a_selection_after_the_whole(empty_cache, mesh):
    selected = np.arange(len(mesh[0])) % 7 == 0
    alone = bf.estimate_vertex_geometry(*mesh, selected=selected)
    model_cache._recent.clear()
    bf.estimate_vertex_geometry(*mesh)
    after = bf.estimate_vertex_geometry(*mesh, selected=selected)
    for name in ("normals", "k_min", "extremality_max", "mean_curvature_std", "status"):
        np.testing.assert_array_equal(getattr(after, name), getattr(alone, name), err_msg=name)


@pytest.mark.parametrize("order", ["its own first", "that of space first"])
def test_a_mesh_in_its_own_order_after_that_of_space_has_a_fit_of_its_own(empty_cache, mesh, order):
    """Holes are surrounded by few vertices, for which a mesh is not sorted; sums in another order round differently."""
    own = triangle_mesh(*mesh)
    ways = [
        lambda: geometry_where(prepare_mesh(own), lambda _: np.ones(len(mesh[0]), dtype=bool)),
        lambda: bf.estimate_vertex_geometry(*mesh),
    ]
    learn, look_up_fit = ways if order == "its own first" else ways[::-1]
    alone = look_up_fit()
    model_cache._recent.clear()
    learn()
    after = look_up_fit()
    assert len(model_cache._recent) == 2
    for name in ("normals", "k_min", "mean_curvature_std", "status"):
        np.testing.assert_array_equal(getattr(after, name), getattr(alone, name), err_msg=name)


def test_other_arrays_or_options_are_learned_again(empty_cache, mesh):
    vertices, faces = mesh
    bf.estimate_vertex_geometry(vertices, faces)
    moved = vertices.copy()
    moved[0] += 1e-9
    bf.estimate_vertex_geometry(moved, faces)
    bf.estimate_vertex_geometry(vertices, faces, degree=3)
    bf.estimate_vertex_geometry(vertices, faces[:, ::-1])
    assert len(model_cache._recent) == 4


def test_nothing_is_kept_of_what_is_given(empty_cache, mesh):
    bf.estimate_vertex_geometry(*mesh, rings=2, alpha=0.8)
    bf.estimate_vertex_geometry(*mesh, smoothness="paper")
    assert not model_cache._recent


def test_what_was_not_asked_for_longest_is_forgotten(empty_cache):
    fit = SurfaceFit(FitChoice(2, 3, None, None), ())
    for number in range(model_cache.MAX_CACHED_FITS + 1):
        model_cache.cache_fit(number, model_cache.CachedFit(fit, np.zeros(3, bool), None, None))
        assert model_cache.look_up_fit(0) is not None or number == model_cache.MAX_CACHED_FITS
        model_cache.look_up_fit(1)
    assert model_cache.look_up_fit(2) is None
    assert len(model_cache._recent) == model_cache.MAX_CACHED_FITS
    large = model_cache.CachedFit(fit, np.zeros(model_cache.MAX_CACHED_VERTICES + 1, bool), None, None)
    model_cache.cache_fit("large", large)
    assert model_cache.look_up_fit("large") is None


def test_threads_share_it(empty_cache, mesh):
    with ThreadPoolExecutor(2) as pool:
        results = list(pool.map(lambda _: bf.estimate_vertex_geometry(*mesh).k_max, range(8)))
    for k_max in results[1:]:
        np.testing.assert_array_equal(k_max, results[0])


@pytest.mark.skipif(config.DISABLE_JIT, reason="takes too long without the compiler")
def test_results_can_be_changed_without_changing_the_next_ones():
    vertices, faces = block_with_sharp_edges(resolution=16, jitter=0.2)
    vertices = vertices + 0.02 * np.random.default_rng(0).standard_normal(vertices.shape)
    first = bf.estimate_vertex_geometry(vertices, faces)
    assert first.noise_free is not None
    kept = first.noise_free.copy()
    first.noise_free[:] = 0.0
    for _ in range(2):
        again = bf.estimate_vertex_geometry(vertices, faces)
        np.testing.assert_array_equal(again.noise_free, kept)
        again.noise_free[:] = 0.0
