"""Fits every part of a surface with the plan that suits it."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from bezier_filters.arrays import ByteArray, FloatArray, IntArray
from bezier_filters.fallbacks import fit_with_fallbacks, planned_chain
from bezier_filters.kernel_input import KernelMesh
from bezier_filters.model_tree import Leaf, Split, grow, leaf_numbers, leaves
from bezier_filters.parallel import Progress
from bezier_filters.plans import THRIFT, Choices, FitPlan, plan_for
from bezier_filters.ring_analysis import RingAnalysis
from bezier_filters.vertex_geometry import FitChoice, FitPart, VertexGeometry

BUNCH = 1 << 16
"""Vertices whose features are held at a time."""


def fit_adaptively(
    mesh: KernelMesh,
    ids: IntArray,
    root: Leaf,
    analyses: Sequence[RingAnalysis],
    choices: Choices,
    geometry: VertexGeometry,
    *,
    robust: bool = False,
    threads: int = 1,
    progress: Progress | None = None,
) -> FitChoice:
    """Fit the vertices `ids` with one plan for all, then those again that belong to a part with a plan worth its time.

    The sampled vertices are fitted, too, so that the parts do not depend on `ids`; what is
    written there means nothing.

    Parameters
    ----------
    mesh : KernelMesh
    ids : (k,) int32
        Vertices to fit, in ascending order.
    root : Leaf
        Model and plans of the whole.
    analyses : sequence of RingAnalysis
        What `root` was learned from.
    choices : Choices
        What is allowed.
    geometry : VertexGeometry
        Receives the results.
    robust : bool
        Whether points far off a fit lose their weight.
    threads : int
        Number of threads.
    progress : callable, optional
        Called with the number of vertices done.

    Returns
    -------
    FitChoice
    """
    is_fitted = np.zeros(len(mesh.vertices), dtype=np.bool_)
    for rows in (ids, *(analysis.centers for analysis in analyses)):
        is_fitted[rows] = True
    fitted = np.flatnonzero(is_fitted).astype(np.int32)
    fit_with_fallbacks(
        mesh,
        fitted,
        list(planned_chain(root.plans, root.chosen)),
        geometry,
        robust=robust,
        threads=threads,
        progress=_of_wanted(progress, len(ids)),
    )
    choice = FitChoice(root.chosen.rings, root.chosen.degree, None, root.surface.sigma)
    tree = grow(root, analyses, lambda centers: _features(geometry, mesh.origin[centers]), choices)
    if isinstance(tree, Leaf):
        return choice
    numbers = _parts_of(tree, geometry, mesh.origin, ids)
    parts = []
    for number, leaf in enumerate(leaves(tree)):
        part = ids[numbers == number]
        plan, there = leaf.chosen, plan_for(root.chosen, leaf.surface)
        if there is not None and there.error <= plan.error * (1.0 + plan.cost / there.cost) ** THRIFT:
            plan = there
            _rescale_errors(geometry, mesh.origin[part], root.chosen, plan)
        else:
            fit_with_fallbacks(
                mesh,
                part,
                list(planned_chain(leaf.plans, plan)),
                geometry,
                robust=robust,
                threads=threads,
                progress=_at_the_end(progress, len(ids)),
            )
        parts.append(FitPart(len(part), plan.rings, plan.degree, leaf.surface.sigma))
    return replace(choice, parts=tuple(parts))


def _features(geometry: VertexGeometry, rows: IntArray) -> FloatArray:
    """What the parts are told apart by, from the first fit: curvedness, but for a factor, and residual."""
    return np.column_stack([np.hypot(geometry.k_min[rows], geometry.k_max[rows]), geometry.residual[rows]])


def _parts_of(tree: Leaf | Split, geometry: VertexGeometry, origin: IntArray, ids: IntArray) -> ByteArray:
    """The number of the leaf that each vertex belongs to, (k,); a bunch at a time, as features take room."""
    numbers = np.empty(len(ids), dtype=np.int8)
    for start in range(0, len(ids), BUNCH):
        bunch = slice(start, start + BUNCH)
        numbers[bunch] = leaf_numbers(tree, _features(geometry, origin[ids[bunch]]))
    return numbers


def _rescale_errors(geometry: VertexGeometry, rows: IntArray, before: FitPlan, after: FitPlan) -> None:
    """Give vertices the standard errors of the same fit under another model."""
    geometry.normal_std[rows] *= after.normal_noise / before.normal_noise
    for errors in (geometry.mean_curvature_std, geometry.gaussian_curvature_std):
        errors[rows] *= after.curvature_noise / before.curvature_noise


def _of_wanted(progress: Progress | None, total: int) -> Progress | None:
    """Progress of the vertices that are wanted, while others are fitted, too."""
    return None if progress is None else lambda done, _: progress(min(done, total), total)


def _at_the_end(progress: Progress | None, total: int) -> Progress | None:
    """Progress of what comes after the last vertex."""
    return None if progress is None else lambda *_: progress(total, total)
