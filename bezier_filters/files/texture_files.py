"""PNG files of baked textures, with 8 or 16 bits for each channel.

The usual libraries write either no more than 8 bits, or no colours with 16 bits: pymeshlab, Pillow, matplotlib.
"""

import os
import struct
import zlib
from pathlib import Path

import numpy as np

from bezier_filters.arguments import brief_repr, checks_arguments, path_of
from bezier_filters.errors import InvalidParameterError
from bezier_filters.runtime.atomic import atomic_write
from bezier_filters.runtime.file_names import printable_path
from bezier_filters.textures.bake import BakedTexture

BIT_DEPTHS = (8, 16)
_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_GREY_TYPE, _RGB_TYPE = 0, 2  # colour types of files
_UP = 2  # filter of a row: differences to the row above, which makes smooth images about half as large


def check_texture_file(path: str | os.PathLike[str], bits: int) -> Path:
    """Path of a PNG file; InvalidParameterError if its suffix is another, or for another number of bits."""
    file = Path(path_of(path))
    if file.suffix.lower() != ".png":
        raise InvalidParameterError(f"path: got {printable_path(file)}, expected a name that ends in .png")
    if bits not in BIT_DEPTHS:
        raise InvalidParameterError(f"bits: got {brief_repr(bits)}, expected 8 or 16")
    return file


@checks_arguments
def save_texture(path: str | os.PathLike[str], texture: BakedTexture, *, bits: int = 16) -> None:
    """Write a baked texture as a PNG file.

    The values are linear: programs must read the file as data, not as colours (in Blender: Non-Color).

    Parameters
    ----------
    path : path
        File to write or replace, ``.png``.
    texture : BakedTexture
        Result of `bake_texture`.
    bits : int
        Bits of each channel, 8 or 16. 0.5 becomes 128 of 255, or 32,768 of 65,535.

    Raises
    ------
    InvalidParameterError
        If the path has another suffix, or `bits` is another number.
    OSError
        If the file cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> from bezier_filters import bake_texture
    >>> baked = bake_texture([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], [[0, 0], [1, 0], [0, 1]], size=4)
    >>> path = Path(tempfile.mkdtemp()) / "curvature.png"
    >>> save_texture(path, baked)
    >>> path.read_bytes()[1:4]
    b'PNG'
    """
    file = check_texture_file(path, bits)
    largest = 2**bits - 1
    values = np.floor(texture.image * np.float64(largest) + 0.5).astype(">u2" if bits > 8 else "u1")
    height, width = values.shape[:2]
    rows = np.ascontiguousarray(values).view(np.uint8).reshape(height, -1)
    filtered = np.full((height, 1 + rows.shape[1]), _UP, dtype=np.uint8)
    filtered[:, 1:] = rows
    filtered[1:, 1:] -= rows[:-1]
    header = struct.pack(">IIBBBBB", width, height, bits, _RGB_TYPE if values.ndim == 3 else _GREY_TYPE, 0, 0, 0)
    with atomic_write(file) as temporary:
        temporary.write_bytes(
            _SIGNATURE
            + _chunk(b"IHDR", header)
            + _chunk(b"IDAT", zlib.compress(filtered.tobytes()))
            + _chunk(b"IEND", b"")
        )


def _chunk(kind: bytes, data: bytes) -> bytes:
    """A chunk of a PNG file: length, kind, data and checksum."""
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
