"""Which texels faces cover, and what is beyond their rims."""

import numpy as np
import pytest

from bezier_filters.errors import InvalidParameterError
from bezier_filters.surfaces import height_field
from bezier_filters.textures.texels import cover_texels, dilate


def sheet(jitter=0.3, resolution=12):
    """Triangles of the unit square as texture coordinates of their corners."""
    flat = height_field(lambda x, y: (0, 0, 0, 0, 0, 0), resolution=resolution, jitter=jitter)
    low, high = flat.vertices[:, :2].min(axis=0), flat.vertices[:, :2].max(axis=0)
    return ((flat.vertices[:, :2] - low) / (high - low))[flat.faces]


@pytest.mark.parametrize("size", [1, 7, 64, 301])
def test_faces_of_a_sheet_cover_every_texel_once(size):
    texels = cover_texels(sheet(), size)
    assert sorted(texels.places) == list(range(size * size))
    assert texels.overlapping == 0


def test_lattice_lines_through_centres_belong_to_one_face():
    """Vertices, horizontal, vertical and diagonal edges pass exactly through centres of texels."""
    size = 16
    steps = (np.arange(5) * 4 + 0.5) / size
    x, y = np.meshgrid(steps, steps, indexing="ij")
    points = np.stack([x.ravel(), y.ravel()], axis=1)
    a = np.array([i * 5 + j for i in range(4) for j in range(4)])
    faces = np.vstack([np.stack([a, a + 5, a + 6], axis=1), np.stack([a, a + 6, a + 1], axis=1)])
    texels = cover_texels(points[faces], size)
    assert texels.overlapping == 0
    assert len(texels.places) == 16**2  # half-open, 16 texels in each direction
    assert len(np.unique(texels.places)) == 16**2


def test_a_linear_function_of_the_texture_is_exact():
    size, corners = 200, sheet()
    texels = cover_texels(corners, size)
    values = 0.3 + 2.0 * corners[..., 0] - 0.7 * corners[..., 1]
    found = np.einsum("kc,kc->k", texels.weights, values[texels.faces])
    row, column = np.divmod(texels.places, size)
    u, v = (column + 0.5) / size, 1.0 - (row + 0.5) / size
    np.testing.assert_allclose(found, 0.3 + 2.0 * u - 0.7 * v, atol=1e-13)


def test_orientation_in_the_texture_does_not_matter():
    corners = sheet()
    texels, mirrored = cover_texels(corners, 90), cover_texels(corners[:, ::-1], 90)
    order, others = np.argsort(texels.places), np.argsort(mirrored.places)
    np.testing.assert_array_equal(texels.faces[order], mirrored.faces[others])
    np.testing.assert_allclose(texels.weights[order], mirrored.weights[others][:, ::-1], atol=1e-12)


def test_overlapping_texels_belong_to_the_first_face():
    whole = np.array([[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]])
    texels = cover_texels(np.vstack([whole, 0.5 * whole]), 64)
    assert not texels.faces.any()
    assert texels.overlapping == len(cover_texels(0.5 * whole, 64).places) > 400


def test_the_texture_repeats_beyond_its_rims():
    corners = 0.913 * sheet() + 0.017
    texels, moved = cover_texels(corners, 128), cover_texels(corners + np.array([3.0, -2.0]), 128)
    order, others = np.argsort(texels.places), np.argsort(moved.places)
    np.testing.assert_array_equal(texels.places[order], moved.places[others])
    np.testing.assert_array_equal(texels.faces[order], moved.faces[others])


def test_faces_over_many_images_are_refused():
    with pytest.raises(InvalidParameterError, match=r"texture_coordinates: the faces cover the image 1\.25e\+09 times"):
        cover_texels(np.array([[[0.0, 0.0], [5e4, 0.0], [0.0, 5e4]]]), 64)


def test_dilation_repeats_the_nearest_value_up_to_the_padding():
    image, covered = np.zeros((20, 20), dtype=np.float32), np.zeros((20, 20), dtype=np.bool_)
    covered[10, 10], image[10, 10] = True, 0.7
    dilate(image, covered, 3)
    row, column = np.indices(image.shape)
    near = np.hypot(row - 10, column - 10) <= 3.0
    np.testing.assert_array_equal(image, np.where(near, np.float32(0.7), np.float32(0.0)))
