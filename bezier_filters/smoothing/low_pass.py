"""Selects the low-pass filter of a mesh by its risk: Laplacian and order globally, the strength around every vertex.

The Laplacian, the order and the candidate strengths minimise Stein's risk estimate over parts of the mesh
(`sample_parts`). At every vertex, filters of these strengths are mixed by their local risks.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.special import j0

from bezier_filters.arrays import FloatArray, SingleArray
from bezier_filters.sampling.mesh_parts import MeshPart
from bezier_filters.smoothing.chebyshev import (
    DEFAULT_ORDER,
    LOWEST_ORDER,
    SIGNALS_PER_PASS,
    Signals,
    accumulate_residuals,
    low_pass,
    low_pass_series,
)
from bezier_filters.smoothing.laplacian import Borders, Laplacian, cotangent_laplacian, umbrella_laplacian
from bezier_filters.smoothing.noise import NoisyMesh
from bezier_filters.smoothing.risk import Estimates, local_risks, local_shares, overall_risks

# strengths s of the filters, see `chebyshev`; 0 is the identity. Steps of the strength below are steps in this array
FILTER_STRENGTHS: FloatArray = np.concatenate([[0.0], 10.0 ** np.arange(-1.0, 8.1, 0.5)])
LAPLACIAN_POWERS = (0.0, 0.5, 1.0)  # powers of `cotangent_laplacian`
# Orders of the filters: steep ones suit surfaces whose spectrum ends at some wavelength, as of analytic surfaces; the
# lowest one suits noise with the same wavelengths as detail.
FILTER_ORDERS = (DEFAULT_ORDER, 6, LOWEST_ORDER)
# largest strength by order: stronger filters would suit round shapes, but need longer series and more rings of tiles
MAX_STRENGTHS = {LOWEST_ORDER: 1e8, DEFAULT_ORDER: 1e7, 6: 1e6}
SEARCH_HALF_WIDTH = 3  # strengths on both sides of the globally best one that may be mixed locally
SEARCH_EXTENSION = 6  # steps beyond the best strength of the umbrella Laplacian in the search with other Laplacians
MIN_MEAN_SHARE = 1e-3  # mean share of the strongest filter; a stronger one with less is dropped
MAX_WEAKEST_FRACTION = 1e-3  # fraction of the vertices that prefer the weakest strength, above which weaker ones follow
WEAK_STRENGTH_STRIDE = 4  # stride of these weaker strengths
PREFILTER_STEPS = 2  # steps by which a prefilter, the input of another filter's weights, is weaker
PREFERENCE_SHARE = 0.5  # share of a strength above which a vertex prefers it
MAX_PREFILTER_STRENGTH = 10_000.0  # strength from which on normals hardly improve
MAX_EDGE_PHASE = 3.8  # largest phase between the ends of an edge: a mesh does not resolve shorter waves
ROUNDING_PASSES = 3  # passes with four probes each if these are errors of rounding, which differ little over terraces
SMALL_MESH_VERTICES = 20_000  # on smaller meshes leverages are averaged over more probes


@dataclass(frozen=True)
class LowPassPlan:
    """Global parameters of the low-pass filters of a mesh."""

    borders: Borders  # treatment of border vertices
    unit: float  # the mean edge, a length
    first: int  # number of the best strength with the umbrella Laplacian
    power: float | None  # power of the best `cotangent_laplacian`; None for the umbrella Laplacian
    max_rate: float  # largest rate of the Laplacian
    # largest local mean of the rates: where edges are short, filters reach across more of them
    max_diffusivity: float
    order: int  # best order of the filters
    strengths: FloatArray  # (s,): strengths that are mixed around every vertex
    overall: FloatArray  # (s,): their overall risks, see `overall_risks`


@dataclass(frozen=True)
class LowPass:
    """Filters of a mesh, with their shares at every vertex."""

    borders: Borders  # treatment of border vertices
    laplacian: Laplacian  # Laplacian of the filters
    order: int  # order of the filters
    strengths: FloatArray  # (s,): strengths of the filters
    shares: SingleArray  # (n, s): shares of the filters at each vertex
    normals: SingleArray  # (n, 3): normals of the prefiltered surface that gives the cotangents
    residuals: SingleArray  # (n,): residuals of the mixture, see `Estimates`

    def apply(self, signals: Signals) -> Signals:
        """Filter signals (n, c)."""
        return low_pass(self.laplacian, signals, self.strengths, self.shares, self.order)

    def next_weaker(self) -> "LowPass":
        """The next weaker filters, as a start for another filter that removes noise, too."""
        shares = np.roll(self.shares, -1, axis=1)
        shares[:, -1] = 0.0
        shares[:, 0] += self.shares[:, 0]
        return replace(self, shares=shares)

    def weaken(self, steps: int) -> "LowPass":
        """The same filters with strengths so many steps lower."""
        return replace(self, strengths=self.strengths * (FILTER_STRENGTHS[1] / FILTER_STRENGTHS[1 + steps]))

    def prefilter(self, umbrella: Laplacian) -> "LowPass":
        """Weak filters, whose output controls the weights of another filter."""
        return replace(self.weaken(PREFILTER_STEPS), laplacian=umbrella, order=DEFAULT_ORDER)


class _FilterFamily(NamedTuple):
    """Filters of one Laplacian and order, and of all strengths."""

    power: float | None  # power of the Laplacian, see `LowPassPlan`
    laplacian: Laplacian
    order: int
    strengths: FloatArray  # (s,)
    estimates: Estimates
    risks: FloatArray  # (s,)


def max_strength(detail: float) -> float:
    """Strength of the filters that halve a wave of a given length, in mean edges, for any order.

    It is L^-4 for the eigenvalue L of the wave. On triangles of one size L = 1 - J_0(2 pi / detail), the mean over all
    directions of an edge, which is (2 pi / detail)^2 / 4 for long waves.

    >>> round(float(max_strength(10.0)), 1), round(float(max_strength(20.0) / max_strength(10.0)), 1)
    (11633.8, 237.7)
    """
    result: float = (1.0 - j0(min(2.0 * np.pi / detail, MAX_EDGE_PHASE))) ** -4.0
    return result


def learn_low_pass(
    noisy: NoisyMesh, borders: Borders, unit: float, detail: float | None = None
) -> tuple[LowPassPlan, LowPass]:
    """Find the Laplacian, the order and the strengths with the smallest risk on the core of a part of a mesh.

    `unit` is the mean edge, `detail` the length of the shortest waves that keep half of their height. Returns the
    global parameters, and the result of `fit_low_pass` with them.
    """
    part, core = noisy.part, noisy.part.core
    umbrella = umbrella_laplacian(part, borders)
    rough = part.mesh.planes.normals
    allowed = FILTER_STRENGTHS if detail is None else FILTER_STRENGTHS[max_strength(detail / unit) >= FILTER_STRENGTHS]
    usual = allowed[allowed <= MAX_STRENGTHS[DEFAULT_ORDER]]
    estimates = _estimates(noisy, umbrella, DEFAULT_ORDER, usual, rough)
    first = int(estimates.mean_risks(core).argmin())
    strongest = max(_strongest_local(noisy, estimates), first)
    smooth, normals = _smooth_shape(part, umbrella, first)
    beyond = allowed[: strongest + SEARCH_EXTENSION + 1]

    def evaluate_family(power: float | None, laplacian: Laplacian, order: int) -> _FilterFamily:
        strengths = beyond[beyond <= MAX_STRENGTHS[order]]
        estimates = _estimates(noisy, laplacian, order, strengths, normals)
        return _FilterFamily(power, laplacian, order, strengths, estimates, estimates.mean_risks(core))

    def least_risk(kind: _FilterFamily) -> float:
        return float(kind.risks.min())

    chosen = evaluate_family(None, umbrella, DEFAULT_ORDER)
    for power in LAPLACIAN_POWERS:
        laplacian = cotangent_laplacian(smooth, borders, power, unit)
        chosen = min(chosen, evaluate_family(power, laplacian, DEFAULT_ORDER), key=least_risk)
    for order in FILTER_ORDERS[1:]:
        chosen = min(chosen, evaluate_family(chosen.power, chosen.laplacian, order), key=least_risk)
    laplacian, strengths, best = chosen.laplacian, chosen.strengths, int(chosen.risks.argmin())
    top = max(best, _strongest_local(noisy, chosen.estimates))
    near = list(range(max(best - SEARCH_HALF_WIDTH, 0), min(top + SEARCH_HALF_WIDTH + 1, len(strengths))))
    while True:
        estimates = chosen.estimates.subset(near)
        overall = overall_risks(estimates, core)
        shares = shares_of(noisy, estimates, overall)
        if near[0] == 0 or (shares[:, 0] > PREFERENCE_SHARE).mean() <= MAX_WEAKEST_FRACTION:
            break  # otherwise even weaker filters may be better there
        near = [*range(max(near[0] - 2 * SEARCH_HALF_WIDTH, 0), max(near[0] - 1, 1), WEAK_STRENGTH_STRIDE), *near]
    used = int(np.flatnonzero(shares.mean(axis=0, dtype=np.float64) > MIN_MEAN_SHARE)[-1]) + 1
    near = near[:used]
    if near[-1] + 1 < len(strengths):  # series of weaker filters are shorter: repeat the sums of `fit_low_pass`
        estimates = _estimates(noisy, laplacian, chosen.order, strengths[near], normals)
        overall = overall_risks(estimates, core)
        shares = shares_of(noisy, estimates, overall)
    clusters = noisy.clusters
    max_diffusivity = max(float(clusters.diffuse(clusters.means([laplacian.rates])).max()), 1.0)
    plan = LowPassPlan(
        borders,
        unit,
        first,
        chosen.power,
        0.5 * laplacian.bound,
        max_diffusivity,
        chosen.order,
        strengths[near],
        overall,
    )
    return plan, _mixture(plan, laplacian, normals, estimates.residuals, shares)


def _strongest_local(noisy: NoisyMesh, estimates: Estimates) -> int:
    """Number of the strongest filter that is the best one at more than a few vertices."""
    risks = local_risks(
        noisy.clusters,
        estimates,
        overall_risks(estimates, noisy.part.core),
        noisy.correlation.variance_inflation,
    )
    counts = np.bincount(risks.argmin(axis=1), noisy.clusters.sizes, risks.shape[1])
    above = np.cumsum(counts[::-1])[::-1]
    return int(np.flatnonzero(above > MAX_WEAKEST_FRACTION * counts.sum())[-1])


def fit_low_pass(noisy: NoisyMesh, plan: LowPassPlan) -> LowPass:
    """Find the shares of the strengths around every vertex of a mesh, or of a tile."""
    laplacian = umbrella_laplacian(noisy.part, plan.borders)
    smooth, normals = _smooth_shape(noisy.part, laplacian, plan.first)
    if plan.power is not None:
        options = plan.borders, plan.power, plan.unit
        laplacian = cotangent_laplacian(smooth, *options, max_rate=plan.max_rate)
    del smooth  # for large meshes, memory counts
    estimates = _estimates(noisy, laplacian, plan.order, plan.strengths, normals)
    shares, residuals = shares_of(noisy, estimates, plan.overall), estimates.residuals
    del estimates
    return _mixture(plan, laplacian, normals, residuals, shares)


def shares_of(noisy: NoisyMesh, estimates: Estimates, overall: FloatArray) -> SingleArray:
    """Share of each estimate at every vertex, (n, s), by its local and overall risks."""
    variance_inflation = noisy.correlation.variance_inflation
    risks = local_risks(noisy.clusters, estimates, overall, variance_inflation)
    return local_shares(noisy.clusters, risks, noisy.part.vertex_count, variance_inflation)


def _mixture(
    plan: LowPassPlan, laplacian: Laplacian, normals: FloatArray, residuals: SingleArray, shares: SingleArray
) -> LowPass:
    residuals = np.einsum("ns,ns->n", shares, residuals)
    return LowPass(plan.borders, laplacian, plan.order, plan.strengths, shares, normals.astype(np.float32), residuals)


def _estimates(
    noisy: NoisyMesh, laplacian: Laplacian, order: int, strengths: FloatArray, normals: FloatArray
) -> Estimates:
    """Residuals and leverages of filters; a leverage is the mean of probe times filtered probe (Hutchinson)."""
    vertices = noisy.part.mesh.vertices
    series = low_pass_series(strengths, laplacian.bound, order)
    signs = noisy.probes(1)
    directions = np.hstack([normals / noisy.scale[:, np.newaxis], signs]).astype(np.float32)
    residuals, removed = np.zeros((2, len(vertices), len(strengths)), dtype=np.float32)
    accumulate_residuals(laplacian, np.hstack([vertices, signs]), series, directions, residuals, removed)
    squares = noisy.mean_squares(signs)
    passes = int(noisy.part.vertex_count <= SMALL_MESH_VERTICES or not noisy.is_white)
    for k in range(passes if noisy.errors is None else ROUNDING_PASSES):
        signs = noisy.probes(SIGNALS_PER_PASS, first=1 + SIGNALS_PER_PASS * k)
        accumulate_residuals(laplacian, signs, series, signs, removed, removed)  # all four add to one sum
        squares += noisy.mean_squares(signs)
    removed /= squares[:, np.newaxis]
    leverages = np.subtract(np.float32(1.0), removed, out=removed)
    leverages *= np.square(noisy.sigma / noisy.scale).astype(np.float32)[:, np.newaxis]
    return Estimates(residuals, leverages, noisy.weights)


def _smooth_shape(part: MeshPart, umbrella: Laplacian, best: int) -> tuple[MeshPart, FloatArray]:
    """The mesh after the normal components of the moves of a weak filter, and its normals.

    Tangential components are omitted, because they would change the angles of the triangles.
    """
    vertices = part.mesh.vertices
    strength = np.array([min(float(FILTER_STRENGTHS[max(best - PREFILTER_STEPS, 0)]), MAX_PREFILTER_STRENGTH)])
    smooth = low_pass(umbrella, vertices, strength)
    normals = part.mesh.move(smooth).planes.normals
    heights = np.einsum("ij,ij->i", smooth - vertices, normals)
    return replace(part, mesh=part.mesh.move(vertices + heights[:, np.newaxis] * normals)), normals
