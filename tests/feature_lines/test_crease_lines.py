"""Sharp edges, ridges and ravines are where they must be, and nowhere else."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from bezier_filters import InvalidMeshError, InvalidParameterError, estimate_vertex_geometry, find_creases
from bezier_filters.feature_lines.crease_lines import join_chains
from bezier_filters.meshes.adjacency import vertex_adjacency
from bezier_filters.meshes.half_edges import mesh_edges
from bezier_filters.meshes.mesh import triangle_mesh
from bezier_filters.surfaces import block_with_sharp_edges, bumpy_star, cylinder, ellipsoid, height_field, sphere, torus

CUBE = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
CUBE_FACES = np.array(
    [
        [[0, 1, 3], [0, 3, 2]],
        [[4, 6, 7], [4, 7, 5]],
        [[0, 4, 5], [0, 5, 1]],
        [[2, 3, 7], [2, 7, 6]],
        [[0, 2, 6], [0, 6, 4]],
        [[1, 5, 7], [1, 7, 3]],
    ]
).reshape(-1, 3)


def total_length(lines):
    return sum(line.length for line in lines)


def length_of(curve):
    return np.linalg.norm(np.diff(curve, axis=0), axis=1).sum()


class TestRidgesOfKnownSurfaces:
    def test_of_an_ellipsoid_they_lie_in_its_planes_of_symmetry(self):
        """With semi-axes a > b > c the curvature across the ellipse of a and b is largest there."""
        angle = np.linspace(0.0, 2.0 * np.pi, 2001)
        ellipse = np.stack([np.cos(angle), 0.8 * np.sin(angle)], axis=1)
        farthest = []
        for resolution in (10, 20):
            shape = ellipsoid(semi_axes=(1.0, 0.8, 0.5), resolution=resolution, jitter=0.3)
            (ridge,) = find_creases(shape.vertices, shape.faces).lines
            assert ridge.kind == "ridge"
            assert ridge.is_closed
            assert not ridge.is_sharp
            assert ridge.length == pytest.approx(length_of(ellipse), rel=0.01)
            farthest.append(np.abs(ridge.points[:, 2]).max())
        assert farthest[0] < 0.005
        assert farthest[1] < farthest[0] / 4.0  # of second order at least

    def test_of_waves_they_are_straight(self):
        wavelength, amplitude = 1.0, 0.1
        k = 2.0 * np.pi / wavelength

        def wave(x, y):
            c, s = amplitude * np.cos(k * x), amplitude * np.sin(k * x)
            return c, -k * s, 0.0, -k * k * c, 0.0, 0.0

        shape = height_field(wave, size=2.5, resolution=50, jitter=0.3)
        creases = find_creases(shape.vertices, shape.faces)
        for kind, places in (("ridge", [-1.0, 0.0, 1.0]), ("ravine", [-0.5, 0.5])):
            lines = creases.of_kind(kind)
            assert sorted(round(float(np.median(line.points[:, 0])), 2) for line in lines) == places
            for line in lines:
                assert np.ptp(line.points[:, 0]) < 0.02
                assert line.length == pytest.approx(2.5, rel=0.05)

    def test_of_a_turned_body_they_are_circles(self):
        tube = cylinder(length=3.0, resolution=48, jitter=0.3)
        x, y, z = tube.vertices.T
        radius = 1.0 + 0.15 * np.cos(4.0 * z)
        creases = find_creases(np.stack([radius * x, radius * y, z], axis=1), tube.faces)
        assert [len(creases.of_kind(kind)) for kind in ("ridge", "ravine")] == [1, 2]
        for line in creases.lines:
            assert line.is_closed
            height = 0.0 if line.kind == "ridge" else np.pi / 4.0
            np.testing.assert_allclose(np.abs(line.points[:, 2]), height, atol=0.01)
            bottom = 1.15 if line.kind == "ridge" else 0.85
            assert line.length == pytest.approx(2.0 * np.pi * bottom, rel=0.01)

    @pytest.mark.parametrize("make", [sphere, torus, cylinder])
    @pytest.mark.parametrize("noise", [0.0, 0.05, 0.2])
    def test_cyclides_have_none_even_with_noise(self, make, noise):
        """Both curvatures of cyclides are constant along their own lines."""
        shape = make(resolution=24, jitter=0.3)
        edge = np.linalg.norm(np.diff(shape.vertices[shape.faces[:, :2]], axis=1), axis=2).mean()
        heights = noise * edge * np.random.default_rng(0).standard_normal((len(shape.vertices), 1))
        found = find_creases(shape.vertices + heights * shape.normals, shape.faces).lines
        assert found == ()

    def test_weaker_lines_come_only_when_asked_for(self):
        shape = bumpy_star(resolution=24)
        geometry = estimate_vertex_geometry(shape.vertices, shape.faces)
        counts = []
        for least in (0.0, 2.0, 8.0):
            lines = find_creases(shape.vertices, shape.faces, geometry, min_strength=least).lines
            strengths = [line.strength for line in lines]
            assert min(strengths) >= least
            assert strengths == sorted(strengths, reverse=True)
            counts.append(len(lines))
        assert counts[0] > counts[1] > counts[2] > 0


class TestSharpEdges:
    def test_of_a_block_with_a_notch(self):
        """A cube of side 1 without one octant: 9 edges of 1 and 6 of 1/2 stick out or end, 3 of 1/2 go inwards."""
        creases = find_creases(*block_with_sharp_edges(resolution=8, jitter=0.2))
        assert all(line.is_sharp for line in creases.lines)
        assert total_length(creases.of_kind("ravine")) == pytest.approx(1.5)
        assert total_length(creases.of_kind("ridge")) == pytest.approx(9.0 + 3.0 + 1.5)
        assert len(creases.lines) == 9 + 9 + 3
        assert len(creases.sharp_edges) == sum(len(line.points) - 1 for line in creases.lines)

    def test_of_a_cube_of_twelve_triangles(self):
        creases = find_creases(CUBE, CUBE_FACES)
        assert len(creases.lines) == 12
        np.testing.assert_allclose([line.length for line in creases.lines], 1.0)

    def test_a_coarse_sphere_has_none(self):
        shape = sphere(resolution=2)
        assert find_creases(shape.vertices, shape.faces).lines == ()

    def test_the_angle_decides(self):
        ridge, eaves = [[0, 0, 0], [0, 2, 0], [0, 4, 0]], [[1, 1, -0.5], [-1, 1, -0.5], [1, 3, -0.5], [-1, 3, -0.5]]
        roof = np.array(ridge + eaves)
        faces = [[0, 3, 1], [0, 1, 4], [1, 5, 2], [1, 2, 6], [3, 5, 1], [4, 1, 6]]
        between = 2.0 * np.degrees(np.arctan(0.5))
        for angle, expected in ((between - 1.0, 1), (between + 1.0, 0)):
            lines = find_creases(roof, faces, angle=angle).lines
            assert [line.is_sharp for line in lines].count(True) == expected
        assert find_creases(roof, faces, angle=10.0).lines[0].points[:, 1].tolist() in ([0, 2, 4], [4, 2, 0])


class TestTransformations:
    shape = bumpy_star(resolution=14, jitter=0.2)

    def find(self, vertices, faces):
        geometry = estimate_vertex_geometry(vertices, faces, rings=3, alpha=1.0, degree=3)
        return find_creases(vertices, faces, geometry)

    def compare(self, after, before, scale=1.0, back=lambda points: points):
        assert len(after) == len(before) > 5
        for line, other in zip(after, before, strict=True):
            assert line.strength == pytest.approx(other.strength, rel=1e-6)
            assert line.length == pytest.approx(scale * other.length, rel=1e-6)
            np.testing.assert_allclose(cKDTree(other.points).query(back(line.points))[0], 0.0, atol=1e-6)
            assert line.is_closed == other.is_closed

    def test_motion_and_scale(self):
        turn = np.linalg.qr(np.random.default_rng(0).standard_normal((3, 3)))[0]
        turn *= np.linalg.det(turn)
        before = self.find(self.shape.vertices, self.shape.faces)
        after = self.find(100.0 * self.shape.vertices @ turn.T + 7.0, self.shape.faces)
        self.compare(after.lines, before.lines, 100.0, lambda points: (points - 7.0) @ turn / 100.0)

    def test_relabelling(self):
        order = np.random.default_rng(1).permutation(len(self.shape.vertices))
        number = np.argsort(order)
        before = self.find(self.shape.vertices, self.shape.faces)
        after = self.find(self.shape.vertices[order], number[self.shape.faces][::-1])
        self.compare(after.lines, before.lines)

    def test_from_inside_ridges_are_ravines(self):
        before = self.find(self.shape.vertices, self.shape.faces)
        after = self.find(self.shape.vertices, self.shape.faces[:, ::-1])
        self.compare(after.of_kind("ravine"), before.of_kind("ridge"))
        assert total_length(after.of_kind("ridge")) == pytest.approx(total_length(before.of_kind("ravine")), rel=1e-6)
        block = block_with_sharp_edges(resolution=6)
        ridges = find_creases(*block).of_kind("ridge")
        assert len(find_creases(block[0], block[1][:, ::-1]).of_kind("ravine")) == len(ridges)


class TestPointsOfLines:
    def test_lie_on_their_edges(self):
        shape = ellipsoid(resolution=10, jitter=0.2)
        for line in find_creases(shape.vertices, shape.faces).lines:
            a, b = shape.vertices[line.edges].swapaxes(0, 1)
            share = line.shares[:, np.newaxis]
            np.testing.assert_allclose((1 - share) * a + share * b, line.points, atol=1e-12)
            distances = np.linalg.norm(shape.vertices[line.nearest_vertices] - line.points, axis=1)
            assert (distances <= 0.5 * np.linalg.norm(b - a, axis=1) + 1e-12).all()


@given(
    st.lists(st.tuples(st.integers(0, 9), st.integers(0, 9)).filter(lambda e: e[0] < e[1]), unique=True, max_size=25)
)
def test_chains_take_every_segment_once_and_are_as_long_as_possible(segments):
    array = np.array(segments, dtype=np.int32).reshape(-1, 2)
    found = join_chains(array)
    passed = [segment for _, ids in found for segment in ids.tolist()]
    assert sorted(passed) == list(range(len(segments)))
    degree = np.bincount(array.ravel(), minlength=10)
    for nodes, ids in found:
        steps = np.sort(np.stack([nodes[:-1], nodes[1:]], axis=1), axis=1)
        np.testing.assert_array_equal(steps, array[ids])
        assert (degree[nodes[1:-1]] == 2).all()
        assert nodes[0] == nodes[-1] or (degree[[nodes[0], nodes[-1]]] != 2).all()


class TestMeshEdges:
    def test_angles_are_those_of_the_bodies(self):
        edges = mesh_edges(triangle_mesh(CUBE, CUBE_FACES))
        assert len(edges.angles) == 18
        assert sorted(np.degrees(edges.angles).round(9)) == [0.0] * 6 + [90.0] * 12
        assert edges.is_convex[edges.angles > 1.0].all()

    def test_borders_and_bad_faces_have_no_angle(self):
        vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [2, 0, 0]], dtype=float)
        faces = [[0, 1, 2], [0, 1, 1], [1, 0, 3], [0, 1, 4], [0, 3, 2]]
        edges = mesh_edges(triangle_mesh(vertices, faces))
        assert edges.of_faces[1].tolist() == [-1, -1, -1]
        at = {tuple(pair): k for k, pair in enumerate(edges.vertices.tolist())}
        assert edges.angles[at[0, 1]] == 0.0  # three faces
        assert edges.angles[at[1, 2]] == 0.0  # one
        assert np.isfinite(edges.widths).all()

    def test_widths_share_the_area(self):
        shape = torus(resolution=12, jitter=0.2)
        mesh = triangle_mesh(shape.vertices, shape.faces)
        edges = mesh_edges(mesh)
        lengths = np.linalg.norm(np.diff(shape.vertices[edges.vertices], axis=1)[:, 0], axis=1)
        a, b, c = shape.vertices[shape.faces].swapaxes(0, 1)
        area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
        assert edges.widths @ lengths == pytest.approx(2.0 * area)
        assert len(edges.angles) == len(vertex_adjacency(mesh).vertices.indices) // 2


class TestRefusals:
    shape = sphere(resolution=4)

    @pytest.mark.parametrize(
        ("options", "message"),
        [
            ({"angle": 0.0}, "angle: got 0.0, expected degrees"),
            ({"angle": 181}, "angle: got 181"),
            ({"angle": "sharp"}, "angle: got 'sharp'"),
            ({"min_strength": -1.0}, "min_strength: got -1.0"),
            ({"min_strength": np.nan}, "min_strength: got nan"),
        ],
    )
    def test_of_parameters(self, options, message):
        with pytest.raises(InvalidParameterError, match=message):
            find_creases(self.shape.vertices, self.shape.faces, **options)

    def test_of_the_geometry_of_another_mesh(self):
        geometry = estimate_vertex_geometry(CUBE, CUBE_FACES)
        with pytest.raises(InvalidParameterError, match="geometry: got that of 8 vertices, expected 162"):
            find_creases(self.shape.vertices, self.shape.faces, geometry)

    def test_of_point_clouds(self):
        with pytest.raises(InvalidMeshError, match="faces: got none"):
            find_creases(CUBE, np.empty((0, 3), dtype=int))
