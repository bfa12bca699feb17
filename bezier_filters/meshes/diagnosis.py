"""What is wrong with a mesh, whether it is fit for fitting, and what to do about it if not."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from bezier_filters.arrays import IntArray
from bezier_filters.meshes.face_sides import face_sides
from bezier_filters.meshes.half_edges import (
    border_edges,
    distinct_edges,
    doubled_edges,
    ends_of_half_edges,
    paired_half_edges,
    proper_faces,
    welded_vertices,
)
from bezier_filters.meshes.mesh import TriangleMesh, as_mesh, triangle_mesh
from bezier_filters.meshes.triangles import area_vectors
from bezier_filters.runtime.cached_property import cached_property

FEWEST_POINTS = 6  # points that determine a quadratic

# by the counts of a report, the worst first, with what each is when it is one
_FINDINGS = {
    "inside_out_bodies": "closed bodies are inside out: the signs of their curvatures and normals are wrong "
    "(meshing_invert_face_orientation)",
    "non_manifold_edges": "edges with three or more faces: neighbourhoods mix sheets "
    "(meshing_repair_non_manifold_edges)",
    "non_manifold_vertices": "vertices at which surfaces only touch: neighbourhoods mix them "
    "(meshing_repair_non_manifold_vertices)",
    "degenerate_faces": "faces without area are ignored (meshing_remove_null_faces removes them)",
    "duplicate_faces": "duplicate faces (meshing_remove_duplicate_faces removes them)",
    "unreferenced_vertices": "unreferenced vertices get no estimate "
    "(meshing_remove_unreferenced_vertices removes them)",
}
# faults that `repair` of the filters mends
_REPAIRABLE = {
    "inside_out_bodies",
    "flipped_faces",
    "non_manifold_edges",
    "non_manifold_vertices",
    "doubled_edges",
    "duplicate_faces",
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
    non_manifold_vertices : int
        Other vertices whose faces are not one fan, because surfaces only touch there.
    incoherent_edges : int
        Edges that their two faces run through in the same direction.
    flipped_faces : int
        Faces that look to another side than most faces of their component, or inwards in a closed body.
    inside_out_bodies : int
        Closed bodies all of whose faces look inwards, but for cavities of other bodies.
    doubled_edges : int
        Boundary edges that lie on another one, as where a file has the vertices of a seam twice.
    unwelded_faces : int
        Faces at such edges.
    inner_vertices : int
        Vertices of faces, and of no boundary edge.
    largest_piece : int
        Most vertices that are connected by edges.
    mean_edge_length : float
        Mean over the distinct edges, in units of length; 0 without edges.
    """

    unreferenced_vertices: int
    degenerate_faces: int
    duplicate_faces: int
    boundary_edges: int
    non_manifold_edges: int
    non_manifold_vertices: int
    incoherent_edges: int
    flipped_faces: int
    inside_out_bodies: int
    doubled_edges: int
    unwelded_faces: int
    inner_vertices: int
    largest_piece: int
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
    border = border_edges(mesh, on_boundary)
    doubled = doubled_edges(mesh, border)
    triples = np.stack([border.start, border.end, border.third], axis=1)[doubled]
    sides = face_sides(mesh.vertices, proper_faces(welded_vertices(mesh, border)[proper]))
    used = np.unique(mesh.faces)
    return MeshReport(
        unreferenced_vertices=mesh.vertex_count - len(used),
        degenerate_faces=mesh.face_count - len(proper) + int(flat.sum()),
        duplicate_faces=int(duplicates.sum()),
        boundary_edges=int((count == 1).sum()),
        non_manifold_edges=int((count > 2).sum()),
        non_manifold_vertices=_count_touching(proper, edges[count > 2], mesh.vertex_count),
        incoherent_edges=int(((count == 2) & (forward != 1)).sum()),
        flipped_faces=int(sides.flipped.sum()),
        inside_out_bodies=sides.inside_out_bodies,
        doubled_edges=len(triples),
        unwelded_faces=len(np.unique(np.sort(triples, axis=1), axis=0)),
        inner_vertices=int((~on_boundary[used]).sum()),
        largest_piece=_largest_piece(edges, mesh.vertex_count),
        mean_edge_length=float(lengths.mean()) if len(lengths) else 0.0,
    )


def _count_touching(faces: IntArray, non_manifold: IntArray, n: int) -> int:
    """Vertices, of no non-manifold edge (e, 2), whose corners of faces (m, 3) are not joined across edges."""
    corners, starts = np.arange(faces.size).reshape(-1, 3), faces.ravel()
    after = corners[:, [1, 2, 0]].ravel()
    first, last = paired_half_edges(faces, n)
    same = starts[first] == starts[last]  # the faces disagree, but are connected all the same
    row = np.concatenate([first, after[first]])
    column = np.concatenate([np.where(same, last, after[last]), np.where(same, after[last], last)])
    graph = coo_array((np.ones(len(row)), (row, column)), shape=(faces.size, faces.size))
    _, fan = np.unique(connected_components(graph, directed=False)[1], return_index=True)
    fans = np.bincount(starts[fan], minlength=n)
    fans[non_manifold] = 1
    return int((fans > 1).sum())


def _largest_piece(edges: IntArray, n: int) -> int:
    """Most vertices of n that edges (e, 2) connect."""
    if not len(edges):
        return min(n, 1)
    graph = coo_array((np.ones(len(edges)), tuple(edges.T)), shape=(n, n))
    return int(np.bincount(connected_components(graph, directed=False)[1]).max())


def _as_mesh(mesh: TriangleMesh | ArrayLike, faces: ArrayLike | None) -> TriangleMesh:
    if isinstance(mesh, TriangleMesh):
        return as_mesh(mesh, faces)
    return triangle_mesh(mesh, [] if faces is None else faces)


def is_fit(mesh: TriangleMesh, report: MeshReport) -> bool:
    """Whether curvature can be estimated at all: from enough points, or enough vertices that faces connect."""
    if mesh.face_count == 0:
        return mesh.vertex_count >= FEWEST_POINTS
    return report.largest_piece >= FEWEST_POINTS and bool(_has_sides(mesh))


def _has_sides(mesh: TriangleMesh) -> bool:
    """Whether faces leave any vertex with a normal: pairs that lie back to back leave none."""
    normals = area_vectors(mesh.vertices, mesh.faces)
    total = np.zeros((mesh.vertex_count, 3))
    for k in range(3):
        np.add.at(total, mesh.faces[:, k], normals)
    return bool((np.abs(total).max(initial=0.0)) > 1e-9 * np.abs(normals).max(initial=0.0))


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
    >>> diagnose([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    ['3 vertices at most are connected by faces: curvature takes 6 or more']
    """
    mesh = _as_mesh(mesh, None if isinstance(report, MeshReport) else report)
    report = report if isinstance(report, MeshReport) else inspect_mesh(mesh)
    if mesh.face_count == 0:
        if mesh.vertex_count < FEWEST_POINTS:
            return [f"{mesh.vertex_count:,} vertices without faces: curvature takes {FEWEST_POINTS} or more"]
        return ["there are no faces: a point cloud, whose normals tell the outside if it has any"]
    findings = []
    if report.largest_piece < FEWEST_POINTS:
        pieces = f"{report.largest_piece:,} vertices at most are connected by faces"
        findings.append(f"{pieces}: curvature takes {FEWEST_POINTS} or more")
    elif not report.inner_vertices:
        findings.append("all vertices lie on the border: there is no surface around any of them")
    findings += _orientation_findings(mesh, report)
    if report.unwelded_faces:
        share = (
            f"{report.unwelded_faces:,} of {mesh.face_count:,} faces ({report.unwelded_faces / mesh.face_count:.0%})"
        )
        findings.append(
            f"{share} are not welded: {report.doubled_edges:,} border edges lie on others, seams and cracks across "
            "which nothing is seen (meshing_merge_close_vertices)"
        )
    counts = ((getattr(report, name), text) for name, text in _FINDINGS.items())
    findings += [f"{count:,} {text}" for count, text in counts if count]
    return findings


def orientation_findings(mesh: TriangleMesh) -> list[str]:
    """Those of `diagnose` that say where signs of curvatures and normals are wrong."""
    report = inspect_mesh(mesh)
    count = report.inside_out_bodies
    return _orientation_findings(mesh, report) + ([f"{count:,} {_FINDINGS['inside_out_bodies']}"] if count else [])


def _orientation_findings(mesh: TriangleMesh, report: MeshReport) -> list[str]:
    if report.flipped_faces:
        share = f"{report.flipped_faces:,} of {mesh.face_count:,} faces ({report.flipped_faces / mesh.face_count:.0%})"
        return [f"{share} are flipped against the others: signs are wrong there (meshing_re_orient_faces_coherently)"]
    if report.incoherent_edges:
        return [
            f"{report.incoherent_edges:,} edges between faces that disagree about the outside, and always will: a "
            "surface with one side; signs are wrong there"
        ]
    return []


def explain(failure: str, otherwise: str, mesh: TriangleMesh) -> str:
    """A failure with what stands in its way by `diagnose`, and whether `repair` of the filters helps, in one line.

    Where nothing does, the other reason is given.
    """
    report = inspect_mesh(mesh)
    text = f"{failure}: {'; '.join(diagnose(mesh, report)) or otherwise}"
    return f"{text}; repair=True of the filter mends what can be mended" if can_be_repaired(report) else text


def can_be_repaired(report: MeshReport) -> bool:
    """Whether `repair` of the filters mends something."""
    return any(getattr(report, name) for name in _REPAIRABLE)
