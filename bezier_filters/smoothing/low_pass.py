"""The low-pass filter that suits a mesh, vertex by vertex: its Laplacian, its order and its strength.

Which Laplacian and order, and which strength on the whole, is tried out on parts of the mesh (`mesh_parts`).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bezier_filters.arrays import FloatArray, SingleArray
from bezier_filters.meshes.adjacency import Adjacency
from bezier_filters.meshes.frames import tangent_planes
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.smoothing.chebyshev import WIDTH, add_heights, differences
from bezier_filters.smoothing.clusters import Clusters
from bezier_filters.smoothing.laplacian import Borders, Laplacian, cotangent_laplacian, umbrella_laplacian
from bezier_filters.smoothing.mesh_parts import SampledParts
from bezier_filters.smoothing.scale_space import ORDER, STRENGTHS, Signals, filtered, filtered_evenly, series
from bezier_filters.smoothing.stein import Estimates, local_risks, local_shares

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

MakeLaplacian = Callable[[TriangleMesh, TriangleMesh, Adjacency], Laplacian]
"""Makes a Laplacian of a mesh, of the same mesh with most of its noise taken off, and of its adjacency."""


@dataclass(frozen=True)
class LowPass:
    """The filter that was chosen.

    Attributes
    ----------
    umbrella : Laplacian
        Plain means of neighbours.
    laplacian : Laplacian
        That of the filter.
    order : int
        Of the filter.
    strengths : (s,) float64
        Of the filters that are mixed.
    shares : (n, s) float32
        Share of each at each vertex.
    normals : (n, 3) float32
        Of the smooth surface at the vertices.
    residuals, leverages : (n,) float32
        Of the mixture, see `Estimates`; the leverages by the probes that chose it.
    """

    umbrella: Laplacian
    laplacian: Laplacian
    order: int
    strengths: FloatArray
    shares: SingleArray
    normals: SingleArray
    residuals: SingleArray
    leverages: SingleArray

    def smoothed(self, signals: Signals, *, threads: int = 1) -> Signals:
        """Signals (n, c) after the filter."""
        return filtered(self.laplacian, signals, self.strengths, self.shares, self.order, threads=threads)

    def slightly_less_smoothed(self, signals: Signals, *, threads: int = 1) -> Signals:
        """Signals (n, c) after the next weaker filters, for where another one follows that takes off noise, too."""
        weaker = np.roll(self.shares, -1, axis=1)
        weaker[:, -1] = 0.0
        weaker[:, 0] += self.shares[:, 0]
        return filtered(self.laplacian, signals, self.strengths, weaker, self.order, threads=threads)

    def weakly_smoothed(self, signals: Signals, *, threads: int = 1) -> Signals:
        """Signals (n, c) with just enough noise taken off for another filter to know them by."""
        weaker = self.strengths * (STRENGTHS[1] / STRENGTHS[1 + WEAKER])
        return filtered(self.umbrella, signals, weaker, self.shares, threads=threads)


@dataclass(frozen=True)
class Choice:
    """What holds for a mesh as a whole.

    Attributes
    ----------
    make_umbrella : callable
        Makes the umbrella Laplacian.
    first : int
        Number of the best strength of the umbrella Laplacian.
    make_laplacian : callable
        Makes the best Laplacian.
    order : int
        The best order of its filters.
    best : int
        Number of its best strength.
    strengths : (s,) float64
        Those that there are.
    """

    make_umbrella: MakeLaplacian
    first: int
    make_laplacian: MakeLaplacian
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
    sigma : (n,) float64
        Standard deviation of the noise around every vertex of the whole mesh, positive lengths.
    borders : {"curve", "fixed"}
        What border vertices do.
    unit : float
        The mean edge, a length.
    threads : int
        Number of threads.
    """
    mesh, adjacency, levels = parts.mesh, parts.adjacency, sigma[parts.vertices]
    umbrella = umbrella_laplacian(mesh, adjacency, borders, threads=threads)

    def risks(laplacian: Laplacian, order: int, normals: FloatArray, strengths: FloatArray) -> FloatArray:
        return _estimates(laplacian, order, mesh.vertices, normals, levels, strengths, threads).mean_risks(parts.core)

    rough = tangent_planes(mesh, adjacency, threads=threads).normals
    first = int(risks(umbrella, ORDER, rough, STRENGTHS).argmin())
    normals, shape = _smooth_shape(mesh, adjacency, umbrella, first, threads)
    strengths = STRENGTHS[: first + STRONGER + 1]

    def plain(mesh: TriangleMesh, shape: TriangleMesh, adjacency: Adjacency) -> Laplacian:
        return umbrella_laplacian(mesh, adjacency, borders, threads=threads)

    def with_power(power: float) -> MakeLaplacian:
        return lambda _, shape, adjacency: cotangent_laplacian(shape, adjacency, borders, power, unit, threads=threads)

    makers = [plain, *map(with_power, POWERS)]
    laplacians = [make(mesh, shape, adjacency) for make in makers]
    chosen = int(np.argmin([risks(laplacian, ORDER, normals, strengths).min() for laplacian in laplacians]))
    by_order = np.array([risks(laplacians[chosen], order, normals, strengths) for order in ORDERS])
    steepness, best = np.unravel_index(by_order.argmin(), by_order.shape)
    return Choice(plain, first, makers[chosen], ORDERS[steepness], int(best), strengths)


def fit_low_pass(
    mesh: TriangleMesh,
    adjacency: Adjacency,
    clusters: Clusters,
    sigma: FloatArray,
    choice: Choice,
    *,
    threads: int = 1,
) -> LowPass:
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
    umbrella = choice.make_umbrella(mesh, mesh, adjacency)
    normals, shape = _smooth_shape(mesh, adjacency, umbrella, choice.first, threads)
    plain = choice.make_laplacian is choice.make_umbrella
    laplacian = umbrella if plain else choice.make_laplacian(mesh, shape, adjacency)
    del shape
    lowest = choice.best + AROUND
    shares = np.ones((1, 1), dtype=np.float32)
    while lowest > 0 and np.mean(shares[:, 0] > 0.5) > SELDOM:  # there, even weaker filters may be better
        lowest = max(lowest - 2 * AROUND, 0)
        strengths = choice.strengths[lowest : choice.best + AROUND + 1]
        estimates = _estimates(laplacian, choice.order, mesh.vertices, normals, sigma, strengths, threads)
        shares = local_shares(local_risks(estimates, clusters, threads=threads), clusters, threads=threads)
    used = int(np.flatnonzero(shares.mean(axis=0, dtype=np.float64) > RARE)[-1]) + 1
    shares = shares[:, :used] / shares[:, :used].sum(axis=1, keepdims=True)
    residuals, leverages = (
        np.einsum("ns,ns->n", shares, values[:, :used]) for values in (estimates.residuals, estimates.leverages)
    )
    return LowPass(
        umbrella, laplacian, choice.order, strengths[:used], shares, normals.astype(np.float32), residuals, leverages
    )


def _smooth_shape(
    mesh: TriangleMesh, adjacency: Adjacency, umbrella: Laplacian, best: int, threads: int
) -> tuple[FloatArray, TriangleMesh]:
    """Normals of the vertices after a weak filter, and the mesh after its steps along them.

    Without the steps along the surface, which would give the triangles other angles.
    """
    strength = min(float(STRENGTHS[max(best - WEAKER, 0)]), ENOUGH)
    smooth = filtered_evenly(umbrella, mesh.vertices, strength, threads=threads)
    normals = tangent_planes(TriangleMesh(smooth, mesh.faces), adjacency, threads=threads).normals
    heights = np.einsum("ij,ij->i", smooth - mesh.vertices, normals)
    return normals, TriangleMesh(mesh.vertices + heights[:, np.newaxis] * normals, mesh.faces)


def _estimates(
    laplacian: Laplacian,
    order: int,
    points: FloatArray,
    normals: FloatArray,
    sigma: FloatArray,
    strengths: FloatArray,
    threads: int,
) -> Estimates:
    """Residuals and leverages of filters; a leverage is the mean of sign times filtered sign over random signs."""
    n = len(points)
    rows = series(strengths, laplacian.bound, order)
    rng = np.random.default_rng(0)
    signals, directions = np.empty((n, WIDTH)), np.empty((n, WIDTH), dtype=np.float32)
    signals[:, :3], directions[:, :3] = points, normals / sigma[:, np.newaxis]
    signals[:, 3] = directions[:, 3] = _signs(rng, n)
    residuals, taken = np.zeros((2, n, len(strengths)), dtype=np.float32)
    start = differences(laplacian, signals, threads=threads)
    add_heights(laplacian, start, rows, directions, residuals, taken, threads=threads)
    probes = 1
    if n <= FEW:
        signs = np.column_stack([_signs(rng, n) for _ in range(WIDTH)])
        start = differences(laplacian, signs, threads=threads)
        add_heights(laplacian, start, rows, signs, taken, taken, threads=threads)
        probes += WIDTH
    return Estimates(residuals, np.float32(1.0) - taken / np.float32(probes))


def _signs(rng: np.random.Generator, n: int) -> SingleArray:
    return (2.0 * rng.integers(0, 2, n, dtype=np.int8) - 1.0).astype(np.float32)
