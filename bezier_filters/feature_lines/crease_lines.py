"""Crease lines of a mesh: chains of sharp edges, and crest lines (ridges and ravines) of the smooth surface.

Sharp edges are detected on the denoised surface if noise hides them. Crest lines follow the zeros of the extremality,
the derivative of a principal curvature along its own direction; see `crest_lines`. Both are joined to polylines with a
strength, the integral of curvature along the line, and a certainty with respect to noise.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from math import radians
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.errors import InvalidMeshError, InvalidParameterError, is_real
from bezier_filters.estimation.estimate import estimate_vertex_geometry
from bezier_filters.estimation.hidden_edges import RESIDUAL_NOISE_FRACTION, hides_sharp_edges, noise_free_surface
from bezier_filters.feature_lines.crest_lines import crest_segments, interpolate_on_edges, ridge_and_ravine_fields
from bezier_filters.feature_lines.polylines import join_polylines
from bezier_filters.fields import CREASES, column_names
from bezier_filters.fitting.noise_level import is_noisy, learn_mesh_noise
from bezier_filters.fitting.vertex_geometry import VertexGeometry
from bezier_filters.meshes.half_edges import MeshEdges, mesh_edges
from bezier_filters.meshes.mesh import takes_meshes, triangle_mesh
from bezier_filters.meshes.mesh_objects import MeshLike
from bezier_filters.meshes.prepared_mesh import PreparedMesh, prepare_mesh
from bezier_filters.meshes.sharp_edges import SHARP_ANGLE, certainties, sharp_edges
from bezier_filters.meshes.unit_size import LENGTH, normalizes_size
from bezier_filters.result_tables import Table, TabularResult
from bezier_filters.runtime.parallel import Progress, runs_on_threads
from bezier_filters.status import FitStatus

CreaseKind = Literal["ridge", "ravine"]
# red, green and blue of the lines wherever they are drawn
COLORS = {"ridge": (0.8, 0.1, 0.1), "ravine": (0.1, 0.2, 0.8)}
MIN_CREST_DEGREE = 3  # of a patch with third derivatives, which the extremality needs
LINE_CODES = {"ridge": 1.0, "ravine": -1.0}  # in the vertex columns; sharp lines have them times the next factor
SHARP_CODE_FACTOR = 2.0
MIN_SHARP_LINE_EDGES = 3  # of a sharp line with a free end: noise makes shorter ones


class _LineMeasures:
    """What follows from the points of a line; fields of a `CreaseLine` of these names."""

    points: FloatArray
    edges: IntArray
    shares: FloatArray

    @property
    def is_closed(self) -> bool:
        """Whether the first and the last point coincide."""
        return bool((self.edges[0] == self.edges[-1]).all())

    @property
    def nearest_vertices(self) -> IntArray:
        """Nearest vertex of each point, (k,): the nearer end of its edge."""
        first_is_nearer = self.shares <= 0.5
        return np.asarray(np.where(first_is_nearer, self.edges[:, 0], self.edges[:, 1]), dtype=np.int32)

    @property
    def length(self) -> float:
        """Length of the polyline."""
        return float(np.linalg.norm(np.diff(self.points, axis=0), axis=1).sum())


@dataclass(frozen=True, repr=False)
class CreaseLine(_LineMeasures):
    """A ridge or a ravine, sharp or smooth, as a polyline.

    Attributes
    ----------
    kind : {"ridge", "ravine"}
        Whether the surface is convex or concave across the line, seen from outside.
    is_sharp : bool
        Whether it consists of sharp edges of the mesh, rather than points of a smooth surface.
    points : (k, 3) float64
        Points in order; a closed line repeats its first point at the end.
    edges : (k, 2) int32
        Vertices of the mesh edge that contains each point; a point at a vertex repeats it.
    shares : (k,) float64
        Position of each point on its edge: 0 at the first vertex, 1 at the second.
    strength : float
        Length in radii of the curvature across the line, less where that curvature is nearly constant across it; see
        `find_creases`.
    certainties : (k - 1,) float64
        For each segment between two points, the probability that it is not an effect of noise.
    is_closed : bool
        Derived: whether the first and the last point coincide.
    nearest_vertices : (k,) int32
        Derived: nearest vertex of each point.
    length : float
        Derived: length of the polyline.
    """

    kind: CreaseKind
    is_sharp: bool
    points: FloatArray = field(metadata=LENGTH)
    edges: IntArray
    shares: FloatArray
    strength: float
    certainties: FloatArray
    is_closed: bool = field(init=False)
    nearest_vertices: IntArray = field(init=False)
    length: float = field(init=False, metadata=LENGTH)

    def __repr__(self) -> str:
        """Kind, length and strength, on one line."""
        kind = f"{'sharp ' * self.is_sharp}{self.kind}"
        return (
            f"CreaseLine({kind} of {len(self.points)} points, length {self.length:.4g}, strength {self.strength:.3g})"
        )


@dataclass(frozen=True, repr=False)
class Creases(TabularResult):
    """Crease lines of a mesh, the result of `find_creases`.

    Attributes
    ----------
    lines : tuple of CreaseLine
        In descending order of strength.
    sharp_edges : (e, 2) int32
        Vertices of all edges of the sharp lines, the smaller index first.
    certainties : (e,) float64
        Probability that the dihedral angle of each sharp edge, without noise, exceeds the limit. Edges that only
        continue a line may have less than 0.5.
    geometry : VertexGeometry
        Curvatures and extremalities that the smooth lines are computed from.
    """

    lines: tuple[CreaseLine, ...]
    sharp_edges: IntArray
    certainties: FloatArray
    geometry: VertexGeometry

    def of_kind(self, kind: CreaseKind) -> tuple[CreaseLine, ...]:
        """Lines of one kind."""
        return tuple(line for line in self.lines if line.kind == kind)

    @property
    def tells_crest_lines(self) -> bool:
        """Whether the fit has third derivatives, without which there are no smooth lines."""
        fit = self.geometry.fit
        return max([fit.degree, *(region.degree for region in fit.parts)]) >= MIN_CREST_DEGREE

    def __repr__(self) -> str:
        """Numbers of ridges and ravines, on one line."""
        note = "" if self.tells_crest_lines else "; a fit of degree 2 does not find smooth ones"
        return f"Creases({len(self.of_kind('ridge'))} ridges, {len(self.of_kind('ravine'))} ravines{note})"

    def _tables(self) -> list[Table]:
        """The lines by kind."""
        rows = []
        for kind in get_args(CreaseKind):
            for is_sharp in (True, False):
                lines = [line for line in self.of_kind(kind) if line.is_sharp == is_sharp]
                strongest = max((line.strength for line in lines), default=None)
                length = sum((line.length for line in lines), 0.0)
                rows.append([f"{'sharp ' * is_sharp}{kind}s", len(lines), length, strongest])
        header = ["", "lines", "length [length]", "strongest"]
        return [Table(f"{len(self.lines):,} lines", header, rows)]

    def _columns(self) -> dict[str, list[object]]:
        """A row for each line."""
        names = ("kind", "is_sharp", "is_closed", "length", "strength")
        counts: dict[str, list[object]] = {"points": [len(line.points) for line in self.lines]}
        return counts | {name: [getattr(line, name) for line in self.lines] for name in names}


def crease_columns(creases: Creases) -> dict[str, FloatArray]:
    """Code and strength of the strongest line at each vertex, by column name."""
    codes, strengths = np.zeros((2, len(creases.geometry.status)))
    for line in reversed(creases.lines):
        ids = line.nearest_vertices
        codes[ids] = LINE_CODES[line.kind] * (SHARP_CODE_FACTOR if line.is_sharp else 1.0)
        strengths[ids] = line.strength
    return dict(zip(column_names(CREASES), (codes, strengths), strict=True))


def edge_mesh(lines: Sequence[CreaseLine]) -> tuple[FloatArray, IntArray, IntArray]:
    """Points (k, 3) of all lines, edges (e, 2) between them, and the line number of each point (k,).

    Closed lines repeat their first point.

    >>> from bezier_filters.surfaces import block_with_sharp_edges
    >>> points, edges, line_of_point = edge_mesh(find_creases(*block_with_sharp_edges(resolution=8)).lines)
    >>> np.ptp(points, axis=0), len(points) - len(edges) == line_of_point[-1] + 1
    (array([1., 1., 1.]), np.True_)
    """
    return join_polylines([line.points for line in lines])


@takes_meshes
@normalizes_size()
@runs_on_threads
def find_creases(
    vertices: ArrayLike | MeshLike,
    faces: ArrayLike | None = None,
    geometry: VertexGeometry | None = None,
    *,
    angle: float = 40.0,
    min_strength: float = 2.0,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Creases:
    """Find the sharp edges of a mesh and its crest lines: ridges and ravines.

    On a ridge of a smooth surface, the larger principal curvature has a maximum along its own direction and exceeds the
    other one in absolute value. The extremality, its derivative along that direction, vanishes there; its zeros are
    traced across the triangles of the mesh (Ohtake, Belyaev, Seidel, "Ridge-valley lines on meshes via implicit surface
    fitting", SIGGRAPH 2004). A ravine is a ridge of the surface with reversed orientation. Edges with a large dihedral
    angle form lines of their own, and patches do not extend across them.

    The strength of a smooth line is the integral of ``k min(1, |k''| / k^3)`` along it, where k is the curvature across
    the line and k'' its second derivative in that direction: the length of the line in radii of curvature, less where
    the curvature decreases more slowly than within a radius. It is invariant under scaling. Planes, spheres, cylinders,
    cones and tori have no lines. For sharp edges, k is the curvature that the mesh resolves: the dihedral angle over
    the width of the edge (see `MeshEdges`).

    Noise makes lines, too. Sharp edges are detected on the denoised surface; if averaged normals turn slowly
    everywhere, no edge is sharp. The curvature on both sides of a smooth line must be smaller than on it, by more than
    the standard errors explain. Each line has a certainty.

    Parameters
    ----------
    vertices : (n, 3) array_like of float, or mesh object
        Coordinates; or a mesh of another library, see `mesh_arrays`, and no faces.
    faces : (m, 3) array_like of int
        Triangles, counter-clockwise seen from outside.
    geometry : VertexGeometry, optional
        Estimate for these vertices, from `estimate_vertex_geometry` with other settings than the defaults.
    angle : float
        Smallest dihedral angle of a sharp edge in degrees, above 0 and up to 180. A sharp edge must also stand out
        among the edges around it. Lines are continued straight along edges with three quarters of this angle.
    min_strength : float
        Weaker smooth lines are dropped; 0 keeps all. By default a line must be as long as the diameter of its circle of
        curvature. Isolated sharp lines of one or two edges are dropped, too.
    threads : int, optional
        Number of threads; by default BEZIER_FILTERS_THREADS or all usable cores. The result
        does not depend on it.
    progress : callable, optional
        ``progress(done, total)`` as in `estimate_vertex_geometry`.

    Returns
    -------
    Creases

    Raises
    ------
    InvalidMeshError
        If the arrays are not a mesh with faces and finite coordinates.
    InvalidParameterError
        If a parameter is out of range, or `geometry` has another number of vertices.
    CancelledError
        If `progress` returned False.

    Examples
    --------
    On an ellipsoid, the ellipse of the two longer axes is a ridge.

    >>> from bezier_filters.surfaces import ellipsoid
    >>> shape = ellipsoid(semi_axes=(1.0, 0.8, 0.5), resolution=20, jitter=0.2)
    >>> strongest = find_creases(shape.vertices, shape.faces).lines[0]
    >>> strongest.kind, strongest.is_closed, bool(np.abs(strongest.points[:, 2]).max() < 0.01)
    ('ridge', True, True)
    """
    mesh = prepare_mesh(triangle_mesh(vertices, faces))
    if not mesh.face_count:
        raise InvalidMeshError("faces: got none; creases need a mesh, not a point cloud")
    if not (is_real(angle) and 0.0 < angle <= 180.0):
        raise InvalidParameterError(f"angle: got {angle!r}, expected degrees above 0 and up to 180")
    if not (is_real(min_strength) and 0.0 <= min_strength < np.inf):
        raise InvalidParameterError(f"min_strength: got {min_strength!r}, expected a number of 0 or more")
    if geometry is None:
        geometry = estimate_vertex_geometry(mesh.vertices, mesh.faces, progress=progress)
    elif len(geometry.status) != mesh.vertex_count:
        raise InvalidParameterError(
            f"geometry: got that of {len(geometry.status)} vertices, expected {mesh.vertex_count}; "
            "estimate it on the same mesh"
        )
    edges, sharp, certainty = find_sharp_edges(mesh, geometry, radians(angle))
    lines = [
        *_sharp_lines(mesh, edges, sharp, certainty),
        *_smooth_lines(mesh, edges, sharp, geometry, min_strength),
    ]
    lines.sort(key=lambda line: -line.strength)
    sharp_lines = [line for line in lines if line.is_sharp]
    along = [np.stack([line.edges[:-1, 0], line.edges[1:, 0]], axis=1) for line in sharp_lines]
    return Creases(
        tuple(lines),
        np.sort(np.vstack([np.empty((0, 2), dtype=np.int32), *along]), axis=1),
        np.concatenate([np.empty(0), *(line.certainties for line in sharp_lines)]),
        geometry,
    )


def find_sharp_edges(
    mesh: PreparedMesh, geometry: VertexGeometry, angle: float = SHARP_ANGLE
) -> tuple[MeshEdges, BoolArray, FloatArray]:
    """Edges of the denoised surface, with flags for sharp ones and their certainties, each (e,)."""
    sigma, surface = geometry.noise_sigma, mesh
    if geometry.noise_free is not None:
        surface = mesh.move(geometry.noise_free)
    elif sigma is None or is_noisy(mesh, sigma):
        noise = learn_mesh_noise(mesh)
        sigma = None if noise is None else noise.sigma
        if noise is not None and hides_sharp_edges(mesh, noise):
            surface, _ = noise_free_surface(mesh, noise)
    edges = mesh_edges(surface)
    if surface is mesh and is_noisy(mesh, sigma):  # noisy, but without hidden sharp edges
        return edges, np.zeros(len(edges.angles), dtype=np.bool_), np.zeros(len(edges.angles))
    residual_sigma = (sigma or 0.0) * (1.0 if surface is mesh else RESIDUAL_NOISE_FRACTION)
    return edges, sharp_edges(surface, edges, mesh.adjacency, angle), certainties(edges, residual_sigma, angle)


def _sharp_lines(mesh: PreparedMesh, edges: MeshEdges, sharp: BoolArray, certainty: FloatArray) -> Iterator[CreaseLine]:
    """Chains of sharp edges, separately for ridges and ravines."""
    meeting = np.bincount(edges.vertices[sharp].ravel(), minlength=mesh.vertex_count)
    is_attached = (meeting > 1) | mesh.adjacency.on_boundary
    ends = np.flatnonzero(meeting > 2).astype(np.int32)
    for kind in get_args(CreaseKind):
        ids = np.flatnonzero(sharp & (edges.is_convex == (kind == "ridge")))
        pairs = edges.vertices[ids]
        lengths = np.linalg.norm(mesh.vertices[pairs[:, 1]] - mesh.vertices[pairs[:, 0]], axis=1)
        weights = edges.angles[ids] * lengths / np.maximum(edges.widths[ids], 1e-300)
        for nodes, segments in join_chains(pairs, ends):
            if len(segments) >= MIN_SHARP_LINE_EDGES or is_attached[nodes].all():
                on = np.stack([nodes, nodes], axis=1).astype(np.int32)
                strength = float(weights[segments].sum())
                here = certainty[ids[segments]]
                yield CreaseLine(kind, True, mesh.vertices[nodes], on, np.zeros(len(on)), strength, here)


def _smooth_lines(
    mesh: PreparedMesh,
    edges: MeshEdges,
    sharp: BoolArray,
    geometry: VertexGeometry,
    min_strength: float,
) -> Iterator[CreaseLine]:
    """Chains of crest segments, separately for ridges and ravines, where fits succeeded and no sharp edge is near."""
    usable = geometry.status <= int(FitStatus.LOWER_DEGREE)
    usable[edges.vertices[sharp]] = False
    faces = np.flatnonzero(usable[mesh.faces].all(axis=1) & (edges.of_faces >= 0).all(axis=1)).astype(np.int32)
    for kind, curvatures in zip(get_args(CreaseKind), ridge_and_ravine_fields(mesh, geometry), strict=True):
        pairs, shares, weights = crest_segments(mesh, edges, curvatures, faces)
        for nodes, segments in join_chains(pairs):
            strength = float(weights[segments].sum())
            if strength < min_strength:
                continue
            points = interpolate_on_edges(mesh.vertices, edges, shares, nodes)
            certainty = curvatures.certainty(points)
            if certainty >= 0.5:
                here = np.full(len(segments), certainty)
                yield CreaseLine(kind, False, points, edges.vertices[nodes], shares[nodes], strength, here)


def join_chains(segments: IntArray, ends: IntArray | None = None) -> list[tuple[IntArray, IntArray]]:
    """Join segments (s, 2), pairs of node numbers, into maximal chains.

    Chains end at nodes of degree other than two, and at the nodes `ends`. Each chain is a pair: its nodes in order,
    (k + 1,), with the first one repeated at the end if it is closed, and the segments between them, (k,).

    >>> [nodes.tolist() for nodes, _ in join_chains(np.array([[4, 7], [9, 7], [1, 2], [2, 3], [3, 1]]))]
    [[4, 7, 9], [1, 2, 3, 1]]
    """
    nodes, local = np.unique(segments, return_inverse=True)
    pairs = local.reshape(-1, 2).tolist()
    at_node: list[list[int]] = [[] for _ in nodes]
    for segment, (a, b) in enumerate(pairs):
        at_node[a].append(segment)
        at_node[b].append(segment)
    named = np.isin(nodes, [] if ends is None else ends).tolist()
    is_end = [named[node] or len(here) != 2 for node, here in enumerate(at_node)]
    used, result = [False] * len(pairs), list[tuple[IntArray, IntArray]]()
    starts = [(node, segment) for node, here in enumerate(at_node) if is_end[node] for segment in here]
    # The segments that remain after all open chains form closed ones.
    for node, segment in [*starts, *((pair[0], segment) for segment, pair in enumerate(pairs))]:
        path, passed = [node], []
        while not used[segment]:
            used[segment] = True
            passed.append(segment)
            a, b = pairs[segment]
            path.append(b if a == path[-1] else a)
            if is_end[path[-1]]:
                break
            first, second = at_node[path[-1]]
            segment = second if first == segment else first
        if passed:
            result.append((nodes[path], np.array(passed, dtype=np.int32)))
    return result
