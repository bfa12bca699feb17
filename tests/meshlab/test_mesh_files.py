import base64
import json
import locale
import os
import re
from pathlib import Path

import numpy as np
import pymeshlab
import pytest
from meshset_state import changed, mesh_state

import bezier_filters as bf
from bezier_filters.files.field_files import read_fields
from bezier_filters.meshlab.mesh_files import load_mesh, save_mesh
from bezier_filters.meshlab.meshset import BezierFilterError
from bezier_filters.meshlab.save_formats import FIELD_SUFFIX, SAVE_SUFFIXES
from bezier_filters.meshlab.vertex_filters import (
    compute_curvature_by_bezier_patch_per_vertex,
    compute_normal_by_bezier_patch_per_vertex,
)
from bezier_filters.surfaces import torus

SAMPLES = Path(pymeshlab.__file__).parent / "tests" / "sample_meshes"


@pytest.fixture(scope="module")
def result():
    """A sphere with new normals, curvature columns, quality and colours."""
    ms = pymeshlab.MeshSet()
    ms.create_sphere(subdiv=3)
    ms.compute_coord_by_function(x="x * 2", y="y", z="z")
    compute_normal_by_bezier_patch_per_vertex(ms)
    compute_curvature_by_bezier_patch_per_vertex(ms, color=True)
    return ms


def quoted(path):
    return rf"cannot (read|write) \S*{path}"


class TestLoading:
    @pytest.mark.parametrize("name", ["bunny10k_textured.obj", "bone.ply"])
    def test_loading(self, name):
        ms = load_mesh(SAMPLES / name)
        assert ms.current_mesh().vertex_number() > 1000
        assert ms.current_mesh().label() == name

    def test_columns_come_back_bit_for_bit_where_pymeshlab_drops_them(self, tmp_path, result):
        names = ("bz_k_min", "bz_normal_x", "bz_fit_grade")
        before = [result.current_mesh().vertex_custom_scalar_attribute_array(name) for name in names]
        save_mesh(result, tmp_path / "a.ply")
        ms = pymeshlab.MeshSet()
        ms.load_new_mesh(str(tmp_path / "a.ply"))
        back, without = load_mesh(tmp_path / "a.ply"), load_mesh(tmp_path / "a.ply", attributes=False)
        for mesh in (ms.current_mesh(), without.current_mesh()):
            with pytest.raises(pymeshlab.PyMeshLabException):
                mesh.vertex_custom_scalar_attribute_array("bz_k_min")
        for name, values in zip(names, before, strict=True):
            np.testing.assert_array_equal(back.current_mesh().vertex_custom_scalar_attribute_array(name), values)
        compute_curvature_by_bezier_patch_per_vertex(back)  # overwrites them, and works

    def test_columns_that_would_harm_the_mesh_are_mended_or_left_out(self, tmp_path):
        names = ("bz_k_min", "bz_K", "bz_a-b")
        header = ["ply", "format ascii 1.0", "element vertex 2", *(f"property double {axis}" for axis in "xyz")]
        header += [f"property double {name}" for name in names]
        lines = [*header, "end_header", "0 0 0 nan 1 1", "1 0 0 2 1 1", ""]
        (tmp_path / "a.ply").write_text("\n".join(lines))
        mesh = (ms := load_mesh(tmp_path / "a.ply")).current_mesh()
        np.testing.assert_array_equal(mesh.vertex_custom_scalar_attribute_array("bz_k_min"), [0.0, 2.0])
        assert [key for key in ms.filter_parameter_values("ply") if "bz_" in key] == ["__ca_vs__bz_k_min"]

    def test_a_name_with_spaces_and_accents(self, tmp_path, result):
        path = tmp_path / "é ü 1.ply"
        save_mesh(result, path)
        back = load_mesh(path)
        assert back.current_mesh().vertex_number() == 642

    @pytest.mark.parametrize(
        ("name", "content", "reason"),
        [
            ("empty.ply", b"", "the file is empty"),
            ("junk.ply", b"\x00\xff" * 200, "is no PLY file"),
            ("junk.stl", b"\x00\xff" * 200, "it is cut short or damaged: its header announces 4278255360 triangles"),
            ("junk.obj", b"\x00\xff" * 200, "No vertex found"),
            # pymeshlab's reader ends the process here.
            (
                "faces.off",
                b"OFF\n4 2 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n# faces\n4 0 1\n2 3\n\n3 0 1 2\n",
                "it is cut short or has faces over several lines: line 8 announces 4 corners, but holds 2",
            ),
            ("mesh.foo", b"abc", "its name ends in no format"),
            ("mesh", b"abc", "its name ends in no format"),
            ("none.ply", b"ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nend_header\n", ""),
            (
                "cut.ply",
                (SAMPLES / "bone.ply").read_bytes()[:20000],
                "it is cut short or damaged: its header announces",
            ),
        ],
    )
    def test_unreadable_files(self, tmp_path, name, content, reason):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(BezierFilterError, match=quoted(name)) as caught:
            load_mesh(tmp_path / name)
        assert reason in str(caught.value)
        assert "\n" not in str(caught.value)

    def test_no_such_file(self, tmp_path):
        with pytest.raises(BezierFilterError, match=quoted("nope.ply: no such file")):
            load_mesh(tmp_path / "nope.ply")

    def test_a_directory(self, tmp_path):
        with pytest.raises(BezierFilterError, match="it is a directory"):
            load_mesh(tmp_path)


class TestSaving:
    def test_ply_keeps_everything(self, tmp_path, result):
        path = tmp_path / "out.PLY"
        save_mesh(result, path)
        mesh, back = result.current_mesh(), load_mesh(path)
        read = back.current_mesh()
        assert np.array_equal(read.vertex_matrix(), mesh.vertex_matrix())
        assert np.array_equal(read.vertex_normal_matrix(), mesh.vertex_normal_matrix())
        assert np.array_equal(read.vertex_scalar_array(), mesh.vertex_scalar_array())
        assert np.array_equal(read.vertex_color_matrix(), mesh.vertex_color_matrix())
        fields = read_fields(path)
        assert np.array_equal(fields["bz_k_min"], mesh.vertex_custom_scalar_attribute_array("bz_k_min"))
        assert "outlierScore" not in fields

    def test_without_columns(self, tmp_path, result):
        path = tmp_path / "out.ply"
        save_mesh(result, path, attributes=False)
        assert list(read_fields(path)) == ["quality"]

    def test_ascii(self, tmp_path, result):
        path = tmp_path / "out.ply"
        save_mesh(result, path, binary=False)
        assert path.read_bytes().startswith(b"ply\nformat ascii")

    @pytest.mark.parametrize("suffix", SAVE_SUFFIXES)
    def test_every_format_can_be_written_and_nothing_is_left_over(self, tmp_path, result, suffix):
        path = tmp_path / f"out{suffix}"
        save_mesh(result, path)
        assert path.stat().st_size > 1000
        assert [entry.name for entry in tmp_path.iterdir()] == [path.name]

    @pytest.mark.parametrize("suffix", [".ply", ".obj", ".off", ".dae", ".x3d", ".wrl"])
    def test_colours_come_back(self, tmp_path, result, suffix):
        save_mesh(result, tmp_path / f"out{suffix}")
        back = load_mesh(tmp_path / f"out{suffix}")  # a mesh lives only as long as its MeshSet
        read = back.current_mesh()
        assert read.has_vertex_color()
        means = [mesh.vertex_color_matrix().mean(axis=0) for mesh in (read, result.current_mesh())]
        assert means[0] == pytest.approx(means[1], abs=0.005)

    @pytest.mark.parametrize("suffix", [".ply", ".obj", ".off"])
    def test_normals_come_back(self, tmp_path, suffix):
        ms = pymeshlab.MeshSet()
        ms.create_sphere(subdiv=3)
        compute_normal_by_bezier_patch_per_vertex(ms)
        save_mesh(ms, tmp_path / f"out{suffix}")
        back = load_mesh(tmp_path / f"out{suffix}")
        assert back.current_mesh().vertex_normal_matrix() == pytest.approx(
            ms.current_mesh().vertex_normal_matrix(), abs=1e-5
        )

    def test_columns_are_saved_which_pymeshlab_leaves_out(self, result, tmp_path):
        bf.save_mesh(result, tmp_path / "ours.ply")
        result.save_current_mesh(str(tmp_path / "theirs.ply"))
        assert {"quality", "bz_k_min", "bz_normal_x"} < set(read_fields(tmp_path / "ours.ply"))
        assert set(read_fields(tmp_path / "theirs.ply")) == {"quality"}

    def test_saving_changes_nothing_in_the_mesh_set(self, tmp_path, textured_bunny):
        before = mesh_state(textured_bunny)
        save_mesh(textured_bunny, tmp_path / "out.obj")
        assert changed(before, mesh_state(textured_bunny)) == set()

    def test_an_obj_and_its_companions(self, tmp_path, textured_bunny):
        save_mesh(textured_bunny, tmp_path / "out.obj")
        save_mesh(textured_bunny, tmp_path / "out.obj")
        assert sorted(os.listdir(tmp_path)) == ["TextureDouble_A.png", "out.obj", "out.obj.mtl"]
        assert "mtllib ./out.obj.mtl" in (tmp_path / "out.obj").read_text()
        back = load_mesh(tmp_path / "out.obj")
        assert list(back.current_mesh().textures()) == ["TextureDouble_A.png"]
        assert back.current_mesh().has_wedge_tex_coord()

    def test_an_image_that_exists_is_not_replaced(self, tmp_path, textured_bunny):
        (tmp_path / "TextureDouble_A.png").write_bytes(b"mine")
        save_mesh(textured_bunny, tmp_path / "out.ply")
        assert (tmp_path / "TextureDouble_A.png").read_bytes() == b"mine"

    def test_an_unknown_format(self, tmp_path, result):
        with pytest.raises(BezierFilterError, match=r"unknown format \.foo; use one of \.ply \.obj"):
            save_mesh(result, tmp_path / "out.foo")
        with pytest.raises(BezierFilterError, match="unknown format without a suffix"):
            save_mesh(result, tmp_path / "out")

    def test_a_missing_directory(self, tmp_path, result):
        with pytest.raises(BezierFilterError, match="there is no directory"):
            save_mesh(result, tmp_path / "no" / "out.ply")

    def test_a_directory_in_the_way(self, tmp_path, result):
        (tmp_path / "out.ply").mkdir()
        with pytest.raises(BezierFilterError, match="not a regular file"):
            save_mesh(result, tmp_path / "out.ply")

    def test_nothing_to_save(self, tmp_path):
        (tmp_path / "out.ply").write_bytes(b"old")
        with pytest.raises(BezierFilterError, match="no current mesh"):
            save_mesh(pymeshlab.MeshSet(), tmp_path / "out.ply")
        assert (tmp_path / "out.ply").read_bytes() == b"old"


def test_a_file_that_cannot_be_read_leaves_the_working_directory(tmp_path, monkeypatch):
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "bad.ply").write_text("no header")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(BezierFilterError, match="cannot read"):
        load_mesh("folder/bad.ply")
    assert Path.cwd() == tmp_path


def test_the_locale_stays_as_it_was(tmp_path, result):
    """The writer of 3MF leaves the locale "C" behind."""
    before = locale.setlocale(locale.LC_ALL)
    for suffix in SAVE_SUFFIXES:
        save_mesh(result, tmp_path / f"out{suffix}")
        assert locale.setlocale(locale.LC_ALL) == before


def test_only_ply_holds_quality_and_columns(tmp_path, result):
    for suffix in SAVE_SUFFIXES:
        path = tmp_path / f"out{suffix.upper()}"
        save_mesh(result, path)
        if suffix == FIELD_SUFFIX:
            assert {"quality", "bz_k_min"} < set(read_fields(path))
        elif suffix != ".dxf":  # which pymeshlab cannot read
            back = load_mesh(path)  # a mesh lives only as long as its MeshSet
            assert not back.current_mesh().has_vertex_scalar() or not back.current_mesh().vertex_scalar_array().any()


def test_a_gltf_file_without_a_mesh_is_refused(tmp_path):
    path = tmp_path / "empty.gltf"
    path.write_text(json.dumps({"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": []}]}), encoding="utf-8")
    with pytest.raises(BezierFilterError, match="it has no vertices"):
        load_mesh(path)


class TestRemarks:
    """What a file lacks is said."""

    def test_an_image_inside_a_gltf_file(self, tmp_path):
        """A triangle with a texture of one pixel, all in one file of JSON."""
        pixel = "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mP8z8BQDwAEhQGAhKmMIQAAAABJRU5ErkJggg=="
        data = np.array([0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 1], dtype=np.float32).tobytes()
        data += np.array([0, 1, 2, 0], dtype=np.uint16).tobytes()
        views = [{"buffer": 0, "byteOffset": at, "byteLength": size} for at, size in ((0, 36), (36, 24), (60, 6))]
        accessors = [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]},
            {"bufferView": 1, "componentType": 5126, "count": 3, "type": "VEC2"},
            {"bufferView": 2, "componentType": 5123, "count": 3, "type": "SCALAR"},
        ]
        primitive = {"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2, "material": 0}
        scene = {
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": [primitive]}], "bufferViews": views, "accessors": accessors,
            "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
            "textures": [{"source": 0}], "images": [{"uri": f"data:image/png;base64,{pixel}"}],
            "buffers": [{"byteLength": len(data), "uri": "data:application/octet-stream;base64,"
                         + base64.b64encode(data).decode()}],
        }  # fmt: skip
        path = tmp_path / "textured.gltf"
        path.write_text(json.dumps(scene), encoding="utf-8")
        ms = load_mesh(path)
        (name,) = ms.current_mesh().textures()
        for suffix in (".ply", ".obj"):
            (remark,) = save_mesh(ms, tmp_path / f"out{suffix}")
            assert f"without the images of its textures ({name})" in remark
            assert len(bf.mesh_arrays(tmp_path / f"out{suffix}")[1]) == 1

    @pytest.mark.filterwarnings("ignore::bezier_filters.errors.MeshFileNote")  # faces that rounding has collapsed
    @pytest.mark.parametrize("suffix", [".stl", ".3ds", ".dae", ".x3d", ".wrl", ".3mf"])
    def test_digits_far_from_the_origin(self, suffix, tmp_path):
        near, far = pymeshlab.MeshSet(), pymeshlab.MeshSet()
        near.create_sphere(subdiv=3)
        vertices = near.current_mesh().vertex_matrix()
        far.add_mesh(pymeshlab.Mesh(vertices + 1e6 * np.pi, near.current_mesh().face_matrix()))
        assert save_mesh(near, tmp_path / f"near{suffix}") == ()
        (remark,) = save_mesh(far, tmp_path / f"far{suffix}")
        promised = float(re.search(r"by up to (\S+) here", remark)[1])
        read, _ = bf.mesh_arrays(tmp_path / f"far{suffix}")
        lost = np.abs(read[:, np.newaxis] - (vertices + 1e6 * np.pi)).max(axis=2).min(axis=0).max()
        assert 0.1 * promised < lost <= 1.1 * promised
        assert save_mesh(far, tmp_path / "far.ply") == ()


def normals_of_vertices(mesh, *, by_angle):
    """Unit sums of the unit normals of the faces around each vertex, perhaps by their angles there, (n, 3)."""
    vertices, faces = mesh.vertex_matrix(), mesh.face_matrix()
    sums = np.zeros_like(vertices)
    for k in range(3):
        one, other = (vertices[faces[:, (k + j) % 3]] - vertices[faces[:, k]] for j in (1, 2))
        normals = np.cross(one, other)
        sines = np.linalg.norm(normals, axis=1, keepdims=True)
        angles = np.arctan2(sines, np.einsum("ij,ij->i", one, other)[:, np.newaxis])
        np.add.at(sums, faces[:, k], normals / sines * (angles if by_angle else 1.0))
    return sums / np.linalg.norm(sums, axis=1, keepdims=True)


FILTERS = {
    "curvature": compute_curvature_by_bezier_patch_per_vertex,
    "smooth": bf.apply_coord_bezier_patch_smoothing,
    "fill-holes": bf.meshing_close_holes_by_bezier_patch,
}


@pytest.mark.parametrize("suffix", [".ply", ".obj", ".off"])
@pytest.mark.parametrize("name", FILTERS)
def test_normals_in_files_are_unit_ones_of_the_surface(name, suffix, tmp_path):
    """pymeshlab makes sums of them where a file has none, such as this OBJ, by angles; of other faces all are alike."""
    shape = torus(resolution=32)
    noisy = shape.vertices + np.random.default_rng(0).normal(scale=0.01, size=shape.vertices.shape)
    lines = [f"v {x} {y} {z}" for x, y, z in noisy] + [f"f {i} {j} {k}" for i, j, k in shape.faces[8:] + 1]
    (tmp_path / "a.obj").write_text("\n".join(lines))
    ms = load_mesh(tmp_path / "a.obj")
    assert np.linalg.norm(ms.current_mesh().vertex_normal_matrix(), axis=1).max() > 5.0
    FILTERS[name](ms)
    save_mesh(ms, tmp_path / f"b{suffix}")
    back = pymeshlab.MeshSet()
    back.load_new_mesh(str(tmp_path / f"b{suffix}"))
    mesh = back.current_mesh()
    normals = mesh.vertex_normal_matrix()
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    has_normals = mesh.has_vertex_color() <= (suffix != ".off")  # OFF files have colours or normals
    if has_normals:
        np.testing.assert_allclose(lengths, 1.0, atol=1e-5)
    wanted = normals_of_vertices(mesh, by_angle=name == "curvature" or not has_normals)
    np.testing.assert_allclose(normals / lengths, wanted, atol=1e-4)


def test_zero_normals_stay_zero(tmp_path):
    ms = pymeshlab.MeshSet()
    ms.add_mesh(pymeshlab.Mesh(np.eye(3), v_normals_matrix=np.diag([0.0, 3.0, 0.5])))
    save_mesh(ms, tmp_path / "a.ply")
    back = load_mesh(tmp_path / "a.ply")
    np.testing.assert_array_equal(back.current_mesh().vertex_normal_matrix(), np.diag([0.0, 1.0, 1.0]))
