"""The surface of the patches of a mesh, made once and asked at any points."""

from dataclasses import dataclass, field
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from bezier_filters.arguments import brief_repr
from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.differential_geometry import DerivedCurvatures
from bezier_filters.errors import InvalidParameterError
from bezier_filters.fitting.patch_geometry import PatchGeometry
from bezier_filters.kernels.kernel_input import PATCH_DEGREE, PATCH_ORIGIN, PATCH_SQUARE
from bezier_filters.meshes.box_tree import BoxTree, morton_order
from bezier_filters.meshes.half_edges import half_edge_twins
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.meshes.unit_size import CURVATURE, LENGTH, SQUARED_CURVATURE, rescale
from bezier_filters.patch_surface.blending import SurfaceArrays
from bezier_filters.patch_surface.cut_mesh import CutMesh
from bezier_filters.patch_surface.nearest_face import face_tree
from bezier_filters.patch_surface.projection import NO_PLACE, Places, evaluation_task, projection_task
from bezier_filters.patch_surface.query_arguments import check_places, check_points
from bezier_filters.runtime.cached_property import cached_property
from bezier_filters.runtime.parallel import Progress, run_in_chunks, runs_on_threads


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
        none was found, as noise turns faces over: the place is on the surface, and a nearer one may exist; 3 where the
        face has no patches, or they fold, and the place is on the face; 4 where no face has an area.
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
        return cast("SurfacePoints", rescale(_points_of(places, distances), self.exponent))

    def __repr__(self) -> str:
        """One line: the mesh."""
        return f"Surface({self.mesh.vertex_count} vertices, {self.mesh.face_count} faces)"


def empty_points(count: int) -> SurfacePoints:
    """Results of so many queries that nothing was found for."""
    return _points_of(empty_places(count), np.zeros(count))


def _points_of(places: Places, distances: FloatArray) -> SurfacePoints:
    return SurfacePoints(
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
