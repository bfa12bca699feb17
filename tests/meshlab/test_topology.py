"""Topology by pymeshlab next to our own: sample meshes, damaged meshes, scans."""

import re
from collections import OrderedDict
from dataclasses import replace
from pathlib import Path

import numpy as np
import pymeshlab
import pytest
from bad_meshes import MAKERS
from mesh_mutations import mutated

from bezier_filters.errors import InvalidParameterError
from bezier_filters.holes.hole_detection import find_holes
from bezier_filters.holes.hole_filling import fill_holes
from bezier_filters.meshes.adjacency import vertex_adjacency
from bezier_filters.meshes.diagnosis import inspect_mesh
from bezier_filters.meshes.half_edges import boundary_loops, distinct_edges, proper_faces
from bezier_filters.meshes.mesh import MAX_COORDINATE, triangle_mesh
from bezier_filters.meshes.prepared_mesh import prepare_mesh
from bezier_filters.meshlab import topology as topology_module
from bezier_filters.meshlab.converters import mesh_arrays
from bezier_filters.meshlab.crease_filter import compute_selection_by_bezier_crease_per_edge
from bezier_filters.meshlab.hole_filter import meshing_close_holes_by_bezier_patch
from bezier_filters.meshlab.topology import clear_topology_cache, topology_of
from bezier_filters.meshlab.vertex_filters import (
    apply_coord_bezier_patch_smoothing,
    compute_curvature_by_bezier_patch_per_vertex,
    compute_normal_by_bezier_patch_per_vertex,
    compute_torsion_by_bezier_patch_per_vertex,
)

ROOT = Path(__file__).parents[2]
SAMPLES = sorted((ROOT / "sample_meshes").glob("*.ply"))
SHIPPED = Path(pymeshlab.__file__).parent / "tests" / "sample_meshes"
SCANS = [SHIPPED / name for name in ("bunny10k_textured.obj", "airplane.obj", "rangemaps/face000.ply")]
SCANS += sorted((ROOT.parent / "shared" / "meshes").glob("*.obj"))


def load(path):
    ms = pymeshlab.MeshSet()
    ms.load_new_mesh(str(path))
    return ms


def compare(vertices, faces):
    """pymeshlab's borders are ours on every mesh, and so are its counts wherever it has some and ours are defined."""
    mesh = triangle_mesh(vertices, faces)
    adjacency, topology = vertex_adjacency(mesh), topology_of(mesh.vertices, mesh.faces)
    np.testing.assert_array_equal(topology.on_border, adjacency.on_boundary)
    assert topology.counts["boundary_edges"] == inspect_mesh(mesh).boundary_edges
    edges, _, count = distinct_edges(proper_faces(mesh.faces), mesh.vertex_count)
    assert topology.not_manifold[edges[count > 2]].all()
    assert topology.not_manifold.sum() == len(np.unique(edges[count > 2])) + topology.counts["non_manifold_vertices"]
    holes = find_holes(prepare_mesh(mesh))
    # more than two faces, or faces with another side up, at a border
    loops = None if any(hole.non_manifold_edges for hole in holes) else sum(len(hole.loops) for hole in holes)
    if topology.counts["boundary_loops_by"] == "pymeshlab":
        assert loops in (None, topology.counts["boundary_loops"])
        assert topology.counts["non_manifold_faces"] == topology.counts["non_manifold_vertices"] == 0
    else:
        assert topology.counts["genus"] is None
        assert not topology.counts["two_manifold"]
        assert topology.counts["boundary_loops"] == loops
    return topology.counts


@pytest.mark.parametrize("path", SAMPLES, ids=lambda path: path.stem)
def test_on_sample_meshes(path):
    counts = compare(*mesh_arrays(path))
    assert counts["boundary_loops_by"] == "pymeshlab"
    assert counts["two_manifold"]
    assert counts["boundary_loops"] == len(boundary_loops(triangle_mesh(*mesh_arrays(path))))


@pytest.mark.parametrize("path", SCANS, ids=lambda path: path.stem)
def test_on_scans(path):
    compare(*mesh_arrays(path))


@pytest.mark.parametrize("name", [name for name in MAKERS if name != "no_vertices"])
def test_on_bad_meshes(name):
    compare(*MAKERS[name]())


def test_on_damaged_meshes():
    """Faces that name a vertex twice are among them, on which pymeshlab would run forever (number 240)."""
    meshes = [mesh for mesh in map(mutated, range(230, 300)) if (np.abs(mesh[0]) < MAX_COORDINATE).all()]
    assert {compare(*mesh)["boundary_loops_by"] for mesh in meshes} == {"pymeshlab", "bezier_filters"}


def test_on_no_faces():
    counts = topology_of(np.zeros((3, 3)), np.empty((0, 3), dtype=np.int32)).counts
    assert (counts["components"], counts["boundary_loops"], counts["boundary_edges"]) == (0, 0, 0)


class TestReports:
    def test_filling_tells_both_states(self):
        ms = load(ROOT / "sample_meshes" / "punched_patch.ply")
        report = meshing_close_holes_by_bezier_patch(ms)
        before, after = report["topology_before"], report["topology_after"]
        assert (before["boundary_loops"], after["boundary_loops"], after["boundary_loops_by"]) == (4, 1, "pymeshlab")
        measures = ms.get_topological_measures()
        assert after["boundary_edges"] == measures["boundary_edges"]
        assert after["genus"] == measures["genus"] == 0
        again = meshing_close_holes_by_bezier_patch(ms)
        assert again["topology_before"] == again["topology_after"] == after

    def test_where_pymeshlab_cannot_say_we_do(self):
        """Two balls that share a vertex, each with a hole elsewhere."""
        vertices, faces = MAKERS["bow_tie"]()
        ms = pymeshlab.MeshSet()
        ms.add_mesh(pymeshlab.Mesh(vertices, np.delete(faces, [len(faces) // 2 - 1, len(faces) - 1], axis=0)))
        assert ms.get_topological_measures()["number_holes"] == -1
        report = meshing_close_holes_by_bezier_patch(ms)
        assert report["topology_before"]["boundary_loops"] == report["closed_holes"] == 2
        assert report["topology_before"]["boundary_loops_by"] == "bezier_filters"
        assert report["topology_after"]["boundary_edges"] == 0

    def test_smoothing_tells_it(self):
        report = apply_coord_bezier_patch_smoothing(load(ROOT / "sample_meshes" / "torus.ply"))
        assert (report["topology"]["genus"], report["topology"]["boundary_loops"]) == (1, 0)


def test_borders_that_are_given_are_those_that_are_filled():
    mesh = triangle_mesh(*mesh_arrays(ROOT / "sample_meshes" / "punched_patch.ply"))
    found = fill_holes(mesh.vertices, mesh.faces)
    given = topology_of(mesh.vertices, mesh.faces).on_border
    again = fill_holes(mesh.vertices, mesh.faces, on_border=given)
    assert again.vertices.tobytes() == found.vertices.tobytes()
    assert again.faces.tobytes() == found.faces.tobytes()
    hole = found.holes[1].rim
    without = given & ~np.isin(np.arange(len(given)), hole)
    assert len(fill_holes(mesh.vertices, mesh.faces, holes=[], on_border=without).holes) == len(found.holes) - 1
    broken = given & (np.arange(len(given)) != hole[0])
    with pytest.raises(InvalidParameterError, match="on_border: got vertices other than the ends"):
        fill_holes(mesh.vertices, mesh.faces, on_border=broken)
    with pytest.raises(InvalidParameterError, match="on_border: got bool of shape"):
        fill_holes(mesh.vertices, mesh.faces, on_border=given[1:])


FILTERS = (
    compute_normal_by_bezier_patch_per_vertex,
    compute_curvature_by_bezier_patch_per_vertex,
    compute_torsion_by_bezier_patch_per_vertex,
    compute_selection_by_bezier_crease_per_edge,
    apply_coord_bezier_patch_smoothing,
    meshing_close_holes_by_bezier_patch,
)


class FakeMeshSet(pymeshlab.MeshSet):
    """A pymeshlab that says what is not so."""

    def get_topological_measures(self):
        false = {"connected_components_number": 99, "incident_faces_on_non_two_manifold_edges": 7}
        return super().get_topological_measures() | false


@pytest.fixture
def forgotten(monkeypatch):
    """Nothing that was asked before is known, nor is what is asked now known after."""
    monkeypatch.setattr(topology_module, "_recent", OrderedDict())


@pytest.mark.usefixtures("forgotten")
class TestEveryFilterAsks:
    @pytest.mark.parametrize("function", FILTERS, ids=lambda function: function.__name__)
    def test_what_pymeshlab_says_is_in_the_report(self, function, monkeypatch):
        true = function(load(ROOT / "sample_meshes" / "punched_patch.ply"))
        assert true["topology"]["components"] == 1
        assert true["topology"]["boundary_loops_by"] == "pymeshlab"
        assert not any("topology" in remark for remark in true["remarks"])
        clear_topology_cache()
        monkeypatch.setattr(topology_module, "MeshSet", FakeMeshSet)
        false = function(load(ROOT / "sample_meshes" / "punched_patch.ply"))
        assert false["topology"]["components"] == 99
        remarks = " ".join(false["remarks"])
        assert "topology: 7 faces lie on edges of three or more, where neighbourhoods mix sheets; " in remarks

    def test_its_borders_are_those_that_are_held(self, monkeypatch):
        def moved_at_border():
            ms = load(ROOT / "sample_meshes" / "punched_patch.ply")
            ms.apply_coord_random_displacement(displacement=pymeshlab.PureValue(0.003))
            before = ms.current_mesh().vertex_matrix()
            apply_coord_bezier_patch_smoothing(ms, borders="fixed")
            return np.linalg.norm(ms.current_mesh().vertex_matrix() - before, axis=1) > 0.0

        vertices, faces = mesh_arrays(ROOT / "sample_meshes" / "punched_patch.ply")
        true = topology_of(vertices, faces)
        moved = moved_at_border()
        assert not moved[true.on_border].any()
        half = vertices[:, 0] > 0.0
        false = replace(true, on_border=true.on_border | half)
        monkeypatch.setattr(topology_module, "_ask_for_topology", lambda *_: false)
        clear_topology_cache()
        assert moved[half].any()
        assert not moved_at_border()[half].any()

    def test_where_it_says_that_surfaces_only_touch_the_papers_method_holds(self, monkeypatch):
        true = topology_of(*mesh_arrays(ROOT / "sample_meshes" / "torus.ply"))
        some = np.arange(len(true.on_border)) % 3 == 0
        monkeypatch.setattr(topology_module, "_ask_for_topology", lambda *_: replace(true, not_manifold=some))
        clear_topology_cache()
        ms = load(ROOT / "sample_meshes" / "torus.ply")
        before = ms.current_mesh().vertex_matrix()
        apply_coord_bezier_patch_smoothing(ms, method="paper")
        moved = (ms.current_mesh().vertex_matrix() != before).any(axis=1)
        assert not moved[some].any()
        assert moved[~some].all()

    def test_a_report_that_is_changed_changes_no_later_one(self):
        ms = load(ROOT / "sample_meshes" / "torus.ply")
        compute_curvature_by_bezier_patch_per_vertex(ms)["topology"]["genus"] = 17
        assert compute_curvature_by_bezier_patch_per_vertex(ms)["topology"]["genus"] == 1

    def test_point_clouds_have_none(self):
        ms = pymeshlab.MeshSet()
        ms.add_mesh(pymeshlab.Mesh(np.random.default_rng(0).normal(size=(50, 3))))
        assert compute_normal_by_bezier_patch_per_vertex(ms)["topology"] is None


class TestSidesOfFaces:
    """Curvatures of faces that look inwards have the wrong sign, which a status does not show."""

    @staticmethod
    def remarks(vertices, faces, function=compute_curvature_by_bezier_patch_per_vertex, **options):
        ms = pymeshlab.MeshSet()
        ms.add_mesh(pymeshlab.Mesh(vertices, faces))
        return function(ms, **options)["remarks"]

    def test_flipped_faces(self):
        vertices, faces = mesh_arrays(ROOT / "sample_meshes" / "torus.ply")
        half = vertices[faces].mean(axis=1)[:, 0] > 0.1
        flipped = np.where(half[:, np.newaxis], faces[:, ::-1], faces)
        share = (
            rf"{half.sum():,} of {len(faces):,} faces \(\d+%\) are flipped against the others: signs are wrong there"
        )
        for function in FILTERS[:5]:
            assert any(re.match(share, remark) for remark in self.remarks(vertices, flipped, function)), function
            assert not self.remarks(vertices, faces, function)
        assert not self.remarks(vertices, flipped, repair=True)

    def test_bodies_that_are_inside_out(self):
        vertices, faces = mesh_arrays(ROOT / "sample_meshes" / "torus.ply")
        (remark,) = self.remarks(vertices, faces[:, ::-1])
        assert remark.startswith("1 closed bodies are inside out: the signs of their curvatures and normals are wrong")
        assert not self.remarks(vertices, faces[:, ::-1], repair=True)
        assert not self.remarks(vertices, faces[: len(faces) // 2, ::-1])  # a sheet has no inside
