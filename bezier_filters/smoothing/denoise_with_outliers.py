"""Denoising of meshes with outliers, which are removed in rounds or treated as noise."""

from dataclasses import replace

import numpy as np

from bezier_filters.arrays import FloatArray
from bezier_filters.fitting.noise_level import learn_mesh_noise
from bezier_filters.fitting.outlier_removal import move_outliers
from bezier_filters.kernels.kernel_input import prepare_kernel_mesh
from bezier_filters.meshes.adjacency import umbrella_vectors
from bezier_filters.meshes.prepared_mesh import PreparedMesh
from bezier_filters.meshes.spikes import move_folded_vertices
from bezier_filters.runtime.parallel import Progress
from bezier_filters.smoothing.denoise import DenoisedMesh, SmoothingOptions, remove_noise
from bezier_filters.smoothing.flipped_faces import repair_flipped_faces
from bezier_filters.smoothing.impulses import MAX_IMPULSE_ROUNDS, has_settled, learn_impulses, remove_impulses
from bezier_filters.smoothing.mesh_parts import MeshPart, sample_parts
from bezier_filters.surface_model.noise_model import NoiseModel

MAX_OUTLIER_ROUNDS = 3  # rounds of outlier removal
MAX_REMAINING_OUTLIERS = 0.01  # share of outliers that needs no further round: edges look like outliers after the first


def denoise_mesh(
    mesh: PreparedMesh,
    noise: NoiseModel | None,
    options: SmoothingOptions,
    *,
    progress: Progress | None = None,
) -> DenoisedMesh:
    """Remove the outliers and the noise of a mesh, see `remove_noise`.

    Among many outliers some look like inliers, so outliers are removed in rounds, and the noise is estimated after
    each. Where they are too dense, they count as noise. If the standard deviation of the noise is not given, the
    residuals of the smoothed surface may show impulses; then the surface is estimated again without them, in rounds.
    """
    if noise is None or not noise.outliers:
        return _denoise_in_rounds(mesh, noise, options, progress=progress)
    parts = sample_parts(mesh)
    are_noise, found = choose_outliers_or_noise(parts, noise, options, progress=progress)
    if parts.mesh is mesh:
        return found
    if are_noise:
        noise = learn_mesh_noise(mesh, options.sigma, robust=False)
    return _denoise_in_rounds(mesh, noise, options, progress=progress)


def choose_outliers_or_noise(
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

    taken_off = _denoise_in_rounds(mesh, noise, options)
    noise_with_them = learn_mesh_noise(mesh, options.sigma, robust=False)
    as_noise = _denoise_in_rounds(mesh, noise_with_them, options, progress=progress)
    (uneven, far), (other_uneven, other_far) = measures(as_noise), measures(taken_off)
    are_noise = uneven * other_far < other_uneven * far
    return are_noise, as_noise if are_noise else taken_off


def _denoise_in_rounds(
    mesh: PreparedMesh,
    noise: NoiseModel | None,
    options: SmoothingOptions,
    *,
    progress: Progress | None = None,
) -> DenoisedMesh:
    measured, rounds = mesh.vertices, 0
    while needs_outlier_removal(noise, rounds):
        mesh = move_mesh_outliers(mesh)
        noise, rounds = learn_mesh_noise(mesh, options.sigma), rounds + 1
    found = remove_noise(mesh, noise or NoiseModel(0.0), options, progress=progress)
    if rounds:
        found = replace(found, points=unfold_surface(mesh, found.points))
    for _ in range(0 if options.sigma is not None else MAX_IMPULSE_ROUNDS):
        surface = mesh.move(found.points)
        parts = sample_parts(surface)
        ids = parts.ids
        impulses = learn_impulses(measured[ids], parts)
        if impulses is None:
            break
        mesh = mesh.move(remove_impulses(measured, surface, impulses))
        noise = learn_mesh_noise(mesh, robust=False) or NoiseModel(0.0)
        found = remove_noise(mesh, noise, options)
        found = replace(found, points=unfold_surface(mesh, found.points))
        if has_settled(surface.vertices[ids], found.points[ids], impulses):
            break
    return found


def needs_outlier_removal(noise: NoiseModel | None, rounds: int) -> bool:
    """Whether another round of outlier removal is needed."""
    return (
        noise is not None
        and rounds < MAX_OUTLIER_ROUNDS
        and noise.outliers > (MAX_REMAINING_OUTLIERS if rounds else 0.0)
    )


def move_mesh_outliers(mesh: PreparedMesh) -> PreparedMesh:
    """Move the outliers of a mesh onto the surface around them."""
    return mesh.move(move_outliers(prepare_kernel_mesh(mesh, creases=False)).vertices)


def unfold_surface(mesh: PreparedMesh, points: FloatArray) -> FloatArray:
    """Unfold the smoothed points (n, 3) of a mesh without its outliers, where outliers have left folds.

    Moves that would flip faces are reduced towards the mesh without outliers, not towards the outliers.
    """
    surface = move_folded_vertices(mesh.move(points))
    return repair_flipped_faces(mesh, surface.vertices)
