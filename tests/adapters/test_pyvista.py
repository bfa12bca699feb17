"""The accessor on pyvista's meshes."""

import doctest
import re
from pathlib import Path

import numpy as np
import pytest

import bezier_filters as bf
from bezier_filters.surfaces import block_with_sharp_edges, torus
from bezier_filters_adapters.field_colors import field_colors

pyvista = pytest.importorskip("pyvista", minversion="0.48", reason="accessors came with pyvista 0.48")
pyvista_accessor = pytest.importorskip("bezier_filters_adapters.pyvista_accessor")
SHAPE = torus(resolution=16)


@pytest.fixture
def mesh():
    made = bf.to_pyvista(SHAPE.vertices, SHAPE.faces)
    made.point_data["mine"] = np.arange(made.n_points)
    return made


@pytest.mark.parametrize("name", ["normals", "curvature", "torsion", "smooth", "creases"])
def test_fields_come_to_a_copy(mesh, name):
    before = mesh.copy()
    made = getattr(mesh.bezier, name)()
    assert mesh == before
    assert any(column.startswith("bz_") for column in made.point_data)
    np.testing.assert_array_equal(made.point_data["mine"], before.point_data["mine"])
    np.testing.assert_array_equal(made.faces, before.faces)


def test_values_are_those_of_the_function(mesh):
    g = bf.estimate_vertex_geometry(SHAPE.vertices, SHAPE.faces, rings=2)
    np.testing.assert_array_equal(mesh.bezier.curvature(rings=2)["bz_k_min"], g.k_min)


def test_vectors_are_arrays_and_codes_integers(mesh):
    """With the names and the types that `to_pyvista` gives."""
    g = bf.estimate_vertex_geometry(mesh)
    whole = bf.to_pyvista(mesh, g).point_data
    for made in (mesh.bezier.normals(), mesh.bezier.curvature(), mesh.bezier.torsion()):
        assert set(made.point_data) <= {*whole.keys(), "mine"}
        for name, values in made.point_data.items():
            if name != "mine":
                np.testing.assert_array_equal(values, whole[name])
                assert values.dtype == whole[name].dtype
    assert mesh.bezier.curvature()["bz_direction_max"].shape == (mesh.n_points, 3)
    assert mesh.bezier.curvature()["bz_fit_grade"].dtype == np.int32
    assert mesh.bezier.creases()["bz_crease"].dtype == np.int32
    assert mesh.bezier.curvature().active_scalars_name == "bz_mean_curvature"


@pytest.mark.parametrize(
    ("name", "shown"),
    [
        ("curvature", "bz_mean_curvature"),
        ("torsion", "bz_geodesic_torsion"),
        ("smooth", "bz_displacement"),
        ("creases", "bz_crease"),
        ("fill_holes", "bz_new"),
    ],
)
def test_the_first_field_is_shown(name, shown):
    holed = bf.to_pyvista(SHAPE.vertices, SHAPE.faces[4:])
    assert getattr(holed.bezier, name)().active_scalars_name == shown


def test_filled_meshes_keep_their_active_scalars():
    curved = bf.to_pyvista(SHAPE.vertices, SHAPE.faces[4:]).bezier.curvature()
    assert curved.bezier.fill_holes().active_scalars_name == "bz_mean_curvature"


def test_a_plot_has_the_colors_of_the_field(mesh):
    made = mesh.bezier.curvature()
    made["bz_mean_curvature"][0] = 1e6  # a value that would take all colours
    limits = field_colors("bz_mean_curvature", made["bz_mean_curvature"]).limits
    drawn = []
    image = made.bezier.plot(
        off_screen=True,
        screenshot=True,
        window_size=(200, 200),
        before_close_callback=lambda plotter: drawn.append(plotter.scalar_bars["bz_mean_curvature"]),
    )
    assert drawn[0].GetLookupTable().GetRange() == limits
    red, blue = image[..., 0].astype(int), image[..., 2].astype(int)
    assert (np.abs(red - blue) > 60).mean() > 0.05


def test_fitted_normals_are_active_and_follow_the_mesh(mesh):
    rng = np.random.default_rng(0)
    fitted = bf.to_pyvista(SHAPE.vertices + rng.normal(scale=0.02, size=SHAPE.vertices.shape), SHAPE.faces)
    fitted = fitted.bezier.normals()
    assert fitted.point_data.active_normals_name == "bz_normal"
    smoothed = fitted.bezier.smooth()
    plain = bf.to_pyvista(smoothed.points, SHAPE.faces).compute_normals(split_vertices=False, consistent_normals=False)
    assert smoothed.point_data.active_normals_name == "bz_normal"
    np.testing.assert_allclose(smoothed["bz_normal"], plain.point_data["Normals"], atol=1e-6)
    holed = mesh.remove_cells(range(6)).bezier.normals()
    closed = holed.bezier.fill_holes()
    np.testing.assert_array_equal(closed["bz_normal"][: holed.n_points], holed["bz_normal"])
    np.testing.assert_array_equal(
        closed["bz_rings_used"], np.pad(holed["bz_rings_used"], (0, closed.n_points - holed.n_points))
    )
    assert closed["bz_rings_used"].dtype == np.int32
    np.testing.assert_allclose(np.linalg.norm(closed["bz_normal"], axis=1), 1.0, atol=1e-6)


def test_smoothing_moves_points():
    noisy = SHAPE.vertices + np.random.default_rng(0).normal(scale=0.02, size=SHAPE.vertices.shape)
    made = bf.to_pyvista(noisy, SHAPE.faces).bezier.smooth(borders="fixed")
    np.testing.assert_array_equal(made.points, bf.smooth(noisy, SHAPE.faces, borders="fixed").vertices)


@pytest.mark.parametrize("active", [True, False])
def test_normals_are_those_of_the_smoothed_mesh(active):
    """Of points and of cells, whether VTK knows them as normals or not."""
    noisy = SHAPE.vertices + np.random.default_rng(0).normal(scale=0.03, size=SHAPE.vertices.shape)
    mesh = bf.to_pyvista(noisy, SHAPE.faces).compute_normals(split_vertices=False, consistent_normals=False)
    before = mesh.copy()
    if not active:
        for data in (mesh.point_data, mesh.cell_data):
            data["normals"] = data.pop("Normals")
    name = "Normals" if active else "normals"
    made = mesh.bezier.smooth()
    plain = bf.to_pyvista(made.points, SHAPE.faces).compute_normals(split_vertices=False, consistent_normals=False)
    for data, wanted, old in (
        (made.point_data, plain.point_data["Normals"], before.point_data["Normals"]),
        (made.cell_data, plain.cell_data["Normals"], before.cell_data["Normals"]),
    ):
        np.testing.assert_allclose(data[name], wanted, atol=1e-6)
        assert np.abs(wanted - old).max() > 0.1
        assert (data.active_normals_name == name) == active
    np.testing.assert_array_equal(mesh.point_data[name], before.point_data["Normals"])
    assert "Normals" not in bf.to_pyvista(noisy, SHAPE.faces).bezier.smooth().point_data


def test_polygons_have_normals_after_smoothing():
    rng = np.random.default_rng(0)
    quads = pyvista.Plane(i_resolution=12, j_resolution=12).compute_normals(split_vertices=False)
    quads.points = quads.points + rng.normal(scale=0.01, size=quads.points.shape)
    made = quads.bezier.smooth()
    assert made.n_cells == 144
    flat = made.compute_normals(split_vertices=False, consistent_normals=False)
    np.testing.assert_allclose(made.point_data["Normals"], flat.point_data["Normals"], atol=1e-6)
    np.testing.assert_allclose(made.cell_data["Normals"], flat.cell_data["Normals"], atol=1e-6)


def test_holes_are_filled(mesh):
    made = bf.to_pyvista(SHAPE.vertices, SHAPE.faces[4:]).bezier.fill_holes()
    assert made.n_open_edges == 0
    assert made.is_all_triangles


def test_polygons_stay():
    quads = pyvista.Plane(i_resolution=8, j_resolution=8)
    made = quads.bezier.curvature()
    assert not made.is_all_triangles
    assert np.abs(made["bz_mean_curvature"]).max() < 1e-6


def test_a_point_cloud_has_normals():
    made = pyvista.PolyData(SHAPE.vertices).bezier.normals()
    assert (np.einsum("ij,ij->i", made["bz_normal"], SHAPE.normals) > 0.9).all()
    np.testing.assert_array_equal(made.active_normals, made["bz_normal"])


def test_sharp_edges_have_codes():
    made = bf.to_pyvista(*block_with_sharp_edges(resolution=8)).bezier.creases(angle=30.0)
    assert set(made["bz_crease"]) >= {0.0, 2.0}


def test_errors_are_those_of_the_filters(mesh):
    with pytest.raises(bf.InvalidParameterError, match="iterations"):
        mesh.bezier.smooth(iterations=0)
    with pytest.raises(bf.InvalidMeshError):
        pyvista.PolyData(SHAPE.vertices).bezier.creases()


def test_help_has_the_parameters():
    assert "keepvolume" in pyvista_accessor.BezierAccessor.smooth.__doc__
    assert doctest.testmod(pyvista_accessor).failed == 0


def test_the_example_of_the_page_runs(capsys):
    page = (Path(__file__).parents[2] / "docs" / "adapters.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"```py\n(.*?)```", page, re.DOTALL)
    exec(compile(code, "page", "exec"), {})
    mean, open_edges = capsys.readouterr().out.split()
    assert abs(float(mean) - 1 / 2) < 0.02
    assert open_edges == "0"


def test_polygons_may_have_different_sizes():
    mixed = pyvista.PolyData(
        [[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0, 0]], faces=[4, 0, 1, 2, 3, 3, 1, 4, 2]
    )
    vertices, faces = bf.mesh_arrays(mixed)
    assert (len(vertices), len(faces)) == (5, 3)
