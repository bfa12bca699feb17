"""Area, volume, total curvatures and bending energies of the surface of a mesh, with standard errors."""

from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from bezier_filters.arguments import brief_repr
from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.errors import InvalidParameterError, is_integer
from bezier_filters.inspection.gauss_bonnet import euler_characteristic_and_turning
from bezier_filters.inspection.quadrature import QuadraturePoints, quadrature_points
from bezier_filters.meshes.mesh import check_has_faces, takes_meshes
from bezier_filters.meshes.mesh_objects import MeshLike
from bezier_filters.meshes.unit_size import AREA, LENGTH, VOLUME
from bezier_filters.patch_surface.surface import Surface
from bezier_filters.patch_surface.surface_fit import fit_surface, refit_surface
from bezier_filters.result_tables import Table, TabularResult
from bezier_filters.runtime.parallel import Progress, runs_on_threads

REPEATS = 8  # fits with new noise: standard errors are known to a quarter
KERNEL_RANGES = 2.5  # ranges of correlated noise at which the kernel that makes it ends; it is .002 there


@dataclass(frozen=True)
class Integrals:
    """Integrals over a part of a surface.

    Attributes
    ----------
    area : float
        Length^2.
    volume : float or None
        Volume enclosed, length^3; None unless the part is closed.
    total_mean_curvature : float
        Integral of the mean curvature H, a length, without that of sharp edges.
    total_gaussian_curvature : float
        Integral of the Gaussian curvature K, without unit.
    willmore_energy : float
        Integral of H^2, without unit.
    bending_energy : float
        Integral of (k_min^2 + k_max^2) / 2, without unit.
    """

    area: float = field(metadata=AREA)
    volume: float | None = field(metadata=VOLUME)
    total_mean_curvature: float = field(metadata=LENGTH)
    total_gaussian_curvature: float
    willmore_energy: float
    bending_energy: float


@dataclass(frozen=True)
class PartMeasures:
    """Measures of a part of a surface.

    Attributes
    ----------
    label : int or None
        Label of the part; None for all of the surface.
    values : Integrals
        The integrals.
    std, bias : Integrals or None
        Standard errors, and mean errors by the noise, which can be subtracted; None without repeats.
    euler_characteristic : int or None
        Vertices less edges plus faces of the part, cut along sharp edges; None for parts by labels of vertices.
    turning : float or None
        Total geodesic curvature of its border, exterior angles included, in radians; sharp edges are borders of both
        sides.
    gauss_bonnet_error : float or None
        Total Gaussian curvature plus turning less 2 pi times the Euler characteristic, which is 0 on a surface that is
        resolved: on its size depends how far to trust the curvatures.
    """

    label: int | None
    values: Integrals
    std: Integrals | None
    bias: Integrals | None
    euler_characteristic: int | None
    turning: float | None
    gauss_bonnet_error: float | None


@dataclass(frozen=True, repr=False)
class SurfaceMeasures(TabularResult):
    """Measures of a surface and of its parts; make them with `measure`.

    Attributes
    ----------
    whole : PartMeasures
        All of the surface.
    parts : tuple of PartMeasures
        One for each label, in ascending order.
    repeats : int
        Number of fits with new noise.
    noise : float or None
        Standard deviation of the noise along the normal, a length; None where it could not be learned.
    faces_without_surface : int
        Faces with places where there are no patches, or these fold; they count as flat there.
    """

    whole: PartMeasures
    parts: tuple[PartMeasures, ...]
    repeats: int
    noise: float | None = field(metadata=LENGTH)
    faces_without_surface: int

    def __repr__(self) -> str:
        """One line: area and number of parts."""
        return f"SurfaceMeasures(area {self.whole.values.area:.6g}; {len(self.parts)} parts)"

    def _tables(self) -> list[Table]:
        tables = []
        for part in (self.whole, *self.parts):
            rows = []
            for name, value in asdict(part.values).items():
                errors = [None if one is None else getattr(one, name) for one in (part.std, part.bias)]
                rows.append([name.replace("_", " "), value, *errors])
            title = "surface" if part.label is None else f"label {part.label}"
            tables.append(Table(title, ["", "value", "standard error", "bias"], rows))
        return tables

    def _columns(self) -> dict[str, object]:
        parts = (self.whole, *self.parts)
        return {"label": [part.label for part in parts]} | {
            entry.name: [getattr(part.values, entry.name) for part in parts] for entry in fields(Integrals)
        }


@takes_meshes
@runs_on_threads
def measure(
    vertices: ArrayLike | MeshLike,
    faces: ArrayLike | None = None,
    *,
    face_labels: ArrayLike | None = None,
    vertex_labels: ArrayLike | None = None,
    noise: float | None = None,
    repeats: int = REPEATS,
    seed: int = 0,
    threads: int | None = None,
    progress: Progress | None = None,
) -> SurfaceMeasures:
    """Measure area, volume, total curvatures and bending energies of the surface of a mesh, with standard errors.

    Integrals are over the blended patches of `fit_surface`, by Gauss points in every face, not over flat triangles: on
    smooth surfaces they converge faster than the square of the edges.

    Standard errors and biases are propagated from the noise by repetition (a parametric bootstrap): noise of the
    learned strength and range is added to the fitted positions along the normals, and everything is fitted and measured
    again, with the sharp edges as found. So they include how integrals depend on the noise and on what is learned, for
    all correlations of fitted values. They assume normally distributed noise of equal strength, and do not include
    details that the mesh does not resolve. That of the total Gaussian curvature includes these, too: the theorem of
    Gauss and Bonnet tells its error, which is added in quadrature.

    Parameters
    ----------
    vertices : (n, 3) array_like of float, or mesh object
        Coordinates; or a mesh of another library, see `mesh_arrays`, and no faces.
    faces : (m, 3) array_like of int
        Triangles, counter-clockwise seen from outside.
    face_labels : (m,) array_like of int or bool, optional
        Labels of faces, or a selection: each label is measured by itself.
    vertex_labels : (n,) array_like of int or bool, optional
        The same for vertices: points within faces belong to the labels of the corners by their barycentric coordinates.
    noise : float, optional
        Standard deviation of the noise along the normal, a length, if it is known; 0 for none.
    repeats : int
        Number of fits with new noise, 0 or 2 and more; 0 for no standard errors.
    seed : int
        Of the random numbers.
    threads : int, optional
        Number of threads; by default BEZIER_FILTERS_THREADS or all usable cores.
    progress : callable, optional
        ``progress(done, total)`` as in `estimate_vertex_geometry`, for each of the fits.

    Returns
    -------
    SurfaceMeasures

    Raises
    ------
    InvalidMeshError
        If the arrays are not a mesh with faces and finite coordinates.
    InvalidParameterError
        If labels do not fit the mesh, or a parameter is out of range.
    CancelledError
        If `progress` returned False.

    Examples
    --------
    >>> from bezier_filters.surfaces import sphere
    >>> ball = sphere(resolution=12)
    >>> found = measure(ball.vertices, ball.faces, repeats=0)
    >>> round(found.whole.values.area / np.pi, 6), round(found.whole.values.volume / np.pi, 6)
    (4.0, 1.333333)
    >>> found.whole.euler_characteristic, abs(found.whole.gauss_bonnet_error) < 1e-4
    (2, True)
    """
    if not (is_integer(repeats) and (repeats == 0 or repeats >= 2)):
        raise InvalidParameterError(f"repeats: got {brief_repr(repeats)}, expected 0, or 2 and more")
    if not (is_integer(seed) and seed >= 0):
        raise InvalidParameterError(f"seed: got {brief_repr(seed)}, expected an integer of 0 or more")
    if face_labels is not None and vertex_labels is not None:
        raise InvalidParameterError("vertex_labels: got labels of faces, too, expected labels of one of them")
    check_has_faces(faces)
    surface = fit_surface(vertices, faces, noise=noise, progress=progress)
    mesh, of_faces = surface.mesh, face_labels is not None
    labels = (
        _check_labels("face_labels", face_labels, mesh.face_count)
        if of_faces
        else _check_labels("vertex_labels", vertex_labels, mesh.vertex_count)
    )
    names, numbers = (np.empty(0, np.int64), None) if labels is None else np.unique(labels, return_inverse=True)
    values, without = _integrate(surface, numbers, len(names), of_faces=of_faces)
    sigma = surface.geometry.fit.noise_sigma
    drawn = []
    if sigma:  # without noise all draws are the fitted positions
        rng = np.random.default_rng(seed)
        for _ in range(repeats):
            again = refit_surface(surface, _draw_vertices(surface, rng), noise=noise, progress=progress)
            drawn.append(_integrate(again, numbers, len(names), of_faces=of_faces)[0])
    spread, bias = (np.std(drawn, axis=0, ddof=1), np.mean(drawn, axis=0) - values) if drawn else (None, None)
    if sigma == 0.0 and repeats:
        spread = bias = np.zeros_like(values)

    def part(row: int) -> PartMeasures:
        label = None if row == 0 else int(names[row - 1])
        border: tuple[int | None, float | None, float | None] = None, None, None
        is_closed = False
        if row == 0 or of_faces:
            inside = np.ones(mesh.face_count, np.bool_) if row == 0 else np.asarray(numbers == row - 1)
            characteristic, turning = euler_characteristic_and_turning(surface, inside)
            border = characteristic, turning, float(values[row, 3] + turning - 2.0 * np.pi * characteristic)
            is_closed = _is_closed(mesh.faces[inside])
        std, mean_error = (None if one is None else _integrals(one[row], is_closed) for one in (spread, bias))
        if std is not None and border[2] is not None:
            std = replace(std, total_gaussian_curvature=float(np.hypot(std.total_gaussian_curvature, border[2])))
        return PartMeasures(label, _integrals(values[row], is_closed), std, mean_error, *border)

    return SurfaceMeasures(
        part(0),
        tuple(part(row + 1) for row in range(len(names))),
        0 if sigma is None else int(repeats),
        None if sigma is None else float(np.ldexp(sigma, surface.exponent)),
        without,
    )


def _check_labels(name: str, labels: ArrayLike | None, count: int) -> IntArray | None:
    """Labels as integers (count,)."""
    if labels is None:
        return None
    array = np.asarray(labels)
    if array.shape != (count,) or array.dtype.kind not in "iub":
        raise InvalidParameterError(
            f"{name}: got {array.dtype} of shape {array.shape}, expected integers of shape ({count},)"
        )
    if (array > np.iinfo(np.int64).max).any():
        raise InvalidParameterError(f"{name}: got {array.max()}, expected integers below 2^63")
    return cast("IntArray", array.astype(np.int64))


def _integrate(surface: Surface, numbers: Any, count: int, *, of_faces: bool) -> tuple[FloatArray, int]:
    """Integrals (1 + count, 6) of the surface and of its parts, in the order of `Integrals`, and faces without it."""
    sums, without = np.zeros((1 + count, len(fields(Integrals)))), 0
    for points in quadrature_points(surface):
        integrands = _integrands(points)
        sums[0] += integrands.sum(axis=0)
        without += len(np.unique(points.places.faces[points.places.outcome != 0]))
        if count and of_faces:
            np.add.at(sums, 1 + numbers[points.places.faces], integrands)
        elif count:
            corners = surface.mesh.faces[points.places.faces]
            for k in range(3):
                np.add.at(sums, 1 + numbers[corners[:, k]], points.shares[:, k : k + 1] * integrands)
    return sums, without


def _integrands(points: QuadraturePoints) -> FloatArray:
    """Columns of `Integrals` at Gauss points, (q, 6)."""
    places, areas = points.places, points.areas
    return np.column_stack(
        [
            areas,
            points.volumes,
            points.mean_curvatures,
            points.gaussian_curvatures,
            np.square(places.mean_curvature) * areas,
            0.5 * (np.square(places.k_min) + np.square(places.k_max)) * areas,
        ]
    )


def _integrals(row: FloatArray, is_closed: bool) -> Integrals:
    area, volume, *others = map(float, row)
    return Integrals(area, volume if is_closed else None, *others)


def _is_closed(faces: IntArray) -> bool:
    """Whether every edge of some faces has one face on each side."""
    starts, ends = faces.ravel().astype(np.int64), np.roll(faces, -1, axis=1).ravel().astype(np.int64)
    size = int(faces.max(initial=0)) + 1
    there, back = np.sort(starts * size + ends), np.sort(ends * size + starts)
    return bool(np.array_equal(there, back) and (np.diff(there) > 0).all())


def _draw_vertices(surface: Surface, rng: np.random.Generator) -> FloatArray:
    """The fitted positions with new noise of the strength and range of the old one, (n, 3), in the given unit."""
    geometry, n = surface.geometry, surface.mesh.vertex_count
    positions = surface.mesh.vertices + geometry.displacements[:n]
    heights = rng.standard_normal(n)
    if geometry.fit.noise_length:
        reach = KERNEL_RANGES * geometry.fit.noise_length
        near = cKDTree(positions).sparse_distance_matrix(cKDTree(positions), reach, output_type="coo_matrix").tocsr()
        near.data = np.exp(-np.square(near.data / geometry.fit.noise_length))
        near = near.tolil()
        near.setdiag(1.0)
        kernel = near.tocsr()
        heights = (kernel @ heights) / np.sqrt(np.asarray(kernel.multiply(kernel).sum(axis=1)).ravel())
    moved = positions + (geometry.fit.noise_sigma or 0.0) * heights[:, np.newaxis] * geometry.normals[:n]
    return np.asarray(np.ldexp(moved, surface.exponent))
