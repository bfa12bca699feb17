"""The low-pass filter that suits a mesh, vertex by vertex: its Laplacian, its order and its strength.

Which Laplacian and order, and which strength on the whole, is tried out on parts of the mesh (`sampled_parts`).
"""

from dataclasses import dataclass, replace

import numpy as np

from bezier_filters.arrays import FloatArray, SingleArray
from bezier_filters.meshes.adjacency import Adjacency
from bezier_filters.meshes.frames import tangent_planes
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.smoothing.chebyshev import ORDER, WIDTH, Signals, add_heights, low_pass, low_pass_series
from bezier_filters.smoothing.clusters import Clusters
from bezier_filters.smoothing.laplacian import Borders, Laplacian, cotangent_laplacian, umbrella_laplacian
from bezier_filters.smoothing.probes import random_signs
from bezier_filters.smoothing.risk import Estimates, local_risks, local_shares
from bezier_filters.smoothing.sampled_parts import SampledParts

STRENGTHS: FloatArray = np.concatenate([[0.0], 10.0 ** np.arange(-1.0, 6.1, 0.5)])
"""Of the filters; 0 leaves everything as it is."""
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
FEW = 20_000
"""Vertices; on smaller meshes, leverages are averaged over more probes."""


@dataclass(frozen=True)
class Shape:
    """A mesh without most of its noise, but with the triangles that it has.

    Attributes
    ----------
    normals : (n, 3) float64
        Of the smooth surface.
    vertices : (n, 3) float64
        The vertices, moved onto the smooth surface along them.
    """

    normals: FloatArray
    vertices: FloatArray


@dataclass(frozen=True)
class Choice:
    """What holds for a mesh as a whole.

    Attributes
    ----------
    borders : {"curve", "fixed"}
        What border vertices do.
    unit : float
        The mean edge, a length.
    first : int
        Number of the best strength with the umbrella Laplacian.
    power : float or None
        Of the best Laplacian, see `cotangent_laplacian`; None for that of umbrellas.
    order : int
        The best order of its filters.
    best : int
        Number of its best strength.
    strengths : (s,) float64
        Those that there are.
    """

    borders: Borders
    unit: float
    first: int
    power: float | None
    order: int
    best: int
    strengths: FloatArray


@dataclass(frozen=True)
class LowPass:
    """The filters of a mesh, mixed as suits every vertex.

    Attributes
    ----------
    borders : {"curve", "fixed"}
        What border vertices do.
    laplacian : Laplacian
        Of the filters.
    order : int
        Of the filters.
    strengths : (s,) float64
        Of the filters.
    shares : (n, s) float32
        Of the filters at each vertex.
    """

    borders: Borders
    laplacian: Laplacian
    order: int
    strengths: FloatArray
    shares: SingleArray

    def apply(self, signals: Signals, *, threads: int = 1) -> Signals:
        """Filter signals (n, c)."""
        return low_pass(self.laplacian, signals, self.strengths, self.shares, self.order, threads=threads)

    def weaker(self) -> "LowPass":
        """The next weaker filters, for where another one follows that takes off noise, too."""
        shares = np.roll(self.shares, -1, axis=1)
        shares[:, -1] = 0.0
        shares[:, 0] += self.shares[:, 0]
        return replace(self, shares=shares)

    def weak(self, umbrella: Laplacian) -> "LowPass":
        """Filters that take off just enough noise for another filter to know signals by."""
        strengths = self.strengths * (STRENGTHS[1] / STRENGTHS[1 + WEAKER])
        return LowPass(self.borders, umbrella, ORDER, strengths, self.shares)


@dataclass(frozen=True)
class FittedLowPass:
    """The filters that suit a mesh, and what they make of it.

    Attributes
    ----------
    filters : LowPass
    shape : Shape
        What cotangents are those of.
    residuals, leverages : (n,) float32
        Of the mixture, see `Estimates`; the leverages by the probes that chose it.
    """

    filters: LowPass
    shape: Shape
    residuals: SingleArray
    leverages: SingleArray


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
    mesh, adjacency = parts.mesh, parts.adjacency

    def risks(laplacian: Laplacian, order: int, normals: FloatArray, strengths: FloatArray) -> FloatArray:
        found = estimates_by(laplacian, order, strengths, mesh.vertices, normals, sigma, threads=threads)
        return found.mean_risks(parts.core)

    umbrella = umbrella_laplacian(mesh, adjacency, borders, threads=threads)
    rough = tangent_planes(mesh, adjacency, threads=threads).normals
    first = int(risks(umbrella, ORDER, rough, STRENGTHS).argmin())
    shape = _smooth_shape(mesh, adjacency, umbrella, first, threads)
    strengths = STRENGTHS[: first + STRONGER + 1]
    powers = (None, *POWERS)
    laplacians = [_laplacian(mesh, adjacency, borders, power, unit, shape, threads) for power in powers]
    chosen = int(np.argmin([risks(one, ORDER, shape.normals, strengths).min() for one in laplacians]))
    by_order = np.array([risks(laplacians[chosen], order, shape.normals, strengths) for order in ORDERS])
    steepness, best = np.unravel_index(by_order.argmin(), by_order.shape)
    return Choice(borders, unit, first, powers[chosen], ORDERS[steepness], int(best), strengths)


def fit_low_pass(
    mesh: TriangleMesh, adjacency: Adjacency, clusters: Clusters, sigma: FloatArray, choice: Choice, *, threads: int = 1
) -> FittedLowPass:
    """Find the strengths around every vertex.

    Parameters
    ----------
    mesh : TriangleMesh
    adjacency : Adjacency
        Of the same mesh.
    clusters : Clusters
        Of the same mesh.
    sigma : (n,) float64
        Standard deviation of the noise around every vertex, positive lengths.
    choice : Choice
        What holds for the mesh as a whole.
    threads : int
        Number of threads.
    """
    n = mesh.vertex_count
    umbrella = umbrella_laplacian(mesh, adjacency, choice.borders, threads=threads)
    shape = _smooth_shape(mesh, adjacency, umbrella, choice.first, threads)
    del umbrella
    laplacian = _laplacian(mesh, adjacency, choice.borders, choice.power, choice.unit, shape, threads)
    lowest, seldom = choice.best + AROUND, 1.0
    while lowest > 0 and seldom > SELDOM:  # there, even weaker filters may be better
        lowest = max(lowest - 2 * AROUND, 0)
        strengths = choice.strengths[lowest : choice.best + AROUND + 1]
        estimates = estimates_by(
            laplacian, choice.order, strengths, mesh.vertices, shape.normals, sigma, threads=threads
        )
        shares = local_shares(clusters, local_risks(clusters, estimates, threads=threads), n, threads=threads)
        seldom = float((shares[:, 0] > 0.5).mean())
    used = int(np.flatnonzero(shares.mean(axis=0, dtype=np.float64) > RARE)[-1]) + 1
    shares = shares[:, :used] / shares[:, :used].sum(axis=1, keepdims=True)
    residuals, leverages = (
        np.einsum("ns,ns->n", shares, values[:, :used]) for values in (estimates.residuals, estimates.leverages)
    )
    return FittedLowPass(
        LowPass(choice.borders, laplacian, choice.order, strengths[:used], shares), shape, residuals, leverages
    )


def estimates_by(
    laplacian: Laplacian,
    order: int,
    strengths: FloatArray,
    vertices: FloatArray,
    normals: FloatArray,
    sigma: FloatArray,
    *,
    threads: int = 1,
) -> Estimates:
    """Residuals and leverages of filters; a leverage is the mean of sign times filtered sign."""
    n, series = len(vertices), low_pass_series(strengths, laplacian.bound, order)
    signs = random_signs(n, 1)
    directions = np.hstack([normals / sigma[:, np.newaxis], signs]).astype(np.float32)
    residuals, taken = np.zeros((2, n, len(strengths)), dtype=np.float32)
    signals = np.hstack([vertices, signs])
    add_heights(laplacian, signals, series, directions, residuals, taken, threads=threads)
    probes = 1
    if n <= FEW:
        signs = random_signs(n, WIDTH, skipped=1)
        add_heights(laplacian, signs, series, signs, taken, taken, threads=threads)  # all four go into the same sum
        probes += WIDTH
    return Estimates(residuals, np.float32(1.0) - taken / np.float32(probes))


def _laplacian(
    mesh: TriangleMesh,
    adjacency: Adjacency,
    borders: Borders,
    power: float | None,
    unit: float,
    shape: Shape,
    threads: int,
) -> Laplacian:
    """Of umbrellas, or of cotangents of a smooth shape."""
    if power is None:
        return umbrella_laplacian(mesh, adjacency, borders, threads=threads)
    smooth = TriangleMesh(shape.vertices, mesh.faces)
    return cotangent_laplacian(smooth, adjacency, borders, power, unit, threads=threads)


def _smooth_shape(mesh: TriangleMesh, adjacency: Adjacency, umbrella: Laplacian, best: int, threads: int) -> Shape:
    """Normals of the vertices after a weak filter, and the mesh after its steps along them.

    Without the steps along the surface, which would give the triangles other angles.
    """
    strength = np.array([min(float(STRENGTHS[max(best - WEAKER, 0)]), ENOUGH)])
    smooth = low_pass(umbrella, mesh.vertices, strength, threads=threads)
    normals = tangent_planes(TriangleMesh(smooth, mesh.faces), adjacency, threads=threads).normals
    heights = np.einsum("ij,ij->i", smooth - mesh.vertices, normals)
    return Shape(normals, mesh.vertices + heights[:, np.newaxis] * normals)
