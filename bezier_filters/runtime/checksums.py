"""Checksums of files: what tells whether one has still the content that it had."""

import hashlib
import os

_BLOCK = 1 << 20  # bytes that are read at a time


def checksum_of(path: str | os.PathLike[str]) -> str:
    """BLAKE2 of a file, 32 hexadecimal digits; about a second for a gigabyte."""
    result = hashlib.blake2b(digest_size=16)
    with open(path, "rb", buffering=0) as stream:
        while block := stream.read(_BLOCK):
            result.update(block)
    return result.hexdigest()
