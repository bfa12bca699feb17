"""Bridges between holes: `bridge_holes` joins two rims by one band that continues the surface on both sides."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from bezier_filters.arguments import brief_repr
from bezier_filters.errors import InvalidParameterError, is_integer
from bezier_filters.holes.fill_methods import FillOptions
from bezier_filters.holes.hole import Hole
from bezier_filters.holes.hole_detection import find_holes, measure_hole
from bezier_filters.holes.hole_filling import HoleFillingResult, fill_chosen
from bezier_filters.holes.loops import vector_area
from bezier_filters.meshes.mesh import takes_meshes, triangle_mesh
from bezier_filters.meshes.mesh_objects import MeshLike
from bezier_filters.meshes.prepared_mesh import PreparedMesh, prepare_mesh
from bezier_filters.meshes.unit_size import normalizes_size
from bezier_filters.runtime.parallel import Progress, runs_on_threads
from bezier_filters.surface_model.fit_options import check_noise

Pairs = Literal["auto"] | Sequence[tuple[int, int]]

MAX_GAP = 5.0  # largest distance of a vertex from the rim on the other side of a gap, in mean edges of the two rims
# Cosine between the vector areas of two rims that face each other: within 60 degrees of opposite directions.
MAX_FACING_COSINE = -0.5


@dataclass(frozen=True, repr=False)
class BridgingResult(HoleFillingResult):
    """A mesh with bridged holes; `holes` has one entry for each pair, which is a hole with two rims.

    Attributes
    ----------
    pairs : tuple of (int, int)
        Numbers of the holes of each pair, in the order of `fill_holes`.
    """

    pairs: tuple[tuple[int, int], ...]


@takes_meshes
@normalizes_size("noise")
@runs_on_threads
def bridge_holes(
    vertices: ArrayLike | MeshLike,
    faces: ArrayLike | None = None,
    pairs: Pairs = "auto",
    *,
    intersecting: bool = False,
    noise: float | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> BridgingResult:
    """Join pairs of holes by bands: a gap around a tube, two halves of a body, the missing wall of a bolt hole.

    A band has no end: it is an annulus between two rims, whose triangles are about as large as those around. By default
    it continues the surface on both sides, as fills of `fill_holes` do. Where the band meets the surface beyond one of
    the rims at more than 60 degrees, in the mean, the rim is an edge, and the band is straight: on a cylinder between
    equal circles. The old vertices and faces do not change, and all other holes stay open.

    Parameters
    ----------
    vertices : (n, 3) array_like of float, or mesh object
        Coordinates; or a mesh of another library, see `mesh_arrays`, and no faces.
    faces : (m, 3) array_like of int
        Triangles, counter-clockwise seen from outside.
    pairs : "auto" or sequence of (int, int)
        Numbers of the holes to join, as ``fill_holes(vertices, faces, holes=[])`` lists them; outer rims may be among
        them. ``"auto"`` joins holes that face each other across a narrow gap: every vertex of each rim is within five
        edges of the other, and their vector areas point in opposite directions, within 60 degrees. The narrowest gaps
        come first, and each hole is in one pair at most.
    intersecting : bool
        Whether to use the band with the fewest intersections where every band intersects other faces.
    noise : float, optional
        Standard deviation of the noise along the normal, a length; by default it is estimated. 0 interpolates.
    threads : int, optional
        Number of threads; by default BEZIER_FILTERS_THREADS or all usable cores. The result does not depend on it.
    progress : callable, optional
        ``progress(done, total)`` is called from this thread at intervals; if it returns False the call is
        cancelled.

    Returns
    -------
    BridgingResult

    Raises
    ------
    InvalidMeshError
        If the arrays are not a mesh with finite coordinates.
    InvalidParameterError
        If a pair or another parameter is out of range, or a hole cannot be joined to another.
    CancelledError
        If `progress` returned False.

    Examples
    --------
    A ball that was cut into two halves, with a gap between them:

    >>> from bezier_filters.surfaces import sphere
    >>> ball = sphere(resolution=16)
    >>> gap = (np.abs(ball.vertices[:, 2]) < 0.1)[ball.faces].any(axis=1)
    >>> result = bridge_holes(ball.vertices, ball.faces[~gap])
    >>> result.pairs, result.holes[0].method
    (((0, 1),), 'surface')
    >>> new = result.vertices[len(ball.vertices):]
    >>> bool(np.abs(np.linalg.norm(new, axis=1) - 1.0).max() < 2e-3)
    True
    """
    mesh = prepare_mesh(triangle_mesh(vertices, faces))
    check_noise(noise)
    found = find_holes(mesh)
    chosen = _facing_pairs(mesh, found) if isinstance(pairs, str) and pairs == "auto" else _check_pairs(pairs, found)
    holes = [_join(mesh, found[a], found[b]) for a, b in chosen]
    filled = fill_chosen(mesh, holes, noise, FillOptions("surface", intersecting=intersecting), progress)
    return BridgingResult(**vars(filled), pairs=tuple(chosen))


def _join(mesh: PreparedMesh, one: Hole, other: Hole) -> Hole:
    """The hole between two rims, the longer of which is its own."""
    first, second = sorted((one, other), key=lambda hole: -hole.diameter)
    return replace(measure_hole(mesh, (first.rim, second.rim)), is_band=True)


def _check_pairs(pairs: Pairs, holes: Sequence[Hole]) -> list[tuple[int, int]]:
    """Validate the numbers of the holes of each pair; InvalidParameterError if they cannot be joined."""
    if isinstance(pairs, str) or not isinstance(pairs, Sequence | np.ndarray):
        raise InvalidParameterError(f"pairs: got {brief_repr(pairs)}, expected 'auto' or pairs of numbers of holes")
    checked = []
    for pair in pairs:
        numbers = list(pair) if isinstance(pair, Sequence | np.ndarray) and not isinstance(pair, str) else []
        if len(numbers) != 2 or not all(is_integer(k) and 0 <= k < len(holes) for k in numbers):
            raise InvalidParameterError(
                f"pairs: got {pair!r}, expected two numbers from 0 to {len(holes) - 1}, for {len(holes)} holes and "
                "rims; the report of fill_holes with holes=[] lists them"
            )
        checked.append((int(numbers[0]), int(numbers[1])))
    numbers = [k for pair in checked for k in pair]
    for k in numbers:
        if numbers.count(k) > 1:
            raise InvalidParameterError(f"pairs: hole {k} occurs {numbers.count(k)} times, but has one rim to join")
        if obstacle := _obstacle(holes[k]):
            raise InvalidParameterError(f"pairs: hole {k} cannot be joined: {obstacle}")
    return checked


def _obstacle(hole: Hole) -> str:
    """Why a hole cannot be joined to another one; empty if it can."""
    if hole.obstacle:
        return hole.obstacle
    if len(hole.loops) > 1:
        return "its rims bound one fill already; fill it instead"
    return "" if len(np.unique(hole.rim)) == len(hole.rim) else "its rim meets itself at a vertex"


def _facing_pairs(mesh: PreparedMesh, holes: Sequence[Hole]) -> list[tuple[int, int]]:
    """Pairs of holes that face each other across a narrow gap, ascending; the narrowest gaps are paired first."""
    numbers = [k for k, hole in enumerate(holes) if not _obstacle(hole)]
    if len(numbers) < 2:
        return []
    rims = {k: mesh.vertices[holes[k].rim] for k in numbers}
    edges = {k: holes[k].perimeter / len(rims[k]) for k in numbers}
    owner = np.repeat(numbers, [len(rims[k]) for k in numbers])
    every = cKDTree(np.concatenate([rims[k] for k in numbers]))
    trees = {k: cKDTree(rim) for k, rim in rims.items()}
    gaps = []
    for a in numbers:
        near = np.unique(owner[every.query_ball_point(rims[a][0], MAX_GAP * max(edges.values()))])
        for b in near[near > a].tolist():
            gap = max(float(trees[one].query(rims[other])[0].max()) for one, other in ((a, b), (b, a)))
            is_narrow = gap <= MAX_GAP * 0.5 * (edges[a] + edges[b])
            areas = vector_area(rims[a]), vector_area(rims[b])
            if is_narrow and areas[0] @ areas[1] < MAX_FACING_COSINE * np.linalg.norm(areas[0]) * np.linalg.norm(
                areas[1]
            ):
                gaps.append((gap, a, b))
    pairs: list[tuple[int, int]] = []
    for _, a, b in sorted(gaps):
        if all(k not in pair for pair in pairs for k in (a, b)):
            pairs.append((a, b))
    return sorted(pairs)
