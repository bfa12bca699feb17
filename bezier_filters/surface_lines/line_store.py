"""Points of traced lines in arrays of fixed capacity, found by a hash grid over space."""

from typing import NamedTuple

import numpy as np

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.runtime.jit import inner_jit

# entries of `LineStore.counts`
POINT_COUNT, LINE_COUNT, NEXT_SIDE, NEXT_SEED, STEP_COUNT, COUNTS = 0, 1, 2, 3, 4, 5
# columns of `LineStore.rows`
LINE_POINT, LINE_NORMAL, LINE_TANGENT, LINE_COORDINATES, LINE_ARC, LINE_STD, LINE_ROW = 0, 3, 6, 9, 11, 12, 13
GRID_CELLS = 1 << 16  # hash values; cells with the same one only cost comparisons


class LineStore(NamedTuple):
    """Points of lines: those of a line are adjacent, from its seed forward, and then from its seed backward."""

    rows: FloatArray  # (c, 13): position, normal, tangent, barycentric coordinates, arc length from the seed, error
    faces: IntArray  # (c,)
    line: IntArray  # (c,): number of the line
    following: IntArray  # (c,): next point of the same hash value, -1 at the end
    heads: IntArray  # (GRID_CELLS,): last point that was added with each hash value
    starts: IntArray  # (l + 1,): first point of each line
    ends: IntArray  # (l, 2): outcomes of the backward and the forward part
    counts: IntArray  # (5,): points, lines, sides of points and seeds that were visited, and steps along lines
    cell: float  # edge of a cell of the grid


def line_store(capacity: int, cell: float) -> LineStore:
    """Room for points; the grid is for distances up to `cell`."""
    return LineStore(
        np.zeros((capacity, LINE_ROW)),
        np.zeros(capacity, np.int32),
        np.zeros(capacity, np.int32),
        np.zeros(capacity, np.int32),
        np.full(GRID_CELLS, -1, np.int32),
        np.zeros(capacity + 1, np.int32),
        np.zeros((capacity, 2), np.int32),
        np.zeros(COUNTS, np.int64),
        cell,
    )


def enlarge_store(store: LineStore) -> LineStore:
    """The same lines with room for twice the points."""
    larger = line_store(2 * len(store.rows), store.cell)
    larger.counts[:], larger.heads[:] = store.counts, store.heads
    for name in ("rows", "faces", "line", "following", "starts", "ends"):
        old = getattr(store, name)
        getattr(larger, name)[: len(old)] = old
    return larger


@inner_jit()
def store_point(store: LineStore, row: int) -> None:
    """Add the point in a row of the store to its grid and to the count."""
    key = _hash(store, store.rows[row, LINE_POINT], store.rows[row, LINE_POINT + 1], store.rows[row, LINE_POINT + 2])
    store.following[row] = store.heads[key]
    store.heads[key] = row
    store.counts[POINT_COUNT] = row + 1


@inner_jit()
def remove_points(store: LineStore, first: int) -> None:
    """Remove all points from a row on."""
    for row in range(store.counts[POINT_COUNT] - 1, first - 1, -1):
        key = _hash(
            store, store.rows[row, LINE_POINT], store.rows[row, LINE_POINT + 1], store.rows[row, LINE_POINT + 2]
        )
        store.heads[key] = store.following[row]
    store.counts[POINT_COUNT] = first


@inner_jit()
def is_near_line(
    store: LineStore, place: FloatArray, distance: float, line: int, arc: float, skip: float, home: float
) -> bool:
    """Whether a point of a line on the same side of the surface is closer than a distance, at most a cell.

    `place` holds position and normal (6,). Points of the given line count where their arc length differs by more than
    `skip` and is at least `home` in absolute value.
    """
    for i in range(-1, 2):
        for j in range(-1, 2):
            for k in range(-1, 2):
                x, y, z = place[0] + i * store.cell, place[1] + j * store.cell, place[2] + k * store.cell
                row = store.heads[_hash(store, x, y, z)]
                while row >= 0:
                    squared = aligned = 0.0
                    for axis in range(3):
                        squared += (store.rows[row, LINE_POINT + axis] - place[axis]) ** 2
                        aligned += store.rows[row, LINE_NORMAL + axis] * place[3 + axis]
                    if squared < distance * distance and aligned > 0.0:
                        there = store.rows[row, LINE_ARC]
                        if store.line[row] != line or (abs(there - arc) > skip and abs(there) >= home):
                            return True
                    row = store.following[row]
    return False


@inner_jit()
def _hash(store: LineStore, x: float, y: float, z: float) -> int:
    """Hash value of the cell that contains a point."""
    i, j, k = int(np.floor(x / store.cell)), int(np.floor(y / store.cell)), int(np.floor(z / store.cell))
    return int((i * 73856093 ^ j * 19349663 ^ k * 83492791) & (GRID_CELLS - 1))
