"""Low-pass filters on a mesh, some steps at a time.

A step looks one ring further around every vertex. What is far away comes in by and by: after some steps a
stage leaves where it is, and the next one goes on from there.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from bezier_filters.arrays import FloatArray, RealArray, SingleArray
from bezier_filters.smoothing.chebyshev import WIDTH, Recurrence, add_heights, add_mixtures, differences
from bezier_filters.smoothing.laplacian import LaplacianRule
from bezier_filters.smoothing.pieces import Arrays, Domain, Draw, Handle, Outcome, Piece
from bezier_filters.smoothing.scale_space import ORDER, series

FEW = 20_000
"""Vertices; on smaller meshes, leverages are averaged over more probes."""


@dataclass(frozen=True)
class LargestRate:
    """The rate of the fastest vertex, which every series has to bear with."""

    rule: LaplacianRule
    rings: int = 2

    def __call__(self, piece: Piece, inputs: Mapping[str, Arrays]) -> Outcome:
        """Rates (n,)."""
        return Outcome(largest={"rate": laplacian_of(piece, self.rule, inputs).rates})


def bounded(domain: Domain, rule: LaplacianRule, **shape: Handle) -> LaplacianRule:
    """The rule with the largest rate on a mesh, or on one with the same faces and another shape."""
    largest = domain.run(LargestRate(rule), **shape).largest["rate"]
    return replace(rule, largest_rate=max(largest, 0.0))


def laplacian_of(piece: Piece, rule: LaplacianRule, inputs: Mapping[str, Arrays]) -> Any:
    """The Laplacian of a piece by a rule; cotangents are those of the values "shape", if there are any."""
    with_shape = rule.power is not None and "shape" in inputs
    return piece.laplacian(rule, inputs["shape"]["shape"] if with_shape else None)


class Signals(Protocol):
    """What is filtered: four columns that are functions of other values."""

    def __call__(self, piece: Piece, inputs: Mapping[str, Arrays]) -> RealArray:
        """Signals (n, 4)."""


@dataclass(frozen=True)
class Steps:
    """Steps of the recurrence, and what to start from.

    Attributes
    ----------
    rule : LaplacianRule
    rows : (terms, s) float64
        The terms of the series that belong to these steps.
    first : int
        Number of the first of them; 0 begins with the differences.
    signals : Signals
        What is filtered.
    """

    rule: LaplacianRule
    rows: FloatArray
    first: int
    signals: Signals

    @property
    def rings(self) -> int:
        """One for every step, one for the differences."""
        return len(self.rows) + 1

    def start(self, piece: Piece, inputs: Mapping[str, Arrays]) -> tuple[Any, Recurrence]:
        """The Laplacian, and the state to go on from."""
        laplacian = laplacian_of(piece, self.rule, inputs)
        if self.first == 0:
            return laplacian, differences(laplacian, self.signals(piece, inputs), threads=piece.threads)
        state = inputs["state"]
        return laplacian, Recurrence(state["before"], state["current"], self.first)


def in_stages(
    domain: Domain, make: Any, rule: LaplacianRule, rows: FloatArray, signals: Signals, **inputs: Handle
) -> Handle:
    """Run all the terms of a series, as many at a time as the domain allows."""
    state: dict[str, Handle] = {}
    for first in range(0, len(rows), min(domain.steps, len(rows))):
        some = rows[first : first + domain.steps]
        found = domain.run(make(Steps(rule, some, first, signals), first + len(some) == len(rows)), **inputs, **state)
        domain.free(*state.values())
        state = {"state": found.vertices}
    return state["state"]


def _state(state: Recurrence, is_last: bool) -> dict[str, NDArray[Any]]:
    return {} if is_last else {"before": state.before, "current": state.current}


@dataclass(frozen=True)
class Mixing:
    """Adds up what filters take off, mixed by shares."""

    steps: Steps
    is_last: bool

    @property
    def rings(self) -> int:
        """Those of the steps."""
        return self.steps.rings

    def __call__(self, piece: Piece, inputs: Mapping[str, Arrays]) -> Outcome:
        """What is taken off the signals so far, (n, 4)."""
        laplacian, state = self.steps.start(piece, inputs)
        shares = inputs["shares"]["shares"] if "shares" in inputs else np.ones((len(state.current), 1), np.float32)
        taken = inputs["state"]["taken"] if self.steps.first else np.zeros_like(state.current)
        state = add_mixtures(laplacian, state, self.steps.rows, shares, taken, threads=piece.threads)
        return Outcome(vertices={"taken": taken} | _state(state, self.is_last))


@dataclass(frozen=True)
class Measuring:
    """Adds up heights over what filters make of the vertices, and leverages by a random sign at each."""

    steps: Steps
    is_last: bool
    probes: int = 1
    """Random signs at each vertex, of which the first one goes with the coordinates."""

    @property
    def rings(self) -> int:
        """Those of the steps."""
        return self.steps.rings

    def __call__(self, piece: Piece, inputs: Mapping[str, Arrays]) -> Outcome:
        """Residuals and what is taken off the probes so far, or leverages in the end, (n, s)."""
        laplacian, state = self.steps.start(piece, inputs)
        if "more" in inputs:
            directions = inputs["more"]["drawn"]
        else:
            directions = np.empty((len(state.current), WIDTH), dtype=np.float32)
            directions[:, :3] = inputs["surface"]["normals"] / inputs["levels"]["levels"][:, np.newaxis]
            directions[:, 3] = inputs["signs"]["drawn"]
        if self.steps.first:
            residuals, taken = inputs["state"]["residuals"], inputs["state"]["taken"]
        elif "more" in inputs:
            taken = inputs["one"]["taken"].copy()
            residuals = inputs["one"]["residuals"]
        else:
            residuals, taken = np.zeros((2, len(directions), self.steps.rows.shape[1]), dtype=np.float32)
        heights = taken if "more" in inputs else residuals
        state = add_heights(laplacian, state, self.steps.rows, directions, heights, taken, threads=piece.threads)
        found = {"residuals": residuals, "taken": taken} | _state(state, self.is_last)
        return Outcome(vertices=found)


@dataclass(frozen=True)
class Leverages:
    """The estimates of Stein's risk, from what is taken off probes."""

    probes: int
    rings: int = 0

    def __call__(self, piece: Piece, inputs: Mapping[str, Arrays]) -> Outcome:
        """Residuals and leverages (n, s), see `Estimates`."""
        found = inputs["found"]
        leverages = np.float32(1.0) - found["taken"] / np.float32(self.probes)
        return Outcome(vertices={"residuals": found["residuals"], "leverages": leverages})


@dataclass(frozen=True)
class PointsAndSigns:
    """Coordinates, and a random sign at every vertex, or nothing."""

    def __call__(self, piece: Piece, inputs: Mapping[str, Arrays]) -> FloatArray:
        """Signals (n, 4)."""
        result = np.zeros((piece.mesh.vertex_count, WIDTH))
        result[:, :3] = piece.mesh.vertices
        if "signs" in inputs:
            result[:, 3] = inputs["signs"]["drawn"]
        return result


@dataclass(frozen=True)
class MoreSigns:
    """Random signs alone."""

    def __call__(self, piece: Piece, inputs: Mapping[str, Arrays]) -> SingleArray:
        """Signals (n, 4)."""
        result: SingleArray = inputs["more"]["drawn"]
        return result


def estimates_by(domain: Domain, rule: LaplacianRule, order: int, strengths: FloatArray, **inputs: Handle) -> Handle:
    """Residuals and leverages, (n, s), of filters; a leverage is the mean of sign times filtered sign.

    Parameters
    ----------
    domain : Domain
    rule : LaplacianRule
        Of the filters.
    order : int
        Of the filters.
    strengths : (s,) float64
        Of the filters.
    **inputs : Handle
        The values "normals" of `surface` and "levels" of `levels`; "shape" of `shape`, if the rule needs it.
    """
    rows = series(strengths, _bound(rule), order)
    signs = domain.drawn(Draw("signs", 0))
    found = in_stages(domain, Measuring, rule, rows, PointsAndSigns(), signs=signs, **inputs)
    probes = 1
    if domain.vertex_count <= FEW:
        more = domain.drawn(Draw("signs", 0, WIDTH, skipped=1))
        shape = {"shape": inputs["shape"]} if "shape" in inputs else {}
        found = in_stages(domain, Measuring, rule, rows, MoreSigns(), more=more, one=found, **shape)
        probes += WIDTH
    return domain.run(Leverages(probes), found=found).vertices


def taken_by(
    domain: Domain,
    rule: LaplacianRule,
    strengths: FloatArray,
    signals: Signals,
    order: int = ORDER,
    **inputs: Handle,
) -> Handle:
    """What a mixture of filters takes off signals, "taken" (n, 4).

    Mixed by the values "shares" (n, s) of `shares`; without them there is only one filter.
    """
    return in_stages(domain, Mixing, rule, series(strengths, _bound(rule), order), signals, **inputs)


def _bound(rule: LaplacianRule) -> float:
    assert rule.largest_rate is not None
    return 2.0 * max(rule.largest_rate, 0.5)
