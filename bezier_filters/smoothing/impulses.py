"""Vertices that are much farther off than others, as impulses are: what noise they have, and what is known without it.

Heights over a smoothed surface are a mixture of two normal distributions, if some vertices are hit and others are not,
whatever their share: those of the others show how far off the surface itself may be. The mixture is found by
expectation and maximisation (Dempster, Laird and Rubin, 1977). A vertex that was probably hit says little of where the
surface is, so that it goes to where that was found without it, and the surface is found again.

Two distributions are also what noise of different strengths makes, and what edges leave that were smoothed: these are
not scattered, as impulses are, but side by side.
"""

from dataclasses import dataclass

import numpy as np

from bezier_filters.arrays import FloatArray
from bezier_filters.meshes.adjacency import Adjacency, from_middles, mean_edge
from bezier_filters.meshes.frames import tangent_planes
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.smoothing.mesh_parts import MeshPart
from bezier_filters.smoothing.noise import DETAIL
from bezier_filters.smoothing.sliding import Sliding, held_back

PEAKED = 3.5  # fourth moment over the squared second one, below which there is one normal distribution, which has 3
STEPS = 60  # of expectation and maximisation
TOLD_APART = 0.05  # mean logarithm of the likelihood that a mixture must gain over one distribution
ALIKE = 0.18  # correlation of neighbours' probabilities from which on they are not scattered
# times their heights: impulses that are off along the surface by less go along the normals. Those that do measure .00
# to .14, others .49 and more
ALONG_NORMALS = 0.3
MOST_ROUNDS = 4  # in which impulses and the surface are found anew,
SETTLED = 0.1  # as long as it moves by more than this, times the standard deviation of the other vertices


@dataclass(frozen=True)
class Impulses:
    """Heights over a smoothed surface as a mixture of two normal distributions of mean 0."""

    share: float  # of the vertices that are hit
    hit: float  # standard deviation of their heights, a length,
    others: float  # and of those of the others
    # standard deviation, per direction, of how far vertices that are hit are off along the surface, a length
    sideways: float = 0.0

    def sound(self, heights: FloatArray) -> FloatArray:
        """Probability of vertices not to be hit, by their heights, (n,)."""
        ratio = self.others / self.hit
        exponents = 0.5 * (1.0 - ratio**2) * np.square(heights / self.others)
        result: FloatArray = 1.0 / (
            1.0 + self.share / (1.0 - self.share) * ratio * np.exp(np.minimum(exponents, 700.0))
        )
        return result


def learn_impulses(measured: FloatArray, smoothed: MeshPart) -> Impulses | None:
    """The impulses among vertices (k, 3), which were measured where parts of a mesh, or all of it, are smooth now.

    None if there are none.
    """
    mesh, adjacency = smoothed.mesh, smoothed.adjacency
    unit = mean_edge(mesh, adjacency)
    smallest = np.finfo(np.float64).tiny
    every, normals = _heights(measured, mesh, adjacency)
    every /= max(unit, smallest)
    heights = every[smoothed.core]
    square = float(np.square(heights).mean()) if len(heights) else 0.0
    if not square > DETAIL**2 or not np.mean(heights**4) > PEAKED * square**2:
        return None
    found = Impulses(0.5, 1.3 * square**0.5, max(float(np.median(np.abs(heights))), DETAIL))
    for _ in range(STEPS):
        sound = found.sound(heights)
        share = float(1.0 - sound.mean())
        if not 0.0 < share < 1.0:
            return None
        others, hit = (np.sqrt(np.average(heights**2, weights=weights)) for weights in (sound, 1.0 - sound))
        found = Impulses(share, float(hit), max(float(others), DETAIL))
    densities = sum(
        weight / deviation * np.exp(-0.5 * np.square(heights / deviation))
        for weight, deviation in ((found.share, found.hit), (1.0 - found.share, found.others))
    )
    gain = float(np.log(np.maximum(densities, smallest)).mean()) + 0.5 + 0.5 * np.log(square)
    sound, rows = found.sound(every), adjacency.vertices
    alike = np.corrcoef(np.repeat(sound, rows.lengths), sound[rows.indices])[0, 1]
    if not (found.hit > found.others and gain > TOLD_APART and alike < ALIKE):
        return None
    # What is off along the surface goes by the middle of the neighbours, which triangles that are uneven are off, too.
    away = (measured - mesh.vertices + from_middles(rows, mesh.vertices)) / unit
    away -= np.einsum("ij,ij->i", away, normals)[:, np.newaxis] * normals
    inside = smoothed.core & ~adjacency.on_boundary & (rows.lengths > 0)
    squares, sound = 0.5 * np.square(away[inside]).sum(axis=1), sound[inside]
    of_hit, of_others = (squares @ weights / max(float(weights.sum()), smallest) for weights in (1.0 - sound, sound))
    sideways = float(max(of_hit - of_others, 0.0)) ** 0.5
    return Impulses(found.share, found.hit * unit, found.others * unit, sideways * unit)


def without_impulses(
    measured: FloatArray, smooth: TriangleMesh, adjacency: Adjacency, impulses: Impulses
) -> FloatArray:
    """Where vertices were measured, as far as that is sound, or else on the smoothed surface, (n, 3).

    If impulses are along the normals, that is where their normals lead to, which are known the better, the better the
    surface is. Others are off along the surface, too, and lie where smoothing has moved them to.
    """
    heights, normals = _heights(measured, smooth, adjacency)
    sound, surface = impulses.sound(heights)[:, np.newaxis], smooth.vertices
    if impulses.sideways < ALONG_NORMALS * impulses.hit:
        surface = held_back(TriangleMesh(measured, smooth.faces), adjacency, surface, Sliding.NARROW)
        return np.asarray(surface + sound * (measured - surface))
    return np.asarray(surface + sound * heights[:, np.newaxis] * normals)


def _heights(measured: FloatArray, smooth: TriangleMesh, adjacency: Adjacency) -> tuple[FloatArray, FloatArray]:
    """How far vertices were measured over a smoothed mesh along its normals, (n,), and these, (n, 3)."""
    normals = tangent_planes(smooth, adjacency).normals
    return np.einsum("ij,ij->i", measured - smooth.vertices, normals), normals


def has_settled(before: FloatArray, after: FloatArray, impulses: Impulses) -> bool:
    """Whether another round moved vertices, (n, 3), so little that there is no need for more."""
    return bool(np.square(after - before).sum(axis=1).mean() <= (SETTLED * impulses.others) ** 2)
