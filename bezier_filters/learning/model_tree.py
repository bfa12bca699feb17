"""A model for every part of a surface: a regression tree over what a first fit shows.

Noise, density and shape may vary over a mesh. A first fit with one plan for all gives each vertex
a curvedness and a residual; a sample split by one of them may have different models on both
sides, and where the predicted error drops, the split stays.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Generic, TypeAlias, TypeVar

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.learning.noise_model import NoiseModel, known_noise
from bezier_filters.learning.plans import (
    THIRD_ORDER,
    Choices,
    FitPlan,
    all_plans,
    best_plan,
    first_valley,
    plan_for,
    plans_around,
    steady_plan,
)
from bezier_filters.learning.ring_analysis import FREE_DEGREE, RingAnalysis
from bezier_filters.learning.surface_model import RingModel, SurfaceModel, learn_model
from bezier_filters.patches.harmonics import harmonic_basis

Kind = TypeVar("Kind")
Other = TypeVar("Other")
Features = Callable[[IntArray], FloatArray]  # gives the features (k, F) of vertices (k,)

QUANTILES = (0.15, 0.3, 0.5, 0.7, 0.85)  # where a sample is tried to be split
FEWEST_ON_A_SIDE = 40  # neighbourhoods of the sample that a model of its own needs
WORTHWHILE = 0.1  # mean logarithm of the predicted error that a split must save,
WORTHWHILE_IF_CORRELATED = 0.35  # and under correlated noise, which is less surely told from the shape of a part
DEEPEST = 3  # splits above each leaf


@dataclass(frozen=True)
class Leaf:
    """A part of the surface: its model and plans."""

    surface: SurfaceModel
    plans: tuple[FitPlan, ...]  # one for each ring
    chosen: FitPlan  # the best of them


@dataclass(frozen=True)
class Split(Generic[Kind]):
    """Two parts: vertices whose feature is at most the threshold, and the others."""

    feature: int
    threshold: float
    low: "Kind | Split[Kind]"
    high: "Kind | Split[Kind]"


Tree: TypeAlias = Kind | Split[Kind]  # splits, and something of one kind at every leaf


def _overflows() -> np.errstate:
    """Where coordinates are of very different sizes, some plans have no finite error, and are left out."""
    return np.errstate(over="ignore", invalid="ignore", divide="ignore")


def leaf_of(
    analyses: Sequence[RingAnalysis],
    choices: Choices,
    correlated: NoiseModel | None = None,
    *,
    heavy: bool = False,
    outliers: float = 0.0,
    known: Sequence[RingModel] = (),
) -> Leaf | None:
    """One model for all; None if the analyses allow no plan. The noise is white unless it is known to be otherwise.

    `known` is what some of the analyses have said by themselves.
    """
    if not any(analysis.degree > FREE_DEGREE for analysis in analyses):
        return None
    if choices.noise is not None:
        correlated = known_noise(correlated, choices.noise)
    with _overflows():
        surface = learn_model(analyses, correlated, known=known)
        surface = replace(surface, noise=replace(surface.noise, heavy=heavy, outliers=outliers))
        return best_leaf(surface, all_plans(surface, choices.degrees), choices)


def best_leaf(surface: SurfaceModel, plans: Sequence[FitPlan], choices: Choices) -> Leaf | None:
    """A leaf with the best of the plans that may be chosen; None if there is none."""
    sound = tuple(plan for plan in plans if np.isfinite(plan.error))
    allowed = choices.among(sound)
    if not allowed or not np.isfinite(surface.sigma):
        return None
    best = best_plan(first_valley(allowed) if surface.noise.sills else allowed)
    return Leaf(surface, sound, steady_plan(surface, best) if THIRD_ORDER in choices.degrees else best)


def part_of(root: Leaf, analyses: Sequence[RingAnalysis], choices: Choices) -> Leaf | None:
    """A model for a part of what another leaf is the model of; None if the analyses allow no plan.

    Rings that would do much worse keep the plans of the whole.
    """
    if not any(analysis.degree > FREE_DEGREE for analysis in analyses):
        return None
    with _overflows():
        surface = learn_model(analyses, None if choices.noise is None else root.surface.noise, root.surface)
        own = plans_around(surface, choices.degrees, choices.rings or root.chosen.rings)
        leaf = best_leaf(surface, own, choices)
    others = (plan for plan in root.plans if plan.rings not in {plan.rings for plan in own})
    return None if leaf is None else replace(leaf, plans=(*own, *others))


def grow(
    root: Leaf, analyses: Sequence[RingAnalysis], features: Features, choices: Choices, depth: int = DEEPEST
) -> Tree[Leaf]:
    """Split a leaf, the model of some neighbourhoods, as long as that is worthwhile, `depth` times at most.

    `features` is asked for those at the centers of neighbourhoods.
    """
    likeliest = max(_candidates(root, analyses, features), default=None) if depth else None
    if likeliest is None:
        return root
    _, feature, threshold = likeliest
    halves = (
        [part.where((features(part.centers)[:, feature] <= threshold) == is_low) for part in analyses]
        for is_low in (True, False)
    )
    sides = [[part for part in half if part is not None] for half in halves]
    parts = [part_of(root, side, choices) for side in sides]
    leaves_ = [leaf for leaf in parts if leaf is not None]
    if len(leaves_) < len(parts):
        return root
    gains = [saved(root.chosen, leaf) for leaf in leaves_]
    sizes = [max(len(part.centers) for part in side) for side in sides]
    worthwhile = WORTHWHILE_IF_CORRELATED if root.surface.noise.sills else WORTHWHILE
    if sum(s * n for s, n in zip(gains, sizes, strict=True)) <= worthwhile * sum(sizes):
        return root
    low, high = (grow(leaf, side, features, choices, depth - 1) for leaf, side in zip(leaves_, sides, strict=True))
    return Split(feature, threshold, low, high)


def saved(plan: FitPlan, leaf: Leaf) -> float:
    """Logarithm of what a leaf's own plan takes off the predicted error of another; -inf if it has no such ring."""
    before = plan_for(plan, leaf.surface)
    smallest = np.finfo(np.float64).tiny  # on exact planes there is no error at all
    if before is None:
        return -np.inf
    return float(np.log(max(before.error, smallest)) - np.log(max(leaf.chosen.error, smallest)))


def leaves(tree: Tree[Kind]) -> list[Kind]:
    """The leaves, from left to right."""
    return leaves(tree.low) + leaves(tree.high) if isinstance(tree, Split) else [tree]


def at_leaves(tree: Tree[Kind], function: Callable[[Kind], Other]) -> Tree[Other]:
    """The same tree with something else at every leaf."""
    if not isinstance(tree, Split):
        return function(tree)
    low, high = at_leaves(tree.low, function), at_leaves(tree.high, function)
    return Split(tree.feature, tree.threshold, low, high)


def leaf_numbers(tree: Tree[Kind], features: FloatArray) -> IntArray:
    """Which of the `leaves` each row of features (n, F) belongs to, (n,)."""
    if not isinstance(tree, Split):
        return np.zeros(len(features), dtype=np.int32)
    low, high = leaf_numbers(tree.low, features), leaf_numbers(tree.high, features)
    is_low: BoolArray = features[:, tree.feature] <= tree.threshold
    return np.where(is_low, low, high + len(leaves(tree.low))).astype(np.int32)


def _candidates(root: Leaf, analyses: Sequence[RingAnalysis], features: Features) -> Iterator[tuple[float, int, float]]:
    """Possible splits with what they add to the log likelihood of the sample: gain, feature, threshold."""
    analysis = next(analysis for analysis in analyses if analysis.rings == root.chosen.rings)
    of_rows = features(analysis.centers)
    everywhere = np.ones(len(of_rows), dtype=np.bool_)
    for feature in range(of_rows.shape[1]):
        for threshold in np.unique(np.quantile(of_rows[:, feature], QUANTILES)):
            low = of_rows[:, feature] <= threshold
            if min(low.sum(), (~low).sum()) < FEWEST_ON_A_SIDE:
                continue
            gain = _log_likelihood(analysis, low) + _log_likelihood(analysis, ~low)
            gain -= _log_likelihood(analysis, everywhere)
            yield gain, feature, float(threshold)


def _log_likelihood(analysis: RingAnalysis, rows: BoolArray) -> float:
    """Of Gaussian terms of degree 3 and more and a Gaussian rest, each with its own variance."""
    free = harmonic_basis().term_count(FREE_DEGREE)
    groups = harmonic_basis().groups[free : analysis.sums.parts.shape[1]]
    groups = groups - harmonic_basis().groups[free]
    sums = np.bincount(groups, weights=np.square(analysis.sums.parts[rows, free:]).sum(axis=0))
    counts = np.bincount(groups) * rows.sum()
    sums = np.append(sums, analysis.sums.residuals[rows, -1].sum())
    counts = np.append(counts, analysis.sums.freedom[rows, -1].sum())
    return float(-0.5 * (counts * np.log(np.maximum(sums, 1e-300) / np.maximum(counts, 1.0))).sum())
