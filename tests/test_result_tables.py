"""Results as text, dictionaries and data frames."""

import dataclasses
import json

import numpy as np
import pytest

import bezier_filters as bf
from bezier_filters.surfaces import block_with_sharp_edges, torus

SHAPE = torus(resolution=12)
GEOMETRY = bf.estimate_vertex_geometry(SHAPE, rings=2, alpha=0.99)
SMOOTHED = bf.smooth(SHAPE, "paper")
FILLED = bf.fill_holes(SHAPE.vertices, SHAPE.faces[6:])
CREASES = bf.find_creases(*block_with_sharp_edges(resolution=6))
REPLACED = bf.replace_selection(SHAPE, np.arange(len(SHAPE.faces)) < 6)
MESH_REPORT = bf.inspect_mesh(SHAPE)
RESULTS = [GEOMETRY, SMOOTHED, FILLED, CREASES, REPLACED, MESH_REPORT]


def test_text_is_a_short_table():
    text = str(GEOMETRY).splitlines()
    row = next(line.split() for line in text if line.startswith("mean_curvature "))
    h = GEOMETRY.mean_curvature
    assert row == ["mean_curvature", "1/length", *(f"{f(h):.4g}" for f in (np.min, np.median, np.max))]
    for result in RESULTS:
        lines = str(result).splitlines()
        assert 3 <= len(lines) <= 25
        assert max(map(len, lines)) <= 120
        assert "\n" not in repr(result)


def test_derived_values_are_fields():
    values = dataclasses.asdict(GEOMETRY)
    np.testing.assert_array_equal(values["mean_curvature"], 0.5 * (GEOMETRY.k_min + GEOMETRY.k_max))
    np.testing.assert_array_equal(values["gaussian_curvature"], GEOMETRY.k_min * GEOMETRY.k_max)
    np.testing.assert_array_equal(values["fit_grade"], 9 - GEOMETRY.status)
    assert dataclasses.asdict(SMOOTHED)["max_displacement"] == SMOOTHED.displacement.max()
    assert dataclasses.asdict(FILLED)["filled"] == len(FILLED.holes) == 1
    assert dataclasses.asdict(REPLACED)["replaced"] == len(REPLACED.patches) == 1
    assert dataclasses.asdict(CREASES.lines[0])["length"] == CREASES.lines[0].length > 0


def test_they_follow_what_is_replaced():
    doubled = dataclasses.replace(GEOMETRY, k_min=2 * GEOMETRY.k_min, k_max=2 * GEOMETRY.k_max)
    np.testing.assert_array_equal(doubled.mean_curvature, 2 * GEOMETRY.mean_curvature)
    assert "mean_curvature" not in vars(doubled)  # computed when it is read


def test_reports_of_meshes_have_a_row_for_each_count():
    rows = [line.rsplit(maxsplit=1) for line in str(MESH_REPORT).splitlines()[2:]]
    assert dict(rows)["inner vertices"] == f"{len(SHAPE.vertices):,}"
    assert [name.replace(" ", "_") for name, _ in rows] == [field.name for field in dataclasses.fields(MESH_REPORT)]


def test_dicts_have_plain_values():
    values = GEOMETRY.to_dict()
    assert values.keys() == dataclasses.asdict(GEOMETRY).keys()
    assert values["k_min"] is GEOMETRY.k_min
    assert json.dumps(values["fit"])
    assert FILLED.to_dict()["holes"][0]["method"] == FILLED.holes[0].method
    assert CREASES.to_dict()["lines"][0]["strength"] == CREASES.lines[0].strength


def test_data_frames_have_a_row_for_each_vertex_hole_or_line():
    pytest.importorskip("pandas", reason="pandas is not installed")
    frame = GEOMETRY.to_pandas()
    np.testing.assert_array_equal(frame[[f"bz_direction_max_{a}" for a in "xyz"]].to_numpy(), GEOMETRY.direction_max)
    np.testing.assert_array_equal(frame["bz_k_min"], GEOMETRY.k_min)
    assert frame["bz_fit_grade"].dtype == np.int32
    moved = SMOOTHED.to_pandas()
    np.testing.assert_array_equal(moved[["x", "y", "z"]].to_numpy(), SMOOTHED.vertices)
    assert moved["outliers"].dtype == bool
    holes = FILLED.to_pandas()
    assert holes.loc[0, "new_faces"] == len(FILLED.faces) - len(SHAPE.faces) + 6
    patches = REPLACED.to_pandas()
    assert patches.loc[0, "old_faces"] == 6
    assert patches.loc[0, "removed_volume"] == REPLACED.patches[0].removed_volume
    lines = CREASES.to_pandas()
    assert len(lines) == len(CREASES.lines)
    assert lines["length"].sum() == pytest.approx(sum(line.length for line in CREASES.lines))


def test_pandas_is_named_if_it_is_missing(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pandas", None)
    with pytest.raises(ImportError, match=r"pandas is missing: pip install .*\[convert\]"):
        GEOMETRY.to_pandas()
