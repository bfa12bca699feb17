"""Diagnosis of meshes: faults, whether curvature can be estimated, and remedies."""

from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from bezier_filters.arrays import IntArray
from bezier_filters.meshes.face_sides import face_sides
from bezier_filters.meshes.half_edges import (
    border_edges,
    coincident_border_edges,
    distinct_edges,
    ends_of_half_edges,
    half_edge_pairs,
    proper_faces,
    weld_vertices,
)
from bezier_filters.meshes.mesh import TriangleMesh, ensure_mesh, surface_or_points
from bezier_filters.meshes.mesh_objects import MeshLike
from bezier_filters.meshes.triangles import area_vectors
from bezier_filters.result_tables import Table, TabularResult
from bezier_filters.runtime.cached_property import cached_property

MIN_FIT_POINTS = 6  # points that determine a quadratic

# messages by the counts of a report, the most severe first
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
# faults that `repair` of the filters removes
_REPAIRABLE = {
    "inside_out_bodies",
    "flipped_faces",
    "non_manifold_edges",
    "non_manifold_vertices",
    "doubled_edges",
    "duplicate_faces",
}


@dataclass(frozen=True)
class MeshReport(TabularResult):
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
        Faces oriented against most faces of their component, or inwards in a closed body.
    inside_out_bodies : int
        Closed bodies whose faces all point inwards, except cavities of other bodies.
    doubled_edges : int
        Boundary edges that coincide with another one, as at seams whose vertices a file stores twice.
    unwelded_faces : int
        Faces at such edges.
    inner_vertices : int
        Vertices of faces but of no boundary edge.
    largest_piece : int
        Number of vertices of the largest component connected by edges.
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

    def _tables(self) -> list[Table]:
        rows = [[name.replace("_", " "), value] for name, value in asdict(self).items()]
        return [Table("Mesh", ["", "count or length"], rows)]

    def _columns(self) -> dict[str, object]:
        return {name: [value] for name, value in asdict(self).items()}


def inspect_mesh(mesh: ArrayLike | MeshLike, faces: ArrayLike | None = None) -> MeshReport:
    """Count what makes a mesh hard to fit: see `MeshReport`.

    Parameters
    ----------
    mesh : TriangleMesh or other mesh object, or (n, 3) array_like of float
        A mesh, see `mesh_arrays`, or the coordinates of its vertices.
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
    mesh = _ensure_mesh(mesh, faces)
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
    doubled = coincident_border_edges(mesh, border)
    triples = np.stack([border.start, border.end, border.third], axis=1)[doubled]
    sides = face_sides(mesh.vertices, proper_faces(weld_vertices(mesh, border)[proper]))
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
    """Count vertices whose faces (m, 3) are not connected across edges, except at non-manifold edges (e, 2)."""
    corners, starts = np.arange(faces.size).reshape(-1, 3), faces.ravel()
    after = corners[:, [1, 2, 0]].ravel()
    first, last = half_edge_pairs(faces, n)
    same = starts[first] == starts[last]  # the faces disagree, but are connected all the same
    row = np.concatenate([first, after[first]])
    column = np.concatenate([np.where(same, last, after[last]), np.where(same, after[last], last)])
    graph = coo_array((np.ones(len(row)), (row, column)), shape=(faces.size, faces.size))
    _, fan = np.unique(connected_components(graph, directed=False)[1], return_index=True)
    fans = np.bincount(starts[fan], minlength=n)
    fans[non_manifold] = 1
    return int((fans > 1).sum())


def _largest_piece(edges: IntArray, n: int) -> int:
    """Number of vertices, of n, of the largest component that edges (e, 2) connect."""
    if not len(edges):
        return min(n, 1)
    graph = coo_array((np.ones(len(edges)), tuple(edges.T)), shape=(n, n))
    return int(np.bincount(connected_components(graph, directed=False)[1]).max())


def _ensure_mesh(mesh: ArrayLike | MeshLike, faces: ArrayLike | None) -> TriangleMesh:
    return ensure_mesh(mesh) if isinstance(mesh, TriangleMesh) and faces is None else surface_or_points(mesh, faces)


def is_fit(mesh: TriangleMesh, report: MeshReport) -> bool:
    """Whether curvature can be estimated at all: enough points, or enough connected vertices."""
    if mesh.face_count == 0:
        return mesh.vertex_count >= MIN_FIT_POINTS
    return report.largest_piece >= MIN_FIT_POINTS and bool(_has_sides(mesh))


def _has_sides(mesh: TriangleMesh) -> bool:
    """Whether any vertex has a normal: pairs of faces back to back cancel out."""
    normals = area_vectors(mesh.vertices, mesh.faces)
    total = np.zeros((mesh.vertex_count, 3))
    for k in range(3):
        np.add.at(total, mesh.faces[:, k], normals)
    return bool((np.abs(total).max(initial=0.0)) > 1e-9 * np.abs(normals).max(initial=0.0))


def diagnose(mesh: ArrayLike | MeshLike, report: MeshReport | ArrayLike | None = None) -> list[str]:
    """List faults that impair the estimates, each with its remedy in pymeshlab; empty if there are none.

    Parameters
    ----------
    mesh : TriangleMesh or other mesh object, or (n, 3) array_like of float
        A mesh, see `mesh_arrays`, or the coordinates of its vertices.
    report : MeshReport, or (m, 3) array_like of int, optional
        From `inspect_mesh` of the same mesh, if available; or triangles, if `mesh` is an array.

    Examples
    --------
    >>> diagnose([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    ['at most 3 vertices are connected by faces: curvature needs 6 or more']
    """
    mesh = _ensure_mesh(mesh, None if isinstance(report, MeshReport) else report)
    report = report if isinstance(report, MeshReport) else inspect_mesh(mesh)
    if mesh.face_count == 0:
        if mesh.vertex_count < MIN_FIT_POINTS:
            return [f"{mesh.vertex_count:,} vertices without faces: curvature needs {MIN_FIT_POINTS} or more"]
        return ["there are no faces: a point cloud; its normals, if it has any, define the outside"]
    findings = []
    if report.largest_piece < MIN_FIT_POINTS:
        pieces = f"at most {report.largest_piece:,} vertices are connected by faces"
        findings.append(f"{pieces}: curvature needs {MIN_FIT_POINTS} or more")
    elif not report.inner_vertices:
        findings.append("all vertices lie on the border: there is no surface around any of them")
    findings += _orientation_findings(mesh, report)
    if report.unwelded_faces:
        share = (
            f"{report.unwelded_faces:,} of {mesh.face_count:,} faces ({report.unwelded_faces / mesh.face_count:.0%})"
        )
        findings.append(
            f"{share} are not welded: {report.doubled_edges:,} border edges coincide with others, seams and cracks "
            "that neighbourhoods do not cross (meshing_merge_close_vertices)"
        )
    counts = ((getattr(report, name), text) for name, text in _FINDINGS.items())
    findings += [f"{count:,} {text}" for count, text in counts if count]
    return findings


def orientation_findings(mesh: TriangleMesh) -> list[str]:
    """Findings of `diagnose` about wrong signs of curvatures and normals."""
    report = inspect_mesh(mesh)
    count = report.inside_out_bodies
    return _orientation_findings(mesh, report) + ([f"{count:,} {_FINDINGS['inside_out_bodies']}"] if count else [])


def _orientation_findings(mesh: TriangleMesh, report: MeshReport) -> list[str]:
    if report.flipped_faces:
        share = f"{report.flipped_faces:,} of {mesh.face_count:,} faces ({report.flipped_faces / mesh.face_count:.0%})"
        return [f"{share} are flipped against the others: signs are wrong there (meshing_re_orient_faces_coherently)"]
    if report.incoherent_edges:
        return [
            f"{report.incoherent_edges:,} edges between faces that cannot agree on an outside: a one-sided surface; "
            "signs are wrong there"
        ]
    return []


def explain(failure: str, otherwise: str, mesh: TriangleMesh) -> str:
    """A failure with the findings of `diagnose`, and whether `repair` of the filters helps, in one line.

    Without findings, the text `otherwise` gives the reason, unless it is empty.
    """
    report = inspect_mesh(mesh)
    reason = "; ".join(diagnose(mesh, report)) or otherwise
    text = f"{failure}: {reason}" if reason else failure
    return f"{text}; repair=True of the filter repairs some of it" if can_be_repaired(report) else text


def can_be_repaired(report: MeshReport) -> bool:
    """Whether `repair` of the filters removes any fault."""
    return any(getattr(report, name) for name in _REPAIRABLE)
