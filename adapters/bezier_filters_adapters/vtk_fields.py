"""Fields as data of VTK's meshes: vectors as arrays with three components, integers as integers."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from vtkmodules.util.numpy_support import numpy_to_vtk

from bezier_filters.fields import AXES, NORMAL, NORMALS
from bezier_filters_adapters.filled_fields import Values
from bezier_filters_adapters.filters import FILL_HOLES


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


def choose_scalars(data: Any, name: str, fields: Mapping[str, Values]) -> str | None:
    """Make the first field of a filter the active scalars, which programs show; return its name if they are new.

    Normals are seen in the shading, and filled meshes keep the scalars that they have.
    """
    if name == NORMALS or (name == FILL_HOLES and data.GetScalars() is not None):
        return None
    shown = next(iter(fields))
    data.SetActiveScalars(shown)
    return shown
