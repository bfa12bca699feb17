"""Compile what most tests call, in one process: two that start at the same time would both compile all of it."""

import numpy as np
from full_meshset import punched_torus
from graph_fits import fit_over_plane_z

from baselines import adaptive_gaussian_smoothing, ouyang_feng_normals, razdan_bae
from bezier_filters.compilation import STAGES, run_job
from bezier_filters.patches.patch_fit import DEGREES, PatchFit
from bezier_filters.surfaces import torus
from corrected_curvatures import corrected_curvatures
from survivors import keep_survivors


def compile_kernels() -> None:
    """Compile the kernels of the package, and the functions of the tests and tools."""
    for stage in STAGES:
        for name in stage:
            run_job(name)
    x, y = np.random.default_rng(0).uniform(-1.0, 1.0, (2, 60))
    for degree in DEGREES:
        fit_over_plane_z(x, y, x * y, PatchFit(degree, 0.8), rings=2)
    razdan_bae(*punched_torus())
    ouyang_feng_normals(*punched_torus())
    adaptive_gaussian_smoothing(*punched_torus(), rounds=1)
    corrected_curvatures(*punched_torus(), radius=0.3)
    ring = torus(resolution=12, jitter=0.3)
    keep_survivors(ring.vertices, ring.faces, np.arange(len(ring.vertices)) % 2 == 0)


if __name__ == "__main__":
    compile_kernels()
