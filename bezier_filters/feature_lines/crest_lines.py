"""Crest lines: where the largest curvature has a maximum along its own direction, and whether noise makes them.

Noise that passes through fits makes lines wherever curvature is nearly constant, as on a torus. But on their sides
the curvature falls off by no more than the standard errors of what was fitted there.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import ndtr

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.estimation.vertex_geometry import VertexGeometry
from bezier_filters.meshes.adjacency import Adjacency, mean_edge
from bezier_filters.meshes.half_edges import MeshEdges
from bezier_filters.meshes.mesh import TriangleMesh

# standard errors by which curvature falls off beside the lines that noise makes, at most: those are found because it
# does. Of 48 tori and spheres with noise of 0.01 to 0.2 edges, white or averaged, two have a line with more.
BY_CHANCE = 2.25
# times the radius of a neighbourhood: how far beside. Within one, what noise makes falls off, too: with 1 and 3
# standard errors there were 14 such lines, and a tenth fewer on a scanned bunny
BESIDE = 1.75
# variance of a principal curvature over that of their mean: of a fit, x^2 - y^2 varies half as much about the plane as
# x^2 + y^2 about its own mean
PRINCIPAL = 1.5
HEIGHT = np.sqrt(0.75)  # of an equilateral triangle over its side: a ring is so many edges wide


@dataclass(frozen=True)
class CurvatureAlongLines:
    """One principal curvature with its sign such that ridges are where it is large, at n vertices."""

    largest: FloatArray  # (n,): that curvature
    other: FloatArray  # (n,): the other one
    directions: FloatArray  # (n, 3): its unit directions, whose signs are arbitrary
    slopes: FloatArray  # (n,): its derivative along them, the extremality; 0 where it is not known
    normals: FloatArray  # (n, 3): of the vertices
    errors: FloatArray  # (n,): standard errors of curvatures, 1/length
    # (n,): how far beside a line curvature is compared with that on it, a length: beyond a neighbourhood's distance
    reach: FloatArray
    tree: cKDTree  # of the vertices

    def certainty(self, points: FloatArray) -> float:
        """Probability that curvature falls off on both sides of a line (k, 3), on average, by more than noise makes it.

        The mean of both sides has 3/2 of the variance of one value, as the line's own has an error, too; along the line
        errors are independent of each other every two reaches.
        """
        lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
        middle = 0.5 * (points[1:] + points[:-1])
        at: IntArray = self.tree.query(middle)[1].astype(np.int32)
        error = float(np.sqrt(1.5 * PRINCIPAL * np.square(self.errors[at]).mean()))
        if error == 0.0:
            return 1.0
        across, reach = self.directions[at], self.reach[at][:, np.newaxis]
        beside = [self._along(middle + side * reach * across, across) for side in (1.0, -1.0)]
        fall = float(np.average(self.largest[at] - 0.5 * (beside[0] + beside[1]), weights=lengths + 1e-300))
        independent = max(1.0, float(lengths.sum()) / (2.0 * float(reach.mean())))
        return float(ndtr(fall / error * np.sqrt(independent) - BY_CHANCE))

    def _along(self, points: FloatArray, directions: FloatArray) -> FloatArray:
        """Curvature in directions (k, 3) at the vertices nearest to points (k, 3), (k,): by Euler's formula."""
        at: IntArray = self.tree.query(points)[1].astype(np.int32)
        normals = self.normals[at]
        tangents = directions - np.einsum("ij,ij->i", directions, normals)[:, np.newaxis] * normals
        squares = np.square(np.einsum("ij,ij->i", tangents, self.directions[at]))
        share = np.divide(squares, np.square(tangents).sum(axis=1), out=np.zeros(len(at)), where=squares > 0.0)
        result: FloatArray = share * self.largest[at] + (1.0 - share) * self.other[at]
        return result


def curvatures_along_lines(
    mesh: TriangleMesh, adjacency: Adjacency, geometry: VertexGeometry
) -> tuple[CurvatureAlongLines, CurvatureAlongLines]:
    """Those of ridges and of ravines: from inside, the smallest curvature is the largest, with the other sign."""
    g = geometry
    reach = BESIDE * HEIGHT * mean_edge(mesh, adjacency) * g.rings_used
    beside = g.normals, g.mean_curvature_std, reach, cKDTree(mesh.vertices)
    return (
        CurvatureAlongLines(g.k_max, g.k_min, g.direction_max, g.extremality_max, *beside),
        CurvatureAlongLines(-g.k_min, -g.k_max, g.direction_min, -g.extremality_min, *beside),
    )


def crest_segments(
    mesh: TriangleMesh, edges: MeshEdges, field: CurvatureAlongLines, faces: IntArray
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Trace ridges across triangles: straight pieces, each across one triangle.

    Gives the edges of the mesh between which each piece runs, (s, 2); for every edge of the mesh where on it the slope
    vanishes, if anywhere, 0 at its first end and 1 at its second, (e,); and what each piece contributes to the strength
    of its line, without a unit, (s,).

    The direction at one vertex is turned to agree with those at the two others, after which the slope is taken for
    linear in the triangle (Ohtake, Belyaev, Seidel, "Ridge-valley lines on meshes via implicit surface fitting", 2004).
    A ridge runs along its zeros where it falls in its direction, and where the curvature is larger than the other one
    in size. Triangles around which the directions turn by half a turn, as at umbilics, have none (Hildebrandt,
    Polthier, Wardetzky, "Smooth feature lines on surface meshes", 2005).

    A segment of the length l, curvature k and second derivative k'' weighs ``k l min(1, |k''| / k^3)``: its length in
    radii of curvature, as far as the curvature falls off within a radius. The weight does not change with
    scale, and vanishes in planes and on surfaces whose curvature is constant along its lines.

    Only the given faces are looked at, none of which names a vertex twice.
    """
    # Zeros by edge, so that both triangles at an edge see the same: signs with which the slopes at both ends agree.
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
    largest, other = (on_edges(values, edges, shares, pairs).mean(axis=1) for values in (field.largest, field.other))
    is_ridge = (second_derivatives < 0.0) & (largest > np.abs(other))
    points = on_edges(mesh.vertices, edges, shares, pairs[is_ridge])
    lengths = np.linalg.norm(points[:, 1] - points[:, 0], axis=1)
    k = largest[is_ridge]
    weights = lengths * np.minimum(k, -second_derivatives[is_ridge] / k**2)
    return pairs[is_ridge], shares, weights


def on_edges(values: FloatArray, edges: MeshEdges, shares: FloatArray, ids: IntArray) -> FloatArray:
    """Values at vertices, (n,) or (n, k), at the given shares (e,) of some edges."""
    share = shares[ids] if values.ndim == 1 else shares[ids][..., np.newaxis]
    result: FloatArray = (1.0 - share) * values[edges.vertices[ids, 0]] + share * values[edges.vertices[ids, 1]]
    return result


def _derivatives_along_directions(mesh: TriangleMesh, corners: IntArray, field: CurvatureAlongLines) -> FloatArray:
    """Derivative of the slope, linear in each triangle (f, 3), along its mean direction, (f,)."""
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
