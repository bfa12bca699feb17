"""Whether the noise of a mesh varies from place to place, and how."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from bezier_filters.arrays import FloatArray, RealArray
from bezier_filters.meshes.frames import tangent_planes
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.smoothing.cluster_stages import MEMBERS
from bezier_filters.smoothing.laplacian import LaplacianRule
from bezier_filters.smoothing.low_pass_runs import bounded
from bezier_filters.smoothing.pieces import Arrays, Domain, Draw, Handle, Outcome, Piece
from bezier_filters.smoothing.scale_space import filtered_evenly, series

WEAK, STRONGER = 1.0, 10.0
"""Strengths of the filters that residuals and normals are taken from."""
WIDTH = 100.0
"""Squared edges: the residuals of some 700 vertices are averaged."""
SPREAD = 2.0
"""Ratio of high levels to low ones from which on the noise is taken to vary."""
NO_CREASES = 0.12
"""Times the mean edge: creases of a mesh without noise look like less noise than this."""
LEAST = 0.1
"""Of the highest levels, the lowest."""
MEAN_ROOT = 0.822
"""Mean of sqrt(|x|) for a standard normal x."""


@dataclass(frozen=True)
class TakenOff:
    """What a weak filter takes off along the normal, and off noise of variance 1."""

    rule: LaplacianRule

    @property
    def rings(self) -> int:
        """The terms of the longer series, differences and planes."""
        return len(series(np.array([STRONGER]), 2.0 * max(self.rule.largest_rate or 0.0, 0.5))) + 2

    def __call__(self, piece: Piece, inputs: Mapping[str, Arrays]) -> Outcome:
        """Residuals (n,)."""
        mesh, threads = piece.mesh, piece.threads
        laplacian = piece.laplacian(self.rule)
        signals = np.hstack([mesh.vertices, inputs["noise"]["drawn"]])
        taken = signals - filtered_evenly(laplacian, signals, WEAK, threads=threads)
        smooth = filtered_evenly(laplacian, mesh.vertices, STRONGER, threads=threads)
        normals = tangent_planes(TriangleMesh(smooth, mesh.faces), piece.adjacency, threads=threads).normals
        residuals = np.abs(np.einsum("ij,ij->i", taken[:, :3], normals))
        return Outcome(vertices={"residuals": residuals}, squares={"noise": np.ascontiguousarray(taken[:, 3])})


@dataclass(frozen=True)
class MeanRoots:
    """Roots of the residuals, averaged over clusters."""

    share: float
    """Of the noise, that the filter takes off."""
    rings: int = MEMBERS

    def __call__(self, piece: Piece, inputs: Mapping[str, Arrays]) -> Outcome:
        """Means (k, 1)."""
        roots = np.sqrt(inputs["residuals"]["residuals"] / self.share)
        return Outcome(clusters={"means": piece.clusters.means(roots[:, np.newaxis])})


@dataclass(frozen=True)
class RootsAtVertices:
    """The same at vertices."""

    rings: int = 1

    def __call__(self, piece: Piece, inputs: Mapping[str, Arrays]) -> Outcome:
        """Roots (n,), float32, not negative."""
        roots = piece.clusters.at_vertices(inputs["roots"]["means"], threads=piece.threads)[:, 0]
        return Outcome(vertices={"roots": np.maximum(roots, np.float32(0.0))})


@dataclass(frozen=True)
class Levels:
    """Standard deviations of the noise, without that of fine relief.

    Attributes
    ----------
    sigma : float or None
        Everywhere; None if it varies.
    lowest : float
        Of those that vary.
    least : float
        Of any.
    detail : float
        What counts as relief.
    """

    sigma: float | None
    lowest: float
    least: float
    detail: float
    rings: int = 0

    def __call__(self, piece: Piece, inputs: Mapping[str, Arrays]) -> Outcome:
        """Levels (n,), lengths."""
        roots = inputs["roots"]["roots"]
        levels = np.full(len(roots), self.sigma) if self.sigma is not None else _levels(roots)
        levels = np.maximum(np.maximum(levels, self.lowest), self.least)
        return Outcome(vertices={"levels": np.sqrt(levels**2 - self.detail**2)})


def _levels(roots: RealArray) -> FloatArray:
    result: FloatArray = np.square(roots.astype(np.float64) / MEAN_ROOT)
    return result


def noise_levels(domain: Domain, sigma: float, unit: float, least: float, detail: float) -> Handle:
    """Standard deviation of the noise around every vertex, "levels" (n,): sigma, unless it clearly varies.

    The levels are means of what a weak filter takes off, in a way that outliers, such as at edges, matter little to.

    Parameters
    ----------
    domain : Domain
        The mesh, in clusters.
    sigma : float
        Standard deviation of the noise of the mesh as a whole, a length.
    unit : float
        The mean edge, a length.
    least : float
        The lowest level that there may be, a length, before
    detail : float
        the standard deviation of the relief is taken off it, a shorter length.
    """
    rule = bounded(domain, LaplacianRule("free"))
    noise = domain.drawn(Draw("normal", 3))
    found = domain.run(TakenOff(rule), noise=noise)
    share = float(np.sqrt(found.sums["noise"][0] / domain.vertex_count))
    means = domain.run(MeanRoots(share), residuals=found.vertices).clusters
    spread = domain.diffused(means, WIDTH)
    roots = domain.run(RootsAtVertices(), roots=spread).vertices
    low, high = (_quantile(domain, roots, share) for share in (0.1, 0.9))
    if high < NO_CREASES * unit or high < SPREAD * low:
        stage = Levels(sigma, 0.0, least, detail)
    else:
        stage = Levels(None, LEAST * high, least, detail)
    result = domain.run(stage, roots=roots).vertices
    domain.free(noise, found.vertices, means, spread, roots)
    return result


def _quantile(domain: Domain, roots: Handle, share: float) -> float:
    """Quantile of the levels, which ascend with their roots."""
    place = (domain.vertex_count - 1) * share
    below = int(place)
    pair = domain.ordered([below, min(below + 1, domain.vertex_count - 1)], "roots", roots)
    return float(np.quantile(_levels(np.array(pair)), place - below))
