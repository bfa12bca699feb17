"""Names for the types of arrays, and of reports."""

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

FloatArray: TypeAlias = NDArray[np.float64]
SingleArray: TypeAlias = NDArray[np.float32]
RealArray: TypeAlias = NDArray[np.float64] | NDArray[np.float32]
IntArray: TypeAlias = NDArray[np.int32]
ByteArray: TypeAlias = NDArray[np.int8]
BoolArray: TypeAlias = NDArray[np.bool_]
Report: TypeAlias = dict[str, Any]  # what a filter tells, by name: plain values that can be written as JSON
