"""The Python examples and the commands of the README and of the pages for users run."""

import re
import shlex
import shutil
from pathlib import Path

import pymeshlab
import pytest
from typer.testing import CliRunner

from bezier_filters.cli import app

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / "README.md", ROOT / "docs" / "index.md", *sorted((ROOT / "docs" / "filters").glob("*.md"))]
PYTHON = re.compile(r"```python\n(.*?)```", re.DOTALL)
COMMAND = re.compile(r"^    bezier-filters (.*)$", re.MULTILINE)


def found(pattern):
    """Everything that a pattern finds, each once, with the page's name."""
    every = {text: page.name for page in PAGES for text in pattern.findall(page.read_text(encoding="utf-8"))}
    return [pytest.param(text, id=f"{name}-{k}") for k, (text, name) in enumerate(every.items())]


@pytest.mark.parametrize("code", found(PYTHON))
def test_python_block_runs(code, tmp_path, monkeypatch, capsys):
    shutil.copytree(ROOT / "sample_meshes", tmp_path / "sample_meshes")
    monkeypatch.chdir(tmp_path)
    exec(compile(code, "page", "exec"), {})
    printed = capsys.readouterr().out
    assert "OK" in printed or "noise" in code
    assert printed


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Files of the names that the pages use: a scan with holes, points, and what the commands before made of them."""
    folder = tmp_path_factory.mktemp("documents")
    shutil.copy(ROOT / "sample_meshes" / "punched_patch.ply", folder / "scan.ply")
    for name in ("clean.ply", "closed.ply"):
        shutil.copy(folder / "scan.ply", folder / name)
    ms = pymeshlab.MeshSet()
    ms.load_new_mesh(str(folder / "scan.ply"))
    vertices = ms.current_mesh().vertex_matrix()
    ms.add_mesh(pymeshlab.Mesh(vertices))
    ms.save_current_mesh(str(folder / "points.ply"))
    (folder / "scans").mkdir()
    shutil.copy(folder / "scan.ply", folder / "scans")
    assert CliRunner().invoke(app, ["curvature", str(folder / "scan.ply"), str(folder / "curved.ply")]).exit_code == 0
    return folder


@pytest.mark.parametrize("command", found(COMMAND))
def test_command_runs(command, folder, monkeypatch):
    monkeypatch.chdir(folder)
    result = CliRunner().invoke(app, shlex.split(command, comments=True))
    assert result.exception is None
    assert result.exit_code == 0
