"""The surface of the patches of a mesh, made once and asked at any points."""

from dataclasses import dataclass, field, replace
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from bezier_filters.arguments import brief_repr, real_array
from bezier_filters.arrays import FloatArray, IntArray, unique_rows
from bezier_filters.differential_geometry import DerivedCurvatures
from bezier_filters.errors import InvalidMeshError, InvalidParameterError
from bezier_filters.estimation.estimate import estimate_patches, estimate_vertex_geometry
from bezier_filters.feature_lines.crease_lines import find_sharp_edges
from bezier_filters.fitting.cloud_triangulation import cloud_surface
from bezier_filters.fitting.noise_level import is_noisy
from bezier_filters.fitting.patch_geometry import PatchGeometry
from bezier_filters.fitting.vertex_geometry import VertexGeometry
from bezier_filters.kernels.kernel_input import PATCH_DEGREE, PATCH_ORIGIN, PATCH_SQUARE
from bezier_filters.meshes.box_tree import BoxTree, morton_order
from bezier_filters.meshes.half_edges import distinct_edges, half_edge_twins
from bezier_filters.meshes.mesh import TriangleMesh, surface_or_points, takes_meshes, triangle_mesh
from bezier_filters.meshes.mesh_objects import MeshLike
from bezier_filters.meshes.prepared_mesh import PreparedMesh, prepare_mesh
from bezier_filters.meshes.unit_size import CURVATURE, LENGTH, SQUARED_CURVATURE, rescale, size_exponent
from bezier_filters.patch_surface.blending import SurfaceArrays
from bezier_filters.patch_surface.cut_mesh import CutMesh, cut_mesh
from bezier_filters.patch_surface.nearest_face import face_tree
from bezier_filters.patch_surface.projection import NO_PLACE, Places, evaluation_task, projection_task
from bezier_filters.patch_surface.query_arguments import check_places, check_points
from bezier_filters.runtime.cached_property import cached_property
from bezier_filters.runtime.parallel import Progress, run_in_chunks, runs_on_threads
from bezier_filters.surface_model.fit_options import FitOptions, check_noise

# Correlation of residuals at neighbours above which they are no noise. White noise leaves -0.3 to 0; without noise,
# tori, ellipsoids and stars of 500 to 20,000 vertices have 0.13 to 0.91.
MIN_SHARED_RESIDUAL = 0.1


@dataclass(frozen=True, repr=False)
class SurfacePoints(DerivedCurvatures):
    """Places on a `Surface`, one for each of q queries.

    Curvatures have the sign and the units of `VertexGeometry`, and every value is finite.

    Attributes
    ----------
    points : (q, 3) float64
        Positions on the surface.
    distances : (q,) float64
        Signed distance of the query, positive on the side of the normal there; 0 for places that were given by face.
    normals : (q, 3) float64
        Unit normals of the surface.
    k_min, k_max : (q,) float64
        Principal curvatures, 1/length, of the mean of the patches.
    direction_min, direction_max : (q, 3) float64
        Their unit tangent directions; signs are arbitrary.
    position_std, normal_std, mean_curvature_std, gaussian_curvature_std : (q,) float64
        Standard errors: of the position along the normal, a length; of the normal, in radians; of H and K. They are
        means of those of the patches, whose errors are nearly the same, as they share most of their points.
    faces : (q,) int32
        Face of the mesh below each place.
    coordinates : (q, 2) float64
        Barycentric coordinates of the second and third corner of the face.
    outcome : (q,) int32
        0 for the nearest place; 1 where that is on a border or sharp edge, so that the query is not over it; 2 where
        none was found, as noise turns faces over: the place is on the surface, and a nearer one may exist, by a tenth
        of an edge mostly; 3 where the face has no patches, or they fold, and the place is on the face; 4 where no face
        has an area.
    mean_curvature, gaussian_curvature, geodesic_torsion : (q,) float64
        Derived from `k_min` and `k_max`.
    """

    points: FloatArray = field(metadata=LENGTH)
    distances: FloatArray = field(metadata=LENGTH)
    normals: FloatArray
    k_min: FloatArray = field(metadata=CURVATURE)
    k_max: FloatArray = field(metadata=CURVATURE)
    direction_min: FloatArray
    direction_max: FloatArray
    position_std: FloatArray = field(metadata=LENGTH)
    normal_std: FloatArray
    mean_curvature_std: FloatArray = field(metadata=CURVATURE)
    gaussian_curvature_std: FloatArray = field(metadata=SQUARED_CURVATURE)
    faces: IntArray
    coordinates: FloatArray
    outcome: IntArray
    mean_curvature: FloatArray = field(init=False, metadata=CURVATURE)
    gaussian_curvature: FloatArray = field(init=False, metadata=SQUARED_CURVATURE)
    geodesic_torsion: FloatArray = field(init=False, metadata=CURVATURE)


@dataclass(frozen=True, repr=False)
class Surface:
    """The blended patches of a mesh; make it with `fit_surface`.

    Attributes
    ----------
    mesh : TriangleMesh
        The mesh that was fitted.
    cut : CutMesh
        The mesh cut along its sharp edges, to whose vertices the patches belong.
    geometry : PatchGeometry
        The estimates at the vertices of `cut`, with the patches.
    exponent : int
        Of the power of two that scales the arrays above to the size of the given mesh: 0 except for extreme sizes.
    """

    mesh: TriangleMesh
    cut: CutMesh
    geometry: PatchGeometry
    exponent: int = 0

    @runs_on_threads
    def query(
        self, points: ArrayLike, *, threads: int | None = None, progress: Progress | None = None
    ) -> SurfacePoints:
        """Find the nearest places on the surface to points (q, 3); see `surface_at`."""
        queries = np.ldexp(check_points(points), -self.exponent)
        places = empty_places(len(queries))
        order = morton_order(queries)  # points that are near each other need the same patches
        run_in_chunks(
            lambda: projection_task(self.arrays, self.tree, queries, order, places), len(queries), progress=progress
        )
        offsets = queries - places.points
        sides = np.where(np.einsum("ij,ij->i", offsets, places.normals) < 0.0, -1.0, 1.0)
        return self._result(places, sides * np.linalg.norm(offsets, axis=1))

    @runs_on_threads
    def evaluate(
        self,
        faces: ArrayLike,
        coordinates: ArrayLike,
        *,
        threads: int | None = None,
        progress: Progress | None = None,
    ) -> SurfacePoints:
        """Find the surface over places of faces, given by barycentric coordinates.

        Parameters
        ----------
        faces : (q,) array_like of int
            Faces of the mesh.
        coordinates : (q, 2) array_like of float
            Barycentric coordinates of the second and third corners, at least 0 and at most 1 in total, but for
            rounding of 1e-12.
        threads, progress
            As in `estimate_vertex_geometry`.
        """
        rows, where = check_places(faces, coordinates, len(self.mesh.faces))
        places = empty_places(len(rows))
        places.face[:], places.coordinates[:] = rows, where
        run_in_chunks(lambda: evaluation_task(self.arrays, places), len(rows), progress=progress)
        return self._result(places, np.zeros(len(rows)))

    @cached_property
    def arrays(self) -> SurfaceArrays:
        """Arrays for the kernels."""
        geometry, faces = self.geometry, self.cut.faces
        twins = half_edge_twins(faces, len(self.cut.vertices)).reshape(-1, 3)
        neighbours = np.where(twins >= 0, twins // 3, -1).astype(np.int32)
        errors = [geometry.height_std, geometry.normal_std, geometry.mean_curvature_std]
        normals = geometry.normals
        return SurfaceArrays(
            self.cut.vertices,
            faces,
            neighbours,
            normals,
            _complete_patches(geometry, self.cut.vertices),
            np.column_stack([*errors, geometry.gaussian_curvature_std]),
        )

    @cached_property
    def tree(self) -> BoxTree:
        """Bounding boxes of the faces."""
        return face_tree(self.cut.vertices, self.cut.faces)

    def _result(self, places: Places, distances: FloatArray) -> SurfacePoints:
        """The places in the unit of the given mesh."""
        found = SurfacePoints(
            points=places.points,
            distances=distances,
            normals=places.normals,
            k_min=places.curvatures[:, 0],
            k_max=places.curvatures[:, 1],
            direction_min=places.directions[:, 0],
            direction_max=places.directions[:, 1],
            position_std=places.errors[:, 0],
            normal_std=places.errors[:, 1],
            mean_curvature_std=places.errors[:, 2],
            gaussian_curvature_std=places.errors[:, 3],
            faces=places.face,
            coordinates=places.coordinates,
            outcome=places.outcome.astype(np.int32),
        )
        return cast("SurfacePoints", rescale(found, self.exponent))

    def __repr__(self) -> str:
        """One line: the mesh."""
        return f"Surface({self.mesh.vertex_count} vertices, {self.mesh.face_count} faces)"


@takes_meshes
@runs_on_threads
def fit_surface(
    vertices: ArrayLike | MeshLike,
    faces: ArrayLike | None = None,
    *,
    noise: float | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Surface:
    """Fit patches to all vertices of a mesh and join them to a surface that can be asked anywhere.

    The patches are those of `estimate_vertex_geometry` with automatic choices. Over each face those of its corners are
    blended so that the surface is tangent-continuous, touches the patch of every vertex there and has its curvature;
    see `bezier_filters.patch_surface.blending`. Sharp edges stay sharp: the mesh is cut along them, and each side has
    patches of its own, which meet to within their errors. The surface ends over the border of the mesh.

    Without noise the surface passes through the vertices. Coarse meshes without noise leave residuals that look like a
    little of it, but neighbours share them; where no edge is sharp, the patches are then fitted without noise.

    A point cloud gets triangles between its points, see `bezier_filters.fitting.cloud_triangulation`: they are the
    faces of the result.

    Parameters
    ----------
    vertices : (n, 3) array_like of float, or mesh object
        Coordinates; or a mesh of another library, see `mesh_arrays`, and no faces.
    faces : (m, 3) array_like of int, optional
        Triangles, counter-clockwise seen from outside; None or empty for a point cloud.
    noise : float, optional
        Standard deviation of the noise along the normal, a length, if it is known; 0 for none. By default it is
        estimated.
    threads : int, optional
        Number of threads; by default BEZIER_FILTERS_THREADS or all usable cores. The result does not depend on it.
    progress : callable, optional
        ``progress(done, total)`` as in `estimate_vertex_geometry`.

    Returns
    -------
    Surface

    Raises
    ------
    InvalidMeshError
        If the arrays are not a mesh, or no cloud of a surface, with finite coordinates, or faces are doubled.
    InvalidParameterError
        If a parameter is out of range.
    CancelledError
        If `progress` returned False.

    Examples
    --------
    >>> from bezier_filters.surfaces import sphere
    >>> ball = sphere(radius=2.0)
    >>> surface = fit_surface(ball.vertices, ball.faces)
    >>> found = surface.query([[3.0, 1.0, 0.0], [0.0, 0.0, 1.5]])
    >>> found.distances.round(3), found.mean_curvature.round(3)
    (array([ 1.162, -0.5  ]), array([0.5, 0.5]))
    """
    exponent = size_exponent(cast("ArrayLike", vertices))  # arrays, see `takes_meshes`
    shape = surface_or_points(np.ldexp(real_array(vertices), -exponent) if exponent else vertices, faces)
    check_noise(noise)
    mesh = prepare_mesh(shape) if shape.face_count else cloud_surface(shape)
    if not mesh.face_count:
        raise InvalidMeshError("vertices: the points of the cloud are too few, or on a line, for a surface")
    _refuse_duplicates(mesh)
    options = FitOptions(noise=None if noise is None else float(np.ldexp(noise, -exponent)))
    geometry = estimate_vertex_geometry(mesh.vertices, mesh.faces, noise=options.noise, progress=progress)
    edges, is_sharp, _ = find_sharp_edges(mesh, geometry)
    if noise is None and not is_sharp.any() and _has_shared_residuals(mesh, geometry):
        options = FitOptions(noise=0.0)  # at sharp edges, points on one side alone would be interpolated wildly
    is_cut = is_sharp | (np.bincount(edges.of_faces[edges.of_faces >= 0], minlength=len(is_sharp)) > 2)
    cut = cut_mesh(mesh.vertices, mesh.faces, edges.vertices[is_cut])
    patches = estimate_patches(triangle_mesh(cut.vertices, cut.faces), options, progress)
    if not shape.face_count:  # noise folds the triangles of a cloud; those on the patches lie along the surface
        cut = replace(cut, vertices=cut.vertices + patches.displacements)
    return Surface(TriangleMesh(mesh.vertices, mesh.faces), cut, patches, exponent)


@takes_meshes
def surface_at(
    vertices: ArrayLike | MeshLike,
    faces: ArrayLike | None,
    points: ArrayLike,
    *,
    noise: float | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> SurfacePoints:
    """Find the places of the fitted surface of a mesh nearest to points, with its differential geometry there.

    For several calls on one mesh, make the surface once with `fit_surface`.

    Parameters
    ----------
    vertices, faces, noise, threads, progress
        As in `fit_surface`.
    points : (q, 3) array_like of float
        Points anywhere. The nearest place is found from the nearest place on the faces, so that far from the surface,
        beyond its centres of curvature, it may be a local one.

    Returns
    -------
    SurfacePoints

    Raises
    ------
    InvalidMeshError, InvalidParameterError, CancelledError
        As `fit_surface`; also if the points are not finite numbers of shape (q, 3).

    Examples
    --------
    >>> from bezier_filters.surfaces import cylinder
    >>> tube = cylinder(radius=2.0)
    >>> found = surface_at(tube.vertices, tube.faces, [[2.5, 0.5, 0.0]])
    >>> bool(abs(found.distances[0] - (np.hypot(2.5, 0.5) - 2.0)) < 1e-3), bool(abs(found.k_max[0] - 0.5) < 0.01)
    (True, True)
    """
    return fit_surface(vertices, faces, noise=noise, threads=threads, progress=progress).query(points, threads=threads)


def _refuse_duplicates(mesh: PreparedMesh) -> None:
    """Refuse faces on the same vertices: their edges have three faces, which would cut the surface all around them."""
    count = mesh.face_count - len(unique_rows(np.sort(mesh.faces, axis=1))[0])
    if count:
        raise InvalidMeshError(
            f"faces: {count:,} lie on others with the same three vertices, in either orientation; remove them, as "
            "meshing_remove_duplicate_faces of pymeshlab does"
        )


@takes_meshes
def project(
    vertices: ArrayLike | MeshLike,
    faces: ArrayLike | None = None,
    points: ArrayLike | None = None,
    *,
    noise: float | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> SurfacePoints:
    """Project the points of a cloud or the vertices of a mesh, or other points, onto the surface of its patches.

    It is `surface_at` with the vertices as points by default.

    Parameters
    ----------
    vertices, faces, noise, threads, progress
        As in `fit_surface`.
    points : (q, 3) array_like of float, optional
        Points to project; the vertices by default.

    Returns
    -------
    SurfacePoints
        Its `points` are the projections, `distances` how far the points were from them, a length with a sign.

    Raises
    ------
    InvalidMeshError, InvalidParameterError, CancelledError
        As `surface_at`.

    Examples
    --------
    >>> from bezier_filters.surfaces import sphere
    >>> ball = sphere(radius=2.0)
    >>> found = project(ball.vertices, None, [[3.0, 1.0, 0.0]])
    >>> found.distances.round(3), np.linalg.norm(found.points, axis=1).round(3)
    (array([1.162]), array([2.]))
    """
    surface = fit_surface(vertices, faces, noise=noise, threads=threads, progress=progress)
    return surface.query(cast("ArrayLike", vertices) if points is None else points, threads=threads)


def _has_shared_residuals(mesh: PreparedMesh, geometry: VertexGeometry) -> bool:
    """Whether the little noise that was found is the error of the patches: their residuals at neighbours agree."""
    sigma = geometry.noise_sigma
    if not sigma or geometry.fit.noise_length or is_noisy(mesh, sigma):
        return False
    residuals = np.einsum("ij,ij->i", geometry.displacements, geometry.normals)
    ends = residuals[distinct_edges(mesh.faces, mesh.vertex_count)[0]]
    return bool(np.mean(ends[:, 0] * ends[:, 1]) > MIN_SHARED_RESIDUAL * np.mean(np.square(ends)))


def _complete_patches(geometry: PatchGeometry, vertices: FloatArray) -> FloatArray:
    """The rows of the patches, with planes where only normals are known."""
    rows = geometry.patch_rows
    alone = np.flatnonzero(~rows[:, :PATCH_ORIGIN].any(axis=1) & geometry.normals.any(axis=1))
    if len(alone):
        rows = rows.copy()
        normals = geometry.normals[alone]
        least = np.eye(3)[np.abs(normals).argmin(axis=1)]
        x_axes = np.cross(normals, least)
        x_axes /= np.linalg.norm(x_axes, axis=1, keepdims=True)
        rows[alone] = 0.0
        rows[alone, :PATCH_ORIGIN] = np.hstack([x_axes, np.cross(normals, x_axes), normals])
        rows[alone, PATCH_ORIGIN:PATCH_SQUARE] = vertices[alone]
        rows[alone, PATCH_SQUARE + 1] = rows[alone, PATCH_SQUARE + 3] = 1.0
        rows[alone, PATCH_DEGREE] = 0.0
    return rows


def empty_places(count: int) -> Places:
    """Room for the results of so many queries."""
    return Places(
        np.full(count, -1, dtype=np.int32),
        np.zeros((count, 2)),
        np.zeros((count, 3)),
        np.zeros((count, 3)),
        np.zeros((count, 2)),
        np.zeros((count, 2, 3)),
        np.zeros((count, 4)),
        np.full(count, NO_PLACE, dtype=np.int8),
    )


def check_surface(surface: object) -> None:
    """Refuse what is no `Surface`."""
    if not isinstance(surface, Surface):
        raise InvalidParameterError(
            f"surface: got {brief_repr(surface)}, expected a Surface; make it with fit_surface(vertices, faces)"
        )
