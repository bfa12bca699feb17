"""Estimates a `SurfaceModel` and the best fit from sampled neighbourhoods, ring by ring.

The first stage analyses rings 1 to `FIRST_STAGE_MAX_RINGS` and estimates the noise covariance and the outlier share.
Wider rings follow while their neighbourhoods are usable and the predicted error does not grow too much.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from typing import Literal

import numpy as np

from bezier_filters.arrays import IntArray
from bezier_filters.kernels.kernel_input import KernelMesh, recompute_barriers, use_smoothed_normals
from bezier_filters.surface_model.fit_spec import FitConstraints
from bezier_filters.surface_model.model import RingModel, estimate_white_noise
from bezier_filters.surface_model.model_tree import Leaf, best_leaf, fit_leaf
from bezier_filters.surface_model.neighbourhood_samples import (
    NORMAL_CHECK_RINGS,
    NeighbourhoodSample,
    draw_from_mesh,
    sample_neighbourhoods,
)
from bezier_filters.surface_model.noise_spectrum import learn_noise_covariance
from bezier_filters.surface_model.outliers import OUTLIER_RINGS, outlier_share
from bezier_filters.surface_model.ring_analysis import RingAnalysis, analyse_rings
from bezier_filters.surface_model.sample_check import MIN_USABLE_SHARE, explain_unusable_sample

CANDIDATE_RINGS = (1, 2, 3, 4, 5, 6, 8, 10)
FIRST_STAGE_MAX_RINGS = 5  # most meshes need no wider rings, and many neighbourhoods of these are cheap
# neighbourhoods analysed per ring: fewer of the wider ones, which have more points each
SAMPLES_PER_RING = {1: 300, 2: 400, 3: 400, 4: 240, 5: 180, 6: 200, 8: 160, 10: 120}
# fraction of flipped normals, more than 90 degrees off the plane, in a usable neighbourhood
MAX_FLIPPED_FRACTION = 0.02
MAX_FLIPPED_BY_OUTLIERS = 0.25  # the same in the search for outliers, which flip more normals
MAX_UNUSABLE_FRACTION = 0.05  # fraction of unusable neighbourhoods above which these are searched for outliers, too
MAX_ERROR_GROWTH = 10.0  # growth of the predicted error at which no wider rings are tried

# Noise is heavy if the fraction of neighbourhoods with a flipped normal and the fraction of flipped normals are larger,
HEAVY_FLIPPED_PLACES, HEAVY_FLIPPED_NORMALS = 0.03, 0.0015
# and so is the median over the neighbourhoods of the rms height over the rms distance; at knife edges only few are
HEAVY_MEDIAN_SLOPE = 0.25

# how neighbourhoods are sampled: from the mesh; with smoothed normals; or without the sharp edges around single spikes
# and with more flipped normals
SampleMode = Literal["plain", "steady", "tolerant"]
# (rings, count, mode): neighbourhoods of `count` vertices
Sampler = Callable[[int, int, SampleMode], NeighbourhoodSample]


def learn_surface(mesh: KernelMesh, constraints: FitConstraints) -> tuple[list[RingAnalysis], Leaf | None]:
    """Analyse rings of ascending width, and estimate one model from all of them.

    The ring in the constraints is always analysed if it has enough usable neighbourhoods. The list is empty for meshes
    with too few usable neighbourhoods; the leaf is None if no fit is possible.
    """
    drawn = cache(partial(draw_from_mesh, mesh))

    def sample(rings: int, count: int, mode: SampleMode) -> NeighbourhoodSample:
        return sample_by_mode(mesh, drawn(count), rings, mode)

    return learn_from_samples(sample, len(mesh.vertices), constraints)


def sample_by_mode(mesh: KernelMesh, ids: IntArray, rings: int, mode: SampleMode) -> NeighbourhoodSample:
    """Neighbourhoods of the vertices `ids` in one of the modes."""
    max_flipped_fraction = MAX_FLIPPED_FRACTION
    if mode == "steady":
        mesh = use_smoothed_normals(mesh)
    if mode == "tolerant":
        mesh, max_flipped_fraction = recompute_barriers(mesh), MAX_FLIPPED_BY_OUTLIERS
    return sample_neighbourhoods(mesh, ids, rings=rings, max_flipped_fraction=max_flipped_fraction)


def explain_unusable_mesh(mesh: KernelMesh) -> str:
    """Say why `learn_surface` finds no model of a mesh."""
    return explain_unusable_sample(
        sample_by_mode(mesh, draw_from_mesh(mesh, SAMPLES_PER_RING[NORMAL_CHECK_RINGS]), NORMAL_CHECK_RINGS, "plain")
    )


def learn_from_samples(
    sampler: Sampler, vertex_count: int, constraints: FitConstraints
) -> tuple[list[RingAnalysis], Leaf | None]:
    """`learn_surface` for a mesh of which only samples are available.

    ``sampler(rings, count, mode)`` returns neighbourhoods, of the same vertices for the same count.
    """
    rings = sorted({*CANDIDATE_RINGS, *(() if constraints.rings is None else (constraints.rings,))})
    stages = [[k for k in rings if k <= FIRST_STAGE_MAX_RINGS], *([k] for k in rings if k > FIRST_STAGE_MAX_RINGS)]
    analyses: list[RingAnalysis] = []
    known: list[RingModel] = []
    errors: list[float] = []
    leaf: Leaf | None = None
    correlated, promising, heavy, outliers = None, True, False, 0.0
    any_rings = replace(constraints, rings=None)
    for stage in stages:
        if not promising and constraints.rings not in stage:
            continue
        count = SAMPLES_PER_RING[2] if stage is stages[0] else SAMPLES_PER_RING[6]
        sample = sampler(stage[-1], count, "steady" if heavy else "plain")
        if stage is stages[0] and _has_flipped_normals(sample):
            steady = sampler(stage[-1], count, "steady")
            heavy = _is_rough(steady) and not _has_flipped_normals(steady)
            sample = steady if heavy else sample
        most: dict[int, int] = {}
        for k in stage:
            promising = promising and sample.usable[:, k].sum() >= MIN_USABLE_SHARE * sample.is_interior[:, k].sum()
            if promising or k == constraints.rings or not (analyses or most):
                most[k] = SAMPLES_PER_RING.get(k, SAMPLES_PER_RING[10])
        found = analyse_rings(sample, most, vertex_count=vertex_count)
        if not found:
            continue
        analyses += found
        if stage is stages[0]:
            correlated, outliers = learn_noise_covariance(analyses), _estimate_outlier_share(sample, sampler, count)
        # by itself first: corrections of narrow rings by wider ones do not matter for the decision to continue
        alone = fit_leaf(found, any_rings, correlated or estimate_white_noise(analyses), heavy=heavy, outliers=outliers)
        if alone is not None:
            leaf = alone
            known += leaf.surface.by_rings
            errors += [spec.error for spec in leaf.specs]
            promising = promising and errors[-1] <= MAX_ERROR_GROWTH * min(errors)
        if constraints.only_noise and correlated is not None:
            break
    if constraints.only_noise:
        return analyses, leaf
    if leaf is None or len(leaf.surface.by_rings) < len(analyses):
        leaf = fit_leaf(analyses, any_rings, correlated, heavy=heavy, outliers=outliers, known=known)
    return analyses, None if leaf is None else best_leaf(leaf.surface, leaf.specs, constraints)


def _estimate_outlier_share(sample: NeighbourhoodSample, sampler: Sampler, count: int) -> float:
    """The `outlier_share`, in tolerant mode if many neighbourhoods are unusable: outliers may be the cause."""
    if (~sample.usable[:, OUTLIER_RINGS]).mean() > MAX_UNUSABLE_FRACTION:
        sample = sampler(OUTLIER_RINGS, count, "tolerant")
    return outlier_share(sample)


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
