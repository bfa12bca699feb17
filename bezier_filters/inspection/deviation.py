"""Deviation of a mesh or point cloud from the surface of another mesh, with its significance."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal, TypeAlias, cast, get_args

import numpy as np
from numpy.typing import ArrayLike

from bezier_filters.arguments import brief_repr
from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.display import summary
from bezier_filters.errors import InvalidMeshError, InvalidParameterError, is_integer, is_real
from bezier_filters.estimation.estimate import estimate_vertex_geometry
from bezier_filters.field_arrays import result_arrays
from bezier_filters.fields import DEVIATION
from bezier_filters.fitting.point_cloud import point_cloud
from bezier_filters.fitting.vertex_geometry import VertexGeometry
from bezier_filters.inspection.deviating_regions import DeviatingRegion, find_deviating_regions
from bezier_filters.inspection.deviation_status import DeviationStatus
from bezier_filters.inspection.regional_means import mean_variance, regional_means, ring_of_size
from bezier_filters.inspection.rigid_motion import rigid_share
from bezier_filters.meshes.adjacency import edge_lengths, vertex_adjacency
from bezier_filters.meshes.half_edges import half_edge_twins
from bezier_filters.meshes.mesh import TriangleMesh, check_has_faces, check_selection, surface_or_points, takes_meshes
from bezier_filters.meshes.mesh_objects import MeshLike
from bezier_filters.meshes.unit_size import LENGTH
from bezier_filters.patch_surface.disagreement import patch_disagreement
from bezier_filters.patch_surface.projection import AT_BORDER, NO_PLACE, NOT_CONVERGED, ON_EDGE, ON_FACE
from bezier_filters.patch_surface.surface import Surface, SurfacePoints
from bezier_filters.patch_surface.surface_fit import fit_surface
from bezier_filters.result_tables import Table, TabularResult
from bezier_filters.runtime.parallel import Progress, runs_on_threads
from bezier_filters.status import FitStatus

Measured: TypeAlias = Literal["auto", "surface", "points"]
REGION_VERTICES = 200  # over which deviations are averaged: a defect of half the noise stands out by five errors there
CERTAIN_ERRORS = 3.0  # standard errors beyond which a single deviation is counted as significant
TRIANGLE_AREA = 0.866  # of the square of an edge: area per vertex of a mesh of equilateral triangles, sqrt(3) / 2
# codes of places on the reference, and what they mean for a deviation
_OUTCOMES = {
    ON_FACE: DeviationStatus.ON_FACE,
    AT_BORDER: DeviationStatus.PAST_BORDER,
    NOT_CONVERGED: DeviationStatus.NOT_CONVERGED,
    NO_PLACE: DeviationStatus.NOT_CONVERGED,
}


class _DeviationMeasures:
    """What follows from the arrays of a `Deviation`."""

    distances: FloatArray
    distance_std: FloatArray
    regional_distances: FloatArray
    regional_std: FloatArray
    status: IntArray
    tolerance: float | None

    @property
    def compared(self) -> BoolArray:
        """Vertices that have a deviation, (n,)."""
        return np.asarray(self.status <= DeviationStatus.ON_FACE)

    @property
    def z_scores(self) -> FloatArray:
        """Deviations over their standard errors, (n,); 0 where these are unknown."""
        return _divide(self.distances, self.distance_std)

    @property
    def regional_z_scores(self) -> FloatArray:
        """Regional means over their standard errors, (n,); 0 where these are unknown."""
        return _divide(self.regional_distances, self.regional_std)

    @property
    def grades(self) -> IntArray:
        """`DeviationStatus` as files and meshes hold it, (n,) int32: from 8 for ``OK`` to 0 for ``SKIPPED``."""
        return np.int32(DeviationStatus.SKIPPED) - self.status

    @property
    def mean(self) -> float | None:
        """Mean deviation, a length; None if nothing was compared."""
        return float(self._values.mean()) if len(self._values) else None

    @property
    def rms(self) -> float | None:
        """Root mean square of the deviations, a length."""
        return float(np.sqrt(np.square(self._values).mean())) if len(self._values) else None

    @property
    def lowest(self) -> int | None:
        """Vertex with the smallest deviation, mostly a negative one."""
        return self._extreme(np.argmin)

    @property
    def highest(self) -> int | None:
        """Vertex with the largest deviation."""
        return self._extreme(np.argmax)

    @property
    def share_within(self) -> float | None:
        """Share of the deviations within the tolerance; None without one."""
        if self.tolerance is None or not len(self._values):
            return None
        return float((np.abs(self._values) <= self.tolerance).mean())

    @property
    def share_significant(self) -> float | None:
        """Share of the deviations that are beyond three standard errors; .0027 where there is nothing but noise."""
        known = self.compared & (self.distance_std > 0.0)
        return float((np.abs(self.z_scores[known]) > CERTAIN_ERRORS).mean()) if known.any() else None

    @property
    def _values(self) -> FloatArray:
        return np.asarray(self.distances[self.compared])

    def _extreme(self, best: Callable[[FloatArray], np.intp]) -> int | None:
        rows = np.flatnonzero(self.compared)
        return int(rows[best(self.distances[rows])]) if len(rows) else None


@dataclass(frozen=True, repr=False)
class Deviation(_DeviationMeasures, TabularResult):
    """Deviation of n vertices from a reference surface; make it with `compare`.

    Attributes
    ----------
    distances : (n,) float64
        Signed distance from the reference, a length: positive on the side of its normals. 0 where nothing was compared.
    distance_std : (n,) float64
        Standard error of the distance, from the errors of both sides; 0 where they are unknown.
    regional_distances, regional_std : (n,) float64
        Mean of the distances over the region around each vertex, and its standard error.
    places : (n, 3) float64
        Nearest places of the reference surface, or of one of its faces.
    status : (n,) int32
        `DeviationStatus` codes.
    regions : tuple of DeviatingRegion
        Where the regional means deviate significantly, the most significant first.
    tolerance : float or None
        As given, a length.
    measured : {"surface", "points"}
        What was compared: the surface of the mesh, or its points.
    noise, reference_noise : float or None
        Standard deviation of the noise of both along the normal, a length; None where it could not be learned.
    rigid_share : float or None
        Share of the sum of squares of the distances that a rigid motion makes, to first order: near 1 for meshes that
        are not registered. None where nothing deviates.
    compared : (n,) bool
        Derived: vertices that have a deviation. The following values are over these.
    z_scores, regional_z_scores : (n,) float64
        Derived: distances and regional means over their standard errors.
    mean, rms : float or None
        Derived: mean and root mean square of the distances, lengths.
    lowest, highest : int or None
        Derived: vertices with the smallest and the largest distance.
    share_within, share_significant : float or None
        Derived: shares within the tolerance, and beyond three standard errors.
    """

    distances: FloatArray = field(metadata=LENGTH)
    distance_std: FloatArray = field(metadata=LENGTH)
    regional_distances: FloatArray = field(metadata=LENGTH)
    regional_std: FloatArray = field(metadata=LENGTH)
    places: FloatArray = field(metadata=LENGTH)
    status: IntArray
    regions: tuple[DeviatingRegion, ...]
    tolerance: float | None = field(metadata=LENGTH)
    measured: str
    noise: float | None = field(metadata=LENGTH)
    reference_noise: float | None = field(metadata=LENGTH)
    rigid_share: float | None
    compared: BoolArray = field(init=False)
    z_scores: FloatArray = field(init=False)
    regional_z_scores: FloatArray = field(init=False)
    mean: float | None = field(init=False, metadata=LENGTH)
    rms: float | None = field(init=False, metadata=LENGTH)
    lowest: int | None = field(init=False)
    highest: int | None = field(init=False)
    share_within: float | None = field(init=False)
    share_significant: float | None = field(init=False)

    def status_counts(self) -> dict[str, int]:
        """Number of vertices for each status that occurs, by name."""
        counts = np.bincount(self.status, minlength=len(DeviationStatus))
        return {status.name: int(counts[status]) for status in DeviationStatus if counts[status]}

    def __repr__(self) -> str:
        """One line: counts and sizes, without the arrays."""
        if self.rms is None:
            return f"Deviation(0 of {len(self.status)} vertices compared)"
        return (
            f"Deviation({self.compared.sum()} of {len(self.status)} vertices: mean {self.mean:.3g}, "
            f"rms {self.rms:.3g}, {len(self.regions)} regions deviate significantly)"
        )

    def _tables(self) -> list[Table]:
        rows = [
            summary("deviation", "length", self._values),
            summary("standard error", "length", self.distance_std[self.compared]),
            summary("deviation over standard error", "", self.z_scores[self.compared]),
        ]
        found = [[region.vertex, len(region.vertices), region.distance, region.p_value] for region in self.regions]
        header = ["vertex", "vertices", "mean deviation", "p-value"]
        tables = [Table(f"{self.compared.sum():,} vertices compared", ["", "unit", "min", "median", "max"], rows)]
        return [*tables, Table("regions that deviate significantly", header, found)] if found else tables

    def _columns(self) -> dict[str, object]:
        return dict(result_arrays(self, DEVIATION))


@takes_meshes
@runs_on_threads
def compare(
    vertices: ArrayLike | MeshLike,
    faces: ArrayLike | None,
    reference_vertices: ArrayLike | MeshLike | Surface,
    reference_faces: ArrayLike | None = None,
    *,
    measured: Measured = "auto",
    tolerance: float | None = None,
    max_distance: float | None = None,
    region: int = REGION_VERTICES,
    selected: BoolArray | None = None,
    noise: float | None = None,
    reference_noise: float | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Deviation:
    """Measure how far a mesh or point cloud is from the surface of another mesh, and what of it is not noise.

    Both must be in the same position: nothing is registered. The reference is the surface of its patches, as of
    `fit_surface`, not its faces, whose corners have all of the noise.

    By default a mesh is measured by its own surface: the distance is that of the patch of each vertex, where noise is
    averaged, and its standard error is that of both patches. With ``measured="points"`` the distance is that of each
    vertex itself, with all of its noise; that is all there is for a point cloud.

    Errors of neighbouring vertices of a surface are correlated, so that many of them may look significant at once. A
    shallow defect is hidden in the error of each vertex and shows in the mean over a region; the standard errors of
    these means count correlated values once (see `bezier_filters.inspection.regional_means`).

    Parameters
    ----------
    vertices : (n, 3) array_like of float, or mesh object
        Mesh to be inspected; or a mesh of another library, see `mesh_arrays`, and no faces.
    faces : (m, 3) array_like of int or None
        Its triangles, counter-clockwise seen from outside; None for a point cloud.
    reference_vertices : (k, 3) array_like of float, mesh object or Surface
        Reference mesh, or its fitted surface, which is reused.
    reference_faces : (l, 3) array_like of int, optional
        Its triangles; none for a mesh object or a surface.
    measured : {"auto", "surface", "points"}
        What is compared; auto is the surface of a mesh and the points of a cloud.
    tolerance : float, optional
        Half the width of the band that is within tolerance, a length, for the share that is within.
    max_distance : float, optional
        Vertices farther away are not compared, a length.
    region : int
        Number of vertices over which deviations are averaged, 1 or more.
    selected : (n,) bool, optional
        Vertices to compare; all by default.
    noise, reference_noise : float, optional
        Standard deviation of the noise of each along the normal, a length; learned by default, 0 for none.
    threads : int, optional
        Number of threads; by default BEZIER_FILTERS_THREADS or all usable cores.
    progress : callable, optional
        ``progress(done, total)`` as in `estimate_vertex_geometry`, for each of the stages.

    Returns
    -------
    Deviation

    Raises
    ------
    InvalidMeshError
        If a mesh is refused, or the reference has no faces.
    InvalidParameterError
        If a parameter is out of range.
    CancelledError
        If `progress` returned False.

    Examples
    --------
    >>> from bezier_filters.surfaces import sphere
    >>> scan, model = sphere(radius=1.01, resolution=10), sphere(resolution=12)
    >>> found = compare(scan.vertices, scan.faces, model.vertices, model.faces, tolerance=0.02)
    >>> round(found.mean, 4), found.share_within, found.status_counts()
    (0.01, 1.0, {'OK': 1002})
    """
    mesh = surface_or_points(cast("ArrayLike", vertices), faces)
    for name, value in (("tolerance", tolerance), ("max_distance", max_distance)):
        if value is not None and not (is_real(value) and 0.0 < value < np.inf):
            raise InvalidParameterError(f"{name}: got {value!r}, expected a positive length, or None")
    if measured not in get_args(Measured):
        raise InvalidParameterError(f"measured: got {measured!r}, expected one of {', '.join(get_args(Measured))}")
    if not is_integer(region) or region < 1:
        raise InvalidParameterError(f"region: got {brief_repr(region)}, expected a number of vertices, 1 or more")
    if selected is not None:
        selected = check_selection(selected, mesh.vertex_count)
    if measured == "surface" and not mesh.face_count:
        raise InvalidMeshError('faces: got none; a point cloud has no surface, measured="points" compares its points')
    if isinstance(reference_vertices, Surface):
        if reference_faces is not None or reference_noise is not None:
            raise InvalidParameterError("reference_faces, reference_noise: a surface as the reference has its own")
        reference = reference_vertices
    else:
        model = surface_or_points(reference_vertices, reference_faces)
        check_has_faces(model.faces)
        reference = fit_surface(model.vertices, model.faces, noise=reference_noise, progress=progress)
    test = _fit_test(mesh, points=measured == "points" or not mesh.face_count, noise=noise, progress=progress)
    found = reference.query(test.positions, progress=progress)
    status = _status(test, reference, found, selected, np.inf if max_distance is None else max_distance)
    compared = status <= DeviationStatus.ON_FACE
    distances = np.where(compared, found.distances, 0.0)
    reference_std, excess = found.position_std, _shape_variance(reference, found)
    known = compared & (test.noise is not None) & (reference.geometry.fit.noise_sigma is not None)
    adjacency = vertex_adjacency(mesh) if mesh.face_count else point_cloud(mesh).adjacency
    shape, regional_shape = (regional_means(excess, compared, adjacency, k)[0] for k in (1, ring_of_size(region)))
    std = np.where(known, np.sqrt(np.square(test.std) + np.square(reference_std) + shape), 0.0)
    means, counts = regional_means(distances, compared, adjacency, ring_of_size(region))
    scale = np.ldexp(1.0, reference.exponent)
    other = _Side(
        reference_std,
        scale * _vertex_noise(reference.geometry)[reference.cut.faces[found.faces, 0]],
        scale * (reference.geometry.fit.noise_length or 0.0),
        scale * _mean_length(edge_lengths(reference.mesh, vertex_adjacency(reference.mesh))),
    )
    own = _Side(test.std, test.vertex_noise, test.noise_length, _mean_length(edge_lengths(mesh, adjacency)))
    noise_variance = own.mean_variance(counts) + other.mean_variance(counts * (own.edge / other.edge) ** 2)
    regional_std = np.where(known, np.sqrt(noise_variance + regional_shape), 0.0)
    means = np.where(compared, means, 0.0)
    sigma = reference.geometry.fit.noise_sigma
    return Deviation(
        distances=distances,
        distance_std=std,
        regional_distances=means,
        regional_std=regional_std,
        places=found.points,
        status=status,
        regions=find_deviating_regions(means, regional_std, found.points, adjacency, region),
        tolerance=tolerance,
        measured="points" if test.is_points else "surface",
        noise=test.noise,
        reference_noise=None if sigma is None else float(scale * sigma),
        rigid_share=rigid_share(found.points[compared], found.normals[compared], distances[compared]),
    )


@dataclass(frozen=True)
class _Test:
    """What is compared with the reference."""

    positions: FloatArray  # (n, 3)
    std: FloatArray  # (n,): standard errors of the positions along the normal, lengths
    normals: FloatArray  # (n, 3): zero where there is none, or its side is not known
    fit_status: IntArray  # (n,)
    noise: float | None
    vertex_noise: FloatArray  # (n,)
    noise_length: float
    is_points: bool


def _fit_test(mesh: TriangleMesh, *, points: bool, noise: float | None, progress: Progress | None) -> _Test:
    """Fit the mesh or cloud that is compared."""
    n = mesh.vertex_count
    if points:
        geometry = estimate_vertex_geometry(mesh.vertices, mesh.faces, noise=noise, progress=progress)
        vertex_noise, scale = _vertex_noise(geometry), 1.0
        positions, std = mesh.vertices, vertex_noise
    else:
        surface = fit_surface(mesh.vertices, mesh.faces, noise=noise, progress=progress)
        patches, scale = surface.geometry, float(np.ldexp(1.0, surface.exponent))
        positions, geometry = mesh.vertices + scale * patches.displacements[:n], patches
        vertex_noise = scale * _vertex_noise(patches)[:n]
        std = np.where(patches.status[:n] < FitStatus.NORMAL_ONLY, scale * patches.height_std[:n], vertex_noise)
    sigma, length = geometry.fit.noise_sigma, geometry.fit.noise_length
    return _Test(
        positions,
        std,
        geometry.normals[:n] if mesh.face_count else np.zeros((n, 3)),  # a cloud does not know its sides
        geometry.status[:n],
        None if sigma is None else float(scale * sigma),
        vertex_noise,
        scale * (length or 0.0),
        points,
    )


def _vertex_noise(geometry: VertexGeometry) -> FloatArray:
    """Standard deviation of the noise at each vertex, (n,): where it varies, the residuals of the fits."""
    sigma = geometry.fit.noise_sigma or 0.0
    if geometry.fit.parts:
        return np.where(geometry.residual > 0.0, geometry.residual, sigma)
    return np.full(len(geometry.status), sigma)


def _are_at_sharp_edges(reference: Surface, found: SurfacePoints) -> BoolArray:
    """Which places, (n,), are at the end of a patch but not of the mesh: the surface goes on across the edge."""
    at_end = found.outcome == AT_BORDER
    twins = half_edge_twins(reference.mesh.faces, reference.mesh.vertex_count).reshape(-1, 3)
    shares = np.column_stack([1.0 - found.coordinates.sum(axis=1), found.coordinates])
    across = np.roll(twins[found.faces], -1, axis=1)  # by the corner that is opposite
    ends_there = ((shares <= ON_EDGE) & (across < 0)).any(axis=1)
    return np.asarray(at_end & ~ends_there)


def _status(
    test: _Test, reference: Surface, found: SurfacePoints, selected: BoolArray | None, max_distance: float
) -> IntArray:
    """Status of every vertex, (n,)."""
    status = np.full(len(test.std), int(DeviationStatus.OK), dtype=np.int32)
    if not test.is_points:
        status[test.fit_status >= FitStatus.NORMAL_ONLY] = DeviationStatus.POINT
    at_sharp_edge = _are_at_sharp_edges(reference, found)
    for outcome, code in _OUTCOMES.items():
        status[(found.outcome == outcome) & ~at_sharp_edge] = code
    is_opposite = np.einsum("ij,ij->i", test.normals, found.normals) < 0.0
    status[(status < DeviationStatus.PAST_BORDER) & is_opposite & ~at_sharp_edge] = DeviationStatus.OPPOSITE
    status[np.abs(found.distances) > max_distance] = DeviationStatus.TOO_FAR
    if len(found.points):
        status[test.fit_status == FitStatus.ISOLATED] = DeviationStatus.ISOLATED
    if selected is not None:
        status[~selected] = DeviationStatus.SKIPPED
    return status


def _shape_variance(reference: Surface, found: SurfacePoints) -> FloatArray:
    """Variance of the error of shape of the reference at places of it, (n,).

    It is that by which the patches that are blended there differ beyond their standard error, which noise explains.
    """
    spread = patch_disagreement(reference.arrays, found.faces, found.coordinates)
    scale = np.ldexp(1.0, reference.exponent)
    return np.asarray(np.maximum(np.square(scale * spread) - np.square(found.position_std), 0.0))


@dataclass(frozen=True)
class _Side:
    """Errors of one of the two meshes at the vertices that are compared, lengths."""

    std: FloatArray  # (n,): of the position
    noise: FloatArray  # (n,)
    noise_length: float
    edge: float  # mean length

    def mean_variance(self, counts: FloatArray) -> FloatArray:
        """Variance of the mean position of so many vertices of this mesh around each vertex, (n,)."""
        if not self.noise_length:
            inflation = 1.0
        else:
            inflation = 1.0 + 2.0 * np.pi * self.noise_length**2 / (TRIANGLE_AREA * self.edge**2)
        return mean_variance(np.square(self.std), inflation * np.square(self.noise), counts)


def _mean_length(lengths: FloatArray) -> float:
    """Mean of some lengths; 1 without any, as of isolated points, or where all are 0."""
    return float(lengths.mean()) or 1.0 if len(lengths) else 1.0


def _divide(values: FloatArray, errors: FloatArray) -> FloatArray:
    return np.divide(values, errors, out=np.zeros_like(values), where=errors > 0.0)
