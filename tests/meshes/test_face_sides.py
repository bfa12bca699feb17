"""Faces that are flipped against others, and bodies that are inside out."""

import numpy as np
import pytest
from bad_meshes import moebius_strip
from turned_meshes import BALL, findings, soup, turned

from bezier_filters import diagnose, inspect_mesh
from bezier_filters.meshes.face_sides import face_sides


@pytest.mark.parametrize("share", [0.1, 0.5, 0.7])
@pytest.mark.parametrize("unwelded", [False, True])
def test_flipped_faces_have_their_share(share, unwelded):
    count = round(share * len(BALL.faces))
    which = np.random.default_rng(0).permutation(len(BALL.faces))[:count]
    mesh = BALL.vertices, turned(BALL.faces, which)
    mesh = soup(*mesh) if unwelded else mesh
    assert inspect_mesh(*mesh).flipped_faces == count
    assert f"{count:,} of {len(BALL.faces):,} faces ({share:.0%}) are flipped" in findings(*mesh)


def test_a_body_that_is_inside_out_is_named_and_a_cavity_is_not():
    v, f, n = BALL.vertices, BALL.faces, len(BALL.vertices)
    assert not diagnose(v, f)
    assert "1 closed bodies are inside out" in findings(v, f[:, ::-1])
    assert "1 closed bodies are inside out" in findings(*soup(v, f[:, ::-1]))
    assert "1 closed bodies are inside out" in findings(np.vstack([v, v + 3.0]), np.vstack([f, f[:, ::-1] + n]))
    assert not diagnose(np.vstack([v, 0.5 * v]), np.vstack([f, f[:, ::-1] + n]))
    assert inspect_mesh(np.vstack([v, 0.5 * v]), np.vstack([f[:, ::-1], f + n])).inside_out_bodies == 1
    # a body that lies only in the box around another one is in no cavity of it
    corner = 0.1 * v + 0.85 * np.abs(v).max(axis=0)
    assert inspect_mesh(np.vstack([v, corner]), np.vstack([f, f[:, ::-1] + n])).inside_out_bodies == 1


def test_surfaces_with_a_border_or_one_side_are_not_inside_out():
    assert inspect_mesh(BALL.vertices, BALL.faces[1:, ::-1]).inside_out_bodies == 0
    report = inspect_mesh(*moebius_strip())
    assert (report.flipped_faces, report.inside_out_bodies) == (0, 0)
    assert "a one-sided surface" in findings(*moebius_strip())


@pytest.mark.parametrize("share", [0.1, 0.4])
def test_the_faces_that_were_turned_are_those_that_are_found(share):
    """In a body that is turned outwards, or inwards: there the others point the wrong way."""
    which = np.random.default_rng(1).random(len(BALL.faces)) < share
    faces = turned(BALL.faces, which)
    np.testing.assert_array_equal(face_sides(BALL.vertices, faces).flipped, which)
    np.testing.assert_array_equal(face_sides(BALL.vertices, faces[:, ::-1]).flipped, ~which)
