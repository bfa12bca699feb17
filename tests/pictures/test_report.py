"""The page of a report: whole by itself, and what a browser without a display and network makes of it."""

import json
import re
import shutil
import subprocess

import numpy as np
import pymeshlab
import pytest
from command_line import run
from conftest import pymeshlab_sample
from matplotlib.image import imread

from bezier_filters import Panel, estimate_vertex_geometry
from bezier_filters.meshlab.meshset import read_current_mesh
from bezier_filters.pictures.report import reduced, save_report
from bezier_filters.pictures.scene import draw, up_axis, view_axes, view_of
from bezier_filters.surfaces import sphere, torus

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
in_a_browser = pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium on this machine")
WIDTH, HEIGHT, TEXT = 1200, 800, 375  # pixels; of the text, beside which the mesh is


def save(path, vertices, faces):
    ms = pymeshlab.MeshSet()
    ms.add_mesh(pymeshlab.Mesh(vertices, faces))
    ms.save_current_mesh(str(path))


def data_of(page):
    """What was put into a page."""
    text = page.read_text("utf-8").partition('<script type="application/json" id="data">')[2]
    return json.loads(text.partition("</script>")[0])


def drawn(page, folder, shown=""):
    """A page as Chromium shows it, the part with the mesh, and what it had to complain about."""
    options = "--headless --no-sandbox --use-angle=swiftshader --enable-unsafe-swiftshader --hide-scrollbars"
    options += f" --enable-logging=stderr --window-size={WIDTH},{HEIGHT} --virtual-time-budget=5000"
    picture = folder / "page.png"
    command = [CHROMIUM, *options.split(), f"--user-data-dir={folder / 'profile'}", f"--screenshot={picture}"]
    done = subprocess.run(
        [*command, f"file://{page}#{shown}"], capture_output=True, text=True, errors="replace", timeout=120
    )
    return imread(picture)[:, TEXT:, :3], [line for line in done.stderr.splitlines() if "CONSOLE" in line]


def cropped(image):
    """What is not white, and its pixels."""
    mask = (image < 0.97).any(axis=2)
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    part = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    return mask[part], image[part]


def stretched(array, shape):
    """The nearest pixels of an image of another size."""
    rows, columns = (
        np.linspace(0, side - 1, to).round().astype(int) for side, to in zip(array.shape, shape, strict=False)
    )
    return array[rows][:, columns]


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """The report on a torus with a hole."""
    folder = tmp_path_factory.mktemp("report")
    shape = torus(resolution=24)
    faces = shape.faces[np.linalg.norm(shape.vertices[shape.faces].mean(axis=1) - [1.0, 0, 0.4], axis=1) > 0.2]
    save(folder / "scan.ply", shape.vertices, faces)
    result = run("report", folder / "scan.ply", folder / "scan.html")
    assert result.returncode == 0, result.stderr
    assert "open it in a browser" in result.stdout
    return folder / "scan.html"


def test_the_page_needs_nothing_else(page):
    text = page.read_text("utf-8")
    assert "default-src 'none'" in text  # browsers refuse any request
    assert not re.search(r"https?://|(src|href)=", text)


def test_it_holds_values_and_facts(page):
    data = data_of(page)
    assert set(data["meshes"]) == {"scan", "smoothed", "filled"}
    labels = [field["label"] for field in data["fields"]]
    assert {"mean curvature", "principal geodesic torsion", "displacement"} < set(labels)
    assert "standard error of the mean curvature" in labels
    facts = dict(map(tuple, data["facts"]))
    assert facts["boundary loops"].startswith("1, ")
    assert "noise" in facts
    assert [name for name, *_ in data["comparisons"]] == ["smoothed", "filled"]
    assert data["comparisons"][1][2] == "1 of 1 holes filled, orange"
    (status,) = (field for field in data["fields"] if field["label"] == "status code")
    n = json.loads(run("info", page.with_suffix(".ply"), "--json").stdout)["vertices"]
    assert sum(name["count"] for name in status["names"].values()) == n


def test_a_name_cannot_end_the_script(tmp_path):
    name = "</script><b>.ply".replace("/", "\u2044")
    ms = pymeshlab.MeshSet()
    ms.create_sphere(subdiv=2)
    mesh = read_current_mesh(ms)
    save_report(tmp_path / "a.html", "</script><b>", mesh, [("file", name)], ["</script>"])
    assert (tmp_path / "a.html").read_text("utf-8").count("</script>") == 2
    assert data_of(tmp_path / "a.html")["findings"] == ["</script>"]


def test_large_meshes_are_reduced_and_that_is_said(tmp_path):
    vertices, faces = pymeshlab_sample("bunny.obj")
    ms = pymeshlab.MeshSet()
    ms.add_mesh(pymeshlab.Mesh(vertices, faces))
    told = save_report(tmp_path / "a.html", "bunny", read_current_mesh(ms), [], [], most_faces=5000)
    assert told["notes"][0].startswith(f"Drawn with 5,000 of {len(faces):,} faces")
    _, _, rows = reduced(vertices, faces[:0], 5000)
    assert 2500 < len(rows) <= 5000
    points, triangles, rows = reduced(vertices, faces, 5000)
    assert len(triangles) == 5000
    assert np.linalg.norm(points - vertices[rows], axis=1).max() < 0.02 * np.linalg.norm(np.ptp(vertices, axis=0))


def test_what_is_no_page_or_the_input_is_refused(tmp_path):
    ball = sphere(resolution=4)
    save(tmp_path / "a.ply", ball.vertices, ball.faces)
    refused = run("report", tmp_path / "a.ply", tmp_path / "b.ply")
    assert refused.returncode == 2
    assert "ends in .html" in " ".join(refused.stderr.replace("│", "").split())
    assert [path.name for path in tmp_path.iterdir()] == ["a.ply"]


def test_points_have_a_report_too(tmp_path, monkeypatch):
    save(tmp_path / "points.ply", torus(resolution=12).vertices, np.empty((0, 3), int))
    monkeypatch.chdir(tmp_path)
    assert run("report", "points.ply", "-q").returncode == 0
    data = data_of(tmp_path / "points.html")
    assert set(data["meshes"]) == {"scan"}
    assert data["comparisons"] == []


@in_a_browser
def test_the_picture_is_that_of_render(page, tmp_path):
    image, complaints = drawn(page, tmp_path, "field=0")
    assert complaints == []
    ms = pymeshlab.MeshSet()
    ms.load_new_mesh(str(page.with_suffix(".ply")))
    vertices, faces = ms.current_mesh().vertex_matrix(), ms.current_mesh().face_matrix()
    values = estimate_vertex_geometry(vertices, faces).mean_curvature
    panel = Panel(vertices, faces, values, signed=True)
    view = view_of(panel, view_axes("front", up_axis(panel)))
    expected_mask, expected = cropped(draw(panel, [view], scale=250.0, background="#ffffff")[0] / 255.0)
    mask, colors = cropped(image)
    same = stretched(mask, expected_mask.shape)
    assert (same & expected_mask).sum() > 0.97 * (same | expected_mask).sum()
    difference = np.abs(stretched(colors, expected_mask.shape) - expected)[same & expected_mask]
    assert np.median(difference) < 0.03
    assert difference.mean() < 0.06


@in_a_browser
def test_it_turns_and_compares(page, tmp_path):
    front, _ = drawn(page, tmp_path)
    dragging = tmp_path / "dragged.html"
    script = """<script>
      const far = {buttons: 1, movementX: 90, movementY: 40};
      canvas.dispatchEvent(new PointerEvent("pointermove", far));
    </script></html>"""
    dragging.write_text(page.read_text("utf-8").replace("</html>", script), "utf-8")
    images = [drawn(page, tmp_path, shown) for shown in ("turn=40", "compare=filled&split=0.02", "compare=smoothed")]
    images.append(drawn(dragging, tmp_path))
    assert [complaints for _, complaints in images] == [[]] * 4
    (turned, _), (filled, _), (smoothed, _), (dragged, _) = images
    for image in (turned, filled, smoothed, dragged):
        assert (np.abs(image - front).max(axis=2) > 0.1).mean() > 0.02
    orange = (filled[..., 0] > 0.5) & (filled[..., 2] < 0.4) & (filled[..., 1] > 0.25)
    assert orange.sum() > 100
    assert np.ptp(smoothed, axis=2).max() < 0.1  # grey
