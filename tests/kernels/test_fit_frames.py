"""Local axes of single neighbourhoods, whose planes are known."""

import numpy as np
import pytest
from compiled import from_python
from high_precision import farthest_direction, vector

from bezier_filters.kernels.fit_frames import complete_axes, write_edge
from bezier_filters.kernels.kernel_input import FITTED, ILL_POSED, kernel_mesh
from bezier_filters.meshes.adjacency import vertex_adjacency
from bezier_filters.meshes.frames import tangent_planes
from bezier_filters.meshes.mesh import triangle_mesh
from bezier_filters.runtime.lanes import LANES


def frame_of(points, neighbours, normal, *, any_axis, x_axis=None):
    """Outcome and axes (3, 3) of the first of some points, of which the next ones are its neighbours."""
    mesh = triangle_mesh(points, np.empty((0, 3), dtype=np.int32))
    adjacency = vertex_adjacency(mesh)
    around = kernel_mesh(mesh, adjacency, tangent_planes(mesh, adjacency))
    if x_axis is not None:
        around = around._replace(x_axes=np.tile(np.array(x_axis, dtype=np.float64), (len(points), 1)))
    frame = np.concatenate([np.full(6, np.nan), normal])
    members = np.arange(len(points), dtype=np.int32)
    outcome = from_python(write_edge)(around, any_axis, members, len(points), neighbours, frame)
    frames = np.repeat(frame, LANES)
    from_python(complete_axes)(frames)
    return outcome, frames.reshape(3, 3, LANES)[..., -1]


@pytest.mark.parametrize("seed", range(5))
def test_x_points_to_the_neighbour_that_projects_farthest(seed):
    rng = np.random.default_rng(seed)
    points = np.vstack([np.zeros(3), rng.standard_normal((11, 3))])
    normal = np.linalg.qr(rng.standard_normal((3, 3)))[0][:, 0]
    outcome, axes = frame_of(points, 6, normal, any_axis=False)
    expected = np.array(farthest_direction([vector(p) for p in points[1:7]], vector(normal)), dtype=np.float64)
    assert outcome == FITTED
    np.testing.assert_allclose(axes, [expected, np.cross(normal, expected), normal], atol=1e-14)


def test_x_points_to_the_first_neighbour_where_any_axis_will_do():
    points = np.array([[0, 0, 0], [0.5, 0, 0.2], [0, 2, 0], [-1, -1, 0]], dtype=np.float64)
    outcome, axes = frame_of(points, 3, [0.0, 0.0, 1.0], any_axis=True)
    assert outcome == FITTED
    np.testing.assert_allclose(axes, np.eye(3), atol=1e-15)


@pytest.mark.parametrize("any_axis", [False, True])
def test_neighbours_that_all_project_onto_the_vertex_give_no_axes(any_axis):
    points = np.array([[0, 0, 0], [0, 0, 1], [0, 0, -2]], dtype=np.float64)
    assert frame_of(points, 2, [0.0, 0.0, 1.0], any_axis=any_axis)[0] == ILL_POSED


def test_x_points_as_is_given_unless_that_is_along_the_normal():
    points = np.array([[0, 0, 0], [0.5, 0, 0.2], [0, 2, 0], [-1, -1, 0]], dtype=np.float64)
    given = frame_of(points, 3, [0.0, 0.0, 1.0], any_axis=False, x_axis=[3.0, -3.0, 7.0])[1]
    np.testing.assert_allclose(given[0], np.array([1.0, -1.0, 0.0]) / np.sqrt(2.0), atol=1e-15)
    for useless in ([0.0, 0.0, 2.0], [0.0, 0.0, 0.0]):
        farthest = frame_of(points, 3, [0.0, 0.0, 1.0], any_axis=False, x_axis=useless)[1]
        np.testing.assert_allclose(farthest[0], [0.0, 1.0, 0.0], atol=1e-15)
