"""Noise of rounded coordinates: meshes whose faces are stairs, as those of voxel masks and of heights in whole metres.

Boundaries of voxel masks, heights in whole metres and coordinates of low precision are rounded to a step s, which is
noise of standard deviation s / sqrt(12) along that axis (Widrow, Kollar, "Quantization Noise", 2008). If steps are
about as long as edges, the dihedral angles of the stairs look like sharp edges.

The error of a mask is correlated over its terraces; where these are wider than a neighbourhood, residuals do not show
it. Not all coordinates that are multiples of a step are rounded. Two axes on which no two vertices share both
coordinates are a sampling grid, as x and y of a height field. And stairs have treads and risers, so that their convex
and concave edges lie side by side, which those of bodies made of bricks do not.
"""

from dataclasses import replace
from itertools import product
from math import radians

import numpy as np

from bezier_filters.arrays import FloatArray
from bezier_filters.meshes.half_edges import mesh_edges
from bezier_filters.meshes.prepared_mesh import PreparedMesh
from bezier_filters.noise.lattice import SINGLE_ERROR, find_lattice, orthogonal_frames
from bezier_filters.noise.noise_model import NO_NOISE, NoiseModel
from bezier_filters.noise.rounding import Rounding, significant_digits

# The tested meshes are 18 masks and terrains, and 11 bodies of bricks and real meshes. Where nothing else is said, half
# and twice a constant decide alike for all of them.

MAX_STEP_SAMPLE = 20_000  # vertices of which the steps are found: a larger sample sees shorter steps
# largest share of distinct values among the coordinates of an axis: steps of a twentieth of an edge and more have fewer
MAX_DISTINCT_SHARE = 0.7
STEP_TOLERANCE = 1e-5  # of a multiple: error of the step itself, which is a difference of two coordinates
# Share of vertices with a pair of coordinates of their own from which on it is a grid, and of vertices with one
# coordinate half-way from which on it is a mask. With 0.5 some masks count as grids.
MIN_DISTINCT_PAIRS = 0.99
# Of most steps of significant digits over the step of all coordinates: multiples of one step have few digits, too.
MIN_STEP_RATIO = 1.5
# Noise by rounding over the mean edge from which on the stairs look like sharp edges: below it a step turns the normal
# of a face by less than about 20 degrees. With 0.2 a terrain in steps of 0.8 cells is no longer stairs.
MIN_STAIR_NOISE = 0.1
# Nugget and range, mean edges, of the errors of masks, as learned where residuals show them (a ball of radius 10, a
# torus of 6): with a range of 1 or a nugget of 0.3, balls of radius 20 and 30 get the same curvature
MASK_NUGGET, MASK_RANGE = 0.1, 0.75
# Share of vertices on sharp edges that have convex and concave edges above this angle around: 0.76 to 1 on masks and
# terrains in whole metres, 0 to 0.05 on bodies made of bricks, at most 0.4 on CAD parts and clean scans. With 0.8 two
# masks are not stairs; with 60 degrees most are not, as the edges of treads turn by 45.
MIN_RISER_SHARE, MIN_RISER_ANGLE = 0.6, radians(30.0)


def rounding_noise(mesh: PreparedMesh) -> NoiseModel:
    """Noise along the normal of coordinates whose steps have left stairs; of variance 0 if there are none.

    >>> from bezier_filters.meshes.mesh import triangle_mesh
    >>> from bezier_filters.meshes.prepared_mesh import prepare_mesh
    >>> from bezier_filters.surfaces import block_with_sharp_edges, waves
    >>> hills = waves(resolution=60, amplitude=0.3)
    >>> heights = np.round(hills.vertices * [1.0, 1.0, 30.0]) / [1.0, 1.0, 30.0]
    >>> terrain = np.column_stack([hills.vertices[:, :2], heights[:, 2]])
    >>> bricks = block_with_sharp_edges(resolution=16)
    >>> noise = [rounding_noise(prepare_mesh(triangle_mesh(*one))) for one in ((terrain, hills.faces), bricks)]
    >>> bool(0.4 < np.sqrt(12.0) * noise[0].sigma * 30.0 < 1.0), noise[1].sigma
    (True, 0.0)
    """
    found = _find_rounding(mesh)
    if found is None:
        return NO_NOISE
    variance = _stair_variance(mesh, found)
    if not found.is_mask or variance == 0.0:
        return NoiseModel(variance, rounding=found)
    sills, ranges = ((1.0 - MASK_NUGGET) * variance,), (MASK_RANGE * mesh.mean_edge,)
    return NoiseModel(MASK_NUGGET * variance, sills, ranges, rounding=found)


def describe_rounding(mesh: PreparedMesh) -> str:
    """Say what the stairs of a mesh come from; empty if there are none.

    >>> from bezier_filters.meshes.mesh import triangle_mesh
    >>> from bezier_filters.meshes.prepared_mesh import prepare_mesh
    >>> from bezier_filters.surfaces import waves
    >>> hills = waves(resolution=60, amplitude=0.3)
    >>> terrain = np.column_stack([30.0 * hills.vertices[:, :2], np.round(30.0 * hills.vertices[:, 2])])
    >>> describe_rounding(prepare_mesh(triangle_mesh(terrain, hills.faces)))
    'stairs: z is rounded to multiples of 1; this counts as noise, and the edges of the stairs are not sharp edges'
    """
    found = _find_rounding(mesh)
    if found is None or _stair_variance(mesh, found) == 0.0:
        return ""
    lengths = [f"{step:.4g}" for step in found.steps]
    if found.is_mask:
        source = "they bound a voxel mask with voxels of " + " x ".join(lengths)
    elif found.axes is None:
        source = " and ".join(
            f"{axis} is rounded to multiples of {length}"
            for axis, length, step in zip("xyz", lengths, found.steps, strict=True)
            if step
        )
    else:
        source = " and ".join(
            f"coordinates along ({axis[0]:.3f}, {axis[1]:.3f}, {axis[2]:.3f}) are rounded to multiples of {length}"
            for axis, length, step in zip(found.axes, lengths, found.steps, strict=True)
            if step
        )
    if found.is_mask and found.axes is not None:
        source += ", which is turned"
    return f"stairs: {source}; this counts as noise, and the edges of the stairs are not sharp edges"


def _find_rounding(mesh: PreparedMesh) -> Rounding | None:
    """How the coordinates are rounded, along the axes or else those of a lattice; None if they are not."""
    if not mesh.face_count:
        return None
    found: Rounding | None = None
    used = mesh.vertices[mesh.planes.normals.any(axis=1)]
    steps = coordinate_steps(used)
    if (steps > 0.0).any():
        found = _rounding_along(mesh, mesh.vertices, None)
    elif mesh.barriers.any() and (lattice := find_lattice(mesh)) is not None:
        for frame in orthogonal_frames(lattice):
            along = _rounding_along(mesh, frame.coordinates(lattice.places), frame.axes)
            found = along if found is None or (along is not None and along.is_mask) else found
            if found is not None and found.is_mask:
                break
    if found is not None and found.is_mask:
        return found
    relative = Rounding(np.zeros(3), digits=significant_digits(used))
    if len(used) and (relative.steps_of(used) > MIN_STEP_RATIO * steps).mean() > 0.5:
        return replace(relative, steps=np.zeros(3) if found is None else found.steps)
    return found


def _stair_variance(mesh: PreparedMesh, rounding: Rounding) -> float:
    """Mean variance of the noise along the normals, length^2, if its steps have left stairs; 0 if they have not."""
    has_normal = mesh.planes.normals.any(axis=1)
    variances = rounding.variances(mesh.vertices[has_normal], mesh.planes.normals[has_normal])
    mean = float(variances.mean()) if len(variances) else 0.0
    return mean if mean > (MIN_STAIR_NOISE * mesh.mean_edge) ** 2 and _has_risers(mesh) else 0.0


def coordinate_steps(vertices: FloatArray) -> FloatArray:
    """Steps of which the coordinates of each axis are multiples, up to an offset, (3,); 0 where there is none.

    >>> heights = np.random.default_rng(0).normal(size=(1000, 3))
    >>> coordinate_steps(np.round(heights / [1.0, 0.5, 1e-9]) * [1.0, 0.5, 1e-9])
    array([1. , 0.5, 0. ])
    """
    stride = max(len(vertices) // MAX_STEP_SAMPLE, 1)
    sample = vertices[::stride]
    return np.array([_step(sample[:, axis]) for axis in range(3)])


def _step(values: FloatArray) -> float:
    """The step of one axis: the smallest difference, if all differences are multiples of it."""
    distinct = np.unique(values)
    scale = max(abs(float(distinct[0])), abs(float(distinct[-1]))) if len(distinct) else 0.0
    if not 2 < len(distinct) <= MAX_DISTINCT_SHARE * len(values):
        return 0.0
    differences = np.diff(distinct)
    differences = differences[differences > SINGLE_ERROR * scale]
    if len(differences) < 2:
        return 0.0
    step = float(differences.min())
    multiples = differences / step
    tolerance = STEP_TOLERANCE * multiples + SINGLE_ERROR * scale / step
    is_multiple = np.abs(multiples - np.round(multiples)) <= tolerance
    return step if is_multiple.all() else 0.0


def _rounding_along(mesh: PreparedMesh, coordinates: FloatArray, axes: FloatArray | None) -> Rounding | None:
    """How the coordinates (n, 3) along some axes are rounded; None if they are not.

    Axes of a sampling grid are not rounded. Of a vertex of a mask, only the coordinate half-way between voxels is, to
    the whole voxel.
    """
    has_normal = mesh.planes.normals.any(axis=1)
    points = coordinates[has_normal]
    steps = coordinate_steps(points)
    if not len(points) or not (steps > 0.0).any():
        return None
    rounded = _remove_grid_steps(points, steps)
    if (rounded > 0.0).all():
        center = _voxel_center(points, steps)
        if center is not None:
            found = Rounding(2.0 * steps, True, center, axes)
            shift = np.median(found.coordinates(mesh.vertices[has_normal]) - points, axis=0)
            return replace(found, center=center + shift)
    return Rounding(rounded, axes=axes)


def _remove_grid_steps(points: FloatArray, steps: FloatArray) -> FloatArray:
    """The steps (3,) without those of a sampling grid, in which no two points (k, 3) share two coordinates."""
    rounded = steps.copy()
    places = np.round((points - points.min(axis=0)) / np.where(steps > 0.0, steps, 1.0))
    for first, second in ((0, 1), (1, 2), (2, 0)):
        if steps[first] > 0.0 and steps[second] > 0.0:
            pairs = places[:, first] * (places[:, second].max() + 1.0) + places[:, second]  # one number for each pair
            if len(np.unique(pairs)) >= MIN_DISTINCT_PAIRS * len(points):
                rounded[[first, second]] = 0.0
    return rounded


def _voxel_center(points: FloatArray, steps: FloatArray) -> FloatArray | None:
    """A point (3,) from which one coordinate of nearly every point (k, 3) is an odd multiple of its step; or None."""
    lowest = points.min(axis=0)
    is_odd = np.round((points - lowest) / steps).astype(np.int64) % 2 == 1
    for shift in product((False, True), repeat=3):
        if np.mean((is_odd ^ np.array(shift)).sum(axis=1) == 1) >= MIN_DISTINCT_PAIRS:
            return np.asarray(lowest + shift * steps)
    return None


def _has_risers(mesh: PreparedMesh) -> bool:
    """Whether most vertices on sharp edges have both convex and concave edges around, as at treads and risers."""
    sharp = np.flatnonzero(mesh.barriers)
    if not len(sharp):
        return False
    edges, rows, n = mesh_edges(mesh), mesh.adjacency.vertices, mesh.vertex_count
    start, is_near = np.repeat(np.arange(n), rows.lengths), np.ones(len(sharp), dtype=np.bool_)
    for is_convex in (True, False):
        ends = np.zeros(n, dtype=np.bool_)
        ends[edges.vertices[(edges.angles > MIN_RISER_ANGLE) & (edges.is_convex == is_convex)]] = True
        is_near &= (ends | (np.bincount(start, ends[rows.indices], n) > 0.0))[sharp]
    return bool(is_near.mean() >= MIN_RISER_SHARE)
