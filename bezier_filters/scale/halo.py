"""Parts of a mesh on disk with their halos, read block by block."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bezier_filters.arrays import BoolArray, IntArray
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.runtime.jit import inner_jit, jit
from bezier_filters.runtime.parallel import thread_count
from bezier_filters.scale.store import Store

UNREACHED_LAYER = 2**31 - 1  # layer of vertices that were not reached: above any number of rings
SEEDS_PER_READ = 16  # vertices whose neighbourhoods are read together, so that few blocks are in memory


@dataclass(frozen=True)
class Part:
    """A part of a mesh, its vertices and faces in the order of the whole."""

    ids: IntArray  # (k,): vertices of the store, ascending
    mesh: TriangleMesh
    keys: NDArray[np.int64]  # (m,): sort keys of faces: cell of the first corner, then number in the source
    cut: BoolArray  # (k,): vertices in the last ring, where faces may be missing

    def local(self, ids: IntArray) -> IntArray:
        """Indices in the part of vertices of the store."""
        return np.searchsorted(self.ids, ids).astype(np.int32)


@dataclass(frozen=True)
class TilePart(Part):
    """A tile with a halo of some rings."""

    own: slice  # range of the vertices of the tile

    def faces_of_tile(self) -> BoolArray:
        """Faces whose first corner is in the tile, (m,): every face of a mesh belongs to one tile."""
        first = self.mesh.faces[:, 0]
        return np.asarray((first >= self.own.start) & (first < self.own.stop))


def tile_part(store: Store, tile: int, rings: int) -> TilePart:
    """Part of a mesh around a tile; see `part_around`."""
    start, stop = store.layout.tile(tile)
    part = part_around(store, np.arange(start, stop, dtype=np.int32), rings)
    first = int(np.searchsorted(part.ids, start))
    return TilePart(**vars(part), own=slice(first, first + stop - start))


def part_around(store: Store, seeds: IntArray, rings: int) -> Part:
    """Part within some rings of vertices, ascending, with all faces at the vertices within ``rings - 1``.

    Breadth-first search: the blocks of the vertices of one layer have all faces at it, which lead to the next layer.
    """
    bits, ptr = store.layout.block_bits, store.face_ptr()
    # layers of the vertices of blocks that were reached; the first slot stands for all other blocks
    slots, layer_of = np.zeros(store.layout.block_count, np.int32), np.full(1 << bits, UNREACHED_LAYER, np.int32)

    def places(ids: IntArray) -> IntArray:
        return np.asarray((slots[ids >> bits] << bits) + (ids & (1 << bits) - 1))

    layers, found = [seeds], list[IntArray]()
    ahead: IntArray = np.empty((0, 4), dtype=np.int32)  # faces beyond the layer
    for k in range(rings + 1):
        blocks = layers[k] >> bits
        blocks = blocks[(np.diff(blocks, prepend=-1) > 0) & (slots[blocks] == 0)]
        slots[blocks] = (len(layer_of) >> bits) + np.arange(len(blocks), dtype=np.int32)
        layer_of = np.append(layer_of, np.full(len(blocks) << bits, UNREACHED_LAYER, np.int32))
        layer_of[places(layers[k])] = k
        if k < rings:
            ahead = np.concatenate([ahead, *store.faces_of(blocks, ptr)])
            nearest, beyond = np.empty(len(ahead), dtype=np.int32), np.empty(3 * len(ahead), dtype=np.int32)
            count = _classify_faces(ahead, bits, slots, layer_of, k, nearest, beyond)
            found.append(ahead.take(np.flatnonzero(nearest == k), axis=0))
            ahead = ahead.take(
                np.flatnonzero(nearest == UNREACHED_LAYER), axis=0
            )  # others were found before, in another block
            layers.append(np.unique(beyond[:count]))
    ids = np.sort(np.concatenate(layers))
    numbers = np.zeros_like(layer_of)
    numbers[places(ids)] = np.arange(len(ids), dtype=np.int32)
    faces = np.concatenate(found)
    corners, vertices = np.empty((len(faces), 3), dtype=np.int32), store.coordinates_of(ids)
    _renumber(faces, bits, slots, numbers, corners)
    cells = store.layout.grid.cells(vertices)[corners[:, 0]]
    # remove duplicates of faces with corners in several blocks
    keys, first = np.unique(cells.astype(np.int64) << 32 | faces[:, 0], return_index=True)
    return Part(ids, TriangleMesh(vertices, corners[first]), keys, layer_of[places(ids)] == rings)


@inner_jit()
def _place(i: int, bits: int, slots: IntArray) -> int:
    """Index of a vertex in arrays by blocks: `places` of `part_around` for one vertex, compiled."""
    return int((slots[i >> bits] << bits) + (i & (1 << bits) - 1))


@jit()
def _classify_faces(
    faces: IntArray, bits: int, slots: IntArray, layer_of: IntArray, layer: int, nearest: IntArray, beyond: IntArray
) -> int:
    """Write the layer of each face's nearest corner, see `part_around`, and the vertices of the next layer.

    These are the unreached corners of faces at the layer, with duplicates; returns their number.
    """
    count = 0
    for f in range(len(faces)):
        nearest[f] = UNREACHED_LAYER
        for c in range(1, 4):
            nearest[f] = min(nearest[f], layer_of[_place(faces[f, c], bits, slots)])
        if nearest[f] == layer:
            for c in range(1, 4):
                if layer_of[_place(faces[f, c], bits, slots)] == UNREACHED_LAYER:
                    beyond[count] = faces[f, c]
                    count += 1
    return count


@jit()
def _renumber(faces: IntArray, bits: int, slots: IntArray, numbers: IntArray, corners: IntArray) -> None:
    """Write the indices of the corners of faces in the part."""
    for f in range(len(faces)):
        for c in range(3):
            corners[f, c] = numbers[_place(faces[f, c + 1], bits, slots)]


def part_around_samples(store: Store, samples: IntArray, rings: int) -> Part:
    """`part_around` for vertices scattered over the mesh, read in groups."""
    samples = np.unique(samples)
    groups = [samples[k : k + SEEDS_PER_READ] for k in range(0, max(len(samples), 1), SEEDS_PER_READ)]
    with ThreadPoolExecutor(thread_count()) as pool:
        return _union(list(pool.map(lambda group: part_around(store, group, rings), groups)))


def restore_source_order(store: Store, part: Part) -> tuple[IntArray, TriangleMesh]:
    """A part with its vertices and faces in the order of the source, and the ids of the vertices in the store."""
    order = np.argsort(store.sources(part.ids)).astype(np.int32)
    number = np.empty_like(order)
    number[order] = np.arange(len(order), dtype=np.int32)
    of_faces = np.argsort(part.keys & 0xFFFFFFFF)
    return part.ids[order], TriangleMesh(part.mesh.vertices[order], number[part.mesh.faces[of_faces]])


def _union(parts: Sequence[Part]) -> Part:
    """The union of parts."""
    ids, first = np.unique(np.concatenate([part.ids for part in parts]), return_index=True)
    keys, first_face = np.unique(np.concatenate([part.keys for part in parts]), return_index=True)
    vertices = np.concatenate([part.mesh.vertices for part in parts])[first]
    faces = np.concatenate([part.ids[part.mesh.faces] for part in parts])[first_face]
    cut = np.ones(len(ids), dtype=np.bool_)
    for part in parts:
        cut[np.searchsorted(ids, part.ids[~part.cut])] = False
    return Part(ids, TriangleMesh(vertices, np.searchsorted(ids, faces).astype(np.int32)), keys, cut)
