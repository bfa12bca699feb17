"""Replacement of selected faces by the continuation of their surroundings: `replace_selection` and its result.

The faces are removed and the holes filled as `fill_holes` does, with noise and sharp edges learned from the rest. The
loops of a hole are those of the removed patch: a ring around a tube becomes one hole with two loops, not two ends.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.errors import InvalidParameterError, is_integer
from bezier_filters.holes.fill_methods import FillingMethod, FillOptions
from bezier_filters.holes.hole import Hole
from bezier_filters.holes.hole_detection import ORIENT_HINT, measure_hole
from bezier_filters.holes.hole_filling import HoleFillingResult, fill_chosen
from bezier_filters.holes.hole_report import HoleReport, describe_hole, hole_columns
from bezier_filters.holes.loops import diameter
from bezier_filters.holes.remaining_mesh import RemainingMesh, remove_faces
from bezier_filters.holes.removed_material import cone_volume, largest_height
from bezier_filters.meshes.half_edges import (
    NON_MANIFOLD,
    boundary_loops,
    faces_at,
    faces_at_edges,
    half_edge_twins,
)
from bezier_filters.meshes.mesh import TriangleMesh, check_selection, takes_meshes, triangle_mesh
from bezier_filters.meshes.mesh_objects import MeshLike
from bezier_filters.meshes.triangles import area_vectors
from bezier_filters.meshes.unit_size import AREA, LENGTH, VOLUME, normalizes_size
from bezier_filters.result_tables import Table, TabularResult
from bezier_filters.runtime.parallel import Progress, runs_on_threads
from bezier_filters.surface_model.fit_options import check_noise

MAX_SELECTION_RINGS = 100  # rings by which a selection may grow
BORDER_HINT = "leave faces at the border out of the selection, or weld coincident borders first"
NOTHING_AROUND = "every face of its component is selected, so nothing around it can be continued"


@dataclass(frozen=True)
class ReplacedPatch:
    """A connected part of the selection, and the patch that replaces it.

    Attributes
    ----------
    old_faces : (k,) int32
        Its faces, as rows of the given mesh.
    hole : HoleReport
        The hole without it, and its fill, as rows of the resulting mesh. If it stays open, the old faces stay, and
        `reason` says why.
    removed_volume : float
        Volume between the old patch and the new one, positive if material was removed and negative if it was added.
    removed_height : float
        Largest distance of an old vertex from the new patch, along its normal: positive outside of the new patch.
    area : float
        Area of the new patch; the volume over the area is the mean height.
    """

    old_faces: IntArray
    hole: HoleReport
    removed_volume: float = field(default=0.0, metadata=VOLUME)
    removed_height: float = field(default=0.0, metadata=LENGTH)
    area: float = field(default=0.0, metadata=AREA)

    @property
    def replaced(self) -> bool:
        """Whether the old faces were replaced."""
        return self.hole.filled


class _PatchCounts:
    """What follows from the patches; fields of a `ReplacementResult` of these names."""

    patches: tuple[ReplacedPatch, ...]

    @property
    def replaced(self) -> int:
        """Number of patches that were replaced."""
        return sum(patch.replaced for patch in self.patches)


@dataclass(frozen=True, repr=False)
class ReplacementResult(_PatchCounts, TabularResult):
    """A mesh whose selected faces were replaced.

    Attributes
    ----------
    vertices : (n, 3) float64
        The old vertices that are still used, or were not used before, in their order, and the new ones after them.
    faces : (m, 3) int32
        The old faces that stay, in their order, and the new ones after them.
    old_vertices : (k,) int32
        Row in the given mesh of each of the first k vertices.
    old_faces : (l,) int32
        Row in the given mesh of each of the first l faces.
    patches : tuple of ReplacedPatch
        The connected parts of the selection, ordered by their first face.
    noise : float or None
        Standard deviation of the noise along the normal that the fills assume, a length; None if it could not be
        estimated.
    replaced : int
        Derived: number of patches that were replaced.
    """

    vertices: FloatArray = field(metadata=LENGTH)
    faces: IntArray
    old_vertices: IntArray
    old_faces: IntArray
    patches: tuple[ReplacedPatch, ...]
    noise: float | None = field(metadata=LENGTH)
    replaced: int = field(init=False)

    def __repr__(self) -> str:
        """One line: how many patches there were, and how many were replaced."""
        return (
            f"ReplacementResult({len(self.vertices)} vertices, {len(self.faces)} faces, "
            f"{self.replaced} of {len(self.patches)} patches replaced)"
        )

    def _tables(self) -> list[Table]:
        header = ["old faces", "fill", "new faces", "removed volume", "removed height", "remarks"]
        rows = [
            [
                len(patch.old_faces),
                patch.hole.method or "left as it was",
                len(patch.hole.new_faces),
                patch.removed_volume,
                patch.removed_height,
                patch.hole.reason,
            ]
            for patch in self.patches
        ]
        return [Table(f"{self.replaced:,} of {len(self.patches):,} patches replaced", header, rows)]

    def _columns(self) -> dict[str, list[object]]:
        """A row for each patch, with its hole; of faces their number."""
        names = ("removed_volume", "removed_height", "area")
        columns: dict[str, list[object]] = {name: [getattr(patch, name) for patch in self.patches] for name in names}
        counts: dict[str, list[object]] = {"old_faces": [len(patch.old_faces) for patch in self.patches]}
        return counts | columns | hole_columns([patch.hole for patch in self.patches])


@takes_meshes
@normalizes_size("noise")
@runs_on_threads
def replace_selection(
    vertices: ArrayLike | MeshLike,
    faces: ArrayLike | None,
    selected: BoolArray,
    *,
    rings: int = 0,
    method: FillingMethod = "auto",
    intersecting: bool = False,
    creases: bool = True,
    noise: float | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> ReplacementResult:
    """Replace selected faces by the continuation of the surface around them: a bump, a scar, a mark of a support.

    The selected faces are removed, and the holes filled as `fill_holes` does; noise and sharp edges are learned from
    the rest of the mesh alone. A patch that cannot be replaced stays as it is, and its report says why: one at the
    border of the mesh or at non-manifold edges, one with nothing around it, and one whose fills all intersect other
    faces.

    Parameters
    ----------
    vertices : (n, 3) array_like of float, or mesh object
        Coordinates; or a mesh of another library, see `mesh_arrays`, and no faces.
    faces : (m, 3) array_like of int
        Triangles, counter-clockwise seen from outside.
    selected : (m,) bool
        Faces to replace.
    rings : int
        Rings of faces around the selection that are replaced, too, such as the foot of a bump; at most 100.
    method : {"auto", "surface", "flat", "paper"}
        As in `fill_holes`.
    intersecting : bool
        Whether to use the fill with the fewest intersections where every fill intersects other faces.
    creases : bool
        Whether to continue sharp edges that end at the selection through it.
    noise : float, optional
        Standard deviation of the noise along the normal, a length; by default it is estimated. 0 interpolates.
    threads : int, optional
        Number of threads; by default BEZIER_FILTERS_THREADS or all usable cores. The result does not depend on it.
    progress : callable, optional
        ``progress(done, total)`` is called from this thread at intervals; if it returns False the call is
        cancelled.

    Returns
    -------
    ReplacementResult

    Raises
    ------
    InvalidMeshError
        If the arrays are not a mesh with finite coordinates.
    InvalidParameterError
        If nothing is selected or a parameter is out of range.
    CancelledError
        If `progress` returned False.

    Examples
    --------
    A bump on a ball, which becomes round again:

    >>> from bezier_filters.surfaces import sphere
    >>> ball = sphere(resolution=16)
    >>> height = 0.1 * np.exp(-np.square((ball.vertices - [0.0, 0.0, 1.0]) / 0.2).sum(axis=1))
    >>> bumpy = ball.vertices * (1.0 + height)[:, np.newaxis]
    >>> result = replace_selection(bumpy, ball.faces, (height[ball.faces] > 1e-6).any(axis=1))
    >>> bool(np.abs(np.linalg.norm(result.vertices, axis=1) - 1.0).max() < 2e-3)
    True
    >>> round(result.patches[0].removed_height, 2)
    0.1
    """
    mesh = triangle_mesh(vertices, faces)
    if not (is_integer(rings) and 0 <= rings <= MAX_SELECTION_RINGS):
        raise InvalidParameterError(f"rings: got {rings!r}, expected an integer from 0 to {MAX_SELECTION_RINGS}")
    check_noise(noise)
    options = FillOptions(method, creases, intersecting)
    chosen = _add_rings(mesh, check_selection(selected, mesh.face_count), rings)
    if not chosen.any():
        raise InvalidParameterError("selected: no face is selected; select the faces to replace")
    patches = _find_patches(mesh, chosen)
    while True:
        rest = _remove(mesh, patches)
        replaceable = [k for k, patch in enumerate(patches) if not patch.obstacle]
        filled = fill_chosen(rest.mesh, [_hole(rest, patches[k]) for k in replaceable], noise, options, progress)
        open_ = {k: hole.reason for k, hole in zip(replaceable, filled.holes, strict=True) if not hole.filled}
        if not open_:
            break
        # Their faces stay, and the fills of the other patches must not intersect them.
        patches = [replace(patch, obstacle=open_.get(k, patch.obstacle)) for k, patch in enumerate(patches)]
    fills = dict(zip(replaceable, filled.holes, strict=True))
    reports = tuple(
        _measure(mesh, patch, fills[k], filled)
        if k in fills
        else ReplacedPatch(patch.faces, describe_hole(_hole(rest, patch), patch.obstacle))
        for k, patch in enumerate(patches)
    )
    return ReplacementResult(filled.vertices, filled.faces, rest.old_vertices, rest.old_faces, reports, filled.noise)


@dataclass(frozen=True)
class _Patch:
    """A connected part of the selection."""

    faces: IntArray  # (k,): its faces, ascending
    # each (l,): its border, as its faces run; with an obstacle the vertices of the border, ascending
    loops: tuple[IntArray, ...]
    obstacle: str = ""  # why it cannot be replaced; empty if it can


def _hole(rest: RemainingMesh, patch: _Patch) -> Hole:
    """The hole that a patch leaves."""
    hole = measure_hole(rest.mesh, tuple(rest.place[loop] for loop in patch.loops), patch.obstacle)
    return replace(hole, is_band=len(patch.loops) == 2)


def _add_rings(mesh: TriangleMesh, selected: BoolArray, rings: int) -> BoolArray:
    """The selection and rings of faces around it."""
    for _ in range(rings):
        selected = selected.copy()
        selected[faces_at(mesh.faces, _vertices_of(mesh, selected))] = True
    return selected


def _vertices_of(mesh: TriangleMesh, selected: BoolArray) -> BoolArray:
    """Vertices of selected faces, (n,)."""
    marked = np.zeros(mesh.vertex_count, dtype=np.bool_)
    marked[mesh.faces[selected]] = True
    return marked


def _find_patches(mesh: TriangleMesh, selected: BoolArray) -> list[_Patch]:
    """Parts of a selection that are connected across edges, ordered by their first faces."""
    near = faces_at(mesh.faces, _vertices_of(mesh, selected))
    own, twin = selected[near], half_edge_twins(mesh.faces[near], mesh.vertex_count)
    owner, start = np.repeat(np.arange(len(near)), 3), mesh.faces[near].ravel()
    is_inner = own[owner] & (twin >= 0) & own[owner[twin]]
    graph = coo_array((np.ones(np.count_nonzero(is_inner)), (owner[is_inner], owner[twin[is_inner]])), (len(near),) * 2)
    number = connected_components(graph, directed=False)[1]
    rims = own[owner] & ~is_inner
    of_mesh, ambiguous = (np.unique(number[owner[rims & (twin == kind)]]) for kind in (-1, NON_MANIFOLD))
    surrounded = np.unique(number[owner[rims & (twin >= 0)]])
    loops: dict[int, list[IntArray]] = {}
    for loop in boundary_loops(TriangleMesh(mesh.vertices, mesh.faces[selected])):
        (face,) = faces_at_edges(mesh.faces[near[own]], loop[:1], loop[1:2])
        loops.setdefault(int(number[own][face]), []).append(loop)
    patches = []
    for part in np.unique(number[own]).tolist():
        faces = near[own & (number == part)]
        obstacle = (
            f"meets edges of several faces, or of faces that disagree: {ORIENT_HINT}"
            if part in ambiguous
            else NOTHING_AROUND
            if part not in surrounded
            else f"meets the border of the mesh: {BORDER_HINT}"
            if part in of_mesh
            else ""
        )
        rim = np.unique(start[rims & (number[owner] == part)])
        around = sorted(loops.get(part, []), key=lambda loop: -diameter(mesh.vertices[loop]))
        patches.append(_Patch(faces, (rim,) if obstacle else tuple(around), obstacle))
    return sorted(patches, key=lambda patch: int(patch.faces[0]))


def _remove(mesh: TriangleMesh, patches: Sequence[_Patch]) -> RemainingMesh:
    """Remove the faces of patches without obstacles."""
    removed = np.zeros(mesh.face_count, dtype=np.bool_)
    for patch in patches:
        removed[patch.faces] = not patch.obstacle
    return remove_faces(mesh, removed)


def _measure(mesh: TriangleMesh, patch: _Patch, hole: HoleReport, filled: HoleFillingResult) -> ReplacedPatch:
    """Compare a patch with the fill that replaces it."""
    old, new = mesh.faces[patch.faces], filled.faces[hole.new_faces.start : hole.new_faces.stop]
    rim = np.concatenate(patch.loops)
    origin = mesh.vertices[rim].mean(axis=0)
    return ReplacedPatch(
        patch.faces,
        hole,
        cone_volume(mesh.vertices, old, origin) - cone_volume(filled.vertices, new, origin),
        largest_height(mesh.vertices[np.setdiff1d(old, rim)], filled.vertices, new),
        0.5 * float(np.linalg.norm(area_vectors(filled.vertices, new), axis=1).sum()),
    )
