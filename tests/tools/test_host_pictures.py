"""Scripts and pictures of other programs, which `make hosts` takes."""

import re
import runpy
import sys
from pathlib import Path

import numpy as np
import pytest

import bezier_filters as bf
import host_pictures
from bezier_filters.surfaces import torus

Image = pytest.importorskip("PIL.Image", reason="Pillow, which comes with matplotlib, is not installed")
ROOT = Path(__file__).parents[2]
SCRIPTS = ROOT / "tools" / "hosts"


def test_every_script_and_its_picture_are_on_the_page():
    page = (ROOT / "docs" / "adapters.md").read_text(encoding="utf-8")
    names = sorted(host_pictures.HOSTS)
    assert sorted(re.findall(r"]\(images/host_(\w+)\.png\)", page)) == names
    assert sorted(re.findall(r'--8<-- "tools/hosts/(\w+)_picture\.py"', page)) == names
    assert sorted(path.name for path in SCRIPTS.iterdir() if path.suffix == ".py") == [f"{n}_picture.py" for n in names]


@pytest.mark.parametrize("name", host_pictures.HOSTS)
def test_pictures_are_small_and_show_a_signed_field(name):
    """Some of it is blue, and some red."""
    path = ROOT / "docs" / "images" / f"host_{name}.png"
    assert path.stat().st_size <= 60_000
    red, _, blue = np.moveaxis(np.asarray(Image.open(path).convert("RGB"), int), 2, 0)
    assert np.mean(red - blue > 30) > 0.01
    assert np.mean(blue - red > 30) > 0.004


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere it may need a display")
def test_the_script_of_pyvista_draws(tmp_path, monkeypatch):
    pytest.importorskip("pyvista", minversion="0.48", reason="accessors came with pyvista 0.48")
    shape, scan, picture = torus(resolution=24), tmp_path / "scan.ply", tmp_path / "picture.png"
    bf.to_pyvista(shape.vertices, shape.faces).save(scan)
    monkeypatch.setattr(sys, "argv", ["pyvista_picture.py", str(scan), str(picture)])
    runpy.run_path(str(SCRIPTS / "pyvista_picture.py"))
    small = tmp_path / "small.png"
    host_pictures.shrink(picture, small)
    with Image.open(small) as image:
        assert image.width == host_pictures.WIDTH
