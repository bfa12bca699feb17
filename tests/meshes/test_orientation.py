"""Normals of points alone are oriented consistently, and outwards."""

import numpy as np
import pytest
from clouds import CLOSED, cloud_of, dots, noisy, points_on_sphere

from bezier_filters import estimate_vertex_geometry
from bezier_filters.surfaces import block_with_sharp_edges, waves


class TestOutside:
    @pytest.mark.parametrize("edges", [0.0, 0.1, 0.3, 0.5])
    @pytest.mark.parametrize("surface", CLOSED.values(), ids=CLOSED)
    def test_normals_of_closed_bodies_point_outward(self, surface, edges):
        normals = cloud_of(noisy(surface, edges)).planes.normals
        assert (dots(normals, surface.normals) > 0).all()
        np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)

    def test_a_block_with_sharp_edges(self):
        vertices, _ = block_with_sharp_edges()
        center = vertices.mean(axis=0)
        assert (dots(cloud_of(vertices).planes.normals, vertices - center) > 0).all()

    def test_bodies_apart_are_turned_each_for_itself(self):
        ball = points_on_sphere(2000)
        normals = cloud_of(np.vstack([ball, 0.3 * ball[:500] + 5.0])).planes.normals
        assert (dots(normals, np.vstack([ball, ball[:500]])) > 0).all()

    def test_both_sides_of_a_plate_face_away_from_each_other(self):
        rng = np.random.default_rng(0)
        lattice = np.array(np.meshgrid(np.arange(30.0), np.arange(30.0))).reshape(2, -1).T
        below, above = (
            np.column_stack([lattice + rng.uniform(-0.3, 0.3, lattice.shape), np.full(len(lattice), z)])
            for z in (0.0, 2.5)
        )
        z = cloud_of(np.vstack([below, above])).planes.normals[:, 2]
        inner = np.tile(np.abs(lattice - 14.5).max(axis=1) < 13, 2)
        assert (np.sign(z) == np.repeat([-1, 1], len(lattice)))[inner].all()

    @pytest.mark.parametrize("axis", [0, 1, 2])
    def test_sheets_look_along_the_axis_that_they_face(self, axis):
        sheet = waves(resolution=30, jitter=0.3)
        turned = np.roll(sheet.vertices, axis + 1, axis=1)  # z to the axis
        assert (cloud_of(turned).planes.normals[:, axis] > 0).all()

    def test_given_normals_decide(self):
        surface = CLOSED["torus"]
        before = estimate_vertex_geometry(surface.vertices, None)
        inward = estimate_vertex_geometry(surface.vertices, None, normals=-0.1 * surface.normals)
        np.testing.assert_allclose(inward.normals, -before.normals, atol=1e-9)
        np.testing.assert_allclose(inward.k_max, -before.k_min, atol=1e-9)

    def test_a_few_given_normals_turn_their_whole_part(self):
        surface = CLOSED["sphere"]
        given = np.zeros_like(surface.vertices)
        given[::50] = -surface.normals[::50]
        both = np.vstack([surface.vertices, surface.vertices + 5.0])
        normals = cloud_of(both, np.vstack([given, np.zeros_like(given)])).planes.normals
        outward = dots(normals, np.vstack([surface.normals, surface.normals]))
        assert (outward[: len(given)] < 0).all()
        assert (outward[len(given) :] > 0).all()
