"""What was learned of a mesh is used again for the same arrays and options, and for nothing else."""

import dataclasses
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import bezier_filters as bf
from bezier_filters.estimation import remembered
from bezier_filters.estimation.adaptive_fit import SurfaceFit
from bezier_filters.estimation.estimate import geometry_where
from bezier_filters.estimation.vertex_geometry import FitChoice
from bezier_filters.meshes.adjacency import vertex_adjacency
from bezier_filters.meshes.mesh import triangle_mesh
from bezier_filters.surfaces import block_with_sharp_edges, bumpy_star


def arrays_of(geometry):
    return {field.name: getattr(geometry, field.name) for field in dataclasses.fields(geometry)}


@pytest.fixture
def nothing_known(monkeypatch):
    monkeypatch.setattr(remembered, "_recent", type(remembered._recent)())


@pytest.fixture(params=["star", "block"])
def mesh(request):
    if request.param == "star":
        star = bumpy_star(resolution=8)
        vertices, faces = star.vertices, star.faces
    else:
        vertices, faces = block_with_sharp_edges(resolution=8)
    edge = np.linalg.norm(vertices[faces[:, 0]] - vertices[faces[:, 1]], axis=1).mean()
    return vertices + np.random.default_rng(5).normal(0.0, 0.1 * edge, vertices.shape), faces


def test_the_second_call_gives_the_same_to_the_last_bit(nothing_known, mesh):
    first, second = (arrays_of(bf.estimate_vertex_geometry(*mesh)) for _ in range(2))
    assert len(remembered._recent) == 1
    for name, values in first.items():
        np.testing.assert_array_equal(second[name], values, err_msg=name)


def test_so_does_a_selection_after_the_whole(nothing_known, mesh):
    selected = np.arange(len(mesh[0])) % 7 == 0
    alone = bf.estimate_vertex_geometry(*mesh, selected=selected)
    remembered._recent.clear()
    bf.estimate_vertex_geometry(*mesh)
    after = bf.estimate_vertex_geometry(*mesh, selected=selected)
    for name in ("normals", "k_min", "extremality_max", "mean_curvature_std", "status"):
        np.testing.assert_array_equal(getattr(after, name), getattr(alone, name), err_msg=name)


@pytest.mark.parametrize("order", ["its own first", "that of space first"])
def test_so_does_a_mesh_in_its_own_order_after_that_of_space(nothing_known, mesh, order):
    """Holes are surrounded by few vertices, for which a mesh is not sorted; where patches end is told by the mesh."""
    own = triangle_mesh(*mesh)
    ways = [
        lambda: geometry_where(own, vertex_adjacency(own), lambda _: np.ones(len(mesh[0]), dtype=bool)),
        lambda: bf.estimate_vertex_geometry(*mesh),
    ]
    learn, recall = ways if order == "its own first" else ways[::-1]
    alone = recall()
    remembered._recent.clear()
    learn()
    after = recall()
    assert len(remembered._recent) == 1
    np.testing.assert_array_equal(after.status, alone.status)
    for name in ("normals", "k_min", "mean_curvature_std"):
        values = getattr(alone, name)
        np.testing.assert_allclose(getattr(after, name), values, atol=1e-9 * np.abs(values).max(), err_msg=name)


def test_other_arrays_or_options_are_learned_anew(nothing_known, mesh):
    vertices, faces = mesh
    bf.estimate_vertex_geometry(vertices, faces)
    moved = vertices.copy()
    moved[0] += 1e-9
    bf.estimate_vertex_geometry(moved, faces)
    bf.estimate_vertex_geometry(vertices, faces, degree=3)
    bf.estimate_vertex_geometry(vertices, faces[:, ::-1])
    assert len(remembered._recent) == 4


def test_nothing_is_kept_of_what_is_given(nothing_known, mesh):
    bf.estimate_vertex_geometry(*mesh, rings=2, alpha=0.8)
    bf.estimate_vertex_geometry(*mesh, smoothness="paper")
    assert not remembered._recent


def test_what_was_not_asked_for_longest_is_forgotten(nothing_known):
    fit = SurfaceFit(FitChoice(2, 3, None, None), ())
    for number in range(remembered.MOST + 1):
        remembered.remember(number, remembered.LearnedFit(fit, np.zeros(3, bool), None, None))
        assert remembered.recall(0) is not None or number == remembered.MOST
        remembered.recall(1)
    assert remembered.recall(2) is None
    assert len(remembered._recent) == remembered.MOST
    large = remembered.LearnedFit(fit, np.zeros(remembered.LARGEST + 1, bool), None, None)
    remembered.remember("large", large)
    assert remembered.recall("large") is None


def test_threads_share_it(nothing_known, mesh):
    with ThreadPoolExecutor(2) as pool:
        results = list(pool.map(lambda _: bf.estimate_vertex_geometry(*mesh).k_max, range(8)))
    for k_max in results[1:]:
        np.testing.assert_array_equal(k_max, results[0])
