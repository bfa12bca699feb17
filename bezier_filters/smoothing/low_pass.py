"""The low-pass filter that suits a mesh, vertex by vertex: its Laplacian, its order and its strength.

Which Laplacian and order, and which strengths there are, is learned from parts of the mesh (`sampled_parts`); which of
these strengths suit a vertex depends on what is around it.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.special import j0

from bezier_filters.arrays import FloatArray, SingleArray
from bezier_filters.meshes.frames import tangent_planes
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.smoothing.chebyshev import (
    LOWEST,
    ORDER,
    SIDE_BY_SIDE,
    Signals,
    add_heights,
    low_pass,
    low_pass_series,
)
from bezier_filters.smoothing.laplacian import Borders, Laplacian, cotangent_laplacian, umbrella_laplacian
from bezier_filters.smoothing.mesh_parts import MeshPart
from bezier_filters.smoothing.noise import NoisyMesh
from bezier_filters.smoothing.risk import Estimates, local_risks, local_shares, overall_risks

# of the filters; 0 leaves everything as it is. The steps below go from one to the next
STRENGTHS: FloatArray = np.concatenate([[0.0], 10.0 ** np.arange(-1.0, 8.1, 0.5)])
POWERS = (0.0, 0.5, 1.0)  # of cotangent Laplacians, see `cotangent_laplacian`
# of filters: steeper ones suit surfaces whose detail ends at some size, as that of analytic surfaces does, gentle ones
# noise that is as long as detail
ORDERS = (ORDER, 6, LOWEST)
# by order: stronger ones would do round shapes good, but their series are longer, and tiles need more rings
STRONGEST = {LOWEST: 1e8, ORDER: 1e7, 6: 1e6}
AROUND = 3  # strengths on both sides of the one that is best for the mesh as a whole that its parts may take
BEYOND = 6  # steps of the strength beyond that of the umbrella Laplacian up to which others are tried
RARE = 1e-3  # mean share of a strength up to which it is left out if it is stronger than all others that are not
SELDOM = 1e-3  # share of the vertices that prefer the weakest strength, above which weaker ones are tried
SPARSE = 4  # of these weaker ones, every fourth one is
HEAD_START = 2  # steps of the strength by which a filter is weaker that only shows another one what to go by
PREFERRED = 0.5  # share of a strength above which a vertex prefers it
ENOUGH = 10_000.0  # strength of a filter whose normals need no stronger one
FARTHEST = 3.8  # phase between the ends of an edge, beyond which waves are shorter than a mesh shows
FEW = 20_000  # vertices; on smaller meshes, leverages are averaged over more probes


@dataclass(frozen=True)
class LowPassPlan:
    """What holds for a mesh as a whole."""

    borders: Borders  # what border vertices do
    unit: float  # the mean edge, a length
    first: int  # number of the best strength with the umbrella Laplacian
    power: float | None  # of the best Laplacian, see `cotangent_laplacian`; None for that of umbrellas
    fastest: float  # the largest rate of that
    # the largest rate on average around a vertex: where edges are short, filters reach across more of them
    haste: float
    order: int  # the best order of its filters
    strengths: FloatArray  # (s,): those that are tried around every vertex
    overall: FloatArray  # (s,): their risks, see `overall_risks`


@dataclass(frozen=True)
class LowPass:
    """The filters of a mesh, mixed as suits every vertex."""

    borders: Borders  # what border vertices do
    laplacian: Laplacian  # of the filters
    order: int  # of the filters
    strengths: FloatArray  # (s,): of the filters
    shares: SingleArray  # (n, s): of the filters at each vertex
    normals: SingleArray  # (n, 3): of the smooth surface that cotangents are those of
    residuals: SingleArray  # (n,): of the mixture that was chosen, see `Estimates`

    def apply(self, signals: Signals) -> Signals:
        """Filter signals (n, c)."""
        return low_pass(self.laplacian, signals, self.strengths, self.shares, self.order)

    def next_weaker(self) -> "LowPass":
        """The next weaker filters, for where another one follows that takes off noise, too."""
        shares = np.roll(self.shares, -1, axis=1)
        shares[:, -1] = 0.0
        shares[:, 0] += self.shares[:, 0]
        return replace(self, shares=shares)

    def weak(self, umbrella: Laplacian) -> "LowPass":
        """Filters that take off just enough noise for another filter to know signals by."""
        strengths = self.strengths * (STRENGTHS[1] / STRENGTHS[1 + HEAD_START])
        return replace(self, laplacian=umbrella, order=ORDER, strengths=strengths)


class _Kind(NamedTuple):
    """Filters of one Laplacian and order, and of all strengths."""

    power: float | None  # of the Laplacian, see `LowPassPlan`
    laplacian: Laplacian
    order: int
    strengths: FloatArray  # (s,)
    estimates: Estimates
    risks: FloatArray  # (s,)


def strongest(detail: float) -> float:
    """Strength of the filter that leaves half of a wave of a given length, in mean edges, whatever its order.

    That is L^-4 where the Laplacian multiplies the wave by L. On triangles of one size L = 1 - J_0(2 pi / detail), the
    mean over all directions of an edge, which is (2 pi / detail)^2 / 4 for long waves.

    >>> round(float(strongest(10.0)), 1), round(float(strongest(20.0) / strongest(10.0)), 1)
    (11633.8, 237.7)
    """
    result: float = (1.0 - j0(min(2.0 * np.pi / detail, FARTHEST))) ** -4.0
    return result


def learn_low_pass(
    noisy: NoisyMesh, borders: Borders, unit: float, detail: float | None = None
) -> tuple[LowPassPlan, LowPass]:
    """Find the Laplacian, the order and the strengths with the least risk on the core of a part of a mesh.

    `unit` is the mean edge, `detail` the length of the shortest waves that keep half of their height. Returns what
    holds for the mesh as a whole, and what `fit_low_pass` makes of it there.
    """
    part, core = noisy.part, noisy.part.core
    umbrella = umbrella_laplacian(part, borders)
    rough = tangent_planes(part.mesh, part.adjacency).normals
    allowed = STRENGTHS if detail is None else STRENGTHS[strongest(detail / unit) >= STRENGTHS]
    usual = allowed[allowed <= STRONGEST[ORDER]]
    first = int(_estimates(noisy, umbrella, ORDER, usual, rough).mean_risks(core).argmin())
    smooth, normals = _smooth_shape(part, umbrella, first)
    beyond = allowed[: first + BEYOND + 1]

    def tried(power: float | None, laplacian: Laplacian, order: int) -> _Kind:
        strengths = beyond[beyond <= STRONGEST[order]]
        estimates = _estimates(noisy, laplacian, order, strengths, normals)
        return _Kind(power, laplacian, order, strengths, estimates, estimates.mean_risks(core))

    def least_risk(kind: _Kind) -> float:
        return float(kind.risks.min())

    chosen = tried(None, umbrella, ORDER)
    for power in POWERS:
        laplacian = cotangent_laplacian(smooth, borders, power, unit)
        chosen = min(chosen, tried(power, laplacian, ORDER), key=least_risk)
    for order in ORDERS[1:]:
        chosen = min(chosen, tried(chosen.power, chosen.laplacian, order), key=least_risk)
    laplacian, strengths, best = chosen.laplacian, chosen.strengths, int(chosen.risks.argmin())
    near = list(range(max(best - AROUND, 0), min(best + AROUND + 1, len(strengths))))
    while True:
        estimates = chosen.estimates.among(near)
        overall = overall_risks(estimates, core)
        shares = shares_of(noisy, estimates, overall)
        if near[0] == 0 or (shares[:, 0] > PREFERRED).mean() <= SELDOM:
            break  # else even weaker filters may be better there
        near = [*range(max(near[0] - 2 * AROUND, 0), max(near[0] - 1, 1), SPARSE), *near]
    used = int(np.flatnonzero(shares.mean(axis=0, dtype=np.float64) > RARE)[-1]) + 1
    near = near[:used]
    if near[-1] + 1 < len(strengths):  # of weaker filters the series are shorter: as `fit_low_pass` will have them
        estimates = _estimates(noisy, laplacian, chosen.order, strengths[near], normals)
        overall = overall_risks(estimates, core)
        shares = shares_of(noisy, estimates, overall)
    clusters = noisy.clusters
    haste = max(float(clusters.diffuse(clusters.means([laplacian.rates])).max()), 1.0)
    plan = LowPassPlan(
        borders, unit, first, chosen.power, 0.5 * laplacian.bound, haste, chosen.order, strengths[near], overall
    )
    return plan, _mixture(plan, laplacian, normals, estimates.residuals, shares)


def fit_low_pass(noisy: NoisyMesh, plan: LowPassPlan) -> LowPass:
    """Find the strengths around every vertex of a mesh, or of a tile of one."""
    laplacian = umbrella_laplacian(noisy.part, plan.borders)
    smooth, normals = _smooth_shape(noisy.part, laplacian, plan.first)
    if plan.power is not None:
        options = plan.borders, plan.power, plan.unit
        laplacian = cotangent_laplacian(smooth, *options, fastest=plan.fastest)
    del smooth  # for large meshes, memory counts
    estimates = _estimates(noisy, laplacian, plan.order, plan.strengths, normals)
    shares, residuals = shares_of(noisy, estimates, plan.overall), estimates.residuals
    del estimates
    return _mixture(plan, laplacian, normals, residuals, shares)


def shares_of(noisy: NoisyMesh, estimates: Estimates, overall: FloatArray) -> SingleArray:
    """Share of each estimate at every vertex, (n, s), by their risks there and overall."""
    alike = noisy.correlation.alike
    risks = local_risks(noisy.clusters, estimates, overall, alike)
    return local_shares(noisy.clusters, risks, noisy.part.vertex_count, alike)


def _mixture(
    plan: LowPassPlan, laplacian: Laplacian, normals: FloatArray, residuals: SingleArray, shares: SingleArray
) -> LowPass:
    residuals = np.einsum("ns,ns->n", shares, residuals)
    return LowPass(plan.borders, laplacian, plan.order, plan.strengths, shares, normals.astype(np.float32), residuals)


def _estimates(
    noisy: NoisyMesh, laplacian: Laplacian, order: int, strengths: FloatArray, normals: FloatArray
) -> Estimates:
    """Residuals and leverages of filters; a leverage is the mean of probe times filtered probe."""
    vertices = noisy.part.mesh.vertices
    series = low_pass_series(strengths, laplacian.bound, order)
    signs = noisy.probes(1)
    directions = np.hstack([normals / noisy.sigma[:, np.newaxis], signs]).astype(np.float32)
    residuals, taken = np.zeros((2, len(vertices), len(strengths)), dtype=np.float32)
    add_heights(laplacian, np.hstack([vertices, signs]), series, directions, residuals, taken)
    squares = noisy.mean_squares(signs)
    if noisy.part.vertex_count <= FEW or noisy.correlation.times:
        signs = noisy.probes(SIDE_BY_SIDE, first=1)
        add_heights(laplacian, signs, series, signs, taken, taken)  # all four go into the same sum
        squares += noisy.mean_squares(signs)
    taken /= squares[:, np.newaxis]
    return Estimates(residuals, np.subtract(np.float32(1.0), taken, out=taken))


def _smooth_shape(part: MeshPart, umbrella: Laplacian, best: int) -> tuple[MeshPart, FloatArray]:
    """The mesh after the steps of a weak filter along the normals of the vertices, and these normals.

    Without the steps along the surface, which would give the triangles other angles.
    """
    vertices, faces = part.mesh.vertices, part.mesh.faces
    strength = np.array([min(float(STRENGTHS[max(best - HEAD_START, 0)]), ENOUGH)])
    smooth = low_pass(umbrella, vertices, strength)
    normals = tangent_planes(TriangleMesh(smooth, faces), part.adjacency).normals
    heights = np.einsum("ij,ij->i", smooth - vertices, normals)
    return replace(part, mesh=TriangleMesh(vertices + heights[:, np.newaxis] * normals, faces)), normals
