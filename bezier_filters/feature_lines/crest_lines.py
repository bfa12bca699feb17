"""Crest lines: zeros of the extremality, where a principal curvature has a maximum along its own direction.

Noise makes spurious lines wherever the curvature is nearly constant, as on a torus. On both sides of such lines the
curvature drops by no more than its standard errors explain; a one-sided z-test of that drop gives the certainty of a
line.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import ndtr

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.fitting.vertex_geometry import VertexGeometry
from bezier_filters.meshes.half_edges import MeshEdges
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.meshes.prepared_mesh import PreparedMesh

# Drop of the curvature on both sides of spurious lines, in standard errors: lines are selected for such a drop. Of 48
# tori and spheres with noise of 0.01 to 0.2 edges, white or averaged, two have a line with a larger one.
MAX_CHANCE_DROP = 2.25
# Distance from the line at which curvatures are compared, in radii of a neighbourhood. Within one radius the drop is
# correlated with the noise: with 1 radius and 3 standard errors there were 14 spurious lines, and a tenth fewer lines
# on a scanned bunny.
COMPARISON_RADII = 1.75
# variance of a principal curvature over that of the mean curvature: in a fit, the coefficient of x^2 - y^2 has half the
# variance of that of x^2 + y^2
PRINCIPAL_VARIANCE_RATIO = 1.5
TRIANGLE_HEIGHT = np.sqrt(0.75)  # of an equilateral triangle over its side: the width of a ring in edges


@dataclass(frozen=True)
class PrincipalField:
    """A principal curvature at n vertices, with the sign for which ridges are its maxima."""

    largest: FloatArray  # (n,): this principal curvature
    other: FloatArray  # (n,): the other principal curvature, with the same sign convention
    directions: FloatArray  # (n, 3): unit principal directions, of arbitrary sign
    slopes: FloatArray  # (n,): derivative along them, the extremality; 0 where it is unknown
    normals: FloatArray  # (n, 3): vertex normals
    errors: FloatArray  # (n,): standard errors of the mean curvature, 1/length
    reach: FloatArray  # (n,): distance from a line at which its curvature is compared, a length
    tree: cKDTree  # of the vertices

    def certainty(self, points: FloatArray) -> float:
        """Probability that the mean drop of curvature on both sides of a line (k, 3) exceeds that of spurious lines.

        The drop is the value on the line minus the mean of both sides; it has 3/2 of the variance of one value. Errors
        along the line are assumed independent at distances of two reaches.
        """
        lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
        middle = 0.5 * (points[1:] + points[:-1])
        at: IntArray = self.tree.query(middle)[1].astype(np.int32)
        error = float(np.sqrt(1.5 * PRINCIPAL_VARIANCE_RATIO * np.square(self.errors[at]).mean()))
        if error == 0.0:
            return 1.0
        across, reach = self.directions[at], self.reach[at][:, np.newaxis]
        sides = [self._directional_curvature(middle + side * reach * across, across) for side in (1.0, -1.0)]
        fall = float(np.average(self.largest[at] - 0.5 * (sides[0] + sides[1]), weights=lengths + 1e-300))
        independent = max(1.0, float(lengths.sum()) / (2.0 * float(reach.mean())))
        return float(ndtr(fall / error * np.sqrt(independent) - MAX_CHANCE_DROP))

    def _directional_curvature(self, points: FloatArray, directions: FloatArray) -> FloatArray:
        """Normal curvature in directions (k, 3) at the vertices nearest to points (k, 3), (k,): Euler's formula.

        k(t) = k1 cos(a)^2 + k2 sin(a)^2 with the angle a between the tangent t and the first principal direction.
        """
        at: IntArray = self.tree.query(points)[1].astype(np.int32)
        normals = self.normals[at]
        tangents = directions - np.einsum("ij,ij->i", directions, normals)[:, np.newaxis] * normals
        squares = np.square(np.einsum("ij,ij->i", tangents, self.directions[at]))
        share = np.divide(squares, np.square(tangents).sum(axis=1), out=np.zeros(len(at)), where=squares > 0.0)
        result: FloatArray = share * self.largest[at] + (1.0 - share) * self.other[at]
        return result


def ridge_and_ravine_fields(mesh: PreparedMesh, geometry: VertexGeometry) -> tuple[PrincipalField, PrincipalField]:
    """Fields of k_max for ridges and of -k_min for ravines, which are ridges of the reversed surface."""
    g = geometry
    reach = COMPARISON_RADII * TRIANGLE_HEIGHT * mesh.mean_edge * g.rings_used
    common = g.normals, g.mean_curvature_std, reach, cKDTree(mesh.vertices)
    return (
        PrincipalField(g.k_max, g.k_min, g.direction_max, g.extremality_max, *common),
        PrincipalField(-g.k_min, -g.k_max, g.direction_min, -g.extremality_min, *common),
    )


def crest_segments(
    mesh: TriangleMesh, edges: MeshEdges, field: PrincipalField, faces: IntArray
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Trace ridges as straight segments, each across one triangle.

    Returns the two mesh edges at the ends of each segment, (s, 2); for every mesh edge the position of the zero of the
    slope, 0 at its first end and 1 at its second, (e,); and the dimensionless contribution of each segment to the
    strength of its line, (s,).

    Directions at the corners of a triangle are given consistent signs, and the slope is interpolated linearly (Ohtake,
    Belyaev, Seidel, "Ridge-valley lines on meshes via implicit surface fitting", 2004). A ridge follows zeros of the
    slope where it decreases in its direction and where the curvature exceeds the other one in absolute value. Triangles
    around which the directions turn by half a turn, as at umbilics, have no segment (Hildebrandt, Polthier, Wardetzky,
    "Smooth feature lines on surface meshes", 2005).

    A segment of length l, curvature k and second derivative k'' has the weight ``k l min(1, |k''| / k^3)``: its length
    in radii of curvature, reduced if the curvature decreases little within a radius. The weight is invariant under
    scaling, and zero in planes and on surfaces whose curvature is constant along its lines.

    Only the given faces are used; they must not repeat a vertex.
    """
    # Zeros are computed by edge, so that both triangles at an edge agree.
    tail, head = edges.vertices.T
    agree = np.where(np.einsum("ij,ij->i", field.directions[tail], field.directions[head]) < 0.0, -1.0, 1.0)
    sign = np.where(field.slopes < 0.0, -1.0, 1.0)
    crossed = sign[tail] * agree * sign[head] < 0.0
    size = np.abs(field.slopes)
    total = size[tail] + size[head]
    shares = np.divide(size[tail], total, out=np.full(len(tail), 0.5), where=total > 0.0)

    corners, own = mesh.faces[faces], edges.of_faces[faces]
    through = (crossed[own].sum(axis=1) == 2) & size[corners].any(axis=1)
    corners, own = corners[through], own[through]
    pairs = np.sort(own[crossed[own]].reshape(-1, 2), axis=1).astype(np.int32)
    second_derivatives = _derivatives_along_directions(mesh, corners, field)
    largest, other = (
        interpolate_on_edges(values, edges, shares, pairs).mean(axis=1) for values in (field.largest, field.other)
    )
    is_ridge = (second_derivatives < 0.0) & (largest > np.abs(other))
    points = interpolate_on_edges(mesh.vertices, edges, shares, pairs[is_ridge])
    lengths = np.linalg.norm(points[:, 1] - points[:, 0], axis=1)
    k = largest[is_ridge]
    weights = lengths * np.minimum(k, -second_derivatives[is_ridge] / k**2)
    return pairs[is_ridge], shares, weights


def interpolate_on_edges(values: FloatArray, edges: MeshEdges, shares: FloatArray, ids: IntArray) -> FloatArray:
    """Linear interpolation of vertex values, (n,) or (n, k), on edges `ids`, at the positions `shares` (e,)."""
    share = shares[ids] if values.ndim == 1 else shares[ids][..., np.newaxis]
    result: FloatArray = (1.0 - share) * values[edges.vertices[ids, 0]] + share * values[edges.vertices[ids, 1]]
    return result


def _derivatives_along_directions(mesh: TriangleMesh, corners: IntArray, field: PrincipalField) -> FloatArray:
    """Derivative of the linear slope in each triangle (f, 3) along its mean direction, (f,)."""
    directions, slopes = field.directions[corners], field.slopes[corners]
    signs = np.where(np.einsum("fj,fkj->fk", directions[:, 0], directions) < 0.0, -1.0, 1.0)
    mean = np.einsum("fk,fkj->fj", signs, directions)
    mean /= np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-300)
    a, b, c = (mesh.vertices[corners[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    squared = np.einsum("ij,ij->i", normal, normal)
    # The gradient of the linear function is the sum of its values times (normal x opposite edge) / |normal|^2.
    opposite = np.stack([c - b, a - c, b - a], axis=1)
    gradient = np.cross(normal, np.einsum("fk,fkj->fj", signs * slopes, opposite))
    along = np.einsum("ij,ij->i", gradient, mean)
    result: FloatArray = np.divide(along, squared, out=np.zeros_like(along), where=squared > 0.0)
    return result
