"""ParaView: the colour map and the limits of a field, where the process has the user's session."""

from typing import Any

from paraview.modules.vtkRemotingServerManager import vtkSMPropertyHelper, vtkSMProxyManager
from paraview.modules.vtkRemotingViews import vtkSMTransferFunctionManager, vtkSMTransferFunctionProxy

from bezier_filters_adapters.field_colors import FieldColors

_GROUP, _KIND = "lookup_tables", "PVLookupTable"  # ParaView has one table for each name of an array
_NEVER = -1  # the mode in which a table keeps its limits when its array is shown
_RGB = 0  # the colour space


def set_color_map(array: str, colors: FieldColors) -> bool:
    """Give the color map of an array its limits, and a new one its colours; False in the process of a remote server.

    A map that is there already keeps the colours that the user may have chosen.
    """
    session = vtkSMProxyManager.GetProxyManager().GetActiveSessionProxyManager()
    if session is None:
        return False
    is_new = session.GetProxy(_GROUP, f"{array}.{_KIND}") is None
    table = vtkSMTransferFunctionManager().GetColorTransferFunction(array, session)
    if is_new:
        _set_colors(table, colors)
    vtkSMPropertyHelper(table, "AutomaticRescaleRangeMode").Set(_NEVER)
    vtkSMTransferFunctionProxy.RescaleTransferFunction(table, *colors.limits)
    table.UpdateVTKObjects()
    return True


def _set_colors(table: Any, colors: FieldColors) -> None:
    """Values and colours of the table, x, r, g, b of each in a row."""
    count = len(colors.palette)
    low, high = colors.limits
    points = [number for k, rgb in enumerate(colors.palette) for number in (low + (high - low) * k / (count - 1), *rgb)]
    helper = vtkSMPropertyHelper(table, "RGBPoints")
    helper.SetNumberOfElements(len(points))
    for k, number in enumerate(points):
        helper.Set(k, float(number))
    vtkSMPropertyHelper(table, "ColorSpace").Set(_RGB)
    vtkSMPropertyHelper(table, "ScalarRangeInitialized").Set(1)
