"""What was learned of the last few meshes: whoever asks for another quantity of one need not wait for it again."""

import hashlib
from collections import OrderedDict
from collections.abc import Hashable
from dataclasses import dataclass
from threading import Lock

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.estimation.adaptive_fit import SurfaceFit
from bezier_filters.runtime.parallel import run_kernel

MOST = 4  # meshes, or ways to look at one
PIECE = 1 << 20  # numbers of an array that are digested at a time
LARGEST = 1_000_000  # vertices of a mesh: fits of larger ones take far longer than what is learned before
_lock, _recent = Lock(), OrderedDict[Hashable, "LearnedFit"]()


@dataclass(frozen=True)
class LearnedFit:
    """How a mesh is fitted, and where."""

    fit: SurfaceFit
    stops: BoolArray  # (n,): where neighbourhoods end
    surface: FloatArray | None  # (n, 3): the vertices without noise, if these were asked for where they end
    cleaned: FloatArray | None  # (n, 3): the vertices without outliers, if these are fitted


def key_of(*parts: FloatArray | IntArray | Hashable) -> Hashable:
    """A key for arrays, by their contents, and other things.

    >>> key_of(np.ones(3), 2) == key_of(np.ones(3), 2) != key_of(np.ones(3), 3)
    True
    """
    flat = [part.ravel() for part in parts if isinstance(part, np.ndarray)]
    pieces = [array[k : k + PIECE] for array in flat for k in range(0, len(array), PIECE)]
    digests = [b""] * len(pieces)

    def digest(start: int, stop: int) -> None:
        for k in range(start, stop):
            digests[k] = hashlib.blake2b(pieces[k].data, digest_size=16, usedforsecurity=False).digest()

    run_kernel(digest, len(pieces), chunk=1)
    return *digests, *(part.shape if isinstance(part, np.ndarray) else part for part in parts)


def recall(key: Hashable) -> LearnedFit | None:
    """What was learned under a key, if it is still known."""
    with _lock:
        if key in _recent:
            _recent.move_to_end(key)
        return _recent.get(key)


def remember(key: Hashable, learned: LearnedFit) -> None:
    """Keep what was learned, and forget what has not been asked for longest."""
    if len(learned.stops) > LARGEST:
        return
    with _lock:
        _recent[key] = learned
        while len(_recent) > MOST:
            _recent.popitem(last=False)
