"""The filters of vertices on a MeshSet, and small MeshSets for them."""

import numpy as np
import pymeshlab

from bezier_filters.arrays import FloatArray
from bezier_filters.meshlab.vertex_filters import (
    compute_curvature_by_bezier_patch_per_vertex,
    compute_normal_by_bezier_patch_per_vertex,
    compute_torsion_by_bezier_patch_per_vertex,
)

FILTERS = (
    compute_curvature_by_bezier_patch_per_vertex,
    compute_normal_by_bezier_patch_per_vertex,
    compute_torsion_by_bezier_patch_per_vertex,
)
GIVEN = {"rings": 2, "alpha": 0.8}  # where it does not matter how fits are chosen


def sphere(radius: float = 2.0) -> pymeshlab.MeshSet:
    """A sphere."""
    ms = pymeshlab.MeshSet()
    ms.create_sphere(radius=radius, subdiv=3)
    return ms


def sphere_and_a_lone_vertex() -> pymeshlab.MeshSet:
    """A sphere, and a vertex without faces after its vertices."""
    ball = sphere()
    vertices = np.vstack([ball.current_mesh().vertex_matrix(), [[9.0, 9.0, 9.0]]])
    ms = pymeshlab.MeshSet()
    ms.add_mesh(pymeshlab.Mesh(vertices, ball.current_mesh().face_matrix()))
    return ms


def array(ms: pymeshlab.MeshSet, name: str) -> FloatArray:
    """A column of the current mesh."""
    return ms.current_mesh().vertex_custom_scalar_attribute_array(name)
