"""The filters on the meshes that pymeshlab ships."""

from pathlib import Path

import numpy as np
import pymeshlab
import pytest

from bezier_filters.registration import FILTERS

SAMPLES = Path(pymeshlab.__file__).parent / "tests" / "sample_meshes"


@pytest.mark.parametrize(
    "name", ["bunny.obj", "bunny10k_textured.obj", "cow.obj", "bone.ply", "airplane.obj", "rangemaps/face000.ply"]
)
@pytest.mark.parametrize("function", FILTERS)
def test_sample_meshes(name, function):
    ms = pymeshlab.MeshSet()
    ms.load_new_mesh(str(SAMPLES / name))
    result = function(ms, color=True)
    mesh = ms.current_mesh()
    assert sum(result["status"].values()) == mesh.vertex_number()
    assert np.isfinite(mesh.vertex_scalar_array()).all()
    for attribute in result["attributes"]:
        assert np.isfinite(mesh.vertex_custom_scalar_attribute_array(attribute)).all()
