"""The methods that the benchmarks compare: ours, the paper's baselines, and other libraries' own.

A method takes vertices and faces and gives an `Estimate`.
"""

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np
import pymeshlab

import baselines
import bezier_filters as bf


class Estimate(NamedTuple):
    """What a method says of the vertices; None for what it does not give."""

    normals: np.ndarray | None
    mean_curvature: np.ndarray | None
    gaussian_curvature: np.ndarray | None


Method: TypeAlias = Callable[[np.ndarray, np.ndarray], Estimate]


def ours(**options: object) -> Method:
    def estimate(vertices: np.ndarray, faces: np.ndarray) -> Estimate:
        geometry = bf.estimate_vertex_geometry(vertices, faces, **options)
        return Estimate(geometry.normals, geometry.mean_curvature, geometry.gaussian_curvature)

    return estimate


def razdan_bae(shape: baselines.ShapeEquations) -> Method:
    def estimate(vertices: np.ndarray, faces: np.ndarray) -> Estimate:
        geometry = baselines.razdan_bae(vertices, faces, shape=shape)
        return Estimate(geometry.normals, geometry.mean_curvature, geometry.gaussian_curvature)

    return estimate


def ouyang_feng(vertices: np.ndarray, faces: np.ndarray) -> Estimate:
    return Estimate(baselines.ouyang_feng_normals(vertices, faces), None, None)


def libigl_quadric(radius: int) -> dict[str, Method]:
    """Libigl's quadric fit within so many edges, under its name; empty, with a notice, without libigl."""
    try:
        import igl
    except ImportError:
        print("libigl is not installed: left out (pip install --group bench)")
        return {}

    def estimate(vertices: np.ndarray, faces: np.ndarray) -> Estimate:
        _, _, k1, k2, *_ = igl.principal_curvature(vertices, faces, radius)
        return Estimate(None, 0.5 * (k1 + k2), k1 * k2)

    return {f"libigl quadric, radius {radius}": estimate}


def loaded(vertices: np.ndarray, faces: np.ndarray) -> pymeshlab.MeshSet:
    meshset = pymeshlab.MeshSet()
    meshset.add_mesh(pymeshlab.Mesh(vertices, faces))
    return meshset


def meshlab_discrete(vertices: np.ndarray, faces: np.ndarray) -> Estimate:
    meshset = loaded(vertices, faces)
    fields = []
    for kind in ("Mean Curvature", "Gaussian Curvature"):
        meshset.compute_scalar_by_discrete_curvature_per_vertex(curvaturetype=kind)
        fields.append(meshset.current_mesh().vertex_scalar_array().copy())
    return Estimate(None, fields[0], fields[1])


def meshlab_directions(kind: str) -> Method:
    """One of the methods of MeshLab's filter for principal directions, at its default scale."""

    def estimate(vertices: np.ndarray, faces: np.ndarray) -> Estimate:
        meshset = loaded(vertices, faces)
        fields = []
        for curvature in ("Mean Curvature", "Gaussian Curvature"):
            meshset.compute_curvature_principal_directions_per_vertex(
                method=kind, curvcolormethod=curvature, autoclean=False
            )
            fields.append(meshset.current_mesh().vertex_scalar_array().copy())
        return Estimate(None, fields[0], fields[1])

    return estimate


def meshlab_normals(weight: str) -> Method:
    """Mean of the face normals with one of MeshLab's weights."""

    def estimate(vertices: np.ndarray, faces: np.ndarray) -> Estimate:
        meshset = loaded(vertices, faces)
        meshset.compute_normal_per_vertex(weightmode=weight)
        return Estimate(meshset.current_mesh().vertex_normal_matrix(), None, None)

    return estimate


def angles(normals: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Angles in degrees between normals of any length and unit normals, each (n, 3)."""
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    unit = np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0)
    return np.degrees(2.0 * np.arcsin(np.minimum(0.5 * np.linalg.norm(unit - truth, axis=1), 1.0)))
