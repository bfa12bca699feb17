"""What is wrong with a mesh, whether it is fit for fitting, and what to do about it if not."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from bezier_filters.meshes.half_edges import (
    border_edges,
    distinct_edges,
    doubled_edges,
    ends_of_half_edges,
    proper_faces,
)
from bezier_filters.meshes.mesh import TriangleMesh, as_mesh, triangle_mesh
from bezier_filters.meshes.triangles import area_vectors

FEWEST_POINTS = 6  # points that determine a quadratic

# by the counts of a report, the worst first
_FINDINGS = {
    "incoherent_edges": "edges between faces that disagree about the outside: signs are wrong there "
    "(meshing_re_orient_faces_coherently)",
    "non_manifold_edges": "edges with three or more faces: neighbourhoods mix sheets "
    "(meshing_repair_non_manifold_edges)",
    "doubled_edges": "border edges lie on others: seams and cracks, across which nothing is seen "
    "(meshing_merge_close_vertices)",
    "degenerate_faces": "faces without area are ignored (meshing_remove_null_faces removes them)",
    "duplicate_faces": "duplicate faces (meshing_remove_duplicate_faces removes them)",
    "unreferenced_vertices": "unreferenced vertices get no estimate "
    "(meshing_remove_unreferenced_vertices removes them)",
}


@dataclass(frozen=True)
class MeshReport:
    """What `inspect_mesh` found; counts of vertices, faces or edges.

    Attributes
    ----------
    unreferenced_vertices : int
        Vertices of no face.
    degenerate_faces : int
        Faces that name a vertex twice or have zero area.
    duplicate_faces : int
        Faces on the same three vertices as an earlier one.
    boundary_edges : int
        Edges of one face only.
    non_manifold_edges : int
        Edges of three or more faces.
    incoherent_edges : int
        Edges that their two faces run through in the same direction.
    doubled_edges : int
        Boundary edges that lie on another one, as where a file has the vertices of a seam twice.
    mean_edge_length : float
        Mean over the distinct edges, in units of length; 0 without edges.
    """

    unreferenced_vertices: int
    degenerate_faces: int
    duplicate_faces: int
    boundary_edges: int
    non_manifold_edges: int
    incoherent_edges: int
    doubled_edges: int
    mean_edge_length: float

    @cached_property
    def is_coherently_oriented(self) -> bool:
        """Whether all neighbouring faces agree on which side is outside."""
        return self.incoherent_edges == 0


def inspect_mesh(mesh: TriangleMesh | ArrayLike, faces: ArrayLike | None = None) -> MeshReport:
    """Count what makes a mesh hard to fit: see `MeshReport`.

    Parameters
    ----------
    mesh : TriangleMesh, or (n, 3) array_like of float
        A mesh, or the coordinates of its vertices.
    faces : (m, 3) array_like of int, optional
        Triangles, if `mesh` is an array; none for a point cloud.

    Raises
    ------
    InvalidMeshError
        If the arrays are no mesh.

    Examples
    --------
    >>> inspect_mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]).boundary_edges
    3
    """
    mesh = _as_mesh(mesh, faces)
    proper = proper_faces(mesh.faces)
    flat = ~area_vectors(mesh.vertices, proper).any(axis=1)
    triples = np.sort(mesh.faces, axis=1)
    triples = triples[np.lexsort(triples.T)]
    duplicates = (triples[1:] == triples[:-1]).all(axis=1)

    starts, ends = ends_of_half_edges(proper)
    edges, edge_of, count = distinct_edges(proper, mesh.vertex_count)
    forward = np.bincount(edge_of, weights=starts < ends, minlength=len(edges))
    on_boundary = np.zeros(mesh.vertex_count, dtype=np.bool_)
    on_boundary[edges[count == 1]] = True
    lengths = np.linalg.norm(mesh.vertices[edges[:, 0]] - mesh.vertices[edges[:, 1]], axis=1)
    return MeshReport(
        unreferenced_vertices=mesh.vertex_count - len(np.unique(mesh.faces)),
        degenerate_faces=mesh.face_count - len(proper) + int(flat.sum()),
        duplicate_faces=int(duplicates.sum()),
        boundary_edges=int((count == 1).sum()),
        non_manifold_edges=int((count > 2).sum()),
        incoherent_edges=int(((count == 2) & (forward != 1)).sum()),
        doubled_edges=int(doubled_edges(mesh, border_edges(mesh, on_boundary)).sum()),
        mean_edge_length=float(lengths.mean()) if len(lengths) else 0.0,
    )


def _as_mesh(mesh: TriangleMesh | ArrayLike, faces: ArrayLike | None) -> TriangleMesh:
    if isinstance(mesh, TriangleMesh):
        return as_mesh(mesh, faces)
    return triangle_mesh(mesh, [] if faces is None else faces)


def is_fit(mesh: TriangleMesh) -> bool:
    """Whether curvature can be estimated at all: from faces, or from enough points."""
    return mesh.face_count > 0 or mesh.vertex_count >= FEWEST_POINTS


def diagnose(mesh: TriangleMesh | ArrayLike, report: MeshReport | ArrayLike | None = None) -> list[str]:
    """What stands in the way of good estimates, each with its remedy in pymeshlab; empty if nothing does.

    Parameters
    ----------
    mesh : TriangleMesh, or (n, 3) array_like of float
        A mesh, or the coordinates of its vertices.
    report : MeshReport, or (m, 3) array_like of int, optional
        From `inspect_mesh` of the same mesh, if that is known; or triangles, if `mesh` is an array.

    Examples
    --------
    >>> diagnose([[0, 0, 0], [1, 0, 0], [0, 1, 0], [5, 5, 5]], [[0, 1, 2]])
    ['1 unreferenced vertices get no estimate (meshing_remove_unreferenced_vertices removes them)']
    """
    mesh = _as_mesh(mesh, None if isinstance(report, MeshReport) else report)
    report = report if isinstance(report, MeshReport) else inspect_mesh(mesh)
    if not is_fit(mesh):
        return [f"{mesh.vertex_count:,} vertices without faces: curvature takes {FEWEST_POINTS} or more"]
    if mesh.face_count == 0:
        return ["there are no faces: a point cloud, whose normals tell the outside if it has any"]
    counts = ((getattr(report, name), text) for name, text in _FINDINGS.items())
    return [f"{count:,} {text}" for count, text in counts if count]
