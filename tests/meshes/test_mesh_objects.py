"""Meshes of other libraries: all their faces, or an error."""

from types import SimpleNamespace

import numpy as np
import pymeshlab
import pytest

import bezier_filters as bf
from bezier_filters.surfaces import torus

SHAPE = torus(resolution=16)
PAIR = SHAPE.vertices, SHAPE.faces


def open3d():
    return pytest.importorskip("open3d", reason="Open3D is not installed, or does not load", exc_type=ImportError)


def of_open3d():
    o3d = open3d()
    vertices, faces = o3d.utility.Vector3dVector(SHAPE.vertices), o3d.utility.Vector3iVector(SHAPE.faces)
    return o3d.geometry.TriangleMesh(vertices, faces)


def of_open3d_tensors():
    mesh = of_open3d()
    return open3d().t.geometry.TriangleMesh.from_legacy(mesh)


def of_meshlib():
    library = pytest.importorskip("meshlib.mrmeshnumpy", reason="MeshLib is not installed")
    return library.meshFromFacesVerts(SHAPE.faces, SHAPE.vertices)


def of_meshset():
    ms = pymeshlab.MeshSet()
    ms.add_mesh(pymeshlab.Mesh(*PAIR))
    return ms


def of_grid():
    """Polygons as cells of a grid, as meshio and files for ParaView hold them."""
    pytest.importorskip("pyvista")
    return bf.to_pyvista(*PAIR).cast_to_unstructured_grid()


def of_vedo():
    return pytest.importorskip("vedo", reason="vedo is not installed").Mesh([SHAPE.vertices, SHAPE.faces])


def of_vtk():
    """A `vtkPolyData` that is none of pyvista's."""
    pytest.importorskip("pyvista")
    from vtkmodules.vtkCommonDataModel import vtkPolyData

    mesh = vtkPolyData()
    mesh.ShallowCopy(bf.to_pyvista(*PAIR))
    return mesh


def of_trimesh():
    pytest.importorskip("trimesh")
    return bf.to_trimesh(*PAIR)


def of_meshio():
    """What `meshio.Mesh` looks like: points, and blocks of cells of one type."""
    blocks = [("vertex", [[0]]), ("triangle", SHAPE.faces[:40]), ("line", [[0, 1]]), ("triangle", SHAPE.faces[40:])]
    cells = [SimpleNamespace(type=name, data=np.array(data)) for name, data in blocks]
    return SimpleNamespace(points=SHAPE.vertices, cells=cells)


SOURCES = {
    "Open3D": of_open3d,
    "Open3D tensors": of_open3d_tensors,
    "MeshLib": of_meshlib,
    "MeshSet": of_meshset,
    "grid": of_grid,
    "surface": lambda: SHAPE,
    "triangle mesh": lambda: bf.triangle_mesh(*PAIR),
    "vedo": of_vedo,
    "VTK": of_vtk,
    "scene": lambda: of_trimesh().scene(),
    "meshio": of_meshio,
    "triangles": lambda: SimpleNamespace(vertices=SHAPE.vertices, triangles=SHAPE.faces),
    "pair": lambda: PAIR,
    "list": lambda: [SHAPE.vertices.tolist(), SHAPE.faces.tolist()],
}


@pytest.mark.parametrize("make", SOURCES.values(), ids=SOURCES)
def test_all_faces_are_there(make):
    vertices, faces = bf.mesh_arrays(make())
    np.testing.assert_allclose(vertices, SHAPE.vertices, atol=1e-6)
    np.testing.assert_array_equal(faces, SHAPE.faces)
    assert (vertices.dtype, faces.dtype) == (np.float64, np.int32)


FUNCTIONS = {
    "estimate_vertex_geometry": lambda mesh: bf.estimate_vertex_geometry(mesh, rings=2, alpha=0.9).k_max,
    "smooth": lambda mesh: bf.smooth(mesh, "paper").vertices,
    "fill_holes": lambda mesh: bf.fill_holes(mesh, "paper", max_edges=9).faces,
    "bridge_holes": lambda mesh: bf.bridge_holes(mesh, "auto").faces,
    "replace_selection": lambda mesh: bf.replace_selection(mesh, np.arange(len(SHAPE.faces)) < 6).faces,
    "subdivide": lambda mesh: bf.subdivide(mesh, noise=0.0).faces,
    "remesh": lambda mesh: bf.remesh(mesh, iterations=1, noise=0.0).faces,
    "find_creases": lambda mesh: bf.find_creases(mesh, GEOMETRY).sharp_edges,
    "vertex_patch": lambda mesh: bf.vertex_patch(mesh, 7).heights,
    "triangle_mesh": lambda mesh: bf.triangle_mesh(mesh).faces,
    "boundary_loops": bf.boundary_loops,
    "vertex_adjacency": lambda mesh: bf.vertex_adjacency(mesh).vertices.indices,
    "inspect_mesh": lambda mesh: [bf.inspect_mesh(mesh).mean_edge_length],
    "diagnose": lambda mesh: np.array(bf.diagnose(mesh)),
    "to_trimesh": lambda mesh: bf.to_trimesh(mesh).faces,
    "show": lambda mesh: np.array(bf.show(mesh, GEOMETRY).html),
}
GEOMETRY = bf.estimate_vertex_geometry(*PAIR, rings=2, alpha=0.9)


@pytest.mark.parametrize("function", FUNCTIONS.values(), ids=FUNCTIONS)
def test_functions_of_arrays_take_mesh_objects(function):
    """With the results that their arrays give."""
    pytest.importorskip("trimesh")
    expected = function(SHAPE)
    for make in (of_trimesh, of_vtk, of_meshset, of_grid, of_meshio):
        np.testing.assert_array_equal(function(make()), expected)


@pytest.mark.parametrize("make", [v for k, v in SOURCES.items() if k not in ("pair", "list")])
def test_mesh_objects_come_without_faces(make):
    mesh = make()
    assert len(bf.triangle_mesh(mesh, None).faces) == len(SHAPE.faces)
    for function in (bf.smooth, bf.triangle_mesh, bf.boundary_loops, bf.inspect_mesh):
        with pytest.raises(bf.InvalidMeshError, match=rf"faces: got both a {type(mesh).__name__} and"):
            function(mesh, SHAPE.faces)
    with pytest.raises(bf.InvalidMeshError, match="faces: got both"):
        bf.smooth(mesh, faces=SHAPE.faces)


def test_results_are_meshes_if_they_have_faces():
    filled = bf.fill_holes(SHAPE.vertices, SHAPE.faces[4:])
    assert not bf.boundary_loops(filled)
    smoothed = bf.smooth(*PAIR, "paper")
    with pytest.raises(bf.InvalidMeshError, match="got SmoothingResult, which has no faces; pass its vertices"):
        bf.estimate_vertex_geometry(smoothed)


def test_clouds_need_no_faces():
    expected = bf.estimate_vertex_geometry(SHAPE.vertices, None, rings=2).k_max
    trimesh = pytest.importorskip("trimesh")
    for cloud in (SHAPE.vertices, trimesh.PointCloud(SHAPE.vertices), bf.to_pyvista(SHAPE.vertices)):
        np.testing.assert_array_equal(bf.estimate_vertex_geometry(cloud, rings=2).k_max, expected)
        with pytest.raises(bf.InvalidMeshError, match=r"faces: got None, .* this needs a surface"):
            bf.fill_holes(cloud)


def test_paths_are_no_mesh_objects():
    for function in (bf.estimate_vertex_geometry, bf.smooth, bf.to_pyvista):
        with pytest.raises(bf.InvalidMeshError, match=r"got a str, expected an array .*mesh_arrays.* reads files"):
            function("scan.ply")


def test_removed_faces_of_meshlib_are_gone():
    mesh = of_meshlib()
    import meshlib.mrmeshpy

    removed = meshlib.mrmeshpy.FaceBitSet()
    removed.resize(len(SHAPE.faces))
    for k in (3, 4, 7):
        removed.set(meshlib.mrmeshpy.FaceId(k), True)
    mesh.topology.deleteFaces(removed)
    np.testing.assert_array_equal(bf.triangle_mesh(mesh).faces, np.delete(SHAPE.faces, [3, 4, 7], axis=0))


@pytest.mark.parametrize("faces", [SHAPE.faces, None])
def test_open3d_has_the_fields_and_gives_the_mesh_back(faces):
    open3d()
    mesh = bf.to_open3d(SHAPE.vertices, faces, GEOMETRY)
    vertices, corners = bf.mesh_arrays(mesh)
    np.testing.assert_array_equal(vertices, SHAPE.vertices)
    np.testing.assert_array_equal(corners, np.empty((0, 3)) if faces is None else faces)
    attributes = mesh.point if faces is None else mesh.vertex
    np.testing.assert_array_equal(attributes["bz_direction_max"].numpy(), GEOMETRY.direction_max)
    np.testing.assert_array_equal(attributes["bz_k_min"].numpy(), GEOMETRY.k_min)
    np.testing.assert_array_equal(attributes["normals"].numpy(), GEOMETRY.normals)
    assert attributes["bz_rings_used"].numpy().dtype == np.int32


def test_polygons_become_triangles():
    vedo = pytest.importorskip("vedo", reason="vedo is not installed")
    vertices, faces = bf.mesh_arrays(vedo.Cube(side=2.0))
    a, b, c = vertices[faces].transpose(1, 0, 2)
    np.testing.assert_allclose(np.linalg.norm(np.cross(b - a, c - a), axis=1), np.full(12, 4.0))  # twice their areas
    quads = SimpleNamespace(
        points=SHAPE.vertices[:4], cells=[SimpleNamespace(type="quad", data=np.array([[0, 1, 2, 3]]))]
    )
    np.testing.assert_array_equal(bf.mesh_arrays(quads)[1], [[0, 1, 2], [0, 2, 3]])


def test_strips_become_triangles():
    pytest.importorskip("pyvista")
    import pyvista

    strips = bf.to_pyvista(*PAIR).strip()
    assert strips.n_strips
    vertices, faces = bf.mesh_arrays(strips)
    assert len(faces) == len(SHAPE.faces)
    assert bf.inspect_mesh(vertices, faces).boundary_edges == 0
    assert bf.mesh_arrays(pyvista.PolyData())[0].shape == (0, 3)


def test_what_moved_in_vedo_is_where_it_is_seen():
    mesh = of_vedo().scale(2.0).pos(1.0, 2.0, 3.0)
    np.testing.assert_allclose(bf.mesh_arrays(mesh)[0], 2.0 * SHAPE.vertices + np.array([1.0, 2.0, 3.0]), atol=1e-5)


def test_meshes_of_a_scene_are_in_their_places():
    trimesh = pytest.importorskip("trimesh")
    scene, place = trimesh.Scene(), np.diag([2.0, 2.0, 2.0, 1.0])
    place[:3, 3] = 9.0, 0.0, 0.0
    scene.add_geometry(of_trimesh())
    scene.add_geometry(of_trimesh(), transform=place)
    vertices, faces = bf.mesh_arrays(scene)
    n = len(SHAPE.vertices)
    np.testing.assert_allclose(vertices, np.vstack([SHAPE.vertices, 2.0 * SHAPE.vertices + np.array([9.0, 0.0, 0.0])]))
    np.testing.assert_array_equal(faces, np.vstack([SHAPE.faces, SHAPE.faces + n]))


def test_point_clouds_stay_point_clouds():
    trimesh = pytest.importorskip("trimesh")
    clouds = [trimesh.PointCloud(SHAPE.vertices), trimesh.Scene([trimesh.PointCloud(SHAPE.vertices)])]
    clouds += [(SHAPE.vertices, None), bf.to_pyvista(SHAPE.vertices, None)]
    for cloud in clouds:
        vertices, faces = bf.mesh_arrays(cloud)
        np.testing.assert_array_equal(vertices, SHAPE.vertices)
        assert faces.shape == (0, 3)


def test_point_clouds_of_open3d():
    o3d = open3d()
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(SHAPE.vertices))
    for source in (cloud, o3d.t.geometry.PointCloud.from_legacy(cloud)):
        vertices, faces = bf.mesh_arrays(source)
        np.testing.assert_allclose(vertices, SHAPE.vertices, atol=1e-6)
        assert faces.shape == (0, 3)


@pytest.mark.parametrize("name", ["TetraMesh", "LineSet", "VoxelGrid"])
def test_what_is_no_surface_in_open3d_is_refused(name):
    with pytest.raises(bf.InvalidMeshError, match=rf"mesh: got {name}"):
        bf.mesh_arrays(getattr(open3d().geometry, name)())


def test_faces_that_are_not_understood_are_refused():
    pyvista, trimesh = pytest.importorskip("pyvista"), pytest.importorskip("trimesh")
    mixed = trimesh.Scene([of_trimesh(), trimesh.PointCloud(SHAPE.vertices)])
    tetrahedra = SimpleNamespace(
        points=SHAPE.vertices, cells=[SimpleNamespace(type="tetra", data=np.array([[0, 1, 2, 3]]))]
    )
    for source, message in [
        (pyvista.ImageData(dimensions=(2, 2, 2)), "not a surface; .*extract_surface"),
        (pyvista.Box().delaunay_3d(), "not a surface; .*extract_surface"),
        (pyvista.MultiBlock([pyvista.Sphere()]), "not a surface"),
        (trimesh.load_path(SHAPE.vertices[:3]), "whose entities cannot be read"),
        (mixed, "meshes and point clouds"),
        (trimesh.Scene(), "which is empty"),
        (tetrahedra, "cells of the type 'tetra' cannot be read"),
        (SimpleNamespace(vertices=SHAPE.vertices, polygons=[]), "whose polygons cannot be read"),  # as in Blender
        ((SHAPE.vertices,), "got a tuple of 1, expected a mesh of pyvista, VTK"),
    ]:
        with pytest.raises(bf.InvalidMeshError, match=message):
            bf.mesh_arrays(source)


@pytest.mark.parametrize("coordinates", ["points", "vertices"])
@pytest.mark.parametrize(
    "name", ["tets", "face", "Cells", "cell_array", "triangle_indices", "line", "edges", "simplices", "f", "T"]
)
def test_other_connectivity_is_refused(coordinates, name):
    """By the name of the attribute, or because its array holds indices."""
    tetrahedra = np.array([[0, 1, 2, 3]])
    for more in ({}, {"faces": None}):
        source = SimpleNamespace(**{coordinates: SHAPE.vertices, name: tetrahedra, **more})
        with pytest.raises(bf.InvalidMeshError, match=f"whose {name} cannot be read as triangles"):
            bf.mesh_arrays(source)


def test_other_attributes_of_points_do_not_matter():
    n = len(SHAPE.vertices)
    colors, scalars = np.zeros((n, 3), np.uint8), {"color": np.zeros((3, 2), np.int64)}
    source = SimpleNamespace(points=SHAPE.vertices, colors=colors, labels=np.arange(7), data=scalars, faces=None)
    vertices, faces = bf.mesh_arrays(source)
    np.testing.assert_array_equal(vertices, SHAPE.vertices)
    assert faces.shape == (0, 3)


def test_lines_are_no_point_cloud():
    pyvista = pytest.importorskip("pyvista")
    edges = bf.to_pyvista(*PAIR).extract_all_edges()
    for source in (pyvista.Line(resolution=5), edges):
        with pytest.raises(bf.InvalidMeshError, match="PolyData, whose lines cannot be read as triangles"):
            bf.mesh_arrays(source)
    surface = bf.to_pyvista(*PAIR)
    surface.lines = [2, 0, 1]  # as a mark on it
    assert len(bf.mesh_arrays(surface)[1]) == len(SHAPE.faces)


@pytest.mark.parametrize("nothing", [None, 3, {}, SHAPE.vertices, [], object(), 1j])
def test_what_is_no_mesh_is_refused(nothing):
    with pytest.raises(bf.InvalidMeshError, match=r"mesh: got .* expected a mesh of pyvista"):
        bf.mesh_arrays(nothing)


class TestLayers:
    """Of napari, or what looks like one."""

    class Layer:
        def __init__(self, scale):
            self.vertices, self.faces = SHAPE.vertices / scale, SHAPE.faces
            self.scale = np.array(scale)

        def data_to_world(self, position):
            return tuple(self.scale * position + [1.0, 2.0, 3.0])

    @pytest.mark.parametrize("scale", [(2.0, 0.5, 0.25), (2.0, -0.5, 0.25)])
    def test_they_are_where_they_are_seen(self, scale):
        vertices, faces = bf.mesh_arrays(self.Layer(scale))
        np.testing.assert_allclose(vertices, SHAPE.vertices + np.array([1.0, 2.0, 3.0]), atol=1e-12)
        np.testing.assert_array_equal(np.sort(faces, axis=1), np.sort(SHAPE.faces, axis=1))
        assert (faces == SHAPE.faces).all() == (min(scale) > 0)

    def test_layers_in_the_plane_are_refused(self):
        layer = self.Layer((1.0, 1.0, 1.0))
        layer.vertices = layer.vertices[:, :2]
        with pytest.raises(bf.InvalidMeshError, match=r"surface layer of shape \(\d+, 2\)"):
            bf.smooth(layer)

    def test_other_layers_are_refused(self):
        with pytest.raises(bf.InvalidMeshError, match="expected a surface layer"):
            bf.mesh_arrays(SimpleNamespace(data_to_world=None, data=[]))
