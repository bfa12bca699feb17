"""Fields as data of VTK's meshes: vectors as arrays with three components, integers as integers."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from vtkmodules.util.numpy_support import numpy_to_vtk

from bezier_filters.fields import AXES, NORMAL
from bezier_filters_adapters.filled_fields import Values


def set_fields(data: Any, fields: Mapping[str, Values]) -> None:
    """Add arrays to point data or cell data, or replace them; `NORMAL` becomes the active normals."""
    for name, values in fields.items():
        array = numpy_to_vtk(np.ascontiguousarray(values), deep=True)
        array.SetName(name)
        if values.ndim > 1:
            for k, axis in enumerate(AXES):
                array.SetComponentName(k, axis)
        data.AddArray(array)
        if name == NORMAL:
            data.SetActiveNormals(name)
