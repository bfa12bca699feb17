"""A window that shows panels, to be turned with the mouse."""

import ctypes
import ctypes.util
import math
import os
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, cast

from bezier_filters.pictures import rendering
from bezier_filters.pictures.render import Panel, RenderingUnavailableError, panel_limits, require_libraries

if TYPE_CHECKING:
    import pyvista

_REMEDY = "`bezier-filters render` draws a picture without one"

_BAR: dict[str, Any] = {
    "color": "black",
    "title_font_size": 16,
    "label_font_size": 14,
    "n_labels": 3,
    "position_x": 0.2,
    "position_y": 0.04,
    "width": 0.6,
    "height": 0.1,
    "fmt": "%.3g",
}
_ZOOM = 1.3  # the window first has room for a ball around the mesh


def check_display() -> None:
    """Refuse to open a window where there is no display.

    Raises
    ------
    RenderingUnavailableError
        With the remedy: `render` writes a picture.
    """
    if sys.platform in ("win32", "darwin") or os.environ.get("WAYLAND_DISPLAY"):
        return
    display = os.environ.get("DISPLAY")
    if not display:
        raise RenderingUnavailableError(f"there is no display to open a window on; {_REMEDY}")
    library = ctypes.util.find_library("X11")
    if library is None:  # VTK will tell
        return
    x11 = ctypes.CDLL(library)
    x11.XOpenDisplay.restype = ctypes.c_void_p
    x11.XCloseDisplay.argtypes = [ctypes.c_void_p]
    connection = x11.XOpenDisplay(None)
    if not connection:
        raise RenderingUnavailableError(f"cannot open the display {display!r}; {_REMEDY}")
    x11.XCloseDisplay(connection)


def show_panels(panels: Sequence[Panel], *, columns: int | None = None, up: str = "auto") -> None:
    """Open a window with the panels side by side, which turn together, until it is closed.

    Parameters
    ----------
    panels : sequence of Panel
        What is shown.
    columns : int, optional
        Panels in a row; by default all.
    up : str
        Axis that points up, as for `render_panels`.

    Raises
    ------
    RenderingUnavailableError
        If there is no display, or pyvista or matplotlib is missing.
    """
    require_libraries()
    check_display()
    window(panels, columns=columns, up=up).show()


def window(
    panels: Sequence[Panel], *, columns: int | None = None, up: str = "auto", off_screen: bool = False
) -> "pyvista.Plotter":
    """What `show_panels` shows; off the screen it can be photographed."""
    import pyvista

    columns = columns or len(panels)
    shape = (math.ceil(len(panels) / columns), columns)
    plotter: Any = pyvista.Plotter(
        shape=shape, lighting="none", title="bezier-filters", border=False, off_screen=off_screen
    )
    rendering.add_lights(plotter)  # to every subplot
    axes = rendering.view_axes("front", rendering.up_axis(panels) if up == "auto" else up)
    for number, panel in enumerate(panels):
        plotter.subplot(*divmod(number, columns))
        plotter.set_background("white")
        rendering.add_panel(plotter, panel, panel.vertices, panel_limits(panel))
        if panel.values is not None:
            unit = f" [{panel.unit}]" if panel.unit else ""
            # pyvista draws bars of one title once; the blanks are not seen.
            bar = plotter.add_scalar_bar(title=f"{panel.label}{unit}\n{' ' * number}", **_BAR)
            bar.SetVerticalTitleSeparation(6)
        plotter.add_text(panel.title, font_size=10, color="black")
        plotter.view_vector(axes[2], viewup=axes[1])
    plotter.link_views()
    plotter.camera.zoom(_ZOOM)
    return cast("pyvista.Plotter", plotter)
