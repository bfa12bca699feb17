"""The page of a report: whole by itself, and what a browser without a display and network makes of it."""

import json
import re
import shutil
import subprocess
from base64 import b64decode
from dataclasses import replace
from html import unescape
from io import BytesIO

import numpy as np
import pymeshlab
import pytest
from command_line import run
from conftest import pymeshlab_sample
from matplotlib.image import imread

from bezier_filters import Page, Panel, compare, estimate_vertex_geometry, fill_holes, show, smooth
from bezier_filters.errors import InvalidParameterError
from bezier_filters.meshlab.meshset import read_current_mesh
from bezier_filters.pictures.page import page_of, report_page
from bezier_filters.pictures.page_meshes import decimate
from bezier_filters.pictures.scene import draw, orientation, view_of
from bezier_filters.pictures.views import view_axes
from bezier_filters.surfaces import bumpy_star, cylinder, sphere, torus

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
in_a_browser = pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium on this machine")
WIDTH, HEIGHT = 1200, 800  # pixels


def save(path, vertices, faces):
    ms = pymeshlab.MeshSet()
    ms.add_mesh(pymeshlab.Mesh(vertices, faces))
    ms.save_current_mesh(str(path))


def data_of(page):
    """What was put into a page."""
    text = page.read_text("utf-8").partition('<script type="application/json" id="data">')[2]
    return json.loads(text.partition("</script>")[0])


def browse(page, folder, output, shown=""):
    """Let Chromium open a page, with one option for its output: what it prints, and complains about."""
    options = "--headless --no-sandbox --use-angle=swiftshader --enable-unsafe-swiftshader --hide-scrollbars"
    options += f" --enable-logging=stderr --window-size={WIDTH},{HEIGHT} --virtual-time-budget=5000"
    command = [CHROMIUM, *options.split(), f"--user-data-dir={folder / 'profile'}", output, f"file://{page}#{shown}"]
    done = subprocess.run(command, capture_output=True, text=True, errors="replace", timeout=120)
    return done.stdout, [line for line in done.stderr.splitlines() if "CONSOLE" in line]


def drawn(page, folder, shown="", script=""):
    """The picture of the mesh as Chromium draws it, after a script."""
    found = told(page, folder, f"{script}; draw_now(); const found = canvas.toDataURL();", shown)
    return imread(BytesIO(b64decode(found.partition(",")[2])))[..., :3]


def told(page, folder, script, shown=""):
    """What a script on a page leaves in `found`; it may do as if a mouse or fingers were there."""
    mouse = """
      canvas.setPointerCapture = () => {};
      function move(kind, x, y, pointerId = 1) {
        const box = canvas.getBoundingClientRect();
        const place = {clientX: box.left + x * box.width, clientY: box.top + y * box.height};
        canvas.dispatchEvent(new PointerEvent(kind, {buttons: 1, pointerId, ...place}));
      }"""
    leave = (
        """document.title = JSON.stringify(found, (key, value) => ArrayBuffer.isView(value) ? [...value] : value);"""
    )
    path = folder / "told.html"
    html = page.html if isinstance(page, Page) else page.read_text("utf-8")
    path.write_text(html.replace("</html>", f"<script>{mouse}\n{script}\n{leave}</script></html>"), "utf-8")
    text, complaints = browse(path, folder, "--dump-dom", shown)
    assert complaints == []
    return json.loads(unescape(re.search("<title>(.*?)</title>", text, re.DOTALL)[1]))


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
    facts = dict(map(tuple, data["tables"][0]["rows"]))
    assert [table["title"] for table in data["tables"]] == ["The mesh", "Fields", "Holes: 1"]
    assert data["about"][1].startswith("bezier-filters ")
    noise, holes, rest = data["verdict"]
    assert "noise" in noise[0].lower()
    assert holes == ["1 of 1 hole can be filled.", f"bezier-filters fill-holes {page.with_suffix('.ply')} filled.ply"]
    assert rest[0].startswith("In the way: 6 unreferenced vertices")
    assert data["start"] == "filled"
    assert sorted(k for _, members in data["groups"] for k in members) == list(range(len(data["fields"])))
    assert all(field["purpose"].endswith(".") for field in data["fields"])
    assert facts["boundary loops"].startswith("1, ")
    assert "noise" in facts
    assert [name for name, *_ in data["comparisons"]] == ["smoothed", "filled"]
    assert data["comparisons"][1][2] == "1 of 1 holes filled."
    (status,) = (field for field in data["fields"] if field["label"] == "grade of the fit")
    n = json.loads(run("info", page.with_suffix(".ply"), "--json").stdout)["vertices"]
    assert sum(name["count"] for name in status["names"].values()) == n


def test_a_name_cannot_end_the_script(tmp_path):
    name = "</script><b>.ply".replace("/", "\u2044")
    ms = pymeshlab.MeshSet()
    ms.create_sphere(subdiv=2)
    mesh = read_current_mesh(ms)
    report_page("</script><b>", mesh, [("file", name)], ["</script>"]).save(tmp_path / "a.html")
    assert (tmp_path / "a.html").read_text("utf-8").count("</script>") == 2
    assert data_of(tmp_path / "a.html")["findings"] == ["</script>"]


def test_large_meshes_are_reduced_and_that_is_said():
    star, ms = bumpy_star(resolution=16), pymeshlab.MeshSet()
    ms.add_mesh(pymeshlab.Mesh(star.vertices, star.faces))
    made = report_page("star", read_current_mesh(ms), [], [], most_faces=2000)
    assert made.notes[0].startswith(f"Drawn with 2,000 of {len(star.faces):,} faces")
    vertices, faces = pymeshlab_sample("bunny.obj")
    _, _, rows = decimate(vertices, faces[:0], 5000)
    assert 2500 < len(rows) <= 5000
    points, triangles, rows = decimate(vertices, faces, 5000)
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
    assert set(data["meshes"]) == {"scan", "smoothed"}
    assert len(data["comparisons"]) == 1


@in_a_browser
def test_the_picture_is_that_of_render(page, tmp_path):
    image = drawn(page, tmp_path, "field=0")
    ms = pymeshlab.MeshSet()
    ms.load_new_mesh(str(page.with_suffix(".ply")))
    vertices, faces = ms.current_mesh().vertex_matrix(), ms.current_mesh().face_matrix()
    values = estimate_vertex_geometry(vertices, faces).mean_curvature
    panel = Panel(vertices, faces, values, signed=True)
    view = view_of(panel, view_axes("iso", *orientation(panel)))
    expected_mask, expected = cropped(draw(panel, [view], scale=250.0, background="#ffffff")[0] / 255.0)
    mask, colors = cropped(image)
    same = stretched(mask, expected_mask.shape)
    assert (same & expected_mask).sum() > 0.97 * (same | expected_mask).sum()
    difference = np.abs(stretched(colors, expected_mask.shape) - expected)[same & expected_mask]
    assert np.median(difference) < 0.03
    assert difference.mean() < 0.06


@pytest.mark.slow
@in_a_browser
def test_it_turns_and_compares(page, tmp_path):
    front = drawn(page, tmp_path, "field=0")
    drag = "move('pointerdown', 0.5, 0.5); move('pointermove', 0.6, 0.55);"
    turned, filled, smoothed, dragged = (
        drawn(page, tmp_path, shown, script)
        for shown, script in (
            ("field=0&turn=40", ""),
            ("compare=filled&split=0.02", ""),
            ("compare=smoothed", ""),
            ("field=0", drag),
        )
    )
    for image in (turned, filled, smoothed, dragged):
        assert (np.abs(image - front).max(axis=2) > 0.1).mean() > 0.02
    orange = (filled[..., 0] > 0.5) & (filled[..., 2] < 0.4) & (filled[..., 1] > 0.25)
    assert orange.sum() > 50
    grey_or_back = smoothed[..., 0] - smoothed[..., 2]
    assert (np.abs(grey_or_back) > 0.3).mean() < 0.01


@in_a_browser
def test_values_under_the_pointer_and_fingers(page, tmp_path):
    """Values at the centres of faces are means of those of the corners; a pinch zooms about its middle."""
    script = """
      const places = [], m = state.turn, pts = meshes.scan.points, order = meshes.scan.indices, values = sources[0];
      for (let f = 0; f < order.length; f += 3 * 53) {
        const corners = [...order.subarray(f, f + 3)];
        const middle = [0, 1, 2].map(i => corners.reduce((sum, k) => sum + pts[3 * k + i] / 3, 0));
        const found = pick(...projected(middle));
        if (!found || Math.hypot(...found.point.map((x, i) => x - middle[i])) > 2e-3) continue;  // hidden
        const error = corners.reduce((sum, k) => sum + errors[0][k] / 3, 0);
        places.push([found.value, corners.reduce((sum, k) => sum + values[k] / 3, 0), found.error, error]);
      }
      move("pointerdown", 0.5, 0.5); move("pointerup", 0.5, 0.45); const text = $("reading").textContent;
      const was = state.zoom, at = placed(0.5 * canvas.clientWidth, 0.5 * canvas.clientHeight);
      move("pointerdown", 0.4, 0.5, 1); move("pointerdown", 0.6, 0.5, 2);
      move("pointermove", 0.3, 0.5, 1); move("pointermove", 0.7, 0.5, 2);
      const still = placed(0.5 * canvas.clientWidth, 0.5 * canvas.clientHeight);
      const texts = [with_error(1.23456, 0.0123), with_error(-5, 0)];
      const found = {places, text, factor: state.zoom / was, at, still, texts};"""
    found = told(page, tmp_path, script, "field=0")
    read, expected, error, expected_error = np.array(found["places"]).T
    assert len(read) > 10
    np.testing.assert_allclose(read, expected, rtol=0, atol=2e-3 * np.ptp(expected))
    np.testing.assert_allclose(error, expected_error, rtol=0.05)
    assert found["factor"] == pytest.approx(2.0, rel=1e-3)
    np.testing.assert_allclose(found["still"], found["at"], atol=0.01)
    assert found["texts"] == ["1.235 \u00b1 0.012", "\u22125"]


@in_a_browser
def test_it_prints_two_pages(page, tmp_path):
    _, complaints = browse(page, tmp_path, f"--print-to-pdf={tmp_path / 'page.pdf'}")
    assert complaints == []
    assert len(re.findall(rb"/Type\s*/Page\b(?!s)", (tmp_path / "page.pdf").read_bytes())) == 2


@in_a_browser
def test_controls_have_names_and_can_be_focused(page, tmp_path):
    script = """
      const controls = [...document.querySelectorAll("#screen :is(button, input, canvas)")];
      const named = it => it.textContent || it.ariaLabel || it.closest("label")?.textContent;
      const found = {count: controls.length, unnamed: controls.filter(it => !named(it)).map(it => it.id)};
      canvas.focus(); const before = state.turn[0];
      canvas.dispatchEvent(new KeyboardEvent("keydown", {key: "ArrowLeft"}));
      found.focused = document.activeElement === canvas; found.turned = state.turn[0] !== before;"""
    found = told(page, tmp_path, script, "field=0")
    assert found["count"] > 20
    assert set(found["unnamed"]) <= {"curve", "heights"}  # which are hidden, and named when they are drawn
    assert found["focused"]
    assert found["turned"]


def arrays(shape):
    return shape.vertices, shape.faces


UPRIGHT, FLAT = "state.turn = [1, 0, 0, 0, 0, 1, 0, -1, 0];", "state.turn = [1, 0, 0, 0, 1, 0, 0, 0, 1];"
DRAG = """
  $("cut").checked = true; $("cut").onchange({target: $("cut")});
  %s
  const found = {...curves, read: $("read").textContent};"""


@pytest.mark.slow
@in_a_browser
def test_the_profile_of_a_sphere_has_its_curvature_and_its_height(tmp_path):
    ball = arrays(sphere(radius=2.0, resolution=24))
    page = page_of("ball", *ball, estimate_vertex_geometry(*ball))
    mouse = "move('pointerdown', 0.5, 0.5); move('pointermove', 0.6, 0.5); move('pointermove', 0.5, 0.1);"
    found = told(page, tmp_path, DRAG % mouse)
    distances, (heights,), (values, errors) = (np.array(found[key]) for key in ("distances", "heights", "values"))
    assert len(distances) == 401
    assert distances[-1] > 1.0
    np.testing.assert_allclose(values, 0.5, rtol=0.01)
    assert errors.shape == values.shape
    expected = np.sqrt(4.0 - distances**2)  # the line begins where the sphere is nearest
    np.testing.assert_allclose(heights, expected - expected[-1], atol=0.005)


@pytest.mark.slow
@in_a_browser
def test_the_profile_of_a_tube_is_that_of_its_near_side_when_it_is_turned_too(tmp_path):
    page = page_of("tube", *arrays(cylinder(radius=0.5, length=3.0, resolution=96)))
    found = told(
        page, tmp_path, DRAG % "state.turn = [1, 0, 0, 0, 0, 1, 0, -1, 0]; turned(0.8, 0); lined([-1, 0.1], [1, 0.1]);"
    )
    distances, heights = np.array(found["distances"]), np.array(found["heights"][0], float)  # None is NaN
    seen = np.isfinite(heights)
    assert abs(np.ptp(distances[seen]) - 1.0) < 0.02
    middle = 0.5 * (distances[seen].min() + distances[seen].max())
    well = seen & (np.abs(distances - middle) < 0.45)
    expected = np.sqrt(0.25 - (distances[well] - middle) ** 2)
    np.testing.assert_allclose(heights[well] - heights[well].max(), expected - expected.max(), atol=0.003)


@pytest.mark.slow
@in_a_browser
def test_profiles_before_and_after(tmp_path):
    """Of a torus and of one that is a tenth larger, which stands for a smoothed one."""
    ring = arrays(torus(resolution=24))
    result = smooth(*ring, "paper")
    page = page_of("torus", *ring, smoothed=replace(result, vertices=1.1 * ring[0]))
    found = told(
        page,
        tmp_path,
        "compare('smoothed');" + DRAG % "state.turn = [1, 0, 0, 0, 1, 0, 0, 0, 1]; lined([-1, 0], [1, 0]);",
    )
    before, after = (np.array(heights, float) for heights in found["heights"])
    assert found["values"] == []
    np.testing.assert_allclose(np.nanmax(after) - np.nanmax(before), 0.1 * 0.4, atol=0.01)


class TestNotebooks:
    def test_results_are_shown(self):
        ring = arrays(torus(resolution=24))
        page = show(*ring, estimate_vertex_geometry(*ring), smooth(*ring, "paper"), title="a torus")
        assert page.fields[0] == "mean_curvature"
        assert page.meshes == ["scan", "smoothed"]
        assert repr(show(ring[0])) == "Page(scan)"
        frame = page._repr_html_()
        assert frame.startswith("<iframe srcdoc=")
        assert unescape(frame.partition('srcdoc="')[2].partition('" sandbox')[0]) == page.html

    def test_noise_has_a_sign(self):
        ball = sphere(resolution=20)
        noise = 0.01 * np.random.default_rng(0).normal(size=len(ball.vertices))
        noisy = ball.vertices + noise[:, None] * ball.normals
        results = estimate_vertex_geometry(noisy, ball.faces), smooth(noisy, ball.faces)
        text = re.search(r'id="data">(.*?)</script>', show(noisy, ball.faces, *results).html)[1]
        (shown,) = (field for field in json.loads(text)["fields"] if field["name"] == "noise")
        found = np.frombuffer(b64decode(shown["values"]), "<f4")
        assert np.corrcoef(found, noise)[0, 1] > 0.98

    def test_deviations_have_standard_errors(self):
        """A ball against one that is .01 smaller, by itself and with fields of the curvature."""
        ball, smaller = sphere(resolution=10), sphere(radius=0.99, resolution=12)
        found = compare(ball.vertices, ball.faces, smaller.vertices, smaller.faces)
        page = show(ball.vertices, ball.faces, found)
        assert page.fields == ["deviation", "regional_deviation", "deviation_z"]
        text = re.search(r'id="data">(.*?)</script>', page.html)[1]
        shown, regional, _ = json.loads(text)["fields"]
        np.testing.assert_allclose(np.frombuffer(b64decode(shown["values"]), "<f4"), 0.01, atol=1e-5)
        for field, errors in ((shown, found.distance_std), (regional, found.regional_std)):
            np.testing.assert_allclose(np.frombuffer(b64decode(field["errors"]), "<f4"), errors, rtol=1e-6)
        g = estimate_vertex_geometry(ball.vertices, ball.faces, rings=2)
        assert {"deviation", "mean_curvature"} <= set(show(ball.vertices, ball.faces, g, found).fields)
        with pytest.raises(InvalidParameterError, match="a Deviation belongs to another mesh"):
            show(smaller.vertices, smaller.faces, found)

    def test_filled_holes_show_themselves(self):
        vertices, faces = arrays(torus(resolution=24))
        faces = faces[np.linalg.norm(vertices[faces].mean(axis=1) - [1.0, 0, 0.4], axis=1) > 0.4]
        result = fill_holes(vertices, faces)
        assert len(result.holes[0].new_vertices)
        page = result.show()
        assert page.meshes == ["scan", "filled"]
        assert page.html == show(vertices, faces, result).html

    def test_results_of_other_meshes_are_refused(self):
        ring = arrays(torus(resolution=12))
        g = estimate_vertex_geometry(*ring, rings=2)
        with pytest.raises(InvalidParameterError, match="belongs to another mesh"):
            show(ring[0][:-1], None, g)
        for results, name in (((g, g), "VertexGeometry"), ((1,), "int")):
            with pytest.raises(InvalidParameterError, match=f"got {name}, expected at most one each"):
                show(*ring, *results)

    @in_a_browser
    def test_a_cell_shows_the_page(self, tmp_path):
        ring = arrays(torus(resolution=24))
        page = show(*ring, estimate_vertex_geometry(*ring))
        cell = tmp_path / "cell.html"
        # A frame in a sandbox is drawn by another process, for which a browser without a window does not wait.
        frame = re.sub(' sandbox="[^"]*"', "", page._repr_html_())
        cell.write_text(f'<!doctype html><meta charset="utf-8"><body>{frame}', "utf-8")
        picture = tmp_path / "cell.png"
        _, complaints = browse(cell, tmp_path, f"--screenshot={picture}")
        assert complaints == []
        image = imread(picture)
        red = (image[..., 0] > 0.5) & (image[..., 1] < 0.4)
        assert red.mean() > 0.02
