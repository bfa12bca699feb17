"""Binary PLY files with any columns, as `ply_text` makes text ones."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

_TYPES = {"double": "<f8", "float": "<f4", "int": "<i4", "uchar": "u1"}


def ply_binary(elements: Mapping[str, Mapping[str, NDArray[np.generic]]], comments: Sequence[str] = ()) -> bytes:
    r"""Content of a PLY file, given the columns of its elements by declarations such as ``double x``; lists are (n, k).

    >>> ply_binary({"face": {"list uchar int vertex_indices": np.array([[0, 1, 2]])}})[-13:]
    b'\x03\x00\x00\x00\x00\x01\x00\x00\x00\x02\x00\x00\x00'
    """
    head, tables = ["ply", "format binary_little_endian 1.0", *(f"comment {comment}" for comment in comments)], []
    for name, columns in elements.items():
        fields = list[tuple[str, NDArray[np.generic]]]()
        for declaration, values in columns.items():
            words = declaration.split()
            if words[0] == "list":
                fields.append((_TYPES[words[1]], np.full((len(values), 1), values.shape[1])))
            fields.append((_TYPES[words[-2]], values.reshape(len(values), -1)))
        count = len(next(iter(columns.values())))
        row = np.dtype([(str(k), kind, values.shape[1]) for k, (kind, values) in enumerate(fields)])
        table = np.zeros(count, row)
        for k, (_, values) in enumerate(fields):
            table[str(k)] = values
        tables.append(table)
        head += [f"element {name} {count}", *(f"property {declaration}" for declaration in columns)]
    return "\n".join([*head, "end_header\n"]).encode() + b"".join(table.tobytes() for table in tables)
