"""The column that says which values are estimates, on meshes that other filters and programs change, and in files."""

import numpy as np
import pymeshlab
import pytest

import bezier_filters as bf
from bezier_filters.fields import ESTIMATES, GRADE, column_names
from bezier_filters.files.field_files import read_fields
from bezier_filters.meshlab.mesh_files import load_mesh, save_mesh
from bezier_filters.pictures.field_panels import are_significant, field_panels, read_mesh_file

FILTERS = [
    bf.compute_normal_by_bezier_patch_per_vertex,
    bf.compute_curvature_by_bezier_patch_per_vertex,
    bf.compute_torsion_by_bezier_patch_per_vertex,
]


def ball():
    ms = pymeshlab.MeshSet()
    ms.create_sphere(radius=1.0, subdiv=3)
    return ms


def column(ms, name=GRADE):
    return ms.current_mesh().vertex_custom_scalar_attribute_array(name)


def subdivide(ms):
    ms.meshing_surface_subdivision_midpoint(iterations=1, threshold=pymeshlab.PureValue(0.0))


@pytest.mark.parametrize("filter_of_ours", FILTERS)
def test_vertices_that_a_filter_adds_are_not_estimated(filter_of_ours, tmp_path):
    ms = ball()
    filter_of_ours(ms, rings=2)
    old = ms.current_mesh().vertex_number()
    subdivide(ms)
    new = ms.current_mesh().vertex_number() - old
    assert new > old
    ms.save_current_mesh(str(tmp_path / "theirs.ply"), **{f"__ca_vs__{GRADE}": True, "__ca_vs__bz_rings_used": True})
    save_mesh(ms, tmp_path / "ours.ply")
    again = load_mesh(tmp_path / "ours.ply")
    for grades in (
        column(ms),
        column(again),
        read_fields(tmp_path / "theirs.ply")[GRADE],
        read_fields(tmp_path / "ours.ply")[GRADE],
    ):
        statuses = [bf.FitStatus.of_grade(grade) for grade in grades]
        assert statuses.count(bf.FitStatus.OK) == old
        assert statuses.count(bf.FitStatus.SKIPPED) == new


def test_pictures_know_them_as_not_estimated(tmp_path):
    ms = pymeshlab.MeshSet()
    ms.create_torus(hradius=3.0, vradius=1.0, hsubdiv=30, vsubdiv=15)
    bf.compute_curvature_by_bezier_patch_per_vertex(ms)
    old = ms.current_mesh().vertex_number()
    subdivide(ms)
    save_mesh(ms, tmp_path / "a.ply")
    file = read_mesh_file(tmp_path / "a.ply")
    (panel,) = field_panels([file], GRADE, colormap="auto", percentile=2.0)
    assert [name for name, _ in panel.names] == [
        f"{bf.FitStatus.SKIPPED.words}: {len(file.vertices) - old:,}",
        f"{bf.FitStatus.OK.words}: {old}",
    ]
    assert are_significant(file.columns).sum() == old


def test_a_selection_later_leaves_them_out():
    ms = ball()
    bf.compute_torsion_by_bezier_patch_per_vertex(ms)
    subdivide(ms)
    ms.compute_selection_by_condition_per_vertex(condselect="vi < 3")
    bf.compute_torsion_by_bezier_patch_per_vertex(ms, onselected=True)
    assert (column(ms)[3:642] == 9).all()
    assert (column(ms)[642:] == 0).all()


def test_what_was_in_memory_is_no_grade(tmp_path):
    ms = ball()
    n = ms.current_mesh().vertex_number()
    values = np.full(n, 9.0)
    values[:6] = 4.7e-310, 6.78, -1.0, 10.0, np.inf, np.nan
    ms.current_mesh().add_vertex_custom_scalar_attribute(values, GRADE)
    ms.save_current_mesh(str(tmp_path / "a.ply"), **{f"__ca_vs__{GRADE}": True})
    assert (column(load_mesh(tmp_path / "a.ply"))[:6] == 0.0).all()
    ms.compute_selection_by_condition_per_vertex(condselect=f"vi > {n - 3}")
    bf.compute_torsion_by_bezier_patch_per_vertex(ms, onselected=True)
    assert (column(ms)[:6] == 0.0).all()
    assert (column(ms)[6:] == 9.0).all()


def test_holes_that_are_filled_later_are_not_estimated():
    ms = ball()
    bf.compute_curvature_by_bezier_patch_per_vertex(ms)
    ms.compute_selection_by_condition_per_vertex(condselect="z > 0.7")
    ms.meshing_remove_selected_vertices()
    old = ms.current_mesh().vertex_number()
    bf.meshing_close_holes_by_bezier_patch(ms)
    assert (column(ms)[:old] == 9).all()
    assert ms.current_mesh().vertex_number() > old
    for name in column_names(*ESTIMATES):
        if f"__ca_vs__{name}" in ms.filter_parameter_values("ply"):
            assert (column(ms, name)[old:] == 0.0).all()


def old_file(path, codes, rings=None):
    """A PLY file with status codes, as version 0.2.0 wrote it, and perhaps the rings."""
    names = ["x", "y", "z", "bz_fit_status"] + ["bz_rings_used"] * (rings is not None)
    rows = np.column_stack([np.zeros((len(codes), 3)), codes, *([] if rings is None else [rings])])
    head = ["ply", "format ascii 1.0", f"element vertex {len(codes)}", *(f"property double {name}" for name in names)]
    lines = [" ".join(f"{value:g}" for value in row) for row in rows]
    path.write_text("\n".join([*head, "end_header", *lines, ""]), encoding="ascii")


def test_files_of_older_versions(tmp_path):
    """They have codes: 0 was OK, and of a vertex that a filter had added; the rings tell."""
    codes, rings = np.array([0, 0, 1, 6, 7, 8, 9]), np.array([2, 0, 3, 2, 0, 0, 0])
    old_file(tmp_path / "a.ply", codes, rings)
    names = ["OK", "SKIPPED", "WIDER_RING", "FOLDED", "NORMAL_ONLY", "ISOLATED", "SKIPPED"]
    fields = read_fields(tmp_path / "a.ply")
    assert "bz_fit_status" not in fields
    assert [bf.FitStatus.of_grade(grade).name for grade in fields[GRADE]] == names
    np.testing.assert_array_equal(column(load_mesh(tmp_path / "a.ply")), fields[GRADE])
    old_file(tmp_path / "b.ply", codes)
    statuses = [bf.FitStatus.of_grade(grade).name for grade in read_fields(tmp_path / "b.ply")[GRADE]]
    assert statuses == ["SKIPPED", "SKIPPED", *names[2:]]


def test_grades_are_codes_upside_down():
    assert [bf.FitStatus.of_grade(status.grade) for status in bf.FitStatus] == list(bf.FitStatus)
    assert bf.FitStatus.of_grade(0) == bf.FitStatus.SKIPPED
    g = bf.estimate_vertex_geometry(*bf.mesh_arrays(ball()), selected=np.arange(642) < 5, rings=2)
    np.testing.assert_array_equal(g.fit_grade, [9] * 5 + [0] * 637)
    assert all(bf.FitStatus.of_grade(k).has_curvature == (k >= 3) for k in range(10))
