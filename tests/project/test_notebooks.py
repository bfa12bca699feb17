"""What notebooks show of results, and meshes of other libraries."""

import xml.etree.ElementTree as ElementTree

import numpy as np
import pymeshlab
import pytest
import pyvista
import trimesh

import bezier_filters as bf
from bezier_filters.surfaces import block_with_sharp_edges, torus


@pytest.fixture(scope="module")
def shape():
    return torus(resolution=12)


@pytest.fixture(scope="module")
def geometry(shape):
    return bf.estimate_vertex_geometry(shape.vertices, shape.faces, rings=2, alpha=0.99)


def cells(html):
    """Rows of cells of all tables; the HTML is well formed."""
    root = ElementTree.fromstring(f"<div>{html}</div>")
    return [[cell.text or "" for cell in row] for row in root.iter("tr")]


class TestRichResults:
    def test_geometry(self, shape, geometry):
        rows = {row[0]: row[1:] for row in cells(geometry._repr_html_())}
        assert rows["mean_curvature"] == [
            "1/length",
            *(f"{f(geometry.mean_curvature):.4g}" for f in (np.min, np.median, np.max)),
        ]
        assert rows["fitted as asked"][1] == f"{len(shape.vertices):,}"
        assert f"{len(shape.vertices)} vertices: {{'OK'" in repr(geometry)
        assert len(repr(geometry)) < 300

    def test_geometry_without_any_estimate(self):
        g = bf.estimate_vertex_geometry([[0.0, 0, 0], [1, 0, 0]], None)
        rows = {row[0]: row[1:] for row in cells(g._repr_html_())}
        assert rows["k_min"] == ["1/length", "", "", ""]

    def test_smoothing(self, shape):
        result = bf.smooth(shape.vertices, shape.faces, "paper")
        rows = {row[0]: row[1:] for row in cells(result._repr_html_())}
        assert rows["volume"] == ["length³", f"{result.volume_before:.4g}", f"{result.volume_after:.4g}"]
        assert len(repr(result)) < 300

    def test_creases(self):
        """A cube without one of its eight octants: three of its edges, each half as long, are concave."""
        found = bf.find_creases(*block_with_sharp_edges(resolution=8))
        header, *rows = cells(found._repr_html_())
        assert header == ["", "lines", "length [length]", "strongest"]
        by_kind = {row[0]: row[1:] for row in rows}
        assert list(by_kind) == ["sharp ridges", "ridges", "sharp ravines", "ravines"]
        assert by_kind["sharp ravines"][:2] == ["3", "1.5"]
        assert by_kind["ridges"] == ["0", "0", ""]
        assert repr(found) == f"Creases({len(found.of_kind('ridge'))} ridges, 3 ravines)"
        assert all(len(repr(line)) < 100 for line in found.lines)

    def test_holes(self, shape):
        open_faces = shape.faces[6:]
        result = bf.fill_holes(shape.vertices, open_faces)
        rows = cells(result._repr_html_())
        assert len(rows) == 1 + len(result.holes)
        assert rows[1][0] == str(result.holes[0].edge_count)
        assert f"{result.filled} of {len(result.holes)} holes filled" in repr(result)


class TestConverters:
    def test_pyvista_has_the_fields_and_gives_the_mesh_back(self, shape, geometry):
        mesh = bf.to_pyvista(shape.vertices, shape.faces, geometry)
        np.testing.assert_array_equal(mesh["bz_direction_max"], geometry.direction_max)
        np.testing.assert_array_equal(mesh["bz_shape_index"], geometry.shape_index)
        assert mesh["bz_rings_used"].dtype == mesh["bz_fit_grade"].dtype == np.int32
        np.testing.assert_array_equal(mesh.active_normals, geometry.normals)
        vertices, faces = bf.mesh_arrays(mesh)
        np.testing.assert_array_equal(vertices, shape.vertices)
        np.testing.assert_array_equal(faces, shape.faces)
        assert mesh.n_open_edges == 0

    def test_trimesh_has_the_fields_and_gives_the_mesh_back(self, shape, geometry):
        mesh = bf.to_trimesh(shape.vertices, shape.faces, geometry)
        assert mesh.is_watertight
        np.testing.assert_array_equal(mesh.vertex_attributes["bz_k_min"], geometry.k_min)
        np.testing.assert_allclose(mesh.vertex_normals, geometry.normals, atol=1e-12)
        vertices, faces = bf.mesh_arrays(mesh)
        np.testing.assert_array_equal(vertices, shape.vertices)
        np.testing.assert_array_equal(faces, shape.faces)

    def test_arrays_are_copies(self, shape):
        before = shape.vertices.copy()
        mesh = bf.to_pyvista(shape.vertices, shape.faces)
        mesh.points += 1.0
        other = bf.to_trimesh(shape.vertices, shape.faces)
        other.vertices += 1.0
        np.testing.assert_array_equal(shape.vertices, before)

    def test_pymeshlab_and_files(self, shape, tmp_path):
        ms = pymeshlab.MeshSet()
        ms.add_mesh(pymeshlab.Mesh(shape.vertices, shape.faces))
        ms.save_current_mesh(str(tmp_path / "torus.ply"))
        for source in (ms, ms.current_mesh(), tmp_path / "torus.ply", str(tmp_path / "torus.ply")):
            vertices, faces = bf.mesh_arrays(source)
            np.testing.assert_allclose(vertices, shape.vertices, atol=1e-6)
            np.testing.assert_array_equal(faces, shape.faces)

    def test_polygons_and_points(self):
        box = pyvista.Box()
        vertices, faces = bf.mesh_arrays(box)
        assert faces.shape == (12, 3)
        np.testing.assert_array_equal(vertices, box.points)
        points = bf.to_pyvista(vertices, None, {"x": vertices[:, 0]})
        assert points.n_points == len(vertices)
        assert bf.mesh_arrays(trimesh.PointCloud(vertices))[1].shape == (0, 3)

    def test_mistakes_name_the_remedy(self, shape):
        with pytest.raises(bf.InvalidMeshError, match=r"got dict, expected a mesh of pyvista"):
            bf.mesh_arrays({})
        with pytest.raises(bf.InvalidParameterError, match=r"'a' has the shape \(2,\), expected \d+ rows"):
            bf.to_pyvista(shape.vertices, shape.faces, {"a": [1, 2]})
        sphere = pyvista.Sphere()
        with pytest.raises(bf.InvalidMeshError, match=r"pass mesh.regular_faces, or use mesh_arrays"):
            bf.estimate_vertex_geometry(sphere.points, sphere.faces)
