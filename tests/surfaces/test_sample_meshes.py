"""The sample meshes are what the generator makes, and PyMeshLab reads them."""

import importlib.util
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pymeshlab
import pytest
from plyfile import PlyData

from bezier_filters import surfaces

FOLDER = Path(__file__).parents[2] / "sample_meshes"
RIMS = {
    "sphere.ply": 0,
    "ellipsoid.ply": 0,
    "bumpy_star.ply": 0,
    "torus.ply": 0,
    "block.ply": 0,
    "fan.ply": 1,
    "monkey_saddle.ply": 1,
    "waves.ply": 1,
    "punched_patch.ply": 4,
}


@pytest.fixture
def generator(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> ModuleType:
    """The script as a module that writes to an empty folder."""
    spec = importlib.util.spec_from_file_location("generate_sample_meshes", FOLDER / "generate.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.setattr(module, "FOLDER", tmp_path)
    return module


def test_files_are_up_to_date(tmp_path: Path) -> None:
    command = [sys.executable, str(FOLDER / "generate.py"), "--check"]
    result = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr


def test_check_finds_missing_and_changed_files(
    generator: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert generator.main(["--check"]) == 1
    assert generator.main([]) == 0
    assert generator.main(["--check"]) == 0
    mesh = PlyData.read(tmp_path / "torus.ply", mmap=False)
    mesh["vertex"]["z"][7] += 1e-9
    mesh.write(tmp_path / "torus.ply")
    (tmp_path / "waves.ply").write_text("no mesh")
    capsys.readouterr()
    assert generator.main(["--check"]) == 1
    assert "torus.ply, waves.ply" in capsys.readouterr().err


@pytest.mark.usefixtures("spheres_afresh")
def test_generator_is_deterministic(generator: ModuleType, tmp_path: Path) -> None:
    generator.main([])
    first = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    generator.main([])
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == first
    assert set(first) == set(RIMS)


def test_files_are_small() -> None:
    assert sum(path.stat().st_size for path in FOLDER.glob("*.ply")) < 2_000_000


@pytest.mark.parametrize("name", RIMS)
def test_pymeshlab_reads_a_manifold_mesh(name: str) -> None:
    scratch = pymeshlab.MeshSet(verbose=False)
    scratch.load_new_mesh(str(FOLDER / name))
    measures = scratch.get_topological_measures()
    assert measures["is_mesh_two_manifold"]
    assert measures["number_holes"] == RIMS[name]
    assert measures["connected_components_number"] == 1
    assert measures["unreferenced_vertices"] == 0
    assert measures["genus"] == (name == "torus.ply")
    mesh = scratch.current_mesh()
    assert 1000 <= mesh.vertex_number() <= 3000

    stored = PlyData.read(FOLDER / name)
    positions = np.stack([stored["vertex"][axis] for axis in "xyz"], axis=1)
    normals = np.stack([stored["vertex"][f"n{axis}"] for axis in "xyz"], axis=1)
    np.testing.assert_array_equal(mesh.vertex_matrix(), positions)
    np.testing.assert_array_equal(mesh.vertex_normal_matrix(), normals)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-14)
    assert (np.einsum("mi,mki->mk", mesh.face_normal_matrix(), normals[mesh.face_matrix()]) > 0).all()


def test_truth_is_in_the_file() -> None:
    vertex = PlyData.read(FOLDER / "torus.ply")["vertex"]
    distance = np.hypot(vertex["x"], vertex["y"])
    k_min, k_max = (distance - 1) / 0.4 / distance, 1 / 0.4
    np.testing.assert_allclose(vertex["true_mean_curvature"], 0.5 * (k_min + k_max), atol=1e-12)
    np.testing.assert_allclose(vertex["true_gaussian_curvature"], k_min * k_max, atol=1e-12)


def test_block_has_no_curvature() -> None:
    names = [p.name for p in PlyData.read(FOLDER / "block.ply")["vertex"].properties]
    assert names == ["x", "y", "z", "nx", "ny", "nz"]
    assert len(PlyData.read(FOLDER / "block.ply")["face"].data) == len(surfaces.block_with_sharp_edges()[1])


def test_readme_lists_every_file_with_its_size() -> None:
    rows = re.findall(
        r"^\| `(\w+\.ply)` .*\| (\d+) \| (\d+) \| (\d) \|$", (FOLDER / "README.md").read_text("utf-8"), re.M
    )
    listed = {name: (int(vertices), int(faces), int(rims)) for name, vertices, faces, rims in rows}
    actual = {}
    for path in FOLDER.glob("*.ply"):
        mesh = PlyData.read(path)
        actual[path.name] = (mesh["vertex"].count, mesh["face"].count, RIMS[path.name])
    assert listed == actual
