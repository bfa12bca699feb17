"""Type aliases for arrays and reports; distinct rows of an array."""

from typing import Any, TypeAlias, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

FloatArray: TypeAlias = NDArray[np.float64]
SingleArray: TypeAlias = NDArray[np.float32]
RealArray: TypeAlias = NDArray[np.float64] | NDArray[np.float32]
IntArray: TypeAlias = NDArray[np.int32]
ByteArray: TypeAlias = NDArray[np.int8]
BoolArray: TypeAlias = NDArray[np.bool_]
Report: TypeAlias = dict[str, Any]  # report of a filter: plain values that can be written as JSON

Rows = TypeVar("Rows", bound=NDArray[Any])


def unique_rows(rows: Rows) -> tuple[Rows, NDArray[np.intp]]:
    """Distinct rows of an array (n, k) in lexicographic order, and the index of each row among them, (n,).

    `np.unique` with an axis compares records in Python code of NumPy, where an interrupt becomes a TypeError.

    >>> distinct, place = unique_rows(np.array([[2, 1], [1, 3], [2, 1]]))
    >>> distinct.tolist(), place.tolist()
    ([[1, 3], [2, 1]], [1, 0, 1])
    """
    order = np.lexsort(rows.T[::-1])
    ordered = rows[order]
    is_new = np.ones(len(rows), dtype=np.bool_)
    is_new[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    place = np.empty(len(rows), dtype=np.intp)
    place[order] = np.cumsum(is_new) - 1
    return cast("Rows", ordered[is_new]), place
