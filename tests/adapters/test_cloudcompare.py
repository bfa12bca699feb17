"""The plugin for CloudCompare: in its Python runtime, which no package index has, or else what can be read of it."""

import ast
import re
from pathlib import Path

import numpy as np
import pytest

from bezier_filters.surfaces import torus

ADAPTERS = Path(__file__).parents[2] / "adapters"
PLUGIN = ADAPTERS / "bezier_filters_adapters" / "cloudcompare_plugin.py"


def test_the_entry_point_is_a_plugin():
    text = (ADAPTERS / "pyproject.toml").read_text(encoding="utf-8")
    (name,) = re.findall(r'entry-points\."cloudcompare.plugins"\]\nbezier-filters = "(.*)"', text)
    assert name.partition(":")[0] == f"bezier_filters_adapters.{PLUGIN.stem}"
    classes = [node for node in ast.parse(PLUGIN.read_text("utf-8")).body if isinstance(node, ast.ClassDef)]
    assert [(node.name, *map(ast.unparse, node.bases)) for node in classes] == [
        (name.partition(":")[2], "pycc.PythonPluginInterface")
    ]


def test_fields_come_to_the_cloud_of_a_mesh():
    pycc = pytest.importorskip("pycc", reason="pycc, built with CloudCompare's Python runtime, is not installed")
    from bezier_filters_adapters.cloudcompare_plugin import apply

    shape = torus(resolution=16)
    cloud = pycc.ccPointCloud(*shape.vertices.astype(np.float32).T)
    mesh = pycc.ccMesh(cloud)
    for face in shape.faces.tolist():
        mesh.addTriangle(*face)
    apply("curvature", mesh)
    assert cloud.getScalarFieldIndexByName("bz_mean_curvature") >= 0
