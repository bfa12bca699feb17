"""What is fitted where the first attempt fails, and what the status says of it."""

import pickle

import numpy as np
import pytest
from scipy.spatial import Delaunay

from bezier_filters import FitStatus, estimate_vertex_geometry, triangle_mesh
from bezier_filters.fitting.fallbacks import fallback_chain, kernel_fit, last_resorts
from bezier_filters.patches.patch_fit import PatchFit
from bezier_filters.surfaces import block_with_sharp_edges, sphere

FIXED = {"rings": 2, "alpha": 0.8}


class TestStatus:
    """Every fallback is visible."""

    def test_unreferenced_vertices_are_isolated_and_filled_with_zeros(self):
        surface = sphere(resolution=4)
        vertices = np.vstack([surface.vertices, [[5.0, 5.0, 5.0]]])
        geometry = estimate_vertex_geometry(vertices, surface.faces)
        assert geometry.status[-1] == FitStatus.ISOLATED
        assert not geometry.normals[-1].any()
        assert geometry.mean_curvature[-1] == 0.0
        assert geometry.rings_used[-1] == 0

    def test_a_single_triangle_has_a_normal_only(self):
        geometry = estimate_vertex_geometry([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
        assert geometry.status_counts() == {"NORMAL_ONLY": 3}
        np.testing.assert_array_equal(geometry.normals, [[0, 0, 1]] * 3)

    def test_the_status_says_where_there_is_a_curvature(self):
        """On a sphere, of which a part is not selected, beside a triangle and a lone point: it is 1 or not there."""
        ball = sphere(resolution=4)
        n = len(ball.vertices)
        vertices = np.vstack([ball.vertices, [[5, 0, 0], [6, 0, 0], [5, 1, 0], [9, 9, 9]]])
        selected = np.arange(n + 4) >= 10
        geometry = estimate_vertex_geometry(vertices, [*ball.faces, [n, n + 1, n + 2]], selected=selected)
        assert {"SKIPPED", "NORMAL_ONLY", "ISOLATED"} < set(geometry.status_counts())
        has_curvature = [FitStatus(code).has_curvature for code in geometry.status]
        np.testing.assert_array_equal(geometry.mean_curvature != 0.0, has_curvature)
        assert sum(has_curvature) == n - 10

    @pytest.mark.parametrize(
        "options",
        [{}, {"rings": 2, "alpha": 0.8}, {"smoothness": "paper"}, {"rings": 1}, {"radius": 2.1}],
    )
    @pytest.mark.parametrize("width", [0.1, 1e-9])
    def test_no_curvature_beyond_what_edges_can_hold(self, width, options):
        """Along a crest whose sides nearly touch, a graph over its plane of symmetry bends by 1 / width^2."""
        x, k = np.meshgrid(np.arange(9.0), np.arange(-2, 3), indexing="ij")
        vertices = np.column_stack([x.ravel(), width * k.ravel(), -np.abs(k).ravel()])
        a = np.arange(40).reshape(8, 5)[:, :4].ravel()
        faces = np.vstack([np.column_stack([a, a + 5, a + 1]), np.column_stack([a + 1, a + 5, a + 6])])
        geometry = estimate_vertex_geometry(vertices, faces, **options)
        height = np.sqrt(0.5)  # of faces, whose legs have length 1, or slightly more
        assert np.abs([geometry.k_min, geometry.k_max]).max() <= np.pi / height
        assert geometry.mean_curvature_std.max() <= np.pi / height
        assert geometry.status_counts()["NORMAL_ONLY"] > 0

    def test_meshes_may_be_stretched(self):
        """Every edge of a thin cylinder is longer than its circle, on which they lie all the same."""
        around, along = np.meshgrid(np.arange(24), np.arange(9))
        angle = (2.0 * np.pi * around / 24.0).ravel()
        heights = 100.0 * (along + 0.4 * (around % 2)).ravel()
        vertices = np.column_stack([np.cos(angle), np.sin(angle), heights])
        k = np.arange(192).reshape(8, 24)
        right = np.roll(k, -1, axis=1)
        halves = (k, right, k + 24), (right, right + 24, k + 24)
        faces = np.vstack([np.stack(half, axis=-1).reshape(-1, 3) for half in halves])
        edges = vertices[faces] - vertices[np.roll(faces, -1, axis=1)]
        assert np.linalg.norm(edges, axis=2).min() > 2.0 * np.pi
        geometry = estimate_vertex_geometry(vertices, faces, rings=2, alpha=1.0)
        inside = (along.ravel() > 1) & (along.ravel() < 7)
        assert (geometry.status[inside] <= FitStatus.OTHER_PLANE).all()
        np.testing.assert_allclose(geometry.k_max[inside], 1.0, rtol=0.1)

    def test_a_triangle_without_area_is_isolated(self):
        geometry = estimate_vertex_geometry([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]])
        assert geometry.status_counts() == {"ISOLATED": 3}

    def test_no_faces_and_no_vertices(self):
        assert estimate_vertex_geometry(np.zeros((3, 3)), []).status_counts() == {"ISOLATED": 3}
        assert estimate_vertex_geometry(np.empty((0, 3)), []).status_counts() == {}

    def test_regular_rings_without_smoothing_are_rank_deficient_and_widened(self):
        # The 19 points of a regular 2-ring lie on 5 rows: rank 15 of 16.
        x, y = (a.ravel() for a in np.meshgrid(np.arange(11.0), np.arange(11.0) * np.sqrt(0.75)))
        x = x + 0.5 * np.round(y / np.sqrt(0.75))
        points = np.column_stack([x, y, 0.01 * x * y])
        mesh = triangle_mesh(points, Delaunay(points[:, :2]).simplices)
        geometry = estimate_vertex_geometry(mesh.vertices, mesh.faces, rings=2, alpha=1.0)
        middle = 5 * 11 + 5
        assert geometry.status[middle] == FitStatus.WIDER_RING
        assert geometry.rings_used[middle] == 3
        assert estimate_vertex_geometry(mesh.vertices, mesh.faces, **FIXED).status[middle] == FitStatus.OK

    def test_a_sharp_edge_takes_another_plane_or_the_one_ring(self):
        vertices, faces = block_with_sharp_edges()
        geometry = estimate_vertex_geometry(vertices, faces, **FIXED)
        counts = geometry.status_counts()
        assert counts["OK"] > 0
        assert counts["OTHER_PLANE"] > 0
        assert sum(counts.values()) == len(vertices)

    def test_small_closed_meshes_have_finite_estimates(self):
        octahedron = np.vstack([np.eye(3), -np.eye(3)])
        faces = [[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]]
        geometry = estimate_vertex_geometry(octahedron, faces)
        assert np.isfinite(geometry.k_max).all()
        assert all(FitStatus(code) >= FitStatus.ONE_RING for code in geometry.status)
        outward = np.einsum("ij,ij->i", geometry.normals, octahedron)
        assert outward.min() > 0.5

    def test_a_bent_sheet_folds_and_says_so(self):
        """A strip bent by 170 degrees around a crease: no plane sees both sides from the front."""
        x, y = (a.ravel() for a in np.meshgrid(np.linspace(-1, 1, 9), np.linspace(-1, 1, 9)))
        faces = Delaunay(np.column_stack([x, y])).simplices
        slope = np.tan(np.radians(85))
        geometry = estimate_vertex_geometry(np.column_stack([x, y, -slope * np.abs(x)]), faces, **FIXED)
        counts = geometry.status_counts()
        assert np.isfinite(geometry.k_max).all()
        assert counts.get("OK", 0) < len(x)
        assert any(name in counts for name in ("OTHER_PLANE", "ONE_RING", "FOLDED"))


def test_attempts_are_the_same_after_pickling():
    """As worker processes get them: the flattest quadratic has a pivot of its own."""
    chains = fallback_chain(2, PatchFit()), last_resorts(2)
    for attempt in (one for chain in chains for one in chain):
        copied = kernel_fit(pickle.loads(pickle.dumps(attempt)), robust=True)
        for value, expected in zip(copied, kernel_fit(attempt, robust=True), strict=True):
            np.testing.assert_array_equal(value, expected)
