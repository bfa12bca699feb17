"""What the adapters share agrees with the functions of arrays and the one table."""

import doctest
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import bezier_filters as bf
import bezier_filters_adapters.filters
from bezier_filters.errors import InvalidParameterError
from bezier_filters.fields import PREFIX
from bezier_filters.parameters import COLORS, DIRECTION, PARAMETERS, RUN
from bezier_filters.surfaces import torus
from bezier_filters_adapters.filters import (
    FILL_HOLES,
    LABELS,
    default_of,
    field_names,
    kind_of,
    parameters_of,
    run,
)

ROOT = Path(__file__).parents[2]
SHAPE = torus(resolution=16)


def test_every_filter_has_an_adapter():
    """But for filters that need selections, holes, texture coordinates or a second mesh, make meshes, or write none."""
    others = ("replace", "bridge", "bake", "subdivide", "remesh", "lines", "compare", "measure")
    assert list(LABELS) == [name for name in PARAMETERS if name not in others]


@pytest.mark.parametrize("name", LABELS)
def test_all_parameters_are_there_but_those_of_meshsets(name):
    of_meshsets = {parameter.name for parameter in (*COLORS, *DIRECTION, *RUN)} | {"quality", "repair", "trim"}
    offered = [parameter.name for parameter in parameters_of(name)]
    assert offered == [parameter.name for parameter in PARAMETERS[name] if parameter.name not in of_meshsets]


@pytest.mark.parametrize("name", LABELS)
def test_defaults_are_of_the_kinds(name):
    for parameter in parameters_of(name):
        kind, default = kind_of(parameter), default_of(parameter)
        assert default in kind if isinstance(kind, tuple) else type(default) is kind, parameter


@pytest.mark.parametrize("name", LABELS)
def test_defaults_change_nothing(name):
    given = {parameter.name: default_of(parameter) for parameter in parameters_of(name)}
    plain, asked = run(name, SHAPE.vertices, SHAPE.faces, {}), run(name, SHAPE.vertices, SHAPE.faces, given)
    assert list(plain.fields) == list(asked.fields) == field_names(name)
    assert all(column.startswith(PREFIX) for column in plain.fields)
    for column, values in plain.fields.items():
        np.testing.assert_array_equal(values, asked.fields[column])
    np.testing.assert_array_equal(plain.vertices, asked.vertices)
    np.testing.assert_array_equal(plain.faces, asked.faces)


def test_texts_are_read():
    given = {"rings": "2", "alpha": " 0.8", "smoothness": "paper", "robust": "default"}
    found = run("curvature", SHAPE.vertices, SHAPE.faces, given).fields["bz_mean_curvature"]
    g = bf.estimate_vertex_geometry(SHAPE.vertices, SHAPE.faces, rings=2, alpha=0.8, smoothness="paper")
    np.testing.assert_array_equal(found, g.mean_curvature)


def test_percentages_are_those_of_the_diagonal():
    diagonal = np.linalg.norm(np.ptp(SHAPE.vertices, axis=0))
    in_percent = run("curvature", SHAPE.vertices, SHAPE.faces, {"radius": "10%"})
    as_length = run("curvature", SHAPE.vertices, SHAPE.faces, {"radius": float(diagonal) / 10})
    assert in_percent.summary == as_length.summary
    np.testing.assert_array_equal(in_percent.fields["bz_k_max"], as_length.fields["bz_k_max"])


def test_holes_are_limited_by_their_edges():
    faces = SHAPE.faces[1:]
    assert len(run(FILL_HOLES, SHAPE.vertices, faces, {"maxholesize": 3}).faces) == len(SHAPE.faces)
    with pytest.raises(InvalidParameterError, match="max_edges"):
        run(FILL_HOLES, SHAPE.vertices, faces, {"maxholesize": 2})


@pytest.mark.parametrize("given", [{"rigns": 2}, {"rings": "many"}, {"radius": "x%"}, {"threads": 1}])
def test_wrong_parameters_are_named(given):
    (name,) = given
    with pytest.raises(InvalidParameterError, match=name):
        run("curvature", SHAPE.vertices, SHAPE.faces, given)


def test_examples():
    assert doctest.testmod(bezier_filters_adapters.filters).failed == 0


def test_pymeshlab_is_not_loaded():
    """Its Qt does not go with that of hosts."""
    code = "import sys; from bezier_filters_adapters import filters; print('pymeshlab' in sys.modules)"
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(map(str, (ROOT, ROOT / "adapters")))}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False"]


def test_the_version_is_that_of_the_filters():
    for path in ("pyproject.toml", "bezier_filters_blender/blender_manifest.toml"):
        text = (ROOT / "adapters" / path).read_text(encoding="utf-8")
        assert re.findall(r'^version = "(.*)"$', text, re.MULTILINE) == [bf.__version__]
    text = (ROOT / "adapters" / "pyproject.toml").read_text(encoding="utf-8")
    assert f'"bezier-filters>={bf.__version__}"' in text
