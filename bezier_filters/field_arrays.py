"""Fields of vertices as arrays: numbers (n,) and vectors (n, 3), or columns with one for each component.

Programs that know vectors get arrays; tables, as PLY files, get columns. Integers stay integers.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bezier_filters.fields import AXES, FIELDS, NORMAL_COLUMNS, PREFIX, QUALITY, fields_of

_INTEGERS = frozenset(field.column for field in FIELDS if field.integer)
_SINGLE = np.finfo(np.float32)


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


def shrink(name: str, values: NDArray[Any], columns: Mapping[str, NDArray[Any]]) -> NDArray[Any]:
    """A column (n,), or vectors (n, 3), in the smallest type that holds it, given all scalar columns by name.

    Estimates and normals are rounded to single precision, 6e-8 of each value, and so is a quality that is one of the
    estimates: their standard errors are larger. Other numbers stay in double precision unless single holds them.

    >>> shrink("bz_fit_grade", np.array([9.0, 3.0]), {}).dtype, shrink("x", np.array([0.1]), {}).dtype
    (dtype('uint8'), dtype('float64'))
    """
    if name in _INTEGERS or values.dtype.kind in "iu":
        return _shrink_integers(values)
    if values.dtype != np.float64:
        return values
    is_estimate = name.startswith(PREFIX) or name in NORMAL_COLUMNS
    if name == QUALITY:
        is_estimate = any(
            np.array_equal(values, other) for key, other in columns.items() if key.startswith(PREFIX) and key != name
        )
    size = np.abs(values[(values != 0.0) & np.isfinite(values)])
    if is_estimate and (not size.size or (_SINGLE.tiny <= size.min() and size.max() <= _SINGLE.max)):
        return values.astype(np.float32)
    with np.errstate(over="ignore", under="ignore"):
        single = values.astype(np.float32)
    return single if np.array_equal(single, values, equal_nan=True) else values


def _shrink_integers(values: NDArray[Any]) -> NDArray[Any]:
    for kind in (np.uint8, np.int8, np.uint16, np.int16, np.int32):
        with np.errstate(invalid="ignore"):
            small = values.astype(kind)
        if np.array_equal(small, values):
            return small
    return values
