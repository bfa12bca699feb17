"""The low-pass filter that suits a mesh, vertex by vertex: its Laplacian, its order and its strength.

Which Laplacian and order, and which strength on the whole, is tried out on parts of the mesh (`mesh_parts`).
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from bezier_filters.arrays import FloatArray
from bezier_filters.meshes.frames import tangent_planes
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.smoothing.laplacian import Borders, LaplacianRule
from bezier_filters.smoothing.low_pass_runs import PointsAndSigns, Signals, bounded, estimates_by, taken_by
from bezier_filters.smoothing.mesh_parts import SampledParts
from bezier_filters.smoothing.pieces import Arrays, Domain, Handle, Outcome, Piece
from bezier_filters.smoothing.risk_stages import local_risks, local_shares
from bezier_filters.smoothing.scale_space import ORDER, STRENGTHS
from bezier_filters.smoothing.stein import Estimates
from bezier_filters.smoothing.whole_mesh import WholeMesh

POWERS = (0.0, 0.5, 1.0)
"""Of cotangent Laplacians, see `cotangent_laplacian`."""
ORDERS = (ORDER, 6)
"""Of filters: steeper ones suit surfaces whose detail ends at some size, as that of analytic surfaces does."""
AROUND = 3
"""Strengths on both sides of the one that is best for the mesh as a whole that its parts may take."""
STRONGER = 6
"""Steps of the strength beyond that of the umbrella Laplacian up to which others are tried."""
RARE = 1e-3
"""Mean share of a strength up to which it is left out if it is stronger than all others that are not."""
SELDOM = 1e-3
"""Share of the vertices that prefer the weakest strength, above which weaker ones are tried."""
WEAKER = 2
"""Steps of the strength by which a filter that another one follows is weaker."""
ENOUGH = 10_000.0
"""Strength of a filter whose normals need no stronger one."""


@dataclass(frozen=True)
class LowPass:
    """The filter that was chosen, with the values that it needs at the vertices.

    Attributes
    ----------
    umbrella : LaplacianRule
        Plain means of neighbours.
    rule : LaplacianRule
        Of the Laplacian of the filter.
    order : int
        Of the filter.
    strengths : (s,) float64
        Of the filters that are mixed.
    shape : Handle
        "normals" (n, 3) of the smooth surface, and the "shape" (n, 3) that cotangents are those of.
    mixture : Handle
        "shares" (n, s) of the filters, and "residuals" and "leverages" (n,) of the mixture, see `Estimates`; the
        leverages by the probes that chose it.
    """

    umbrella: LaplacianRule
    rule: LaplacianRule
    order: int
    strengths: FloatArray
    shape: Handle
    mixture: Handle

    def takes_off(self, domain: Domain, signals: Signals, **inputs: Handle) -> Handle:
        """What the filter takes off signals, "taken" (n, 4)."""
        inputs |= {"shape": self.shape, "shares": self.mixture}
        return taken_by(domain, self.rule, self.strengths, signals, self.order, **inputs)

    def weaker(self, domain: Domain) -> "LowPass":
        """The next weaker filters, for where another one follows that takes off noise, too."""
        return replace(self, mixture=domain.run(WeakerShares(), mixture=self.mixture).vertices)

    def weak(self) -> "LowPass":
        """Filters that take off just enough noise for another filter to know signals by."""
        strengths = self.strengths * (STRENGTHS[1] / STRENGTHS[1 + WEAKER])
        return replace(self, rule=self.umbrella, order=ORDER, strengths=strengths)


@dataclass(frozen=True)
class WeakerShares:
    """Every filter's share goes to the next weaker one."""

    rings: int = 0

    def __call__(self, piece: Piece, inputs: Mapping[str, Arrays]) -> Outcome:
        """Shares (n, s)."""
        shares = inputs["mixture"]["shares"]
        weaker = np.roll(shares, -1, axis=1)
        weaker[:, -1] = 0.0
        weaker[:, 0] += shares[:, 0]
        return Outcome(vertices={"shares": weaker})


@dataclass(frozen=True)
class Choice:
    """What holds for a mesh as a whole.

    Attributes
    ----------
    umbrella : LaplacianRule
        The umbrella Laplacian.
    first : int
        Number of its best strength.
    rule : LaplacianRule
        The best Laplacian.
    order : int
        The best order of its filters.
    best : int
        Number of its best strength.
    strengths : (s,) float64
        Those that there are.
    """

    umbrella: LaplacianRule
    first: int
    rule: LaplacianRule
    order: int
    best: int
    strengths: FloatArray


def choose_low_pass(
    parts: SampledParts, sigma: FloatArray, borders: Borders, unit: float, *, threads: int = 1
) -> Choice:
    """Find the Laplacian, the order and the strength with the least risk on some parts of a mesh.

    Parameters
    ----------
    parts : SampledParts
    sigma : (k,) float64
        Standard deviation of the noise around every vertex of the parts, positive lengths.
    borders : {"curve", "fixed"}
        What border vertices do.
    unit : float
        The mean edge, a length.
    threads : int
        Number of threads.
    """
    domain = WholeMesh(parts.mesh, parts.adjacency, threads)
    levels = {"levels": sigma}

    def risks(rule: LaplacianRule, order: int, shape: Handle, strengths: FloatArray) -> FloatArray:
        found = estimates_by(domain, rule, order, strengths, surface=shape, shape=shape, levels=levels)
        return Estimates(found["residuals"], found["leverages"]).mean_risks(parts.core)

    umbrella = bounded(domain, LaplacianRule(borders))
    rough = {
        "normals": tangent_planes(parts.mesh, parts.adjacency, threads=threads).normals,
        "shape": parts.mesh.vertices,
    }
    first = int(risks(umbrella, ORDER, rough, STRENGTHS).argmin())
    shape = _smooth_shape(domain, umbrella, first)
    strengths = STRENGTHS[: first + STRONGER + 1]
    cotangents = [bounded(domain, LaplacianRule(borders, power, unit), shape=shape) for power in POWERS]
    rules = [umbrella, *cotangents]
    chosen = int(np.argmin([risks(rule, ORDER, shape, strengths).min() for rule in rules]))
    by_order = np.array([risks(rules[chosen], order, shape, strengths) for order in ORDERS])
    steepness, best = np.unravel_index(by_order.argmin(), by_order.shape)
    return Choice(umbrella, first, rules[chosen], ORDERS[steepness], int(best), strengths)


def fit_low_pass(domain: Domain, levels: Handle, choice: Choice) -> LowPass:
    """Find the strengths around every vertex.

    Parameters
    ----------
    domain : Domain
        The mesh, in clusters.
    levels : Handle
        "levels" (n,), the standard deviation of the noise around every vertex, positive lengths.
    choice : Choice
        What holds for the mesh as a whole.
    """
    umbrella = bounded(domain, choice.umbrella)
    shape = _smooth_shape(domain, umbrella, choice.first)
    rule = umbrella if choice.rule.power is None else bounded(domain, choice.rule, shape=shape)
    lowest, seldom, old = choice.best + AROUND, 1.0, list[Handle]()
    while lowest > 0 and seldom > SELDOM:  # there, even weaker filters may be better
        domain.free(*old)
        lowest = max(lowest - 2 * AROUND, 0)
        strengths = choice.strengths[lowest : choice.best + AROUND + 1]
        estimates = estimates_by(domain, rule, choice.order, strengths, surface=shape, shape=shape, levels=levels)
        risks, _ = local_risks(domain, {"one": estimates}, 1.0)
        found = local_shares(domain, risks)
        seldom = float(found.sums["first"][0]) / domain.vertex_count
        old = [estimates, found.vertices, risks]
    used = int(np.flatnonzero(found.sums["shares"] / domain.vertex_count > RARE)[-1]) + 1
    mixture = domain.run(Mixture(used), estimates=estimates, shares=found.vertices).vertices
    domain.free(*old)
    return LowPass(umbrella, rule, choice.order, strengths[:used], shape, mixture)


@dataclass(frozen=True)
class Mixture:
    """The filters that are used at all."""

    used: int
    rings: int = 0

    def __call__(self, piece: Piece, inputs: Mapping[str, Arrays]) -> Outcome:
        """Shares (n, used), and residuals and leverages (n,) of the mixture."""
        shares, estimates = inputs["shares"]["shares"][:, : self.used], inputs["estimates"]
        shares = shares / shares.sum(axis=1, keepdims=True)
        residuals, leverages = (
            np.einsum("ns,ns->n", shares, estimates[name][:, : self.used]) for name in ("residuals", "leverages")
        )
        return Outcome(vertices={"shares": shares, "residuals": residuals, "leverages": leverages})


def _smooth_shape(domain: Domain, umbrella: LaplacianRule, best: int) -> Handle:
    """Normals of the vertices after a weak filter, and the mesh after its steps along them.

    Without the steps along the surface, which would give the triangles other angles.
    """
    strength = min(float(STRENGTHS[max(best - WEAKER, 0)]), ENOUGH)
    taken = taken_by(domain, umbrella, np.array([strength]), PointsAndSigns())
    result = domain.run(SmoothShape(), smooth=taken).vertices
    domain.free(taken)
    return result


@dataclass(frozen=True)
class SmoothShape:
    """Normals of a smooth mesh, and the mesh moved onto it along them."""

    rings: int = 1

    def __call__(self, piece: Piece, inputs: Mapping[str, Arrays]) -> Outcome:
        """Normals and coordinates, (n, 3)."""
        mesh = piece.mesh
        smooth = mesh.vertices - inputs["smooth"]["taken"][:, :3]
        normals = tangent_planes(TriangleMesh(smooth, mesh.faces), piece.adjacency, threads=piece.threads).normals
        heights = np.einsum("ij,ij->i", smooth - mesh.vertices, normals)
        return Outcome(vertices={"normals": normals, "shape": mesh.vertices + heights[:, np.newaxis] * normals})
