"""Remeshing of a surface: `remesh` and its result."""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.errors import InvalidMeshError, InvalidParameterError, is_integer, is_real
from bezier_filters.meshes.half_edges import distinct_edges
from bezier_filters.meshes.mesh import TriangleMesh, check_has_faces, check_selection, takes_meshes
from bezier_filters.meshes.mesh_objects import MeshLike
from bezier_filters.meshes.unit_size import LENGTH, normalizes_size
from bezier_filters.patch_surface.surface import Surface
from bezier_filters.patch_surface.surface_fit import fit_surface
from bezier_filters.remeshing.edge_lengths import curvature_sizing, length_for_count, uniform_sizing
from bezier_filters.remeshing.edge_splitting import face_edges
from bezier_filters.remeshing.isotropic import (
    FIXED,
    FREE,
    MAX_FACE_GROWTH,
    ON_CURVE,
    STEPS,
    WorkingMesh,
    remesh_surface,
)
from bezier_filters.remeshing.kept_curves import CurvePlaces, find_chains, initial_edges, kept_edges
from bezier_filters.remeshing.step_progress import StepProgress
from bezier_filters.remeshing.subdivision import MAX_FACES, are_moved, mean_edge
from bezier_filters.remeshing.surface_places import check_places, find_vertices
from bezier_filters.remeshing.vertex_count import COUNT_ITERATIONS, COUNT_ROUNDS, check_vertex_count, remesh_to_count
from bezier_filters.result_tables import Table, TabularResult
from bezier_filters.runtime.parallel import Progress, runs_on_threads

MAX_REMESHING_ITERATIONS = 100
MIN_LENGTH_RATIO = 0.05  # of edges by curvature to the mean old one: finer curvature is not known
MAX_LENGTH_RATIO = 0.1  # of edges by curvature to the diagonal of the bounding box


@dataclass(frozen=True, repr=False)
class RemeshingResult(TabularResult):
    """A new mesh of a surface.

    Attributes
    ----------
    vertices : (n, 3) float64
        Vertices on the surface, none without faces.
    faces : (m, 3) int32
        Triangles, oriented as the old ones.
    old_vertices : (n,) int32
        Old vertex that each is, or -1; corners of the kept curves are.
    vertex_faces : (n,) int32
        Old face below each vertex.
    vertex_coordinates : (n, 2) float64
        Barycentric coordinates in it, of its second and third corner.
    old_faces : (m,) int32
        Old face below the middle of each face.
    chord_error : float
        Largest distance of the midpoint of an edge from the surface, a length.
    noise : float or None
        Standard deviation of the noise along the normal, a length; None if it could not be estimated.
    requested_vertices : int or None
        The number of vertices that was asked for, if it was.
    """

    vertices: FloatArray = field(metadata=LENGTH)
    faces: IntArray
    old_vertices: IntArray
    vertex_faces: IntArray
    vertex_coordinates: FloatArray
    old_faces: IntArray
    chord_error: float = field(metadata=LENGTH)
    noise: float | None = field(metadata=LENGTH)
    requested_vertices: int | None = None

    @property
    def has_requested_vertices(self) -> bool:
        """Whether the number of vertices is within a tenth of the requested one, or none was."""
        wanted = self.requested_vertices
        return wanted is None or abs(len(self.vertices) - wanted) <= max(0.1 * wanted, 1.0)

    def __repr__(self) -> str:
        """One line: the numbers of vertices and faces."""
        return f"RemeshingResult({len(self.vertices)} vertices, {len(self.faces)} faces)"

    def _tables(self) -> list[Table]:
        rows: list[list[object]] = [
            ["vertices", len(self.vertices)],
            ["faces", len(self.faces)],
            ["chord error", self.chord_error],
        ]
        if not self.has_requested_vertices:
            rows.append(["requested vertices", self.requested_vertices])
        return [Table("remeshing", ["", ""], rows)]

    def _columns(self) -> dict[str, list[object]]:
        """One row."""
        counts: dict[str, list[object]] = {"vertices": [len(self.vertices)], "faces": [len(self.faces)]}
        return counts | {"chord_error": [self.chord_error], "noise": [self.noise]}


@takes_meshes
@normalizes_size("length", "tolerance", "noise")
@runs_on_threads
def remesh(
    vertices: ArrayLike | MeshLike,
    faces: ArrayLike | None = None,
    *,
    length: float | None = None,
    vertex_count: int | None = None,
    tolerance: float | None = None,
    selected: BoolArray | None = None,
    edges: IntArray | None = None,
    iterations: int = 10,
    noise: float | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> RemeshingResult:
    """Make a new mesh of regular triangles whose vertices lie on the surface of the patches.

    The surface is that of `fit_surface`: curved between vertices and free of the noise. Triangles are nearly
    equilateral, with edges of one length, or shorter where the surface is curved. Edges are split, collapsed and
    flipped, and vertices relaxed, as Botsch and Kobbelt do ("A remeshing approach to multiresolution modeling", 2004).
    Sharp edges, borders and given edges stay: they become chains of edges, with their corners.

    Parameters
    ----------
    vertices : (n, 3) array_like of float, or mesh object
        Coordinates; or a mesh of another library, see `mesh_arrays`, and no faces.
    faces : (m, 3) array_like of int
        Triangles, counter-clockwise seen from outside.
    length : float, optional
        Length of the edges; by default the mean of the old ones. With a tolerance, the largest one, by default a tenth
        of the diagonal of the bounding box.
    vertex_count : int, optional
        Number of vertices instead of a length, reached to within some percent. The topology of the surface needs some;
        and where large triangles would lean away from it, the mesh stays finer, with more vertices.
    tolerance : float, optional
        Distance of triangles from the surface, a length, from which the lengths of edges follow by the curvature. With
        few triangles on nearly flat parts it decimates a mesh. The result says how large distances are.
    selected : (m,) bool, optional
        Faces to remesh; the others stay.
    edges : (e, 2) array_like of int, optional
        Other edges that are kept, pairs of vertices.
    iterations : int
        Number of iterations, at most 100.
    noise : float, optional
        Standard deviation of the noise along the normal, a length; by default it is estimated. 0 interpolates.
    threads : int, optional
        Number of threads; by default BEZIER_FILTERS_THREADS or all usable cores. The result does not depend on it.
    progress : callable, optional
        ``progress(done, total)`` as in `estimate_vertex_geometry`, for the fits, and then for the iterations.

    Returns
    -------
    RemeshingResult

    Raises
    ------
    InvalidMeshError
        If the arrays are not a mesh with faces and finite coordinates.
    InvalidParameterError
        If a parameter is out of range, or the result would have more than 50 million faces.
    CancelledError
        If `progress` returned False.

    Examples
    --------
    >>> from bezier_filters.surfaces import torus
    >>> ring = torus(resolution=24, jitter=0.3)
    >>> even = remesh(ring.vertices, ring.faces, vertex_count=2000)
    >>> bool(abs(len(even.vertices) - 2000) < 40)
    True
    >>> heights = np.hypot(np.hypot(*even.vertices[:, :2].T) - 1.0, even.vertices[:, 2]) - 0.4
    >>> bool(np.abs(heights).max() < 1e-4)
    True
    """
    _check(length, vertex_count, tolerance, iterations)
    check_has_faces(faces)
    surface = fit_surface(vertices, faces, noise=noise, progress=progress)
    m = surface.mesh.face_count
    _check_manifold(surface.mesh)
    if not mean_edge(surface.mesh) > 0.0:
        raise InvalidMeshError("vertices: all are in one place; there is nothing to remesh")
    chosen = np.ones(m, np.bool_) if selected is None else check_selection(selected, m)
    if vertex_count is not None:
        check_vertex_count(vertex_count, surface.mesh.faces[chosen], surface.mesh.vertex_count)
    extra = _check_edges(edges, surface.mesh.vertex_count)
    corrections = 0 if vertex_count is None else COUNT_ROUNDS * COUNT_ITERATIONS
    steps = StepProgress(progress, STEPS * (iterations + corrections))
    mesh = _working_mesh(surface, chosen, extra, steps)
    size = mean_edge(surface.mesh) if length is None else length
    if length is vertex_count is tolerance is None:
        _check_growth(mesh, size)
    if vertex_count is not None:
        mesh = remesh_to_count(mesh, vertex_count, iterations)
    elif tolerance is None:
        _check_size(mesh, size)
        remesh_surface(mesh, uniform_sizing(size), iterations)
    else:
        longest = MAX_LENGTH_RATIO * float(np.linalg.norm(np.ptp(surface.mesh.vertices, axis=0)))
        sizing = curvature_sizing(
            tolerance, MIN_LENGTH_RATIO * mean_edge(surface.mesh), longest if length is None else length
        )
        remesh_surface(mesh, sizing, iterations)
    result = replace(_result(mesh, surface, chosen), requested_vertices=vertex_count)
    steps.finish()
    return result


def _check(length: float | None, vertex_count: int | None, tolerance: float | None, iterations: int) -> None:
    for name, value in (("length", length), ("tolerance", tolerance)):
        if value is not None and not (is_real(value) and 0.0 < value < np.inf):
            raise InvalidParameterError(f"{name}: got {value!r}, expected a positive length")
    if vertex_count is not None and not (is_integer(vertex_count) and 4 <= vertex_count <= MAX_FACES // 2):
        raise InvalidParameterError(
            f"vertex_count: got {vertex_count!r}, expected an integer from 4 to {MAX_FACES // 2}"
        )
    if vertex_count is not None and (length is not None or tolerance is not None):
        raise InvalidParameterError("vertex_count: a number of vertices excludes a length and a tolerance")
    if not (is_integer(iterations) and 1 <= iterations <= MAX_REMESHING_ITERATIONS):
        raise InvalidParameterError(
            f"iterations: got {iterations!r}, expected an integer from 1 to {MAX_REMESHING_ITERATIONS}"
        )


def _check_growth(mesh: WorkingMesh, length: float) -> None:
    count = (length_for_count(mesh.points, mesh.faces, 1.0) / length) ** 2
    if count > MAX_FACE_GROWTH * len(mesh.faces):
        raise InvalidParameterError(
            f"length: the mean edge would make some {count:,.0f} faces of {len(mesh.faces):,}, as a few are far larger "
            "than the others; give a length"
        )


def _check_manifold(mesh: TriangleMesh) -> None:
    _, _, count = distinct_edges(mesh.faces, mesh.vertex_count)
    if (count > 2).any():
        raise InvalidMeshError(
            f"faces: {int((count > 2).sum()):,} edges have three faces or more; split or remove faces there, as "
            "meshing_repair_non_manifold_edges of pymeshlab does"
        )


def _check_edges(edges: IntArray | None, n: int) -> IntArray:
    if edges is None:
        return np.zeros((0, 2), dtype=np.int32)
    try:
        found = np.asarray(edges)
    except ValueError as error:
        raise InvalidParameterError(f"edges: expected integers of shape (e, 2); {error}") from None
    if not found.size:
        return np.zeros((0, 2), dtype=np.int32)
    if found.ndim != 2 or found.shape[1] != 2 or found.dtype.kind not in "iu":
        raise InvalidParameterError(f"edges: got shape {found.shape}, expected integers of shape (e, 2)")
    if len(found) and not (found.min() >= 0 and found.max() < n):
        raise InvalidParameterError(f"edges: expected vertices from 0 to {n - 1}")
    return found.astype(np.int32)


def _check_size(mesh: WorkingMesh, length: float) -> None:
    count = (length_for_count(mesh.points, mesh.faces, 1.0) / length) ** 2
    if count > MAX_FACES:
        raise InvalidParameterError(f"length: the result would have some {count:,.0f} faces, more than {MAX_FACES:,}")


def _working_mesh(surface: Surface, chosen: BoolArray, extra: IntArray, progress: StepProgress) -> WorkingMesh:
    """The mesh of the chosen faces, and all vertices of the others, which are fixed."""
    mesh = surface.mesh
    n, found = mesh.vertex_count, find_vertices(surface)
    all_edges = face_edges(mesh.faces, n)
    parts = np.bincount(all_edges.of_face.ravel(), np.repeat(chosen, 3), len(all_edges.ends))
    frozen = all_edges.ends[(parts > 0) & (parts < np.bincount(all_edges.of_face.ravel()))]
    kept = kept_edges(surface, np.vstack([extra, frozen]))
    number = {tuple(pair): k for k, pair in enumerate(np.sort(all_edges.ends, axis=1).tolist())}
    kept = np.array([pair for pair in kept.tolist() if parts[number.get(tuple(pair), 0)] > 0 and tuple(pair) in number])
    kept = kept.reshape(-1, 2).astype(np.int32)
    fixed = np.zeros(n, dtype=np.bool_)
    fixed[mesh.faces[~chosen]] = True
    chains = find_chains(mesh.vertices, kept, fixed)
    stay = set(map(tuple, np.sort(frozen, axis=1).tolist()))
    is_frozen = np.array([tuple(pair) in stay for pair in np.sort(chains.ends, axis=1).tolist()], dtype=np.bool_)
    kind = np.full(n, FREE)
    kind[chains.ends] = ON_CURVE
    kind[fixed] = FIXED
    points = np.where(((kind != FIXED) | are_moved(surface))[:, np.newaxis], found.points, mesh.vertices)
    of_others = np.zeros(n, dtype=np.bool_)
    of_others[mesh.faces[~chosen]] = True
    points[of_others] = mesh.vertices[of_others]
    place_face, place = np.zeros(n, dtype=np.int32), np.zeros((n, 2))
    rows = np.repeat(np.arange(mesh.face_count, dtype=np.int32), 3)
    place_face[mesh.faces.ravel()] = rows
    place[mesh.faces.ravel()] = np.tile([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]], (mesh.face_count, 1))
    working = WorkingMesh(
        surface,
        initial_edges(chains, is_frozen),
        CurvePlaces(surface, chains),
        points,
        mesh.faces[chosen],
        kind,
        place_face,
        place,
        np.zeros((n, 3)),
        found.curvatures,
        np.where(kind == FIXED, np.arange(n, dtype=np.int32), np.int32(-1)),
        progress,
    )
    unused = np.ones(n, dtype=np.bool_)
    unused[mesh.faces] = False
    working.kind[unused] = FREE
    working.lengths = np.zeros(n)
    working.drop_unused()
    working.project()
    return working


def _result(mesh: WorkingMesh, surface: Surface, chosen: BoolArray) -> RemeshingResult:
    """The new faces with the old ones that were not chosen."""
    n_old = surface.mesh.vertex_count
    row_of_old = np.full(n_old, -1)
    kept = mesh.old >= 0
    row_of_old[mesh.old[kept]] = np.flatnonzero(kept)
    cancel = mesh.progress.within
    below = surface.query(mesh.points[mesh.faces].mean(axis=1), progress=cancel).faces
    others = np.flatnonzero(~chosen)
    faces = np.vstack([row_of_old[surface.mesh.faces[others]], mesh.faces]).astype(np.int32)
    edges = face_edges(mesh.faces, len(mesh.points))
    middles = mesh.points[edges.ends].mean(axis=1)
    on_surface, _, _ = check_places(surface, surface.query(middles, progress=cancel))
    distances = np.linalg.norm(on_surface - middles, axis=1)
    return RemeshingResult(
        mesh.points,
        faces,
        mesh.old,
        mesh.place_face,
        mesh.place,
        np.concatenate([others, below]).astype(np.int32),
        float(distances.max(initial=0.0)),
        surface.geometry.noise_sigma,
    )
