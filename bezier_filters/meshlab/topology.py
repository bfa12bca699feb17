"""Topology of a mesh by pymeshlab: borders, holes, components, manifoldness; and repairs."""

from collections import OrderedDict
from collections.abc import Hashable
from dataclasses import dataclass
from threading import Lock

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray, Report
from bezier_filters.fitting.model_cache import cache_key
from bezier_filters.holes.hole_detection import find_holes
from bezier_filters.meshes.adjacency import incoherent_vertices, vertex_adjacency
from bezier_filters.meshes.face_sides import face_sides
from bezier_filters.meshes.half_edges import (
    COINCIDENCE_TOLERANCE,
    border_edges,
    coincident_border_edges,
    proper_faces,
)
from bezier_filters.meshes.mesh import TriangleMesh, triangle_mesh
from bezier_filters.meshes.prepared_mesh import prepare_mesh
from bezier_filters.meshlab.meshset import (
    BezierFilterError,
    CurrentMesh,
    Mesh,
    MeshSet,
    PureValue,
    PyMeshLabException,
    current_mesh,
    one_at_a_time,
    preserve_filter_script,
    read_current_mesh,
    reason_of,
)
from bezier_filters.runtime.parallel import single_threaded_openmp

# measures of `get_topological_measures`, by their names here
_MEASURES = {
    "components": "connected_components_number",
    "genus": "genus",
    "boundary_loops": "number_holes",
    "boundary_edges": "boundary_edges",
    "non_manifold_faces": "incident_faces_on_non_two_manifold_edges",
    "non_manifold_vertices": "non_two_manifold_vertices",
    "two_manifold": "is_mesh_two_manifold",
}
_MAX_CACHED_MESHES = 4  # cached topologies, for filters in sequence: computing one takes about as long as an estimate
_lock, _recent = Lock(), OrderedDict[Hashable, "Topology"]()


@dataclass(frozen=True)
class Topology:
    """Borders of a mesh, and counts by the names above; see `topology_of`."""

    counts: Report
    on_border: BoolArray  # (n,): vertices on an edge of one face only
    is_coherent: bool  # whether neighbouring faces agree on the outside, which pymeshlab does not report
    not_manifold: BoolArray  # (n,): ends of edges of three or more faces, and vertices at which surfaces only touch

    @property
    def faults(self) -> list[str]:
        """What is not manifold, as remarks."""
        texts = {
            "non_manifold_faces": "faces lie on edges of three or more, where neighbourhoods mix sheets",
            "non_manifold_vertices": "vertices join surfaces that only touch, which neighbourhoods mix",
        }
        found = ((self.counts[name], text) for name, text in texts.items())
        return [f"topology: {count:,} {text}" for count, text in found if count > 0]

    @property
    def remarks(self) -> list[str]:
        """Remarks for users of filters that repair."""
        return [f"{fault}; repair=True splits them" for fault in self.faults]


def topology_of(vertices: FloatArray, faces: IntArray) -> Topology:
    """Topology of a mesh by pymeshlab, from a cache of the last meshes."""
    key = cache_key(np.ascontiguousarray(faces), len(vertices))
    with _lock:
        known = _recent.pop(key, None)
    if known is None:
        known = _ask_for_topology(vertices, faces)
    with _lock:
        _recent[key] = known
        while len(_recent) > _MAX_CACHED_MESHES:
            _recent.popitem(last=False)
    return known


def clear_topology_cache() -> None:
    """Clear the cache of `topology_of`."""
    with _lock:
        _recent.clear()


def _ask_for_topology(vertices: FloatArray, faces: IntArray) -> Topology:
    """Ask pymeshlab for the topology of a mesh given as arrays.

    That filter clears the selection, so it runs on a separate MeshSet. Faces that repeat a vertex are omitted, as it
    may loop forever on them. Where the mesh is not a manifold, pymeshlab does not count holes: the genus is None, the
    boundary loops are counted here, or None if they cannot be ordered, and ``boundary_loops_by`` names the source.
    """
    proper = proper_faces(faces)
    with one_at_a_time():
        scratch = MeshSet()
        scratch.add_mesh(Mesh(vertices, proper))
        measures = scratch.get_topological_measures()
        beyond = current_mesh(scratch).face_face_adjacency_matrix()
        not_manifold = np.zeros(len(vertices), dtype=np.bool_)
        if not measures["is_mesh_two_manifold"]:
            scratch.compute_selection_by_non_manifold_per_vertex()
            not_manifold |= current_mesh(scratch).vertex_selection_array()
            scratch.compute_selection_by_non_manifold_edges_per_face()  # and the ends of these edges
            not_manifold |= current_mesh(scratch).vertex_selection_array()
    on_border = np.zeros(len(vertices), dtype=np.bool_)
    for k in range(3):
        on_border[proper[beyond[:, k] < 0][:, [k, (k + 1) % 3]]] = True
    counts: Report = {name: measures[key] for name, key in _MEASURES.items()} | {"boundary_loops_by": "pymeshlab"}
    if counts["boundary_loops"] < 0:
        holes = find_holes(prepare_mesh(triangle_mesh(vertices, proper)))
        loops = None if any(hole.non_manifold_edges for hole in holes) else sum(len(hole.loops) for hole in holes)
        counts |= {"genus": None, "boundary_loops": loops, "boundary_loops_by": "bezier_filters"}
    is_coherent = not incoherent_vertices(proper, vertex_adjacency(TriangleMesh(vertices, proper))).any()
    return Topology(counts, on_border, is_coherent, not_manifold)


def repair_copy(ms: MeshSet) -> tuple[CurrentMesh, Report]:
    """Repaired copy of the current mesh, which does not change, and the report of `repair`."""
    wanted = ms.current_mesh_id()
    with preserve_filter_script(ms):
        ms.generate_copy_of_current_mesh()
        try:
            report = repair(ms)
            return read_current_mesh(ms), report
        finally:
            ms.set_selection_none(allfaces=False, allverts=False)  # a filter that succeeds: see `check_writable`
            ms.delete_current_mesh()
            ms.set_current_mesh(wanted)


def repair(ms: MeshSet) -> Report:
    """Weld coincident borders of the current mesh, split non-manifold edges and vertices, reorient flipped faces.

    It runs pymeshlab's own filters where needed. These orient faces like the first of each component; if most faces
    would change, all are reversed again. All are reversed, too, if they form closed bodies that are inside out. Returns
    the numbers of changes.
    """
    mesh = current_mesh(ms)
    given = triangle_mesh(mesh.vertex_matrix(), mesh.face_matrix())
    border = border_edges(given, vertex_adjacency(given).on_boundary)
    try:
        with single_threaded_openmp():
            if coincident_border_edges(given, border).any():
                lengths = np.linalg.norm(given.vertices[border.end] - given.vertices[border.start], axis=1)
                ms.meshing_merge_close_vertices(
                    threshold=PureValue(COINCIDENCE_TOLERANCE * float(lengths[lengths > 0.0].min()))
                )
            welded, referenced = mesh.vertex_number(), len(np.unique(mesh.face_matrix()))
            ms.meshing_remove_duplicate_faces()
            if not _is_manifold(mesh):
                ms.meshing_repair_non_manifold_edges(method="Split Vertices")
                ms.meshing_remove_unreferenced_vertices()  # what was split
            ms.meshing_repair_non_manifold_vertices(vertdispratio=0.0)
            faces = np.array(mesh.face_matrix())
            if _is_manifold(mesh):
                ms.meshing_re_orient_faces_coherently()
            if 2 * _count_turned(faces, mesh) > len(faces):
                ms.meshing_invert_face_orientation(forceflip=True, onlyselected=False)
            now = np.array(mesh.face_matrix())
            if len(now) and face_sides(np.array(mesh.vertex_matrix()), proper_faces(now)).inside_out.all():
                ms.meshing_invert_face_orientation(forceflip=True, onlyselected=False)
    except PyMeshLabException as error:
        reason = f"repair: pymeshlab could not repair this mesh ({reason_of(error)}); go on without that"
        raise BezierFilterError(reason) from error
    return {
        "welded_vertices": given.vertex_count - welded,
        "split_vertices": len(np.unique(faces)) - referenced,
        "removed_faces": given.face_count - len(faces),
        "turned_faces": _count_turned(faces, mesh),
    }


def _is_manifold(mesh: Mesh) -> bool:
    """Whether no edge has more than two faces."""
    return not topology_of(mesh.vertex_matrix(), mesh.face_matrix()).counts["non_manifold_faces"]


def _count_turned(faces: IntArray, mesh: Mesh) -> int:
    """Number of faces of a mesh whose corners are in another cyclic order than before."""
    now = mesh.face_matrix()
    same = [(now == np.roll(faces, k, axis=1)).all(axis=1) for k in range(3)]
    return int(len(faces) - np.any(same, axis=0).sum())
