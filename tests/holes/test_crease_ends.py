"""Where creases end at a hole, and what surrounds its parts."""

import numpy as np
import pytest
from hole_cases import cube, filled_hole, off_the_cube, without_faces_near

from bezier_filters import fill_holes
from bezier_filters.holes.crease_ends import crease_ends, cut_hole, sharp_edge_graph, sub_hole_border, sub_hole_region
from bezier_filters.holes.hole_detection import find_holes
from bezier_filters.holes.influence_region import influence_regions
from bezier_filters.meshes.mesh import triangle_mesh
from bezier_filters.meshes.prepared_mesh import prepare_mesh


def region_and_creases(vertices, faces):
    """What surrounds the only hole of a mesh, and the creases there."""
    mesh = prepare_mesh(triangle_mesh(vertices, faces))
    (hole,) = find_holes(mesh)
    (region,) = influence_regions(mesh, [hole.loops])
    return region, sharp_edge_graph(region)


def ends_at_hole(vertices, faces):
    """Crease ends at the only hole of a mesh, where they are, and the edges of the rim that creases run along."""
    region, creases = region_and_creases(vertices, faces)
    ends, along_rim = crease_ends(region, creases)
    return ends, region.vertices[region.loops[0][[end.position for end in ends]]], along_rim


@pytest.mark.parametrize(("depth", "touching"), [(0.26, 1), (0.2, 4)])
def test_creases_that_touch_the_rim_do_not_cross_the_hole(depth, touching):
    """A hole in one side of a cube that reaches an edge of it at a vertex, or runs along it for a while."""
    vertices, faces = cube()
    centers = vertices[faces].mean(axis=1)
    offset = np.abs(centers - [-0.5, -0.5 + depth, 0.0])
    in_hole = (centers[:, 0] < -0.4999) & (offset[:, 1] + offset[:, 2] < 0.25)
    rim = np.intersect1d(faces[in_hole], faces[~in_hole])
    assert (vertices[rim, 1] < -0.4999).sum() == touching
    ends, _, along_rim = ends_at_hole(vertices, faces[~in_hole])
    assert not ends
    assert bool(along_rim) == (touching > 1)
    result = fill_holes(vertices, faces[~in_hole])
    assert filled_hole(result).method == "surface"
    assert off_the_cube(result.vertices[len(vertices) :]).max() < 1e-9


def test_crease_leaves_a_corner_of_the_rim():
    """A hole in two sides of a cube that ends at a corner: where the crease goes, none arrives there."""
    vertices, faces = cube()
    centers = vertices[faces].mean(axis=1)
    on_crease = (np.abs(vertices[:, :2] + 0.5).max(axis=1) < 1e-9) & (vertices[:, 2] < -0.2)
    in_hole = np.linalg.norm(centers - [-0.5, -0.5, -0.25], axis=1) < 0.2
    in_hole |= np.count_nonzero(on_crease[faces], axis=1) == 2
    assert (np.abs(vertices[np.intersect1d(faces[in_hole], faces[~in_hole])] + 0.5).max(axis=1) < 1e-9).any()
    ends, places, _ = ends_at_hole(vertices, faces[~in_hole])
    assert [end.is_convex for end in ends] == [True, True]
    (corner,) = np.flatnonzero(np.abs(places + 0.5).max(axis=1) < 1e-9)
    np.testing.assert_allclose(ends[corner].tangent, [0.0, 0.0, 1.0], atol=1e-6)
    result = fill_holes(vertices, faces[~in_hole])
    hole = filled_hole(result)
    assert (hole.method, hole.parts, hole.self_intersections) == ("creases", 2, 0)
    assert off_the_cube(result.vertices[len(vertices) :]).max() < 1e-6


def test_surroundings_of_a_part_are_those_of_the_hole():
    """Points of a curve through the hole have rows of their own, which are no vertices around it."""
    vertices, faces = cube()
    region, creases = region_and_creases(
        vertices, without_faces_near(vertices, faces, np.array([-0.5, -0.5, 0.0]), 0.2)
    )
    ends, along_rim = crease_ends(region, creases)
    cut = cut_hole(region, creases, ends, along_rim, [(0, 1)])
    start, stop = (int(region.loops[0][end.position]) for end in ends)
    count = region.rim_count
    curve = np.linspace(region.vertices[start], region.vertices[stop], 7)[1:-1]
    path = np.array([start, *range(count, count + len(curve)), stop], dtype=np.int32)
    points, sizes = np.vstack([region.rim_vertices, curve]), np.ones(count + len(curve))
    for number in (0, 1):
        loop = sub_hole_border(cut, [path], number)
        side = sub_hole_region(cut, number, points, sizes, loop, region.rim_edges)
        around = region.vertices[region.faces[cut.sub_hole_of_face == number]]
        np.testing.assert_array_equal(side.vertices[side.faces], around)
        np.testing.assert_array_equal(side.rim_vertices, points[loop])
        assert side.faces.min() < side.rim_count < side.faces.max()
        rows = side.ids[side.joined]
        assert len(rows) > 10
        assert {tuple(row) for row in rows.tolist()} <= {tuple(row) for row in region.rim_edges.tolist()}
