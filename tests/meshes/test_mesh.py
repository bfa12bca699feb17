"""What a mesh is made of, and what is refused."""

import numpy as np
import pytest

from bezier_filters import InvalidMeshError, inspect_mesh, triangle_mesh


@pytest.mark.parametrize(
    ("vertices", "faces", "message"),
    [
        ([[0, 0]], [[0, 0, 0]], r"vertices: got shape \(1, 2\), expected \(n, 3\)"),
        ([[0, 0, np.nan]], np.empty((0, 3)), "1 of 1 have a coordinate that is NaN"),
        ([[0, 0, np.inf]], np.empty((0, 3)), "NaN or infinite"),
        ([["a", 0, 1]], np.empty((0, 3)), "vertices: expected real numbers"),
        (np.zeros((3, 3)), [[0, 1, 3]], "faces: indices run from 0 to 3, expected 0 to 2"),
        (np.zeros((3, 3)), [[0, 1, -1]], "faces: indices run from -1 to 1"),
        (np.zeros((4, 3)), [[0, 1, 2, 3]], r"faces: got shape \(1, 4\).*triangulate"),
        (np.zeros((3, 3)), [[0.0, 1.0, 2.0]], "faces: got dtype float64, expected integers"),
        (np.zeros((3, 3)), [[0, 1, 2], [0, 1]], "faces: expected integers"),
    ],
)
def test_bad_arrays_are_refused_by_name(vertices, faces, message):
    with pytest.raises(InvalidMeshError, match=message):
        triangle_mesh(vertices, faces)


def test_empty_meshes_are_meshes():
    assert triangle_mesh(np.empty((0, 3)), np.empty((0, 3))).vertex_count == 0
    assert inspect_mesh(triangle_mesh(np.zeros((2, 3)), [])).unreferenced_vertices == 2
