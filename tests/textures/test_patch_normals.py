"""Normals inside faces, and tangent spaces."""

import numpy as np
import pytest
from texture_charts import separate_charts

from bezier_filters import estimate_vertex_geometry
from bezier_filters.meshes.mesh import triangle_mesh
from bezier_filters.meshes.prepared_mesh import prepare_mesh
from bezier_filters.surfaces import block_with_sharp_edges, torus
from bezier_filters.textures.patch_normals import (
    find_patch_normals,
    mean_face_normals,
    tangent_spaces,
    unit_vectors,
)

RADIUS, TUBE = 1.0, 0.4


def torus_normals(points):
    """Normals of the torus at the points of it nearest to some points."""
    circle = unit_vectors(points * [1.0, 1.0, 0.0]) * RADIUS
    return unit_vectors(points - circle)


def samples(count, faces):
    rng = np.random.default_rng(0)
    return rng.integers(0, faces, count).astype(np.int32), rng.dirichlet([1.0, 1.0, 1.0], count)


def rms_degrees(found, expected):
    chords = np.linalg.norm(found - expected, axis=1)
    return np.degrees(np.sqrt(np.square(2.0 * np.arcsin(0.5 * chords)).mean()))


def normal_errors(resolution):
    """Errors of the normals in a mesh of a torus, in degrees: of the patches, and of exact vertex normals."""
    shape = torus(major_radius=RADIUS, minor_radius=TUBE, resolution=resolution)
    geometry = estimate_vertex_geometry(shape.vertices, shape.faces)
    surface = find_patch_normals(prepare_mesh(triangle_mesh(shape.vertices, shape.faces)), geometry)
    assert surface.has_patch.all()
    faces, weights = samples(5000, len(shape.faces))
    expected = torus_normals(np.einsum("kc,kcj->kj", weights, shape.vertices[shape.faces[faces]]))
    linear = unit_vectors(np.einsum("kc,kcj->kj", weights, shape.normals[shape.faces[faces]]))
    return rms_degrees(surface.evaluate(faces, weights), expected), rms_degrees(linear, expected)


def test_normals_have_an_error_of_third_order():
    """Interpolated exact vertex normals have one of second order: half the edge, a quarter of the error."""
    (coarse, coarse_linear), (fine, fine_linear) = normal_errors(18), normal_errors(36)
    assert coarse_linear / fine_linear == pytest.approx(4.0, rel=0.1)
    assert coarse / fine > 7.0
    assert fine < 0.1 * fine_linear


def test_faces_at_sharp_edges_have_the_normals_of_their_side():
    vertices, faces = block_with_sharp_edges(resolution=8)
    mesh = prepare_mesh(triangle_mesh(vertices, faces))
    surface = find_patch_normals(mesh, estimate_vertex_geometry(vertices, faces))
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    own = unit_vectors(np.cross(b - a, c - a))
    rows, weights = samples(5000, len(faces))
    assert mesh.barriers[faces].any(axis=1).mean() > 0.3
    assert rms_degrees(surface.evaluate(rows, weights), own[rows]) < 1e-4
    assert (surface.corners[~surface.has_patch] == own[~surface.has_patch][:, np.newaxis]).all()


@pytest.mark.parametrize("mirrored", [False, True])
def test_tangent_spaces_hold_and_restore_normals(mirrored):
    """Decoded as a shader does, x T + y B + z N, with interpolated N and T and their cross product."""
    shape = torus(resolution=16, jitter=0.2)
    charts = separate_charts(shape.faces, mirrored=mirrored)
    spaces = tangent_spaces(shape.vertices, shape.faces, charts, shape.normals)
    assert (spaces.signs == (-1.0 if mirrored else 1.0)).all()
    faces, weights = samples(2000, len(shape.faces))
    normal, tangent = (np.einsum("kc,kcj->kj", weights, each[faces]) for each in (spaces.normals, spaces.tangents))
    bitangent = spaces.signs[faces, np.newaxis] * np.cross(normal, tangent)
    given = unit_vectors(normal + 0.3 * np.random.default_rng(1).standard_normal(normal.shape))
    x, y, z = spaces.encode(faces, weights, given).T[..., np.newaxis]
    np.testing.assert_allclose(unit_vectors(x * tangent + y * bitangent + z * normal), given, atol=1e-12)


def test_axes_follow_the_texture():
    """On a plane the tangent is the direction in which u grows, and the bitangent that of v."""
    vertices, faces = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]), np.array([[0, 1, 2], [0, 2, 3]])
    up = np.broadcast_to([0.0, 0.0, 1.0], (4, 3))
    turn = np.array([[0.6, 0.8], [-0.8, 0.6]])
    for matrix in (turn, turn * [[1.0], [-1.0]]):  # turned, and mirrored
        spaces = tangent_spaces(vertices, faces, (vertices[:, :2] @ matrix.T)[faces], up)
        along_u, along_v = np.linalg.inv(matrix).T
        np.testing.assert_allclose(spaces.tangents[..., :2], np.broadcast_to(along_u, (2, 3, 2)), atol=1e-12)
        bitangents = spaces.signs[:, np.newaxis, np.newaxis] * np.cross(spaces.normals, spaces.tangents)
        np.testing.assert_allclose(bitangents[..., :2], np.broadcast_to(along_v, (2, 3, 2)), atol=1e-12)


def test_mean_face_normals_are_those_of_pymeshlab():
    pymeshlab = pytest.importorskip("pymeshlab")
    shape = torus(resolution=12, jitter=0.3)
    ms = pymeshlab.MeshSet()
    ms.add_mesh(pymeshlab.Mesh(shape.vertices, shape.faces))
    ms.compute_normal_per_vertex(weightmode="By Angle")
    expected = unit_vectors(np.array(ms.current_mesh().vertex_normal_matrix()))
    np.testing.assert_allclose(mean_face_normals(shape.vertices, shape.faces), expected, atol=1e-7)
