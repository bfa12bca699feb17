"""Errors of rounding at the vertices of a mesh: random ones, as probes for leverages, and the largest possible ones.

The errors of rounding follow from the surface: where it crosses few steps, they have the same sign over whole terraces,
and along the normal they are as large as the steps are there. So they are drawn by rounding a smooth surface again,
with the steps shifted at random (a dither: Widrow, Kollar, "Quantization Noise", 2008).

A vertex of a mask lies half-way on an edge between two voxels. If the lattice is shifted by d, the plane with normal n
through the crossing c of an edge along an axis a crosses the shifted edge at c - (n d / n_a) a. The mesh of a shifted
lattice has other vertices: so phases are known up to their change along an edge of the mesh, and neighbours mostly have
a voxel in common, and with it a part of their errors, which are averaged over neighbours.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bezier_filters.arrays import FloatArray, IntArray, SingleArray
from bezier_filters.meshes.adjacency import Rows
from bezier_filters.meshes.prepared_mesh import PreparedMesh
from bezier_filters.noise.rounding import Rounding
from bezier_filters.sampling.mesh_parts import MeshPart
from bezier_filters.smoothing.chebyshev import diffuse, low_pass
from bezier_filters.smoothing.laplacian import Laplacian
from bezier_filters.smoothing.random_noise import draw_white_noise, inflation_by_neighbours

# Strength of the filter that gives the smooth surface. With 1e3 or 1e5 nineteen masks, with slices 1 to 5 voxels apart,
# keep 1.00 or 0.99 times as much of their errors, with 100 thin plates 1.4 times.
SURFACE_STRENGTH = 1e4
# Diffusion time, squared edges, of the errors of masks, which gives neighbours on masks of balls, tori, tubes and
# ellipsoids the correlation that they have, 0.3. With 0.25 or 1 the same masks keep 1.05 or 1.02 times as much.
SHARED_VOXEL_TIME = 0.5
VARIANCE_TIME = 1.5  # diffusion time, squared edges, of the variances: over some ten vertices
MIN_ERROR_PER_EDGE = 1e-4  # smallest standard deviation over the mean edge: along planes between steps there is none
MIN_COSINE = 1e-3  # of normals to an axis: nearly parallel planes cross it far away
CALIBRATION_COLUMNS = 4  # errors from which their size and correlation are found
# Steps of an additive sequence that covers the cube evenly (Roberts: powers of the root of x^4 = x + 1), and the
# distance to another such sequence.
SHIFTS, OTHER_SHIFT = 1.2207440846057596 ** -np.arange(1.0, 4.0), np.sqrt(2.0)
PHASE_STREAM = 1000  # first stream of the random bits for phases
# Times that points are projected onto the surfaces that rounding allows and smoothed. With 3 or 12 the masks keep 1.03
# or 0.97 times as much of their errors.
PROJECTIONS = 6


@dataclass(frozen=True)
class RoundingErrors:
    """Distribution of the errors along the normals."""

    sigma: FloatArray  # (n,): standard deviations, lengths
    phases: FloatArray  # (n, a): coordinates of a smooth surface over the steps: all, or that along an edge of voxels
    reaches: FloatArray  # (n, a): steps times components of the normal, over sigma
    voxels: "_VoxelPhases | None" = None  # how the phases of a mask change with the lattice

    def draw(self, columns: int, *, first: int = 0, stream: int = 0) -> SingleArray:
        """Random errors, (n, columns), in units of the standard deviation; the shifts do not depend on the mesh."""
        drawn = np.empty((len(self.sigma), columns))
        for k in range(columns):
            shift = (0.5 + stream * OTHER_SHIFT + (first + k) * SHIFTS) % 1.0
            if self.voxels is not None:
                numbers = PHASE_STREAM * (1 + stream) + 2 * (first + k)
                shift = self.voxels.change(shift, numbers)[:, np.newaxis]
            moved = self.phases + shift
            drawn[:, k] = ((0.5 - moved + np.floor(moved)) * self.reaches).sum(axis=1)
        if self.voxels is not None:
            drawn = diffuse(self.voxels.laplacian, drawn, SHARED_VOXEL_TIME)
        return drawn.astype(np.float32)

    def calibrate(self, neighbours: Rows) -> tuple[float, float]:
        """Root mean square of the drawn errors, and how many vertices are as informative as an independent one."""
        drawn = self.draw(CALIBRATION_COLUMNS).astype(np.float64)
        square = float(np.square(drawn).mean())
        start = np.repeat(np.arange(len(drawn)), neighbours.lengths)
        product = float((drawn[start] * drawn[neighbours.indices]).mean())
        return float(np.sqrt(square)), inflation_by_neighbours(product / square)


@dataclass(frozen=True)
class _VoxelPhases:
    """Phases of the vertices of a mask."""

    ids: IntArray  # (n,): numbers of the vertices in the whole mesh
    shifts: FloatArray  # (n, 3): derivatives of the phase by the shift of the lattice
    spreads: FloatArray  # (n,): changes of the phase along an edge of the mesh
    laplacian: Laplacian  # umbrella Laplacian with free borders

    def change(self, shift: FloatArray, stream: int) -> FloatArray:
        """Changes of the phases, (n,), by a shift of the lattice (3,), in voxels, and by other vertices."""
        return np.asarray(self.shifts @ shift + self.spreads * draw_white_noise(self.ids, 2, stream=stream)[:, 0])


def rounding_errors(part: MeshPart, rounding: Rounding, laplacian: Laplacian, unit: float) -> RoundingErrors:
    """Errors of rounding at the vertices of a mesh, or of a tile, whose mean edge is `unit`.

    `laplacian` is the umbrella Laplacian with free borders.
    """
    vertices = part.mesh.vertices
    smooth = low_pass(laplacian, vertices, np.array([SURFACE_STRENGTH]))
    normals = part.mesh.move(smooth).planes.normals
    along, steps = rounding.coordinates(normals), rounding.steps_of(vertices)
    variances = rounding.variances(vertices, normals)[:, np.newaxis]
    sigma = np.sqrt(np.maximum(diffuse(laplacian, variances, VARIANCE_TIME)[:, 0], (MIN_ERROR_PER_EDGE * unit) ** 2))
    reaches = along * steps / sigma[:, np.newaxis]
    if rounding.center is None:
        phases = np.divide(rounding.coordinates(smooth), steps, out=np.zeros_like(steps), where=steps > 0.0)
        return RoundingErrors(sigma, phases, reaches)
    rows, axis = np.arange(len(vertices)), steps.argmax(axis=1)
    cosines = along[rows, axis]
    cosines = np.where(np.abs(cosines) < MIN_COSINE, MIN_COSINE, cosines)
    step, start = rounding.steps[axis], rounding.coordinates(vertices)[rows, axis] - rounding.center[axis]
    crossings = start + np.einsum("ij,ij->i", smooth - vertices, normals) / cosines
    shifts = -(along * rounding.steps) / (cosines * step)[:, np.newaxis]
    spreads = unit * np.sqrt(0.5 * np.maximum(1.0 - cosines**2, 0.0)) / step
    phases = (crossings / step)[:, np.newaxis]
    voxels = _VoxelPhases(part.ids, shifts, spreads, laplacian)
    return RoundingErrors(sigma, phases, reaches[rows, axis][:, np.newaxis], voxels)


def project_on_rounding(
    mesh: PreparedMesh, points: FloatArray, rounding: Rounding, smooth: Callable[[FloatArray], FloatArray]
) -> FloatArray:
    """A smooth surface (n, 3) among those whose rounding gives the vertices of a mesh, from points (n, 3) near it.

    Projections alternate with a weak filter `smooth` (Youla, Webb, "Image restoration by the method of convex
    projections", IEEE Transactions on Medical Imaging 1, 1982), of whose moves those along the normals are made.
    """
    points = limit_to_steps(mesh, points, rounding)
    for _ in range(PROJECTIONS):
        found = smooth(points)
        normals = mesh.move(found).planes.normals
        heights = np.einsum("ij,ij->i", found - points, normals)
        points = limit_to_steps(mesh, points + heights[:, np.newaxis] * normals, rounding)
    return points


def limit_to_steps(mesh: PreparedMesh, points: FloatArray, rounding: Rounding) -> FloatArray:
    """Points (n, 3) whose heights over the vertices of a mesh, along their normals, are errors that rounding can make.

    A coordinate is rounded by half a step at most.
    """
    normals = mesh.move(points).planes.normals
    heights = np.einsum("ij,ij->i", points - mesh.vertices, normals)
    most = 0.5 * np.abs(rounding.coordinates(normals) * rounding.steps_of(mesh.vertices)).sum(axis=1)
    return np.asarray(points + (np.clip(heights, -most, most) - heights)[:, np.newaxis] * normals)
