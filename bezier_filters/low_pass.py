"""The low-pass filter that suits a mesh, vertex by vertex: its Laplacian and its strength."""

from dataclasses import dataclass

import numpy as np

from bezier_filters.adjacency import Adjacency
from bezier_filters.arrays import FloatArray
from bezier_filters.frames import tangent_planes
from bezier_filters.laplacian import Borders, Laplacian, cotangent_laplacian, umbrella_laplacian
from bezier_filters.mesh import TriangleMesh
from bezier_filters.scale_space import STRENGTHS, filtered, filtered_evenly, run_series, series
from bezier_filters.stein import Estimates, local_shares

POWERS = (0.0, 0.5, 1.0)
"""Of cotangent Laplacians, see `cotangent_laplacian`."""
AROUND = 6
"""Strengths on both sides of the one that is best for the mesh as a whole that its parts may take."""
STRONGER = 6
"""Steps of the strength beyond that of the umbrella Laplacian up to which others are tried."""
WEAKER = 2
"""Steps of the strength by which a filter that another one follows is weaker."""
FEWEST_PROBED = 40_000
"""Vertices times probes, for leverages."""


@dataclass(frozen=True)
class LowPass:
    """The filter that was chosen.

    Attributes
    ----------
    surroundings : Laplacian
        Plain means of neighbours, also at borders.
    umbrella : Laplacian
        Plain means of neighbours; at borders, as was asked for.
    laplacian : Laplacian
        That of the filter.
    strengths : (s,) float64
        Of the filters that are mixed.
    shares : (n, s) float64
        Share of each at each vertex.
    weak_strength : float
        That suits the mesh as a whole if another filter follows.
    normals : (n, 3) float64
        Of the smooth surface at the vertices.
    """

    surroundings: Laplacian
    umbrella: Laplacian
    laplacian: Laplacian
    strengths: FloatArray
    shares: FloatArray
    weak_strength: float
    normals: FloatArray

    def smoothed(self, signals: FloatArray, *, threads: int = 1) -> FloatArray:
        """Signals (n, c) after the filter."""
        return filtered(self.laplacian, signals, self.strengths, self.shares, threads=threads)

    def slightly_less_smoothed(self, signals: FloatArray, *, threads: int = 1) -> FloatArray:
        """Signals (n, c) after the next weaker filters, for where another one follows that takes off noise, too."""
        weaker = np.roll(self.shares, -1, axis=1)
        weaker[:, -1] = 0.0
        weaker[:, 0] += self.shares[:, 0]
        return filtered(self.laplacian, signals, self.strengths, weaker, threads=threads)

    def weakly_smoothed(self, signals: FloatArray, *, threads: int = 1) -> FloatArray:
        """Signals (n, c) with just enough noise taken off for another filter to know them by."""
        return filtered_evenly(self.umbrella, signals, self.weak_strength, threads=threads)


def choose_low_pass(
    mesh: TriangleMesh, adjacency: Adjacency, sigma: FloatArray, borders: Borders, unit: float, *, threads: int = 1
) -> LowPass:
    """Find the Laplacian and the strengths with the least risk.

    Parameters
    ----------
    mesh : TriangleMesh
    adjacency : Adjacency
        Of the same mesh.
    sigma : (n,) float64
        Standard deviation of the noise around every vertex, positive lengths.
    borders : {"curve", "fixed"}
        What border vertices do.
    unit : float
        The mean edge, a length.
    threads : int
        Number of threads.
    """
    umbrella = umbrella_laplacian(mesh, adjacency, borders, threads=threads)
    probes = _probes(mesh.vertex_count)
    first = _estimates(umbrella, mesh.vertices, _normals(mesh, adjacency, threads), sigma, STRENGTHS, probes, threads)
    best = int(first.risks.argmin())
    weak = STRENGTHS[max(best - WEAKER, 0)]
    smooth = filtered_evenly(umbrella, mesh.vertices, weak, threads=threads)
    normals = _normals(TriangleMesh(smooth, mesh.faces), adjacency, threads)
    # Without its steps along the surface, which would give the triangles other angles.
    heights = np.einsum("ij,ij->i", smooth - mesh.vertices, normals)
    shape = TriangleMesh(mesh.vertices + heights[:, np.newaxis] * normals, mesh.faces)
    strengths = STRENGTHS[: best + STRONGER + 1]
    tried = [(umbrella, _estimates(umbrella, mesh.vertices, normals, sigma, strengths, probes, threads))]
    for power in POWERS:
        laplacian = cotangent_laplacian(shape, adjacency, borders, power, unit, threads=threads)
        tried.append((laplacian, _estimates(laplacian, mesh.vertices, normals, sigma, strengths, probes, threads)))
    laplacian, estimates = min(tried, key=lambda pair: pair[1].risks.min())
    best = int(estimates.risks.argmin())
    near = slice(max(best - AROUND, 0), best + AROUND + 1)
    free = umbrella_laplacian(mesh, adjacency, "free", threads=threads)
    shares = local_shares(estimates.only(near), free, threads=threads)
    weak = strengths[max(best - WEAKER, 0)]
    return LowPass(free, umbrella, laplacian, strengths[near], shares, float(weak), normals)


def _normals(mesh: TriangleMesh, adjacency: Adjacency, threads: int) -> FloatArray:
    return tangent_planes(mesh, adjacency, threads=threads).normals


def _probes(n: int) -> FloatArray:
    """Random signs (n, k)."""
    count = int(np.clip(FEWEST_PROBED // max(n, 1), 1, 6))
    return np.random.default_rng(0).choice(np.array([-1.0, 1.0]), (n, count))


def _estimates(
    laplacian: Laplacian,
    points: FloatArray,
    normals: FloatArray,
    sigma: FloatArray,
    strengths: FloatArray,
    probes: FloatArray,
    threads: int,
) -> Estimates:
    """Residuals and leverages of filters; a leverage is the mean of sign times filtered sign over random signs."""
    n, count = probes.shape
    heights = np.einsum("ij,ij->i", points, normals)
    residuals = np.repeat(heights[:, np.newaxis], len(strengths), axis=1)
    leverages = np.zeros((n, len(strengths)))

    def add(values: FloatArray, coefficients: FloatArray) -> None:
        heights = np.einsum("ij,ij->i", values[:, :3], normals)
        own = np.einsum("ij,ij->i", values[:, 3:], probes) / count
        residuals[:] -= heights[:, np.newaxis] * coefficients
        leverages[:] += own[:, np.newaxis] * coefficients

    run_series(laplacian, np.hstack([points, probes]), series(strengths, laplacian.bound), add, threads=threads)
    return Estimates(residuals / sigma[:, np.newaxis], leverages)
