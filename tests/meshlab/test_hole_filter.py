"""Filling holes in a MeshSet: what is added, what stays, what is refused."""

import json

import numpy as np
import pymeshlab
import pytest
from conftest import full_bunny
from meshset_state import attributes, changed, frozen, layer_state, mesh_state

from bezier_filters.errors import CancelledError
from bezier_filters.holes.hole_filling import fill_holes
from bezier_filters.meshes.half_edges import boundary_loops
from bezier_filters.meshes.mesh import triangle_mesh
from bezier_filters.meshlab.hole_filter import meshing_close_holes_by_bezier_patch
from bezier_filters.meshlab.mesh_growth import textures_of
from bezier_filters.meshlab.meshset import BezierFilterError
from bezier_filters.surfaces import sphere, torus

NORMALS = {"vertex_normal_matrix", "face_normal_matrix"}


@pytest.fixture
def textured(textured):
    return with_columns(textured)


def with_columns(ms):
    """With columns of our own, too."""
    mesh = ms.current_mesh()
    mesh.add_vertex_custom_scalar_attribute(np.ones(mesh.vertex_number()), "bz_k_min")
    mesh.add_vertex_custom_scalar_attribute(np.full(mesh.vertex_number(), 9.0), "bz_fit_grade")
    return ms


@pytest.fixture(scope="module")
def filled(textured_bunny_file):
    """The bunny with everything before and after its holes were filled, to be looked at only, and the report."""
    before, after = pymeshlab.MeshSet(), pymeshlab.MeshSet()
    for ms in (before, after):
        ms.load_new_mesh(str(textured_bunny_file))
        with_columns(full_bunny(ms))
    assert changed(mesh_state(before), mesh_state(after)) == set()
    return before, after, meshing_close_holes_by_bezier_patch(after)


def arrays(ms):
    mesh = ms.current_mesh()
    return mesh.vertex_matrix(), mesh.face_matrix()


def thawed(value):
    kind, shape, data = value
    return np.frombuffer(data, kind).reshape(shape)


def punctured_torus(seam=False):
    """A torus with a hole; with a seam, the vertices of a curve twice, as where textures are cut."""
    surface = torus(resolution=24, jitter=0.3)
    centers = surface.vertices[surface.faces].mean(axis=1)
    away_from_the_seam = [0.0, 1.0, 0.4] if seam else [1.0, 0.0, 0.4]
    faces = surface.faces[np.linalg.norm(centers - away_from_the_seam, axis=1) > 0.2]
    vertices = surface.vertices
    if seam:
        upper = vertices[faces].mean(axis=1)[:, 1] > 0
        shared = np.intersect1d(faces[upper], faces[~upper])
        number = np.arange(len(vertices))
        number[shared] = len(vertices) + np.arange(len(shared))
        faces = np.where(upper[:, None], number[faces], faces)
        vertices = np.vstack([vertices, vertices[shared]])
    ms = pymeshlab.MeshSet()
    ms.add_mesh(pymeshlab.Mesh(vertices, faces), "ring")
    return ms


def test_the_mesh_is_that_of_the_array_function(filled):
    before, after, report = filled
    expected = fill_holes(*arrays(before))
    vertices, faces = arrays(after)
    np.testing.assert_array_equal(vertices, expected.vertices)
    np.testing.assert_array_equal(faces, expected.faces)
    assert report["closed_holes"] == expected.filled == 5
    assert report["open_holes"] == 0
    alone = pymeshlab.MeshSet()  # since pymeshlab's filter changes what is selected
    alone.add_mesh(pymeshlab.Mesh(vertices, faces))
    assert alone.get_topological_measures()["boundary_edges"] == 0


def test_everything_old_stays(filled):
    open_one, closed_one, report = filled
    before, after = (
        layer_state(ms.current_mesh()) | {k: frozen(v) for k, v in attributes(ms).items()}
        for ms in (open_one, closed_one)
    )
    others = {key: value for key, value in mesh_state(open_one).items() if key.startswith("1: ")}
    script = mesh_state(open_one)["script"]
    count = open_one.current_mesh().vertex_number(), open_one.current_mesh().face_number()
    assert report["lost_attributes"] == []
    assert before.keys() == after.keys()
    vertices, _ = arrays(closed_one)
    np.testing.assert_array_equal(thawed(after["bounding_box"]), [*vertices.min(axis=0), *vertices.max(axis=0)])
    for key, old in before.items():
        if key in {*NORMALS, "bounding_box"}:
            continue
        if old != after[key]:  # then it has more rows
            rows = thawed(old)
            np.testing.assert_array_equal(thawed(after[key])[: len(rows)], rows, err_msg=key)
            assert len(rows) in (*count, 3 * count[1]), key
    state = mesh_state(closed_one)
    assert state["script"] == script
    assert state["current"] == report["id"]
    assert {layer.id() for layer in closed_one} == {1, report["id"]}
    assert others.items() <= state.items()


def test_what_is_new_is_defined(filled):
    before, after, report = filled
    n, m = before.current_mesh().vertex_number(), before.current_mesh().face_number()
    quality, mesh = before.current_mesh().vertex_scalar_array(), after.current_mesh()
    assert mesh.vertex_number() == n + report["new_vertices"] > n
    assert mesh.face_number() == m + report["new_faces"]
    new = slice(n, None)
    assert (mesh.vertex_scalar_array()[new] >= quality.min()).all()
    assert (mesh.vertex_scalar_array()[new] <= quality.max()).all()
    assert (mesh.vertex_custom_scalar_attribute_array("bz_k_min")[new] == 0.0).all()
    assert (mesh.vertex_custom_scalar_attribute_array("bz_fit_grade")[new] == 0.0).all()
    assert np.isin(
        mesh.face_custom_scalar_attribute_array("facemine")[m:], mesh.face_custom_scalar_attribute_array("facemine")[:m]
    ).all()
    np.testing.assert_allclose(np.linalg.norm(mesh.vertex_normal_matrix(), axis=1), 1.0)


def test_quality_and_colours_go_on_into_fills():
    """A linear function is harmonic in the plane: it is continued exactly, and colours to their eight bits."""
    x, y = (0.1 * axis.ravel() for axis in np.meshgrid(np.arange(20.0), np.arange(20.0)))
    corner = np.arange(380).reshape(19, 20)[:, :-1].ravel()
    faces = np.vstack([np.c_[corner, corner + 1, corner + 21], np.c_[corner, corner + 21, corner + 20]])
    vertices = np.c_[x, y, np.zeros_like(x)]
    centers = vertices[faces].mean(axis=1)
    faces = faces[(np.abs(centers - [1.0, 0.9, 0.0]) > 0.4).any(axis=1)].astype(np.int32)
    used, local = np.unique(faces, return_inverse=True)
    vertices = vertices[used]
    shade = np.c_[0.5 * vertices[:, :2], np.full(len(vertices), 0.25), np.ones(len(vertices))]
    ms = pymeshlab.MeshSet()
    mesh = pymeshlab.Mesh(
        vertices,
        local.reshape(-1, 3).astype(np.int32),
        v_scalar_array=3.0 * vertices[:, 0],
        v_color_matrix=shade,
        v_tex_coords_matrix=vertices[:, :2],
    )
    ms.add_mesh(mesh)
    assert meshing_close_holes_by_bezier_patch(ms)["new_vertices"] > 0
    filled = ms.current_mesh()
    where, new = filled.vertex_matrix(), slice(len(vertices), None)
    np.testing.assert_allclose(filled.vertex_scalar_array()[new], 3.0 * where[new, 0], atol=1e-9)
    colors = filled.vertex_color_matrix()
    rounded = 1.51 / 255  # down, and then to the nearest
    np.testing.assert_allclose(colors[new, :2], 0.5 * where[new, :2], atol=rounded)
    assert len(np.unique(colors[:, 2])) == len(np.unique(colors[:, 3])) == 1
    np.testing.assert_allclose(filled.vertex_tex_coord_matrix()[new], where[new, :2], atol=1e-6)  # single precision


def edges_with_coordinates(mesh, faces):
    """The edges of some faces as these run, with the texture coordinates at their ends."""
    corners, wedges = mesh.face_matrix(), mesh.wedge_tex_coord_matrix().reshape(-1, 3, 2)
    return {
        (int(corners[f, k]), int(corners[f, (k + 1) % 3])): (wedges[f, k], wedges[f, (k + 1) % 3])
        for f in faces
        for k in range(3)
    }


def test_new_faces_show_the_texture_of_those_beside_them(filled, tmp_path):
    before, after, report = filled
    m, mesh = before.current_mesh().face_number(), after.current_mesh()
    assert report["textured"]
    new = edges_with_coordinates(mesh, range(m, mesh.face_number()))
    old = edges_with_coordinates(mesh, range(m))
    shared = [(start, end) for start, end in new if (end, start) in old]
    assert len(shared) == sum(hole["edge_count"] for hole in report["holes"])
    faces = mesh.face_matrix()
    face_at = {tuple(faces[f, [k, k - 2]].tolist()): f for f in range(m, len(faces)) for k in range(3)}
    agreeing = {
        face_at[start, end] for start, end in shared if np.allclose(new[start, end], old[end, start][::-1], atol=1e-6)
    }
    assert agreeing == {face_at[edge] for edge in shared}  # a new face with two old neighbours is like one of them
    names, _ = textures_of(after)
    assert names == ["TextureDouble_A.png"]
    after.save_current_mesh(str(tmp_path / "closed.obj"))
    materials = (tmp_path / "closed.obj.mtl").read_text()
    assert materials.count("newmtl") == materials.count("map_Kd TextureDouble_A.png")


def test_texture_coordinates_go_on_into_fills_without_seams(textured, tmp_path):
    """The horizontal coordinates of a hemisphere, which the texture shows from above."""
    textured.current_mesh().texture(0).save(str(tmp_path / "skin.png"))
    ball = sphere(resolution=16)
    centers = ball.vertices[ball.faces].mean(axis=1)
    faces = ball.faces[(centers[:, 2] > -0.1) & (np.linalg.norm(centers - [0.3, 0.1, 0.9], axis=1) > 0.3)]
    used, local = np.unique(faces, return_inverse=True)
    vertices, faces = ball.vertices[used], local.reshape(-1, 3).astype(np.int32)
    ms = pymeshlab.MeshSet()
    wedges = np.ascontiguousarray(vertices[faces].reshape(-1, 3)[:, :2])
    ms.add_mesh(pymeshlab.Mesh(vertices, faces, w_tex_coords_matrix=wedges))
    ms.set_texture_per_mesh(textname=str(tmp_path / "skin.png"))
    assert meshing_close_holes_by_bezier_patch(ms, maxdiameter=1.0)["textured"]
    mesh = ms.current_mesh()
    found, corners = mesh.wedge_tex_coord_matrix(), mesh.face_matrix().ravel()
    truth = mesh.vertex_matrix()[corners, :2]
    np.testing.assert_allclose(found, truth, atol=0.02)  # x is not harmonic on the sphere: its Laplacian is -2 x
    old = corners < len(vertices)
    assert not old[3 * len(faces) :].all()
    np.testing.assert_allclose(found[old], truth[old], atol=1e-6)  # single precision


@pytest.fixture
def two_textures(textured, tmp_path):
    """A torus with a hole at the seam between two textures, and the texture of each of its faces."""
    surface = torus(resolution=24)
    centers = surface.vertices[surface.faces].mean(axis=1)
    faces = surface.faces[np.linalg.norm(centers - [1.0, 0.0, 0.4], axis=1) > 0.2]
    numbers = (surface.vertices[faces].mean(axis=1)[:, 1] > 0.0).astype(int)
    lines = ["ply", "format ascii 1.0", "comment TextureFile z.png", "comment TextureFile a.png"]
    lines += [f"element vertex {len(surface.vertices)}", *(f"property double {axis}" for axis in "xyz")]
    lines += [f"element face {len(faces)}", "property list uchar int vertex_indices"]
    lines += ["property list uchar float texcoord", "property int texnumber", "end_header"]
    lines += [" ".join(map(repr, vertex)) for vertex in surface.vertices.tolist()]
    for face, number in zip(faces.tolist(), numbers.tolist(), strict=True):
        corners = " ".join(f"{x:.6f} {z:.6f}" for x, _, z in surface.vertices[face])
        lines.append(f"3 {' '.join(map(str, face))} 6 {corners} {number}")
    for name in ("z.png", "a.png"):
        textured.current_mesh().texture(0).save(str(tmp_path / name))
    (tmp_path / "torus.ply").write_text("\n".join(lines) + "\n")
    ms = pymeshlab.MeshSet()
    ms.load_new_mesh(str(tmp_path / "torus.ply"))
    return ms, numbers


def test_with_several_textures_each_new_face_shows_that_of_its_neighbour(two_textures):
    ms, before = two_textures
    assert textures_of(ms)[0] == ["z.png", "a.png"]
    report = meshing_close_holes_by_bezier_patch(ms)
    assert report["textured"]
    names, numbers = textures_of(ms)
    assert names == ["z.png", "a.png"]
    m = len(before)
    np.testing.assert_array_equal(numbers[:m], before)
    mesh = ms.current_mesh()
    y = mesh.vertex_matrix()[mesh.face_matrix()[m:]].mean(axis=1)[:, 1]
    clear = np.abs(y) > 0.05
    np.testing.assert_array_equal(numbers[m:][clear], y[clear] > 0.0)
    assert set(numbers[m:].tolist()) == {0, 1}


def test_textures_with_names_that_cannot_be_written_are_reported(textured, tmp_path):
    textured.current_mesh().texture(0).save(str(tmp_path / "my skin.png"))
    ms = punctured_torus()
    vertices, faces = arrays(ms)
    ms.add_mesh(pymeshlab.Mesh(vertices, faces, w_tex_coords_matrix=np.full((3 * len(faces), 2), 0.5)), "skinned")
    ms.set_texture_per_mesh(textname=str(tmp_path / "my skin.png"))
    assert list(ms.current_mesh().textures()) == ["my skin.png"]
    count = len(list(ms))
    report = meshing_close_holes_by_bezier_patch(ms)
    assert report["closed_holes"] == 1
    assert not report["textured"]
    assert len(list(ms)) == count
    assert list(ms.current_mesh().textures()) == ["my skin.png"]


def test_coincident_vertices_stay_apart():
    ms = punctured_torus(seam=True)
    vertices, faces = arrays(ms)
    assert len(np.unique(vertices, axis=0)) < len(vertices)
    expected = fill_holes(vertices, faces)
    assert expected.filled
    meshing_close_holes_by_bezier_patch(ms)
    np.testing.assert_array_equal(ms.current_mesh().vertex_matrix(), expected.vertices)
    np.testing.assert_array_equal(ms.current_mesh().face_matrix(), expected.faces)


def test_new_faces_are_selected_on_request():
    ms = punctured_torus()
    ms.compute_selection_by_condition_per_vertex(condselect="x > 0")
    m = ms.current_mesh().face_number()
    meshing_close_holes_by_bezier_patch(ms, newfaceselected=True)
    selection = ms.current_mesh().face_selection_array()
    assert selection[m:].all()
    assert not selection[:m].any()
    assert not ms.current_mesh().vertex_selection_array().any()


@pytest.mark.parametrize(
    ("options", "closed"),
    [
        ({"maxholesize": 19}, 2),
        ({"maxholesize": 22}, 4),
        ({"maxdiameter": 2.5}, 3),
        ({"maxdiameter": pymeshlab.PercentageValue(50)}, 5),
        ({"maxperimeter": 1e-3}, 0),
    ],
)
def test_which_holes(textured, options, closed):
    """That does not depend on how they are filled."""
    before = mesh_state(textured)
    report = meshing_close_holes_by_bezier_patch(textured, method="paper", **options)
    assert report["closed_holes"] == closed
    assert report["closed_holes"] + report["open_holes"] == 5
    assert all(hole["filled"] or hole["reason"] for hole in report["holes"])
    if not closed:
        assert changed(before, mesh_state(textured)) == set()


def test_only_holes_at_the_selection(textured):
    loop = boundary_loops(triangle_mesh(*arrays(textured)))[1]
    textured.compute_selection_by_condition_per_vertex(condselect=f"vi == {loop[3]}")
    report = meshing_close_holes_by_bezier_patch(textured, onselected=True)
    assert [hole["edge_count"] for hole in report["holes"] if hole["filled"]] == [len(loop)]


def test_report(textured):
    report = meshing_close_holes_by_bezier_patch(textured)
    assert json.loads(json.dumps(report)) == report
    assert sum(hole["new_faces"] for hole in report["holes"]) == report["new_faces"]
    assert {hole["rim_error"] for hole in report["holes"]} == {0.0}
    assert {hole["edge_count"] for hole in report["holes"]} == {8, 19, 22, 38}


def test_a_closed_mesh_stays_as_it_is():
    ms = pymeshlab.MeshSet()
    ms.create_sphere(subdiv=3)
    before = mesh_state(ms)
    report = meshing_close_holes_by_bezier_patch(ms)
    assert report["holes"] == []
    assert changed(before, mesh_state(ms)) == set()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"method": "round"}, "method: got 'round'"),
        ({"maxholesize": 2}, "maxholesize: got 2"),
        ({"maxdiameter": -1.0}, "max_diameter: got -1.0"),
        ({"noise": -1.0}, "noise: got -1.0"),
        ({"method": "paper", "alpha": 0.0}, "alpha: got 0.0"),
        ({"alpha": 0.5}, "alpha: method=.auto. does not use it"),
        ({"threads": 0}, "threads: got 0"),
    ],
)
def test_parameters_are_refused_and_all_stays(textured, options, message):
    before = mesh_state(textured)
    with pytest.raises(BezierFilterError, match=message):
        meshing_close_holes_by_bezier_patch(textured, **options)
    assert changed(before, mesh_state(textured)) == set()


def test_a_point_cloud_is_refused():
    ms = pymeshlab.MeshSet()
    ms.add_mesh(pymeshlab.Mesh(np.random.default_rng(0).random((50, 3))))
    with pytest.raises(BezierFilterError, match="has no faces"):
        meshing_close_holes_by_bezier_patch(ms)


def test_cancelling_leaves_all_as_it_was(textured):
    before = mesh_state(textured)
    with pytest.raises(CancelledError):
        meshing_close_holes_by_bezier_patch(textured, progress=lambda done, total: False)
    assert changed(before, mesh_state(textured)) == set()


@pytest.mark.parametrize(
    "when", ["generate_copy_of_current_mesh", "compute_coord_linear_morphing", "generate_by_merging_visible_meshes"]
)
def test_an_interrupt_while_writing_is_undone(when):
    class Interrupted(pymeshlab.MeshSet):
        armed = False

        def interrupt(self, **options):
            getattr(pymeshlab.MeshSet, when)(self, **options)
            if self.armed:
                self.armed = False
                raise KeyboardInterrupt

    setattr(Interrupted, when, Interrupted.interrupt)
    ms = Interrupted()
    source = punctured_torus()
    ms.add_mesh(pymeshlab.Mesh(*arrays(source)))
    ms.create_cube()
    ms.set_current_mesh(0)
    ms.armed = True
    before = mesh_state(ms)
    with pytest.raises(KeyboardInterrupt):
        meshing_close_holes_by_bezier_patch(ms)
    assert changed(before, mesh_state(ms)) == set()


class TestRepair:
    """What stops hole filling goes away first, on request, by pymeshlab's filters."""

    def repaired(self, vertices, faces, **options):
        ms = pymeshlab.MeshSet()
        ms.add_mesh(pymeshlab.Mesh(vertices, faces))
        without = meshing_close_holes_by_bezier_patch(ms, **options)
        ms = pymeshlab.MeshSet()
        ms.add_mesh(pymeshlab.Mesh(vertices, faces))
        return ms, without, meshing_close_holes_by_bezier_patch(ms, repair=True, **options)

    def test_a_hole_at_a_seam_is_welded_and_filled(self):
        surface = torus(resolution=24)
        upper = surface.vertices[surface.faces].mean(axis=1)[:, 1] > 0
        centers = surface.vertices[surface.faces].mean(axis=1)
        shared = np.intersect1d(surface.faces[upper], surface.faces[~upper])
        number = np.arange(len(surface.vertices))
        number[shared] = len(number) + np.arange(len(shared))
        faces = np.where(upper[:, None], number[surface.faces], surface.faces)
        faces = faces[np.linalg.norm(centers - [1.0, 0.0, 0.4], axis=1) > 0.2]
        ms, without, report = self.repaired(np.vstack([surface.vertices, surface.vertices[shared]]), faces)
        assert without["repaired"] is None
        assert without["closed_holes"] == 0
        assert report["closed_holes"] == len(report["holes"]) == 1
        assert report["repaired"] == {
            "welded_vertices": len(shared), "split_vertices": 0, "removed_faces": 0, "turned_faces": 0
        }  # fmt: skip
        assert report["topology_after"]["boundary_edges"] == 0
        assert ms.get_topological_measures()["genus"] == 1

    def test_a_fin_is_split_off(self):
        ball = sphere(resolution=12)
        faces = ball.faces[ball.vertices[ball.faces].mean(axis=1)[:, 2] < 0.9]
        a, b = next(face[:2] for face in faces if (ball.vertices[face, 2] < -0.9).all())
        vertices = np.vstack([ball.vertices, 1.5 * ball.vertices[a]])
        ms, without, report = self.repaired(vertices, np.vstack([faces, [[a, b, len(vertices) - 1]]]))
        assert [hole["filled"] for hole in without["holes"]].count(False) == 1
        assert report["repaired"]["split_vertices"] == 2
        assert report["closed_holes"] == 1
        assert ms.get_topological_measures()["is_mesh_two_manifold"]

    def test_few_faces_turn_rather_than_many(self):
        ball = sphere(resolution=12)
        height = ball.vertices[ball.faces].mean(axis=1)[:, 2]
        faces = ball.faces[height < 0.9].copy()
        turned = height[height < 0.9] > 0.6
        faces[turned] = faces[turned][:, ::-1]
        faces = faces[np.argsort(~turned, kind="stable")]  # pymeshlab turns all to the first face
        ms, without, report = self.repaired(ball.vertices, faces)
        assert without["closed_holes"] == 1  # faces disagree elsewhere
        assert report["repaired"]["turned_faces"] == turned.sum()
        assert ms.get_geometric_measures()["mesh_volume"] > 0

    def test_faces_that_are_there_twice_go(self):
        """Both sides of every face, as exporters write them: splitting their edges would not end."""
        ball = sphere(resolution=12)
        faces = ball.faces[ball.vertices[ball.faces].mean(axis=1)[:, 2] < 0.9]
        ms, _, report = self.repaired(ball.vertices, np.vstack([faces, faces[:, ::-1]]))
        assert report["repaired"]["removed_faces"] == len(faces)
        assert report["closed_holes"] == 1
        assert ms.get_topological_measures()["boundary_edges"] == 0

    def test_a_lattice_is_split_into_sheets(self):
        """Boxes that share their walls: each edge inside has four faces."""
        axis = np.arange(4)
        x, y, z = (part.ravel() for part in np.meshgrid(axis, axis, axis, indexing="ij"))
        number = np.arange(64).reshape(4, 4, 4)
        faces = []
        for turned in (number, number.transpose(1, 2, 0), number.transpose(2, 0, 1)):
            a, b, c, d = turned[:, :-1, :-1], turned[:, 1:, :-1], turned[:, 1:, 1:], turned[:, :-1, 1:]
            faces += [np.stack(corners, axis=-1).reshape(-1, 3) for corners in ((a, b, c), (a, c, d))]
        ms = pymeshlab.MeshSet()
        ms.add_mesh(pymeshlab.Mesh(np.column_stack([x, y, z]).astype(float), np.vstack(faces)))
        report = meshing_close_holes_by_bezier_patch(ms, repair=True)
        assert report["repaired"]["split_vertices"] > 0
        assert report["topology_after"]["non_manifold_faces"] == 0

    def test_the_mesh_stays_as_it_was_where_filling_is_cancelled(self):
        surface = torus(resolution=24)
        faces = surface.faces[surface.vertices[surface.faces].mean(axis=1)[:, 0] < 1.2].copy()
        faces[0] = faces[0][::-1]
        ms = pymeshlab.MeshSet()
        ms.add_mesh(pymeshlab.Mesh(surface.vertices, faces))
        before = mesh_state(ms)
        with pytest.raises(CancelledError):
            meshing_close_holes_by_bezier_patch(ms, repair=True, progress=lambda done, total: False)
        assert changed(before, mesh_state(ms)) == set()
