"""A small mesh in a MeshSet where everything that could get lost is set."""

import numpy as np
import pymeshlab

from bezier_filters.surfaces import torus

TRANSFORM = np.array([[0, -2, 0, 1], [2, 0, 0, 2], [0, 0, 2, 3], [0, 0, 0, 1.0]])


def punched_torus(resolution=12):
    """Vertices and faces of a noisy torus with two holes."""
    surface = torus(resolution=resolution, jitter=0.2)
    vertices = surface.vertices + 0.01 * np.random.default_rng(0).standard_normal(surface.vertices.shape)
    centers = vertices[surface.faces].mean(axis=1)
    keep = np.ones(len(centers), dtype=bool)
    for place in ([1.0, 0.0, 0.4], [-1.0, 0.0, -0.4]):
        keep &= np.linalg.norm(centers - place, axis=1) > 0.25
    return vertices, surface.faces[keep]


def full_meshset(vertices=None, faces=None, *, layers=2):
    """A MeshSet with a filter script, several layers and, on the current one, all that a mesh can carry."""
    ms = pymeshlab.MeshSet()
    if vertices is None:
        vertices, faces = punched_torus()
    ms.add_mesh(pymeshlab.Mesh(vertices, faces), "ring")
    for _ in range(layers - 1):
        ms.create_cube()
    ms.set_current_mesh(0)
    if len(faces):
        ms.compute_texcoord_by_function_per_vertex(u="x", v="y")
        ms.compute_texcoord_by_function_per_wedge(u0="x0", u1="x1", u2="x2", v0="y0", v1="y1", v2="y2")
    add_all_attributes(ms, height=0.2, faces=50)
    return ms


def add_all_attributes(ms, *, height, faces):
    """Give the current mesh, layer 0, all that a mesh can carry; selected are what is above and the first faces."""
    ms.set_matrix(transformmatrix=TRANSFORM, freeze=False)
    ms.compute_scalar_by_function_per_vertex(q="x")
    ms.compute_color_by_function_per_vertex(x="vi * 0.05", y="7", z="9")
    ms.compute_selection_by_condition_per_vertex(condselect=f"y > {height}")
    ms.compute_selection_by_condition_per_face(condselect=f"fi < {faces}")
    ms.set_mesh_visibility(0, False)
    mesh = ms.current_mesh()
    rng = np.random.default_rng(1)
    mesh.add_vertex_custom_scalar_attribute(rng.normal(size=mesh.vertex_number()), "mine")
    mesh.add_vertex_custom_point_attribute(rng.normal(size=(mesh.vertex_number(), 3)), "minepoint")
    mesh.add_face_custom_scalar_attribute(rng.normal(size=mesh.face_number()), "facemine")
