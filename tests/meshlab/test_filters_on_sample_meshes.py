"""The filters on the meshes that pymeshlab ships."""

import numpy as np
import pytest
from conftest import load_sample

from bezier_filters.meshlab.vertex_filters import (
    apply_coord_bezier_patch_smoothing,
    compute_curvature_by_bezier_patch_per_vertex,
    compute_normal_by_bezier_patch_per_vertex,
    compute_torsion_by_bezier_patch_per_vertex,
)

VERTEX_FILTERS = (
    compute_normal_by_bezier_patch_per_vertex,
    compute_curvature_by_bezier_patch_per_vertex,
    compute_torsion_by_bezier_patch_per_vertex,
)


NAMES = [
    *("bunny.obj", "bunny10k_textured.obj", "cow.obj", "bone.ply", "airplane.obj"),
    pytest.param("rangemaps/face000.ply", marks=pytest.mark.slow),
]


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("function", VERTEX_FILTERS)
def test_sample_meshes(name, function):
    ms = load_sample(name)
    # All three choose their fits alike: that is looked at in one of them.
    is_curvature = function is compute_curvature_by_bezier_patch_per_vertex
    result = function(ms, color=True, **({} if is_curvature else {"rings": 2, "alpha": 0.8}))
    mesh = ms.current_mesh()
    assert sum(result["status"].values()) == mesh.vertex_number()
    assert np.isfinite(mesh.vertex_scalar_array()).all()
    for attribute in result["attributes"]:
        assert np.isfinite(mesh.vertex_custom_scalar_attribute_array(attribute)).all()


@pytest.mark.parametrize("name", [pytest.param(NAMES[0], marks=pytest.mark.slow), *NAMES[1:]])  # 10k is the same scan
def test_smoothing_of_sample_meshes(name):
    ms = load_sample(name)
    report = apply_coord_bezier_patch_smoothing(ms, quality="displacement", color=True)
    assert np.isfinite(ms.current_mesh().vertex_matrix()).all()
    assert report["new_bad_faces"] == 0
    assert report["displacement"]["max"] < 5.0 * report["mean_edge"]
