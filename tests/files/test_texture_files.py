"""PNG files of baked textures, read by other libraries."""

import dataclasses

import numpy as np
import pytest

from bezier_filters import InvalidParameterError, bake_texture, save_texture

TRIANGLE = bake_texture([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], [[0, 0], [1, 0], [0, 1]], size=4)


def texture_of(values):
    """A texture with some values."""
    return dataclasses.replace(TRIANGLE, image=np.asarray(values, dtype=np.float32))


GREY = np.linspace(0.0, 1.0, 65536).reshape(256, 256)[:, ::-1]
COLORS = np.random.default_rng(0).random((30, 40, 3))


@pytest.mark.parametrize(("bits", "largest"), [(8, 255), (16, 65535)])
def test_grey_is_read_by_pillow(bits, largest, tmp_path):
    library = pytest.importorskip("PIL.Image", reason="Pillow is not installed")
    save_texture(tmp_path / "a.png", texture_of(GREY), bits=bits)
    with library.open(tmp_path / "a.png") as image:
        assert image.mode == {8: "L", 16: "I;16"}[bits]
        found = np.asarray(image).astype(np.int64)
    np.testing.assert_array_equal(found, np.floor(GREY.astype(np.float32) * np.float64(largest) + 0.5))


@pytest.mark.parametrize(("bits", "largest"), [(8, 255), (16, 65535)])
def test_colours_are_read_by_vtk(bits, largest, tmp_path):
    pyvista = pytest.importorskip("pyvista", reason="pyvista is not installed")
    save_texture(tmp_path / "a.png", texture_of(COLORS), bits=bits)
    grid = pyvista.read(tmp_path / "a.png")  # from the bottom
    found = np.asarray(grid.active_scalars).reshape(30, 40, 3)[::-1].astype(np.int64)
    np.testing.assert_array_equal(found, np.floor(COLORS.astype(np.float32) * np.float64(largest) + 0.5))


@pytest.mark.parametrize(("bits", "middle"), [(8, 128), (16, 32768)])
def test_a_plane_is_mid_grey(bits, middle, tmp_path):
    library = pytest.importorskip("PIL.Image", reason="Pillow is not installed")
    save_texture(tmp_path / "a.png", TRIANGLE, bits=bits)
    with library.open(tmp_path / "a.png") as image:
        assert set(np.unique(np.asarray(image))) == {middle}


def test_other_files_and_bits_are_refused(tmp_path):
    with pytest.raises(InvalidParameterError, match=r"path: got .*a\.jpg, expected a name that ends in \.png"):
        save_texture(tmp_path / "a.jpg", TRIANGLE)
    with pytest.raises(InvalidParameterError, match=r"bits: got 12, expected 8 or 16"):
        save_texture(tmp_path / "a.png", TRIANGLE, bits=12)
    assert list(tmp_path.iterdir()) == []
