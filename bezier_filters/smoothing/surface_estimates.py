"""Estimates of the surface under the noise, from smooth to sharp.

The first is a low-pass filter. For edges and corners the normals of a more weakly filtered mesh are
filtered, many times, by means that do not reach across what noise cannot explain, and the
vertices follow. In between are fewer rounds.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from bezier_filters.arrays import SingleArray
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.smoothing.chebyshev import WIDTH
from bezier_filters.smoothing.low_pass import LowPass
from bezier_filters.smoothing.low_pass_runs import PointsAndSigns
from bezier_filters.smoothing.normal_filter import NoisyNormals, filter_normals, noisy_normals
from bezier_filters.smoothing.pieces import Arrays, Domain, Draw, Handle, Outcome, Piece
from bezier_filters.smoothing.vertex_update import TERMS as UPDATE_STEPS
from bezier_filters.smoothing.vertex_update import move_to_normals

SMOOTH, GENTLE = 0, 1
"""Kinds of estimates: the low-pass filter proper, and one round after a slightly weaker one; then the sharp ones."""
SHARP_ROUNDS = (2, 5, 16)
"""Numbers of rounds of filtering the normals, after a much weaker filter, at which there are estimates."""
KINDS = range(2 + len(SHARP_ROUNDS))
GENTLE_TOLERANCE, SHARP_TOLERANCE = 2.5, 1.5
"""Of `filter_normals`."""
PROBE = 0.1
"""Times sigma: how far vertices are moved to find their leverages."""
FEWEST_SAMPLED = 60_000
"""Vertices times samples of the noise, that normals are filtered by."""
ROUND_RINGS = 3
"""That a round of `filter_normals` looks around a face."""


class Estimate(NamedTuple):
    """An estimate of the surface, as a mesh on the same vertices."""

    kind: int
    """Which one it is."""
    values: Handle
    """How far each vertex moves, "moves" (n, 3); heights of the measured vertices over it, times the standard deviation
    of the noise, "residuals" (n,); and how far it follows each vertex, "leverages" (n,)."""


def surface_estimates(domain: Domain, low_pass: LowPass, levels: Handle, kinds: frozenset[int]) -> Iterator[Estimate]:
    """Estimates, ever sharper ones, of which the first is the low-pass filter's.

    Parameters
    ----------
    domain : Domain
        The mesh as measured.
    low_pass : LowPass
        What every estimate starts with, more or less of it.
    levels : Handle
        "levels" (n,), the standard deviation of the noise around every vertex.
    kinds : frozenset of int
        Those that are wanted besides the first.
    """
    signs = domain.drawn(Draw("choices", 1))
    taken = low_pass.takes_off(domain, PointsAndSigns(), signs=signs)
    found = domain.run(SmoothEstimate(), smooth=taken, signs=signs, mixture=low_pass.mixture)
    domain.free(taken)
    yield Estimate(SMOOTH, found.vertices)
    wanted = sorted(kinds - {SMOOTH})
    if not wanted:
        return
    count = int(np.clip(FEWEST_SAMPLED // domain.vertex_count, 2, 6))
    inputs = {"levels": levels, "shape": low_pass.shape, "signs": signs}
    inputs["heights"] = domain.drawn(Draw("normal32", 2, count))
    if GENTLE in kinds:
        start = _start(domain, low_pass.weaker(domain), count, inputs)
        yield Estimate(GENTLE, domain.run(FilteredNormals(1, GENTLE_TOLERANCE), **inputs, **start).vertices)
        domain.free(*start.values())
    if wanted[-1] == GENTLE:
        return
    start = _start(domain, low_pass.weak(), count, inputs)
    for kind, rounds in enumerate(SHARP_ROUNDS, start=GENTLE + 1):
        if kind in kinds:
            found = domain.run(FilteredNormals(rounds, SHARP_TOLERANCE), **inputs, **start)
            yield Estimate(kind, found.vertices)
    domain.free(*start.values())


@dataclass(frozen=True)
class SmoothEstimate:
    """The low-pass filter's."""

    rings: int = 0

    def __call__(self, piece: Piece, inputs: Mapping[str, Arrays]) -> Outcome:
        """See `Estimate`."""
        vertices, taken, signs = piece.mesh.vertices, inputs["smooth"]["taken"], inputs["signs"]["drawn"]
        moves = ((vertices - taken[:, :3]) - vertices).astype(np.float32)
        leverages = (signs * (signs.astype(np.float64) - taken[:, 3])).astype(np.float32)
        return Outcome(vertices={"moves": moves, "residuals": inputs["mixture"]["residuals"], "leverages": leverages})


@dataclass(frozen=True)
class NoiseSamples:
    """Four of the coordinates of samples of the noise along the normals; the first sample is that of the probe."""

    first: int

    def __call__(self, piece: Piece, inputs: Mapping[str, Arrays]) -> SingleArray:
        """Signals (n, 4)."""
        samples = noise_samples(inputs)[:, self.first : self.first + WIDTH]
        result = np.zeros((len(samples), WIDTH), dtype=np.float32)
        result[:, : samples.shape[1]] = samples
        return result


def noise_samples(inputs: Mapping[str, Arrays]) -> SingleArray:
    """Coordinates of all samples of the noise, (n, 3 samples)."""
    heights = inputs["heights"]["drawn"].copy()
    heights[:, 0] = inputs["signs"]["drawn"]
    heights *= inputs["levels"]["levels"].astype(np.float32)[:, np.newaxis]
    normals = inputs["shape"]["normals"].astype(np.float32)
    vectors: SingleArray = heights[:, :, np.newaxis] * normals[:, np.newaxis]
    return vectors.reshape(len(vectors), -1)


def _start(domain: Domain, low_pass: LowPass, samples: int, inputs: Mapping[str, Handle]) -> dict[str, Handle]:
    """What a filter takes off vertices and samples of the noise, four columns each."""
    found = {"points": low_pass.takes_off(domain, PointsAndSigns())}
    for k, first in enumerate(range(0, 3 * samples, WIDTH)):
        found[f"noise{k}"] = low_pass.takes_off(domain, NoiseSamples(first), **inputs)
    return found


@dataclass(frozen=True)
class FilteredNormals:
    """Vertices that follow filtered normals, after a low-pass filter."""

    rounds: int
    tolerance: float

    @property
    def rings(self) -> int:
        """Those of the rounds, and of the vertices that follow."""
        return ROUND_RINGS * self.rounds + UPDATE_STEPS + 2

    def __call__(self, piece: Piece, inputs: Mapping[str, Arrays]) -> Outcome:
        """See `Estimate`."""
        mesh, levels, signs = piece.mesh, inputs["levels"]["levels"], inputs["signs"]["drawn"]
        normals = inputs["shape"]["normals"].astype(np.float32)
        start = ((mesh.vertices - inputs["points"]["taken"][:, :3]) - mesh.vertices).astype(np.float32)
        probe, state = self._filtered(piece, inputs, start)
        movable = ~piece.adjacency.on_boundary  # those at borders stay

        def follow(start: SingleArray, goal: SingleArray) -> SingleArray:
            moves = move_to_normals(_moved(mesh, start), piece.adjacency, goal, movable, threads=piece.threads)
            moves += start
            return moves

        moved = follow(start, state.normals)
        probed = follow(start + probe, state.probed_normals)
        residuals = -np.einsum("ij,ij->i", moved, normals) / levels
        leverages = np.einsum("ij,ij->i", probed - moved, normals) * signs / (PROBE * levels)
        return Outcome(
            vertices={
                "moves": moved,
                "residuals": residuals.astype(np.float32),
                "leverages": leverages.astype(np.float32),
            }
        )

    def _filtered(
        self, piece: Piece, inputs: Mapping[str, Arrays], start: SingleArray
    ) -> tuple[SingleArray, NoisyNormals]:
        """The probing steps and the normals after all rounds, going on from an earlier stage if that was kept."""
        key = f"normals {self.tolerance}"
        if key not in piece.kept:
            piece.forget()  # this is the hungriest part
            noise = noise_samples(inputs)
            for name, values in inputs.items():
                if name.startswith("noise"):
                    columns = noise[:, WIDTH * int(name.removeprefix("noise")) :][:, :WIDTH]
                    columns -= values["taken"][:, : columns.shape[1]]
            noise = noise.reshape(len(noise), -1, 3)
            probe = np.float32(PROBE) * noise[:, 0]
            both = _moved(piece.mesh, start), _moved(piece.mesh, start + probe)
            piece.kept[key] = 0, probe, noisy_normals(*both, noise, threads=piece.threads)
        done, probe, state = piece.kept.pop(key)
        state = filter_normals(state, piece.adjacency.faces, self.rounds - done, self.tolerance, threads=piece.threads)
        piece.kept[key] = self.rounds, probe, state
        return probe, state


def _moved(mesh: TriangleMesh, moves: SingleArray) -> TriangleMesh:
    return TriangleMesh(mesh.vertices + moves, mesh.faces)
