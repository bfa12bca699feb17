"""Open surfaces: a tube, graphs z(x, y) with upward normals, and a patch with holes."""

from collections.abc import Callable, Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from bezier_filters.arrays import FloatArray
from bezier_filters.errors import InvalidParameterError
from bezier_filters.surfaces import sampling
from bezier_filters.surfaces.sampling import SampledSurface, check_finite, check_positive, check_resolution

HeightFunction: TypeAlias = Callable[[FloatArray, FloatArray], Sequence[ArrayLike]]
"""Maps x and y, each (n,), to z, z_x, z_y, z_xx, z_xy, z_yy, each (n,) or a number."""


def cylinder(
    *, radius: float = 1.0, length: float = 3.0, resolution: int = 36, jitter: float = 0.0, seed: int = 0
) -> SampledSurface:
    """Open tube about the z axis, centred at the origin: H = 1/(2 radius), K = 0.

    Parameters
    ----------
    radius, length : float
        Positive lengths.
    resolution : int
        Samples around the tube, at least 6.
    jitter : float
        Displacement of every sample, in a random direction along the tube, as a fraction of the
        edge; at least 0, below 0.35. Samples on a rim slide along it. Jittered samples are
        triangulated again (Delaunay on the unrolled tube).
    seed : int
        Seed of the displacements.

    Returns
    -------
    SampledSurface
        Mesh with two rims and normals away from the axis.

    Raises
    ------
    InvalidParameterError
        If a parameter is out of range.

    Examples
    --------
    >>> tube = cylinder(radius=0.5, length=1)
    >>> np.allclose(tube.k_max, 2), bool(np.abs(tube.k_min).max() < 1e-12)
    (True, True)
    """
    check_positive(radius=radius, length=length)
    check_resolution(resolution, 6)
    cells = (resolution, max(1, round(resolution * length / (2 * np.pi * radius))))
    lattice, faces = sampling.rectangle(cells, wrapped=(True, False), jitter=jitter, seed=seed)
    outward = sampling.radial_directions(2 * np.pi * lattice[:, 0] / cells[0])
    vertices = radius * outward
    vertices[:, 2] = length * (lattice[:, 1] / cells[1] - 0.5)
    return SampledSurface.from_level_set(vertices, faces, radius * outward, np.diag([1.0, 1.0, 0.0]))


def height_field(
    function: HeightFunction,
    *,
    size: float = 2.0,
    holes: Sequence[tuple[float, float, float]] = (),
    resolution: int = 36,
    jitter: float = 0.0,
    seed: int = 0,
) -> SampledSurface:
    """Graph of any function z(x, y) over a square around the origin.

    The normal is (-z_x, -z_y, 1) / sqrt(1 + z_x^2 + z_y^2), upward: curvatures are positive where
    the patch is a hill and negative where it is a bowl.

    Parameters
    ----------
    function : callable
        Maps x and y, each (n,), to the six arrays or numbers z, z_x, z_y, z_xx, z_xy, z_yy.
    size : float
        Side of the square, a positive length.
    holes : sequence of (x, y, radius)
        Holes in the patch, round as seen from above; their radii are at least one edge and their
        rims at least three edges apart from each other and from the border (edges of ``size / resolution``).
    resolution : int
        Edges along each side of the square, at least 1.
    jitter : float
        Displacement of every sample, in a random direction in x and y, as a fraction of the edge;
        at least 0, below 0.35. Samples on the border slide along it, those on the rims of holes
        stay. Jittered samples are triangulated again (Delaunay in x and y).
    seed : int
        Seed of the displacements.

    Returns
    -------
    SampledSurface
        Open mesh with upward normals.

    Raises
    ------
    InvalidParameterError
        If a parameter is out of range, or the function returns anything but six finite arrays.

    Examples
    --------
    A parabolic bowl, H = -1 at its bottom:

    >>> bowl = height_field(lambda x, y: ((x**2 + y**2) / 2, x, y, 1.0, 0.0, 1.0), size=1)
    >>> round(float(bowl.mean_curvature.min()), 6)
    -1.0
    """
    check_positive(size=size)
    check_resolution(resolution, 1)
    edge = size / resolution
    holes_in_cells = [((x + size / 2) / edge, (y + size / 2) / edge, radius / edge) for x, y, radius in holes]
    lattice, faces = sampling.rectangle((resolution, resolution), holes=holes_in_cells, jitter=jitter, seed=seed)
    x, y = ((lattice / resolution - 0.5) * size).T
    derivatives = function(x, y)
    if len(derivatives) != 6:
        raise InvalidParameterError(f"function returned {len(derivatives)} values, expected z and its five derivatives")
    z, z_x, z_y, z_xx, z_xy, z_yy = (np.broadcast_to(np.asarray(d, dtype=np.float64), x.shape) for d in derivatives)
    gradients = np.stack([-z_x, -z_y, np.ones_like(x)], axis=1)
    hessians = np.zeros((len(x), 3, 3))
    hessians[:, 0, 0] = -z_xx
    hessians[:, 0, 1] = hessians[:, 1, 0] = -z_xy
    hessians[:, 1, 1] = -z_yy
    vertices = np.stack([x, y, z], axis=1)
    if not (np.isfinite(vertices).all() and np.isfinite(gradients).all() and np.isfinite(hessians).all()):
        raise InvalidParameterError("function returned values that are not finite")
    return SampledSurface.from_level_set(vertices, faces, gradients, hessians)


def monkey_saddle(
    *, strength: float = 0.3, size: float = 2.0, resolution: int = 36, jitter: float = 0.0, seed: int = 0
) -> SampledSurface:
    """Monkey saddle z = strength (x^3 - 3 x y^2): K <= 0 everywhere, a flat point in the middle.

    Parameters
    ----------
    strength : float
        Factor of the cubic, 1/length^2.
    size, resolution, jitter, seed
        As in `height_field`.

    Returns
    -------
    SampledSurface
        Open mesh with upward normals.

    Raises
    ------
    InvalidParameterError
        If a parameter is out of range.

    Examples
    --------
    >>> saddle = monkey_saddle(resolution=10)
    >>> bool(saddle.gaussian_curvature.max() <= 0), saddle.vertices.shape
    (True, (121, 3))
    """
    check_finite(strength=strength)

    def function(x: FloatArray, y: FloatArray) -> Sequence[ArrayLike]:
        cubic = np.array([x**3 - 3 * x * y**2, 3 * x**2 - 3 * y**2, -6 * x * y, 6 * x, -6 * y, -6 * x])
        return list(strength * cubic)

    return height_field(function, size=size, resolution=resolution, jitter=jitter, seed=seed)


def waves(
    *,
    amplitude: float = 0.1,
    wavelength: float = 1.0,
    size: float = 2.0,
    resolution: int = 36,
    jitter: float = 0.0,
    seed: int = 0,
) -> SampledSurface:
    """Egg carton z = amplitude sin(w x) cos(w y) with w = 2 pi / wavelength.

    At the tops H = amplitude w^2, at the bottoms its negative; K changes sign between them.

    Parameters
    ----------
    amplitude : float
        Height of the tops, a length.
    wavelength : float
        Distance from top to top along x and y, a positive length.
    size, resolution, jitter, seed
        As in `height_field`.

    Returns
    -------
    SampledSurface
        Open mesh with upward normals.

    Raises
    ------
    InvalidParameterError
        If a parameter is out of range.

    Examples
    --------
    >>> carton = waves(amplitude=0.1, wavelength=2 * np.pi, size=4 * np.pi, resolution=8)
    >>> round(float(carton.mean_curvature.max()), 6)
    0.1
    """
    function = _wave_function(amplitude, wavelength)
    return height_field(function, size=size, resolution=resolution, jitter=jitter, seed=seed)


def punched_patch(
    *,
    holes: Sequence[tuple[float, float, float]] = ((-0.45, -0.4, 0.22), (0.45, -0.25, 0.32), (0.0, 0.5, 0.15)),
    amplitude: float = 0.1,
    wavelength: float = 1.0,
    size: float = 2.0,
    resolution: int = 36,
    jitter: float = 0.0,
    seed: int = 0,
) -> SampledSurface:
    """The egg carton of `waves` with round holes: a case for hole filling whose truth is known.

    Parameters
    ----------
    holes : sequence of (x, y, radius)
        As in `height_field`; by default three of different sizes.
    amplitude, wavelength
        As in `waves`.
    size, resolution, jitter, seed
        As in `height_field`.

    Returns
    -------
    SampledSurface
        Mesh with one rim per hole and the border, and upward normals.

    Raises
    ------
    InvalidParameterError
        If a parameter is out of range.

    Examples
    --------
    >>> patch = punched_patch(holes=[(0.0, 0.0, 0.5)], resolution=20)
    >>> bool(np.hypot(patch.vertices[:, 0], patch.vertices[:, 1]).min() > 0.499)
    True
    """
    function = _wave_function(amplitude, wavelength)
    return height_field(function, size=size, holes=holes, resolution=resolution, jitter=jitter, seed=seed)


def _wave_function(amplitude: float, wavelength: float) -> HeightFunction:
    """Heights amplitude sin(w x) cos(w y) and their derivatives."""
    check_finite(amplitude=amplitude)
    check_positive(wavelength=wavelength)
    w = 2 * np.pi / wavelength

    def function(x: FloatArray, y: FloatArray) -> Sequence[ArrayLike]:
        sin_x, cos_x, sin_y, cos_y = np.sin(w * x), np.cos(w * x), np.sin(w * y), np.cos(w * y)
        z = amplitude * sin_x * cos_y
        slope = amplitude * w
        return [
            z,
            slope * cos_x * cos_y,
            -slope * sin_x * sin_y,
            -(w**2) * z,
            -slope * w * cos_x * sin_y,
            -(w**2) * z,
        ]

    return function
