"""Lines through a field of directions on a surface, evenly spaced or from seeds.

A line follows the field by the Runge-Kutta method of order 4 in space, whose every stage is projected to the surface.
Its sign is that of the last direction, so that the field needs none. Near the end of the field, of the surface, and
where the direction turns fast, steps are halved.

Evenly spaced lines grow from each other (Jobard, Lefer, "Creating evenly-spaced streamlines of arbitrary density",
1997): both sides of every point, at the given spacing, are seeds, unless a line is near; a line ends where another one
is closer than a part of the spacing.
"""

from typing import NamedTuple

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.patch_surface.blending import SurfaceArrays, X, place_on_surface
from bezier_filters.patch_surface.projection import AT_BORDER, ON_SURFACE, Places, descend, write_place
from bezier_filters.runtime.jit import inner_jit, jit
from bezier_filters.surface_lines.direction_field import write_direction
from bezier_filters.surface_lines.line_store import (
    LINE_ARC,
    LINE_COORDINATES,
    LINE_COUNT,
    LINE_NORMAL,
    LINE_STD,
    LINE_TANGENT,
    NEXT_SEED,
    NEXT_SIDE,
    POINT_COUNT,
    STEP_COUNT,
    LineStore,
    is_near_line,
    remove_points,
    store_point,
)

# outcomes of the ends of lines, see `LineEnd`
CLOSED_LINE, AT_LINE, END_OF_FIELD, END_OF_SURFACE, NO_PATCH, TOO_LONG = 0, 1, 2, 3, 4, 5
STORE_IS_FULL, MORE_TO_TRACE, ALL_TRACED = -1, 1, 0
MAX_HALVINGS = 6  # of a step
MAX_TURN = 0.94  # cosine of the largest angle between the directions at the ends of a step, 20 degrees
# of the spacing: distance of seeds from other lines, as chords are shorter than the walk to them; distance at which
# lines end; largest gap of a closed line; and least length of a line
SEED_DISTANCE, END_DISTANCE, CLOSING_GAP, LEAST_LENGTH = 0.9, 0.5, 0.1, 2.0
MAX_OFFSET = 1e-3  # of a step: distance of the surface over a face from a place there
MIN_CLOSING_STEP = 0.5  # of a step: least length of the last one of a closed line, which would turn aside if shorter
# scratch vectors: direction of the line, of a stage, sum of stages, position and normal, start of the line
ALIGNED, STAGE, STAGE_SUM, HERE, LINE_START, SCRATCH_SIZE = 0, 3, 6, 9, 15, 21


class Tracer(NamedTuple):
    """What tracing needs besides the lines; one for each thread."""

    surface: SurfaceArrays
    here: Places  # a row: the current place
    ahead: Places  # a row: a place at the end of a step or a stage
    work: FloatArray  # scratch array of the surface
    scratch: FloatArray  # (SCRATCH_SIZE,)
    field: int  # code of the field of directions
    value: float  # normal curvature, where that is given
    max_std: float  # least standard error of the angle, in radians, at which there is no direction
    step: float  # in sizes of a face
    max_step: float  # a length
    spacing: float  # 0 for lines that may cross others
    max_length: float  # of each half of a line
    is_short: BoolArray  # (m,): faces on lines that were dropped, whose middles are no seeds: they are on the same ones


@jit()
def trace_field(
    tracer: Tracer, store: LineStore, seeds: IntArray, seed_coordinates: FloatArray, fill: bool, budget: int
) -> int:
    """Trace lines from seeds, and with `fill` from both sides of all points of lines, until there is no place for more.

    Returns after a line with which it made so many steps; call it again with the same arguments unless it returns
    `ALL_TRACED`, with a larger store if it returns `STORE_IS_FULL`.
    """
    last = store.counts[STEP_COUNT] + budget
    while True:
        if store.counts[STEP_COUNT] > last:
            return MORE_TO_TRACE
        store.counts[STEP_COUNT] += 1
        if fill and store.counts[NEXT_SIDE] < 2 * store.counts[POINT_COUNT]:
            side = store.counts[NEXT_SIDE]
            is_there = _walk_aside(tracer, store, side // 2, 1.0 if side % 2 == 0 else -1.0)
            if is_there and not _trace_line(tracer, store):
                return STORE_IS_FULL
            store.counts[NEXT_SIDE] += 1
            continue
        if store.counts[NEXT_SEED] == seeds.shape[0]:
            return ALL_TRACED
        seed = store.counts[NEXT_SEED]
        f, a, b = seeds[seed], seed_coordinates[seed, 0], seed_coordinates[seed, 1]
        if not (fill and tracer.is_short[f]) and place_on_surface(tracer.surface, f, a, b, tracer.work):
            tracer.here.outcome[0] = ON_SURFACE
            write_place(tracer.surface, f, a, b, tracer.work, 0, tracer.here)
            if not _trace_line(tracer, store):
                return STORE_IS_FULL
        store.counts[NEXT_SEED] += 1


@inner_jit()
def _walk_aside(tracer: Tracer, store: LineStore, row: int, side: float) -> bool:
    """Walk from a stored point across its line by the spacing, to `tracer.here`."""
    point, scratch = store.rows[row], tracer.scratch
    f, a, b = store.faces[row], point[LINE_COORDINATES], point[LINE_COORDINATES + 1]
    for axis in range(3):
        one, two = (axis + 1) % 3, (axis + 2) % 3
        scratch[STAGE + axis] = side * (
            point[LINE_NORMAL + one] * point[LINE_TANGENT + two] - point[LINE_NORMAL + two] * point[LINE_TANGENT + one]
        )
        tracer.here.points[0, axis] = point[axis]
    tracer.here.face[0], tracer.here.coordinates[0, 0], tracer.here.coordinates[0, 1] = f, a, b
    for _ in range(2):
        if _move(tracer, tracer.here, scratch[STAGE : STAGE + 3], 0.5 * tracer.spacing) != ON_SURFACE:
            return False
        _copy_place(tracer.ahead, tracer.here)
        along = length = 0.0
        for axis in range(3):
            along += scratch[STAGE + axis] * tracer.here.normals[0, axis]
        for axis in range(3):
            scratch[STAGE + axis] -= along * tracer.here.normals[0, axis]
            length += scratch[STAGE + axis] ** 2
        for axis in range(3):
            scratch[STAGE + axis] /= np.sqrt(length)
    return _is_over_face(tracer, MAX_OFFSET * tracer.max_step)


@inner_jit()
def _trace_line(tracer: Tracer, store: LineStore) -> bool:
    """Trace a line both ways from `tracer.here`, if no other is near; returns False where the store is full."""
    here, scratch, spacing = tracer.here, tracer.scratch, tracer.spacing
    first, line = store.counts[POINT_COUNT], store.counts[LINE_COUNT]
    for axis in range(3):
        scratch[ALIGNED + axis] = 0.0
        scratch[HERE + axis], scratch[HERE + 3 + axis] = here.points[0, axis], here.normals[0, axis]
    if spacing > 0.0 and is_near_line(
        store, scratch[HERE : HERE + 6], SEED_DISTANCE * spacing, line, 0.0, np.inf, np.inf
    ):
        return True
    std = write_direction(here, tracer.field, tracer.value, scratch[ALIGNED:STAGE], scratch[ALIGNED:STAGE])
    if not std < tracer.max_std:
        return True
    if first == store.rows.shape[0]:
        return False
    _push(tracer, store, 0.0, std)
    for axis in range(3):
        scratch[LINE_START + axis], scratch[LINE_START + 3 + axis] = here.points[0, axis], scratch[ALIGNED + axis]
    store.ends[line, 0] = CLOSED_LINE
    outcome = _trace_half(tracer, store, 1.0)
    length = store.rows[store.counts[POINT_COUNT] - 1, LINE_ARC]
    if outcome != CLOSED_LINE and outcome >= 0:
        _copy_row(tracer, store, first)
        for axis in range(3):
            scratch[ALIGNED + axis] = -scratch[LINE_START + 3 + axis]
        store.ends[line, 0] = _trace_half(tracer, store, -1.0)
        length -= min(store.rows[store.counts[POINT_COUNT] - 1, LINE_ARC], 0.0)
    store.ends[line, 1] = outcome
    if outcome < 0 or store.ends[line, 0] < 0:
        remove_points(store, first)
        return False
    if store.counts[POINT_COUNT] < first + 2 or length < LEAST_LENGTH * spacing:
        for row in range(first, store.counts[POINT_COUNT]):
            tracer.is_short[store.faces[row]] = True
        remove_points(store, first)
        return True
    store.counts[LINE_COUNT] += 1
    store.starts[line + 1] = store.counts[POINT_COUNT]
    return True


@inner_jit()
def _trace_half(tracer: Tracer, store: LineStore, sign: float) -> int:
    """Follow the field from `tracer.here` on the side of the aligned direction; returns why the line ends."""
    here, scratch, spacing = tracer.here, tracer.scratch, tracer.spacing
    arc, line = 0.0, store.counts[LINE_COUNT]
    while True:
        if arc >= tracer.max_length:
            return TOO_LONG
        step = min(tracer.step * _face_size(tracer.surface, here.face[0]), tracer.max_step)
        for halving in range(MAX_HALVINGS + 1):
            store.counts[STEP_COUNT] += 1
            outcome, std = _step(tracer, step)
            if outcome == ON_SURFACE:
                break
            if halving < MAX_HALVINGS:
                step *= 0.5
        if outcome != ON_SURFACE:
            return outcome
        gap = spacing if spacing > 0.0 else 4.0 * step
        if sign > 0.0 and arc > 3.0 * gap and _passes_start(tracer, CLOSING_GAP * gap, step):
            if _distance_to_start(tracer) < MIN_CLOSING_STEP * step:
                remove_points(store, store.counts[POINT_COUNT] - 1)
            return CLOSED_LINE
        arc += step
        if spacing > 0.0:
            for axis in range(3):
                scratch[HERE + axis] = tracer.ahead.points[0, axis]
                scratch[HERE + 3 + axis] = tracer.ahead.normals[0, axis]
            home = spacing if _is_in_line_with_start(tracer, CLOSING_GAP * spacing) else 0.0
            near = END_DISTANCE * spacing
            if is_near_line(store, scratch[HERE : HERE + 6], near, line, sign * arc, 3.0 * spacing, home):
                return AT_LINE
        if store.counts[POINT_COUNT] == store.rows.shape[0]:
            return STORE_IS_FULL
        _copy_place(tracer.ahead, here)
        _push(tracer, store, sign * arc, std)


@inner_jit()
def _step(tracer: Tracer, step: float) -> tuple[int, float]:
    """Make a step from `tracer.here` to `tracer.ahead`, and write the direction there to the aligned one.

    Returns `ON_SURFACE` or why the line ends, and the standard error of the angle there.
    """
    here, ahead, scratch = tracer.here, tracer.ahead, tracer.scratch
    std, turn = 0.0, 0.0
    for axis in range(3):
        scratch[STAGE + axis] = scratch[ALIGNED + axis]
        scratch[STAGE_SUM + axis] = scratch[ALIGNED + axis]
    for stage in range(4):
        part = 0.5 if stage < 2 else 1.0
        if stage == 3:  # the weighted mean of all stages
            for axis in range(3):
                scratch[STAGE + axis] = (scratch[STAGE_SUM + axis] + scratch[STAGE + axis]) / 6.0
        outcome = _move(tracer, here if stage == 0 else ahead, scratch[STAGE : STAGE + 3], part * step)
        if outcome == AT_BORDER:
            return END_OF_SURFACE, 0.0
        if outcome != ON_SURFACE:
            return NO_PATCH, 0.0
        std = write_direction(
            ahead, tracer.field, tracer.value, scratch[ALIGNED : ALIGNED + 3], scratch[STAGE : STAGE + 3]
        )
        if not std < tracer.max_std:
            return END_OF_FIELD, 0.0
        weight = 2.0 if stage < 2 else 0.0
        for axis in range(3):
            scratch[STAGE_SUM + axis] += weight * scratch[STAGE + axis]
    for axis in range(3):
        turn += scratch[STAGE + axis] * scratch[ALIGNED + axis]
    if turn < MAX_TURN:
        return END_OF_FIELD, 0.0
    if not _is_over_face(tracer, MAX_OFFSET * step):
        return NO_PATCH, 0.0
    for axis in range(3):
        scratch[ALIGNED + axis] = scratch[STAGE + axis]
    return ON_SURFACE, std


@inner_jit()
def _move(tracer: Tracer, start: Places, direction: FloatArray, distance: float) -> int:
    """Write to `tracer.ahead` the place below the point at a distance from `tracer.here`; returns its outcome.

    The search begins at the place `start`.
    """
    surface, here, ahead, work = tracer.surface, tracer.here, tracer.ahead, tracer.work
    f, a, b, outcome = descend(
        surface,
        start.face[0],
        start.coordinates[0, 0],
        start.coordinates[0, 1],
        here.points[0, 0] + distance * direction[0],
        here.points[0, 1] + distance * direction[1],
        here.points[0, 2] + distance * direction[2],
        work,
    )
    ahead.outcome[0] = outcome
    write_place(surface, f, a, b, work, 0, ahead)
    return int(outcome)


@inner_jit()
def _is_over_face(tracer: Tracer, tolerance: float) -> bool:
    """Whether the surface over the face of `tracer.ahead` is there: the search may follow another sheet of a fold."""
    ahead, work, squared = tracer.ahead, tracer.work, 0.0
    f, a, b = ahead.face[0], ahead.coordinates[0, 0], ahead.coordinates[0, 1]
    if not place_on_surface(tracer.surface, f, a, b, work):
        return False
    for axis in range(3):
        squared += (work[X + axis] - ahead.points[0, axis]) ** 2
    return squared <= tolerance * tolerance


@inner_jit()
def _passes_start(tracer: Tracer, gap: float, step: float) -> bool:
    """Whether the step from `tracer.here` to `tracer.ahead` passes the start of the line, no farther than the gap."""
    before, after, scratch = 0.0, 0.0, tracer.scratch
    for axis in range(3):
        tangent = scratch[LINE_START + 3 + axis]
        before += (tracer.here.points[0, axis] - scratch[LINE_START + axis]) * tangent
        after += (tracer.ahead.points[0, axis] - scratch[LINE_START + axis]) * tangent
    return before <= 0.0 < after and before > -2.0 * step and _is_in_line_with_start(tracer, gap)


@inner_jit()
def _distance_to_start(tracer: Tracer) -> float:
    """Distance of `tracer.here` from the start of the line."""
    squared = 0.0
    for axis in range(3):
        squared += (tracer.here.points[0, axis] - tracer.scratch[LINE_START + axis]) ** 2
    return float(np.sqrt(squared))


@inner_jit()
def _is_in_line_with_start(tracer: Tracer, gap: float) -> bool:
    """Whether the line through `tracer.ahead` passes the start of the line in its direction, no farther than the gap.

    The line is continued as a circle with the tangents there and at the start.
    """
    scratch, squared, turn = tracer.scratch, 0.0, 0.0
    for axis in range(3):
        turn += scratch[ALIGNED + axis] * scratch[LINE_START + 3 + axis]
    if turn < MAX_TURN:
        return False
    along = 0.0
    for axis in range(3):
        mean = 0.5 * (scratch[ALIGNED + axis] + scratch[LINE_START + 3 + axis])
        along += mean * (tracer.ahead.points[0, axis] - scratch[LINE_START + axis])
    for axis in range(3):
        mean = 0.5 * (scratch[ALIGNED + axis] + scratch[LINE_START + 3 + axis])
        offset = tracer.ahead.points[0, axis] - scratch[LINE_START + axis] - along * mean
        squared += offset * offset
    return squared < gap * gap


@inner_jit()
def _face_size(surface: SurfaceArrays, f: int) -> float:
    """Mean edge of a face."""
    total = 0.0
    for corner in range(3):
        squared = 0.0
        for axis in range(3):
            first = surface.vertices[surface.faces[f, corner], axis]
            squared += (surface.vertices[surface.faces[f, (corner + 1) % 3], axis] - first) ** 2
        total += np.sqrt(squared)
    return float(total / 3.0)


@inner_jit()
def _copy_place(source: Places, target: Places) -> None:
    """Copy face, coordinates, position and normal."""
    target.face[0] = source.face[0]
    target.coordinates[0, 0], target.coordinates[0, 1] = source.coordinates[0, 0], source.coordinates[0, 1]
    target.curvatures[0, 0], target.curvatures[0, 1] = source.curvatures[0, 0], source.curvatures[0, 1]
    for column in range(source.errors.shape[1]):
        target.errors[0, column] = source.errors[0, column]
    for axis in range(3):
        target.points[0, axis], target.normals[0, axis] = source.points[0, axis], source.normals[0, axis]
        for kind in range(2):
            target.directions[0, kind, axis] = source.directions[0, kind, axis]


@inner_jit()
def _copy_row(tracer: Tracer, store: LineStore, row: int) -> None:
    """Go back to a stored point."""
    here = tracer.here
    here.face[0] = store.faces[row]
    here.coordinates[0, 0], here.coordinates[0, 1] = (
        store.rows[row, LINE_COORDINATES],
        store.rows[row, LINE_COORDINATES + 1],
    )
    for axis in range(3):
        here.points[0, axis], here.normals[0, axis] = store.rows[row, axis], store.rows[row, LINE_NORMAL + axis]


@inner_jit()
def _push(tracer: Tracer, store: LineStore, arc: float, std: float) -> None:
    """Store the place `tracer.here` as the next point of the line."""
    here, row = tracer.here, store.counts[POINT_COUNT]
    for axis in range(3):
        store.rows[row, axis], store.rows[row, LINE_NORMAL + axis] = here.points[0, axis], here.normals[0, axis]
        store.rows[row, LINE_TANGENT + axis] = tracer.scratch[ALIGNED + axis]
    store.rows[row, LINE_COORDINATES], store.rows[row, LINE_COORDINATES + 1] = (
        here.coordinates[0, 0],
        here.coordinates[0, 1],
    )
    store.rows[row, LINE_ARC], store.rows[row, LINE_STD] = arc, std
    store.faces[row], store.line[row] = here.face[0], store.counts[LINE_COUNT]
    store_point(store, row)
