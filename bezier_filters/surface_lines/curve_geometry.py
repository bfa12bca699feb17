"""The geometry of a curve on a surface: of the curve in space, and of the surface along it.

With the unit tangent T, the normal n of the surface and u = n x T, a curve on a surface has

    T' = k_g u - k_n n,   n' = k_n T - t_g u,   u' = -k_g T + t_g n

with the normal curvature k_n (convex positive), the geodesic curvature k_g and the geodesic torsion t_g; k_n and t_g
follow from the direction T alone: k_n = k_max cos^2 theta + k_min sin^2 theta, t_g = (k_max - k_min) / 2 sin 2 theta.
The curvature of the curve is sqrt(k_g^2 + k_n^2), and with the angle psi of its principal normal, cos psi = k_g / k and
sin psi = -k_n / k, its Frenet torsion is t_g + psi' (do Carmo, "Differential geometry of curves and surfaces", 1976,
section 3-2, exercises 17 to 19). So only k_g and psi' need differences between points; all else is the surface's.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.errors import InvalidParameterError, is_integer
from bezier_filters.meshes.unit_size import CURVATURE, LENGTH
from bezier_filters.patch_surface.query_arguments import check_points
from bezier_filters.patch_surface.surface import Surface, check_surface

MIN_NEIGHBOURS = 2  # on each side: five points determine a cubic


@dataclass(frozen=True)
class CurveGeometry:
    """Geometry of a curve on a surface at k points; curvatures and torsions in 1/length.

    Attributes
    ----------
    points : (k, 3) float64
        Nearest places on the surface of the given points.
    arc_lengths : (k,) float64
        Length of the polyline up to each of them.
    tangents, normals : (k, 3) float64
        Unit tangents of the curve, in its order, and unit normals of the surface.
    curvature : (k,) float64
        Of the curve in space, 0 or more.
    torsion : (k,) float64
        Frenet torsion of the curve, positive for a right-handed helix; 0 where it is not defined, see `has_torsion`.
    normal_curvature : (k,) float64
        Of the surface along the curve, positive where the surface is convex.
    geodesic_curvature : (k,) float64
        Of the curve within the surface, positive where it turns left, seen from outside.
    geodesic_torsion : (k,) float64
        Of the surface along the curve, see `VertexGeometry.torsion_along`.
    normal_curvature_std, geodesic_curvature_std, geodesic_torsion_std : (k,) float64
        Standard errors: from the noise of the mesh, in the given direction; and, for the geodesic curvature, from how
        far the points are from a smooth curve.
    has_torsion : (k,) bool
        Whether the curve has a torsion: its curvature exceeds twice its standard error.
    """

    points: FloatArray = field(metadata=LENGTH)
    arc_lengths: FloatArray = field(metadata=LENGTH)
    tangents: FloatArray
    normals: FloatArray
    curvature: FloatArray = field(metadata=CURVATURE)
    torsion: FloatArray = field(metadata=CURVATURE)
    normal_curvature: FloatArray = field(metadata=CURVATURE)
    geodesic_curvature: FloatArray = field(metadata=CURVATURE)
    geodesic_torsion: FloatArray = field(metadata=CURVATURE)
    normal_curvature_std: FloatArray = field(metadata=CURVATURE)
    geodesic_curvature_std: FloatArray = field(metadata=CURVATURE)
    geodesic_torsion_std: FloatArray = field(metadata=CURVATURE)
    has_torsion: BoolArray


def curve_geometry(
    surface: Surface, points: ArrayLike, *, neighbours: int = 4, threads: int | None = None
) -> CurveGeometry:
    """Curvature and torsion of a curve on a surface, and normal and geodesic curvature and geodesic torsion along it.

    The points are projected to the surface. Tangents and geodesic curvature are those of cubics fitted to every point
    and its neighbours along the polyline, by least squares; the rest follows from the surface, see
    `bezier_filters.surface_lines.curve_geometry`.

    Parameters
    ----------
    surface : Surface
        From `fit_surface`.
    points : (k, 3) array_like of float
        Points in order, such as those of a `SurfaceLine` or a `CreaseLine`, at least twice as many as neighbours and
        one; a closed curve repeats its first point at the end. Coincident points in sequence are refused.
    neighbours : int
        Points on each side, at least 2. More of them smooth rough lines, such as those across the edges of a mesh.
    threads : int, optional
        Number of threads.

    Returns
    -------
    CurveGeometry

    Raises
    ------
    InvalidParameterError
        If the points are not finite numbers of shape (k, 3), too few or coincident.

    Examples
    --------
    A circle of latitude on a sphere of radius 1, of radius 0.6:

    >>> from bezier_filters import fit_surface
    >>> from bezier_filters.surfaces import sphere
    >>> ball = sphere()
    >>> angles = np.arange(61) % 60 * np.pi / 30.0
    >>> circle = np.column_stack([0.6 * np.cos(angles), 0.6 * np.sin(angles), np.full(61, 0.8)])
    >>> found = curve_geometry(fit_surface(ball.vertices, ball.faces), circle)
    >>> bool(abs(found.curvature - 1 / 0.6).max() < 0.02), bool(abs(found.normal_curvature - 1).max() < 0.01)
    (True, True)
    >>> bool(abs(found.geodesic_curvature - 0.8 / 0.6).max() < 0.02), bool(abs(found.torsion).max() < 0.02)
    (True, True)
    """
    check_surface(surface)
    given = _curve_points(points, neighbours)
    is_closed = bool((given[0] == given[-1]).all())
    there = surface.query(given, threads=threads)
    scaled = np.ldexp(there.points, -surface.exponent)
    if is_closed:
        scaled[-1] = scaled[0]
    lengths = np.linalg.norm(np.diff(scaled, axis=0), axis=1)
    if not (lengths > 0.0).all():
        raise InvalidParameterError("points: two in sequence coincide on the surface")
    arc = np.concatenate([[0.0], np.cumsum(lengths)])
    windows, offsets = _windows(arc, neighbours, is_closed=is_closed)
    first, second, second_std = _derivatives(scaled[windows], offsets)
    normals = there.normals
    tangents = first - np.einsum("ij,ij->i", first, normals)[:, np.newaxis] * normals
    speed = np.linalg.norm(tangents, axis=1, keepdims=True)
    tangents /= speed
    left = np.cross(normals, tangents)
    geodesic = np.einsum("ij,ij->i", second, left) / speed[:, 0] ** 2
    cosine = np.einsum("ij,ij->i", tangents, there.direction_max)
    sine = np.einsum("ij,ij->i", tangents, there.direction_min)
    unit = np.ldexp(1.0, surface.exponent)
    k_min, k_max, mean_std = there.k_min * unit, there.k_max * unit, there.mean_curvature_std * unit
    normal = k_max * cosine**2 + k_min * sine**2
    twist = (k_max - k_min) * sine * cosine
    curvature = np.hypot(normal, geodesic)
    angle = np.unwrap(np.arctan2(-normal, geodesic))
    around = angle[windows]
    if is_closed:  # across the seam
        around = angle[np.arange(len(arc))][:, np.newaxis] + np.angle(np.exp(1j * (around - angle[:, np.newaxis])))
    turn = _derivatives(around[:, :, np.newaxis], offsets)[0][:, 0]
    normal_std, twist_std = np.sqrt(1.5) * mean_std, np.sqrt(0.5) * mean_std
    exists = curvature > 2.0 * np.hypot(normal_std, second_std)
    values = {
        "curvature": curvature,
        "torsion": np.where(exists, twist + turn, 0.0),
        "normal_curvature": normal,
        "geodesic_curvature": geodesic,
        "geodesic_torsion": twist,
        "normal_curvature_std": normal_std,
        "geodesic_curvature_std": second_std,
        "geodesic_torsion_std": twist_std,
    }
    return CurveGeometry(
        points=np.ldexp(scaled, surface.exponent),
        arc_lengths=np.ldexp(arc, surface.exponent),
        tangents=tangents,
        normals=normals,
        has_torsion=exists,
        **{name: np.asarray(value / unit) for name, value in values.items()},
    )


def _curve_points(points: ArrayLike, neighbours: int) -> FloatArray:
    """The points, checked."""
    if not (is_integer(neighbours) and neighbours >= MIN_NEIGHBOURS):
        raise InvalidParameterError(f"neighbours: got {neighbours!r}, expected an integer of {MIN_NEIGHBOURS} or more")
    given, least = check_points(points), 2 * neighbours + 1
    if len(given) < least:
        raise InvalidParameterError(
            f"points: got {len(given)}, expected {least} or more for {neighbours} neighbours on each side"
        )
    return given


def _windows(arc: FloatArray, neighbours: int, *, is_closed: bool) -> tuple[IntArray, FloatArray]:
    """Rows of the points around each one, (k, 2 j + 1), and their arc lengths from it; at an end those next to it."""
    k, count = len(arc), 2 * neighbours + 1
    if is_closed:  # the last point is the first one
        rows = np.arange(-neighbours, k + neighbours, dtype=np.int32)
        turns, places = np.divmod(rows, k - 1)
        around = sliding_window_view(arc[places] + turns * arc[-1], count)
        return np.asarray(sliding_window_view(places, count), dtype=np.int32), around - arc[:, np.newaxis]
    starts = np.clip(np.arange(k) - neighbours, 0, k - count)
    windows: IntArray = np.add.outer(starts, np.arange(count)).astype(np.int32)
    return windows, np.asarray(arc[windows] - arc[:, np.newaxis])


def _derivatives(values: FloatArray, offsets: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """First and second derivatives (k, d) at offset 0 of cubics fitted to values (k, c, d) at offsets (k, c).

    Also the standard error (k,) of the components of the second one.
    """
    scale = np.abs(offsets).max(axis=1)[:, np.newaxis]
    powers = (offsets / scale)[:, :, np.newaxis] ** np.arange(4)
    inverse = np.linalg.pinv(powers)
    found = inverse @ values
    residuals = values - powers @ found
    freedom = max(values.shape[1] - 4, 1) * values.shape[2]
    sigma = np.sqrt(np.square(residuals).sum(axis=(1, 2)) / freedom)
    spread = np.linalg.norm(inverse[:, 2], axis=1)
    return found[:, 1] / scale, 2.0 * found[:, 2] / scale**2, 2.0 * sigma * spread / scale[:, 0] ** 2
