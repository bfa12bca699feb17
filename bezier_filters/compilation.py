"""Compile all kernels at once, in several processes: for wheels, containers and programs that must not wait later.

Every job calls functions of the package on a mesh as small as it can be. The jobs of the first stage have few kernels
in common; the jobs of the second stage need theirs.
"""

import importlib.util
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.estimation.estimate import estimate_vertex_geometry
from bezier_filters.feature_lines.crease_lines import find_creases
from bezier_filters.files.mesh_counts import count_mesh
from bezier_filters.fitting.first_call import compile_fit, compile_the_rest
from bezier_filters.holes.bridging import bridge_holes
from bezier_filters.holes.hole_filling import fill_holes
from bezier_filters.holes.loops import diameter
from bezier_filters.holes.polygon_triangulation import triangulate_polygon
from bezier_filters.holes.polyharmonic_fairing import polyharmonic_continuation
from bezier_filters.inspection.deviation import compare
from bezier_filters.inspection.measures import measure
from bezier_filters.meshes.adjacency import Adjacency, Rows
from bezier_filters.meshes.half_edges import faces_at_edges
from bezier_filters.meshes.spatial_order import MIN_REORDER_VERTICES, has_locality
from bezier_filters.patch_surface.surface_fit import fit_surface
from bezier_filters.remeshing.remeshing import remesh
from bezier_filters.remeshing.subdivision import subdivide
from bezier_filters.runtime.compile_time import ANNOUNCEMENTS
from bezier_filters.runtime.kernel_cache import SUFFIX
from bezier_filters.runtime.kernel_folders import kernel_folders
from bezier_filters.runtime.parallel import Progress, report, usable_threads
from bezier_filters.runtime.worker_processes import run_in_processes
from bezier_filters.sampling.mesh_parts import grow_component, next_unseen
from bezier_filters.smoothing.smooth import smooth
from bezier_filters.surface_lines.lines import trace_lines
from bezier_filters.surfaces import block_with_sharp_edges, sphere, torus

_PLY = b"""ply
format binary_little_endian 1.0
element vertex 0
property float x
element face 1
property list uchar int vertex_indices
end_header
\0"""


@dataclass(frozen=True)
class CompiledKernels:
    """The machine code that is there after all kernels were compiled."""

    seconds: float  # that it took, of wall time
    processes: int
    functions: int  # variants of compiled functions
    size: int  # in bytes
    folder: Path | None  # for new code, if it can be kept


def compile_kernels(*, processes: int | None = None, progress: Progress | None = None) -> CompiledKernels:
    """Compile all kernels that are not there yet.

    Parameters
    ----------
    processes
        Number of processes; by default BEZIER_FILTERS_THREADS, else the number of usable cores.
    progress
        Called after each job with the number of finished jobs and of all jobs.

    Raises
    ------
    ChildProcessError
        If a job fails; the message has the reason.
    """
    begin, done = time.perf_counter(), 0
    processes = processes or usable_threads()
    total = sum(map(len, STAGES))
    for names in map(list, STAGES):
        for index, outcome in run_in_processes(run_job, names, processes=min(processes, len(names))):
            if outcome.error:
                raise ChildProcessError(f"cannot compile the kernels of {names[index]}: {outcome.error}")
            done += 1
            report(progress, done, total)
    folders = kernel_folders()
    files = [file for folder in folders.readable for file in folder.glob(f"*{SUFFIX}")]
    size = sum(file.stat().st_size for file in files)
    return CompiledKernels(time.perf_counter() - begin, processes, len(files), size, folders.writable)


def run_job(name: str) -> None:
    """Run one of the jobs of `STAGES`, in silence."""
    ANNOUNCEMENTS.setLevel("ERROR")
    next(stage[name] for stage in STAGES if name in stage)()


def _remove_faces_near(vertices: FloatArray, faces: IntArray, place: tuple[float, float, float]) -> IntArray:
    keep: BoolArray = np.linalg.norm(vertices[faces].mean(axis=1) - place, axis=1) > 0.25
    return faces[keep]


def _torus_with_holes() -> tuple[FloatArray, IntArray]:
    """Vertices and faces of a noisy torus with two holes."""
    ring = torus(resolution=12, jitter=0.2)
    vertices = ring.vertices + 0.01 * np.random.default_rng(0).standard_normal(ring.vertices.shape)
    faces = _remove_faces_near(vertices, ring.faces, (1.0, 0.0, 0.4))
    return vertices, _remove_faces_near(vertices, faces, (-1.0, 0.0, -0.4))


def _estimate(**options: object) -> None:
    estimate_vertex_geometry(*_torus_with_holes(), **options)  # type: ignore[arg-type]


def _estimate_in_all_ways() -> None:
    for robust in (False, True):
        for conditions in (False, True):
            _estimate(robust=robust, conditions=conditions)
    _estimate(radius=0.5)
    _estimate(rings=2, alpha=0.8, robust=True)
    _estimate(rings=2, alpha=0.8, fallbacks="paper", fold_test="crossings")


def _estimate_points() -> None:
    points = _torus_with_holes()[0]
    estimate_vertex_geometry(points, None)
    estimate_vertex_geometry(points, None, viewpoint=(0.0, 0.0, 0.0))
    smooth(points)


def _smooth() -> None:
    for method in ("auto", "paper"):
        smooth(*_torus_with_holes(), method)
    ball = sphere(resolution=8)  # closed: its volume is kept
    smooth(ball.vertices * (1.0 + 0.02 * np.random.default_rng(0).standard_normal((len(ball.vertices), 1))), ball.faces)


def _fill() -> None:
    block, faces = block_with_sharp_edges(resolution=8)
    for place in ((-0.5, -0.5, 0.0), (-0.5, -0.5, -0.5)):  # an edge and a corner
        fill_holes(block, _remove_faces_near(block, faces, place))
    for method in ("auto", "paper"):
        fill_holes(*_torus_with_holes(), method)
    bridge_holes(*_torus_with_holes(), [(0, 1)])
    ball = sphere(resolution=24)
    fill_holes(ball.vertices, _remove_faces_near(ball.vertices, ball.faces, (0.9, 0.0, 0.0)))


def _ask_surface() -> None:
    surface = fit_surface(*_torus_with_holes())
    surface.query(np.zeros((1, 3)))
    surface.evaluate([0], [[0.2, 0.3]])


def _remesh() -> None:
    remesh(*_torus_with_holes(), iterations=1)
    subdivide(*_torus_with_holes())


def _find_lines() -> None:
    find_creases(*block_with_sharp_edges(resolution=8))


def _trace_lines() -> None:
    ring = torus(resolution=12)
    trace_lines(fit_surface(ring.vertices, ring.faces), spacing=0.5)


def _inspect() -> None:
    ring = torus(resolution=12)
    for faces in (ring.faces, None):
        compare(ring.vertices, faces, *_torus_with_holes())
    measure(ring.vertices, ring.faces, repeats=0)


def _run_tiles() -> None:
    if importlib.util.find_spec("distributed") is None:  # without the extra `scale`
        return
    from bezier_filters.scale import estimate_file, smooth_file, surface_at_file

    with tempfile.TemporaryDirectory() as folder:
        files = Path(folder, "vertices.npy"), Path(folder, "faces.npy")
        vertices, faces = _torus_with_holes()
        np.save(files[0], vertices)
        np.save(files[1], faces)
        for function in (estimate_file, smooth_file):
            function(files, Path(folder, "out.ply"), tile_vertices=256, scheduler="synchronous")
        surface_at_file(files, np.zeros((1, 3)), tile_vertices=256, scheduler="synchronous")


def _run_rare_cases() -> None:
    """Call kernels that only large or unusual meshes need."""
    nothing = np.zeros(0, np.int32)
    many = Rows(np.zeros(MIN_REORDER_VERTICES + 1, np.int32), nothing)
    has_locality(Adjacency(many, many, np.zeros(MIN_REORDER_VERTICES, np.bool_)))
    next_unseen(np.zeros(1, np.bool_), 0)
    grow_component(Rows(np.zeros(2, np.int32), nothing), 0, np.zeros(1, np.bool_), 1)
    faces_at_edges(np.array([[0, 1, 2]], np.int32), nothing, nothing)
    ball = sphere(resolution=12)
    diameter(ball.vertices)
    square = np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 3.0], [0.0, 3.0]])
    loops = np.arange(4, dtype=np.int32), np.array([4, 7, 6, 5], np.int32)
    triangulate_polygon(np.vstack([square, square / 3.0 + 1.0]), loops, np.empty((0, 2), np.int32))
    polyharmonic_continuation(ball.vertices, ball.faces, ball.vertices[:-4].copy())
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "one.ply")
        file.write_bytes(_PLY)
        count_mesh(file)


STAGES: tuple[dict[str, Callable[[], None]], ...] = (
    {
        "fits": compile_fit,
        "robust fits": partial(compile_fit, robust=True),
        "preparation": compile_the_rest,
        "fits with condition numbers": partial(compile_fit, conditions=True),
        "robust fits with condition numbers": partial(compile_fit, robust=True, conditions=True),
    },
    {
        "holes": _fill,
        "smoothing": _smooth,
        "point clouds": _estimate_points,
        "estimates": _estimate_in_all_ways,
        "surfaces": _ask_surface,
        "feature lines": _find_lines,
        "surfaces and lines on them": _trace_lines,
        "remeshing": _remesh,
        "inspection": _inspect,
        "tiles": _run_tiles,
        "rare cases": _run_rare_cases,
    },
)
"""Jobs by name, in stages, the longest first."""
