"""Closed surfaces: outward normals, no boundary."""

import numpy as np

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.errors import InvalidParameterError
from bezier_filters.surfaces import sampling
from bezier_filters.surfaces.sampling import SampledSurface, check_positive, check_resolution


def sphere(*, radius: float = 1.0, resolution: int = 12, jitter: float = 0.0, seed: int = 0) -> SampledSurface:
    """Sphere around the origin: H = 1/radius, K = 1/radius^2, every point an umbilic.

    Parameters
    ----------
    radius : float
        Radius, a positive length.
    resolution : int
        Parts of each icosahedron edge, at least 1; the mesh has ``10 resolution^2 + 2`` vertices.
    jitter : float
        Displacement of every sample, in a random direction along the sphere, as a fraction of the
        edge; at least 0, below 0.35. Jittered samples are triangulated again (spherical Delaunay).
    seed : int
        Seed of the displacements.

    Returns
    -------
    SampledSurface
        Closed mesh with outward normals.

    Raises
    ------
    InvalidParameterError
        If a parameter is out of range.

    Examples
    --------
    >>> ball = sphere(radius=2, resolution=5, jitter=0.3)
    >>> ball.vertices.shape
    (252, 3)
    >>> np.allclose(ball.mean_curvature, 0.5), np.allclose(ball.gaussian_curvature, 0.25)
    (True, True)
    """
    check_positive(radius=radius)
    return ellipsoid(semi_axes=(radius, radius, radius), resolution=resolution, jitter=jitter, seed=seed)


def ellipsoid(
    *,
    semi_axes: tuple[float, float, float] = (1.0, 0.7, 0.5),
    resolution: int = 12,
    jitter: float = 0.0,
    seed: int = 0,
) -> SampledSurface:
    """Ellipsoid (x/a)^2 + (y/b)^2 + (z/c)^2 = 1.

    The mesh is that of the unit sphere, stretched along the axes.

    Parameters
    ----------
    semi_axes : tuple of three floats
        a, b and c, positive lengths.
    resolution, jitter, seed
        As in `sphere`; the jitter is that of the directions from the centre.

    Returns
    -------
    SampledSurface
        Closed mesh with outward normals.

    Raises
    ------
    InvalidParameterError
        If a parameter is out of range.

    Examples
    --------
    The largest mean curvature is that of the ends of the longest axis, a/2 (1/b^2 + 1/c^2):

    >>> egg = ellipsoid(semi_axes=(2, 1, 1), resolution=10)
    >>> round(float(egg.mean_curvature.max()), 2)
    2.0
    """
    if np.shape(semi_axes) != (3,):
        raise InvalidParameterError(f"semi_axes is {semi_axes!r}, but must be three lengths")
    for semi_axis in semi_axes:
        check_positive(semi_axes=semi_axis)
    directions, faces = sampling.sphere_directions(resolution, jitter=jitter, seed=seed)
    axes = np.asarray(semi_axes, dtype=np.float64)
    # F is half of the sum above.
    return SampledSurface.from_level_set(directions * axes, faces, directions / axes, np.diag(axes**-2))


def bumpy_star(
    *,
    amplitude: float = 0.08,
    frequencies: tuple[float, float, float] = (4.0, 5.0, 6.0),
    resolution: int = 12,
    jitter: float = 0.0,
    seed: int = 0,
) -> SampledSurface:
    """Star-shaped blob: the direction d has the radius r = 1 + amplitude sum_k sin(frequency_k d_k).

    Smooth everywhere and without symmetry, with bumps, dents and saddles.

    Parameters
    ----------
    amplitude : float
        Height of the bumps, less than 1/3 in size, so that the radius stays positive.
    frequencies : tuple of three floats
        Radians per unit of x, y and z; higher ones make smaller bumps.
    resolution, jitter, seed
        As in `sphere`; the jitter is that of the directions from the centre.

    Returns
    -------
    SampledSurface
        Closed mesh with outward normals.

    Raises
    ------
    InvalidParameterError
        If a parameter is out of range.

    Examples
    --------
    >>> blob = bumpy_star(resolution=10)
    >>> bool(blob.gaussian_curvature.min() < 0 < blob.gaussian_curvature.max())
    True
    """
    if not abs(amplitude) < 1 / 3:
        raise InvalidParameterError(f"amplitude is {amplitude!r}, but must be less than 1/3 in size")
    if np.shape(frequencies) != (3,) or not np.isfinite(frequencies).all():
        raise InvalidParameterError(f"frequencies is {frequencies!r}, but must be three finite numbers")
    directions, faces = sampling.sphere_directions(resolution, jitter=jitter, seed=seed)
    phases = directions * frequencies
    bumps = amplitude * np.sin(phases)
    slopes = amplitude * np.cos(phases) * frequencies
    radii = 1.0 + bumps.sum(axis=1)[:, None]

    # F = |p| - r(p / |p|); the chain rule brings in the tangent projection P of the unit sphere.
    radial_slopes = np.einsum("ni,ni->n", slopes, directions)[:, None]
    tangent_slopes = slopes - radial_slopes * directions
    projection = np.eye(3) - directions[:, :, None] * directions[:, None, :]
    bending = (projection * (-bumps * np.square(frequencies))[:, None, :]) @ projection
    mixed = directions[:, :, None] * tangent_slopes[:, None, :]
    bending -= radial_slopes[:, :, None] * projection + mixed + mixed.transpose(0, 2, 1)
    gradients = directions - tangent_slopes / radii
    hessians = projection / radii[:, :, None] - bending / radii[:, :, None] ** 2
    return SampledSurface.from_level_set(radii * directions, faces, gradients, hessians)


def torus(
    *,
    major_radius: float = 1.0,
    minor_radius: float = 0.4,
    resolution: int = 24,
    jitter: float = 0.0,
    seed: int = 0,
) -> SampledSurface:
    """Torus (sqrt(x^2 + y^2) - R)^2 + z^2 = r^2 about the z axis.

    At the angle v around the tube (v = 0 on the outer equator) its principal curvatures are 1/r and
    cos v / (R + r cos v). It has no umbilics.

    Parameters
    ----------
    major_radius, minor_radius : float
        R and r, positive lengths, r < R.
    resolution : int
        Samples around the tube, at least 6; there are R/r times as many around the axis.
    jitter : float
        Displacement of every sample, in a random direction along the torus, as a fraction of the
        edge; at least 0, below 0.35. Jittered samples are triangulated again (Delaunay over the angles).
    seed : int
        Seed of the displacements.

    Returns
    -------
    SampledSurface
        Closed mesh with outward normals.

    Raises
    ------
    InvalidParameterError
        If a parameter is out of range.

    Examples
    --------
    >>> ring = torus(major_radius=2, minor_radius=0.5, resolution=12)
    >>> ring.vertices.shape
    (576, 3)
    >>> np.allclose(ring.k_max, 1 / 0.5), round(float(ring.k_min.max()), 6)
    (True, 0.4)
    """
    check_positive(major_radius=major_radius, minor_radius=minor_radius)
    if not minor_radius < major_radius:
        raise InvalidParameterError(
            f"minor_radius is {minor_radius!r}, but must be less than major_radius, {major_radius!r}"
        )
    check_resolution(resolution, 6)
    cells = (round(resolution * major_radius / minor_radius), resolution)
    lattice, faces = sampling.rectangle(cells, wrapped=(True, True), jitter=jitter, seed=seed)
    u, v = (2 * np.pi * lattice / cells).T
    outward = sampling.radial_directions(u)
    around = sampling.radial_directions(u + 0.5 * np.pi)
    axial = np.array([0.0, 0.0, 1.0])
    axis_distance = (major_radius + minor_radius * np.cos(v))[:, None]
    # F is half of the equation above.
    gradients = minor_radius * (np.cos(v)[:, None] * outward + np.sin(v)[:, None] * axial)
    hessians = _outer(outward) + np.diag(axial) + ((1 - major_radius / axis_distance)[:, :, None] * _outer(around))
    vertices = axis_distance * outward + (minor_radius * np.sin(v))[:, None] * axial
    return SampledSurface.from_level_set(vertices, faces, gradients, hessians)


def block_with_sharp_edges(
    *, size: float = 1.0, resolution: int = 16, jitter: float = 0.0, seed: int = 0
) -> tuple[FloatArray, IntArray]:
    """Cube around the origin without its octant x, y, z > 0: convex and concave sharp edges and corners.

    Normals and curvatures are undefined on the edges, so there is no truth but the shape. The
    edges of the block are exactly edges of the mesh.

    Parameters
    ----------
    size : float
        Side of the cube, a positive length.
    resolution : int
        Mesh edges along the side of the cube, even; the mesh has ``6 resolution^2 + 2`` vertices.
    jitter : float
        Largest displacement of the samples, in random directions, as a fraction of the edge; at
        least 0, below 0.35. Samples stay on their face or edge of the block. Random diagonals if
        it is positive.
    seed : int
        Seed of the displacements and diagonals.

    Returns
    -------
    vertices : (n, 3) float64
        Points of the block's surface.
    faces : (m, 3) int32
        Outward triangles of a closed mesh.

    Raises
    ------
    InvalidParameterError
        If a parameter is out of range.

    Examples
    --------
    >>> vertices, faces = block_with_sharp_edges(resolution=10)
    >>> vertices.shape, faces.shape
    ((602, 3), (1200, 3))
    """
    check_positive(size=size)
    points, faces = sampling.cube_with_notch(resolution, jitter=jitter, seed=seed)
    return (points / resolution - 0.5) * size, faces


def _outer(vectors: FloatArray) -> FloatArray:
    """Outer products of the rows with themselves, shape (n, 3, 3)."""
    return vectors[:, :, None] * vectors[:, None, :]
