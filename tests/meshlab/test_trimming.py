"""Spikes and flaps at rims, removed by the filter that fills holes: rows of the old mesh, and what hangs on them."""

import numpy as np
import pymeshlab
from command_line import run
from hole_cases import ball_with_rim

from bezier_filters.holes.hole_filling import fill_holes
from bezier_filters.meshlab.hole_filter import meshing_close_holes_by_bezier_patch


def test_trimmed_faces_go_with_their_rows(tmp_path):
    """A flap at the rim goes, and what hangs on the other rows stays."""
    vertices, faces, _ = ball_with_rim(noise=0.5, seed=2)
    expected = fill_holes(vertices, faces, trim=True)
    n, m = len(expected.old_vertices), len(expected.old_faces)
    ms = pymeshlab.MeshSet()
    ms.add_mesh(pymeshlab.Mesh(vertices, faces, v_scalar_array=np.arange(len(vertices), dtype=np.float64)))
    ms.current_mesh().add_face_custom_scalar_attribute(np.arange(len(faces), dtype=np.float64), "number")
    report = meshing_close_holes_by_bezier_patch(ms, trim=True)
    assert report["trimmed_faces"] == len(faces) - m > 0
    assert report["open_holes"] == 0
    mesh = ms.current_mesh()
    np.testing.assert_array_equal(mesh.vertex_matrix(), expected.vertices)
    np.testing.assert_array_equal(mesh.face_matrix(), expected.faces)
    np.testing.assert_array_equal(mesh.vertex_scalar_array()[:n], expected.old_vertices)
    np.testing.assert_array_equal(mesh.face_custom_scalar_attribute_array("number")[:m], expected.old_faces)
    ms.clear()
    ms.add_mesh(pymeshlab.Mesh(vertices, faces))
    ms.save_current_mesh(str(tmp_path / "ball.ply"))
    done = run("fill-holes", tmp_path / "ball.ply", tmp_path / "closed.ply", "--trim")
    assert f"{report['trimmed_faces']:,} old faces at rims removed" in done.stdout
