"""Learns a surface from its neighbourhoods: ring after ring, as long as they promise something."""

from bezier_filters.adjacency import Adjacency
from bezier_filters.kernel_input import KernelMesh
from bezier_filters.model_tree import Leaf, best_leaf, leaf_of
from bezier_filters.neighbourhood_samples import sample_neighbourhoods
from bezier_filters.plans import Choices, all_plans
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


def learn_surface(
    mesh: KernelMesh, adjacency: Adjacency, choices: Choices, *, threads: int = 1, seed: int = 0
) -> tuple[list[RingAnalysis], Leaf | None]:
    """Analyse rings of ascending width, and learn one model for all from them.

    Parameters
    ----------
    mesh : KernelMesh
    adjacency : Adjacency
        Of the same mesh.
    choices : Choices
        What is allowed; the ring that is wanted is analysed in any case, if it can be.
    threads : int
        Number of threads.
    seed : int
        Of the sample.

    Returns
    -------
    analyses : list of RingAnalysis
        None at all for meshes with too few usable neighbourhoods.
    root : Leaf or None
        The model; None if the analyses allow no plan.
    """
    analyses: list[RingAnalysis] = []
    rings = sorted({*CANDIDATE_RINGS, *(() if choices.rings is None else (choices.rings,))})
    root, promising, sample = None, True, None
    for k in rings:
        if not promising and k != choices.rings:
            continue
        if sample is None or k >= sample.sizes.shape[1]:
            widest, count = (NEAR_RINGS, max(SAMPLES.values())) if k <= NEAR_RINGS else (k, SAMPLES[6])
            sample = sample_neighbourhoods(
                mesh, adjacency, rings=widest, count=count, most_turned=MOST_TURNED, seed=seed, threads=threads
            )
        promising = promising and sample.usable[:, k].sum() >= USABLE_SHARE * sample.clear[:, k].sum()
        if not promising and k != choices.rings and analyses:
            continue
        analysis = analyse_ring(
            sample, k, SAMPLES.get(k, SAMPLES[10]), vertex_count=len(mesh.vertices), threads=threads
        )
        if analysis is None:
            continue
        analyses.append(analysis)
        root = None
        if k >= NEAR_RINGS:
            surface = learn_model(analyses)
            plans = all_plans(surface, choices.degrees)
            root = best_leaf(surface, plans, choices)
            promising = promising and plans[-1].error <= HOPELESS * min(plan.error for plan in plans)
    return analyses, root or leaf_of(analyses, choices)
