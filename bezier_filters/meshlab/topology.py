"""What pymeshlab says of the topology of a mesh: its borders and holes, its components, whether it is a manifold."""

from dataclasses import dataclass

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray, Report
from bezier_filters.errors import InvalidMeshError
from bezier_filters.holes.hole_detection import find_holes
from bezier_filters.meshes.adjacency import vertex_adjacency
from bezier_filters.meshes.mesh import triangle_mesh
from bezier_filters.meshlab.meshset import Mesh, MeshSet, current_mesh, one_at_a_time

# by our names, the measures of `get_topological_measures`
_MEASURES = {
    "components": "connected_components_number",
    "genus": "genus",
    "boundary_loops": "number_holes",
    "boundary_edges": "boundary_edges",
    "non_manifold_faces": "incident_faces_on_non_two_manifold_edges",
    "non_manifold_vertices": "non_two_manifold_vertices",
    "two_manifold": "is_mesh_two_manifold",
}


@dataclass(frozen=True)
class Topology:
    """Borders of a mesh, and counts by the names above; see `topology_of`."""

    counts: Report
    on_border: BoolArray  # (n,): vertices on an edge of one face only


def topology_of(vertices: FloatArray, faces: IntArray) -> Topology:
    """Ask pymeshlab for the topology of a mesh given as arrays.

    On a MeshSet that filter clears the selection, so it runs on a MeshSet of its own. Faces that name a vertex twice
    are left out: on those it may run forever. Where the mesh is not a manifold, pymeshlab does not say how many holes
    there are: the genus is None, the loops of the border are counted by us, or None if they cannot be ordered, and
    ``boundary_loops_by`` says whose the number is.
    """
    a, b, c = faces.T
    proper = faces[(a != b) & (b != c) & (c != a)]
    with one_at_a_time():
        scratch = MeshSet()
        scratch.add_mesh(Mesh(vertices, proper))
        measures = scratch.get_topological_measures()
        beyond = current_mesh(scratch).face_face_adjacency_matrix()
    on_border = np.zeros(len(vertices), dtype=np.bool_)
    for k in range(3):
        on_border[proper[beyond[:, k] < 0][:, [k, (k + 1) % 3]]] = True
    counts: Report = {name: measures[key] for name, key in _MEASURES.items()} | {"boundary_loops_by": "pymeshlab"}
    if counts["boundary_loops"] < 0:
        counts |= {"genus": None, "boundary_loops": _loops(vertices, proper), "boundary_loops_by": "bezier_filters"}
    return Topology(counts, on_border)


def _loops(vertices: FloatArray, faces: IntArray) -> int | None:
    try:
        mesh = triangle_mesh(vertices, faces)
        return sum(len(hole.loops) for hole in find_holes(mesh, vertex_adjacency(mesh)))
    except InvalidMeshError:
        return None
