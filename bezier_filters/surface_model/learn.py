"""Estimates a `SurfaceModel` and the best fit from sampled neighbourhoods, ring by ring.

The first stage analyses rings 1 to `FIRST_STAGE_MAX_RINGS` and estimates the noise covariance and the outlier share.
Wider rings follow while their neighbourhoods are usable and the predicted error does not grow too much.
"""

from dataclasses import replace
from functools import cache

import numpy as np

from bezier_filters.arrays import IntArray
from bezier_filters.noise.neighbourhoods import Neighbourhoods
from bezier_filters.noise.noise_evidence import learn_noise_covariance
from bezier_filters.noise.outliers import OUTLIER_RINGS, STANDING_PLACES, outlier_share, stand_out
from bezier_filters.sampling.neighbourhood_samples import (
    NORMAL_CHECK_RINGS,
    NeighbourhoodSample,
    SampleMode,
)
from bezier_filters.sampling.ring_analysis import RingAnalysis, analyse_rings
from bezier_filters.sampling.sample_check import MIN_USABLE_SHARE, explain_unusable_sample
from bezier_filters.surface_model.fit_options import FitOptions
from bezier_filters.surface_model.model import RingModel, estimate_white_noise
from bezier_filters.surface_model.model_tree import Leaf, fit_leaf

CANDIDATE_RINGS = (1, 2, 3, 4, 5, 6, 8, 10)
FIRST_STAGE_MAX_RINGS = 5  # most meshes need no wider rings, and many neighbourhoods of these are cheap
# neighbourhoods analysed per ring: fewer of the wider ones, which have more points each
SAMPLES_PER_RING = {1: 300, 2: 400, 3: 400, 4: 240, 5: 180, 6: 200, 8: 160, 10: 120}
MAX_UNUSABLE_FRACTION = 0.05  # fraction of unusable neighbourhoods above which these are searched for outliers, too
MAX_ERROR_GROWTH = 10.0  # growth of the predicted error at which no wider rings are tried

# Noise is heavy if the fraction of neighbourhoods with a flipped normal and the fraction of flipped normals are larger,
HEAVY_FLIPPED_PLACES, HEAVY_FLIPPED_NORMALS = 0.03, 0.0015
# and so is the median over the neighbourhoods of the rms height over the rms distance; at knife edges only few are
HEAVY_MEDIAN_SLOPE = 0.25


def learn_surface(
    source: Neighbourhoods,
    options: FitOptions,
    *,
    at: IntArray | None = None,
    mode: SampleMode | None = None,
    only_noise: bool = False,
) -> Leaf | None:
    """Analyse rings of ascending width, and estimate one model from all of them.

    The given ring is always analysed if it has enough usable neighbourhoods; `Leaf.limit` selects it. The centers of
    the neighbourhoods are drawn from all vertices, or are the first ones of `at`; on request all are sampled in one
    `mode`. If only the noise is needed, not all rings are analysed. None if no fit is possible.
    """
    draw, fixed, rounding = cache(source.draw), options.ring_count, source.rounding

    def sample_at(rings: int, count: int, wanted: SampleMode) -> NeighbourhoodSample:
        return source.sample(draw(count) if at is None else at[:count], rings, mode or wanted)

    rings = sorted({*CANDIDATE_RINGS, *(() if fixed is None else (fixed,))})
    stages = [[k for k in rings if k <= FIRST_STAGE_MAX_RINGS], *([k] for k in rings if k > FIRST_STAGE_MAX_RINGS)]
    analyses: list[RingAnalysis] = []
    known: list[RingModel] = []
    errors: list[float] = []
    leaf: Leaf | None = None
    correlated, promising, heavy, outliers = None, True, False, 0.0
    any_rings = replace(options, rings="auto")
    for stage in stages:
        if not promising and fixed not in stage:
            continue
        count = SAMPLES_PER_RING[2] if stage is stages[0] else SAMPLES_PER_RING[6]
        sample = sample_at(stage[-1], count, "smoothed" if heavy else "plain")
        if stage is stages[0] and _has_flipped_normals(sample):
            smoothed = sample_at(stage[-1], count, "smoothed")
            heavy = _is_rough(smoothed) and not _has_flipped_normals(smoothed)
            sample = smoothed if heavy else sample
        most: dict[int, int] = {}
        for k in stage:
            promising = promising and sample.usable[:, k].sum() >= MIN_USABLE_SHARE * sample.is_interior[:, k].sum()
            if promising or k == fixed or not (analyses or most):
                most[k] = SAMPLES_PER_RING.get(k, SAMPLES_PER_RING[10])
        found = analyse_rings(sample, most, vertex_count=source.vertex_count, noise_floor=rounding.variance)
        if not found:
            continue
        analyses += found
        if stage is stages[0]:
            correlated = learn_noise_covariance(analyses)
            if correlated is None and rounding.sills:
                correlated = rounding
            elif correlated is not None:
                missing = max(rounding.variance - correlated.variance, 0.0)
                correlated = replace(correlated, white=correlated.white + missing)
            # many unusable neighbourhoods: outliers may be the cause
            has_many = (~sample.usable[:, OUTLIER_RINGS]).mean() > MAX_UNUSABLE_FRACTION
            outliers = outlier_share(sample_at(OUTLIER_RINGS, count, "tolerant") if has_many else sample)
            if outliers and not stand_out(sample_at(OUTLIER_RINGS, STANDING_PLACES, "tolerant")):
                outliers = 0.0
        # by itself first: corrections of narrow rings by wider ones do not matter for the decision to continue
        alone = fit_leaf(found, any_rings, correlated or estimate_white_noise(analyses), heavy=heavy, outliers=outliers)
        if alone is not None:
            leaf = alone
            known += leaf.surface.by_rings
            errors += [spec.error for spec in leaf.specs]
            promising = promising and errors[-1] <= MAX_ERROR_GROWTH * min(errors)
        if only_noise and correlated is not None:
            break
    if not only_noise and (leaf is None or len(leaf.surface.by_rings) < len(analyses)):
        leaf = fit_leaf(analyses, any_rings, correlated, heavy=heavy, outliers=outliers, known=known)
    return leaf


def learn_without_outliers(source: Neighbourhoods, options: FitOptions, *, only_noise: bool = False) -> Leaf | None:
    """Learn a surface without its outliers, if it has any or if the fit is to be robust.

    The noise model keeps the share of the outliers.
    """
    leaf = learn_surface(source.clean if options.robust else source, options, only_noise=only_noise)
    if options.robust is not None or leaf is None or not leaf.surface.noise.outliers:
        return leaf
    share = leaf.surface.noise.outliers
    leaf = learn_surface(source.clean, options, only_noise=only_noise)
    if leaf is None:
        return None
    surface = replace(leaf.surface, noise=replace(leaf.surface.noise, outliers=share))
    return replace(leaf, surface=surface)


def explain_unknown_surface(source: Neighbourhoods) -> str:
    """Say why `learn_surface` finds no model."""
    drawn = source.draw(SAMPLES_PER_RING[NORMAL_CHECK_RINGS])
    return explain_unusable_sample(source.sample(drawn, NORMAL_CHECK_RINGS, "plain"))


def _has_flipped_normals(sample: NeighbourhoodSample) -> bool:
    """Whether many normals are flipped, and in many neighbourhoods: at thin walls they are in few."""
    if not len(sample.flipped_fraction):
        return False
    return bool(
        sample.flipped_fraction.mean() > HEAVY_FLIPPED_NORMALS
        and (sample.flipped_fraction > 0.0).mean() > HEAVY_FLIPPED_PLACES
    )


def _is_rough(sample: NeighbourhoodSample) -> bool:
    """Whether the median slope from a vertex to its neighbours is large."""
    seen = sample.usable[:, 1:].any(axis=1)
    is_near = np.arange(sample.points.shape[1]) < sample.sizes[:, 1:2]
    x, y, z = np.moveaxis(np.square(sample.points).sum(axis=1, where=is_near[..., np.newaxis])[seen], 1, 0)
    return bool(seen.any() and np.median(z / np.maximum(x + y, np.finfo(np.float64).tiny)) > HEAVY_MEDIAN_SLOPE**2)
