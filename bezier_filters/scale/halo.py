"""Parts of a mesh on disk with what surrounds them, read block by block."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bezier_filters.arrays import BoolArray, IntArray
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.runtime.jit import jit
from bezier_filters.scale.store import Store

FAR = 2**31 - 1  # ring of what was not reached: no number of rings comes near it
GROUP = 16  # vertices whose surroundings are read together, so that few blocks are held


@dataclass(frozen=True)
class Part:
    """A part of a mesh, its vertices and faces in the order of the whole."""

    ids: IntArray  # (k,): which vertices of the store they are, ascending
    mesh: TriangleMesh
    keys: NDArray[np.int64]  # (m,): what faces are sorted by: cell of the first corner, then number in the source
    cut: BoolArray  # (k,): vertices in the last ring, of which faces may be missing

    def local(self, ids: IntArray) -> IntArray:
        """Numbers in the part of vertices of the store that it has."""
        return np.searchsorted(self.ids, ids).astype(np.int32)


@dataclass(frozen=True)
class TilePart(Part):
    """A tile with some rings around it."""

    own: slice  # where the vertices of the tile are

    def faces_of_tile(self) -> BoolArray:
        """Faces whose first corner belongs to the tile, (m,): every face of a mesh belongs to one tile."""
        first = self.mesh.faces[:, 0]
        return np.asarray((first >= self.own.start) & (first < self.own.stop))


def tile_part(store: Store, tile: int, rings: int) -> TilePart:
    """See `part_around`."""
    start, stop = store.layout.tile(tile)
    part = part_around(store, np.arange(start, stop, dtype=np.int32), rings)
    first = int(np.searchsorted(part.ids, start))
    return TilePart(**vars(part), own=slice(first, first + stop - start))


def part_around(store: Store, seeds: IntArray, rings: int) -> Part:
    """Some vertices (k,) and what lies within some rings, with all faces at the vertices within one ring less."""
    loaded = _Loaded(store)
    loaded.load(np.unique(seeds >> loaded.bits), with_faces=True)
    loaded.layers[loaded.places(seeds)] = 0
    for k in range(rings):
        missing = loaded.grow(k)
        if len(missing):
            loaded.load(missing, with_faces=k + 1 < rings)
            loaded.grow(k)
    return loaded.part(rings)


def part_around_samples(store: Store, samples: IntArray, rings: int, *, threads: int = 1) -> Part:
    """The same for vertices from all over the mesh, which are read some at a time."""
    if not len(samples):
        nothing = TriangleMesh(np.empty((0, 3)), np.empty((0, 3), dtype=np.int32))
        return Part(np.empty(0, dtype=np.int32), nothing, np.empty(0, dtype=np.int64), np.empty(0, dtype=np.bool_))
    samples = np.sort(samples)
    groups = [samples[k : k + GROUP] for k in range(0, len(samples), GROUP)]
    with ThreadPoolExecutor(threads) as pool:
        return _together(list(pool.map(lambda group: part_around(store, group, rings), groups)))


def in_source_order(store: Store, part: Part) -> tuple[IntArray, TriangleMesh]:
    """A part with its vertices and faces in the order of the source, and which vertices of the store they are."""
    order = np.argsort(store.sources(part.ids)).astype(np.int32)
    number = np.empty_like(order)
    number[order] = np.arange(len(order), dtype=np.int32)
    of_faces = np.argsort(part.keys & 0xFFFFFFFF)
    return part.ids[order], TriangleMesh(part.mesh.vertices[order], number[part.mesh.faces[of_faces]])


def _together(parts: Sequence[Part]) -> Part:
    """The union of parts."""
    ids, first = np.unique(np.concatenate([part.ids for part in parts]), return_index=True)
    keys, first_face = np.unique(np.concatenate([part.keys for part in parts]), return_index=True)
    vertices = np.concatenate([part.mesh.vertices for part in parts])[first]
    faces = np.concatenate([part.ids[part.mesh.faces] for part in parts])[first_face]
    cut = np.ones(len(ids), dtype=np.bool_)
    for part in parts:
        cut[np.searchsorted(ids, part.ids[~part.cut])] = False
    return Part(ids, TriangleMesh(vertices, np.searchsorted(ids, faces).astype(np.int32)), keys, cut)


class _Loaded:
    """Blocks that were read, and how far their vertices are from where it began."""

    def __init__(self, store: Store) -> None:
        self.store, self.bits, self.ptr = store, store.layout.block_bits, store.face_ptr()
        self.slots = np.full(store.layout.block_count, -1, dtype=np.int32)
        self.layers: IntArray = np.empty(0, dtype=np.int32)
        self.faces = list[IntArray]()
        self.active: IntArray = np.empty((0, 4), dtype=np.int32)  # faces that may still lead on

    def places(self, ids: IntArray) -> IntArray:
        """Where vertices are in the arrays."""
        return np.asarray((self.slots[ids >> self.bits] << self.bits) + (ids & (1 << self.bits) - 1))

    def load(self, blocks: IntArray, *, with_faces: bool) -> None:
        """Read blocks that are not there yet."""
        self.slots[blocks] = (len(self.layers) >> self.bits) + np.arange(len(blocks), dtype=np.int32)
        self.layers = np.append(self.layers, np.full(len(blocks) << self.bits, FAR, dtype=np.int32))
        if with_faces:
            runs = np.split(blocks, np.flatnonzero(np.diff(blocks) > 1) + 1)
            found = [self.store.faces(int(self.ptr[run[0]]), int(self.ptr[run[-1] + 1])) for run in runs]
            self.faces += found
            self.active = np.concatenate([self.active, *found])

    def grow(self, k: int) -> IntArray:
        """Reach what shares a face with layer k; return the blocks that are missing for that."""
        needed = np.zeros(len(self.slots), dtype=np.bool_)
        count = _reach(self.active, self.bits, self.slots, self.layers, k, needed)
        self.active = self.active[:count].copy()
        return np.flatnonzero(needed).astype(np.int32)

    def part(self, rings: int) -> Part:
        """All that was reached."""
        every = ((np.flatnonzero(self.slots >= 0) << self.bits)[:, np.newaxis] + np.arange(1 << self.bits)).ravel()
        ids = every[self.layers[self.places(every)] != FAR].astype(np.int32)
        places = self.places(ids)
        numbers = np.full(len(self.layers), -1, dtype=np.int32)
        numbers[places] = np.arange(len(ids), dtype=np.int32)
        faces = np.concatenate([self.faces_within(rings, faces) for faces in self.faces])
        corners = numbers[self.places(faces[:, 1:])]
        vertices = self.store.coordinates_of(ids)
        cells = self.store.layout.grid.cells(vertices)[corners[:, 0]]
        # faces of several blocks come several times
        keys, first = np.unique(cells.astype(np.int64) << 32 | faces[:, 0], return_index=True)
        return Part(ids, TriangleMesh(vertices, corners[first]), keys, self.layers[places] == rings)

    def faces_within(self, rings: int, faces: IntArray) -> IntArray:
        """Those of some faces that have a corner within rings - 1 layers."""
        within = np.zeros(len(faces), dtype=np.bool_)
        _mark_within(faces, self.bits, self.slots, self.layers, rings, within)
        return faces[within]


@jit()
def _layer(bits: int, slots: IntArray, layers: IntArray, i: int) -> int:
    """Layer of a vertex, `FAR` if it is unknown."""
    slot = slots[i >> bits]
    return int(layers[(slot << bits) + (i & (1 << bits) - 1)]) if slot >= 0 else FAR


@jit()
def _reach(active: IntArray, bits: int, slots: IntArray, layers: IntArray, k: int, needed: BoolArray) -> int:
    """Put the unknown corners of active faces with one in layer k into layer k + 1.

    Blocks that are missing are marked. Faces within layer k, which lead nowhere, are left out of the active ones;
    returns how many stay.
    """
    count = 0
    for f in range(len(active)):
        nearest, farthest = FAR, 0
        for c in range(1, 4):
            layer = _layer(bits, slots, layers, active[f, c])
            nearest, farthest = min(nearest, layer), max(farthest, layer)
        if farthest <= k:
            continue
        for c in range(4):
            active[count, c] = active[f, c]
        if nearest == k:
            for c in range(1, 4):
                i = active[f, c]
                slot = slots[i >> bits]
                if slot < 0:
                    needed[i >> bits] = True
                else:
                    place = (slot << bits) + (i & (1 << bits) - 1)
                    if layers[place] == FAR:
                        layers[place] = k + 1
        count += 1
    return count


@jit()
def _mark_within(faces: IntArray, bits: int, slots: IntArray, layers: IntArray, rings: int, within: BoolArray) -> None:
    """Mark the faces with a corner within rings - 1 layers."""
    for f in range(len(faces)):
        for c in range(1, 4):
            within[f] = within[f] or _layer(bits, slots, layers, faces[f, c]) < rings
