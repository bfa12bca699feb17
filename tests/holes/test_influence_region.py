"""What surrounds a hole: rings of faces, measures of its rim, and a sample of the points."""

import numpy as np
import pytest
from hole_cases import hole_around, without_faces_near
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial.distance import cdist, pdist

from bezier_filters.holes.influence_region import farthest_point_sample
from bezier_filters.surfaces import torus


def test_rims_are_measured_by_their_faces():
    """Gaps are what the angles of the faces leave of 2 pi, sizes the means of the edges at each vertex of a rim."""
    shape = torus(resolution=20, jitter=0.3)
    region = hole_around(shape.vertices, without_faces_near(shape.vertices, shape.faces, np.array([1.4, 0, 0]), 0.4))
    for k in range(region.rim_count):
        faces = region.faces[(region.faces == k).any(axis=1)]
        to = region.vertices - region.vertices[k]
        pairs = [[j for j in face.tolist() if j != k] for face in faces]
        cosines = [to[i] @ to[j] / np.linalg.norm(to[i]) / np.linalg.norm(to[j]) for i, j in pairs]
        assert region.gaps[k] == pytest.approx(2 * np.pi - np.arccos(cosines).sum())
        lengths = np.linalg.norm(to[np.setdiff1d(faces, k)], axis=1)
        assert region.sizes[k] == pytest.approx(lengths.mean())


def test_regions_are_the_rings_around_the_rim():
    """Ordered by ring, with all faces that have a vertex inside the outermost one."""
    shape = torus(resolution=20, jitter=0.3)
    faces = without_faces_near(shape.vertices, shape.faces, np.array([1.4, 0, 0]), 0.4)
    region = hole_around(shape.vertices, faces, rings=3)
    n = len(shape.vertices)
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    graph = coo_array((np.ones(len(edges)), edges.T), shape=(n, n))
    rim = region.ids[region.rings == 0]
    distances = dijkstra(graph, directed=False, unweighted=True, indices=rim, min_only=True)
    np.testing.assert_array_equal(np.sort(region.ids), np.flatnonzero(distances <= 3))
    np.testing.assert_array_equal(region.rings, distances[region.ids])
    assert (np.diff(region.rings) >= 0).all()
    expected = faces[(distances[faces] < 3).any(axis=1)]
    assert sorted(map(tuple, region.ids[region.faces])) == sorted(map(tuple, expected))


def test_sampled_points_are_as_far_apart_as_any_point_is_from_them():
    """The mean of all points counts as one of the sample, from which the first one is farthest."""
    points = np.random.default_rng(0).random((2000, 2)) @ np.eye(2, 3)
    rows = farthest_point_sample(points, np.ones(len(points), dtype=bool), 40)
    assert len(rows) == 40
    chosen = np.vstack([points[rows], points.mean(axis=0)])
    assert pdist(chosen).min() >= cdist(chosen, points).min(axis=0).max()
    order = np.random.default_rng(1).permutation(len(points))
    assert set(order[farthest_point_sample(points[order], np.ones(len(points), dtype=bool), 40)]) == set(rows)


def test_three_fourths_of_the_sample_are_near_if_there_are_so_many():
    points = np.random.default_rng(0).random((200, 3))
    for count, expected in ((100, 30), (20, 20)):
        near = np.arange(len(points)) < count
        assert near[farthest_point_sample(points, near, 40)].sum() >= expected
    far = points[:, 0] > 2.0
    assert len(farthest_point_sample(points, far, 40)) == 40
