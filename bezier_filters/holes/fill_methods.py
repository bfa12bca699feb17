"""The ways to fill a hole, the best first."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.holes.contrasts import WorkSpace
from bezier_filters.holes.crease_fill import crease_fills
from bezier_filters.holes.fill_topology import Fill
from bezier_filters.holes.paper_fill import paper_fill
from bezier_filters.holes.smooth_fill import faired, first_fill, meeting_rim, on_surface, surface_around, triangulated
from bezier_filters.holes.surroundings import Surroundings

FEWEST_POINTS = 16
"""With known normals, for a surface."""


@dataclass(frozen=True)
class Attempt:
    """A fill, or why there is none.

    Attributes
    ----------
    method : str
        Its name; see `HoleReport.method`.
    fill : Fill or None
        Triangles on the rim and new vertices.
    reason : str
        What went wrong, if there is no fill.
    parts : int
        Sub-holes.
    creases : (e, 2) int32
        Edges of the fill that are creases.
    """

    method: str
    fill: Fill | None
    reason: str = ""
    parts: int = 1
    creases: IntArray | None = None


def smooth_attempts(
    around: Surroundings, normals: FloatArray, *, noisy: bool, work: WorkSpace | None = None, threads: int = 1
) -> Iterator[Attempt]:
    """Fill a hole in a smooth surface, in ever simpler ways.

    Parameters
    ----------
    around : Surroundings
        Three rings around the hole, or more.
    normals : (b, 3) float64
        Unit normals of its vertices, zero where they are not known.
    noisy : bool
        Whether its points have errors that should not be followed.
    work : WorkSpace, optional
        Memory of earlier fits, to be used again.
    threads : int
        Number of threads.
    """
    fill = first_fill(around)
    if fill is None:
        yield Attempt("flat", None, "every triangulation of the rim would join vertices that are joined already")
        return
    if len(fill.points) > fill.rim_count:
        yield _continued(fill, around, normals, noisy=noisy, work=work, threads=threads)
        yield Attempt("variational", faired(fill, around, 2 if noisy else 3))
        yield Attempt("variational", fill)
        yield Attempt("flat", faired(fill, around, 1))
    yield Attempt("flat", triangulated(around))


def crease_attempts(around: Surroundings, *, noisy: bool) -> Iterator[Attempt]:
    """Fill a hole with the creases that run into it continued, if there are any; see `smooth_attempts`."""
    for found in crease_fills(around, noisy=noisy):
        if isinstance(found, str):
            yield Attempt("creases", None, found)
        else:
            yield Attempt("creases", found.fill, parts=found.parts, creases=found.creases)


def paper_attempts(
    around: Surroundings,
    normals: FloatArray,
    alpha: float,
    *,
    noisy: bool,
    work: WorkSpace | None = None,
    threads: int = 1,
) -> Iterator[Attempt]:
    """Fill a hole in the paper's way, or else as a smooth one; see `smooth_attempts`."""
    fill = paper_fill(around, alpha)
    yield Attempt("paper", None, fill) if isinstance(fill, str) else Attempt("paper", fill)
    yield from smooth_attempts(around, normals, noisy=noisy, work=work, threads=threads)


def _continued(
    fill: Fill, around: Surroundings, normals: FloatArray, *, noisy: bool, work: WorkSpace | None, threads: int
) -> Attempt:
    known = np.einsum("ij,ij->i", normals, normals) > 0.25
    if np.count_nonzero(known) < FEWEST_POINTS:
        return Attempt("surface", None, "too few vertices around the hole to fit a surface")
    surface = surface_around(around, normals, known, noisy=noisy, work=work)
    moved = None if surface is None else on_surface(fill, around, surface, threads=threads)
    if surface is None or moved is None:
        return Attempt("surface", None, "the surface around the hole does not continue into it")
    return Attempt("surface", meeting_rim(moved, around, surface))
