"""The surface under the noise, as far as it can be told: which of its edges are sharp is asked of that."""

from dataclasses import replace

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray
from bezier_filters.estimation.adaptive_fit import Learn, learn_without_outliers, learner
from bezier_filters.estimation.outlier_removal import without_outliers
from bezier_filters.kernels.kernel_input import prepare_kernel_mesh
from bezier_filters.learning.learn import why_unlearned
from bezier_filters.learning.noise_model import NoiseModel, known_noise
from bezier_filters.learning.plans import Choices
from bezier_filters.meshes.adjacency import Adjacency, from_middles, mean_edge
from bezier_filters.meshes.frames import tangent_planes
from bezier_filters.meshes.half_edges import mesh_edges
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.meshes.sharp_edges import may_have_sharp_edges, sharp_edges
from bezier_filters.meshes.tips import unfolded
from bezier_filters.runtime.parallel import Progress
from bezier_filters.smoothing.denoise import Denoised, SmoothingOptions, remove_noise
from bezier_filters.smoothing.flipped_faces import repair_flipped_faces
from bezier_filters.smoothing.impulses import MOST_ROUNDS, has_settled, learn_impulses, without_impulses
from bezier_filters.smoothing.mesh_parts import MeshPart, sampled_parts

# times the mean edge: less noise turns a face by some 5 degrees at most, and no flat edge looks like a sharp one
NOISY = 0.02
# times the mean edge: heights that differ make edges longer, by 2 / sqrt(pi) times white noise at the least, so more is
# not noise, but a part with few vertices
MOST_NOISE = 0.5 * np.sqrt(np.pi)
# of the noise, what the angles at sharp edges of the surface without it still show: 0.06 to 0.3 on wedges, prisms and
# a fandisk with white noise of 0.1 to 0.5 edges
LEFT = 0.2
KEPT = 0.1  # least sharpness of smoothing where it takes a line for an edge; round shapes have hardly any
MOST_CLEANED = 3  # times that outliers are taken off
LEFT_OVER = 0.01  # share of the vertices up to which they may be left after that: touched edges look like them


def learn_noise(
    mesh: TriangleMesh, adjacency: Adjacency, sigma: float | None = None, robust: bool | None = None
) -> NoiseModel | None:
    """The noise along the normal, of a strength that may be known, a length; None if the mesh is too coarse for it.

    Outliers are no part of it, unless it is not to be `robust`: there are none then.
    """
    arrays, fitted = prepare_kernel_mesh(mesh, adjacency=adjacency, creases=True)
    return learned_noise(learner(arrays, fitted), sigma, robust, MOST_NOISE * mean_edge(mesh, adjacency))


def why_noise_is_unknown(mesh: TriangleMesh, adjacency: Adjacency) -> str:
    """Why `learn_noise` gives none."""
    return why_unlearned(*prepare_kernel_mesh(mesh, adjacency=adjacency, creases=True))


def learned_noise(learn: Learn, sigma: float | None, robust: bool | None, most: float = np.inf) -> NoiseModel | None:
    """The noise of a mesh as `learn_noise` does, in memory or in tiles; what is more than the most is none."""
    if sigma == 0.0:
        return NoiseModel(0.0)
    _, leaf = learn_without_outliers(learn, Choices(only_noise=True), robust)
    learned = None if leaf is None or leaf.surface.noise.sigma > most else leaf.surface.noise
    if learned is not None and robust is False:
        learned = replace(learned, outliers=0.0)
    return learned if sigma is None else known_noise(learned, sigma)


def denoised(
    mesh: TriangleMesh,
    adjacency: Adjacency,
    noise: NoiseModel | None,
    options: SmoothingOptions,
    *,
    progress: Progress | None = None,
) -> Denoised:
    """The mesh without its noise, see `remove_noise`, and without its outliers, which no filter takes for noise.

    Among many outliers some look sound, so they are taken off as long as there are any, and the noise is learned again;
    where they are too dense for that, they are noise, too. If its strength is not known, and where a smooth surface is
    tells which vertices were hit by impulses, that is found again without these.
    """
    if noise is None or not noise.outliers:
        return _denoised(mesh, adjacency, noise, options, progress=progress)
    parts = sampled_parts(mesh, adjacency)
    are_noise, found = with_outliers_as_noise(parts, noise, options, progress=progress)
    if parts.mesh is mesh:
        return found
    if are_noise:
        noise = learn_noise(mesh, adjacency, options.sigma, robust=False)
    return _denoised(mesh, adjacency, noise, options, progress=progress)


def with_outliers_as_noise(
    parts: MeshPart, noise: NoiseModel, options: SmoothingOptions, *, progress: Progress | None = None
) -> tuple[bool, Denoised]:
    """Whether outliers of a mesh, of which there are parts, are better taken for noise, and these parts without them.

    The better surface is smooth, but far from what was measured: one that follows outliers is neither.
    """
    mesh, adjacency = parts.mesh, parts.adjacency
    inside = parts.core & ~adjacency.on_boundary

    def measures(found: Denoised) -> tuple[float, float]:
        """How uneven a surface is, and how far it is off."""
        normals = tangent_planes(TriangleMesh(found.points, mesh.faces), adjacency).normals
        heights, distances = (
            np.einsum("ij,ij->i", vectors[inside], normals[inside])
            for vectors in (from_middles(adjacency.vertices, found.points), mesh.vertices - found.points)
        )
        return float(np.abs(heights).sum()), float(np.linalg.norm(distances))

    taken_off = _denoised(mesh, adjacency, noise, options)
    noise_with_them = learn_noise(mesh, adjacency, options.sigma, robust=False)
    as_noise = _denoised(mesh, adjacency, noise_with_them, options, progress=progress)
    (uneven, far), (other_uneven, other_far) = measures(as_noise), measures(taken_off)
    are_noise = uneven * other_far < other_uneven * far
    return are_noise, as_noise if are_noise else taken_off


def _denoised(
    mesh: TriangleMesh,
    adjacency: Adjacency,
    noise: NoiseModel | None,
    options: SmoothingOptions,
    *,
    progress: Progress | None = None,
) -> Denoised:
    measured, rounds = mesh.vertices, 0
    while are_to_be_taken_off(noise, rounds):
        mesh = cleaned(mesh, adjacency)
        noise, rounds = learn_noise(mesh, adjacency, options.sigma), rounds + 1
    found = remove_noise(mesh, adjacency, noise or NoiseModel(0.0), options, progress=progress)
    if rounds:
        found = replace(found, points=unfolded_surface(mesh, adjacency, found.points))
    for _ in range(0 if options.sigma is not None else MOST_ROUNDS):
        surface = TriangleMesh(found.points, mesh.faces)
        parts = sampled_parts(surface, adjacency)
        ids = parts.ids
        impulses = learn_impulses(measured[ids], parts)
        if impulses is None:
            break
        mesh = TriangleMesh(without_impulses(measured, surface, adjacency, impulses), mesh.faces)
        noise = learn_noise(mesh, adjacency, robust=False) or NoiseModel(0.0)
        found = remove_noise(mesh, adjacency, noise, options)
        found = replace(found, points=unfolded_surface(mesh, adjacency, found.points))
        if has_settled(surface.vertices[ids], found.points[ids], impulses):
            break
    return found


def are_to_be_taken_off(noise: NoiseModel | None, rounds: int) -> bool:
    """Whether there are outliers to be taken off, after some rounds of that."""
    return noise is not None and rounds < MOST_CLEANED and noise.outliers > (LEFT_OVER if rounds else 0.0)


def cleaned(mesh: TriangleMesh, adjacency: Adjacency) -> TriangleMesh:
    """The mesh with its outliers moved onto the surface around them."""
    arrays, _ = prepare_kernel_mesh(mesh, adjacency=adjacency, creases=False)
    return TriangleMesh(without_outliers(arrays, adjacency).vertices, mesh.faces)


def unfolded_surface(mesh: TriangleMesh, adjacency: Adjacency, points: FloatArray) -> FloatArray:
    """Points (n, 3) that a mesh without its outliers was smoothed to, without folds that outliers left.

    Where moves are taken back, as faces would turn over, it is not to the outliers.
    """
    surface = unfolded(TriangleMesh(points, mesh.faces), adjacency)
    return repair_flipped_faces(mesh, adjacency, surface.vertices)


def is_noisy(mesh: TriangleMesh, adjacency: Adjacency, sigma: float | None) -> bool:
    """Whether noise of a standard deviation, a length, makes angles that look like sharp edges."""
    return sigma is not None and sigma > NOISY * mean_edge(mesh, adjacency)


def hides_sharp_edges(mesh: TriangleMesh, adjacency: Adjacency, noise: NoiseModel) -> bool:
    """Whether the mesh may have sharp edges, which can only be told without its noise."""
    return is_noisy(mesh, adjacency, noise.sigma) and may_have_sharp_edges(mesh, adjacency)


def noise_free_surface(mesh: TriangleMesh, adjacency: Adjacency, noise: NoiseModel) -> tuple[TriangleMesh, BoolArray]:
    """The mesh without its noise and without the faces that turned over with it, and where fits end on it, (n,).

    That is at vertices with two sharp edges or more, as long as edges that are sharp explain the mesh best there (see
    `smooth`): coarse round shapes have sharp edges, too, but no lines that fits should not reach across.
    """
    found = denoised(mesh, adjacency, noise, SmoothingOptions())
    points = repair_flipped_faces(mesh, adjacency, found.points)
    surface = TriangleMesh(points, mesh.faces)
    edges = mesh_edges(surface)
    sharp = sharp_edges(surface, edges, adjacency)
    is_inside = np.bincount(edges.vertices[sharp].ravel(), minlength=mesh.vertex_count) >= 2
    return surface, is_inside & (found.sharpness >= KEPT)
