"""Tiles with the rings around them, in the order of the source, as pieces that stages compute on.

All but the coordinates of a piece is kept in the store: there are many stages.
"""

import os
import uuid
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bezier_filters.arrays import IntArray
from bezier_filters.meshes.adjacency import Adjacency, Rows, vertex_adjacency
from bezier_filters.scale.halo import in_source_order, part_around
from bezier_filters.scale.store import Store

KEPT_RINGS = (3, 36)
"""Around the tiles that are kept, for stages that look at neighbours and for those that make many steps. Those that
look further make their own. Reading and writing what goes from stage to stage takes as long as some thirty steps of
a filter: more rings would save less than they cost."""


@dataclass(frozen=True)
class TilePiece:
    """A tile with what is around it.

    Attributes
    ----------
    ids : (k,) int32
        Which vertices of the store it has, ascending.
    places : (k,) int32
        Where each of its vertices is among them: these are in the order of the source, and so are the faces.
    faces : (m, 3) int32
    adjacency : Adjacency
    """

    ids: IntArray
    places: IntArray
    faces: IntArray
    adjacency: Adjacency

    def rows(self, start: int, stop: int) -> IntArray:
        """Where vertices start .. stop-1 of the store are, in this order."""
        vertices = np.empty_like(self.places)
        vertices[self.places] = np.arange(len(vertices), dtype=np.int32)
        first, end = np.searchsorted(self.ids, [start, stop])
        return vertices[first:end]


def rows_between(ids: IntArray, start: int, stop: int) -> IntArray:
    """Where the numbers start .. stop-1 are, in ascending order of the numbers."""
    places = np.flatnonzero((ids >= start) & (ids < stop))
    return places[np.argsort(ids[places])].astype(np.int32)


def piece_around(store: Store, tile: int, rings: int) -> TilePiece:
    """Some rings around a tile, or more."""
    rings = next((kept for kept in KEPT_RINGS if kept >= rings), rings)
    path = store.folder / f"pieces-{rings}" / f"piece-{tile:06d}.npz"
    if path.is_file():
        return _read(path)
    start, stop = store.layout.tile(tile)
    part = part_around(store, np.arange(start, stop, dtype=np.int32), rings)
    ids, mesh = in_source_order(store, part)
    found = TilePiece(part.ids, part.local(ids), mesh.faces, vertex_adjacency(mesh))
    if rings in KEPT_RINGS:
        _write(path, found)
    return found


def _write(path: Path, piece: TilePiece) -> None:
    """Write a piece, whole or not at all; its sums are checked when it is read."""
    path.parent.mkdir(exist_ok=True)
    temporary = path.with_name(f".{uuid.uuid4().hex}.npz")
    faces, vertices = piece.adjacency.faces, piece.adjacency.vertices
    np.savez(
        temporary,
        ids=piece.ids,
        places=piece.places,
        faces=piece.faces,
        face_ptr=faces.indptr,
        face_indices=faces.indices,
        ptr=vertices.indptr,
        indices=vertices.indices,
        on_boundary=piece.adjacency.on_boundary,
    )
    os.replace(temporary, path)


def _read(path: Path) -> TilePiece:
    with np.load(path) as found:
        of_faces: NDArray[np.int32] = found["face_ptr"]
        adjacency = Adjacency(
            Rows(of_faces, found["face_indices"]), Rows(found["ptr"], found["indices"]), found["on_boundary"]
        )
        return TilePiece(found["ids"], found["places"], found["faces"], adjacency)
