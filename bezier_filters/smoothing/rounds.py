"""Rounds of noise removal: first without outliers, then without impulses, which a smoothed surface shows.

The rounds are the same for meshes in memory and in stores: see `NoisySurface`.
"""

from dataclasses import dataclass, replace
from typing import Protocol, TypeVar

import numpy as np

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.fitting.noise_level import learn_mesh_noise
from bezier_filters.fitting.outlier_removal import move_outliers
from bezier_filters.kernels.kernel_input import prepare_kernel_mesh
from bezier_filters.meshes.adjacency import umbrella_vectors
from bezier_filters.meshes.prepared_mesh import PreparedMesh
from bezier_filters.meshes.spikes import move_folded_vertices
from bezier_filters.noise.noise_model import NoiseModel
from bezier_filters.runtime.cached_property import cached_property
from bezier_filters.runtime.parallel import Progress
from bezier_filters.sampling.mesh_parts import MeshPart, sample_parts
from bezier_filters.smoothing.denoise import DenoisedMesh, SmoothingOptions, remove_noise
from bezier_filters.smoothing.flipped_faces import repair_flipped_faces
from bezier_filters.smoothing.impulses import MAX_IMPULSE_ROUNDS, Impulses, has_settled, learn_impulses, remove_impulses

MAX_OUTLIER_ROUNDS = 3  # rounds of outlier removal
MAX_REMAINING_OUTLIERS = 0.01  # share of outliers that needs no further round: edges look like outliers after the first

Surface = TypeVar("Surface", bound="NoisySurface")


class NoisySurface(Protocol):
    """A surface from which noise is removed, in memory or in a store. Every step returns another surface."""

    def learn_noise(self, sigma: float | None = None, robust: bool | None = None) -> NoiseModel | None:
        """Learn the noise, see `learn_mesh_noise`."""

    @property
    def parts(self) -> MeshPart:
        """Sampled parts of the surface, see `mesh_parts`."""

    def points_of(self, ids: IntArray) -> FloatArray:
        """Coordinates (k, 3) of vertices of the sampled parts."""

    def move_outliers(self: Surface) -> Surface:
        """The surface with its outliers moved onto the surface around them."""

    def remove_noise(
        self: Surface, noise: NoiseModel, options: SmoothingOptions, *, unfold: bool, progress: Progress | None
    ) -> Surface:
        """The surface without its noise; on request without the folds that outliers have left."""

    def remove_impulses(self: Surface, smooth: Surface, impulses: Impulses) -> Surface:
        """The measured surface without the impulses that a smooth one shows."""

    def reuse_if_whole(self: Surface, parts: MeshPart, denoised: DenoisedMesh) -> Surface | None:
        """The surface that is already denoised, if the sampled parts are all of it; else None."""


def denoise_surface(
    measured: Surface, noise: NoiseModel | None, options: SmoothingOptions, *, progress: Progress | None = None
) -> Surface:
    """Remove the outliers and the noise of a surface, see `remove_noise`.

    Among many outliers some look like inliers, so outliers are removed in rounds, and the noise is estimated after
    each. Where they are too dense, they count as noise. If the standard deviation of the noise is not given, the
    residuals of the smoothed surface may show impulses; then the surface is estimated again without them, in rounds.
    """
    if noise is None or not noise.outliers:
        return _denoise_in_rounds(measured, noise, options, progress=progress)
    parts = measured.parts
    are_noise, found = _choose_outliers_or_noise(parts, noise, options, progress=progress)
    whole = measured.reuse_if_whole(parts, found)
    if whole is not None:
        return whole
    if are_noise:
        noise = measured.learn_noise(options.sigma, robust=False)
    return _denoise_in_rounds(measured, noise, options, progress=progress)


def denoise_mesh(
    mesh: PreparedMesh, noise: NoiseModel | None, options: SmoothingOptions, *, progress: Progress | None = None
) -> DenoisedMesh:
    """Remove the outliers and the noise of a mesh in memory: `denoise_surface`."""
    return denoise_surface(
        _MeshInMemory(mesh, *np.zeros((3, mesh.vertex_count))), noise, options, progress=progress
    ).result


def _denoise_in_rounds(
    measured: Surface, noise: NoiseModel | None, options: SmoothingOptions, *, progress: Progress | None = None
) -> Surface:
    surface, rounds = measured, 0
    while (
        noise is not None
        and rounds < MAX_OUTLIER_ROUNDS
        and noise.outliers > (MAX_REMAINING_OUTLIERS if rounds else 0.0)
    ):
        surface = surface.move_outliers()
        noise, rounds = surface.learn_noise(options.sigma), rounds + 1
        if noise is None:  # without noise to compare with, outliers may be shape
            surface, rounds = measured, 0
            break
    found = surface.remove_noise(noise or NoiseModel(0.0), options, unfold=rounds > 0, progress=progress)
    if noise is not None and noise.heavy and options.repeats and options.sigma is options.detail is None:
        # Single normals were useless; now they show the noise that remains.
        remaining = found.learn_noise()
        found = found.remove_noise(remaining or NoiseModel(0.0), options, unfold=False, progress=None)
    for _ in range(0 if options.sigma is not None else MAX_IMPULSE_ROUNDS):
        parts = found.parts
        impulses = learn_impulses(measured.points_of(parts.ids), parts)
        if impulses is None:
            break
        surface = measured.remove_impulses(found, impulses)
        noise = surface.learn_noise(robust=False)
        found = surface.remove_noise(noise or NoiseModel(0.0), options, unfold=True, progress=None)
        if has_settled(parts.mesh.vertices, found.points_of(parts.ids), impulses):
            break
    return found


def _choose_outliers_or_noise(
    parts: MeshPart, noise: NoiseModel, options: SmoothingOptions, *, progress: Progress | None = None
) -> tuple[bool, DenoisedMesh]:
    """Decide on parts of a mesh whether outliers are better removed or treated as noise; also return the better result.

    The better surface has the smaller ratio of its unevenness to its distance from the measured vertices: a surface
    that follows outliers is uneven and near to them.
    """
    mesh = parts.mesh
    inside = parts.core & ~mesh.adjacency.on_boundary

    def measures(found: DenoisedMesh) -> tuple[float, float]:
        """Unevenness of a surface, and its distance from the measured vertices."""
        normals = mesh.move(found.points).planes.normals
        heights, distances = (
            np.einsum("ij,ij->i", vectors[inside], normals[inside])
            for vectors in (umbrella_vectors(mesh.adjacency.vertices, found.points), mesh.vertices - found.points)
        )
        return float(np.abs(heights).sum()), float(np.linalg.norm(distances))

    surface = _MeshInMemory(mesh, *np.zeros((3, mesh.vertex_count)))
    without = _denoise_in_rounds(surface, noise, options).result
    noise_with_them = surface.learn_noise(options.sigma, robust=False)
    as_noise = _denoise_in_rounds(surface, noise_with_them, options, progress=progress).result
    (uneven, far), (other_uneven, other_far) = measures(as_noise), measures(without)
    are_noise = uneven * other_far < other_uneven * far
    return are_noise, as_noise if are_noise else without


@dataclass(frozen=True)
class _MeshInMemory:
    """A `NoisySurface` in memory."""

    mesh: PreparedMesh
    # (n,): see `DenoisedMesh`
    sharpness: FloatArray
    noise: FloatArray
    error: FloatArray

    @property
    def result(self) -> DenoisedMesh:
        return DenoisedMesh(self.mesh.vertices, self.sharpness, self.noise, self.error)

    def learn_noise(self, sigma: float | None = None, robust: bool | None = None) -> NoiseModel | None:
        return learn_mesh_noise(self.mesh, sigma, robust)

    @cached_property
    def parts(self) -> MeshPart:
        return sample_parts(self.mesh)

    def points_of(self, ids: IntArray) -> FloatArray:
        return np.asarray(self.mesh.vertices[ids])

    def move_outliers(self) -> "_MeshInMemory":
        return replace(self, mesh=move_mesh_outliers(self.mesh))

    def remove_noise(
        self, noise: NoiseModel, options: SmoothingOptions, *, unfold: bool, progress: Progress | None
    ) -> "_MeshInMemory":
        found = remove_noise(self.mesh, noise, options, progress=progress)
        points = unfold_surface(self.mesh, found.points) if unfold else found.points
        return _MeshInMemory(
            self.mesh.move(points),
            np.maximum(self.sharpness, found.sharpness),
            np.hypot(self.noise, found.noise),
            join_errors(self.error, found.noise, found.error),
        )

    def remove_impulses(self, smooth: "_MeshInMemory", impulses: Impulses) -> "_MeshInMemory":
        points = remove_impulses(self.mesh.vertices, smooth.mesh, impulses)
        return replace(self, mesh=self.mesh.move(points))

    def reuse_if_whole(self, parts: MeshPart, denoised: DenoisedMesh) -> "_MeshInMemory | None":
        is_whole = parts.mesh is self.mesh
        if not is_whole:
            return None
        return _MeshInMemory(self.mesh.move(denoised.points), denoised.sharpness, denoised.noise, denoised.error)


def join_errors(before: FloatArray, noise: FloatArray, after: FloatArray) -> FloatArray:
    """Errors (n,) after a round, given those before, the noise that it found in them, and what it leaves of that.

    What it does not find stays: noise that is smooth, and the blur of the rounds before.

    >>> join_errors(np.array([0.0, 5.0]), np.array([1.0, 4.0]), np.array([0.1, 4.0])).tolist()
    [0.1, 5.0]
    """
    return np.asarray(np.sqrt(np.square(after) + np.maximum(np.square(before) - np.square(noise), 0.0)))


def move_mesh_outliers(mesh: PreparedMesh) -> PreparedMesh:
    """Move the outliers of a mesh onto the surface around them."""
    return mesh.move(move_outliers(prepare_kernel_mesh(mesh, with_barriers=False)).vertices)


def unfold_surface(mesh: PreparedMesh, points: FloatArray) -> FloatArray:
    """Unfold the smoothed points (n, 3) of a mesh without its outliers, where outliers have left folds.

    Moves that would flip faces are reduced towards the mesh without outliers, not towards the outliers.
    """
    return repair_flipped_faces(mesh, move_folded_vertices(mesh.move(points)).vertices)
