"""What is wrong with a mesh, whether it is fit for fitting, and what to do about it if not."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bezier_filters.meshes.dihedral_angles import distinct_edges
from bezier_filters.meshes.half_edges import ends_of_half_edges
from bezier_filters.meshes.mesh import TriangleMesh

FEWEST_POINTS = 6  # points that determine a quadratic

# by the counts of a report, the worst first
_FINDINGS = {
    "incoherent_edges": "edges between faces that disagree about the outside: signs are wrong there "
    "(meshing_re_orient_faces_coherently)",
    "non_manifold_edges": "edges with three or more faces: neighbourhoods mix sheets "
    "(meshing_repair_non_manifold_edges)",
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
    mean_edge_length : float
        Mean over the distinct edges, in units of length; 0 without edges.
    """

    unreferenced_vertices: int
    degenerate_faces: int
    duplicate_faces: int
    boundary_edges: int
    non_manifold_edges: int
    incoherent_edges: int
    mean_edge_length: float

    @cached_property
    def is_coherently_oriented(self) -> bool:
        """Whether all neighbouring faces agree on which side is outside."""
        return self.incoherent_edges == 0


def inspect_mesh(mesh: TriangleMesh) -> MeshReport:
    """Count what makes a mesh hard to fit: see `MeshReport`."""
    a, b, c = mesh.faces.T
    twice = (a == b) | (b == c) | (c == a)
    proper = mesh.faces[~twice]
    corners = mesh.vertices[proper]
    flat = ~np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).any(axis=1)
    triples = np.sort(mesh.faces, axis=1)
    triples = triples[np.lexsort(triples.T)]
    duplicates = (triples[1:] == triples[:-1]).all(axis=1)

    starts, ends = ends_of_half_edges(proper)
    edges, edge_of, count = distinct_edges(proper, mesh.vertex_count)
    forward = np.bincount(edge_of, weights=starts < ends, minlength=len(edges))
    lengths = np.linalg.norm(mesh.vertices[edges[:, 0]] - mesh.vertices[edges[:, 1]], axis=1)
    return MeshReport(
        unreferenced_vertices=mesh.vertex_count - len(np.unique(mesh.faces)),
        degenerate_faces=int(twice.sum() + flat.sum()),
        duplicate_faces=int(duplicates.sum()),
        boundary_edges=int((count == 1).sum()),
        non_manifold_edges=int((count > 2).sum()),
        incoherent_edges=int(((count == 2) & (forward != 1)).sum()),
        mean_edge_length=float(lengths.mean()) if len(lengths) else 0.0,
    )


def is_fit(mesh: TriangleMesh) -> bool:
    """Whether curvature can be estimated at all: from faces, or from enough points."""
    return mesh.face_count > 0 or mesh.vertex_count >= FEWEST_POINTS


def diagnose(mesh: TriangleMesh, report: MeshReport) -> list[str]:
    """What stands in the way of good estimates, each with its remedy in pymeshlab; empty if nothing does.

    Parameters
    ----------
    mesh : TriangleMesh
    report : MeshReport
        From `inspect_mesh` of the same mesh.

    Examples
    --------
    >>> from bezier_filters.meshes.mesh import triangle_mesh
    >>> mesh = triangle_mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [5, 5, 5]], [[0, 1, 2]])
    >>> diagnose(mesh, inspect_mesh(mesh))
    ['1 unreferenced vertices get no estimate (meshing_remove_unreferenced_vertices removes them)']
    """
    if not is_fit(mesh):
        return [f"{mesh.vertex_count:,} vertices without faces: curvature takes {FEWEST_POINTS} or more"]
    if mesh.face_count == 0:
        return ["there are no faces: a point cloud, whose normals tell the outside if it has any"]
    counts = ((getattr(report, name), text) for name, text in _FINDINGS.items())
    return [f"{count:,} {text}" for count, text in counts if count]
