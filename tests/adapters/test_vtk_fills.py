"""Filling holes of VTK's meshes: cells, points and all data stay, and new ones have rows of their own."""

import numpy as np
import pytest

import bezier_filters as bf

pyvista = pytest.importorskip("pyvista", minversion="0.48", reason="accessors came with pyvista 0.48")
pytest.importorskip("bezier_filters_adapters.pyvista_accessor")


@pytest.fixture(scope="module")
def plate():
    """A bent plate of quadrilaterals with a hole, a line and a vertex beside it, and data of all kinds."""
    plate = pyvista.Plane(i_size=12.0, j_size=12.0, i_resolution=12, j_resolution=12)
    plate.clear_data()
    centers = plate.cell_centers().points
    plate = plate.extract_cells(np.hypot(*centers[:, :2].T) > 2.5).extract_surface(algorithm=None)
    plate.clear_data()
    points = np.array(plate.points, np.float64)
    points[:, 2] = 0.02 * points[:, 0] ** 2
    n = len(points)
    points = np.vstack([points, [[20.0, 0.0, 0.0], [21.0, 0.0, 0.0], [22.0, 0.0, 0.0]]])
    mesh = pyvista.PolyData(points, faces=plate.faces, lines=[2, n, n + 1], verts=[1, n + 2])
    mesh.point_data["height"] = points[:, 1]
    mesh.point_data["place"] = points.astype(np.float32)
    mesh.point_data["code"] = np.arange(mesh.n_points)
    mesh.point_data["flag"] = points[:, 0] > 0.0
    mesh.point_data["label"] = [f"p{k}" for k in range(mesh.n_points)]
    mesh.point_data["bz_k_min"] = np.ones(mesh.n_points)
    mesh.cell_data["group"] = np.arange(mesh.n_cells)
    mesh.cell_data["bz_certainty"] = np.ones(mesh.n_cells)
    mesh.cell_data["name"] = [f"c{k}" for k in range(mesh.n_cells)]
    mesh.field_data["note"] = ["kept"]
    mesh.active_texture_coordinates = points[:, :2] / 12.0 + 0.5
    mesh.set_active_scalars("height")
    return mesh


@pytest.fixture(scope="module")
def filled(plate):
    before = plate.copy()
    made = plate.bezier.fill_holes()
    assert plate == before
    return made


def test_old_cells_stay_and_new_ones_are_triangles(plate, filled):
    old, new = plate.regular_faces, filled.faces[len(plate.faces) :].reshape(-1, 4)
    assert old.shape[1] == 4
    np.testing.assert_array_equal(filled.faces[: len(plate.faces)], plate.faces)
    assert len(new) > 0
    assert (new[:, 0] == 3).all()
    np.testing.assert_array_equal(filled.lines, plate.lines)
    np.testing.assert_array_equal(filled.verts, plate.verts)
    np.testing.assert_array_equal(filled.points[: plate.n_points], plate.points)
    assert filled.n_points > plate.n_points
    polygons = pyvista.PolyData(filled.points, faces=filled.faces)
    assert polygons.n_open_edges == 4 * 12


def test_old_rows_stay(plate, filled):
    for name in plate.point_data:
        np.testing.assert_array_equal(filled.point_data[name][: plate.n_points], plate.point_data[name], err_msg=name)
        assert filled.point_data[name].dtype == plate.point_data[name].dtype
    for name in plate.cell_data:
        np.testing.assert_array_equal(filled.cell_data[name][: plate.n_cells], plate.cell_data[name], err_msg=name)
    assert set(filled.point_data) == {*plate.point_data, "bz_new"}
    assert set(filled.cell_data) == {*plate.cell_data, "bz_new"}
    assert filled.active_scalars_name == "height"
    assert filled.point_data.active_texture_coordinates_name == plate.point_data.active_texture_coordinates_name
    assert list(filled.field_data["note"]) == ["kept"]


def test_new_rows(plate, filled):
    new, data = slice(plate.n_points, None), filled.point_data
    y = filled.points[new, 1]
    np.testing.assert_allclose(data["height"][new], y, atol=1e-3)  # nearly harmonic: the plate is bent across it
    np.testing.assert_allclose(data["place"][new, 1], y, atol=1e-3)
    np.testing.assert_allclose(filled.active_texture_coordinates[new, 1], y / 12.0 + 0.5, atol=1e-4)
    code, x = data["code"][new], plate.points[:, 0]
    np.testing.assert_array_equal(data["flag"][new], x[code] > 0.0)
    assert [f"p{k}" for k in code] == list(data["label"][new])
    assert not data["bz_k_min"][new].any()
    cells = slice(plate.n_cells, None)
    group = filled.cell_data["group"][cells]
    assert ((group >= 2) & (group < plate.n_cells)).all()  # polygons come after the vertex and the line
    assert [f"c{k}" for k in group] == list(filled.cell_data["name"][cells])
    assert not filled.cell_data["bz_certainty"][cells].any()
    touching = [
        set(filled.get_cell(plate.n_cells + k).point_ids) & set(plate.get_cell(int(cell)).point_ids)
        for k, cell in enumerate(group)
    ]
    assert sum(len(shared) == 2 for shared in touching) >= 10


def test_marks(plate, filled):
    for data, count in ((filled.point_data, plate.n_points), (filled.cell_data, plate.n_cells)):
        assert data["bz_new"].dtype == np.uint8
        np.testing.assert_array_equal(data["bz_new"], np.arange(len(data["bz_new"])) >= count)


def test_marks_are_those_of_the_last_fill(filled):
    again = filled.bezier.fill_holes()
    assert again.n_points == filled.n_points
    assert not again.point_data["bz_new"].any()
    assert not again.cell_data["bz_new"].any()


def test_normals_of_fills_are_those_of_their_polygons(plate):
    mesh = pyvista.PolyData(plate.points, faces=plate.faces)
    mesh = mesh.compute_normals(split_vertices=False, consistent_normals=False)
    mesh.point_data["Normals"] = -mesh.point_data["Normals"]  # old ones stay whatever they are
    made = mesh.bezier.fill_holes()
    plain = pyvista.PolyData(made.points, faces=made.faces)
    plain = plain.compute_normals(split_vertices=False, consistent_normals=False)
    n, m = mesh.n_points, mesh.n_cells
    np.testing.assert_array_equal(made.point_data["Normals"][:n], mesh.point_data["Normals"])
    np.testing.assert_array_equal(made.cell_data["Normals"][:m], mesh.cell_data["Normals"])
    np.testing.assert_allclose(made.point_data["Normals"][n:], plain.point_data["Normals"][n:], atol=1e-6)
    np.testing.assert_allclose(made.cell_data["Normals"][m:], plain.cell_data["Normals"][m:], atol=1e-6)
    assert made.point_data.active_normals_name == "Normals"


def test_strips_keep_their_data():
    """Their cells are the last ones: new cells go before them."""
    sheet = pyvista.Plane(i_resolution=12, j_resolution=12).triangulate()
    sheet.clear_data()
    kept = sheet.extract_cells(np.hypot(*sheet.cell_centers().points[:, :2].T) > 0.2)
    strips = kept.extract_surface(algorithm=None).strip()
    strips.clear_data()
    assert strips.n_strips > 0
    strips.cell_data["group"] = np.arange(strips.n_cells)
    made = strips.bezier.fill_holes()
    place, count = strips.n_cells - strips.n_strips, made.n_cells - strips.n_cells
    assert count > 0
    assert made.n_strips == strips.n_strips
    old = np.delete(made.cell_data["group"], np.s_[place : place + count])
    np.testing.assert_array_equal(old, strips.cell_data["group"])
    np.testing.assert_array_equal(np.flatnonzero(made.cell_data["bz_new"]), np.arange(place, place + count))
    assert made.triangulate().n_open_edges == 4 * 12


def test_global_ids_stay_distinct_and_new_points_are_no_ghosts(plate):
    from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray, vtk_to_numpy

    mesh = pyvista.PolyData(plate.points, faces=plate.faces)
    ids = numpy_to_vtkIdTypeArray(np.arange(mesh.n_points, dtype=np.int64) + 100, deep=True)
    ids.SetName("ids")
    mesh.GetPointData().SetGlobalIds(ids)
    ghosts = numpy_to_vtk(np.ones(mesh.n_points, np.uint8), deep=True)
    ghosts.SetName("vtkGhostType")
    mesh.GetPointData().AddArray(ghosts)
    made = mesh.bezier.fill_holes()
    found = vtk_to_numpy(made.GetPointData().GetGlobalIds())
    np.testing.assert_array_equal(found, np.arange(made.n_points) + 100)
    np.testing.assert_array_equal(made.point_data["vtkGhostType"], np.arange(made.n_points) < mesh.n_points)


def test_the_mesh_is_that_of_the_function(plate):
    made = plate.bezier.fill_holes()
    vertices, faces = bf.mesh_arrays(plate)
    np.testing.assert_array_equal(made.points, bf.fill_holes(vertices, faces).vertices)
