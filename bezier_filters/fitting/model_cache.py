"""Cache of the fits chosen for the last few meshes, so that another quantity of a mesh needs no second choice."""

import hashlib
from collections import OrderedDict
from collections.abc import Hashable
from dataclasses import dataclass
from threading import Lock

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.fitting.surface_fit import SurfaceFit
from bezier_filters.runtime.parallel import run_kernel

MAX_CACHED_FITS = 4  # meshes, or sets of options of one mesh
DIGEST_CHUNK = 1 << 20  # numbers of an array per digest
MAX_CACHED_VERTICES = 1_000_000  # vertices of a mesh: fitting a larger one takes far longer than choosing the fit
_lock, _recent = Lock(), OrderedDict[Hashable, "CachedFit"]()


@dataclass(frozen=True)
class CachedFit:
    """The fit chosen for a mesh; arrays are in the order of its vertices."""

    fit: SurfaceFit
    barriers: BoolArray  # (n,): vertices across which neighbourhoods do not extend
    noise_free: FloatArray | None  # (n, 3): the denoised vertices, if they were needed to find sharp edges
    cleaned: FloatArray | None  # (n, 3): the vertices without outliers, if these are fitted


def cache_key(*parts: FloatArray | IntArray | Hashable) -> Hashable:
    """A key of arrays, by their contents, and of other hashable values.

    >>> cache_key(np.ones(3), 2) == cache_key(np.ones(3), 2) != cache_key(np.ones(3), 3)
    True
    """
    flat = [part.ravel() for part in parts if isinstance(part, np.ndarray)]
    pieces = [array[k : k + DIGEST_CHUNK] for array in flat for k in range(0, len(array), DIGEST_CHUNK)]
    digests = [b""] * len(pieces)

    def digest(start: int, stop: int) -> None:
        for k in range(start, stop):
            digests[k] = hashlib.blake2b(pieces[k].data, digest_size=16, usedforsecurity=False).digest()

    run_kernel(digest, len(pieces), chunk=1)
    return *digests, *(part.shape if isinstance(part, np.ndarray) else part for part in parts)


def look_up_fit(key: Hashable) -> CachedFit | None:
    """The fit stored under a key, or None."""
    with _lock:
        if key in _recent:
            _recent.move_to_end(key)
        return _recent.get(key)


def cache_fit(key: Hashable, learned: CachedFit) -> None:
    """Store a fit, and drop the least recently used one."""
    if len(learned.barriers) > MAX_CACHED_VERTICES:
        return
    with _lock:
        _recent[key] = learned
        while len(_recent) > MAX_CACHED_FITS:
            _recent.popitem(last=False)
