"""Checksums of files, to detect changes of their content."""

import hashlib
import os

_HASH_BLOCK_BYTES = 1 << 20  # read at a time


def file_checksum(path: str | os.PathLike[str]) -> str:
    """BLAKE2 of a file, 32 hexadecimal digits; about a second for a gigabyte."""
    result = hashlib.blake2b(digest_size=16)
    with open(path, "rb", buffering=0) as stream:
        while block := stream.read(_HASH_BLOCK_BYTES):
            result.update(block)
    return result.hexdigest()
