"""The report of what is wrong with a mesh."""

import numpy as np
import pymeshlab
import pytest
from bad_meshes import bow_tie, crossing_sheets, fins, random_faces, turned_faces
from turned_meshes import BALL, findings, soup

from bezier_filters import InvalidMeshError, diagnose, inspect_mesh, triangle_mesh
from bezier_filters.meshes.diagnosis import is_fit

TETRAHEDRON = ([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


def test_report_counts_every_fault():
    vertices = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [2, 0, 0], [9, 9, 9]]
    faces = [[0, 1, 2], [1, 2, 3], [2, 0, 1], [0, 1, 4], [3, 3, 1]]
    report = inspect_mesh(triangle_mesh(vertices, faces))
    assert report.unreferenced_vertices == 1
    assert report.degenerate_faces == 2  # (0, 1, 4) has no area, (3, 3, 1) names 3 twice
    assert report.duplicate_faces == 1
    assert report.non_manifold_edges == 2  # 0-1 and 1-2 have three faces
    assert report.boundary_edges == 4
    assert report.incoherent_edges == 1  # 0-2 twice in the same direction


def test_arrays_are_taken_as_meshes():
    mesh = triangle_mesh(*TETRAHEDRON)
    assert inspect_mesh(*TETRAHEDRON) == inspect_mesh(mesh)
    apart = ([*TETRAHEDRON[0], [5, 5, 5]], TETRAHEDRON[1])
    assert diagnose(*apart) == diagnose(triangle_mesh(*apart)) == diagnose(triangle_mesh(*apart), inspect_mesh(*apart))
    assert diagnose(np.eye(3)) == ["3 vertices without faces: curvature needs 6 or more"]
    with pytest.raises(InvalidMeshError, match="indices run from 0 to 3"):
        inspect_mesh(TETRAHEDRON[0][:3], TETRAHEDRON[1])


def test_of_point_clouds_it_says_nothing_but_that_they_are_ones():
    findings = diagnose(np.random.default_rng(0).standard_normal((20, 3)))
    assert [text.partition(":")[0] for text in findings] == ["there are no faces"]


def test_incoherent_orientation_is_seen():
    flipped = inspect_mesh(triangle_mesh([*np.eye(3).tolist(), [0, 0, 0]], [[0, 1, 2], [1, 2, 3]]))
    assert flipped.incoherent_edges == 1
    assert not flipped.is_coherently_oriented
    assert inspect_mesh(triangle_mesh(*TETRAHEDRON)).is_coherently_oriented


def test_mean_edge_length_counts_each_edge_once():
    assert inspect_mesh(triangle_mesh(*TETRAHEDRON)).mean_edge_length == pytest.approx((3 + 3 * np.sqrt(2)) / 6)


def test_without_edges_their_mean_length_is_zero():
    assert inspect_mesh(np.eye(3), []).mean_edge_length == 0.0


@pytest.mark.parametrize("make", [bow_tie, fins, turned_faces, crossing_sheets, random_faces])
def test_pymeshlab_counts_as_many_non_manifold_vertices(make):
    vertices, faces = make()
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    ms = pymeshlab.MeshSet()
    ms.add_mesh(pymeshlab.Mesh(vertices, faces))
    expected = ms.get_topological_measures()["non_two_manifold_vertices"]
    assert inspect_mesh(vertices, faces).non_manifold_vertices == expected
    assert ("surfaces only touch" in findings(vertices, faces)) == (expected > 0)


def test_faces_that_are_not_welded_are_named():
    report = inspect_mesh(*soup(BALL.vertices, BALL.faces))
    assert (report.unwelded_faces, report.largest_piece, report.inner_vertices) == (len(BALL.faces), 3, 0)
    assert "at most 3 vertices are connected by faces" in findings(*soup(BALL.vertices, BALL.faces))
    assert "faces (100%) are not welded" in findings(*soup(BALL.vertices, BALL.faces))


def test_meshes_that_cannot_be_fitted_are_not_fit():
    def fit(vertices, faces):
        mesh = triangle_mesh(vertices, faces)
        return is_fit(mesh, inspect_mesh(mesh))

    v, f = BALL.vertices, BALL.faces
    assert fit(v, f)
    assert fit(v, np.vstack([f, f]))
    assert not fit(v, np.vstack([f, f[:, ::-1]]))
    assert not fit(*soup(v, f))
    assert not fit(np.eye(3), [[0, 1, 2]])
