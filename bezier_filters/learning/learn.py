"""Learns a surface from its neighbourhoods: ring after ring, as long as they promise something."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from typing import Literal

import numpy as np

from bezier_filters.arrays import IntArray
from bezier_filters.kernels.kernel_input import KernelMesh, recompute_barriers, use_smoothed_normals
from bezier_filters.learning.model_tree import Leaf, best_leaf, leaf_of
from bezier_filters.learning.neighbourhood_samples import (
    NEAR,
    NeighbourhoodSample,
    draw_from_mesh,
    sample_neighbourhoods,
)
from bezier_filters.learning.noise_spectrum import learn_noise
from bezier_filters.learning.outliers import RINGS, outlier_share
from bezier_filters.learning.plans import Choices
from bezier_filters.learning.ring_analysis import RingAnalysis, analyse_rings
from bezier_filters.learning.surface_model import RingModel, white_noise
from bezier_filters.learning.unlearned import USABLE_SHARE, reason_unlearned
from bezier_filters.meshes.adjacency import Adjacency

CANDIDATE_RINGS = (1, 2, 3, 4, 5, 6, 8, 10)
NEAR_RINGS = 5  # most meshes need no wider rings than these, of which many neighbourhoods can be afforded
# neighbourhoods analysed per ring: the wider, the more points each has
SAMPLES = {1: 300, 2: 400, 3: 400, 4: 240, 5: 180, 6: 200, 8: 160, 10: 120}
MOST_TURNED = 0.02  # share of the vertices of a neighbourhood whose normals noise may turn away from its plane
MAY_TURN = 0.25  # the same where outliers are looked for, which turn more
MANY_UNUSABLE = 0.05  # share of the neighbourhoods from which on they are looked at for outliers, too
HOPELESS = 10.0  # wider rings are not tried once the predicted error has grown by this factor

# share of the places with a normal near them that turns away, and of all normals: more of both is heavy noise,
OFTEN_TURNED, MANY_TURNED = 0.03, 0.0015
# if most places are so rough, too: heights of the neighbours over their distances. At knife edges only few are.
ROUGH = 0.25

# how neighbourhoods are looked at: as the mesh is; with steady normals; or without the sharp edges around lone tips,
# and where outliers turn normals away, too
View = Literal["plain", "steady", "tolerant"]
# gives neighbourhoods out to some rings of some number of vertices
Sampler = Callable[[int, int, View], NeighbourhoodSample]


def learn_surface(mesh: KernelMesh, adjacency: Adjacency, choices: Choices) -> tuple[list[RingAnalysis], Leaf | None]:
    """Analyse rings of ascending width, and learn one model for all from them.

    The ring that is wanted is analysed in any case, if it can be. There are no analyses at all for meshes with too few
    usable neighbourhoods, and no model if they allow no plan.
    """
    drawn = cache(partial(draw_from_mesh, mesh))

    def sample(rings: int, count: int, view: View) -> NeighbourhoodSample:
        return viewed_sample(mesh, adjacency, drawn(count), rings, view)

    return learn_from_samples(sample, len(mesh.vertices), choices)


def viewed_sample(mesh: KernelMesh, adjacency: Adjacency, ids: IntArray, rings: int, view: View) -> NeighbourhoodSample:
    """The neighbourhoods of vertices `ids`, looked at in some way."""
    most_turned = MOST_TURNED
    if view == "steady":
        mesh = use_smoothed_normals(mesh)
    if view == "tolerant":
        mesh, most_turned = recompute_barriers(mesh, adjacency), MAY_TURN
    return sample_neighbourhoods(mesh, adjacency, ids, rings=rings, most_turned=most_turned)


def why_unlearned(mesh: KernelMesh, adjacency: Adjacency) -> str:
    """Why `learn_surface` learns nothing of a mesh."""
    return reason_unlearned(viewed_sample(mesh, adjacency, draw_from_mesh(mesh, SAMPLES[NEAR]), NEAR, "plain"))


def learn_from_samples(sampler: Sampler, vertex_count: int, choices: Choices) -> tuple[list[RingAnalysis], Leaf | None]:
    """The same for a mesh of which only samples are known.

    ``sampler(rings, count, view)`` gives neighbourhoods, the same vertices for the same count.
    """
    rings = sorted({*CANDIDATE_RINGS, *(() if choices.rings is None else (choices.rings,))})
    stages = [[k for k in rings if k <= NEAR_RINGS], *([k] for k in rings if k > NEAR_RINGS)]
    analyses: list[RingAnalysis] = []
    known: list[RingModel] = []
    errors: list[float] = []
    leaf: Leaf | None = None
    correlated, promising, heavy, outliers = None, True, False, 0.0
    any_rings = replace(choices, rings=None)
    for stage in stages:
        if not promising and choices.rings not in stage:
            continue
        count = SAMPLES[2] if stage is stages[0] else SAMPLES[6]
        sample = sampler(stage[-1], count, "steady" if heavy else "plain")
        if stage is stages[0] and _turns_normals(sample):
            steady = sampler(stage[-1], count, "steady")
            heavy = _is_rough(steady) and not _turns_normals(steady)
            sample = steady if heavy else sample
        most: dict[int, int] = {}
        for k in stage:
            promising = promising and sample.usable[:, k].sum() >= USABLE_SHARE * sample.clear[:, k].sum()
            if promising or k == choices.rings or not (analyses or most):
                most[k] = SAMPLES.get(k, SAMPLES[10])
        found = analyse_rings(sample, most, vertex_count=vertex_count)
        if not found:
            continue
        analyses += found
        if stage is stages[0]:
            correlated, outliers = learn_noise(analyses), _outliers(sample, sampler, count)
        # by itself first: what wider rings say of narrower ones does not matter for how far to go on
        alone = leaf_of(found, any_rings, correlated or white_noise(analyses), heavy=heavy, outliers=outliers)
        if alone is not None:
            leaf = alone
            known += leaf.surface.by_rings
            errors += [plan.error for plan in leaf.plans]
            promising = promising and errors[-1] <= HOPELESS * min(errors)
        if choices.only_noise and correlated is not None:
            break
    if choices.only_noise:
        return analyses, leaf
    if leaf is None or len(leaf.surface.by_rings) < len(analyses):
        leaf = leaf_of(analyses, any_rings, correlated, heavy=heavy, outliers=outliers, known=known)
    return analyses, None if leaf is None else best_leaf(leaf.surface, leaf.plans, choices)


def _outliers(sample: NeighbourhoodSample, sampler: Sampler, count: int) -> float:
    """The `outlier_share`; of neighbourhoods that are not usable, too, if these are many: outliers may be why."""
    if (~sample.usable[:, RINGS]).mean() > MANY_UNUSABLE:
        sample = sampler(RINGS, count, "tolerant")
    return outlier_share(sample)


def _turns_normals(sample: NeighbourhoodSample) -> bool:
    """Whether many normals turn away from those around them, and not only at few places, as at thin parts."""
    if not len(sample.turned):
        return False
    return bool(sample.turned.mean() > MANY_TURNED and (sample.turned > 0.0).mean() > OFTEN_TURNED)


def _is_rough(sample: NeighbourhoodSample) -> bool:
    """Whether at most places the neighbours are far off the plane, at the distance that they have."""
    seen = sample.usable[:, 1:].any(axis=1)
    is_near = np.arange(sample.points.shape[1]) < sample.sizes[:, 1:2]
    x, y, z = np.moveaxis(np.square(sample.points).sum(axis=1, where=is_near[..., np.newaxis])[seen], 1, 0)
    return bool(seen.any() and np.median(z / np.maximum(x + y, np.finfo(np.float64).tiny)) > ROUGH**2)
