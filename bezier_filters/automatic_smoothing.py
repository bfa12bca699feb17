"""Takes noise off a mesh: as a smooth surface or as one with sharp edges, wherever it is which.

Two ways lead to a result. A low-pass filter, whose Laplacian and strength are chosen by the
data, is best for smooth surfaces. For edges and corners the normals of a more weakly filtered
mesh are filtered, many times, by means that do not reach across what noise cannot explain, and the
vertices follow. In between are fewer rounds. Stein's estimate of the risk tells what is best around each vertex.
"""

from dataclasses import dataclass

import numpy as np

from bezier_filters.adjacency import Adjacency
from bezier_filters.arrays import FloatArray
from bezier_filters.laplacian import Borders
from bezier_filters.low_pass import choose_low_pass
from bezier_filters.mesh import TriangleMesh
from bezier_filters.noise_levels import noise_levels
from bezier_filters.normal_filter import filter_normals, noisy_normals
from bezier_filters.parallel import Progress, report
from bezier_filters.stein import Estimates, local_shares
from bezier_filters.vertex_update import move_to_normals

DETAIL = 0.01
"""Times the mean edge: fine relief of clean scans, in which neighbours differ, too, and which is left alone."""
SMALLEST_NOISE = 1e-4
"""Times the mean edge: below that there is nothing to take off."""
FEWEST_SAMPLED = 60_000
"""Vertices times samples of the noise, that normals are filtered by."""
PROBE = 0.1
"""Times sigma: how far vertices are moved to find their leverages."""


@dataclass(frozen=True)
class Treatment:
    """Rounds of filtering the normals, and what counts as agreement, in standard deviations."""

    rounds: int
    tolerance: float


NONE = Treatment(0, 0.0)
"""After the low-pass filter proper."""
GENTLE = Treatment(1, 3.0)
"""After a slightly weaker one."""
SHARPENING = (Treatment(2, 2.0), Treatment(5, 1.5), Treatment(16, 1.5))
"""After a much weaker one."""
SHARPNESS = (0.0, 0.0, 0.33, 0.67, 1.0)
"""Of the results, as reported."""
STEPS = 6
"""Of the progress."""


@dataclass(frozen=True)
class Denoised:
    """The result.

    Attributes
    ----------
    vertices : (n, 3) float64
        Coordinates.
    sharpness : (n,) float64
        0 where the surface was taken for smooth, 1 where edges were kept as sharp as can be.
    """

    vertices: FloatArray
    sharpness: FloatArray


def denoise(
    mesh: TriangleMesh,
    adjacency: Adjacency,
    sigma: float,
    unit: float,
    borders: Borders,
    *,
    threads: int = 1,
    progress: Progress | None = None,
) -> Denoised:
    """Take the noise off.

    Parameters
    ----------
    mesh : TriangleMesh
    adjacency : Adjacency
        Of the same mesh.
    sigma : float
        Standard deviation of the noise along the normal, a length.
    unit : float
        The mean edge, a length.
    borders : {"curve", "fixed"}
        Whether border vertices are smoothed along the border, or stay.
    threads : int
        Number of threads.
    progress : callable, optional
        Called after each of a few steps.
    """
    least = (DETAIL + SMALLEST_NOISE) * unit
    if not sigma > least:
        return Denoised(mesh.vertices.copy(), np.zeros(mesh.vertex_count))
    center = mesh.vertices.mean(axis=0)  # far from the origin, digits would be lost
    mesh = TriangleMesh(mesh.vertices - center, mesh.faces)
    levels = np.maximum(noise_levels(mesh, adjacency, sigma, unit, threads=threads), least)
    levels = np.sqrt(levels**2 - (DETAIL * unit) ** 2)
    report(progress, 0, STEPS)
    low_pass = choose_low_pass(mesh, adjacency, levels, borders, unit, threads=threads)
    signs = np.random.default_rng(1).choice(np.array([-1.0, 1.0]), mesh.vertex_count)
    signals = np.hstack([mesh.vertices, _noise(low_pass.normals, levels), _probe(low_pass.normals, signs, levels)])
    report(progress, 2, STEPS)
    candidates: list[FloatArray] = []
    probed: list[FloatArray] = []
    for step, (smooth, treatments) in enumerate(
        (
            (low_pass.smoothed, (NONE,)),
            (low_pass.slightly_less_smoothed, (GENTLE,)),
            (low_pass.weakly_smoothed, SHARPENING),
        )
    ):
        start = smooth(signals, threads=threads)
        points, noise = start[:, :3], start[:, 3:-3].reshape(len(start), -1, 3)
        candidates += _treated(mesh, adjacency, points, noise, treatments, threads)
        probed += _treated(mesh, adjacency, points + start[:, -3:], noise, treatments, threads)
        report(progress, 3 + step, STEPS)
    estimates = _estimates(mesh.vertices, candidates, probed, low_pass.normals, signs, levels)
    shares = local_shares(estimates.rescaled(), low_pass.surroundings, threads=threads)
    result = np.einsum("nk,knc->nc", shares, np.stack(candidates)) + center
    report(progress, STEPS, STEPS)
    return Denoised(result, shares @ np.array(SHARPNESS))


def _noise(normals: FloatArray, levels: FloatArray) -> FloatArray:
    """Samples of the noise, (n, 3 k)."""
    n = len(normals)
    count = int(np.clip(FEWEST_SAMPLED // n, 2, 6))
    heights = np.random.default_rng(2).standard_normal((n, count)) * levels[:, np.newaxis]
    result: FloatArray = (heights[:, :, np.newaxis] * normals[:, np.newaxis]).reshape(n, -1)
    return result


def _probe(normals: FloatArray, signs: FloatArray, levels: FloatArray) -> FloatArray:
    """Small steps along the normals, (n, 3)."""
    result: FloatArray = (PROBE * levels * signs)[:, np.newaxis] * normals
    return result


def _treated(
    mesh: TriangleMesh,
    adjacency: Adjacency,
    vertices: FloatArray,
    noise: FloatArray,
    treatments: tuple[Treatment, ...],
    threads: int,
) -> list[FloatArray]:
    """Vertices after each treatment of the normals of the same start."""
    start = TriangleMesh(np.ascontiguousarray(vertices), mesh.faces)
    first = noisy_normals(start, np.ascontiguousarray(noise), threads=threads)
    corners = adjacency.faces.indptr, adjacency.faces.indices
    results: list[FloatArray] = []
    for treatment in treatments:
        state = first
        for _ in range(treatment.rounds):
            state = filter_normals(start, corners, state, treatment.tolerance, threads=threads)
        if not treatment.rounds:
            results.append(start.vertices)
            continue
        results.append(move_to_normals(start, adjacency, state.normals, ~adjacency.on_boundary, threads=threads))
    return results


def _estimates(
    measured: FloatArray,
    candidates: list[FloatArray],
    probed: list[FloatArray],
    normals: FloatArray,
    signs: FloatArray,
    levels: FloatArray,
) -> Estimates:
    """Residuals of the candidates, and leverages: how far they followed the probing steps."""

    def heights(vectors: FloatArray) -> FloatArray:
        result: FloatArray = np.einsum("ij,ij->i", vectors, normals)
        return result

    residuals = np.column_stack([heights(measured - points) / levels for points in candidates])
    followed = [heights(after - points) for points, after in zip(candidates, probed, strict=True)]
    return Estimates(residuals, np.column_stack(followed) * (signs / (PROBE * levels))[:, np.newaxis])
