"""Point clouds in the formats of scanners, with GPS-size offsets, intensities and colours."""

import subprocess
import sys

import numpy as np
import pymeshlab
import pytest

import bezier_filters as bf
from bezier_filters.errors import MeshFileNote
from bezier_filters.files.scan_formats import decompress_lzf

OFFSET = np.array([500_000.0, 4_500_000.0, 120.0])
POINTS = OFFSET + np.array([[0.001, 0.002, 0.003], [1.5, -2.25, 3.125], [7.0, 8.0, 9.0]])
INTENSITY, COLORS = np.array([10.0, 200.5, 7.0]), np.array([[255, 0, 0], [0, 255, 0], [1, 2, 3]])


def rows(*columns):
    return "".join(
        " ".join(f"{value:.9g}" if value < 1e4 else f"{value:.3f}" for value in row) + "\n"
        for row in zip(*columns, strict=True)
    )


ALL = (*POINTS.T, INTENSITY, *COLORS.T)
LOCAL = (*(POINTS - OFFSET).T, INTENSITY, *COLORS.T)
POSE = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n" + " ".join(map(str, OFFSET)) + " 1\n"


def pcd(kind, dtype="<f8"):
    table = np.zeros(3, dtype=[("x", dtype), ("y", dtype), ("z", dtype), ("intensity", "<f4"), ("rgb", "<u4")])
    for axis, values in zip("xyz", POINTS.T, strict=True):
        table[axis] = values
    table["intensity"], table["rgb"] = INTENSITY, COLORS @ [65536, 256, 1]
    size = dtype[-1]
    head = "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z intensity rgb\n"
    head += (
        f"SIZE {size} {size} {size} 4 4\nTYPE F F F F U\nCOUNT 1 1 1 1 1\nWIDTH 3\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\n"
    )
    head += f"POINTS 3\nDATA {kind}\n"
    if kind == "ascii":
        return (head + rows(*POINTS.T, INTENSITY, table["rgb"])).replace(".000\n", "\n").encode()
    if kind == "binary":
        return head.encode() + table.tobytes()
    content = b"".join(table[name].tobytes() for name in table.dtype.names)
    packed = b"".join(
        bytes([len(part) - 1]) + part for part in (content[k : k + 32] for k in range(0, len(content), 32))
    )
    return head.encode() + np.array([len(packed), len(content)], "<u4").tobytes() + packed


FILES = {
    "a.pts": ("3\n" + rows(*ALL)).encode(),
    "two.pts": ("2\n" + rows(*(c[:2] for c in ALL)) + "1\n" + rows(*(c[2:] for c in ALL))).encode(),
    "a.ptx": ("3\n1\n" + POSE + rows(*LOCAL)).encode(),
    "a.xyz": rows(*ALL).encode(),
    "names.xyz": b"# X Y Z Intensity R G B\n" + rows(*ALL).encode(),
    "comma.xyz": b"x,y,z,i,r,g,b\n" + rows(*ALL).replace(" ", ",").encode(),
    "a.csv": b"x,y,z,intensity,red,green,blue\n" + rows(*ALL).replace(" ", ",").encode(),
    "ascii.pcd": pcd("ascii"),
    "binary.pcd": pcd("binary"),
    "compressed.pcd": pcd("binary_compressed"),
}


@pytest.mark.parametrize("name", FILES)
def test_points_intensities_and_colours_are_read(tmp_path, name):
    (tmp_path / name).write_bytes(FILES[name])
    check(bf.load_mesh(tmp_path / name))


def check(ms, atol=1e-9):
    mesh = ms.current_mesh()
    np.testing.assert_allclose(mesh.vertex_matrix(), POINTS, rtol=0, atol=atol)
    np.testing.assert_allclose(mesh.vertex_custom_scalar_attribute_array("bz_intensity"), INTENSITY, rtol=1e-6)
    np.testing.assert_array_equal(np.rint(255 * mesh.vertex_color_matrix()[:, :3]), COLORS)
    assert mesh.face_number() == 0


def test_scans_of_e57_files_are_read(tmp_path):
    pye57 = pytest.importorskip("pye57", reason="pye57 is not installed")
    file = pye57.E57(str(tmp_path / "a.e57"), mode="w")
    data = {f"cartesian{axis}": (POINTS - OFFSET)[:, k] for k, axis in enumerate("XYZ")}
    data |= {"intensity": INTENSITY} | {
        f"color{c}": COLORS[:, k].astype(np.uint8) for k, c in enumerate(("Red", "Green", "Blue"))
    }
    file.write_scan_raw(data, translation=OFFSET, rotation=np.array([1.0, 0.0, 0.0, 0.0]))
    file.close()
    check(ms := bf.load_mesh(tmp_path / "a.e57"), atol=1e-6)
    np.testing.assert_allclose(viewpoints(ms), np.tile(OFFSET, (3, 1)))


def viewpoints(ms):
    """The places from which points were seen, (n, 3)."""
    mesh = ms.current_mesh()
    return np.column_stack([mesh.vertex_custom_scalar_attribute_array(f"bz_viewpoint_{axis}") for axis in "xyz"])


def test_places_of_scanners_are_read(tmp_path):
    """In the common frame; two scans of a PTX file have two."""
    here, there = "4 5 6 1", "-1 0 2 1"
    scans = [("3\n1\n" + POSE.replace(" ".join(map(str, OFFSET)) + " 1", at) + rows(*LOCAL)) for at in (here, there)]
    (tmp_path / "two.ptx").write_text("".join(scans), encoding="ascii")
    seen = bf.load_mesh(tmp_path / "two.ptx")
    np.testing.assert_array_equal(viewpoints(seen), np.repeat([[4.0, 5.0, 6.0], [-1.0, 0.0, 2.0]], 3, axis=0))
    (tmp_path / "a.pcd").write_bytes(pcd("binary").replace(b"VIEWPOINT 0 0 0", b"VIEWPOINT 1.5 -2 3"))
    np.testing.assert_array_equal(viewpoints(bf.load_mesh(tmp_path / "a.pcd")), np.tile([1.5, -2.0, 3.0], (3, 1)))
    bf.save_mesh(seen, tmp_path / "again.ply")
    np.testing.assert_array_equal(viewpoints(bf.load_mesh(tmp_path / "again.ply")), viewpoints(seen))


@pytest.mark.parametrize("line", [b"VIEWPOINT 0 0 0 1 0 0 0", b"VIEWPOINT x 0 1 1 0 0 0", b"VIEWPOINT nan 0 1 1 0 0 0"])
def test_a_pcd_file_that_says_nothing_has_no_places(tmp_path, line):
    (tmp_path / "a.pcd").write_bytes(pcd("binary").replace(b"VIEWPOINT 0 0 0 1 0 0 0", line))
    check(ms := bf.load_mesh(tmp_path / "a.pcd"))
    with pytest.raises(pymeshlab.PyMeshLabException):
        viewpoints(ms)


def test_six_columns_are_normals_or_colours(tmp_path):
    (tmp_path / "n.xyz").write_text("0 0 0 0 0 1\n1 0 0 0 0 -1\n", encoding="ascii")
    (tmp_path / "c.xyz").write_text("0 0 0 9 8 7\n1 0 0 0 0 1\n", encoding="ascii")
    normals, colors = bf.load_mesh(tmp_path / "n.xyz"), bf.load_mesh(tmp_path / "c.xyz")
    np.testing.assert_array_equal(normals.current_mesh().vertex_normal_matrix()[:, 2], [1, -1])
    colors = colors.current_mesh().vertex_color_matrix()
    np.testing.assert_array_equal(np.rint(255 * colors[:, :3]), [[9, 8, 7], [0, 0, 1]])


def test_points_that_were_not_measured_are_left_out(tmp_path):
    (tmp_path / "a.ptx").write_text("2\n2\n" + POSE + rows(*LOCAL) + "0 0 0 .5 0 0 0\n", encoding="ascii")
    (tmp_path / "a.pcd").write_bytes(pcd("binary").replace(POINTS[1:2, 0].tobytes(), np.array([np.nan]).tobytes()))
    with pytest.warns(MeshFileNote, match="1 points that were not measured were left out"):
        check(bf.load_mesh(tmp_path / "a.ptx"))
    with pytest.warns(MeshFileNote, match="1 points that were not measured"):
        ms = bf.load_mesh(tmp_path / "a.pcd")
    assert ms.current_mesh().vertex_number() == 2


def test_repeated_bytes_are_copied_one_by_one():
    """A reference may overlap what it writes: one byte repeated, as compressors do it."""
    assert decompress_lzf(b"\x00a" + bytes([0xE0, 20, 0]), 30) == b"a" * 30
    with pytest.raises(ValueError, match="expected 31"):
        decompress_lzf(b"\x00a" + bytes([0xE0, 20, 0]), 31)


WRONG = {
    "head.pcd": (b"VERSION 0.7\nFIELDS x y z\n", "no complete header"),
    "short.pcd": (pcd("binary")[:-9], "damaged PCD file"),
    "packed.pcd": (pcd("binary_compressed")[:-9], "damaged PCD file"),
    "words.pcd": (pcd("ascii").replace(b"10 ", b"ten "), "damaged PCD file"),
    "lengths.xyz": (b"1 2 3\n1 2\n", "line 2 has '1 2'"),
    "wide.xyz": (b"1 2 3 4 5\n", "rows of 5 numbers"),
    "cut.ptx": (b"3\n1\n" + POSE.encode() + b"1 2 3 4\n", "scan of 1 points, expected 3"),
    "pose.ptx": (b"3\n1\n1 2 3\n", "faulty header"),
    "binary.pts": (b"\xff\xfe\x00x", "is no text"),
}


@pytest.mark.parametrize("name", WRONG)
def test_damaged_files_are_refused(tmp_path, name):
    content, message = WRONG[name]
    (tmp_path / name).write_bytes(content)
    with pytest.raises(bf.BezierFilterError, match=rf"{name}: it .*{message}"):
        bf.load_mesh(tmp_path / name)


def test_offsets_survive_smoothing(tmp_path):
    """The command removes noise of centimetres at coordinates of millions, and keeps intensities."""
    random = np.random.default_rng(0)
    flat = random.uniform(0.0, 20.0, (900, 2))
    cloud = OFFSET + np.column_stack([flat, 0.1 * random.normal(size=900)])
    np.savetxt(tmp_path / "in.xyz", np.column_stack([cloud, np.arange(900)]), fmt="%.6f")
    command = [sys.executable, "-m", "bezier_filters", "smooth", tmp_path / "in.xyz", tmp_path / "out.ply", "--quiet"]
    subprocess.run(command, check=True)
    ms = bf.load_mesh(tmp_path / "out.ply")
    mesh = ms.current_mesh()
    np.testing.assert_allclose(mesh.vertex_matrix()[:, :2], cloud[:, :2], atol=0.02)
    assert np.sqrt(np.square(mesh.vertex_matrix()[:, 2] - OFFSET[2]).mean()) < 0.04
    np.testing.assert_array_equal(mesh.vertex_custom_scalar_attribute_array("bz_intensity"), np.arange(900))
