"""Learns a surface from its neighbourhoods: ring after ring, as long as they promise something."""

from bezier_filters.adjacency import Adjacency
from bezier_filters.kernel_input import KernelMesh
from bezier_filters.neighbourhood_samples import sample_neighbourhoods
from bezier_filters.plans import all_plans
from bezier_filters.ring_analysis import RingAnalysis, analyse_ring
from bezier_filters.surface_model import learn_model

CANDIDATE_RINGS = (1, 2, 3, 4, 5, 6, 8, 10)
NEAR_RINGS = 5
"""Most meshes need no wider rings than these, of which many neighbourhoods can be afforded."""
SAMPLES = {1: 400, 2: 400, 3: 400, 4: 300, 5: 240, 6: 200, 8: 160, 10: 120}
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
    wanted: int | None = None,
    threads: int = 1,
    seed: int = 0,
) -> list[RingAnalysis]:
    """Analyse rings of ascending width; none for meshes with too few usable neighbourhoods.

    Parameters
    ----------
    mesh : KernelMesh
    adjacency : Adjacency
        Of the same mesh.
    wanted : int, optional
        A ring that is analysed in any case, if it can be.
    threads : int
        Number of threads.
    seed : int
        Of the sample.
    """
    analyses: list[RingAnalysis] = []
    rings = sorted({*CANDIDATE_RINGS, *(() if wanted is None else (wanted,))})
    sample = sample_neighbourhoods(
        mesh, adjacency, rings=NEAR_RINGS, count=max(SAMPLES.values()), most_turned=MOST_TURNED, seed=seed
    )
    promising = True
    for k in rings:
        if not promising and k != wanted:
            continue
        if k >= sample.sizes.shape[1]:
            sample = sample_neighbourhoods(
                mesh, adjacency, rings=rings[-1], count=SAMPLES[6], most_turned=MOST_TURNED, seed=seed
            )
        promising = promising and sample.usable[:, k].sum() >= USABLE_SHARE * sample.clear[:, k].sum()
        if not promising and k != wanted and analyses:
            continue
        analysis = analyse_ring(
            sample, k, SAMPLES.get(k, SAMPLES[10]), vertex_count=len(mesh.vertices), threads=threads
        )
        if analysis is None:
            continue
        analyses.append(analysis)
        if k > NEAR_RINGS:
            errors = [plan.error for plan in all_plans(learn_model(analyses))]
            promising = promising and errors[-1] <= HOPELESS * min(errors)
    return analyses
