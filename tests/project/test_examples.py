"""The examples run without a display, write what they say, and what they show holds."""

from importlib import import_module
from pathlib import Path

import numpy as np
import pymeshlab
import pytest

pytestmark = pytest.mark.slow

EXAMPLES = sorted(path.stem for path in (Path(__file__).parents[2] / "examples").glob("ex*.py"))


@pytest.fixture(scope="module")
def done():
    """Results and folders of the examples that were run."""
    return {}


@pytest.fixture
def run(done, tmp_path_factory, quick_pictures):
    """Run an example once: its results, and the folder with its files."""

    def run_once(number):
        name = next(name for name in EXAMPLES if name.startswith(f"ex{number:02}_"))
        if name not in done:
            out = tmp_path_factory.mktemp(name)
            done[name] = import_module(name).main(out), out
        return done[name]

    return run_once


def load(path):
    ms = pymeshlab.MeshSet()
    ms.load_new_mesh(str(path))
    return ms


@pytest.mark.parametrize("number", range(1, len(EXAMPLES) + 1))
def test_it_says_what_one_sees_and_draws_it(number, run):
    _, out = run(number)
    doc = import_module(EXAMPLES[number - 1]).__doc__
    assert "sees" in doc
    pictures = list(out.glob("*.png"))
    assert len(pictures) == 1
    assert pictures[0].stat().st_size > 20_000


def test_curvature_opens_in_meshlab_with_quality_and_colours(run):
    report, out = run(1)
    ms = load(out / "curvature.ply")
    mesh = ms.current_mesh()
    assert np.median(mesh.vertex_scalar_array()) == report["statistics"]["median"]
    assert len(np.unique(mesh.vertex_color_array())) > 100


def test_torsion_is_red_where_high_blue_where_medium_and_green_where_low(run):
    report, out = run(2)
    ms = load(out / "torsion.ply")
    torsion = ms.current_mesh().vertex_scalar_array()
    red, green, blue = 255 * ms.current_mesh().vertex_color_matrix()[:, :3].T
    low, high = report["color_range"]
    share = (torsion - low) / (high - low)
    assert red[share.argmax()] == pytest.approx(255, abs=1)
    assert green[share.argmin()] > 240
    assert (blue[np.abs(share - 0.5) < 0.05] > 225).all()


def test_smoothing_removes_most_of_the_noise_and_more_than_the_paper_does(run):
    distance, _ = run(3)
    for name in ("bumpy_star", "block"):
        noisy, paper, automatic = (value for key, value in distance.items() if key.startswith(name))
        assert automatic < 0.5 * noisy
        assert automatic < paper < noisy


def test_holes_are_filled_and_the_block_has_its_volume_again(run):
    result, _ = run(4)
    assert result["holes filled in the egg carton"] == 3
    assert result["holes filled in the block"] == 2
    assert result["volume of the block"] == pytest.approx(0.875, abs=1e-6)


def test_crests_of_the_block_are_its_edges(run):
    """A cube of side 1 without one octant."""
    lengths, _ = run(5)
    assert lengths["length of ridges, block"] == pytest.approx(13.5)
    assert lengths["length of ravines, block"] == pytest.approx(1.5)
    assert lengths["length of ridges, blob"] > lengths["length of ravines, blob"] > 1.0


def test_an_ellipsoid_has_four_umbilics_and_the_bunny_has_lines(run):
    found, _ = run(13)
    assert found["umbilics, ellipsoid"] == [0.5] * 4
    assert found["lines, bunny"] > found["lines, ellipsoid"] > 50


def test_the_standard_error_tells_where_the_errors_are(run):
    result, _ = run(6)
    assert 0.9 < result["truth within 95 % intervals"] < 1.0
    for side in ("left", "right"):
        assert 0.5 < result[f"standard error, {side}"] / result[f"error, {side}"] < 2.0
    for what in ("standard error", "error"):
        assert result[f"{what}, right"] > 1.3 * result[f"{what}, left"]


def test_points_without_normals_get_curvature_and_outside(run):
    result, out = run(7)
    assert result["outward"] == 1.0
    assert result["relative error"] < 0.1
    assert load(out / "points.ply").current_mesh().is_point_cloud()


def test_the_pipeline_ends_with_a_closed_clean_mesh(run):
    result, out = run(8)
    assert result["closed"]
    assert result["holes filled"] == 1
    assert result["noise after"] < 0.3 * result["noise before"]
    ms = load(out / "pipeline.ply")
    assert 0 < result["selected vertices"] < ms.current_mesh().vertex_number()


def test_only_the_paper_does_not_converge(run):
    paper, third_order, automatic = run(9)[0].values()
    assert paper < 0.5
    assert third_order > 1.7
    assert automatic > 4.0


def test_the_bunnys_bottom_is_closed(run):
    result, _ = run(10)
    assert result["filled"] == result["holes"] == 5
    paper, automatic = (value for name, value in result.items() if name.startswith("mean angle"))
    assert automatic < paper


def test_the_papers_fields_agree_with_ours_but_for_detail(run):
    result, _ = run(11)
    assert result["median angle between the normals [degrees]"] < 5.0
    assert result["correlation of the mean curvatures"] > 0.8


def test_edges_and_corners_of_a_part_are_there_again(run):
    from ex12_part_like_the_fandisk import arrays, distance_to_fan
    from ex12_part_like_the_fandisk import load as load_sample

    result, _ = run(12)
    assert result["filled, automatic"] == 4
    assert result["parts, paper"] == result["parts, automatic"] == [2, 2, 3, 3]
    automatic, paper, one_patch = (
        result[f"distance, {name} [mean edges]"] for name in ("automatic", "paper", "paper, one patch")
    )
    assert automatic < 0.1 * paper < 0.01 * one_patch
    assert distance_to_fan(arrays(load_sample("fan.ply"))[0]).max() < 1e-12
