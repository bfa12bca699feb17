"""The page of a comparison: what it says first, its colours, and where nothing is compared."""

import json
import re
from base64 import b64decode
from pathlib import Path

import numpy as np
import pytest
from command_line import run
from invariants import meshset_with

import bezier_filters as bf
from bezier_filters.pictures.page_deviation import deviation_sentences
from bezier_filters.surfaces import sphere


def _data(html: str) -> dict:
    return json.loads(re.search(r'id="data">(.*?)</script>', html)[1])


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A ball with a bump of .02, and the part of the ball around it."""
    folder, ball = tmp_path_factory.mktemp("compare"), sphere(resolution=16)
    bump = 0.02 * np.exp(-np.square((ball.vertices - ball.vertices[0]) / 0.15).sum(axis=1))
    half = ball.faces[ball.vertices[ball.faces].mean(axis=1) @ ball.vertices[0] > -0.3]
    bf.save_mesh(meshset_with(ball.vertices * (1.0 + bump[:, None]), ball.faces), folder / "scan.ply")
    bf.save_mesh(meshset_with(ball.vertices, half), folder / "model.ply")
    return folder


def test_a_comparison_has_a_page(files: Path):
    names = [str(files / name) for name in ("scan.ply", "model.ply", "page.html")]
    done = run("compare", *names[:2], "--tolerance", "0.01", "--report", names[2], "--json")
    assert done.returncode == 0, done.stderr
    report, page = json.loads(done.stdout), _data(Path(names[2]).read_text("utf-8"))
    left = sum(report["status"].values()) - report["compared"]
    assert left > 0
    deviation = page["fields"][0]
    values = np.frombuffer(b64decode(deviation["values"]), "<f4")
    assert np.isnan(values).sum() == left
    assert deviation["unknown"] == f"not compared: {left:,}"
    assert deviation["limits"] == [-0.03, 0.03]
    colors = np.array(deviation["colors"])
    assert (colors[86:170] == colors[128]).all()  # green: the middle third
    assert not (colors[84:86] == colors[128]).all()
    assert page["verdict"][0][0].startswith("The root mean square deviation from model.ply is")
    assert f"{left:,} of" in page["verdict"][-1][0]
    assert page["tables"][0]["title"] == "The comparison"
    assert np.nanmax(values) == pytest.approx(0.02, abs=1e-3)


def test_the_page_of_a_comparison_needs_its_ending(files: Path):
    names = [str(files / name) for name in ("scan.ply", "model.ply", "page.png")]
    done = run("compare", *names[:2], "--report", names[2])
    assert done.returncode == 2
    assert ".html" in done.stderr


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"regions": []}, "No region deviates by more than noise explains."),
        ({"share_significant": None}, "What of it is noise is not known, because the noise could not be learned."),
    ],
)
def test_sentences_say_what_deviates(change: dict, sentence: str):
    region = {"place": [0.0, 1.0, 2.0], "deviation": 0.1, "std": 0.01, "vertices": 20}
    report = {"compared": 9, "rms": 0.1, "mean": 0.0, "share_within": None, "share_significant": 0.5}
    report |= {"regions": [region], "remarks": ["1 of 10 vertices was not compared"]}
    texts = [text for text, _ in deviation_sentences(report | change, "model.ply")]
    assert texts[1:] == [sentence, "1 of 10 vertices was not compared."]
    found = deviation_sentences(report, "model.ply")[1][0]
    assert found == (
        "1 region deviates by more than noise explains. It is around (0, 1, 2), "
        "with a mean of 0.1 ± 0.01 over 20 vertices."
    )
