"""Figures in the documents name the command and the commit that they come from, and tables that are kept stay true.

Of every kept table a row that is cheap to compute is computed again. Seeds are fixed, so only rounding, and what is
learned from it, may differ: 1 % for fits of given settings, 5 % where the data choose.
"""

import csv
import re
import shutil
import subprocess
import sys
from decimal import Decimal
from pathlib import Path

import numpy as np
import pytest

import accuracy
import denoising
import lines
import noise
import red_blood_cell
import reduction
import smoothing
import strongest_peer
import sub_holes
import uneven_shape
from bezier_filters import estimate_vertex_geometry, fill_holes, smooth, surfaces
from bezier_filters.meshlab.meshset import bunny_path
from cut_holes import compact, cut

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
RESULTS = ROOT / "benchmarks" / "results"
DENOISING = ROOT.parent / "shared" / "cases" / "denoising"
GIVEN, LEARNED = 0.01, 0.05
COMMIT = re.compile(r"\b(?=[0-9a-f]*[0-9])[0-9a-f]{7}\b")
MEASURED = re.compile(r"`python (?:benchmarks|docs)/\w+\.py[^`]*`")
PAGES = [*sorted((ROOT / "docs").glob("*.md")), *sorted((ROOT / "docs" / "decisions").rglob("*.md"))]


def kept(name, **where):
    """The row of a kept table that has some values, as numbers where it can be."""
    with (RESULTS / name).open(newline="", encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if all(row[key] == str(value) for key, value in where.items())]
    (row,) = rows
    return row


def assert_kept(row, found, tolerance):
    """Numbers are those that are kept, up to a share of them."""
    for name, value in found.items():
        assert value == pytest.approx(float(row[name]), rel=tolerance), name


# --- commands and commits -------------------------------------------------------------------------


def sections_with_figures():
    """Sections of the pages that say a benchmark was run."""
    for page in PAGES:
        for number, section in enumerate(re.split(r"\n(?=##? )", page.read_text(encoding="utf-8"))):
            if MEASURED.search(section):
                yield pytest.param(section, id=f"{page.stem}-{number}")


def git(*arguments):
    return subprocess.run(["git", *arguments], cwd=ROOT, check=False, capture_output=True, text=True)


def commits_are_missing():
    """Why this tree cannot tell which commits there are, or an empty text."""
    if not shutil.which("git"):
        return "git is not installed"
    found = git("rev-parse", "--show-toplevel", "--is-shallow-repository")
    if found.returncode != 0 or not ROOT.samefile(found.stdout.splitlines()[0]):
        return "the tree is no clone of its repository"
    return "the clone is shallow: git fetch --unshallow" if found.stdout.splitlines()[1] == "true" else ""


@pytest.mark.parametrize("section", list(sections_with_figures()))
def test_figures_name_a_commit(section):
    assert COMMIT.findall(section), "a benchmark is named, but not the commit at which it ran"


@pytest.mark.parametrize("section", list(sections_with_figures()))
def test_named_commits_exist(section):
    if reason := commits_are_missing():
        pytest.skip(reason)
    for commit in COMMIT.findall(section):
        assert git("cat-file", "-e", f"{commit}^{{commit}}").returncode == 0, f"there is no commit {commit}"


@pytest.mark.slow
@pytest.mark.skipif(bool(commits_are_missing()), reason=commits_are_missing() or "a whole clone")
def test_in_a_shallow_clone_commits_are_not_looked_for(tmp_path):
    """The tests above pass in a clone of depth 1, as forges make it; here, those of one page."""
    clone = tmp_path / "clone"
    assert git("clone", "--quiet", "--depth", "1", ROOT.as_uri(), clone).returncode == 0
    names = Path(__file__).relative_to(ROOT)
    shutil.copy(__file__, clone / names)
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-q", "-rs", names, "-k", "commit and accuracy"],
        cwd=clone,
        check=False,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout
    assert "the clone is shallow" in done.stdout


def test_the_workflow_fetches_all_commits_where_tests_run():
    jobs = re.split(r"\n  (?=\w+:\n)", (ROOT / ".github" / "workflows" / "check.yml").read_text(encoding="utf-8"))
    (tests,) = [job for job in jobs if job.startswith("test:")]
    assert re.search(r"uses: actions/checkout@v4\n +with: \{fetch-depth: 0\}", tests)


def rows_of_page(page, columns):
    """Cells of the tables of a page that have so many columns, without marks."""
    lines = [line for line in (ROOT / "docs" / page).read_text(encoding="utf-8").splitlines() if line.startswith("|")]
    cells = [[re.sub(r"[* x]+$|^[* ]+", "", cell) for cell in line.strip("|").split("|")] for line in lines]
    return [row for row in cells if len(row) == columns]


def assert_printed(text, value):
    """A number is the rounded one that is printed."""
    assert abs(float(text) - value) < 0.51 * 10.0 ** Decimal(text).as_tuple().exponent, (text, value)


def test_the_page_of_accuracy_has_the_kept_figures():
    noise, compared = None, 0
    for level, method, *figures in rows_of_page("accuracy.md", 5):
        noise = {"0": 0.0, "0.01": 0.01, "0.1": 0.1}.get(level, noise)
        name = method.removesuffix(" (default)")
        if name not in ("automatic", "2 rings, alpha 0.8", "paper", "Razdan-Bae"):
            continue
        with (RESULTS / "accuracy.csv").open(newline="", encoding="utf-8") as file:
            rows = [row for row in csv.DictReader(file) if float(row["noise"]) == noise and row["method"] == name]
        for text, column in zip(figures, ("normal_degrees", "mean_curvature", "gaussian_curvature"), strict=True):
            assert_printed(text, np.exp(np.mean(np.log([float(row[column]) for row in rows]))))
            compared += 1
    assert compared == 36


def test_the_page_of_accuracy_has_the_kept_deviations():
    noise, quantity, compared = None, None, 0
    columns = {"normal": "normal_degrees", "H": "mean_curvature", "K": "gaussian_curvature"}
    for first, method, *figures in rows_of_page("accuracy.md", 7):
        noise = {"clean": 0.0, "noise 0.05": 0.05}.get(first, noise)
        quantity = columns.get(first, quantity)
        if noise is None or method not in ("automatic (default)", "automatic on 2 rings", "paper"):
            continue
        for text, deleted in zip(figures, (10, 30, 50, 70, 90), strict=True):
            name = method.removesuffix(" (default)")
            assert_printed(
                text, float(kept("reduction.csv", noise=noise, deleted_percent=deleted, method=name)[quantity])
            )
            compared += 1
    assert compared == 90


def test_the_page_of_accuracy_has_the_kept_figures_of_the_strongest_peer():
    with (RESULTS / "strongest_peer.csv").open(newline="", encoding="utf-8") as file:
        kept_rows = list(csv.DictReader(file))
    rows = [row for row in rows_of_page("accuracy.md", 13) if row[0] in strongest_peer.SURFACES]
    assert len(kept_rows) == 2 * len(rows) == 2 * 12 * len(strongest_peer.LEVELS)
    for (surface, vertices, level, *figures), row_h, row_k in zip(rows, kept_rows[::2], kept_rows[1::2], strict=True):
        for row, texts in ((row_h, figures[:5]), (row_k, figures[5:])):
            assert (row["surface"], row["vertices"], row["noise"]) == (surface, vertices.replace(",", ""), level)
            for text, value in zip(texts, list(row.values())[4:], strict=True):
                assert_printed(text, float(value))


@pytest.mark.parametrize(("level", "quantity"), [(level, q) for level in strongest_peer.LEVELS for q in ("H", "K")])
def test_the_page_of_accuracy_has_the_kept_summary_of_the_strongest_peer(level, quantity):
    with (RESULTS / "strongest_peer.csv").open(newline="", encoding="utf-8") as file:
        rows = [{key: number_of(text) for key, text in row.items()} for row in csv.DictReader(file)]
    assert strongest_peer.summary(rows, level, quantity) in (ROOT / "docs" / "accuracy.md").read_text(encoding="utf-8")


def number_of(text):
    """A number, or the text if it is none."""
    try:
        return float(text)
    except ValueError:
        return text


def test_the_page_of_holes_has_the_kept_figures():
    fillers = ["ours", "ours, paper", "MeshLab", "CGAL, continuity 1", "CGAL, continuity 2", "MeshLib", "pymeshfix"]
    with (RESULTS / "holes.csv").open(newline="", encoding="utf-8") as file:
        cases = {row["case"].replace("_", " "): row["case"] for row in csv.DictReader(file)}
    rows = [row for row in rows_of_page("holes.md", 8) if row[0] in cases]
    assert len(rows) == len(cases)
    for case, *figures in rows:
        for text, filler in zip(figures, fillers, strict=True):
            assert_printed(text, float(kept("holes.csv", case=cases[case], filler=filler)["rms"]))


def test_the_readme_compares_with_the_figures_of_the_pages():
    """Mean curvature at noise 0.1, angles after smoothing, ratio of fills, and speed."""
    readme = " ".join((ROOT / "README.md").read_text(encoding="utf-8").split())
    at_noise = {}
    for level, method, _, curvature, _ in rows_of_page("accuracy.md", 5):
        at_noise.setdefault(method.removesuffix(" (default)"), []).append(curvature)
        assert level in ("noise", "0", "0.01", "0.1", "", "---")
    ours, libigl = at_noise["automatic"][-1], at_noise["libigl quadric, radius 2 / 5"][-1].split(" / ")[-1]
    assert f"([{ours} and {libigl}](docs/accuracy.md))" in readme
    angles = {row[0]: [row[k].split(" / ")[0] for k in (2, 4)] for row in rows_of_page("smoothing.md", 13)}
    (block, taubin_block), (bunny, taubin_bunny) = angles["block 0.2"], angles["bunny 0.2"]
    found = re.search(r"by ([\d.]+) degrees on a block and ([\d.]+) on a bunny.*?\[([\d.]+) and ([\d.]+)\]", readme)
    for text, value in zip(found.groups(), (block, bunny, taubin_block, taubin_bunny), strict=True):
        assert_printed(text, float(value))
    (ratio,) = [row[3] for row in rows_of_page("holes.md", 7) if row[0] == "CGAL, continuity 2"]
    assert_printed(re.search(r"\[([\d.]+) times\]\(docs/holes.md", readme)[1], float(ratio))
    (times,) = [row[5] for row in rows_of_page("performance.md", 8) if row[0] == "automatic, 2 threads"]
    assert 9.0 < float(times) < 11.0
    assert "[a tenth](docs/performance.md)" in readme


# --- rows of kept tables --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("method", "level", "tolerance"), [("paper", 0.0, GIVEN), ("paper", 0.1, GIVEN), ("automatic", 0.1, LEARNED)]
)
def test_accuracy(method, level, tolerance):
    surface = accuracy.SURFACES["ellipsoid"](30)
    estimate = accuracy.methods()[method](accuracy.with_noise(surface, level, 0), surface.faces)
    found = accuracy.errors(surface, estimate, accuracy.inner_vertices(surface))
    row = kept("accuracy.csv", surface="ellipsoid", noise=level, method=method)
    assert_kept(row, dict(zip(list(row)[3:], found, strict=True)), tolerance)


def test_strongest_peer():
    for found in strongest_peer.rows_of("ellipsoid", 15, 0.1):
        row = kept("strongest_peer.csv", surface="ellipsoid", vertices=2252, noise=0.1, quantity=found["quantity"])
        assert_kept(row, {"corrected": found["corrected"]}, GIVEN)
        assert_kept(row, {name: found[name] for name in ("ours", "corrected_by_our_normals")}, LEARNED)


def test_lines():
    row = kept("lines.csv", vertices=2562, noise=0.1)
    found = lines.row_of(16, 0.1)
    assert_kept(row, {name: found[name] for name in ("median", "quantile_90", "distance")}, 2.0 * LEARNED)


def test_the_page_of_accuracy_has_the_kept_figures_of_lines():
    with (RESULTS / "lines.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    printed = [row for row in rows_of_page("accuracy.md", 6) if row[0].replace(",", "").isdigit() and len(row) == 6]
    printed = [
        row for row in printed if (row[0].replace(",", ""), row[1]) in {(r["vertices"], r["noise"]) for r in rows}
    ]
    assert len(printed) == len(rows)
    for row, texts in zip(rows, printed, strict=True):
        for text, name in zip(texts[2:], ("median", "quantile_90", "largest", "distance"), strict=True):
            assert_printed(text, float(row[name]))


@pytest.mark.parametrize(("method", "tolerance"), [("paper", GIVEN), ("automatic", LEARNED)])
def test_red_blood_cell(method, tolerance):
    (surface,) = red_blood_cell.sampled(None, 8)
    found = red_blood_cell.errors(surface, red_blood_cell.methods()[method](surface.vertices, surface.faces))
    for quantity, (mean, largest) in found.items():
        row = kept("red_blood_cell.csv", triangles=1280, method=method, quantity=quantity)
        assert_kept(row, {"mean_error": mean, "max_error": largest}, tolerance)


@pytest.mark.parametrize(("method", "deleted", "tolerance"), [("paper", 90, GIVEN), ("automatic", 90, LEARNED)])
def test_deleted_vertices(method, deleted, tolerance):
    methods = {method: reduction.methods(slow=False)[method]}
    ((_, _, _, *found),) = reduction.measured(*reduction.model(bunny_path()), methods, (deleted,), (0.0,), 0)
    row = kept("reduction.csv", noise=0.0, deleted_percent=deleted, method=method)
    assert_kept(row, dict(zip(list(row)[3:], found, strict=True)), tolerance)


@pytest.mark.parametrize(("method", "tolerance"), [("paper", GIVEN), ("automatic", LEARNED)])
def test_uneven_shape(method, tolerance):
    surface, regular, _ = uneven_shape.shape(30, 1, 0)
    estimate = uneven_shape.methods()[method](surface.vertices, surface.faces)
    row = kept("uneven_shape.csv", kept_percent=30, noise=0.0, method=method)
    assert_kept(row, dict(zip(list(row)[3:], uneven_shape.errors(surface, regular, estimate), strict=True)), tolerance)


@pytest.mark.parametrize(("filler", "method"), [("ours", "auto"), ("ours, paper", "paper")])
def test_holes(filler, method):
    ball = surfaces.sphere(resolution=28)
    case = cut("sphere 0.1", ball.vertices, ball.faces, np.array([0.3, 0.4, 0.87]), 0.2)
    vertices, faces = compact(case.vertices, case.faces)
    result = fill_holes(vertices, faces, method)
    row = kept("holes.csv", case="sphere 0.1", filler=filler)
    assert_kept(row, {"rms": sub_holes.rms(case, result.vertices, result.faces[len(faces) :])}, LEARNED)


@pytest.mark.parametrize(("method", "tolerance"), [("auto", LEARNED), ("paper", GIVEN)])
def test_smoothing(method, tolerance):
    case = smoothing.made_cases()["sphere"]
    scores = smoothing.scores(smooth(smoothing.with_noise(case, 1), case.faces, method).vertices, case)
    row = kept("smoothing.csv", case="sphere", method="automatic" if method == "auto" else method, seed=1)
    assert_kept(row, {name: scores[name] for name in ("angle", "volume")}, tolerance)


@pytest.mark.parametrize(("kind", "level"), [("averaged 1", 0.1), ("varying", 0.05)])
def test_noise(kind, level):
    values = []
    for make in noise.SURFACES.values():
        surface = make()
        estimate = estimate_vertex_geometry(noise.displaced(kind, level, surface, 5), surface.faces)
        values.append(noise.errors(estimate, surface))
    row = kept("noise.csv", kind=kind, level=level)
    assert_kept(row, dict(zip(("normal", "H"), np.exp(np.log(values).mean(axis=0)), strict=True)), LEARNED)


@pytest.mark.skipif(not DENOISING.is_dir(), reason="the models are not part of the project")
def test_denoising():
    case = next(case for case in denoising.cases(DENOISING) if (case.name, case.level) == ("Pyramid", "n1"))
    rows, _ = denoising.rows_of(case)
    for found in rows[:2]:
        row = kept("denoising.csv", case="Pyramid", level="n1", method=found["method"])
        assert_kept(row, {name: float(found[name]) for name in ("angle", "height", "volume")}, LEARNED)
