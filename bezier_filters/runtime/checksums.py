"""Checksums of files, to detect changes of their content."""

import hashlib
import os
from typing import Protocol

_HASH_BLOCK_BYTES = 1 << 20  # read at a time


class Readable(Protocol):
    """A binary stream."""

    def read(self, size: int, /) -> bytes | None:
        """At most `size` bytes, none at the end."""


def file_checksum(path: str | os.PathLike[str]) -> str:
    """BLAKE2 of a file, 32 hexadecimal digits; about a second for a gigabyte."""
    with open(path, "rb", buffering=0) as stream:
        return stream_checksum(stream)


def stream_checksum(stream: Readable) -> str:
    """BLAKE2 of what a stream still has, as of `file_checksum`."""
    result = hashlib.blake2b(digest_size=16)
    while block := stream.read(_HASH_BLOCK_BYTES):
        result.update(block)
    return result.hexdigest()
