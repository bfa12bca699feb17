"""Learns a surface from its neighbourhoods: ring after ring, as long as they promise something."""

from collections.abc import Sequence

import numpy as np

from bezier_filters.adjacency import Adjacency
from bezier_filters.fit_kernel import KernelMesh
from bezier_filters.neighbourhood_samples import sample_neighbourhoods
from bezier_filters.plans import ring_plans
from bezier_filters.ring_analysis import RingAnalysis, analyse_ring
from bezier_filters.surface_model import learn_model

CANDIDATE_RINGS = (2, 3, 4, 5, 6, 8, 10)
NEAR_RINGS = 5
"""Most meshes need no wider rings than these, of which many neighbourhoods can be afforded."""
SAMPLES = {2: 600, 3: 600, 4: 500, 5: 400, 6: 300, 8: 240, 10: 180}
"""Neighbourhoods analysed per ring: the wider, the more points each has."""
MOST_TURNED = 0.02
"""Share of the vertices of a neighbourhood whose normals noise may turn away from its plane."""
USABLE_SHARE = 0.8
"""A ring that folds at more than the rest of the sampled vertices is too wide."""
HOPELESS = 4.0
"""Wider rings are not tried once the predicted error has grown by this factor."""


def analyse_rings(
    mesh: KernelMesh,
    adjacency: Adjacency,
    *,
    rings: Sequence[int] = CANDIDATE_RINGS,
    threads: int = 1,
    seed: int = 0,
) -> list[RingAnalysis]:
    """Analyse rings of ascending width; none for meshes with too few usable neighbourhoods."""
    analyses: list[RingAnalysis] = []
    best = np.inf
    near = min(NEAR_RINGS, max(rings))
    sample = sample_neighbourhoods(
        mesh, adjacency, rings=near, count=max(SAMPLES.values()), most_turned=MOST_TURNED, seed=seed
    )
    for k in rings:
        if k >= sample.sizes.shape[1]:
            sample = sample_neighbourhoods(
                mesh, adjacency, rings=max(rings), count=SAMPLES[6], most_turned=MOST_TURNED, seed=seed
            )
        if analyses and sample.usable[:, k].sum() < USABLE_SHARE * sample.clear[:, k].sum():
            break
        analysis = analyse_ring(
            sample, k, SAMPLES.get(k, SAMPLES[10]), vertex_count=len(mesh.vertices), threads=threads
        )
        if analysis is None:
            continue
        analyses.append(analysis)
        surface = learn_model(analyses)
        error = min(plan.error for plan in ring_plans(surface, surface.by_rings[-1]))
        if k > NEAR_RINGS and error > HOPELESS * best:
            break
        best = min(best, error)
    return analyses
