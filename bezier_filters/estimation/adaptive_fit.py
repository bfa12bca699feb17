"""Chooses how to fit a surface, and fits every part of it with the plan that suits it.

What is chosen follows from samples; vertices are then fitted by it one by one, all together or some at a time.
The neighbourhoods are rings of edges, or balls of one radius: a scale that does not depend on the sampling.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

import numpy as np

from bezier_filters.arrays import BoolArray, ByteArray, FloatArray, IntArray
from bezier_filters.estimation.fallbacks import (
    FitAttempt,
    fallback_chain,
    fit_with_fallbacks,
    overall_progress,
    planned_chain,
)
from bezier_filters.estimation.outlier_removal import without_outliers
from bezier_filters.estimation.vertex_geometry import FitChoice, FitPart, VertexGeometry, arrays_of
from bezier_filters.kernels.graph_geometry import bound_errors
from bezier_filters.kernels.kernel_input import KernelMesh, use_smoothed_normals
from bezier_filters.learning.learn import CANDIDATE_RINGS, MOST_TURNED, View, learn_from_samples, learn_surface
from bezier_filters.learning.model_tree import (
    DEEPEST,
    WORTHWHILE_IF_CORRELATED,
    Features,
    Leaf,
    Split,
    Tree,
    at_leaves,
    best_leaf,
    grow,
    leaf_numbers,
    leaf_of,
    leaves,
    saved,
)
from bezier_filters.learning.neighbourhood_samples import NeighbourhoodSample, draw_from_mesh, sample_neighbourhoods
from bezier_filters.learning.noise_model import NoiseModel
from bezier_filters.learning.plans import THRIFT, Choices, plan_for
from bezier_filters.learning.ring_analysis import FEWEST_SAMPLES, RingAnalysis
from bezier_filters.meshes.adjacency import Adjacency
from bezier_filters.patches.fitting import DEGREES, PatchFit
from bezier_filters.runtime.parallel import Progress, run_kernel
from bezier_filters.status import FitStatus

RADIUS_SAMPLES = 150  # neighbourhoods whose radius is measured
# A small part of the surface that the fit for all of it does not follow hardly shows in the sample that this was
# learned from: what is off by so many standard deviations of the noise, among more vertices, is learned by itself
OFF, LOOKED_AT = 1.4, 2000
FEWEST_OFF, MOST_OFF = 40, 0.3  # vertices, and share of those looked at: more of them are in the sample, too
WORTHWHILE_THERE = 0.2  # logarithm of the predicted error that this must save, unless the noise is correlated
DENSE = 0.1  # share of outliers from which on they turn single normals anywhere, as heavy noise does
WORSE = 2.0  # times the standard error of a sound fit that one of the part may have instead
AT_ONCE = 1 << 18  # vertices of a part of which both fits are kept
RESIDUAL = 1  # place among the `first_features`

# learns a surface, as `learning.learn_surface` does, as it is or without its outliers
Learn = Callable[[Choices, bool], tuple[list[RingAnalysis], Leaf | None]]
# the vertices (n,) at the sharp edges that are told without the noise; None if that is not to be asked
FindEdges = Callable[[NoiseModel], BoolArray | None]


@dataclass(frozen=True)
class Places:
    """Vertices of a mesh, in memory or in tiles, after the first fit."""

    drawn: IntArray  # spread over the mesh, in random order
    features: Features  # the `first_features` of these and of those that the surface was learned from
    sample: Callable[[IntArray, int], NeighbourhoodSample]  # neighbourhoods of vertices, up to some rings


@dataclass(frozen=True)
class PartFit:
    """How a part of a surface is fitted."""

    rings: int
    degree: int
    noise_sigma: float  # as in `FitPart`
    attempts: tuple[FitAttempt, ...]  # tried in order; none where the first fit is good enough
    # what the standard errors of normal and curvatures are multiplied by where the first fit stays; infinite if that is
    # not known
    error_ratios: tuple[float, float]


@dataclass(frozen=True)
class SurfaceFit:
    """How a surface is fitted: small, whatever the size of the mesh."""

    choice: FitChoice  # for all of it
    attempts: tuple[FitAttempt, ...]  # tried in order at every vertex
    steady: bool = False  # whether frames come from averaged normals, see `use_smoothed_normals`
    robust: bool = False  # whether points far off a fit lose their weight
    cleaned: bool = False  # whether outliers are moved onto the surface around them before
    parts: Tree[PartFit] | None = None  # what comes after that, by the features that the first fit shows


@dataclass(frozen=True)
class Learned:
    """What is known of a surface from samples: neighbourhoods, and the model and plans for all of it."""

    analyses: Sequence[RingAnalysis]
    root: Leaf
    choices: Choices

    @property
    def centers(self) -> IntArray:
        """The sampled vertices, each once, in ascending order."""
        return np.unique(np.concatenate([analysis.centers for analysis in self.analyses]))


def choose_fit(
    learn: Learn,
    rings: int | Literal["auto"],
    fixed: PatchFit | None,
    degrees: tuple[int, ...],
    robust: bool | None = None,
    sigma: float | None = None,
    detail: float | None = None,
) -> tuple[SurfaceFit, Learned | None]:
    """Choose what the user left open, as far as one choice holds for all.

    `rings` or `fixed` are given or left to the data, which may then choose one of the degrees; `learn` is called only
    if something is left open, and fits are `robust` then if there are outliers, unless that is decided. `sigma` is the
    standard deviation of the noise, if that is known, `detail` the size of the smallest detail that matters. The second
    result is what `with_parts` finds parts from, if there may be any.
    """
    root, noise = None, None
    if fixed is None or rings == "auto":
        choices = Choices(
            None if rings == "auto" else rings, degrees, sigma, np.inf if detail is None else 0.5 * detail
        )
        analyses, root = learn_without_outliers(learn, choices, robust)
        robust = bool(robust) or (robust is None and root is not None and root.surface.noise.outliers > 0.0)
    if root is not None:
        noise, chosen = root.surface.noise, root.chosen
        if fixed is None:
            choice = _with_noise(FitChoice(chosen.rings, chosen.degree, None, None), noise)
            attempts = tuple(planned_chain(root.plans, chosen))
            steady = noise.heavy or noise.outliers > DENSE
            surface_fit = SurfaceFit(choice, attempts, steady, bool(robust), cleaned=bool(robust))
            return surface_fit, Learned(analyses, root, choices)
    if rings == "auto":
        rings = 2 if root is None else root.chosen.rings
    fit = fixed or patch_of_degrees(degrees)
    choice = _with_noise(FitChoice(rings, fit.degree, fit.alpha, None), noise)
    return SurfaceFit(choice, tuple(fallback_chain(rings, fit)), choice.noise_heavy, bool(robust)), None


def patch_of_degrees(degrees: tuple[int, ...]) -> PatchFit:
    """The patch for a surface of which nothing can be learned: of the one degree that is allowed, 4 at most, or 3."""
    return PatchFit(min(degrees[0], max(DEGREES))) if len(degrees) == 1 else PatchFit()


def _with_noise(choice: FitChoice, noise: NoiseModel | None) -> FitChoice:
    """A choice that says what the noise is, if that is known."""
    if noise is None:
        return choice
    return replace(choice, noise_sigma=noise.sigma, noise_length=noise.length, noise_heavy=noise.heavy)


def learn_without_outliers(
    learn: Learn, choices: Choices, robust: bool | None = None
) -> tuple[list[RingAnalysis], Leaf | None]:
    """Learn a surface, and if there are outliers or fits are to be robust, what is there without them.

    The share of the outliers stays part of the noise.
    """
    analyses, leaf = learn(choices, bool(robust))
    if robust is not None or leaf is None or not leaf.surface.noise.outliers:
        return analyses, leaf
    share = leaf.surface.noise.outliers
    analyses, leaf = learn(choices, True)
    if leaf is None:
        return analyses, None
    surface = replace(leaf.surface, noise=replace(leaf.surface.noise, outliers=share))
    return analyses, replace(leaf, surface=surface)


def learner(mesh: KernelMesh, adjacency: Adjacency, cleaned: Callable[[], KernelMesh] | None = None) -> Learn:
    """What learns the surface of a mesh in memory, which may be known without its outliers."""

    def learn(choices: Choices, without: bool) -> tuple[list[RingAnalysis], Leaf | None]:
        learned_from = (cleaned or partial(without_outliers, mesh, adjacency))() if without else mesh
        return learn_surface(learned_from, adjacency, choices)

    return learn


def with_parts(fit: SurfaceFit, learned: Learned, places: Places) -> SurfaceFit:
    """The fit with what suits the parts of the surface, if they differ, by what the first fit shows."""
    root = learned.root
    tree = grow(root, learned.analyses, places.features, learned.choices)
    if not fit.robust:  # outliers are off, too
        tree = _without_what_is_off(tree, root, learned.choices, places)
    return fit if isinstance(tree, Leaf) else replace(fit, parts=at_leaves(tree, partial(_part_fit, root)))


def _without_what_is_off(tree: Tree[Leaf], root: Leaf, choices: Choices, places: Places) -> Tree[Leaf]:
    """The tree, and a leaf for what the first fit does not follow, if a plan of its own does much better there."""
    threshold = OFF * max(leaf.surface.sigma for leaf in leaves(tree))
    off = places.drawn[places.features(places.drawn)[:, RESIDUAL] > threshold]
    if not FEWEST_OFF <= len(off) <= MOST_OFF * len(places.drawn):
        return tree

    def sample(rings: int, count: int, _: View) -> NeighbourhoodSample:
        return places.sample(off[:count], rings)

    vertex_count, noise = root.surface.by_rings[0].analysis.vertex_count, root.surface.noise
    analyses, leaf = learn_from_samples(sample, vertex_count, choices)
    worthwhile = WORTHWHILE_THERE
    # Long waves of noise are found stronger where residuals are largest, by the choice of the places; and if there are
    # none elsewhere, they are shape.
    if leaf is not None and leaf.surface.sigma > noise.sigma and (noise.sills or leaf.surface.noise.sills):
        leaf = leaf_of(analyses, choices, noise, heavy=noise.heavy)
        worthwhile = WORTHWHILE_IF_CORRELATED if noise.sills else WORTHWHILE_THERE
    # without rings as wide as those of the first fit, there are none that do not fold
    if leaf is None or -np.inf < saved(root.chosen, leaf) <= worthwhile:
        return tree
    return Split(RESIDUAL, threshold, tree, grow(leaf, analyses, places.features, choices, DEEPEST - 1))


def _part_fit(root: Leaf, leaf: Leaf) -> PartFit:
    """A plan for a part: its own, or that of the whole if another fit is not worth its time."""
    before, plan, there = root.chosen, leaf.chosen, plan_for(root.chosen, leaf.surface)
    sigma = leaf.surface.sigma
    ratios = np.inf, np.inf
    # Where the whole is exact, its standard errors are 0, and tell nothing of those of a part that is not.
    if there is not None and before.normal_noise > 0.0 and before.curvature_noise > 0.0:
        ratios = there.normal_noise / before.normal_noise, there.curvature_noise / before.curvature_noise
        if there.error <= plan.error * (1.0 + (plan.cost - plan.overhead) / there.cost) ** THRIFT:
            return PartFit(there.rings, there.degree, sigma, (), ratios)
    return PartFit(plan.rings, plan.degree, sigma, tuple(planned_chain(leaf.plans, plan)), ratios)


def first_features(geometry: VertexGeometry, rows: IntArray) -> FloatArray:
    """What the parts are told apart by, from the first fit: curvedness, but for a factor, and residual."""
    return np.column_stack([np.hypot(geometry.k_min[rows], geometry.k_max[rows]), geometry.residual[rows]])


def fit_parts(
    mesh: KernelMesh, ids: IntArray, fit: SurfaceFit, geometry: VertexGeometry, *, progress: Progress | None = None
) -> FitChoice:
    """Fit those of the vertices `ids`, in ascending order, again that belong to a part with a plan worth its time.

    The results of the first fit are replaced. Returns the choice with the number of vertices of each part.
    """
    if fit.parts is None:
        return fit.choice
    numbers = _part_numbers(fit.parts, geometry, mesh.origin, ids)
    at_the_end = overall_progress(progress, len(ids), len(ids))
    parts = []
    for number, part in enumerate(leaves(fit.parts)):
        of_part = ids[numbers == number]
        if part.attempts:
            for first in range(0, len(of_part), AT_ONCE):
                some = of_part[first : first + AT_ONCE]
                _fit_again(mesh, some, part, geometry, fit.robust, at_the_end)
        else:
            _rescale_errors(mesh, of_part, geometry, *part.error_ratios)
        parts.append(FitPart(len(of_part), part.rings, part.degree, part.noise_sigma))
    return replace(fit.choice, parts=tuple(parts))


def _fit_again(
    mesh: KernelMesh, ids: IntArray, part: PartFit, geometry: VertexGeometry, robust: bool, progress: Progress | None
) -> None:
    """Fit vertices of a part by a plan of its own, but where a sound fit was better, as its model has it.

    The plan is for neighbourhoods without a border: the fewer sides a vertex has neighbours on, the more depends on
    priors, and on wider rings than it is for, on what it leaves out.
    """
    status = geometry.status[mesh.origin[ids]]
    sound = ids[status <= FitStatus.WIDER_RING]
    rows = mesh.origin[sound]
    before = {name: values[rows] for name, values in arrays_of(geometry).items()}
    instead = [one for one in part.attempts if one.status in (FitStatus.OK, FitStatus.NARROWER_RING)]
    for some, attempts in ((status == FitStatus.OK, instead), (status != FitStatus.OK, part.attempts)):
        fit_with_fallbacks(mesh, ids[some], attempts, geometry, robust=robust, progress=progress)
    with np.errstate(over="ignore", invalid="ignore"):  # nothing is worse than what is not known, or no number
        errors = geometry.normal_std[rows] * geometry.mean_curvature_std[rows]
        is_worse = errors > WORSE**2 * np.prod(part.error_ratios) * before["normal_std"] * before["mean_curvature_std"]
    for name, values in arrays_of(geometry).items():
        values[rows[is_worse]] = before[name][is_worse]
    _rescale_errors(mesh, sound[is_worse], geometry, *part.error_ratios)


def _part_numbers(parts: Tree[PartFit], geometry: VertexGeometry, origin: IntArray, ids: IntArray) -> ByteArray:
    """The number of the part that each vertex belongs to, (k,); some at a time, as features take room."""
    numbers = np.empty(len(ids), dtype=np.int8)

    def number(start: int, stop: int) -> None:
        numbers[start:stop] = leaf_numbers(parts, first_features(geometry, origin[ids[start:stop]]))

    run_kernel(number, len(ids))
    return numbers


def _rescale_errors(
    mesh: KernelMesh, ids: IntArray, geometry: VertexGeometry, of_normal: float, of_curvature: float
) -> None:
    """Give vertices the standard errors of the same fit under another model."""
    rows, of_both = mesh.origin[ids], (geometry.mean_curvature_std, geometry.gaussian_curvature_std)
    geometry.normal_std[rows] *= of_normal
    for errors in of_both:
        errors[rows] *= of_curvature
    if of_curvature > 1.0:
        run_kernel(bound_errors, len(ids), mesh, ids, *of_both)


def fit_in_balls(
    mesh: KernelMesh,
    adjacency: Adjacency,
    ids: IntArray,
    radius: float,
    fit: PatchFit | None,
    degrees: tuple[int, ...],
    geometry: VertexGeometry,
    *,
    sigma: float | None = None,
    robust: bool = False,
    find_edges: FindEdges,
    progress: Progress | None = None,
) -> FitChoice:
    """Fit the vertices `ids` to what lies within a distance of each, a length.

    Where the patch is left open, one that suits the rings of about this radius is taken, the same everywhere.
    """
    choices = Choices(None, degrees, sigma)
    leaf = None if fit else _learn_balls(mesh, adjacency, radius, choices, robust)
    if leaf is not None:
        edges = find_edges(leaf.surface.noise)
        if edges is not None and (edges & ~mesh.barriers).any():
            mesh = mesh._replace(barriers=mesh.barriers | edges)
            leaf = _learn_balls(mesh, adjacency, radius, choices, robust)
    if leaf is None:
        fit = fit or patch_of_degrees(degrees)
        attempts = fallback_chain(1, fit, radius)
        choice = FitChoice(0, fit.degree, fit.alpha, None, radius=radius)
    else:
        attempts = planned_chain(leaf.plans, leaf.chosen, radius)
        choice = _with_noise(FitChoice(0, leaf.chosen.degree, None, None, radius=radius), leaf.surface.noise)
        mesh = use_smoothed_normals(mesh) if leaf.surface.noise.heavy else mesh
    fit_with_fallbacks(mesh, ids, list(attempts), geometry, robust=robust, progress=progress)
    return choice


def _learn_balls(mesh: KernelMesh, adjacency: Adjacency, radius: float, choices: Choices, robust: bool) -> Leaf | None:
    """Learn the surface; the chosen plan is that of the rings whose radius is nearest to the one given."""
    mesh = without_outliers(mesh, adjacency) if robust else mesh
    wanted = nearest_rings(mesh, adjacency, radius)
    analyses, leaf = learn_surface(mesh, adjacency, replace(choices, rings=wanted))
    if not analyses:
        return None
    nearest = min(analyses, key=lambda analysis: abs(analysis.radius - radius))
    choices = replace(choices, rings=nearest.rings)
    return leaf_of(analyses, choices) if leaf is None else best_leaf(leaf.surface, leaf.plans, choices)


def nearest_rings(mesh: KernelMesh, adjacency: Adjacency, radius: float) -> int:
    """Number of rings, as many as can be analysed at most, whose median radius is nearest to a length."""
    ids = draw_from_mesh(mesh, RADIUS_SAMPLES)
    sample = sample_neighbourhoods(mesh, adjacency, ids, rings=max(CANDIDATE_RINGS), most_turned=MOST_TURNED)
    distances = np.sqrt(np.square(sample.points[..., :2]).sum(axis=2))
    best, smallest = 1, np.inf
    for rings in range(1, sample.sizes.shape[1]):
        usable = sample.usable[:, rings]
        if usable.sum() < FEWEST_SAMPLES:
            break
        within = np.arange(distances.shape[1]) < sample.sizes[usable, rings, np.newaxis]
        difference = abs(float(np.median((distances[usable] * within).max(axis=1))) - radius)
        if difference < smallest:
            best, smallest = rings, difference
    return best
