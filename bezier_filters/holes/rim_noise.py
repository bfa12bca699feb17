"""Noise of a rim that the surface around it does not have, as at the ragged border of a scan, and spikes.

The surface through the vertices from the second ring on predicts the rim. Errors of the prediction vary slowly along
the rim; noise does not. Where the surface bends much, errors at a zigzag rim look like noise, but such a rim still
helps to predict the ring beyond it.
"""

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.holes.crease_ends import MIN_CREASE_ANGLE
from bezier_filters.holes.implicit_surface import MIN_SLOPE, ImplicitSurface
from bezier_filters.holes.influence_region import InfluenceRegion
from bezier_filters.holes.smooth_fill import fit_surrounding_surface
from bezier_filters.meshes.half_edges import dihedral_angles, ends_of_half_edges

# The prediction, which costs as much as another fill, is made where the mean dihedral angle at the rim exceeds that
# beyond it by this factor. With 2, noise of 0.05 edges is not seen.
MIN_ANGLE_RATIO = 1.25
# Standard deviation of the distances of a rim from the prediction that may be noise, in edges: less turns faces by one
# degree. With 0.06, noise of 0.05 edges stays, and fills of holes of 60 degrees are 0.2 to 0.5 edges from a ball.
MIN_RIM_NOISE = 0.02
# Mean square difference of neighbours, over twice the variance (von Neumann 1941), that may be noise: of n independent
# values it is 1 +- 1 / sqrt(n), of a slow variation 0.
MIN_DIFFERENCE_RATIO = 0.5
RELIABLE_RING = 2  # the first ring whose normals do not depend much on the rim


def normals_beyond_noisy_rim(region: InfluenceRegion, normals: FloatArray, noise: float | None) -> FloatArray | None:
    """The normals (b, 3) without those at a noisy rim and in the first ring; None if the rim is not noisy.

    Noise with a standard deviation of `noise`, a length, is that of the whole mesh.
    """
    if not region.has_simple_rim or not _is_rough(region):
        return None
    reliable = np.where((region.rings >= RELIABLE_RING)[:, np.newaxis], normals, 0.0)
    surface = fit_surrounding_surface(region, reliable, noisy=region.is_noisy(noise))
    if isinstance(surface, str):
        return None
    distances = _distances(surface, region.vertices[region.loops[0]])
    least = 3.0 * (noise or 0.0) + MIN_RIM_NOISE * float(region.sizes.mean())
    variance, differences = distances.var(), np.square(distances - np.roll(distances, 1)).mean()
    is_noise = np.sqrt(variance) > least and differences > 2.0 * MIN_DIFFERENCE_RATIO * variance
    return reliable if is_noise and _is_misleading(region, normals, surface, noise) else None


def _is_misleading(region: InfluenceRegion, normals: FloatArray, surface: ImplicitSurface, noise: float | None) -> bool:
    """Whether a surface through the rim is farther from the first ring than one without it, both without that ring."""
    others = np.where((region.rings != 1)[:, np.newaxis], normals, 0.0)
    through_rim = fit_surrounding_surface(region, others, noisy=region.is_noisy(noise))
    if isinstance(through_rim, str):
        return True
    ring = region.vertices[region.rings == 1]
    errors = [np.square(_distances(each, ring)).mean() for each in (surface, through_rim)]
    return bool(errors[0] < errors[1])


def _is_rough(region: InfluenceRegion) -> bool:
    """Whether faces turn more at the rim than beyond it, where there are no sharp edges."""
    angles, rings = _edge_angles(region)
    near, far = angles[rings == 0], angles[rings >= RELIABLE_RING]
    if not (len(near) and len(far)) or far.max() > MIN_CREASE_ANGLE:
        return False
    return bool(near.mean() > MIN_ANGLE_RATIO * far.mean())


def _edge_angles(region: InfluenceRegion) -> tuple[FloatArray, IntArray]:
    """Dihedral angles at the edges of two faces, in radians, and the ring of their nearer end, (e,) each."""
    start, end = ends_of_half_edges(region.faces)
    face = np.repeat(np.arange(len(region.faces)), 3)
    key = np.minimum(start, end) * np.int64(len(region.ids)) + np.maximum(start, end)
    order = np.argsort(key, kind="stable")
    pairs: BoolArray = key[order[1:]] == key[order[:-1]]
    first, second = order[:-1][pairs], order[1:][pairs]
    angles = dihedral_angles(region.face_normals[face[first]], region.face_normals[face[second]])
    return angles, np.minimum(region.rings[start[first]], region.rings[end[first]])


def _distances(surface: ImplicitSurface, points: FloatArray) -> FloatArray:
    """Signed distances from a surface, to first order, (n,)."""
    values, gradients = surface.values_and_gradients(points)
    return np.asarray(values / np.maximum(np.linalg.norm(gradients, axis=1), MIN_SLOPE))
