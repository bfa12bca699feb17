"""Whether a mesh is fit for fitting, and what to do about it if not."""

from bezier_filters.meshes.mesh import MeshReport, TriangleMesh

FEWEST_POINTS = 6
"""Points that determine a quadratic."""


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
    >>> from bezier_filters.meshes.mesh import inspect_mesh, triangle_mesh
    >>> mesh = triangle_mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [5, 5, 5]], [[0, 1, 2]])
    >>> diagnose(mesh, inspect_mesh(mesh))
    ['1 unreferenced vertices get no estimate (meshing_remove_unreferenced_vertices removes them)']
    """
    if not is_fit(mesh):
        return [f"{mesh.vertex_count:,} vertices without faces: curvature takes {FEWEST_POINTS} or more"]
    if mesh.face_count == 0:
        return ["there are no faces: a point cloud, whose normals tell the outside if it has any"]
    findings = [
        (
            report.incoherent_edges,
            "edges between faces that disagree about the outside: signs are wrong there "
            "(meshing_re_orient_faces_coherently)",
        ),
        (
            report.non_manifold_edges,
            "edges with three or more faces: neighbourhoods mix sheets (meshing_repair_non_manifold_edges)",
        ),
        (report.degenerate_faces, "faces without area are ignored (meshing_remove_null_faces removes them)"),
        (report.duplicate_faces, "duplicate faces (meshing_remove_duplicate_faces removes them)"),
        (
            report.unreferenced_vertices,
            "unreferenced vertices get no estimate (meshing_remove_unreferenced_vertices removes them)",
        ),
    ]
    return [f"{count:,} {text}" for count, text in findings if count]
