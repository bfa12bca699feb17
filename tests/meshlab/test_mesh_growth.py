"""Which columns a mesh has after its holes were filled: those from before."""

import itertools

import numpy as np
import pymeshlab
import pytest

from bezier_filters.files.ply_text import color_columns, coordinate_columns, ply_text
from bezier_filters.meshlab.hole_filter import meshing_close_holes_by_bezier_patch
from bezier_filters.surfaces import torus

KINDS = ("vertex_color", "vertex_scalar", "vertex_tex_coord", "face_color", "face_scalar", "wedge_tex_coord")


def kinds_of(mesh):
    return {kind for kind in KINDS if getattr(mesh, f"has_{kind}")()}


def write_torus(path, kinds, resolution=12):
    """A torus with a hole as a PLY file, with some columns."""
    surface = torus(resolution=resolution)
    centers = surface.vertices[surface.faces].mean(axis=1)
    faces = surface.faces[np.linalg.norm(centers - [1.0, 0.0, 0.4], axis=1) > 0.25]
    vertices, of_faces = coordinate_columns(surface.vertices), {"list uchar int vertex_indices": faces}
    if "vertex_color" in kinds:
        vertices |= color_columns(np.full((len(surface.vertices), 4), 0.4))
    if "vertex_scalar" in kinds:
        vertices["double quality"] = surface.vertices[:, 0]
    if "vertex_tex_coord" in kinds:
        vertices |= {"float texture_u": surface.vertices[:, 0], "float texture_v": surface.vertices[:, 1]}
    if "wedge_tex_coord" in kinds:
        of_faces["list uchar float texcoord"] = surface.vertices[faces][..., :2].reshape(-1, 6)
    if "face_color" in kinds:
        of_faces |= color_columns(np.full((len(faces), 4), 0.6))
    if "face_scalar" in kinds:
        of_faces["double quality"] = np.arange(len(faces), dtype=float)
    path.write_text(ply_text({"vertex": vertices, "face": of_faces}))


@pytest.mark.parametrize(
    "kinds",
    [(), *((kind,) for kind in KINDS), *itertools.combinations(KINDS, len(KINDS) - 1), KINDS],
    ids=lambda kinds: " ".join(kinds) or "none",
)
def test_columns_are_those_from_before(tmp_path, kinds):
    write_torus(tmp_path / "torus.ply", kinds)
    ms = pymeshlab.MeshSet()
    ms.load_new_mesh(str(tmp_path / "torus.ply"))
    before = kinds_of(ms.current_mesh())
    assert before == set(kinds)
    report = meshing_close_holes_by_bezier_patch(ms)
    assert report["closed_holes"] == 1
    assert kinds_of(ms.current_mesh()) == before


def test_texture_coordinates_without_an_image_go_on(tmp_path):
    """As in OBJ files without their materials: new faces had the coordinates (0, 0)."""
    write_torus(tmp_path / "torus.ply", ["wedge_tex_coord"], resolution=24)
    ms = pymeshlab.MeshSet()
    ms.load_new_mesh(str(tmp_path / "torus.ply"))
    report = meshing_close_holes_by_bezier_patch(ms)
    assert report["new_vertices"] > 0
    assert not report["textured"]
    mesh = ms.current_mesh()
    truth = mesh.vertex_matrix()[mesh.face_matrix()].reshape(-1, 3)[:, :2]
    np.testing.assert_allclose(mesh.wedge_tex_coord_matrix(), truth, atol=0.02)
