"""One mesh through every object of other libraries and every file format, and back; and files that are refused."""

import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pymeshlab
import pytest
from command_line import run

import bezier_filters as bf
from bezier_filters.errors import MeshFileNote
from bezier_filters.field_arrays import join_vectors, result_arrays, shrink, split_vectors
from bezier_filters.fields import CURVATURE, fields_of
from bezier_filters.files.host_formats import READERS, WRITERS
from bezier_filters.surfaces import torus

pytest.importorskip("pyvista")
pytest.importorskip("trimesh")
SAMPLES = Path(__file__).parents[2] / "sample_meshes"
SHAPE = torus(resolution=16)
GEOMETRY = bf.estimate_vertex_geometry(SHAPE, rings=2, alpha=0.9)
FIELDS = result_arrays(GEOMETRY, CURVATURE)
SINGLE = 2.0**-24  # relative rounding of single precision
FIELD_FORMATS = ["vtp", "vtu", "npz", "ply", "csv"]


@pytest.fixture(scope="module")
def curved():
    """A MeshSet with fields, quality, colours and unit normals."""
    ms = pymeshlab.MeshSet()
    ms.add_mesh(pymeshlab.Mesh(SHAPE.vertices, SHAPE.faces))
    bf.compute_curvature_by_bezier_patch_per_vertex(ms, rings=2, alpha=0.9, color=True)
    return ms


def columns_of(ms):
    mesh = ms.current_mesh()
    names = [field.column for field in fields_of(CURVATURE) if field.attribute is not None]
    return {name: mesh.vertex_custom_scalar_attribute_array(name) for name in names}


def check_mesh(ms, *, faces=True, coordinates=0.0):
    mesh = ms.current_mesh()
    np.testing.assert_allclose(mesh.vertex_matrix(), SHAPE.vertices, rtol=0, atol=coordinates)
    np.testing.assert_array_equal(mesh.face_matrix(), SHAPE.faces if faces else np.empty((0, 3)))


@pytest.mark.parametrize("compact", [False, True])
@pytest.mark.parametrize("suffix", FIELD_FORMATS)
def test_files_give_everything_back(curved, tmp_path, suffix, compact):
    path = tmp_path / f"torus.{suffix}"
    remarks = bf.save_mesh(curved, path, compact=compact)
    assert remarks == (("written without its faces, which CSV files do not have",) if suffix == "csv" else ())
    back = bf.load_mesh(path)
    check_mesh(back, faces=suffix != "csv")
    # a text has the fewest digits that give the single back, which differ from it by as much as that from the double
    rounding = (2 * SINGLE if suffix == "csv" else SINGLE) if compact else 0.0
    for name, values in columns_of(curved).items():
        np.testing.assert_allclose(columns_of(back)[name], values, rtol=rounding, atol=0)
    before, after = curved.current_mesh(), back.current_mesh()
    np.testing.assert_allclose(after.vertex_scalar_array(), before.vertex_scalar_array(), rtol=rounding, atol=0)
    np.testing.assert_allclose(after.vertex_normal_matrix(), before.vertex_normal_matrix(), rtol=0, atol=rounding)
    np.testing.assert_array_equal(after.vertex_color_matrix(), before.vertex_color_matrix())
    np.testing.assert_allclose(np.linalg.norm(after.vertex_normal_matrix(), axis=1), 1.0, atol=1e-6)
    saved = bf.load_mesh(path)  # once more, as a command would
    bf.save_mesh(saved, tmp_path / f"again.{suffix}", compact=compact)
    assert (tmp_path / f"again.{suffix}").stat().st_size <= path.stat().st_size * 1.01


@pytest.mark.filterwarnings("default:left out")
def test_one_mesh_goes_through_all_objects_and_files(tmp_path):
    """From each to the next: names, types, values and faces are those of the beginning."""
    import pyvista

    mesh = bf.to_pyvista(SHAPE, FIELDS)
    mesh.save(tmp_path / "a.vtp")
    ms = bf.load_mesh(tmp_path / "a.vtp")
    for step in ("npz", "vtu", "ply", "vtp"):
        check_mesh(ms)
        bf.save_mesh(ms, tmp_path / f"b.{step}")
        ms = bf.load_mesh(tmp_path / f"b.{step}")
    bf.save_mesh(ms, tmp_path / "c.vtu")
    mesh = pyvista.read(tmp_path / "c.vtu")
    fields = {name: mesh.point_data[name] for name in mesh.point_data if name.startswith("bz_")}
    mesh = bf.to_trimesh(mesh, fields)
    fields = dict(mesh.vertex_attributes)
    for convert in OBJECTS.values():
        try:
            mesh, fields = convert(mesh, fields)
        except ImportError as error:  # not installed, or does not load
            warnings.warn(f"left out: {error}", MeshFileNote, stacklevel=1)
    vertices, faces = bf.mesh_arrays(mesh)
    np.testing.assert_array_equal(vertices, SHAPE.vertices)
    np.testing.assert_array_equal(faces, SHAPE.faces)
    assert fields.keys() == FIELDS.keys()
    for name, values in FIELDS.items():
        np.testing.assert_array_equal(fields[name], values)
        assert fields[name].dtype == values.dtype, name


def through_open3d(mesh, fields):
    made = bf.to_open3d(mesh, fields)
    return made, {name: made.vertex[name].numpy() for name in fields}


def through_meshio(mesh, fields):
    import meshio

    vertices, faces = bf.mesh_arrays(mesh)
    made = meshio.Mesh(vertices, [("triangle", faces)], point_data=dict(fields))
    return made, made.point_data


def through_vedo(mesh, fields):
    import vedo

    made = vedo.Mesh(bf.to_pyvista(mesh, fields))
    return made, {name: made.pointdata[name] for name in made.pointdata.keys() if name.startswith("bz_")}  # noqa: SIM118


def through_pymeshlab(mesh, fields):
    ms = pymeshlab.MeshSet()
    ms.add_mesh(pymeshlab.Mesh(*bf.mesh_arrays(mesh)))
    for name, values in split_vectors(fields).items():
        ms.current_mesh().add_vertex_custom_scalar_attribute(values.astype(np.float64), name)
    return ms, join_vectors(columns_of(ms))


OBJECTS = {"Open3D": through_open3d, "meshio": through_meshio, "vedo": through_vedo, "pymeshlab": through_pymeshlab}


def test_programs_read_the_names_and_types(curved, tmp_path):
    """Vectors with three components, codes as integers, unit normals and colours as such."""
    import pyvista
    import trimesh

    for suffix in ("vtp", "vtu", "npz", "csv", "glb"):
        bf.save_mesh(curved, tmp_path / f"torus.{suffix}", compact=True)
    for suffix in ("vtp", "vtu"):
        data = pyvista.read(tmp_path / f"torus.{suffix}").point_data
        assert data["bz_direction_max"].shape == (len(SHAPE.vertices), 3)
        assert (data["bz_fit_grade"].dtype, data["bz_k_min"].dtype) == (np.uint8, np.float32)
        assert (data["RGBA"].dtype, data["RGBA"].shape[1]) == (np.uint8, 4)
        assert (data.active_normals_name, data.active_scalars_name) == ("Normals", "quality")
    arrays = np.load(tmp_path / "torus.npz")
    np.testing.assert_array_equal(arrays["faces"], SHAPE.faces)
    np.testing.assert_allclose(arrays["bz_direction_max"], GEOMETRY.direction_max, atol=SINGLE)
    table = np.genfromtxt(tmp_path / "torus.csv", delimiter=",", names=True)
    np.testing.assert_array_equal(np.stack([table[axis] for axis in "xyz"], axis=1), SHAPE.vertices)
    np.testing.assert_array_equal(table["bz_k_min"].astype(np.float32), GEOMETRY.k_min.astype(np.float32))
    scene = trimesh.load(tmp_path / "torus.glb")
    (mesh,) = scene.geometry.values()
    colors = np.rint(255 * curved.current_mesh().vertex_color_matrix())
    np.testing.assert_array_equal(mesh.visual.vertex_colors, colors)
    back = bf.load_mesh(tmp_path / "torus.glb")
    check_mesh(back, coordinates=2 * SINGLE)
    np.testing.assert_array_equal(np.rint(255 * back.current_mesh().vertex_color_matrix()), colors)


def test_fitted_normals_are_active(tmp_path):
    import pyvista

    ms = pymeshlab.MeshSet()
    ms.add_mesh(pymeshlab.Mesh(SHAPE.vertices, SHAPE.faces))
    bf.compute_normal_by_bezier_patch_per_vertex(ms, rings=2)
    for suffix in ("vtp", "vtu"):
        bf.save_mesh(ms, tmp_path / f"a.{suffix}")
        mesh = pyvista.read(tmp_path / f"a.{suffix}")
        assert mesh.point_data.active_normals_name == "bz_normal"
        back = bf.load_mesh(tmp_path / f"a.{suffix}")
        np.testing.assert_array_equal(back.current_mesh().vertex_normal_matrix(), mesh["bz_normal"])


@pytest.mark.parametrize("suffix", ["vtp", "vtu", "npz", "csv", "ply"])
def test_clouds_have_no_faces(tmp_path, suffix):
    ms = pymeshlab.MeshSet()
    ms.add_mesh(pymeshlab.Mesh(SHAPE.vertices))
    assert bf.save_mesh(ms, tmp_path / f"cloud.{suffix}") == ()
    check_mesh(bf.load_mesh(tmp_path / f"cloud.{suffix}"), faces=False)


def test_compact_files_are_smaller_and_lose_nothing_of_others(tmp_path):
    """Numbers that are none of this package's estimates stay as they are."""
    ms = pymeshlab.MeshSet()
    quality = np.linspace(0.0, 1.0, len(SHAPE.vertices))
    ms.add_mesh(pymeshlab.Mesh(SHAPE.vertices, SHAPE.faces, v_scalar_array=quality))
    bf.compute_curvature_by_bezier_patch_per_vertex(ms, rings=2, quality=None)
    for name, compact in (("small", True), ("large", False)):
        bf.save_mesh(ms, tmp_path / f"{name}.ply", compact=compact)
    np.testing.assert_array_equal(bf.read_fields(tmp_path / "small.ply")["quality"], quality)
    sizes = [(tmp_path / f"{name}.ply").stat().st_size for name in ("small", "large")]
    assert sizes[0] < 0.65 * sizes[1]


def test_types_hold_the_numbers():
    large = np.array([1e200, -1e-200])
    assert shrink("bz_k", large, {}).dtype == np.float64
    np.testing.assert_array_equal(shrink("bz_crease", np.array([-2.0, 1.0]), {}), np.array([-2, 1], np.int8))
    assert shrink("bz_rings_used", np.array([300.0]), {}).dtype == np.uint16
    assert shrink("bz_rings_used", np.array([0.5, np.nan]), {}).dtype == np.float64
    assert shrink("quality", np.array([16777217.0]), {}).dtype == np.float64
    assert shrink("quality", np.array([0.1]), {"bz_k": np.array([0.1])}).dtype == np.float32
    assert shrink("x", np.array([0.5, 2.0]), {}).dtype == np.float32


CSV = {
    "commas": ("x,y,z\n0,0,0\n1,0,0\n0,1,0.5\n", {}),
    "semicolons": ("X;Y;Z;R;G;B\n0;0;0;255;0;0\n1;0;0;0;255;0\n0;1;0.5;0;0;255\n", {}),
    "spaces": ("//X Y Z\n0 0 0\n1 0 0\n0 1 0.5\n", {}),
    "no header": ("0,0,0\n1,0,0\n0,1,0.5\n", {}),
    "marked": ("\ufeffx,y,z,bz_k\n0,0,0,1\n1,0,0,2\n0,1,0.5,3\n", {"bz_k": [1.0, 2.0, 3.0]}),
    "other order": ('"z","y","x"\n0,0,0\n0,0,1\n0.5,1,0\n', {}),
}


@pytest.mark.parametrize(("text", "fields"), CSV.values(), ids=CSV)
def test_points_of_text_are_read(tmp_path, text, fields):
    path = tmp_path / "points.csv"
    path.write_text(text, encoding="utf-8")
    ms = bf.load_mesh(path)
    mesh = ms.current_mesh()
    np.testing.assert_array_equal(mesh.vertex_matrix(), [[0, 0, 0], [1, 0, 0], [0, 1, 0.5]])
    for name, values in fields.items():
        np.testing.assert_array_equal(mesh.vertex_custom_scalar_attribute_array(name), values)
    if "R;G;B" in text:
        np.testing.assert_array_equal(mesh.vertex_color_matrix()[:, :3], np.eye(3))


def test_what_is_not_read_is_named(tmp_path):
    (tmp_path / "points.csv").write_text("x,y,z,height\n0,0,0,7\n", encoding="utf-8")
    with pytest.warns(MeshFileNote, match=r"points.csv: columns that were not read: height"):
        bf.load_mesh(tmp_path / "points.csv")


@pytest.mark.parametrize("point_format", [0, 2])
def test_points_of_laser_scans_are_read(tmp_path, point_format):
    laspy = pytest.importorskip("laspy", reason="laspy is not installed")
    header = laspy.LasHeader(point_format=point_format, version="1.2")
    header.offsets, header.scales = [500_000.0, 4_500_000.0, 0.0], [0.001] * 3
    las = laspy.LasData(header)
    las.xyz = SHAPE.vertices + header.offsets
    las.intensity = np.arange(len(SHAPE.vertices))
    if point_format == 2:
        las.red, las.green, las.blue = (np.full(len(SHAPE.vertices), 257 * k, np.uint16) for k in (200, 100, 0))
    las.write(tmp_path / "scan.las")
    ms = bf.load_mesh(tmp_path / "scan.las")
    np.testing.assert_allclose(ms.current_mesh().vertex_matrix() - header.offsets, SHAPE.vertices, atol=5.1e-4)
    found = ms.current_mesh().vertex_custom_scalar_attribute_array("bz_intensity")
    np.testing.assert_array_equal(found, np.arange(len(SHAPE.vertices)))
    if point_format == 2:
        np.testing.assert_array_equal(np.rint(255 * ms.current_mesh().vertex_color_matrix()[0]), [200, 100, 0, 255])


def test_vertices_without_coordinates_are_skipped_or_refused(tmp_path):
    vertices = SHAPE.vertices.copy()
    vertices[5, 1] = np.nan
    np.savez(tmp_path / "a.npz", vertices=vertices, faces=SHAPE.faces, bz_k_min=GEOMETRY.k_min)
    with pytest.raises(bf.BezierFilterError, match=r"a\.npz: it has vertices without finite coordinates: vertex 5"):
        bf.load_mesh(tmp_path / "a.npz")
    with pytest.warns(MeshFileNote, match=r"a\.npz: 1 vertices without finite coordinates were left out"):
        ms = bf.load_mesh(tmp_path / "a.npz", skip=True)
    found = ms.current_mesh().vertex_custom_scalar_attribute_array("bz_k_min")
    np.testing.assert_array_equal(found, np.delete(GEOMETRY.k_min, 5))


def volume(path):
    import pyvista

    pyvista.Box().delaunay_3d().save(path)


def text(content):
    return lambda path: path.write_bytes(content)


def arrays(**values):
    return lambda path: np.savez(path, **values)


WRONG = {
    "volume.vtu": (volume, "holds no surface"),
    "garbage.vtp": (text(b"<VTKFile type='PolyData'> garbage"), "has no points, or is damaged"),
    "binary.vtu": (text(bytes(range(256)) * 9), "has no points, or is damaged"),
    "words.csv": (text(b"a,b\n1,2\n"), "has the columns a, b, expected x, y and z"),
    "row.csv": (text(b"x,y,z\n1,2,3\n1,2\n"), "has a faulty row"),
    "number.csv": (text(b"x,y,z\n1,2,three\n"), "has a faulty row: .*three"),
    "header.csv": (text(b"x,y,z\n"), "has no vertices"),
    "binary.csv": (text(b"\xff\xfe\x00x"), "is no text"),
    "fields.npz": (arrays(k_min=np.zeros(3)), "has no array 'vertices'"),
    "faces.npz": (arrays(vertices=np.eye(3), faces=[[0, 1, 9]]), ".* that are no triangle mesh"),
    "halves.npz": (arrays(vertices=np.eye(3), faces=[[0.0, 1.0, 1.5]]), ".* that are no triangle mesh"),
    "flat.npz": (arrays(vertices=np.eye(2)), ".* that are no triangle mesh"),
    "text.npz": (text(b"not a zip"), "is neither"),
}


@pytest.mark.parametrize("name", WRONG)
def test_files_without_a_mesh_are_refused(tmp_path, name):
    make, message = WRONG[name]
    make(tmp_path / name)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # NumPy's, of a file without rows
        with pytest.raises(bf.BezierFilterError, match=rf"cannot read .*{name}: it {message}"):
            bf.load_mesh(tmp_path / name)


def test_scans_that_are_none_are_refused(tmp_path):
    pytest.importorskip("laspy", reason="laspy is not installed")
    for content in (b"LASF", b"LASF" + bytes(300), b"no scan"):
        (tmp_path / "a.las").write_bytes(content)
        with pytest.raises(bf.BezierFilterError, match=r"a\.las: it is no readable LAS file"):
            bf.load_mesh(tmp_path / "a.las")


def test_every_cut_file_is_refused_or_read(curved, tmp_path):
    """Never another error than the package's own, wherever a file ends."""
    names = []
    for suffix in ("vtp", "npz", "csv"):
        bf.save_mesh(curved, tmp_path / f"a.{suffix}", compact=True)
        whole = (tmp_path / f"a.{suffix}").read_bytes()
        for size in np.linspace(1, len(whole) - 1, 12).astype(int):
            (tmp_path / f"cut.{suffix}").write_bytes(whole[:size])
            try:
                bf.load_mesh(tmp_path / f"cut.{suffix}")
            except bf.BezierFilterError as error:
                names.append(str(error))
    assert len(names) > 20
    assert all("cut." in name for name in names)


@pytest.mark.skipif(sys.platform == "win32", reason="no limit on the size of files")
def test_a_full_disk_leaves_the_old_files(tmp_path):
    code = (
        "import resource, signal, sys; signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
        "import pymeshlab, pyvista, trimesh, bezier_filters as bf\n"
        "from bezier_filters.surfaces import torus\n"
        "ms = pymeshlab.MeshSet()\n"
        "ms.add_mesh(pymeshlab.Mesh(torus(resolution=40).vertices, torus(resolution=40).faces))\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (8192, 8192))\n"
        "for path in sys.argv[1:]:\n"
        "    try: bf.save_mesh(ms, path, compact=True)\n"
        "    except bf.BezierFilterError as error: print(error)\n"
    )
    paths = [tmp_path / f"a{suffix}" for suffix in (*WRITERS, ".ply")]
    for path in paths:
        path.write_text("old")
    done = subprocess.run([sys.executable, "-c", code, *map(str, paths)], capture_output=True, text=True, check=True)
    assert done.stdout.count("cannot write") == len(paths)
    assert {each.name: each.read_text() for each in tmp_path.iterdir()} == {path.name: "old" for path in paths}


def test_commands_write_and_read_the_formats(tmp_path):
    """Creases as lines, a batch, and a picture."""
    import pyvista

    block = SAMPLES / "block.ply"
    assert run("creases", block, tmp_path / "lines.vtp").returncode == 0
    lines = pyvista.read(tmp_path / "lines.vtp")
    assert lines.n_lines > 0
    assert lines.active_scalars_name == "quality"
    assert run("batch", "curvature", block, "--out", tmp_path, "--suffix", ".vtp").returncode == 0
    assert len(pyvista.read(tmp_path / "block.vtp").point_data["bz_direction_max"].T) == 3
    shown = run("render", tmp_path / "block.vtp", tmp_path / "block.png", "--field", "bz_k_max")
    assert (shown.returncode, (tmp_path / "block.png").exists()) == (0, True)
    done = run("smooth", tmp_path / "block.vtp", tmp_path / "block.stl")
    assert done.returncode == 0, done.stderr


def test_formats_have_readers():
    assert set(WRITERS) - {".glb"} <= set(READERS)  # pymeshlab reads GLB files
