"""Meshes on disk are read as they are, or refused with a reason."""

import contextlib
import json
import shutil
from pathlib import Path

import numpy as np
import plyfile
import pytest
from scale_cases import clean, save_arrays
from typer.testing import CliRunner

from bezier_filters import InvalidMeshError, read_fields
from bezier_filters.cli import commands
from bezier_filters.cli.commands import app
from bezier_filters.errors import FieldFileError
from bezier_filters.scale import estimate_file
from bezier_filters.scale.source import open_source

TORUS = Path(__file__).parents[2] / "sample_meshes" / "torus.ply"


def ply(
    path, vertices, faces, *, byte_order="<", coordinates="f8", text=False, length="u1", corner="i4", faces_first=False
):
    """A PLY file with more columns than are needed."""
    table = np.zeros(
        len(vertices), [("flags", "u1"), ("y", coordinates), ("x", coordinates), ("z", coordinates), ("nx", "f4")]
    )
    for k, axis in enumerate("xyz"):
        table[axis] = vertices[:, k]
    rows = np.zeros(len(faces), [("quality", "f4"), ("vertex_indices", corner, (np.shape(faces)[1],)), ("label", "i2")])
    rows["vertex_indices"] = faces
    elements = [
        plyfile.PlyElement.describe(table, "vertex"),
        plyfile.PlyElement.describe(rows, "face", len_types={"vertex_indices": length}),
        plyfile.PlyElement.describe(np.zeros(3, [("when", "f8")]), "shot"),
    ]
    order = [1, 0, 2] if faces_first else [2, 0, 1]
    plyfile.PlyData([elements[k] for k in order], text=text, byte_order=byte_order).write(str(path))
    return path


@pytest.mark.parametrize("byte_order", "<>")
@pytest.mark.parametrize(
    "layout",
    [{}, {"coordinates": "f4"}, {"length": "i4", "corner": "u4"}, {"faces_first": True}],
)
def test_binary_ply_files_are_read_in_any_layout(layout, byte_order, tmp_path):
    vertices, faces = clean()
    source = open_source(ply(tmp_path / "a.ply", vertices, faces, byte_order=byte_order, **layout))
    dtype = np.dtype(layout.get("coordinates", "f8"))
    assert (source.vertex_count, source.face_count) == (len(vertices), len(faces))
    assert source.vertices(7, 90).dtype == source.dtype == dtype
    assert np.array_equal(source.vertices(7, 90), vertices[7:90].astype(dtype))
    assert np.array_equal(source.faces(100, len(faces)), faces[100:])


@pytest.mark.parametrize(("real", "integer"), [("f4", "i8"), (">f8", ">u4")])
def test_arrays_are_read_in_any_type(real, integer, tmp_path):
    vertices, faces = clean()
    source = open_source(save_arrays(tmp_path, vertices.astype(real), faces.astype(integer)))
    assert np.array_equal(source.vertices(3, 50), vertices[3:50].astype(real))
    assert np.array_equal(source.faces(3, 50), faces[3:50])


def test_coordinates_in_single_precision_stay_so(tmp_path):
    vertices, faces = clean()
    path = ply(tmp_path / "a.ply", vertices, faces, coordinates="f4")
    estimate_file(path, tmp_path / "out.ply", scheduler="synchronous", tile_vertices=512)
    written = open_source(tmp_path / "out.ply")
    assert written.dtype == np.float32
    assert np.array_equal(written.vertices(0, len(vertices)), vertices.astype(np.float32))
    assert np.array_equal(written.faces(0, len(faces)), faces)


def damaged(kind, path):
    """Write a file that cannot be read in parts."""
    vertices, faces = clean()
    if kind == "ascii":
        return ply(path, vertices, faces, text=True)
    if kind == "quads":
        return ply(path, vertices, np.column_stack([faces, faces[:, 0]]))
    if kind == "no faces":
        return ply(path, vertices, faces[:0])
    data = ply(path, vertices, faces).read_bytes()
    if kind == "cut short":
        data = data[: len(data) - 2000]
    elif kind == "no header":
        data = data[200:]
    elif kind == "endless header":
        data = data.replace(b"end_header", b"end_of_it.")
    elif kind == "huge count":
        data = data.replace(b"element face %d" % len(faces), b"element face 999999999999999999")
    elif kind == "integers":
        data = data.replace(b"double x", b"int32 x")
    elif kind == "list before":
        data = data.replace(b"property uchar flags", b"property list uchar int flags")
    path.write_bytes(data)
    return path


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("ascii", "save it as binary PLY"),
        ("cut short", "cut short"),
        ("no header", "is neither a PLY"),
        ("endless header", "header has no end"),
        ("huge count", "cut short"),
        ("integers", "expected x, y and z"),
        ("list before", "lists of any length"),
    ],
)
def test_files_that_cannot_be_read_in_parts_are_refused(kind, message, tmp_path):
    path = damaged(kind, tmp_path / "a.ply")
    with pytest.raises(FieldFileError, match=message) as error:
        open_source(path)
    assert str(path) in str(error.value)


def bad(vertices, faces):
    """Arrays that are no mesh, with what is said of them."""
    nan, far, index, negative = vertices.copy(), vertices.copy(), faces.copy(), faces.copy()
    nan[70, 1], far[5, 0], index[900, 2], negative[3, 0] = np.nan, 1e60, len(vertices), -1
    yield nan, faces, "vertex 70 has a coordinate that is NaN"
    yield far, faces, "too large to compute with"
    yield vertices, index, f"expected 0 to {len(vertices) - 1}"
    yield vertices, negative, "run from -1"


def test_arrays_that_are_no_mesh_are_refused(tmp_path):
    for vertices, faces, message in bad(*clean()):
        files = save_arrays(tmp_path, vertices, faces)
        with pytest.raises(InvalidMeshError, match=message):
            estimate_file(files, tmp_path / "out.ply", store=tmp_path / message[:6], scheduler="synchronous")
        assert not (tmp_path / "out.ply").exists()


@pytest.mark.parametrize("kind", ["quads", "no faces"])
def test_polygons_and_points_are_refused(kind, tmp_path):
    with pytest.raises((InvalidMeshError, FieldFileError), match=r"corners|no faces|triangles"):
        estimate_file(damaged(kind, tmp_path / "a.ply"), tmp_path / "out.ply", scheduler="synchronous")


@pytest.mark.parametrize(
    ("vertices", "message"),
    [
        (np.zeros((4, 2)), "expected float32"),
        (np.zeros((4, 3), int), "expected float32"),
        (np.asfortranarray(np.zeros((4, 3))), "Fortran"),
        (np.zeros(12), "expected float32"),
    ],
)
def test_other_arrays_are_refused(vertices, message, tmp_path):
    np.save(tmp_path / "v.npy", vertices)
    np.save(tmp_path / "f.npy", np.zeros((1, 3), int))
    with pytest.raises(FieldFileError, match=message):
        open_source((tmp_path / "v.npy", tmp_path / "f.npy"))
    with pytest.raises(FieldFileError, match="no NPY file"):
        open_source((TORUS, tmp_path / "f.npy"))


def test_the_command_line_reports_what_was_done(tmp_path):
    arguments = ["scale", "curvature", str(TORUS), str(tmp_path / "out.ply"), "--scheduler", "threads"]
    result = CliRunner().invoke(app, [*arguments, "--tile-vertices", "256", "--quality", "gaussian", "--json"])
    assert result.exception is None
    report = json.loads(result.stdout)
    assert (report["vertices"], report["tiles"], report["status"]) == (1440, 6, {"OK": 1440})
    fields = read_fields(tmp_path / "out.ply")
    assert np.array_equal(fields["quality"], fields["bz_gaussian_curvature"])
    shown = CliRunner().invoke(app, arguments).stdout
    assert "1,440 vertices" in shown
    assert "tiles of" in shown


def test_the_command_line_takes_arrays(tmp_path):
    vertices, faces = save_arrays(tmp_path, *clean())
    arguments = ["scale", "curvature", vertices, tmp_path / "out.ply", "--faces", faces, "--scheduler", "synchronous"]
    result = CliRunner().invoke(app, [*map(str, arguments), "--column", "k_min", "--memory-limit", "2 GiB"])
    assert result.exception is None
    assert read_fields(tmp_path / "out.ply").keys() == {"quality", "bz_k_min"}


def test_the_command_line_moves_vertices_onto_patches(tmp_path):
    arguments = ["scale", "smooth", str(TORUS), str(tmp_path / "out.ply"), "--scheduler", "synchronous"]
    result = CliRunner().invoke(app, [*arguments, "--method", "paper", "--iterations", "2", "--json"])
    assert result.exception is None
    assert json.loads(result.stdout)["iterations"] == 2
    vertices = open_source(TORUS).vertices(0, 1440)
    moved = open_source(tmp_path / "out.ply").vertices(0, 1440)
    distances = np.linalg.norm(moved - vertices, axis=1)
    assert np.array_equal(read_fields(tmp_path / "out.ply")["quality"], distances)
    assert 0.0 < distances.max() < 0.1


@pytest.mark.parametrize("where", ["threads", pytest.param("cluster", marks=pytest.mark.slow)])
def test_batches_run_on_a_scheduler(where, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copy(TORUS, tmp_path / "good.ply")
    (tmp_path / "bad.ply").write_bytes(b"ply\nno mesh")
    with contextlib.ExitStack() as stack:
        if where == "cluster":
            import distributed

            options = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": ":0"}
            where = stack.enter_context(distributed.LocalCluster(**options)).scheduler_address
        arguments = ["batch", "curvature", "good.ply", "bad.ply", "--out", "out", "--scheduler", where, "--json"]
        result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 1
    files = {file["input"]: file for file in json.loads(result.stdout)["files"]}
    assert files["good.ply"]["result"] == "done"
    assert files["good.ply"]["report"]["status"] == {"OK": 1440}
    assert (tmp_path / "out" / "good.ply").is_file()
    assert files["bad.ply"]["result"] == "failed"
    assert "cannot read" in files["bad.ply"]["error"]


def test_without_dask_one_line_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "dask", None)  # as if it were not there
    monkeypatch.setattr("sys.argv", ["bezier-filters", "scale", "curvature", str(TORUS), str(tmp_path / "out.ply")])
    assert 'pip install "bezier-filters[scale]"' in commands._run()
    assert not list(tmp_path.iterdir())
