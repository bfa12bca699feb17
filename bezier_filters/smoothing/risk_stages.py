"""Risks of estimates around every vertex, and what share each of them gets there."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from bezier_filters.arrays import FloatArray, SingleArray
from bezier_filters.smoothing.cluster_stages import MEMBERS
from bezier_filters.smoothing.pieces import Arrays, Domain, Found, Handle, Outcome, Piece
from bezier_filters.smoothing.stein import Estimates, add_distances, add_terms

WIDTH = 100.0
"""Squared edges over which risks are averaged around a vertex,"""
VERTICES = 7.26 * WIDTH
"""so many vertices that is, on a regular mesh: the reciprocal of the sum of their squared weights."""
DOUBT = 2.0
"""Times its variance: up to that squared deviation from the mesh as a whole, a local risk is not believed."""
TEMPERATURE = 0.3
"""Times sigma^2, divided by the square root of the number of vertices: difference of risks at which the larger one's
share is exp(-1) times the other's. The overall difference of two risks is known about that well."""


def together(inputs: Mapping[str, Arrays], factor: float) -> Estimates:
    """Residuals and leverages of all estimates among the inputs, side by side, with less noise by a factor."""
    estimates = [values for values in inputs.values() if "residuals" in values]
    residuals, leverages = (_columns([values[name] for values in estimates]) for name in ("residuals", "leverages"))
    return Estimates(residuals if factor == 1.0 else residuals / np.float32(factor), leverages)


def _columns(values: list[SingleArray]) -> SingleArray:
    """Side by side, without a copy if there is one array only."""
    return values[0] if len(values) == 1 and values[0].ndim == 2 else np.column_stack(values)


@dataclass(frozen=True)
class Terms:
    """What the risks, plus 1, are the means of, over each cluster."""

    factor: float
    rings: int = MEMBERS

    def __call__(self, piece: Piece, inputs: Mapping[str, Arrays]) -> Outcome:
        """Terms (k, s), and their means over the mesh."""
        clusters, estimates = piece.clusters, together(inputs, self.factor)
        terms = np.zeros((len(clusters.sizes), estimates.residuals.shape[1]))
        add_terms(clusters.of_vertex, estimates.residuals, estimates.leverages, terms)
        terms /= clusters.sizes[:, np.newaxis]
        return Outcome(clusters={"means": terms}, cluster_sums={"terms": clusters.sizes[:, np.newaxis] * terms})


@dataclass(frozen=True)
class Differences:
    """Differences of the terms from those of the best estimate, and squared distances of the estimates from it."""

    factor: float
    best: int
    rings: int = MEMBERS

    def __call__(self, piece: Piece, inputs: Mapping[str, Arrays]) -> Outcome:
        """Both, (k, 2 s), and the means of the differences over the mesh."""
        clusters, estimates, terms = piece.clusters, together(inputs, self.factor), inputs["terms"]["means"]
        distances = np.zeros(terms.shape)
        add_distances(clusters.of_vertex, estimates.residuals, self.best, distances)
        distances /= clusters.sizes[:, np.newaxis]
        differences = terms - terms[:, [self.best]]
        return Outcome(
            clusters={"means": np.hstack([differences, distances])},
            cluster_sums={"differences": clusters.sizes[:, np.newaxis] * differences},
        )


@dataclass(frozen=True)
class Risks:
    """Local risks, as far as they are believed, and what the last estimate gains over the others."""

    overall: FloatArray
    rings: int = MEMBERS

    def __call__(self, piece: Piece, inputs: Mapping[str, Arrays]) -> Outcome:
        """Risks (k, s)."""
        means, count = inputs["around"]["means"], len(self.overall)
        local = means[:, :count] - self.overall
        # A difference of squared residuals has four times the variance of the difference of the estimates.
        variances = np.maximum(4.0 / VERTICES * means[:, count:], 0.0)
        squares = np.square(local)
        believed = np.divide(
            np.maximum(squares - DOUBT * variances, 0.0), squares, out=np.zeros_like(squares), where=squares > 0.0
        )
        risks = self.overall + believed * local
        others = risks[:, :-1].min(axis=1) if count > 1 else risks[:, 0]
        gains = np.maximum(others - risks[:, -1], 0.0)
        return Outcome(clusters={"risks": risks}, cluster_sums={"gains": (piece.clusters.sizes * gains)[:, np.newaxis]})


@dataclass(frozen=True)
class Shares:
    """Shares of the estimates, by their risks."""

    temperature: float
    rings: int = 1

    def __call__(self, piece: Piece, inputs: Mapping[str, Arrays]) -> Outcome:
        """Shares (n, s), their sums, and the number of vertices that prefer the first estimate."""
        risks = inputs["risks"]["risks"]
        shares: FloatArray = np.exp(-(risks - risks.min(axis=1, keepdims=True)) / self.temperature)
        shares /= shares.sum(axis=1, keepdims=True)
        at_vertices = piece.clusters.at_vertices(shares, threads=piece.threads)
        preferred = (at_vertices[:, 0] > 0.5).astype(np.float32)
        return Outcome(vertices={"shares": at_vertices}, sums={"shares": at_vertices, "first": preferred})


def local_risks(domain: Domain, estimates: Mapping[str, Handle], factor: float) -> tuple[Handle, float]:
    """Risk of every estimate around every cluster, less that of the one that is best for the mesh as a whole.

    Where the local difference deviates from the overall one by no more than noise may make it do, the latter is taken
    (after James and Stein).

    Parameters
    ----------
    domain : Domain
        The mesh, in clusters.
    estimates : mapping
        "residuals" and "leverages", (n,) or (n, s), of some estimates.
    factor : float
        How much less noise there is than was thought.

    Returns
    -------
    risks : Handle
        "risks" (k, s).
    gain : float
        Mean of what the last estimate gains over all others.
    """
    n = max(domain.vertex_count, 1)
    terms = domain.run(Terms(factor), **estimates)
    best = int((terms.sums["terms"] / n).argmin())
    found = domain.run(Differences(factor, best), terms=terms.clusters, **estimates)
    around = domain.diffused(found.clusters, WIDTH)
    risks = domain.run(Risks(found.sums["differences"] / n), around=around)
    domain.free(terms.clusters, found.clusters, around)
    return risks.clusters, float(risks.sums["gains"][0]) / n


def local_shares(domain: Domain, risks: Handle) -> Found:
    """Share of every estimate at every vertex, "shares" (n, s), by their risks around it."""
    return domain.run(Shares(TEMPERATURE / np.sqrt(max(domain.vertex_count, 1))), risks=risks)
