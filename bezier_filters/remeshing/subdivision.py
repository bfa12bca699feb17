"""Subdivision of a mesh on the surface of its patches: `subdivide` and its result."""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.errors import InvalidParameterError, is_integer, is_real
from bezier_filters.meshes.mesh import TriangleMesh, check_has_faces, check_selection, takes_meshes
from bezier_filters.meshes.mesh_objects import MeshLike
from bezier_filters.meshes.unit_size import LENGTH, normalizes_size
from bezier_filters.patch_surface.surface import Surface
from bezier_filters.patch_surface.surface_fit import fit_surface
from bezier_filters.remeshing.edge_splitting import (
    FaceEdges,
    NestedFaces,
    face_edges,
    include_longest_edges,
    nest_faces,
    split_edges,
)
from bezier_filters.remeshing.step_progress import StepProgress
from bezier_filters.remeshing.surface_places import Positions, find_positions, find_vertices
from bezier_filters.result_tables import Table, TabularResult
from bezier_filters.runtime.parallel import Progress, runs_on_threads

MAX_ITERATIONS = 10  # each makes four faces of one
MAX_ROUNDS = 40  # splits of edges for a tolerance; 20 make a millionth of an edge
# Splits halve the largest error of a face in this many rounds where they help, and mostly make a 64th of it. Where
# the surface has a step, as noise makes, they never end. Three, four or six rounds leave five faces of one
# noisy torus.
ROUNDS_TO_HALVE = 6
MAX_FACES = 50_000_000  # of a result, which has 5 GB then
# Faces that one becomes, over the ratio of its chord error to the tolerance: spheres, tori, tubes, ellipsoids and stars
# have 0.7 to 2.8.
FACES_PER_RATIO = 1.6
DISTANCE_ROUNDING = 4e-15  # error of the distance of a midpoint from the surface over the coordinates
# Noise in mean edges up to which old vertices stay: they are as far from the surface, and angles of faces change by
# some of 0.1 degrees.
MAX_STAYING_NOISE = 0.002


@dataclass(frozen=True, repr=False)
class SubdivisionResult(TabularResult):
    """A mesh with more vertices on the surface of its patches.

    Attributes
    ----------
    vertices : (n, 3) float64
        The old vertices in their order, and the new ones after them.
    faces : (m, 3) int32
        Ordered by the old face in which they lie.
    old_faces : (m,) int32
        That old face, a row of the given mesh.
    coordinates : (m, 3, 2) float64
        Barycentric coordinates of the corners in it, of its second and third corner.
    flat_vertices : (k,) int32
        Vertices on a face of the given mesh, because the surface has no place over it: where patches are missing or
        fold.
    unresolved_faces : (k,) int32
        Old faces where edges stay farther from the surface than the tolerance, because splits do not bring them nearer:
        the surface has a step there, as strong noise makes.
    moved : bool
        Whether old vertices moved onto the surface.
    chord_error : float
        Largest distance of the midpoint of a new edge from the surface, a length; None without a tolerance.
    noise : float or None
        Standard deviation of the noise along the normal, a length; None if it could not be estimated.
    """

    vertices: FloatArray = field(metadata=LENGTH)
    faces: IntArray
    old_faces: IntArray
    coordinates: FloatArray
    flat_vertices: IntArray
    unresolved_faces: IntArray
    moved: bool
    chord_error: float | None = field(metadata=LENGTH)
    noise: float | None = field(metadata=LENGTH)

    def __repr__(self) -> str:
        """One line: the numbers of vertices and faces."""
        return f"SubdivisionResult({len(self.vertices)} vertices, {len(self.faces)} faces)"

    def _tables(self) -> list[Table]:
        rows: list[list[object]] = [
            ["vertices", len(self.vertices)],
            ["faces", len(self.faces)],
            ["vertices on old faces", len(self.flat_vertices)],
            ["faces beyond the tolerance", len(self.unresolved_faces)],
            ["old vertices moved", "yes" if self.moved else "no"],
            ["chord error", self.chord_error],
        ]
        return [Table("subdivision", ["", ""], rows)]

    def _columns(self) -> dict[str, list[object]]:
        """One row."""
        counts: dict[str, list[object]] = {"vertices": [len(self.vertices)], "faces": [len(self.faces)]}
        return counts | {"moved": [self.moved], "chord_error": [self.chord_error], "noise": [self.noise]}


@takes_meshes
@normalizes_size("tolerance", "noise")
@runs_on_threads
def subdivide(
    vertices: ArrayLike | MeshLike,
    faces: ArrayLike | None = None,
    *,
    iterations: int | None = None,
    tolerance: float | None = None,
    selected: BoolArray | None = None,
    move: bool | None = None,
    noise: float | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> SubdivisionResult:
    """Make a mesh finer, with new vertices on the surface of its patches.

    Every face becomes four, or edges are split only where they are farther from the surface than a tolerance. The
    surface is that of `fit_surface`: curved between vertices, sharp at sharp edges, where it lies on both sides, and
    free of the noise. It ends over the border edges of the mesh.

    Parameters
    ----------
    vertices : (n, 3) array_like of float, or mesh object
        Coordinates; or a mesh of another library, see `mesh_arrays`, and no faces.
    faces : (m, 3) array_like of int
        Triangles, counter-clockwise seen from outside.
    iterations : int, optional
        How often every face becomes four, 1 if no tolerance is given; at most 10.
    tolerance : float, optional
        Split only edges whose midpoints are farther from the surface, a length, until none is, or splits do not help.
        With any edge of a face its longest one is split, so that angles stay above half of those of the mesh.
    selected : (m,) bool, optional
        Faces to subdivide; their neighbours are divided at common edges.
    move : bool, optional
        Whether old vertices move onto the surface. By default they do where the noise is more than 0.002 mean edges;
        otherwise the surface is drawn through them. False draws it through noisy ones, too: their distances from it,
        interpolated linearly over faces, are added.
    noise : float, optional
        Standard deviation of the noise along the normal, a length; by default it is estimated. 0 interpolates.
    threads : int, optional
        Number of threads; by default BEZIER_FILTERS_THREADS or all usable cores. The result does not depend on it.
    progress : callable, optional
        ``progress(done, total)`` as in `estimate_vertex_geometry`, for the fits, and then for the rounds of splits.

    Returns
    -------
    SubdivisionResult

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
    >>> from bezier_filters.surfaces import sphere
    >>> ball = sphere(resolution=8)
    >>> finer = subdivide(ball.vertices, ball.faces, iterations=2)
    >>> finer
    SubdivisionResult(10242 vertices, 20480 faces)
    >>> bool(np.abs(np.linalg.norm(finer.vertices, axis=1) - 1.0).max() < 1e-4)
    True
    """
    _check(iterations, tolerance)
    check_has_faces(faces)
    surface = fit_surface(vertices, faces, noise=noise, progress=progress)
    mesh, sigma = surface.mesh, surface.geometry.noise_sigma
    chosen = np.ones(mesh.face_count, np.bool_) if selected is None else check_selection(selected, mesh.face_count)
    _check_size(int(chosen.sum()) * 4 ** (iterations or (1 if tolerance is None else 0)))
    if move is None:
        move = are_moved(surface)
    count = iterations or (1 if tolerance is None else 0)
    refinement = _Refinement(surface, chosen, StepProgress(progress, count), moves=bool(move))
    for _ in range(count):
        refinement.divide_all()
        refinement.progress.advance()
    chord_error, unresolved = (None, np.empty(0, np.int32)) if tolerance is None else refinement.divide_to(tolerance)
    refinement.progress.finish()
    return SubdivisionResult(
        refinement.vertices,
        refinement.nested.faces,
        refinement.nested.parents,
        refinement.nested.coordinates,
        np.flatnonzero(refinement.on_face).astype(np.int32),
        unresolved,
        bool(move),
        chord_error,
        sigma,
    )


def _check(iterations: int | None, tolerance: float | None) -> None:
    if iterations is not None and not (is_integer(iterations) and 1 <= iterations <= MAX_ITERATIONS):
        raise InvalidParameterError(f"iterations: got {iterations!r}, expected an integer from 1 to {MAX_ITERATIONS}")
    if tolerance is not None and not (is_real(tolerance) and 0.0 < tolerance < np.inf):
        raise InvalidParameterError(f"tolerance: got {tolerance!r}, expected a positive length")


def _check_size(face_count: int) -> None:
    if face_count > MAX_FACES:
        raise InvalidParameterError(
            f"the result would have some {face_count:,} faces, more than {MAX_FACES:,}: fewer iterations or a larger "
            "tolerance are needed"
        )


def predict_faces(tolerance: float, errors: FloatArray) -> float:
    """Number of faces after splits to a tolerance, given the largest chord error of each face, (m,).

    Half an edge has a quarter of its error, so that faces become four until it is below the tolerance.
    """
    return float(np.maximum(FACES_PER_RATIO * errors / tolerance, 1.0).sum())


def check_tolerance(tolerance: float, errors: FloatArray) -> None:
    """Refuse a tolerance that makes too many faces, given the largest chord error of each face, (m,)."""
    count = predict_faces(tolerance, errors)
    if count <= MAX_FACES:
        return
    least = tolerance
    while predict_faces(least, errors) > MAX_FACES:  # at each factor, or else faces that are not split are most
        least *= max(predict_faces(least, errors) / MAX_FACES, 1.01)
    raise InvalidParameterError(
        f"tolerance: got {tolerance:g}, which would make some {count:.2g} faces, more than {MAX_FACES:,}; the smallest "
        f"tolerance that fits is about {1.06 * least:.2g}"
    )


def are_moved(surface: Surface) -> bool:
    """Whether old vertices move onto the surface by default."""
    return (surface.geometry.noise_sigma or 0.0) > MAX_STAYING_NOISE * mean_edge(surface.mesh)


def mean_edge(mesh: TriangleMesh) -> float:
    """Mean length of the edges of all faces."""
    corners = mesh.vertices[mesh.faces]
    return float(np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2).mean())


class _Refinement:
    """A mesh that is being refined on a surface."""

    def __init__(self, surface: Surface, chosen: BoolArray, progress: StepProgress, *, moves: bool) -> None:
        self.surface, self.chosen, self.progress, mesh = surface, chosen, progress, surface.mesh
        self.nested = nest_faces(mesh.faces)
        n, found = mesh.vertex_count, find_vertices(surface)
        used = np.zeros(n, dtype=np.bool_)
        used[mesh.faces[chosen]] = True
        residuals = np.where(used[:, np.newaxis], mesh.vertices - found.points, 0.0)
        moving = used & ~found.on_face if moves else np.zeros(n, dtype=np.bool_)
        self.vertices = np.where(moving[:, np.newaxis], found.points, mesh.vertices)
        self.residuals = np.where(moving[:, np.newaxis], 0.0, residuals)  # (n, 3): of old vertices from the surface
        self.on_face = used & found.on_face

    def divide_all(self) -> None:
        """Make four faces of each chosen one, and divide their neighbours."""
        edges = face_edges(self.nested.faces, len(self.vertices))
        marked = np.zeros(len(edges.ends), dtype=np.bool_)
        marked[edges.of_face[self.chosen[self.nested.parents]]] = True
        self._split(edges, marked)

    def divide_to(self, tolerance: float) -> tuple[float, IntArray]:
        """Split edges until their midpoints are within a tolerance of the surface, or this does not help.

        Returns the largest distance, and the old faces where it is beyond the tolerance.
        """
        is_open = self.chosen.copy()
        peaks: list[FloatArray] = []  # (m,) after each round: the largest distance so far in each old face
        largest, tested, rounding = 0.0, self.nested, DISTANCE_ROUNDING * float(np.abs(self.vertices).max())
        for k in range(MAX_ROUNDS):
            edges = face_edges(self.nested.faces, len(self.vertices))
            marked = np.zeros(len(edges.ends), dtype=np.bool_)
            marked[edges.of_face[is_open[self.nested.parents] & self.nested.is_new]] = True
            tested, ids = self.nested, np.flatnonzero(marked)
            middles = 0.5 * self.vertices[edges.ends[ids]].sum(axis=1)
            distances = np.linalg.norm(self._middles(tested, edges, marked).points - middles, axis=1)
            distances[distances < rounding] = 0.0
            of_edge = np.zeros(len(marked))
            of_edge[ids] = distances
            if k == 0:
                check_tolerance(tolerance, of_edge[edges.of_face].max(axis=1))
                # two rounds of bisection quarter the largest distance
                self.progress.total += 1 + int(
                    2.0 * np.log(max(distances.max(initial=0.0) / tolerance, 1.0)) / np.log(4.0)
                )
            worst = np.zeros(self.surface.mesh.face_count)
            np.maximum.at(worst, tested.parents, of_edge[edges.of_face].max(axis=1))
            peaks.append(np.maximum(worst, peaks[-1]) if peaks else worst)
            if k >= ROUNDS_TO_HALVE:
                is_open &= worst <= np.maximum(tolerance, 0.5 * peaks[k - ROUNDS_TO_HALVE])
            can_split = np.zeros(len(marked), dtype=np.bool_)
            can_split[edges.of_face[is_open[tested.parents]]] = True
            far = (distances > tolerance) & can_split[ids]
            largest = max(largest, float(distances[~far].max(initial=0.0)))
            if not far.any():
                break
            marked[ids[~far]] = False
            self.progress.advance()
            self._split(edges, include_longest_edges(TriangleMesh(self.vertices, tested.faces), edges, marked))
        else:
            largest = max(largest, float(distances.max()))
        return largest, np.flatnonzero(self.chosen & ~is_open).astype(np.int32)

    def _split(self, edges: FaceEdges, marked: BoolArray) -> None:
        n = len(self.vertices)
        _check_size(len(self.nested.faces) + 2 * int(np.count_nonzero(marked)))
        found = self._middles(self.nested, edges, marked)
        middle = np.where(marked, n + np.cumsum(marked) - 1, -1)
        self.nested = split_edges(self.nested, self.vertices, edges, middle)
        self.vertices = np.vstack([self.vertices, found.points])
        self.on_face = np.concatenate([self.on_face, found.on_face])

    def _middles(self, nested: NestedFaces, edges: FaceEdges, marked: BoolArray) -> Positions:
        """Positions for the midpoints of the marked edges, with the interpolated residuals of old vertices."""
        rows, corner = np.nonzero(marked[edges.of_face])
        owner = (np.cumsum(marked) - 1)[edges.of_face[rows, corner]]
        parents, coordinates = nested.parents[rows], nested.midpoints()[rows, corner]
        count = int(np.count_nonzero(marked))
        found = find_positions(self.surface, owner, parents, coordinates, count, self.progress.within)
        weights = np.column_stack([1.0 - coordinates.sum(axis=1), coordinates])
        residuals = np.einsum("qk,qkd->qd", weights, self.residuals[self.surface.mesh.faces[parents]])
        residuals[found.on_face[owner]] = 0.0
        of_owner = np.empty((count, 3))
        of_owner[owner] = residuals  # the same from all faces at an edge
        return replace(found, points=found.points + of_owner)
