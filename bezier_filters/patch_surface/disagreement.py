"""How far the patches that are blended at places of a surface are from each other."""

import numpy as np

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.patch_surface.blending import JETS, WEIGHTS, SurfaceArrays, place_on_surface
from bezier_filters.patch_surface.projection import WORK_SIZE
from bezier_filters.runtime.jit import jit
from bezier_filters.runtime.parallel import RangeTask, run_in_chunks


def patch_disagreement(surface: SurfaceArrays, faces: IntArray, coordinates: FloatArray) -> FloatArray:
    """Root mean square distance (q,) of the patches from the surface at places of faces, by their weights there.

    It is 0 at vertices, where one patch is the surface, and where a face has no surface.
    """
    found = np.zeros(len(faces))

    def task() -> RangeTask:
        work = np.empty(WORK_SIZE)

        def run(start: int, stop: int) -> None:
            measure_disagreement(surface, faces, coordinates, start, stop, work, found)

        return run

    run_in_chunks(task, len(faces))
    return found


@jit()
def measure_disagreement(
    surface: SurfaceArrays,
    faces: IntArray,
    coordinates: FloatArray,
    start: int,
    stop: int,
    work: FloatArray,
    found: FloatArray,
) -> None:
    """Write the disagreement at places start .. stop-1."""
    for q in range(start, stop):
        if faces[q] < 0 or not place_on_surface(surface, faces[q], coordinates[q, 0], coordinates[q, 1], work):
            continue
        total = 0.0
        for corner in range(3):
            jet, square = JETS + 10 * corner, 0.0
            for axis in range(3):
                square += work[jet + 1 + axis] ** 2
            if square > 0.0:
                total += max(work[WEIGHTS + corner], 0.0) * work[jet] ** 2 / square
        found[q] = np.sqrt(total)
