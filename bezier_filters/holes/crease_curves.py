"""Creases continued through a hole: which ends belong together, and the curves between them."""

from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from itertools import combinations

import numpy as np

from bezier_filters.arrays import FloatArray
from bezier_filters.holes.implicit_surface import ImplicitSurface
from bezier_filters.holes.rim_creases import CreaseEnd

STEPS = 12
STEPS_TO_CORNER = 60
WEAKEST = 0.15
"""Least share of the strongest direction in which surfaces determine their intersection."""
LARGEST_BEND = 12.0
"""Bending energy of a curve over a unit chord, from which on its ends do not belong together: half a circle has 10."""
LARGEST_LEG_BEND = 0.5
"""The same of a curve to a corner: it turns by some 20 degrees."""
ENERGY_OF_GROUP = 0.5
"""What another group must save: ends of which all meet in a point do not meet there in twos and threes."""
MOST_ENDS = 8
"""Up to which every group of ends may meet in a corner."""


def groupings(ends: Sequence[CreaseEnd], points: FloatArray) -> list[list[tuple[int, ...]]]:
    """Ways to join the ends of creases, the best first: pairs that one curve joins, and more that meet in a corner.

    As few ends as possible are left over, and then the curves bend as little as possible. They do not cross. Corners of
    more than three are those where the creases go; three that are all there are always meet in one.

    Parameters
    ----------
    ends : sequence of CreaseEnd
        In the order of the rim.
    points : (k, 3) float64
        Where they are.

    Returns
    -------
    list of list of tuple
        Numbers of the ends that belong together; ends that are missing end in the hole.
    """
    count = len(ends)
    pairs: dict[tuple[int, ...], float] = {
        (i, j): _energy(ends, points, i, j) for i, j in combinations(range(count), 2)
    }
    tangents = np.array([end.tangent for end in ends]).reshape(-1, 3)
    corners = {group: _corner_energy(points, tangents, list(group)) for group in _possible_corners(count)}
    if count == 3:
        corners[0, 1, 2] = min(corners[0, 1, 2], LARGEST_BEND)
    result: list[list[tuple[int, ...]]] = []
    for found in (_partition(count, pairs | corners), _partition(count, pairs)):
        if found and found not in result:
            result.append(found)
    return result


def _possible_corners(count: int) -> Iterator[tuple[int, ...]]:
    """Groups of three or more of some ends; where there are many ends, only all of them."""
    sizes = range(3, count + 1) if count <= MOST_ENDS else range(count, count + 1)
    for size in sizes:
        yield from combinations(range(count), size)


def _energy(ends: Sequence[CreaseEnd], points: FloatArray, i: int, j: int) -> float:
    """Bending energy of the curve between two ends; infinite between ridge and valley, or if it bends too far."""
    if ends[i].is_convex != ends[j].is_convex:
        return float("inf")
    energy = bending_energy(points[i], ends[i].tangent, points[j], -ends[j].tangent)
    return energy if energy < LARGEST_BEND else float("inf")


def _corner_energy(points: FloatArray, tangents: FloatArray, group: list[int]) -> float:
    """Bending energies of the curves from some ends to the point nearest to their lines; infinite if one bends far."""
    starts, along = points[group], tangents[group]
    across = np.eye(3) - along[:, :, np.newaxis] * along[:, np.newaxis, :]
    corner = np.linalg.lstsq(across.sum(axis=0), np.einsum("kij,kj->i", across, starts), rcond=1e-6)[0]
    chords = corner - starts
    lengths = np.linalg.norm(chords, axis=1, keepdims=True)
    if not (lengths > 0.0).all():
        return float("inf")
    energies = [bending_energy(s, t, corner, c) for s, t, c in zip(starts, along, chords / lengths, strict=True)]
    return sum(energies) if max(energies) < LARGEST_LEG_BEND else float("inf")


def bending_energy(start: FloatArray, start_tangent: FloatArray, stop: FloatArray, stop_tangent: FloatArray) -> float:
    """Integral of the squared second derivative of the cubic curve over a unit chord; about the squared angle it turns.

    Examples
    --------
    >>> right = np.array([1.0, 0.0, 0.0])
    >>> bending_energy(0 * right, right, 5 * right, right)
    0.0
    """
    length = float(np.linalg.norm(stop - start))
    if not length > 0.0:
        return float("inf")
    chord = (stop - start) / length
    a = 6.0 * chord - 4.0 * start_tangent - 2.0 * stop_tangent
    b = -6.0 * chord + 2.0 * start_tangent + 4.0 * stop_tangent
    return float(a @ a + a @ b + b @ b) / 3.0


def _partition(count: int, energies: Mapping[tuple[int, ...], float]) -> list[tuple[int, ...]]:
    """Groups that do not cross, with as few ends left over as possible, and then with the least energy."""

    @cache
    def best(first: int, stop: int) -> tuple[int, float, tuple[tuple[int, ...], ...]]:
        if stop - first < 2:
            return max(stop - first, 0), 0.0, ()
        rest = best(first + 1, stop)
        options = [(rest[0] + 1, rest[1], rest[2])]
        for group, energy in energies.items():
            if group[0] == first and group[-1] < stop and energy < float("inf"):
                between = [best(a + 1, b) for a, b in zip(group, (*group[1:], stop), strict=True)]
                found = (group, *(part for option in between for part in option[2]))
                options.append(
                    (sum(o[0] for o in between), ENERGY_OF_GROUP + energy + sum(o[1] for o in between), found)
                )
        return min(options, key=lambda option: option[:2])

    return list(best(0, count)[2])


def corner_of(
    points: FloatArray, tangents: FloatArray, surfaces: Sequence[ImplicitSurface], tolerance: float
) -> FloatArray:
    """The point with the least sum of distances to lines through points (k, 3) along tangents, and to surfaces.

    Sums of distances, not of squares: a crease that bends on its way, or a surface that is continued badly, does not
    pull the corner away from where the others meet. Found by least squares with weights from the distances.
    """
    across = np.eye(3) - tangents[:, :, np.newaxis] * tangents[:, np.newaxis, :]
    corner = points.mean(axis=0)
    line_weights, surface_weights = np.ones(len(points)), np.zeros(len(surfaces))
    for _ in range(STEPS_TO_CORNER):
        values, gradients = _values(surfaces, corner[np.newaxis])
        values, gradients = values[0], gradients[0]
        system = 1e-6 * np.eye(3) + np.einsum("k,kij->ij", line_weights, across)
        system += np.einsum("k,ki,kj->ij", surface_weights, gradients, gradients)
        target = np.einsum("k,kij,kj->i", line_weights, across, points - corner)
        target -= np.einsum("k,k,ki->i", surface_weights, values, gradients)
        corner = corner + np.linalg.solve(system, target)
        distances = np.linalg.norm(np.einsum("kij,kj->ki", across, points - corner), axis=1)
        line_weights = 1.0 / np.maximum(distances, tolerance)
        surface_weights = 1.0 / np.maximum(np.abs(_values(surfaces, corner[np.newaxis])[0][0]), tolerance)
    return np.asarray(corner, dtype=np.float64)


def _values(surfaces: Sequence[ImplicitSurface], points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Values (n, k) and gradients (n, k, 3) of k surfaces."""
    found = [surface.values_and_gradients(points) for surface in surfaces]
    values = np.array([value for value, _ in found]).reshape(len(surfaces), len(points))
    gradients = np.array([gradient for _, gradient in found]).reshape(len(surfaces), len(points), 3)
    return values.T, gradients.swapaxes(0, 1)


def hermite_curve(
    start: FloatArray, start_tangent: FloatArray, stop: FloatArray, stop_tangent: FloatArray, edge: float
) -> FloatArray:
    """Points inside a cubic curve about one edge apart, (k, 3); tangents are unit vectors along the curve."""
    length = float(np.linalg.norm(stop - start))
    t = np.linspace(0.0, 1.0, 200)[:, np.newaxis]
    curve = (
        (1 + 2 * t) * (1 - t) ** 2 * start
        + t * (1 - t) ** 2 * length * start_tangent
        + t**2 * (3 - 2 * t) * stop
        - t**2 * (1 - t) * length * stop_tangent
    )
    return evenly_spaced(curve, edge)


def evenly_spaced(curve: FloatArray, edge: float) -> FloatArray:
    """Points inside a polyline (n, 3) about one edge apart, without its ends."""
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))])
    count = max(round(float(lengths[-1]) / edge), 1)
    at = np.linspace(0.0, lengths[-1], count + 1)[1:-1]
    return np.stack([np.interp(at, lengths, curve[:, k]) for k in range(3)], axis=1)


def onto_intersection(points: FloatArray, surfaces: Sequence[ImplicitSurface], limit: float) -> FloatArray:
    """Move points (n, 3) to where all surfaces are zero, by Newton's method with the shortest steps.

    Points that would go farther than a limit stay where they are; so they do in directions that surfaces
    nearly tangent to each other do not determine.
    """
    result = points.copy()
    for _ in range(STEPS):
        values, gradients = _values(surfaces, result)
        steps = np.einsum("nij,nj->ni", np.linalg.pinv(gradients, rcond=WEAKEST), values)
        lengths = np.linalg.norm(steps, axis=1, keepdims=True)
        result = result - steps * np.minimum(1.0, 0.2 * limit / np.maximum(lengths, 1e-300))
    moved = np.linalg.norm(result - points, axis=1) <= limit
    return np.where((moved & np.isfinite(result).all(axis=1))[:, np.newaxis], result, points)
