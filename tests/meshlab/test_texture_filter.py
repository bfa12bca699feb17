"""The filter that bakes maps of a MeshSet, and its command."""

import json
from pathlib import Path

import numpy as np
import pymeshlab
import pytest
from command_line import run
from full_meshset import full_meshset
from meshset_state import mesh_state

from bezier_filters import BezierFilterError, bake_texture, compute_texmap_by_bezier_patch, load_mesh, save_mesh
from bezier_filters.surfaces import torus

BUNNY = Path(pymeshlab.__file__).parent / "tests" / "sample_meshes" / "bunny10k_textured.obj"
RING = torus(resolution=16)


def unwrapped_ring():
    ms = pymeshlab.MeshSet()
    ms.add_mesh(pymeshlab.Mesh(RING.vertices, RING.faces))
    ms.compute_texcoord_parametrization_triangle_trivial_per_wedge(textdim=256)
    return ms


def read_png(path):
    library = pytest.importorskip("PIL.Image", reason="Pillow is not installed")
    with library.open(path) as image:
        return np.asarray(image).astype(np.int64)


def test_the_file_is_the_image_of_the_array_function(tmp_path):
    ms = unwrapped_ring()
    path = tmp_path / "curvature.png"
    report = compute_texmap_by_bezier_patch(ms, textname=str(path), size=256, scale=0.5)
    charts = ms.current_mesh().wedge_tex_coord_matrix().reshape(-1, 3, 2)
    baked = bake_texture(RING.vertices, RING.faces, charts, size=256, scale=0.5)
    assert np.abs(read_png(path) - baked.image * 65535.0).max() <= 0.51
    assert report["covered"] == baked.covered.mean()
    assert report["overlapping_texels"] == 0
    assert json.loads(json.dumps(report)) == report


def test_nothing_in_a_meshset_changes():
    ms = full_meshset()
    before = mesh_state(ms)
    report = compute_texmap_by_bezier_patch(ms, size=64)
    assert report["texture"] is None
    assert str(mesh_state(ms)) == str(before)


def test_a_percentage_is_one_of_the_diagonal():
    diagonal = np.linalg.norm(np.ptp(RING.vertices, axis=0))
    assert compute_texmap_by_bezier_patch(unwrapped_ring(), size=64, scale="5%")["scale"] == 0.05 * diagonal


def test_coordinates_of_vertices_count_where_there_are_no_others():
    ms = pymeshlab.MeshSet()
    ms.load_new_mesh(str(Path(__file__).parents[2] / "sample_meshes" / "waves.ply"))
    ms.compute_texcoord_by_function_per_vertex(u="x", v="y")
    report = compute_texmap_by_bezier_patch(ms, size=64)
    assert not ms.current_mesh().has_wedge_tex_coord()
    assert report["outside_faces"] > 0
    assert any("beyond 0 to 1; the texture repeats there" in remark for remark in report["remarks"])


def test_normal_maps_are_relative_to_the_normals_of_the_mesh(tmp_path):
    ms = unwrapped_ring()
    charts = ms.current_mesh().wedge_tex_coord_matrix().reshape(-1, 3, 2)
    ms.compute_normal_by_function_per_vertex(x="3*x", y="3*y", z="1")
    compute_texmap_by_bezier_patch(ms, textname=str(tmp_path / "a.png"), texmap="normal", size=128, bits=8)
    normals = np.column_stack([3 * RING.vertices[:, :2], np.ones(len(RING.vertices))])
    baked = bake_texture(RING.vertices, RING.faces, charts, "normal", size=128, normals=normals)
    assert np.abs(read_png(tmp_path / "a.png") - baked.image * 255.0).max() <= 0.6


def test_meshes_without_coordinates_learn_how_to_get_some():
    ms = pymeshlab.MeshSet()
    ms.create_sphere(subdiv=2)
    with pytest.raises(BezierFilterError, match="has no texture coordinates; unwrap it first") as caught:
        compute_texmap_by_bezier_patch(ms)
    named = [word for word in str(caught.value).split() if word.startswith(("generate_", "compute_"))]
    assert len(named) == 2
    for name in named:
        ms = pymeshlab.MeshSet()
        ms.create_sphere(subdiv=3)
        ms.apply_filter(name)
        ms.set_current_mesh(ms.mesh_number() - 1)
        report = compute_texmap_by_bezier_patch(ms, size=256)
        assert report["overlapping_texels"] == report["faces_without_area"] == report["outside_faces"] == 0


def test_several_images_are_refused(tmp_path):
    lines = [f"v {x} {y} 0" for x in (0, 1) for y in (0, 1)] + ["vt 0 0", "vt 1 0", "vt 0 1"]
    materials = "".join(f"newmtl m{k}\nmap_Kd {k}.png\n" for k in (0, 1))
    (tmp_path / "a.mtl").write_text(materials)
    lines += ["usemtl m0", "f 1/1 3/2 2/3", "usemtl m1", "f 2/1 3/2 4/3"]
    (tmp_path / "a.obj").write_text("\n".join(["mtllib a.mtl", *lines, ""]))
    compute_texmap_by_bezier_patch(unwrapped_ring(), textname=str(tmp_path / "0.png"), size=4)
    compute_texmap_by_bezier_patch(unwrapped_ring(), textname=str(tmp_path / "1.png"), size=4)
    with pytest.raises(BezierFilterError, match=r"are on 2 images, expected one"):
        compute_texmap_by_bezier_patch(load_mesh(tmp_path / "a.obj"))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"texmap": "bump"}, "texmap: got 'bump', expected one of curvature"),
        ({"textname": "a.jpg"}, r"path: got a\.jpg, expected a name that ends in \.png"),
        ({"textname": "a.png", "bits": 9}, "bits: got 9, expected 8 or 16"),
        ({"scale": -1.0}, r"scale: got -1\.0, expected a positive length"),
    ],
)
def test_bad_parameters_are_refused_and_write_nothing(options, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(BezierFilterError, match=message):
        compute_texmap_by_bezier_patch(unwrapped_ring(), **options)
    assert list(tmp_path.iterdir()) == []


def test_the_command_bakes_a_bunny(tmp_path):
    path = tmp_path / "normals.png"
    result = run("bake", BUNNY, path, "--map", "normal", "--size", 256, "--bits", 8, "--directx", "--json")
    assert result.returncode == 0, result.stderr
    report = json.loads(result.stdout)
    assert (report["input"], report["output"]) == (str(BUNNY), str(path))
    assert "faces are smaller than a texel" in result.stderr
    image = read_png(path)
    assert image.shape == (256, 256, 3)
    assert image[..., 2].min() > 127
    shown = run("bake", BUNNY, tmp_path / "cavity.png", "--map", "cavity", "--size", 64).stdout
    assert "cavity map of 64 x 64 texels, 16 bits, 26% in faces, saturated at a radius of curvature of" in shown


def test_the_command_refuses_in_the_words_of_the_shell(tmp_path):
    save_mesh(unwrapped_ring(), tmp_path / "ring.obj")
    result = run("bake", tmp_path / "ring.obj", tmp_path / "a.png", "--map", "bump")
    assert (result.returncode, result.stderr.startswith("bezier-filters: --map: got 'bump'")) == (2, True)
    result = run("bake", Path(__file__).parents[2] / "sample_meshes" / "torus.ply", tmp_path / "a.png")
    assert result.stderr.startswith("bezier-filters: the mesh has no texture coordinates; unwrap it first")
    assert not (tmp_path / "a.png").exists()
