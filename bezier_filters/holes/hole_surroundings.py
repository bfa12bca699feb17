"""What is known around holes: rings of the mesh, its noise, and normals at the points that surfaces are fitted to."""

from collections.abc import Sequence

import numpy as np

from bezier_filters.arrays import FloatArray
from bezier_filters.estimation.estimate import estimate_vertex_geometry
from bezier_filters.estimation.vertex_geometry import VertexGeometry
from bezier_filters.holes.hole_detection import Hole
from bezier_filters.holes.smooth_fill import fitted_points
from bezier_filters.holes.surroundings import Surroundings, surroundings_of
from bezier_filters.meshes.adjacency import Adjacency
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.runtime.parallel import RangeTask, run_in_chunks

RINGS = 5
"""Around a hole, from which its fill follows."""
NOISE = 0.05
"""Of an edge, from which on points are fitted rather than interpolated: face normals are some 4 degrees off then."""
CHUNK = 16
"""Holes that a thread looks at in one go."""


def all_surroundings(
    mesh: TriangleMesh, adjacency: Adjacency, holes: Sequence[Hole], *, threads: int = 1
) -> list[Surroundings]:
    """The surroundings of each hole."""
    result: list[Surroundings | None] = [None] * len(holes)

    def make_task() -> RangeTask:
        places = np.full(mesh.vertex_count, -1, dtype=np.int32)

        def collect(start: int, stop: int) -> None:
            for k in range(start, stop):
                result[k] = surroundings_of(mesh, adjacency, holes[k].loops, RINGS, places)

        return collect

    run_in_chunks(make_task, len(holes), threads=threads, chunk=CHUNK)
    return [around for around in result if around is not None]


def is_noisy(around: Surroundings, noise: float | None) -> bool:
    """Whether noise of that size, a length, is so large that points around a hole are fitted."""
    return noise is not None and noise > NOISE * float(around.sizes.mean())


def normals_and_noise(
    mesh: TriangleMesh, surroundings: Sequence[Surroundings], noise: float | None, *, threads: int = 1
) -> tuple[FloatArray, float | None]:
    """Normals of the Bezier patches at the points that surfaces are fitted to, and the noise of the mesh.

    Parameters
    ----------
    mesh : TriangleMesh
    surroundings : sequence of Surroundings
        Of the holes.
    noise : float, optional
        Its standard deviation, a length, if that is known; otherwise it is learned.
    threads : int
        Number of threads.

    Returns
    -------
    (n, 3) float64, float or None
        Normals are zero elsewhere; the noise is None if the mesh is too small to learn it.
    """
    if not surroundings:
        return np.zeros_like(mesh.vertices), noise
    expected = [is_noisy(around, noise) for around in surroundings]
    geometry = _geometry(mesh, surroundings, expected, threads)
    noise = geometry.noise_sigma if noise is None else noise
    noisy = [is_noisy(around, noise) for around in surroundings]
    if noisy != expected:  # more points are fitted than was thought
        geometry = _geometry(mesh, surroundings, noisy, threads)
    return geometry.normals, noise


def _geometry(
    mesh: TriangleMesh, surroundings: Sequence[Surroundings], noisy: Sequence[bool], threads: int
) -> VertexGeometry:
    """Geometry at the points that surfaces are fitted to, given around which holes there is noise."""
    selected = np.zeros(mesh.vertex_count, dtype=np.bool_)
    for around, with_noise in zip(surroundings, noisy, strict=True):
        selected[around.ids[fitted_points(around, noisy=with_noise)]] = True
    return estimate_vertex_geometry(mesh.vertices, mesh.faces, selected=selected, threads=threads)
