"""Parts of a surface get models of their own where noise or shape differ, and only there."""

import numpy as np
import pytest
from random_neighbourhoods import analyse_ring, as_sample, draw, variances_by_degree

from bezier_filters.noise.noise_model import NoiseModel
from bezier_filters.patches.harmonics import harmonic_basis
from bezier_filters.surface_model.fit_options import FitOptions
from bezier_filters.surface_model.fit_spec import FitSpec
from bezier_filters.surface_model.model import SurfaceModel
from bezier_filters.surface_model.model_tree import (
    MIN_SPLIT_SAMPLES,
    Leaf,
    Split,
    _candidates,
    fit_leaf,
    grow_tree,
    leaf_numbers,
    leaves,
)

CALM, ROUGH = variances_by_degree(1e-4, 0.1), variances_by_degree(1.0, 0.3)


def grown(halves, features):
    """The tree over one ring, half of whose neighbourhoods are drawn from either model."""
    points = np.concatenate([drawn.points for drawn in halves])
    order = np.random.default_rng(0).permutation(len(points))  # samples are drawn at random
    points, features = points[order], features[order]
    analysis = analyse_ring(as_sample(points), 3, len(points))
    root = fit_leaf([analysis], FitOptions())
    return root, grow_tree(root, np.arange(len(features)), features, FitOptions())


def two_kinds(variances, sigmas):
    return [draw(150, 37, v, s, seed=k) for k, (v, s) in enumerate(zip(variances, sigmas, strict=True))]


IS_SECOND = (np.arange(300) >= 150).astype(float)
NOISE = np.random.default_rng(0).standard_normal(300)


def test_parts_with_different_noise_are_told_apart_and_their_noise_is_found():
    halves = two_kinds((CALM, CALM), (0.01, 0.1))
    _, tree = grown(halves, np.column_stack([NOISE, IS_SECOND]))
    assert tree.feature == 1
    assert 0.0 <= tree.threshold < 1.0
    sigmas = [leaf.surface.sigma for leaf in leaves(tree)]
    np.testing.assert_allclose(sigmas[0], 0.01, rtol=0.15)
    np.testing.assert_allclose(sigmas[-1], 0.1, rtol=0.15)


def test_parts_with_different_shape_are_told_apart():
    halves = two_kinds((CALM, ROUGH), (0.01, 0.01))
    _, tree = grown(halves, np.column_stack([IS_SECOND, NOISE]))
    assert tree.feature == 0
    cubic = harmonic_basis().degrees == 3
    low, high = leaves(tree)[0], leaves(tree)[-1]
    assert low.surface.by_rings[0].variances[cubic].max() < 1e-3
    np.testing.assert_allclose(high.surface.by_rings[0].variances[cubic], 1.0, rtol=0.5)
    assert low.chosen.error < high.chosen.error


@pytest.mark.parametrize("seed", range(4))
def test_nothing_is_split_by_features_that_say_nothing(seed):
    features = np.random.default_rng(seed).standard_normal((300, 2))
    root, tree = grown(two_kinds((CALM, CALM), (0.01, 0.01)), features)
    assert tree is root


def test_splits_gain_the_same_whichever_side_comes_first_and_lose_nothing():
    """Two models are at least as likely as one, whose variances are among theirs; -f splits the other way round."""
    points = np.concatenate([drawn.points for drawn in two_kinds((CALM, ROUGH), (0.01, 0.1))])
    analysis = analyse_ring(as_sample(points), 3, len(points))
    features = np.column_stack([NOISE, -NOISE, IS_SECOND + 0.1 * NOISE])
    splits = list(_candidates(fit_leaf([analysis], FitOptions()), np.arange(len(features)), features))
    gains = [[gain for gain, feature, _ in splits if feature == k] for k in range(3)]
    np.testing.assert_allclose(gains[0], gains[1][::-1])
    assert min(map(min, gains)) >= 0.0
    assert np.argmax(gains[2]) == len(gains[2]) // 2  # the middle, between both kinds
    assert max(gains[2]) > 10.0 * max(gains[0])


def test_no_side_gets_fewer_neighbourhoods_than_a_model_needs():
    few = (np.arange(300) >= 300 - MIN_SPLIT_SAMPLES + 5).astype(float)
    halves = [draw(265, 37, CALM, 0.01, seed=1), draw(35, 37, CALM, 1.0, seed=2)]
    root, tree = grown(halves, few[:, np.newaxis])
    assert tree is root


def test_leaves_are_numbered_from_left_to_right():
    spec = FitSpec(1, 2, 7.0, 1.0, np.zeros(6), np.inf, 0.0, 0.0)
    a, b, c = (Leaf(SurfaceModel(NoiseModel(sigma**2), ()), (spec,), spec) for sigma in (1.0, 2.0, 3.0))
    tree = Split(1, 5.0, a, Split(0, 2.0, b, c))
    assert leaves(tree) == [a, b, c]
    features = np.array([[9.0, 5.0], [2.0, 6.0], [2.1, 6.0], [0.0, -1.0]])
    assert leaf_numbers(tree, features).tolist() == [0, 1, 2, 0]
    assert leaf_numbers(a, features).tolist() == [0, 0, 0, 0]
