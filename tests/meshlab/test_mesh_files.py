import locale
import os
from pathlib import Path

import numpy as np
import pymeshlab
import pytest
from meshset_state import changed, mesh_state

import bezier_filters as bf
from bezier_filters.files.field_files import read_fields
from bezier_filters.meshlab.mesh_files import SAVE_SUFFIXES, format_support, load_mesh, save_mesh
from bezier_filters.meshlab.meshset import BezierFilterError
from bezier_filters.meshlab.vertex_filters import (
    compute_curvature_by_bezier_patch_per_vertex,
    compute_normal_by_bezier_patch_per_vertex,
)

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

    def test_a_name_with_spaces_and_accents(self, tmp_path, result):
        path = tmp_path / "é ü 1.ply"
        save_mesh(result, path)
        back = load_mesh(path)
        assert back.current_mesh().vertex_number() == 642

    @pytest.mark.parametrize(
        ("name", "content", "reason"),
        [
            ("empty.ply", b"", "the file is empty"),
            ("junk.ply", b"\x00\xff" * 200, "Header not found"),
            ("junk.stl", b"\x00\xff" * 200, "it is cut short or damaged: its header announces 4278255360 triangles"),
            ("junk.obj", b"\x00\xff" * 200, "No vertex found"),
            ("mesh.foo", b"abc", "Unknown format for load: foo"),
            ("mesh", b"abc", "Unknown format for load"),
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
        assert format_support(f"out{suffix}").color
        save_mesh(result, tmp_path / f"out{suffix}")
        back = load_mesh(tmp_path / f"out{suffix}")  # a mesh lives only as long as its MeshSet
        read = back.current_mesh()
        assert read.has_vertex_color()
        means = [mesh.vertex_color_matrix().mean(axis=0) for mesh in (read, result.current_mesh())]
        assert means[0] == pytest.approx(means[1], abs=0.005)

    @pytest.mark.parametrize("suffix", [".ply", ".obj", ".off"])
    def test_normals_come_back(self, tmp_path, suffix):
        assert format_support(f"out{suffix}").normals
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


def test_only_ply_holds_quality_and_columns():
    for suffix in SAVE_SUFFIXES:
        support = format_support(f"x{suffix.upper()}")
        assert support.quality == support.attributes == (suffix == ".ply")
