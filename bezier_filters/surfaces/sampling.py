"""Sample meshes of smooth surfaces together with their exact geometry, and of the simple domains that they map.

Every surface is a level set F(x, y, z) = const, and one formula serves them all: with g the gradient
and M the Hessian of F, the normal is n = g / |g| and the shape operator is M / |g| on the tangent
plane. The other functions of this package only place the samples and write down g and M.

Regular samples lie on a lattice. Jittered samples get a Delaunay triangulation in the domain, so
that their valences are irregular, too, and no triangle can fold.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.spatial import ConvexHull, Delaunay

from bezier_filters.arrays import FloatArray, IntArray, unique_rows
from bezier_filters.differential_geometry import DerivedCurvatures, principal_curvatures_of
from bezier_filters.errors import InvalidParameterError, is_integer

MAX_JITTER = 0.35  # half the width of a right triangle with unit legs: no corner moves past the opposite edge

# up to this jitter lattice squares keep their diagonals: with four corners on a circle both would be Delaunay, and
# the copies of a square on a torus could get different ones
TIE_JITTER = 1e-6

# least distance of lattice points to a hole's rim, in edges. Over half a chord, so that the circle over each chord is
# empty and the whole rim consists of Delaunay edges.
RIM_CLEARANCE = 0.6

WRAP_MARGIN_EDGES = 4.0  # edges of a wrapped rectangle that are repeated around it; triangles are much smaller
HOLE_GAP = 3.0  # least distance between two holes, and between a hole and the border, in edges


@dataclass(frozen=True)
class SampledSurface(DerivedCurvatures):
    """A triangle mesh whose vertices lie on a smooth surface, with the surface's exact geometry.

    Curvatures are positive on a convex body with outward normals (MeshLab's sign) and have the
    unit 1/length; the Gaussian curvature has 1/length^2. Open patches have upward normals.

    Attributes
    ----------
    vertices : (n, 3) float64
        Points of the surface.
    faces : (m, 3) int32
        Consistently oriented triangles, counter-clockwise seen from outside or above.
    normals : (n, 3) float64
        Unit normals, outward or upward.
    k_min, k_max : (n,) float64
        Principal curvatures, ``k_min <= k_max``.
    direction_min, direction_max : (n, 3) float64
        Unit tangent directions of `k_min` and `k_max`, with
        ``direction_min = normals x direction_max``. Their signs are arbitrary, and at umbilics
        (``k_min == k_max``) so is the pair: compare lines, not vectors.
    """

    vertices: FloatArray
    faces: IntArray
    normals: FloatArray
    k_min: FloatArray
    k_max: FloatArray
    direction_min: FloatArray
    direction_max: FloatArray

    @classmethod
    def from_level_set(
        cls, vertices: FloatArray, faces: IntArray, gradients: FloatArray, hessians: FloatArray
    ) -> "SampledSurface":
        """Surface F = const from the derivatives of F at its vertices.

        The derivative of n = g / |g| along a tangent t is P M t / |g| with P = I - n n^T, so the
        shape operator is the symmetric 2 x 2 matrix of M / |g| in any orthonormal tangent frame
        (Goldman, "Curvature formulas for implicit curves and surfaces", CAGD 22, 2005).

        Faces (m, 3) are oriented like the gradients (n, 3), which point outward and are not zero; their scale cancels
        with that of the Hessians (n, 3, 3), or (3, 3) if it is the same everywhere.

        The unit sphere x^2 + y^2 + z^2 = 1 at one point:

        >>> point = np.array([[0.0, 0.0, 1.0]])
        >>> no_faces = np.empty((0, 3), dtype=np.int32)
        >>> SampledSurface.from_level_set(point, no_faces, 2 * point, 2 * np.eye(3)).mean_curvature
        array([1.])
        """
        slope = np.linalg.norm(gradients, axis=1, keepdims=True)
        normals = gradients / slope
        least_aligned_axis = np.eye(3)[np.abs(normals).argmin(axis=1)]
        first = _normalize(np.cross(normals, least_aligned_axis))
        second = np.cross(normals, first)

        frame = np.stack([first, second], axis=1)
        shape = frame @ hessians @ frame.transpose(0, 2, 1) / slope[:, :, None]
        twist = 0.5 * (shape[:, 0, 1] + shape[:, 1, 0])
        curvatures = principal_curvatures_of(shape[:, 0, 0], twist, shape[:, 1, 1], first, second)
        return cls(vertices, faces, normals, *curvatures)


def sphere_directions(resolution: int, *, jitter: float = 0.0, seed: int = 0) -> tuple[FloatArray, IntArray]:
    """Points on the unit sphere: an icosahedron whose edges are divided into `resolution` parts, one or more.

    The jitter is in random directions, as a fraction of the edge. Returns unit vectors (10 resolution^2 + 2, 3) and
    their spherical Delaunay triangulation (20 resolution^2, 3), outward.

    >>> directions, faces = sphere_directions(1)
    >>> len(directions), len(faces)
    (12, 20)
    """
    check_resolution(resolution, 1)
    check_jitter(jitter)
    golden = 0.5 * (1.0 + np.sqrt(5.0))
    rectangle = np.array([(0.0, i, j * golden) for i in (-1, 1) for j in (-1, 1)])
    corners = np.concatenate([np.roll(rectangle, k, axis=1) for k in range(3)]) / np.hypot(1.0, golden)
    triangles = _convex_hull(corners)

    # Integer weights on the twelve corners: points that two triangles share get equal rows.
    i, j = np.indices((resolution + 1, resolution + 1)).reshape(2, -1)
    steps = np.stack([i, j, resolution - i - j], axis=1)[i + j <= resolution]
    weights = np.zeros((len(triangles), len(steps), len(corners)), dtype=np.int64)
    np.put_along_axis(weights, triangles[:, None, :].astype(np.int64), steps[None, :, :], axis=2)
    distinct, _ = unique_rows(weights.reshape(-1, len(corners)))

    # The sines divide the icosahedron's edges into equal arcs; linear weights would crowd their ends.
    edge = np.arctan(2.0) / resolution
    directions = _normalize(np.sin(distinct * edge) @ corners)
    if jitter > 0:
        tangents = _normalize(np.cross(directions, _random_directions(directions.shape, seed)))
        directions = _normalize(directions + jitter * edge * tangents)
    return directions, _convex_hull(directions)


def rectangle(
    cells: tuple[int, int],
    *,
    wrapped: tuple[bool, bool] = (False, False),
    holes: Sequence[tuple[float, float, float]] = (),
    jitter: float = 0.0,
    seed: int = 0,
) -> tuple[FloatArray, IntArray]:
    """Points (n, 2) of the rectangle [0, cells[0]] x [0, cells[1]], one per unit square, and their triangles (m, 3).

    The ends of wrapped axes are joined: one gives a tube, two a torus; the sides are at least 6 then (callers check
    that). Holes (x, y, radius) are circles to cut out, not with wrapped axes, whose rims are divided evenly. Jittered
    border points slide along the border; its corners and the rims of holes stay.

    >>> points, faces = rectangle((2, 1))
    >>> points.T
    array([[0., 0., 1., 1., 2., 2.],
           [0., 1., 0., 1., 0., 1.]])
    >>> faces
    array([[0, 2, 3],
           [0, 3, 1],
           [2, 4, 5],
           [2, 5, 3]], dtype=int32)
    """
    check_jitter(jitter)
    if len(holes) and any(wrapped):
        raise InvalidParameterError("holes cannot be cut out of a wrapped rectangle")
    counts = tuple(n if wrap else n + 1 for n, wrap in zip(cells, wrapped, strict=True))
    points = np.indices(counts).reshape(2, -1).T.astype(np.float64)
    offsets = jitter * _random_directions(points.shape, seed)
    for axis in range(2):
        if not wrapped[axis]:
            offsets[(points[:, axis] == 0) | (points[:, axis] == cells[axis]), axis] = 0.0
    points += offsets
    if not len(holes):
        periods = tuple(n if wrap else 0 for n, wrap in zip(cells, wrapped, strict=True))
        return points, _lattice_faces(cells, counts) if jitter <= TIE_JITTER else _delaunay(points, periods)

    _check_holes(np.asarray(holes, dtype=np.float64), cells)
    for x, y, radius in holes:
        points = points[np.hypot(*(points - (x, y)).T) > radius + RIM_CLEARANCE]
    rims = [_circle(*hole) for hole in holes]
    owner = np.repeat(np.arange(len(holes) + 1), [len(points), *map(len, rims)])
    points = np.concatenate([points, *rims])
    faces = _delaunay(points, (0, 0))
    # Triangles inside a hole are those with all three corners on its rim.
    owners = owner[faces]
    inside = (owners[:, 0] > 0) & (owners == owners[:, :1]).all(axis=1)
    return points, faces[~inside]


def cube_with_notch(resolution: int, *, jitter: float = 0.0, seed: int = 0) -> tuple[FloatArray, IntArray]:
    """Surface points of the cube [0, resolution]^3 without its upper octant, one per unit square, and their triangles.

    There are 6 resolution^2 + 2 points, and twice as many faces less 4. Jittered points stay in their plane or on their
    edge, corners stay; the squares get random diagonals then.

    >>> points, faces = cube_with_notch(2)
    >>> len(points), len(faces)
    (26, 48)
    """
    check_resolution(resolution, 2)
    check_jitter(jitter)
    if resolution % 2:
        raise InvalidParameterError(f"resolution is {resolution}, but must be even: the notch is half a cube wide")
    solid = np.pad(np.ones((resolution,) * 3, dtype=np.int8), 1)
    solid[1 + resolution // 2 : -1, 1 + resolution // 2 : -1, 1 + resolution // 2 : -1] = 0

    squares: list[IntArray] = []
    normal_axes: list[IntArray] = []
    for axis in range(3):
        step = np.diff(solid, axis=axis)
        for side, corners in ((-1, [(0, 0), (1, 0), (1, 1), (0, 1)]), (1, [(0, 0), (0, 1), (1, 1), (1, 0)])):
            cell = np.argwhere(step == side).astype(np.int32)
            # The padding moved the cells by one, but not the planes between them.
            cell[:, [axis - 2, axis - 1]] -= 1
            corner = np.zeros((4, 3), dtype=np.int32)
            corner[:, [axis - 2, axis - 1]] = corners
            squares.append(cell[:, None, :] + corner)
            normal_axes.append(np.full(len(cell), axis, dtype=np.int32))

    corners_of_squares = np.concatenate(squares)
    lattice, inverse = unique_rows(corners_of_squares.reshape(-1, 3))
    quads = inverse.reshape(-1, 4).astype(np.int32)
    points = lattice.astype(np.float64)
    if jitter > 0:
        offsets = jitter * _random_directions(points.shape, seed)
        # A point on a square must not leave its plane; on edges and corners several planes hold it.
        offsets[quads, np.concatenate(normal_axes)[:, None]] = 0.0
        points += offsets
        turned = np.random.default_rng(seed).integers(2, size=len(quads), dtype=np.int8) == 1
        quads = np.where(turned[:, None], np.roll(quads, 1, axis=1), quads)
    return points, _canonical(np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]))


def check_resolution(resolution: int, minimum: int) -> None:
    """Raise `InvalidParameterError` unless `resolution` is an int of at least `minimum`."""
    if not is_integer(resolution) or resolution < minimum:
        raise InvalidParameterError(f"resolution is {resolution!r}, but must be an int of at least {minimum}")


def check_jitter(jitter: float) -> None:
    """Raise `InvalidParameterError` unless ``0 <= jitter < 0.35``."""
    if not 0 <= jitter < MAX_JITTER:
        raise InvalidParameterError(
            f"jitter is {jitter!r}, but must be at least 0 and less than {MAX_JITTER} edges; 0.3 is very irregular"
        )


def check_positive(**lengths: float) -> None:
    """Raise `InvalidParameterError` unless each named value is positive and finite."""
    for name, value in lengths.items():
        if not 0 < value < np.inf:
            raise InvalidParameterError(f"{name} is {value!r}, but must be a positive length")


def check_finite(**values: float) -> None:
    """Raise `InvalidParameterError` unless each named value is finite."""
    for name, value in values.items():
        if not np.isfinite(value):
            raise InvalidParameterError(f"{name} is {value!r}, but must be finite")


def _check_holes(holes: FloatArray, cells: tuple[int, int]) -> None:
    """Raise `InvalidParameterError` if holes are too small, touch each other or touch the border."""
    if holes.ndim != 2 or holes.shape[1] != 3 or not np.isfinite(holes).all():
        raise InvalidParameterError("holes must be finite triples (x, y, radius)")
    centres, radii = holes[:, :2], holes[:, 2]
    if radii.min() < 1.0:
        raise InvalidParameterError(
            f"a hole has a radius of {radii.min():.3g} edges, but must have at least 1: raise resolution or radius"
        )
    to_border = np.minimum(centres, np.asarray(cells) - centres).min(axis=1) - radii
    apart = np.linalg.norm(centres[:, None] - centres, axis=2) - radii[:, None] - radii
    gap = min(to_border.min(), apart[~np.eye(len(holes), dtype=bool)].min(initial=np.inf))
    if gap < HOLE_GAP:
        raise InvalidParameterError(
            f"the gap between two holes, or a hole and the border, is {gap:.3g} edges, but must be at least "
            f"{HOLE_GAP:g}: raise resolution or move the holes"
        )


def _circle(x: float, y: float, radius: float) -> FloatArray:
    """Evenly spaced points on a circle, at most one unit apart."""
    count = int(np.ceil(2 * np.pi * radius))
    angle = np.arange(count) * (2 * np.pi / count)
    return np.stack([x + radius * np.cos(angle), y + radius * np.sin(angle)], axis=1)


def radial_directions(angle: FloatArray) -> FloatArray:
    """Unit vectors in the x-y plane, shape (n, 3)."""
    return np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)


def _lattice_faces(cells: tuple[int, int], counts: tuple[int, ...]) -> IntArray:
    """Split every lattice square along the same diagonal: all inner valences are six."""
    i, j = np.indices(cells).reshape(2, -1)

    def vertex(di: int, dj: int) -> IntArray:
        return ((i + di) % counts[0] * counts[1] + (j + dj) % counts[1]).astype(np.int32)

    a, b, c, d = vertex(0, 0), vertex(1, 0), vertex(1, 1), vertex(0, 1)
    return np.stack([a, b, c, a, c, d], axis=1).reshape(-1, 3)


def _delaunay(points: FloatArray, periods: tuple[int, ...]) -> IntArray:
    """Delaunay triangulation in the plane, on a strip or on a torus (period 0: not periodic)."""
    shifts = np.array(list(product(*((0, -period, period) if period else (0,) for period in periods))))
    tiles = (points + shifts[:, None, :]).reshape(-1, 2)
    low, high = points.min(axis=0) - WRAP_MARGIN_EDGES, points.max(axis=0) + WRAP_MARGIN_EDGES
    near = np.flatnonzero(((tiles >= low) & (tiles <= high)).all(axis=1))
    tiled = near[Delaunay(tiles[near]).simplices]
    faces = tiled % len(points)
    # Each triangle recurs in every tile: keep the one whose lowest vertex lies in the first tile.
    lowest = np.take_along_axis(tiled, faces.argmin(axis=1)[:, None], axis=1)[:, 0]
    return _canonical(faces[lowest < len(points)])


def _convex_hull(points: FloatArray) -> IntArray:
    """Outward triangles of the convex hull of points around the origin."""
    faces = ConvexHull(points).simplices
    inward = np.linalg.det(points[faces]) < 0
    return _canonical(np.where(inward[:, None], faces[:, ::-1], faces))


def _canonical(faces: IntArray) -> IntArray:
    """Rotate each face to start at its lowest vertex and sort the faces, whatever order qhull chose."""
    turns = (faces.argmin(axis=1)[:, None] + np.arange(3)) % 3
    rotated = np.take_along_axis(faces, turns, axis=1)
    return rotated[np.lexsort(rotated.T[::-1])].astype(np.int32)


def _random_directions(shape: tuple[int, ...], seed: int) -> FloatArray:
    """Random unit vectors, one per row."""
    return _normalize(np.random.default_rng(seed).standard_normal(shape))


def _normalize(vectors: FloatArray) -> FloatArray:
    """Unit vectors along the rows of an array."""
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))
