"""Takes noise off a mesh: as a smooth surface or as one with sharp edges, wherever it is which.

Two ways lead to a result. A low-pass filter, whose Laplacian and strength are chosen by the
data, is best for smooth surfaces. For edges and corners the normals of a more weakly filtered
mesh are filtered, many times, by means that do not reach across what noise cannot explain, and the
vertices follow. In between are fewer rounds. Stein's estimate of the risk tells what is best around each vertex.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from bezier_filters.adjacency import Adjacency
from bezier_filters.arrays import FloatArray
from bezier_filters.laplacian import Borders
from bezier_filters.low_pass import LowPass, choose_low_pass
from bezier_filters.mesh import TriangleMesh
from bezier_filters.noise_levels import noise_levels
from bezier_filters.normal_filter import NoisyNormals, filter_normals, noisy_normals
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


GENTLE_TOLERANCE, SHARP_TOLERANCE = 2.5, 1.5
"""Of `filter_normals`."""
SMOOTH_ESTIMATES = 2
"""Of the low-pass filter proper, and after a slightly weaker one; the others follow a much weaker one."""
SHARP_ROUNDS = (2, 5, 16)
"""Numbers of rounds of filtering the normals after which there is an estimate."""
UNUSED = 0.005
"""Mean share of an estimate below which the following, sharper ones are not made."""
SHARPNESS = (0.0, 0.0, 0.33, 0.67, 1.0)
"""Of the estimates, as reported."""
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
    found: list[tuple[FloatArray, FloatArray]] = []
    shares = np.ones((mesh.vertex_count, 1))
    for estimate in _estimates(mesh, adjacency, low_pass, signals, threads):
        found.append(estimate)
        report(progress, min(2 + len(found), STEPS - 1), STEPS)
        if len(found) > SMOOTH_ESTIMATES:
            errors = _errors(mesh.vertices, found, low_pass.normals, signs, levels)
            shares = local_shares(errors.rescaled(), low_pass.surroundings, threads=threads)
            if shares[:, -1].mean() < UNUSED:
                break
    result = np.einsum("nk,knc->nc", shares, np.stack([points for points, _ in found])) + center
    report(progress, STEPS, STEPS)
    return Denoised(result, shares @ np.array(SHARPNESS[: len(found)]))


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


def _estimates(
    mesh: TriangleMesh, adjacency: Adjacency, low_pass: LowPass, signals: FloatArray, threads: int
) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Estimates of the surface, ever sharper ones, each for the vertices as measured and for those moved by the probe.

    Parameters
    ----------
    mesh : TriangleMesh
        As measured.
    adjacency : Adjacency
        Of the same mesh.
    low_pass : LowPass
        What every estimate starts with, more or less of it.
    signals : (n, 3 + 3 k + 3) float64
        The vertices, samples of their noise, and steps to probe with.
    threads : int
        Number of threads.
    """
    smooth = low_pass.smoothed(signals, threads=threads)
    yield smooth[:, :3], smooth[:, :3] + smooth[:, -3:]
    gentle = _both_starts(mesh, low_pass.slightly_less_smoothed(signals, threads=threads), threads)
    gentle = [filter_normals(start, adjacency.faces, 1, GENTLE_TOLERANCE, threads=threads) for start in gentle]
    yield _both_moved(adjacency, gentle, threads)
    sharp = _both_starts(mesh, low_pass.weakly_smoothed(signals, threads=threads), threads)
    done = 0
    for rounds in SHARP_ROUNDS:
        more = rounds - done
        sharp = [filter_normals(start, adjacency.faces, more, SHARP_TOLERANCE, threads=threads) for start in sharp]
        yield _both_moved(adjacency, sharp, threads)
        done = rounds


def _both_starts(mesh: TriangleMesh, signals: FloatArray, threads: int) -> list[NoisyNormals]:
    """Normals of the filtered vertices, without and with the probing steps."""
    noise = np.ascontiguousarray(signals[:, 3:-3]).reshape(len(signals), -1, 3)
    starts = signals[:, :3].copy(), signals[:, :3] + signals[:, -3:]
    return [noisy_normals(TriangleMesh(points, mesh.faces), noise, threads=threads) for points in starts]


def _both_moved(adjacency: Adjacency, states: list[NoisyNormals], threads: int) -> tuple[FloatArray, FloatArray]:
    """Vertices that fit the normals; those at borders stay."""
    movable = ~adjacency.on_boundary
    one, other = (move_to_normals(s.mesh, adjacency, s.normals, movable, threads=threads) for s in states)
    return one, other


def _errors(
    measured: FloatArray,
    found: Sequence[tuple[FloatArray, FloatArray]],
    normals: FloatArray,
    signs: FloatArray,
    levels: FloatArray,
) -> Estimates:
    """Residuals of estimates, and leverages: how far they followed the probing steps."""

    def heights(vectors: FloatArray) -> FloatArray:
        result: FloatArray = np.einsum("ij,ij->i", vectors, normals) / levels
        return result

    residuals = [heights(measured - points) for points, _ in found]
    leverages = [heights(probed - points) * signs / PROBE for points, probed in found]
    return Estimates(np.column_stack(residuals), np.column_stack(leverages))
