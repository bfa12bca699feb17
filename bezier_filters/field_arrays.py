"""Fields of vertices as arrays: numbers (n,) and vectors (n, 3), or columns with one for each component.

Programs that know vectors get arrays; tables, as PLY files, get columns. Integers stay integers.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bezier_filters.fields import AXES, FIELDS, PREFIX, fields_of

_INTEGERS = frozenset(field.column for field in FIELDS if field.integer)


def result_arrays(result: object, *filters: str) -> dict[str, NDArray[Any]]:
    """Arrays of the fields of some filters in a result, by name, such as ``bz_k_min`` and ``bz_direction_max``."""
    fields = [field for field in fields_of(*filters) if field.attribute is not None]
    return {field.array: np.asarray(getattr(result, field.source)) for field in fields}


def split_vectors(arrays: Mapping[str, ArrayLike]) -> dict[str, NDArray[Any]]:
    """Columns of arrays (n,) and (n, 3): a vector has three, whose names end in _x, _y and _z.

    >>> {name: values.tolist() for name, values in split_vectors({"k": [1.0], "d": [[0.0, 1.0, 2.0]]}).items()}
    {'k': [1.0], 'd_x': [0.0], 'd_y': [1.0], 'd_z': [2.0]}
    """
    columns: dict[str, NDArray[Any]] = {}
    for name, given in arrays.items():
        values = np.asarray(given)
        if values.ndim == 1:
            columns[name] = values
        else:
            columns |= {f"{name}_{axis}": values[:, k] for k, axis in enumerate(AXES)}
    return columns


def join_vectors(columns: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Arrays of columns: three whose names begin with ``bz_`` and end in _x, _y and _z make a vector (n, 3).

    Codes and counts become integers.

    >>> join_vectors({"bz_d_x": np.array([0.0]), "bz_d_y": np.array([1.0]), "bz_d_z": np.array([2.0])})
    {'bz_d': array([[0., 1., 2.]])}
    """
    arrays: dict[str, NDArray[Any]] = {}
    for name, values in columns.items():
        stem = name[:-2]
        parts = [f"{stem}_{axis}" for axis in AXES]
        if name.startswith(PREFIX) and name in parts and all(part in columns for part in parts):
            if stem not in arrays:
                arrays[stem] = np.stack([columns[part] for part in parts], axis=1)
        else:
            arrays[name] = values.astype(np.int32) if name in _INTEGERS else values
    return arrays
