"""A file whose rows do not all come in is refused, or says so: no vertex is lost or moved without a word."""

import os
import re
import struct
import subprocess
import sys
import warnings

import numpy as np
import pytest
from command_line import in_this_process, run

from bezier_filters import load_mesh, mesh_arrays, read_fields
from bezier_filters.cli.reading import file_remarks
from bezier_filters.errors import MeshFileNote, MeshFileWarning
from bezier_filters.files.mesh_counts import count_mesh
from bezier_filters.meshlab.mesh_files import save_mesh
from bezier_filters.meshlab.meshset import BezierFilterError, Mesh, MeshSet
from bezier_filters.meshlab.save_formats import SAVE_SUFFIXES
from bezier_filters.runtime import worker_processes

ROWS = ["0 0 0", "1 0 0", "0 1 0", "0 0 1", "1 1 1"]
FACES = [(0, 1, 2), (0, 1, 3), (1, 2, 3), (0, 2, 3), (1, 2, 4)]


def obj(rows=ROWS, faces=FACES):
    lines = [f"v {row}" for row in rows] + ["f " + " ".join(str(k + 1) for k in face) for face in faces]
    return "\n".join(lines) + "\n"


def off(rows=ROWS, faces=FACES, counts=None):
    lines = [f"{len(face)} " + " ".join(map(str, face)) for face in faces]
    n, m = counts or (len(rows), len(faces))
    return "\n".join(["OFF", f"{n} {m} 0", *rows, *lines]) + "\n"


def ply(rows=ROWS, faces=FACES, counts=None, extra=""):
    lines = [f"{len(face)} " + " ".join(map(str, face)) for face in faces]
    n, m = counts or (len(rows), len(faces))
    head = ["ply", "format ascii 1.0", f"element vertex {n}", *(f"property float {axis}" for axis in "xyz")]
    head += [*filter(None, [extra]), f"element face {m}", "property list uchar int vertex_indices", "end_header"]
    return "\n".join([*head, *rows, *lines]) + "\n"


def xyz(rows=ROWS):
    return "\n".join(rows) + "\n"


def text_stl(rows=ROWS):
    facets = ["".join(f"vertex {rows[k]}\n" for k in face) for face in FACES]
    return "solid\n" + "".join(f"facet normal 0 0 1\nouter loop\n{f}endloop\nendfacet\n" for f in facets) + "endsolid\n"


def binary_stl(rows):
    points = np.array([[float(x) for x in row.split()] for row in rows])
    body = b"".join(struct.pack("<12fH", 0, 0, 1, *points[list(face)].ravel(), 0) for face in FACES)
    return bytes(80) + struct.pack("<I", len(FACES)) + body


def three_ds(count=5, rows=ROWS):
    def chunk(kind, content):
        return struct.pack("<HI", kind, len(content) + 6) + content

    points = np.array([[float(x) for x in row.split()] for row in rows], "<f4").tobytes()
    faces = b"".join(struct.pack("<4H", *face, 0) for face in FACES)
    mesh = chunk(0x4110, struct.pack("<H", count) + points) + chunk(0x4120, struct.pack("<H", len(FACES)) + faces)
    return chunk(0x4D4D, chunk(0x3D3D, chunk(0x4000, b"a\0" + chunk(0x4100, mesh))))


def changed(row, at=2):
    return [*ROWS[:at], row, *ROWS[at + 1 :]]


def written(folder, name, content):
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


REFUSED = {
    "nan.obj": (obj(changed("nan 1 0")), "vertex 2 (line 3)"),
    "inf.obj": (obj(changed("0 -inf 0")), "vertex 2 (line 3)"),
    "huge.obj": (obj(changed("1e999 1 0")), "vertex 2 (line 3)"),
    "nan.off": (off(changed("nan 1 0")), "vertex 2 (line 5)"),
    "nan.ply": (ply(changed("nan 1 0")), "vertex 2"),
    "single.ply": (ply(changed("1e39 1 0")), "vertex 2"),
    "nan.xyz": (xyz(changed("nan 1 0")), "vertex 2 (line 3)"),
    "nan.asc": (xyz(changed("nan 1 0")), "vertex 2 (line 3)"),
    "nan.stl": (text_stl(changed("nan 1 0", 4)), "without finite coordinates"),
    "nan_binary.stl": (binary_stl(changed("nan 1 0", 4)), "without finite coordinates"),
    "nan.3ds": (three_ds(rows=changed("nan 1 0")), "vertex 2"),
    "over32.obj": (obj(faces=[(0, 1, 2**32 + 2)]), "has no vertex 4294967299, which its face 0 (line 6) names"),
    "over64.obj": (obj(faces=[(0, 1, 10**20 - 2)]), "has no vertex 99999999999999999999"),
    "over31.obj": (obj(faces=[(0, 1, 2**31)]), "has no vertex 2147483649"),
    "over32.off": (off(faces=[(0, 1, 2**32 + 2)]), "has no vertex 4294967298, which its face 0 (line 8) names"),
    "over32.ply": (ply(faces=[(0, 1, 2**32 + 2)]), "row 0: property 'vertex_indices'"),
    "before.obj": (obj(faces=[]) + "f -50 -4 -3\n", "line 6 has 'f -50 -4 -3'"),
    "one_before.obj": (obj() + "f -50 -4 -3\n", "line 11 has 'f -50 -4 -3'"),
    "a_word.obj": (obj(changed("1.0 abc 2.0")), "line 3 has '1.0 abc 2.0', expected three coordinates"),
    "a_comma.obj": (obj(changed("1,5 2,5 3,5")), "line 3 has '1,5 2,5 3,5'"),
    "fortran.obj": (obj(changed("1.0D2 1 0")), "line 3 has '1.0D2 1 0'"),
    "a_word_for_a_corner.obj": (obj() + "f 1 2 x\n", "line 11 has 'f 1 2 x'"),
    "half_a_corner.obj": (obj() + "f 1 2 3.7\n", "line 11 has 'f 1 2 3.7'"),
    "two_corners.obj": (obj(faces=[*FACES[:2], (0, 1), *FACES[2:]]), "line 8 has 'f 1 2', expected three corners"),
    "two_and_four.obj": (obj(faces=[*FACES, (0, 1), (0, 1, 2, 3)]), "line 11 has 'f 1 2', expected three corners"),
    "a_corner.obj": (obj() + "f 1\nf 1 2 4\n", "line 11 has 'f 1', expected three corners"),
    "no_corners.obj": (obj() + "f\nf 1 2 4\n", "line 11 has 'f', expected three corners"),
    "a_comment.obj": (obj() + "f 1 2 4 # 5\n", "line 11 has 'f 1 2 4 # 5'"),
    "old_mac.obj": (obj().replace("\n", "\r"), "carriage returns alone"),
    "a_word.off": (off(changed("abc 1 0")), "line 5 has 'abc 1 0'"),
    "two_numbers.off": (off(changed("1 0")), "line 5 has '1 0'"),
    "less.off": (off(counts=(5, 6)), "announces 5 vertices and 6 faces, but it has lines for 5 and 5"),
    "less.ply": (ply(counts=(6, 5)), "it is cut short or damaged: "),
    "more.ply": (ply(counts=(4, 5)), "expected end-of-line"),
    "a_word.xyz": (xyz(changed("1 abc 2")), "line 3 has '1 abc 2'"),
    "two_numbers.xyz": (xyz(changed("1 2")), "line 3 has '1 2'"),
    "many.pts": ("4000000000\n" + xyz(), "announces 4000000000 points, but holds 5"),
    "less.pts": ("6\n" + xyz(), "announces 6 points, but holds 5"),
    "four.stl": (text_stl().replace("vertex 0 1 0\n", "vertex 0 1 0\nvertex 9 9 9\n", 1), "has 4 vertices, expected 3"),
    "spelt.obj": (obj(changed("1.2.3 1 0")), "line 3 has '1.2.3 1 0'"),
    "signs.obj": (obj(changed("--1 1 0")), "line 3 has '--1 1 0'"),
    "minus_nan.xyz": (xyz(changed("-nan 1 0")), "vertex 2 (line 3)"),
    "a_word.ply": (ply(changed("1 abc 2")), "row 2"),
    "more_rows.3ds": (three_ds(4), "announces 4 vertices, but holds 5"),
    "a_mark.obj": ("\ufeff" + obj(), "begins with a byte order mark"),
    "polygon.ply": (ply(faces=[*FACES, (0, 1, 2, 5)]), "has no vertex 5"),
    "polygon.off": (off(faces=[*FACES, (0, 1, 2, 5)]), "has no vertex 5"),
    "polygon.obj": (obj(faces=[*FACES, (0, 1, 2, 5)]), "has no vertex 6"),
    "colours.off": (off([f"{row} 255 0 0" for row in ROWS]), "vertices of more than three numbers"),
    "vcount.3ds": (three_ds(65535), "a mesh in it announces 65535 vertices, but holds 5"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_file_that_does_not_come_in_whole_is_refused_with_its_row(name, tmp_path):
    content, message = REFUSED[name]
    with pytest.raises(BezierFilterError) as caught:
        load_mesh(written(tmp_path, name, content))
    assert message in str(caught.value)
    assert name in str(caught.value)
    assert "\n" not in str(caught.value)


SOUND = {
    "a.obj": obj(), "a.off": off(), "a.ply": ply(), "a.xyz": xyz(), "a.asc": xyz(), "a.stl": text_stl(),
    "binary.stl": binary_stl(ROWS), "a.3ds": three_ds(), "a.pts": "5\n" + xyz(),
    "continued.obj": obj().replace("f 1 2 3\n", "f 1 2 \\\n3\n"), "crlf.obj": obj().replace("\n", "\r\n"),
    "tabs.obj": obj().replace(" ", "\t"), "notes.obj": "# abc\no nan\ng inf\nusemtl 1,5\n" + obj(),
    "negative.obj": obj(faces=[]) + "f -5 -4 -3\n" * 5, "commented.obj": obj().replace("v 0 1 0", "v 0 1 0 # ,a"),
    "textured.obj": "vt 0 0\n" + obj(faces=FACES[1:]) + "f 1/1 2/1 3/1\n",
    "indented.off": off().replace("\n", "\n  "), "commented.off": "# a\n" + off().replace("0 1 0", "# b\n\n0 1 0"),
    "header.asc": "x y z\n" + xyz(), "header.xyz": "x y z\n" + xyz(),
    "blank.xyz": xyz().replace("\n", "\n\n"), "a_quality.ply":
    ply([f"{row} nan" for row in ROWS], extra="property float quality"), "upper.stl": text_stl().upper(),
    "continued_crlf.obj": obj().replace("f 1 2 3\n", "f 1 2 \\\n3\n").replace("\n", "\r\n"),
    "behind.off": off().replace("1 0 0", "1 0 0 # 7 8"), "integers.ply": ply().replace("float", "int"),
    "short_lists.ply": ply().replace("uchar int", "ushort ushort"),
}  # fmt: skip


@pytest.mark.parametrize("name", SOUND)
def test_sound_files_pass_without_a_word(name, tmp_path):
    vertices, faces = mesh_arrays(written(tmp_path, name, SOUND[name]))
    assert len(vertices) == 5
    assert len(faces) == (0 if name.split(".")[1] in ("xyz", "asc", "pts") else 5)
    if not name.endswith(".stl"):
        np.testing.assert_array_equal(vertices, [[float(x) for x in row.split()] for row in ROWS])


def test_lines_among_the_faces_of_off_files_are_named(tmp_path):
    """They are allowed there, and no surface."""
    path = written(tmp_path, "lines.off", off(faces=[*FACES[:2], (0, 1), (3, 4), *FACES[2:], (0, 1, 4, 3)]))
    with pytest.warns(MeshFileNote, match="2 faces with fewer than three different corners were left out"):
        _, faces = mesh_arrays(path)
    assert len(faces) == len(FACES) + 2


@pytest.mark.parametrize("suffix", SAVE_SUFFIXES)
def test_what_is_written_is_counted_right(suffix, tmp_path):
    ms = MeshSet()
    ms.create_sphere(subdiv=3)
    for binary in (True, False):
        save_mesh(ms, tmp_path / f"ball{suffix}", binary=binary)
        counts = count_mesh(tmp_path / f"ball{suffix}")
        assert counts.vertices in (None, 642)
        assert counts.faces in (None, 1280)
        assert not counts.is_odd
        assert (counts.faces is None) == (suffix not in (".ply", ".obj", ".off", ".stl", ".3ds"))


def test_polygons_are_counted_as_the_triangles_that_they_are_cut_into(tmp_path):
    ms = MeshSet()
    squares = [[0, 1, 2, 3], [4, 5, 6]]
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [5, 0, 0], [6, 0, 0], [6, 1, 0]], dtype=float)
    ms.add_mesh(Mesh(points, face_list_of_indices=squares))
    for name, binary in (("a.ply", True), ("a.ply", False), ("a.obj", True), ("a.off", True)):
        ms.save_current_mesh(str(tmp_path / name), **({"binary": binary} if "ply" in name else {}))
        assert count_mesh(tmp_path / name).faces == 3
        assert len(mesh_arrays(tmp_path / name)[1]) == 3


class TestSkip:
    @pytest.mark.parametrize("name", [name for name in REFUSED if name.startswith(("nan", "inf", "huge", "single"))])
    def test_skipped_vertices_are_counted(self, name, tmp_path):
        path = written(tmp_path, name, REFUSED[name][0])
        with pytest.warns(MeshFileNote, match="1 vertices without finite coordinates were left out"):
            ms = load_mesh(path, skip=True)
        vertices = ms.current_mesh().vertex_matrix()
        assert np.isfinite(vertices).all()
        if "binary" not in name:  # pymeshlab does not weld then
            assert len(vertices) == 4

    @pytest.mark.parametrize("binary", [True, False])
    def test_columns_stay_at_their_vertices(self, binary, tmp_path):
        ms = MeshSet()
        ms.create_sphere(subdiv=3)
        mesh = ms.current_mesh()
        mesh.add_vertex_custom_scalar_attribute(mesh.vertex_matrix()[:, 0], "bz_k_min")
        save_mesh(ms, tmp_path / "a.ply", binary=binary)
        content = (tmp_path / "a.ply").read_bytes()
        head = content.index(b"end_header\n") + len(b"end_header\n")
        if binary:
            at = head + 300 * ((len(content) - head - 1280 * 13) // 642)
            content = content[:at] + struct.pack("<d", np.nan) + content[at + 8 :]
        else:
            lines = content[head:].split(b"\n")
            lines[300] = b" ".join([b"nan", *lines[300].split()[1:]])
            content = content[:head] + b"\n".join(lines)
        (tmp_path / "a.ply").write_bytes(content)
        with pytest.raises(BezierFilterError, match="vertex 300; skip=True"):
            load_mesh(tmp_path / "a.ply")
        with pytest.warns(MeshFileNote):
            back = load_mesh(tmp_path / "a.ply", skip=True)
        read = back.current_mesh()
        assert read.vertex_number() == 641
        column = read.vertex_custom_scalar_attribute_array("bz_k_min")
        np.testing.assert_allclose(column, read.vertex_matrix()[:, 0], atol=1e-6)

    def test_faces_without_area_are_a_note(self, tmp_path):
        path = written(tmp_path, "a.obj", obj(faces=[*FACES, (1, 1, 2)]))
        with pytest.warns(MeshFileNote, match="1 faces with fewer than three different corners"):
            assert len(mesh_arrays(path)[1]) == 5

    def test_text_stl_without_its_end_is_a_warning(self, tmp_path):
        facet = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"
        path = written(tmp_path, "a.stl", "solid a\n" + facet)
        with pytest.warns(MeshFileWarning, match="no endsolid after its last facet: it may have been cut short"):
            mesh_arrays(path)
        mesh_arrays(written(tmp_path, "b.stl", "solid a\n" + facet + "endsolid\n"))  # a warning is an error here

    def test_a_raster_is_no_point_cloud(self, tmp_path):
        raster = "ncols 4\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 1\n1 2 3 4\n5 6 7 8\n"
        with pytest.raises(BezierFilterError, match="it is a grid of heights"):
            mesh_arrays(written(tmp_path, "dem.asc", raster))

    def test_a_face_that_the_reader_drops_is_a_warning(self, tmp_path):
        path = written(tmp_path, "a.obj", obj() + "vt 0 0\nf 1/9 2/1 3/1\n")
        with pytest.warns(MeshFileWarning, match="has 6 triangles, but its reader gives 5"):
            mesh_arrays(path)


class TestCommandLine:
    def call(self, folder, *arguments, **options):
        command = [sys.executable, "-m", "bezier_filters", *arguments]
        return subprocess.run(command, cwd=folder, capture_output=True, encoding="utf-8", timeout=100, **options)

    def ball(self, folder):
        ms = MeshSet()
        ms.create_sphere(subdiv=2)
        ms.save_current_mesh(str(folder / "ball.obj"))
        return (folder / "ball.obj").read_text()

    def test_a_vertex_without_coordinates(self, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        text = re.sub(r"(?m)^v \S+", "v nan", self.ball(tmp_path), count=1)
        (tmp_path / "bad.obj").write_text(text)
        refused = run("curvature", "bad.obj", "out.ply")
        assert refused.returncode == 2
        assert re.search(r"vertex 0 \(line \d+\); --skip leaves them", refused.stderr)
        assert not (tmp_path / "out.ply").exists()
        skipped = run("curvature", "bad.obj", "out.ply", "--skip")
        assert skipped.returncode == 0
        assert "note: bad.obj: 1 vertices without finite coordinates were left out" in skipped.stderr
        assert len(read_fields(tmp_path / "out.ply")["bz_k_min"]) == 161

    def test_lost_faces_need_a_look(self, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(worker_processes, "run_in_processes", in_this_process)
        (tmp_path / "bad.obj").write_text(self.ball(tmp_path) + "vt 0 0\nf 1/9 2/1 3/1\n")
        done = run("info", "bad.obj")
        assert done.returncode == 3
        last = done.stderr.splitlines()[-1]
        assert last == "look at bad.obj: has 321 triangles, but its reader gives 320"
        batch = run("batch", "normals", "bad.obj", "--out", "out")
        assert "bad.obj: has 321 triangles" in batch.stdout

    @pytest.mark.skipif(sys.platform == "win32", reason="pipes with a name")
    def test_materials_in_a_pipe(self, tmp_path):
        os.mkfifo(tmp_path / "pipe")
        (tmp_path / "bad.obj").write_text("mtllib ./pipe\n" + self.ball(tmp_path))
        refused = self.call(tmp_path, "info", "bad.obj")
        assert refused.returncode == 2
        assert "names the material file './pipe', which is not a regular file" in refused.stderr

    @pytest.mark.skipif(sys.platform == "win32", reason="pipes with a name")
    def test_a_pipe_is_no_mesh_file(self, tmp_path):
        os.mkfifo(tmp_path / "pipe.ply")
        assert "it is not a regular file" in self.call(tmp_path, "info", "pipe.ply").stderr


def test_other_warnings_are_shown_as_always():
    with warnings.catch_warnings(record=True) as shown:
        warnings.simplefilter("always")
        with file_remarks() as remarks:
            warnings.warn("old", DeprecationWarning, stacklevel=1)
            warnings.warn("gone", MeshFileWarning, stacklevel=1)
    assert list(remarks.losses) == ["gone"]
    assert [str(warning.message) for warning in shown] == ["old"]
