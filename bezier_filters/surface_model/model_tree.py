"""A regression tree of surface models, one per region of a mesh.

Noise, density and shape may vary over a mesh. A first fit with one specification gives each vertex two features,
curvedness and residual. The sample is split at the feature quantile that raises the likelihood most. Each
side gets its own `SurfaceModel`, and the split is kept if the mean logarithm of the predicted error drops enough.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Generic, TypeAlias, TypeVar

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.noise.noise_model import NoiseModel, rescale_noise
from bezier_filters.patches.harmonics import harmonic_basis
from bezier_filters.sampling.ring_analysis import FREE_DEGREE, RingAnalysis
from bezier_filters.surface_model.fit_options import FitOptions
from bezier_filters.surface_model.fit_spec import (
    THIRD_ORDER,
    FitSpec,
    best_spec,
    best_specs,
    predict_under_model,
    prefer_cubic,
    select_specs,
    specs_around,
    specs_to_first_minimum,
)
from bezier_filters.surface_model.model import RingModel, SurfaceModel, learn_surface_model

Kind = TypeVar("Kind")
Other = TypeVar("Other")

SPLIT_QUANTILES = (0.15, 0.3, 0.5, 0.7, 0.85)  # candidate thresholds of a feature
MIN_SPLIT_SAMPLES = 40  # neighbourhoods on each side of a split
MIN_SPLIT_GAIN = 0.1  # mean decrease of the logarithm of the predicted error by a split
MIN_CORRELATED_SPLIT_GAIN = 0.35  # the same under correlated noise, which is harder to separate from shape
MAX_TREE_DEPTH = 3  # splits above each leaf


@dataclass(frozen=True)
class Leaf:
    """Model and fit specifications of a region."""

    surface: SurfaceModel
    specs: tuple[FitSpec, ...]  # one for each ring
    chosen: FitSpec  # the best of them

    @property
    def analyses(self) -> list[RingAnalysis]:
        """The neighbourhoods that the model was estimated from, in ascending order of rings."""
        return [ring.analysis for ring in self.surface.by_rings]

    @property
    def centers(self) -> IntArray:
        """The sampled vertices, each once, in ascending order."""
        return np.unique(np.concatenate([analysis.centers for analysis in self.analyses]))

    def limit(self, options: FitOptions) -> "Leaf | None":
        """The same model with the best fit that the options allow; None if they allow none."""
        return best_leaf(self.surface, self.specs, options)


@dataclass(frozen=True)
class Split(Generic[Kind]):
    """Two regions: vertices whose feature is at most the threshold, and the others."""

    feature: int
    threshold: float
    low: "Kind | Split[Kind]"
    high: "Kind | Split[Kind]"


LearnAt: TypeAlias = Callable[[IntArray], Leaf | None]  # learns a leaf from the neighbourhoods of vertices
Tree: TypeAlias = Kind | Split[Kind]  # splits, and something of one kind at every leaf


def _ignore_overflow() -> np.errstate:
    """Ignore overflow: with coordinates of very different sizes some errors are infinite; such fits are skipped."""
    return np.errstate(over="ignore", invalid="ignore", divide="ignore")


def fit_leaf(
    analyses: Sequence[RingAnalysis],
    options: FitOptions,
    correlated: NoiseModel | None = None,
    *,
    heavy: bool = False,
    outliers: float = 0.0,
    known: Sequence[RingModel] = (),
) -> Leaf | None:
    """One model for all neighbourhoods; None if the analyses allow no fit. The noise is white unless `correlated`.

    `known` are models of single rings that were estimated before.
    """
    if not any(analysis.degree > FREE_DEGREE for analysis in analyses):
        return None
    if options.noise is not None:
        correlated = rescale_noise(correlated, options.noise)
    with _ignore_overflow():
        surface = learn_surface_model(analyses, correlated, known=known)
        surface = replace(surface, noise=replace(surface.noise, heavy=heavy, outliers=outliers))
        return best_leaf(surface, best_specs(surface, options.degrees), options)


def best_leaf(surface: SurfaceModel, specs: Sequence[FitSpec], options: FitOptions) -> Leaf | None:
    """A leaf with the best of the allowed fits; None if there is none."""
    finite = tuple(spec for spec in specs if np.isfinite(spec.error))
    allowed = select_specs(finite, options)
    if not allowed or not np.isfinite(surface.sigma):
        return None
    best = best_spec(specs_to_first_minimum(allowed) if surface.noise.sills else allowed)
    return Leaf(surface, finite, prefer_cubic(surface, best) if THIRD_ORDER in options.degrees else best)


def fit_region_leaf(root: Leaf, analyses: Sequence[RingAnalysis], options: FitOptions) -> Leaf | None:
    """A leaf for a region of another one; None if the analyses allow no fit.

    Rings with a much larger error keep the specifications of the root.
    """
    if not any(analysis.degree > FREE_DEGREE for analysis in analyses):
        return None
    with _ignore_overflow():
        surface = learn_surface_model(analyses, None if options.noise is None else root.surface.noise, root.surface)
        own = specs_around(surface, options.degrees, options.ring_count or root.chosen.rings)
        leaf = best_leaf(surface, own, options)
    others = (spec for spec in root.specs if spec.rings not in {spec.rings for spec in own})
    return None if leaf is None else replace(leaf, specs=(*own, *others))


def grow_tree(
    root: Leaf,
    vertices: IntArray,
    features: FloatArray,
    options: FitOptions,
    learn_at: LearnAt | None = None,
    depth: int = MAX_TREE_DEPTH,
) -> Tree[Leaf]:
    """Split a leaf while the gain is large enough, `depth` times at most.

    `vertices` (k,) of the leaf are the centers of its neighbourhoods, and perhaps others, in ascending order, with
    `features` (k, F). `learn_at` learns a leaf from wider neighbourhoods of its own vertices, where the widest ring of
    the root is the best.
    """
    likeliest = max(_candidates(root, vertices, features), default=None) if depth else None
    if likeliest is None:
        return root
    _, feature, threshold = likeliest
    is_low = features[:, feature] <= threshold
    sides = (is_low, ~is_low)
    parts = [_learn_side(root, vertices, side, options, learn_at) for side in sides]
    leaves_ = [leaf for leaf in parts if leaf is not None]
    if len(leaves_) < len(parts):
        return root
    gains = [log_error_reduction(root.chosen, leaf) for leaf in leaves_]
    sampled = np.searchsorted(vertices, max((part.centers for part in root.analyses), key=len))
    sizes = [int(side[sampled].sum()) for side in sides]
    min_gain = MIN_CORRELATED_SPLIT_GAIN if root.surface.noise.sills else MIN_SPLIT_GAIN
    if sum(s * n for s, n in zip(gains, sizes, strict=True)) <= min_gain * sum(sizes):
        return root
    low, high = (
        grow_tree(leaf, vertices[side], features[side], options, learn_at, depth - 1)
        for leaf, side in zip(leaves_, sides, strict=True)
    )
    return Split(feature, threshold, low, high)


def _learn_side(
    root: Leaf, vertices: IntArray, side: BoolArray, options: FitOptions, learn_at: LearnAt | None
) -> Leaf | None:
    """The leaf of the vertices where a mask is true; None if the sample of the root has no fit for them."""
    subsets = (part.subset(side[np.searchsorted(vertices, part.centers)]) for part in root.analyses)
    leaf = fit_region_leaf(root, [part for part in subsets if part is not None], options)
    if learn_at is None or leaf is None or leaf.chosen.rings < root.analyses[-1].rings:
        return leaf
    wider = learn_at(vertices[side])
    return leaf if wider is None or wider.chosen.error >= leaf.chosen.error else wider


def log_error_reduction(spec: FitSpec, leaf: Leaf) -> float:
    """Logarithm of the predicted error of a fit over that of the leaf's own fit; -inf if the leaf has no such ring."""
    before = predict_under_model(spec, leaf.surface)
    smallest = np.finfo(np.float64).tiny  # on exact planes there is no error at all
    if before is None:
        return -np.inf
    return float(np.log(max(before.error, smallest)) - np.log(max(leaf.chosen.error, smallest)))


def leaves(tree: Tree[Kind]) -> list[Kind]:
    """The leaves, from left to right."""
    return leaves(tree.low) + leaves(tree.high) if isinstance(tree, Split) else [tree]


def map_leaves(tree: Tree[Kind], function: Callable[[Kind], Other]) -> Tree[Other]:
    """The tree with a function applied to every leaf."""
    if not isinstance(tree, Split):
        return function(tree)
    low, high = map_leaves(tree.low, function), map_leaves(tree.high, function)
    return Split(tree.feature, tree.threshold, low, high)


def leaf_numbers(tree: Tree[Kind], features: FloatArray) -> IntArray:
    """Which of the `leaves` each row of features (n, F) belongs to, (n,)."""
    if not isinstance(tree, Split):
        return np.zeros(len(features), dtype=np.int32)
    low, high = leaf_numbers(tree.low, features), leaf_numbers(tree.high, features)
    is_low: BoolArray = features[:, tree.feature] <= tree.threshold
    return np.where(is_low, low, high + len(leaves(tree.low))).astype(np.int32)


def _candidates(root: Leaf, vertices: IntArray, features: FloatArray) -> Iterator[tuple[float, int, float]]:
    """Candidate splits: gain of the log likelihood, feature, threshold."""
    analysis = next(analysis for analysis in root.analyses if analysis.rings == root.chosen.rings)
    of_rows = features[np.searchsorted(vertices, analysis.centers)]
    everywhere = np.ones(len(of_rows), dtype=np.bool_)
    for feature in range(of_rows.shape[1]):
        for threshold in np.unique(np.quantile(of_rows[:, feature], SPLIT_QUANTILES)):
            low = of_rows[:, feature] <= threshold
            if min(low.sum(), (~low).sum()) < MIN_SPLIT_SAMPLES:
                continue
            gain = _log_likelihood(analysis, low) + _log_likelihood(analysis, ~low)
            gain -= _log_likelihood(analysis, everywhere)
            yield gain, feature, float(threshold)


def separate_magnitudes(values: FloatArray) -> float:
    """The value that separates small from large magnitudes with the least variance of the logarithms within both.

    (Otsu, "A threshold selection method from gray-level histograms", IEEE Transactions on Systems, Man, and
    Cybernetics 9, 1979.) Both sides have at least `MIN_SPLIT_SAMPLES`; infinite if there are too few values.

    >>> separate_magnitudes(np.repeat([1e-9, 2e-9, 0.1, 0.3], [50, 50, 30, 20]))
    2e-09
    """
    ordered, n = np.sort(np.abs(values)), len(values)
    counts = np.arange(MIN_SPLIT_SAMPLES, n - MIN_SPLIT_SAMPLES + 1)
    if not len(counts) or ordered[-1] == 0.0:
        return np.inf
    sums = np.cumsum(np.log(np.maximum(ordered / ordered[-1], np.finfo(np.float64).eps)))
    low, high = sums[counts - 1], sums[-1] - sums[counts - 1]
    between = np.square(low) / counts + np.square(high) / (n - counts)
    return float(ordered[counts[between.argmax()] - 1])


def _log_likelihood(analysis: RingAnalysis, rows: BoolArray) -> float:
    """Maximum log likelihood of Gaussian terms of degree 3 and more and of Gaussian residuals, with own variances."""
    free = harmonic_basis().term_count(FREE_DEGREE)
    groups = harmonic_basis().groups[free : analysis.sums.scores.shape[1]]
    groups = groups - harmonic_basis().groups[free]
    sums = np.bincount(groups, weights=np.square(analysis.sums.scores[rows, free:]).sum(axis=0))
    counts = np.bincount(groups) * rows.sum()
    sums = np.append(sums, analysis.sums.residuals[rows, -1].sum())
    counts = np.append(counts, analysis.sums.freedom[rows, -1].sum())
    return float(-0.5 * (counts * np.log(np.maximum(sums, 1e-300) / np.maximum(counts, 1.0))).sum())
