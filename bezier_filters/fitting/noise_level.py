"""The noise of a mesh along its normals, estimated with or without outliers."""

from dataclasses import replace

import numpy as np

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.fitting.mesh_neighbourhoods import mesh_neighbourhoods
from bezier_filters.meshes.prepared_mesh import PreparedMesh
from bezier_filters.noise.neighbourhoods import Neighbourhoods
from bezier_filters.noise.noise_model import NoiseModel, rescale_noise
from bezier_filters.noise.rounding import Rounding
from bezier_filters.sampling.ring_analysis import analyse_rings
from bezier_filters.surface_model.fit_options import FitOptions
from bezier_filters.surface_model.learn import explain_unknown_surface, learn_surface, learn_without_outliers
from bezier_filters.surface_model.model_tree import Leaf, separate_magnitudes

# standard deviation of the noise over the mean edge, above which angles of flat edges look sharp: less noise turns a
# face by 5 degrees at most
MIN_MASKING_NOISE = 0.02
# largest standard deviation of the noise over the mean edge: noise makes edges at least 2 / sqrt(pi) times its standard
# deviation long, so larger estimates come from coarse shape
MAX_NOISE_PER_EDGE = 0.5 * np.sqrt(np.pi)
# Rings of the widest neighbourhoods with noise. Models of few triangles end at 2, noisy surfaces of 160 vertices and
# more reach 4 to 10. With 2 the models of animals, of 156 to 3,205 vertices, move by up to 6 edges; with 6 noisy tori
# of 640 vertices stay as they are.
MIN_WIDEST_RINGS = 3
RESIDUAL_RINGS, RESIDUAL_SAMPLES = 3, 400  # neighbourhoods in whose residuals the noise of a part is looked for
# Separations of large residuals from small ones: exact places, shape, noise. With 1 noise on 10 to 40 % of 103 meshes
# leaves 0.275 of its distance from the surface instead of 0.251, with 6 as much.
MAX_SEPARATIONS = 3
# Bounds of the ratio of residuals, or of the learned noise, to the errors of rounding, between which these are the
# noise. The median is 0.55 to 1.14 on meshes that are rounded only, 1.35 and more with noise of 0.3 steps, and 0 if
# coordinates are exact.
MIN_ROUNDING_RATIO, MAX_ROUNDING_RATIO = 0.5, 1.25
MIN_PART_RATIO = 2.0  # noise of a part over the errors of rounding from which on it is other noise
MIN_ROUNDING_PER_EDGE = 1e-3  # standard deviation of these errors over the mean edge that matters: less is not visible


def learn_mesh_noise(mesh: PreparedMesh, sigma: float | None = None, robust: bool | None = None) -> NoiseModel | None:
    """Estimate the noise along the normal, with a known standard deviation `sigma`, a length, or None.

    The result is None if the mesh is too coarse. Outliers do not count as noise, unless `robust` is False.
    """
    return estimate_noise(mesh_neighbourhoods(mesh), sigma, robust, mesh.mean_edge)


def learn_noise_at(mesh: PreparedMesh, vertices: IntArray) -> tuple[float, float] | None:
    """The noise around some vertices, a length, and the predicted error of the best patches there; None if unknown.

    The error is the geometric mean of those of normal and curvature, with the mean edge as the unit of length.
    """
    leaf = learn_surface(mesh_neighbourhoods(mesh), FitOptions(), at=vertices)
    if leaf is None:
        return None
    return leaf.surface.noise.sigma, leaf.chosen.error * float(np.sqrt(mesh.mean_edge))


def explain_unknown_noise(mesh: PreparedMesh) -> str:
    """Say why `learn_mesh_noise` finds no noise model."""
    return explain_no_noise(mesh_neighbourhoods(mesh))


def explain_no_noise(source: Neighbourhoods) -> str:
    """Say why `estimate_noise` finds no noise model."""
    leaf = learn_without_outliers(source, FitOptions(), only_noise=True)
    if leaf is not None and _is_coarse(leaf):
        folded = f"neighbourhoods of more than {leaf.analyses[-1].rings} rings fold; give the noise if it is known"
        return f"too coarse to distinguish noise from shape: {folded}"
    return explain_unknown_surface(source)


def _is_coarse(leaf: Leaf) -> bool:
    """Whether noise cannot be distinguished from shape: no fit is wide enough that most of its residuals are noise.

    Rings are analysed as long as most of their neighbourhoods are graphs over a plane. Where averaged normals are used,
    neighbourhoods are one ring wider.
    """
    return leaf.analyses[-1].rings < MIN_WIDEST_RINGS + int(leaf.surface.noise.heavy)


def estimate_noise(
    source: Neighbourhoods, sigma: float | None, robust: bool | None, mean_edge: float
) -> NoiseModel | None:
    """Estimate the noise as `learn_mesh_noise`, in memory or in tiles."""
    if sigma == 0.0:
        return NoiseModel(0.0)
    options = FitOptions(robust=robust)
    leaf = learn_without_outliers(source, options, only_noise=True)
    learned = None if leaf is None or _is_coarse(leaf) else leaf.surface.noise
    stairs = source.rounding if source.rounding.variance > 0.0 else None
    if stairs is not None and learned is None:
        learned = stairs
    elif stairs is not None and learned is not None and learned.sigma <= MAX_ROUNDING_RATIO * stairs.sigma:
        learned = replace(learned, rounding=stairs.rounding)
    elif stairs is None and learned is not None:
        learned = _refine_small_noise(source, options, learned, mean_edge)
    if learned is not None and learned.rounding is None and learned.sigma > MAX_NOISE_PER_EDGE * mean_edge:
        learned = None
    if learned is not None and robust is False:
        learned = replace(learned, outliers=0.0)
    return learned if sigma is None else rescale_noise(learned, sigma)


def _refine_small_noise(
    source: Neighbourhoods, options: FitOptions, learned: NoiseModel, mean_edge: float
) -> NoiseModel:
    """The noise of coordinates whose steps have left no stairs, or of a noisy part, or the learned one."""
    rounding, least = source.rounding.rounding, MIN_MASKING_NOISE * mean_edge
    variance = 0.0 if rounding is None else _rounding_variance(source, rounding)
    if variance > (MIN_ROUNDING_PER_EDGE * mean_edge) ** 2:
        least = max(least, MIN_PART_RATIO * float(np.sqrt(variance)))
        learned = NoiseModel(variance, outliers=learned.outliers, rounding=rounding)
    of_part = None
    if not learned.outliers and learned.sigma <= least:
        of_part = _noise_of_part(source, options)
    return of_part if of_part is not None and of_part.sigma > least else learned


def _noise_of_part(source: Neighbourhoods, options: FitOptions) -> NoiseModel | None:
    """The white noise of the part of the surface where residuals are large; None if they are not noise.

    Where there is noise wider rings are better; where residuals are shape, narrower ones are.
    """
    centers, residuals = _residuals(source)
    for _ in range(MAX_SEPARATIONS if len(centers) else 0):
        is_large = residuals > separate_magnitudes(residuals)
        centers, residuals = centers[is_large], residuals[is_large]
        part = learn_surface(source, options, at=centers) if len(centers) else None
        if part is None:
            break
        if part.chosen.rings > RESIDUAL_RINGS and not part.surface.noise.sills:
            return part.surface.noise
    return None


def _rounding_variance(source: Neighbourhoods, rounding: Rounding) -> float:
    """Mean variance of the errors of rounding along the normals, length^2; 0 if they do not explain the residuals.

    Exact coordinates may have few digits, too, and other noise may be larger.
    """
    centers, residuals = _residuals(source)
    variances = rounding.variances(*source.locate(centers))
    known = variances > 0.0
    if not known.any():
        return 0.0
    ratio = float(np.median(residuals[known] / np.sqrt(variances[known])))
    return float(variances.mean()) if MIN_ROUNDING_RATIO < ratio < MAX_ROUNDING_RATIO else 0.0


def _residuals(source: Neighbourhoods) -> tuple[IntArray, FloatArray]:
    """Vertices, (k,), and the root mean square residual of the patch of highest degree around each, lengths (k,)."""
    sample = source.sample(source.draw(RESIDUAL_SAMPLES), RESIDUAL_RINGS, "plain")
    found = analyse_rings(sample, {RESIDUAL_RINGS: RESIDUAL_SAMPLES}, vertex_count=source.vertex_count)
    if not found:
        return np.zeros(0, dtype=np.int32), np.zeros(0)
    sums = found[0].sums
    return found[0].centers, np.sqrt(sums.residuals[:, -1] / np.maximum(sums.freedom[:, -1], 1.0))


def is_noisy(mesh: PreparedMesh, sigma: float | None) -> bool:
    """Whether noise of standard deviation `sigma`, a length, makes angles that look like sharp edges."""
    return sigma is not None and sigma > MIN_MASKING_NOISE * mesh.mean_edge
