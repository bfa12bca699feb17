import io
import struct
import subprocess
import sys
import tracemalloc
import zipfile
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import pymeshlab
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bezier_filters.files.field_files import FieldFileError, read_fields, save_fields
from bezier_filters.fitting.vertex_geometry import FitChoice, VertexGeometry

PLY_TYPES = {
    "b": "char",
    "B": "uchar",
    "h": "short",
    "H": "ushort",
    "i": "int32",
    "I": "uint",
    "f": "float",
    "d": "float64",
}
TRIANGLE_HEADER = (
    "ply\nformat {format} 1.0\nelement vertex {vertices}\nproperty float x\nproperty double bz_k\n"
    "element face {faces}\nproperty list uchar int vertex_indices\nend_header\n"
)


def geometry(n: int, seed: int = 0) -> VertexGeometry:
    rng = np.random.default_rng(seed)
    k = np.sort(rng.normal(size=(2, n)), axis=0)
    codes = rng.integers(0, 5, size=(2, n)).astype(np.int32)
    return VertexGeometry(
        *rng.normal(size=(1, n, 3)),
        *k,
        *rng.normal(size=(2, n, 3)),
        *rng.random((2, n)),
        *rng.normal(size=(1, n, 3)),
        *rng.random((4, n)),
        *codes,
        FitChoice(2, 3, 0.8, None),
    )


def save_sphere(path: Path, *, points: bool = False, **options: Any) -> tuple[np.ndarray, np.ndarray]:
    """Write a sphere with pymeshlab: its quality and its custom attribute bz_k (and the point attribute bz_pd)."""
    meshes = pymeshlab.MeshSet()
    meshes.create_sphere(subdiv=2)
    mesh = meshes.current_mesh()
    n = mesh.vertex_number()
    k = np.random.default_rng(1).normal(size=n) * 10.0 ** np.arange(n).clip(0, 3)
    mesh.add_vertex_custom_scalar_attribute(k, "bz_k")
    meshes.compute_scalar_by_function_per_vertex(q="x/3")
    attributes = {"__ca_vs__bz_k": True}
    if points:
        mesh.add_vertex_custom_point_attribute(np.zeros((n, 3)), "bz_pd")
        attributes = {"__ca_vs__bz_k": "k" in options.pop("only", "k"), "__ca_vp__bz_pd": True}
    options = {"save_vertex_quality": True} | options
    meshes.save_current_mesh(str(path), **options, **attributes)
    return k, mesh.vertex_scalar_array()


# pymeshlab's files


def test_binary_files_of_pymeshlab_come_back_bit_for_bit(tmp_path: Path) -> None:
    k, quality = save_sphere(tmp_path / "sphere.ply")
    found = read_fields(tmp_path / "sphere.ply")
    assert sorted(found) == ["bz_k", "quality"]
    np.testing.assert_array_equal(found["bz_k"], k)
    np.testing.assert_array_equal(found["quality"], quality)
    assert all(values.dtype == np.float64 and values.flags.owndata for values in found.values())


def test_ascii_files_of_pymeshlab_have_six_decimals(tmp_path: Path) -> None:
    k, quality = save_sphere(tmp_path / "sphere.ply", binary=False)
    found = read_fields(tmp_path / "sphere.ply")
    np.testing.assert_allclose(found["bz_k"], k, rtol=0, atol=0.5e-6)
    np.testing.assert_allclose(found["quality"], quality, rtol=0, atol=0.5e-6)


@pytest.mark.parametrize("binary", [True, False])
def test_point_attributes_which_pymeshlab_writes_as_lists_do_not_disturb(tmp_path: Path, binary: bool) -> None:
    k, _ = save_sphere(tmp_path / "sphere.ply", points=True, binary=binary)
    found = read_fields(tmp_path / "sphere.ply")
    assert sorted(found) == ["bz_k", "quality"]
    np.testing.assert_allclose(found["bz_k"], k, rtol=0, atol=0 if binary else 0.5e-6)


def test_a_file_without_fields_says_what_it_has_and_what_to_do(tmp_path: Path) -> None:
    save_sphere(tmp_path / "sphere.ply", points=True, only="", save_vertex_quality=False)
    with pytest.raises(FieldFileError, match=r"vertices have x, y, z.*bz_pd \(a list\).*__ca_vs__bz_k_min"):
        read_fields(tmp_path / "sphere.ply")


def test_two_million_faces_cost_nothing(tmp_path: Path) -> None:
    n, m = 200_000, 2_000_000
    rows = np.zeros(n, [("x", "<f4"), ("bz_k", "<f8")])
    rows["bz_k"] = np.arange(n)
    path = tmp_path / "large.ply"
    header = TRIANGLE_HEADER.format(format="binary_little_endian", vertices=n, faces=m)
    path.write_bytes(header.encode() + rows.tobytes() + (b"\x03" + bytes(12)) * m)
    tracemalloc.start()
    np.testing.assert_array_equal(read_fields(path)["bz_k"], np.arange(n))
    assert tracemalloc.get_traced_memory()[1] < 8 * rows.nbytes
    tracemalloc.stop()


# any PLY file


@dataclass
class Element:
    """Rows of numbers and lists; a type is a struct code, or two for a list: of its length and its entries."""

    name: str
    types: dict[str, str]
    rows: list[dict[str, Any]]

    def header(self) -> str:
        lines = [f"element {self.name} {len(self.rows)}"]
        for name, code in self.types.items():
            lines.append(" ".join(["property", *["list"] * (len(code) - 1), *(PLY_TYPES[c] for c in code), name]))
        return "\n".join(lines) + "\n"

    def data(self, order: str) -> bytes:
        return b"".join(self._row(row, order) for row in self.rows)

    def _row(self, row: dict[str, Any], order: str) -> bytes:
        numbers = []
        for name, code in self.types.items():
            values = [row[name]] if len(code) == 1 else [len(row[name]), *row[name]]
            numbers += list(zip(code[0] + code[-1] * (len(values) - 1), values, strict=True))
        if order == "ascii":
            return " ".join(repr(value) for _, value in numbers).encode() + b"\n"
        return struct.pack(order + "".join(code for code, _ in numbers), *(value for _, value in numbers))


def numbers(code: str) -> st.SearchStrategy[Any]:
    if code in "fd":
        return st.floats(width=32 if code == "f" else 64, allow_nan=False)
    bits = 8 * struct.calcsize(code)
    return st.integers(0, 2**bits - 1) if code.isupper() else st.integers(-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)


@st.composite
def elements(draw: st.DrawFn) -> list[Element]:
    """Vertices with columns of any type, before or after other elements, with and without lists."""
    codes = st.sampled_from(sorted(PLY_TYPES))
    types = {name: draw(codes) for name in draw(st.permutations(["x", "quality", "bz_a", "bz_b"]))}
    lists = draw(st.sampled_from(["none", "triples", "ragged"]))
    if lists != "none":
        types["bz_list"] = "Bd"
    length = {"min_size": 0, "max_size": 5} if lists == "ragged" else {"min_size": 3, "max_size": 3}
    row = {name: numbers(code[-1]) for name, code in types.items()}
    row |= {name: st.lists(row[name], **length) for name, code in types.items() if len(code) > 1}
    corners = st.lists(st.integers(0, 9), min_size=3, max_size=5)
    flags = st.lists(numbers("h"), max_size=2)
    made = [
        Element("vertex", types, draw(st.lists(st.fixed_dictionaries(row), max_size=5))),
        Element(
            "face",
            {"vertex_indices": "Bi", "flags": "Ih"},
            draw(st.lists(st.fixed_dictionaries({"vertex_indices": corners, "flags": flags}), max_size=4)),
        ),
        Element("camera", {"id": "h"}, draw(st.lists(st.fixed_dictionaries({"id": numbers("h")}), max_size=3))),
    ]
    return draw(st.permutations(made))


@settings(max_examples=150, deadline=None)
@given(elements(), st.sampled_from(["ascii", "<", ">"]))
def test_every_layout_of_a_ply_file_is_read(
    tmp_path_factory: pytest.TempPathFactory, parts: list[Element], order: str
) -> None:
    # Not written with plyfile, which puts numbers beside lists in the wrong byte order (1.1.5).
    path = tmp_path_factory.getbasetemp() / "layout.ply"
    name = {"ascii": "ascii", "<": "binary_little_endian", ">": "binary_big_endian"}[order]
    header = f"ply\nformat {name} 1.0\n" + "".join(part.header() for part in parts) + "end_header\n"
    path.write_bytes(header.encode() + b"".join(part.data(order) for part in parts))
    found = read_fields(path)
    assert sorted(found) == ["bz_a", "bz_b", "quality"]
    vertex = next(part for part in parts if part.name == "vertex")
    for column, values in found.items():
        np.testing.assert_array_equal(values, [row[column] for row in vertex.rows])
        assert values.dtype == np.float64


def test_line_ends_comments_and_empty_lines(tmp_path: Path) -> None:
    path = tmp_path / "mesh.ply"
    text = TRIANGLE_HEADER.format(format="ascii", vertices=2, faces=0).replace(
        "element vertex", "comment TextureFile größe.png\n\nobj_info end_header\nelement vertex"
    )
    path.write_bytes((text + "0 1\n0 nan").replace("\n", "\r\n").encode())
    np.testing.assert_array_equal(read_fields(path)["bz_k"], [1.0, np.nan])


# damaged files


@pytest.mark.parametrize("binary", [True, False])
def test_every_shorter_file_is_refused(tmp_path: Path, binary: bool) -> None:
    save_sphere(tmp_path / "sphere.ply", binary=binary)
    whole = (tmp_path / "sphere.ply").read_bytes()
    cut = tmp_path / "cut.ply"
    # In an ASCII file only missing lines can be noticed.
    ends = range(0, len(whole), 211) if binary else [k for k, c in enumerate(whole[:-1]) if c == 10][:-1:17]
    for end in (*ends, len(whole) - 1) if binary else ends:
        cut.write_bytes(whole[:end])
        with pytest.raises(FieldFileError):
            read_fields(cut)


@pytest.mark.parametrize("format_name", ["ascii", "binary_little_endian", "binary_big_endian"])
@pytest.mark.parametrize(("vertices", "faces"), [(10**17, 0), (10**9, 0), (1, 10**12), (10**17, 10**17)])
def test_false_counts_allocate_nothing(tmp_path: Path, format_name: str, vertices: int, faces: int) -> None:
    path = tmp_path / "false.ply"
    path.write_text(TRIANGLE_HEADER.format(format=format_name, vertices=vertices, faces=faces) + "0 1\n" * 9)
    tracemalloc.start()
    with pytest.raises(FieldFileError, match="cut short or damaged: its header announces"):
        read_fields(path)
    assert tracemalloc.get_traced_memory()[1] < 4 * 2**20
    tracemalloc.stop()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("ply\n", "plz\n", "neither a PLY nor an NPZ file: it starts with b'plz"),
        ("end_header\n", "", "header has no end"),
        ("ascii", "utf-8", "line 2 .*not understood: 'format utf-8 1.0'"),
        ("format ascii 1.0\n", "", "names no format"),
        ("vertex 2", "vertex -2", "line 3 .*not understood"),
        ("vertex 2", "vertex " + "9" * 5000, "line 3 .*not understood"),
        ("double bz_k", "quad bz_k", "line 5 .*not understood"),
        ("element vertex", "element point", "no vertices; its elements: point, face"),
        ("float x", "float bz_k", "two of the same name"),
        ("property list uchar int vertex_indices\n", "", "face has no properties"),
        ("0 1\n", "0 one\n", "row 0: property 'bz_k': malformed input"),
        ("0 1\n", "0 1 7\n", "row 0: expected end-of-line"),
        ("0 1\n", "0     \n", "row 0: property 'bz_k': early end-of-line"),
        ("0 1\n", "    \n", "row 0: property 'x': early end-of-line"),
    ],
)
def test_damage_is_named(tmp_path: Path, old: str, new: str, message: str) -> None:
    path = tmp_path / "damaged.ply"
    whole = TRIANGLE_HEADER.format(format="ascii", vertices=2, faces=1) + "0 1\n1 2\n3 0 1 1\n"
    path.write_text(whole)
    assert read_fields(path)["bz_k"].tolist() == [1.0, 2.0]
    path.write_text(whole.replace(old, new, 1))
    with pytest.raises(FieldFileError, match=message):
        read_fields(path)


def test_lists_longer_than_the_file_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "lists.ply"
    header = "ply\nformat binary_little_endian 1.0\nelement vertex 1\n"
    header += "property list uint double bz_pd\nproperty double bz_k\nend_header\n"
    path.write_bytes(header.encode() + struct.pack("<Id", 2**32 - 1, 1.0) + bytes(99))
    with pytest.raises(FieldFileError, match="early end-of-file"):
        read_fields(path)


def test_a_missing_file_is_a_missing_file(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        read_fields(tmp_path / "nothing.ply")


# NPZ


def test_saved_geometry_comes_back_with_every_field(tmp_path: Path) -> None:
    saved = geometry(50)
    path = tmp_path / "sphere.npz"
    save_fields(path, saved)
    found = read_fields(path)
    assert sorted(found) == sorted(
        [field.name for field in fields(saved) if isinstance(getattr(saved, field.name), np.ndarray)]
    )
    for name, values in found.items():
        np.testing.assert_array_equal(values, getattr(saved, name))
        assert values.dtype == np.float64
    with np.load(path, allow_pickle=False) as archive:
        assert archive["status"].dtype == np.int32


def test_the_name_is_taken_as_it_is(tmp_path: Path) -> None:
    save_fields(tmp_path / "fields.dat", geometry(3))
    assert [item.name for item in tmp_path.iterdir()] == ["fields.dat"]
    assert len(read_fields(tmp_path / "fields.dat")["k_min"]) == 3


def test_a_failed_save_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "fields.npz"
    save_fields(path, geometry(3))
    whole = path.read_bytes()

    def fail(stream: io.BytesIO, **_: Any) -> None:
        stream.write(b"PK")
        raise OSError("disk full")

    monkeypatch.setattr(np, "savez_compressed", fail)
    with pytest.raises(OSError, match="disk full"):
        save_fields(path, geometry(4))
    assert path.read_bytes() == whole
    assert [item.name for item in tmp_path.iterdir()] == ["fields.npz"]


def test_damaged_archives_are_refused(tmp_path: Path) -> None:
    save_fields(tmp_path / "whole.npz", geometry(30))
    whole = (tmp_path / "whole.npz").read_bytes()
    path = tmp_path / "damaged.npz"
    for damaged in (whole[:5], whole[:-1], whole[: len(whole) // 2], whole[:200] + bytes(9) + whole[209:]):
        path.write_bytes(damaged)
        with pytest.raises(FieldFileError, match="not a complete NPZ file"):
            read_fields(path)


def test_an_archive_whose_header_is_no_python_is_refused(tmp_path: Path) -> None:
    buffer = io.BytesIO()
    np.save(buffer, np.zeros(3))
    damaged = buffer.getvalue().replace(b"'shape': (3,)", b"'shape': (3 (")
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        archive.writestr("a.npy", damaged)
    with pytest.raises(FieldFileError, match="not a complete NPZ file"):
        read_fields(tmp_path / "a.npz")


class Dangerous:
    executed = False

    def __reduce__(self) -> tuple[Any, ...]:
        return setattr, (Dangerous, "executed", True)


def test_nothing_is_unpickled(tmp_path: Path) -> None:
    np.savez(tmp_path / "pickle.npz", k_min=np.array([Dangerous()], dtype=object))
    with pytest.raises(FieldFileError, match="holds object, not numbers"):
        read_fields(tmp_path / "pickle.npz")
    assert not Dangerous.executed


def test_false_shapes_allocate_nothing(tmp_path: Path) -> None:
    path = tmp_path / "false.npz"
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"shape": (10**10,), "fortran_order": False, "descr": "<f8"})
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("k_min.npy", header.getvalue() + bytes(80))
    tracemalloc.start()
    with pytest.raises(FieldFileError, match=r"k_min.npy claims the shape \(10000000000,\)"):
        read_fields(path)
    assert tracemalloc.get_traced_memory()[1] < 4 * 2**20
    tracemalloc.stop()


def test_the_import_is_light() -> None:
    heavy = "{'pymeshlab', 'plyfile', 'pyvista', 'matplotlib', 'scipy'}"
    imports = "import sys, bezier_filters.files.field_files, bezier_filters.pictures.render"
    code = f"{imports}; print({heavy} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"
