"""The methods to fill a hole. A further one is a function of a task and a line in the table."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

from bezier_filters.arrays import FloatArray
from bezier_filters.holes.crease_fill import crease_attempts
from bezier_filters.holes.influence_region import InfluenceRegion
from bezier_filters.holes.planar_fill import Correction, paper_fill
from bezier_filters.holes.smooth_fill import Attempt, smooth_attempts

FillingMethod = Literal["auto", "paper"]


@dataclass(frozen=True)
class FillTask:
    """A hole to fill."""

    region: InfluenceRegion  # what surrounds it
    normals: FloatArray  # (b, 3): unit normals of the vertices of the region, zero where they are not known
    noisy: bool  # whether these vertices have errors that should not be followed
    creases: bool  # whether creases are continued
    # for ``"paper"``
    alpha: float  # weight of the points
    correction: Correction  # how patches are made to end at the rim
    threads: int


def _automatic(task: FillTask) -> Iterator[Attempt]:
    """With the creases that run into the hole, if there are any, or else smooth, in ever simpler ways."""
    if task.creases:
        yield from crease_attempts(task.region, noisy=task.noisy)
    yield from smooth_attempts(task.region, task.normals, noisy=task.noisy, threads=task.threads)


def _paper(task: FillTask) -> Iterator[Attempt]:
    """In the paper's way: a patch for each part that creases cut the hole into, or one patch; or else smooth."""
    fill_part = partial(paper_fill, alpha=task.alpha, correction=task.correction)
    if task.creases:
        for attempt in crease_attempts(task.region, noisy=task.noisy, fill_part=fill_part):
            yield replace(attempt, method="paper")
    fill = fill_part(task.region)
    yield Attempt("paper", None, fill) if isinstance(fill, str) else Attempt("paper", fill)
    yield from smooth_attempts(task.region, task.normals, noisy=task.noisy, threads=task.threads)


# what each one tries, the best first: the first fill that cuts nothing is taken
FILL_METHODS: dict[FillingMethod, Callable[[FillTask], Iterator[Attempt]]] = {"auto": _automatic, "paper": _paper}
