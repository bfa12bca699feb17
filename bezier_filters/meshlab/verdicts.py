"""Warnings and remarks about the success of a filter, with the diagnosis of the mesh."""

import numpy as np

from bezier_filters.arrays import BoolArray, Report
from bezier_filters.fitting.vertex_geometry import VertexGeometry
from bezier_filters.meshes.diagnosis import can_be_repaired, explain, inspect_mesh, is_fit, orientation_findings
from bezier_filters.meshes.mesh import triangle_mesh
from bezier_filters.meshlab.meshset import CurrentMesh
from bezier_filters.meshlab.topology import Topology
from bezier_filters.smoothing.smooth import SmoothingMethod, SmoothingResult, unknown_noise
from bezier_filters.status import FitStatus


def fit_verdict(what: str, geometry: VertexGeometry, mesh: CurrentMesh, mask: BoolArray, worst: FitStatus) -> Report:
    """A warning if no vertex of a mask has an estimate, or folds spoil most; a remark if most are unreliable."""
    if len(mesh.faces):  # isolated vertices have a message of their own
        in_faces = np.isin(np.arange(len(mask)), mesh.faces)
        mask = mask & in_faces if (mask & in_faces).any() else mask
    status = geometry.status[mask]
    good = status <= worst if what == "normal" else status < FitStatus.FOLDED
    if not len(status) or 2 * int(good.sum()) > len(status):
        return {"warnings": [], "remarks": []}
    most = list(FitStatus)[int(np.bincount(status).argmax())]
    shape = triangle_mesh(mesh.vertices, mesh.faces)
    if (status > worst).all():
        return {"warnings": [explain(f"no vertex has a {what}", most.message, shape)], "remarks": []}
    bad = f"{len(status) - int(good.sum()):,} of {len(status):,} vertices have no {what} to rely on"
    found = [explain(bad, most.message, shape)]
    return {"warnings": found, "remarks": []} if most == FitStatus.FOLDED else {"warnings": [], "remarks": found}


def remark_flipped(geometry: VertexGeometry) -> list[str]:
    """A remark if normals of a cloud contradict their viewpoints."""
    if not geometry.flipped:
        return []
    known = int(geometry.normals.any(axis=1).sum())
    return [f"{geometry.flipped:,} of {known:,} normals contradict their viewpoints, to agree with those around them"]


def orientation_remarks(mesh: CurrentMesh, topology: Topology) -> list[str]:
    """Remarks about wrong signs of curvatures and normals, by flipped faces or inside-out bodies."""
    is_closed = not topology.counts["boundary_edges"]
    if topology.is_coherent and not (is_closed and _volume(mesh) < 0.0):
        return []
    found = orientation_findings(triangle_mesh(mesh.vertices, mesh.faces))
    return [f"{finding}; repair=True of the filter repairs some of it" for finding in found]


def _volume(mesh: CurrentMesh) -> float:
    """Signed volume enclosed by the faces, length^3."""
    middle = mesh.vertices.mean(axis=0)
    a, b, c = (mesh.vertices[mesh.faces[:, k]] - middle for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


def smoothing_warnings(result: SmoothingResult, mesh: CurrentMesh, method: SmoothingMethod) -> list[str]:
    """Why nothing was smoothed; empty where nothing was to do, as on a clean or a flat mesh."""
    if result.displacement.any():
        return []
    shape = triangle_mesh(mesh.vertices, mesh.faces)
    if method == "auto" and result.noise_before is None:
        return [explain(unknown_noise(result.noise_reason), "", shape)]
    faults = inspect_mesh(shape)
    if is_fit(shape, faults) and (result.noise_before is not None or not can_be_repaired(faults)):
        return []
    return [explain("nothing was smoothed", "no vertex has a patch", shape)]
