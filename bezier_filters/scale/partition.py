"""Sorts a mesh on disk in space and cuts it into blocks, without ever holding it in memory.

The order is that of `spatial_order`, which meshes in memory are sorted by, too: each tile then sees its vertices
and faces in the same order as there, and its sums are the same to the last digit.
"""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bezier_filters.arrays import IntArray
from bezier_filters.errors import InvalidMeshError
from bezier_filters.meshes.mesh import triangle_mesh
from bezier_filters.meshes.spatial_order import Grid, grid_around, widen_bounds
from bezier_filters.runtime.jit import jit
from bezier_filters.runtime.parallel import Progress, report, run_kernel
from bezier_filters.scale.array_file import ArrayFile, new_array_file
from bezier_filters.scale.source import MeshSource
from bezier_filters.scale.store import FACE_PTR, FACES, ORDER, RANK, VERTICES, Layout, Store, open_store, write_manifest

ROWS = 1 << 20  # vertices or faces that are held at a time
LARGEST_BLOCK_BITS = 10  # of the number of vertices in a block: sampled neighbourhoods and halos read whole blocks


def build_store(
    source: MeshSource, folder: Path, tile_vertices: int, *, threads: int = 1, progress: Progress | None = None
) -> Store:
    """Make a mesh ready for tiles, in an empty folder; refused if a coordinate is not finite, or a face no triangle."""
    n, m = source.vertex_count, source.face_count
    passes = _Passes(2 * n + m, progress)
    bits = min(LARGEST_BLOCK_BITS, int(math.log2(tile_vertices)))
    grid = _grid(source, passes)
    low = tuple(float(x) for x in grid.low)
    layout = Layout(n, m, source.dtype.str, bits, 0, (low[0], low[1], low[2]), grid.scale, grid.bits)
    layout = replace(layout, tile_vertices=layout.in_whole_blocks(tile_vertices))
    rank = _sort_vertices(source, folder, grid, threads, passes)
    _sort_faces(source, folder, layout, rank, threads, passes)
    write_manifest(folder, layout, source.fingerprint())
    return open_store(folder)


class _Passes:
    """Rows done over several passes."""

    def __init__(self, total: int, progress: Progress | None) -> None:
        self.done, self.total, self.progress = 0, total, progress

    def add(self, rows: int) -> None:
        self.done += rows
        report(self.progress, self.done, self.total)


def _chunks(total: int) -> list[tuple[int, int]]:
    return [(start, min(start + ROWS, total)) for start in range(0, total, ROWS)]


def _grid(source: MeshSource, passes: _Passes) -> Grid:
    """The grid around all vertices, which are checked."""
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for start, stop in _chunks(source.vertex_count):
        vertices = source.vertices(start, stop).astype(np.float64)
        widen_bounds(vertices, low, high)
        if not np.isfinite(vertices).all():
            bad = start + int(np.flatnonzero(~np.isfinite(vertices).all(axis=1))[0])
            raise InvalidMeshError(
                f"{source.paths[0]}: vertex {bad} has a coordinate that is NaN or infinite; remove such vertices first"
            )
        passes.add(stop - start)
    triangle_mesh([low, high], [])  # sizes that cannot be computed with
    return grid_around(low, high, source.vertex_count)


def _sort_vertices(source: MeshSource, folder: Path, grid: Grid, threads: int, passes: _Passes) -> ArrayFile:
    """Write coordinates and numbers of the vertices in their new order, and their new places."""
    n = source.vertex_count
    ends = np.zeros(grid.cell_count + 1, dtype=np.int32)
    of_vertices = ArrayFile(folder / "cells.tmp", np.dtype(np.int32), 1, n)
    with open(of_vertices.path, "wb") as stream:
        for start, stop in _chunks(n):
            cells = grid.cells(source.vertices(start, stop).astype(np.float64), threads=threads)
            _count_cells(cells, ends)
            cells.tofile(stream)
    np.cumsum(ends, out=ends)
    vertices = new_array_file(folder / VERTICES, source.dtype, 3, n)
    order = new_array_file(folder / ORDER, np.int32, 1, n)
    rank = ArrayFile(folder / RANK, np.dtype(np.int32), 1, n)
    with open(rank.path, "wb") as stream:
        for start, stop in _chunks(n):
            places = np.empty(stop - start, dtype=np.int32)
            _place(of_vertices.read(start, stop), ends, start, places, order.mapped("r+"))
            vertices.mapped("r+")[places] = source.vertices(start, stop)
            places.tofile(stream)
            passes.add(stop - start)
    of_vertices.path.unlink()
    return rank


def _sort_faces(
    source: MeshSource, folder: Path, layout: Layout, rank: ArrayFile, threads: int, passes: _Passes
) -> None:
    """Write every face to each block that it touches."""
    m = source.face_count
    ptr = np.zeros(layout.block_count + 1, dtype=np.int64)
    ranked = ArrayFile(folder / "ranked.tmp", np.dtype(np.int32), 3, m)
    with open(ranked.path, "wb") as stream:
        for start, stop in _chunks(m):
            faces = source.faces(start, stop)
            run_kernel(_look_up, len(faces), rank.mapped(), faces, threads=threads, chunk=ROWS >> 5)
            _count_faces(faces, layout.block_bits, ptr)
            faces.tofile(stream)
            passes.add(stop - start)
    np.cumsum(ptr, out=ptr)
    np.save(folder / FACE_PTR, ptr)
    rows = new_array_file(folder / FACES, np.int32, 4, int(ptr[-1]))
    for start, stop in _chunks(m):
        _fill_in_faces(ranked.read(start, stop), start, layout.block_bits, ptr, rows.mapped("r+"))
    ranked.path.unlink()


@jit()
def _look_up(rank: IntArray, faces: IntArray, start: int, stop: int) -> None:
    """Replace vertices of the source by their new numbers."""
    for f in range(start, stop):
        for k in range(3):
            faces[f, k] = rank[faces[f, k]]


@jit()
def _count_cells(cells: IntArray, ends: IntArray) -> None:
    """Count the vertices of each cell, one place later."""
    for i in range(cells.shape[0]):
        ends[cells[i] + 1] += 1


@jit()
def _place(cells: IntArray, ends: IntArray, first: int, places: IntArray, order: IntArray) -> None:
    """Append each vertex to those of its cell."""
    for i in range(cells.shape[0]):
        place = ends[cells[i]]
        ends[cells[i]] += 1
        places[i] = place
        order[place] = first + i


@jit()
def _count_faces(faces: IntArray, bits: int, ptr: NDArray[np.int64]) -> None:
    """Count the faces of each block, one place later."""
    for f in range(faces.shape[0]):
        a, b, c = faces[f, 0] >> bits, faces[f, 1] >> bits, faces[f, 2] >> bits
        ptr[a + 1] += 1
        if b != a:
            ptr[b + 1] += 1
        if c not in (a, b):
            ptr[c + 1] += 1


@jit()
def _fill_in_faces(faces: IntArray, first: int, bits: int, ptr: NDArray[np.int64], rows: IntArray) -> None:
    """Append each face to those of its blocks."""
    for f in range(faces.shape[0]):
        a, b, c = faces[f, 0] >> bits, faces[f, 1] >> bits, faces[f, 2] >> bits
        for k in range(3):
            block = a if k == 0 else b if k == 1 else c
            if (k == 1 and b == a) or (k == 2 and c in (a, b)):
                continue
            row = ptr[block]
            ptr[block] += 1
            rows[row, 0] = first + f
            rows[row, 1], rows[row, 2], rows[row, 3] = faces[f, 0], faces[f, 1], faces[f, 2]
