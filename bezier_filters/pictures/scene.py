"""Panels, which are meshes with colours: drawn from several sides off screen, or in a window to be turned."""

import ctypes
import ctypes.util
import math
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.display import AUTO, color_range, matplotlib_colormap, round_limits
from bezier_filters.errors import InvalidMeshError, InvalidParameterError
from bezier_filters.meshes.mesh import triangle_mesh
from bezier_filters.pictures.views import AUTO_AXIS, choose_orientation, view_axes

if TYPE_CHECKING:
    import pyvista
    from matplotlib.colors import Normalize

Image: TypeAlias = NDArray[np.uint8]  # pixels (height, width, 3)
Color: TypeAlias = tuple[float, float, float]  # red, green and blue in 0..1

MARGIN_PIXELS = 4  # pixels around the mesh

_SUPERSAMPLING = 2  # rendered larger and averaged: smooth edges on every graphics driver
NAN_COLOR = (0.83, 0.83, 0.83)  # of values that are not known
_SHARP = 60.0  # degrees between faces from which on the edge between them is seen
_AMBIENT = 0.45  # share of the colour that no shadow takes
_LINES_PER_DIAGONAL = 400.0  # their radii in a row are as long as the diagonal of the bounding box
_SIDES = 12  # of tubes
_ZOOM = 1.3  # a window first has room for a ball around the meshes
_REMEDY = "`bezier-filters render` draws a picture without one"


class RenderingUnavailableError(ImportError):
    """Pyvista or matplotlib, which pictures need, cannot be imported."""


def require_libraries() -> None:
    """Refuse to draw without the libraries of the extra."""
    try:
        import matplotlib  # noqa: F401
        import pyvista  # noqa: F401
    except ImportError as error:
        raise RenderingUnavailableError(
            f'pictures need pyvista and matplotlib: pip install "bezier-filters[viz]" ({error})'
        ) from error


@dataclass(frozen=True)
class Panel:
    """A mesh and what colours it: one column of a sheet.

    Attributes
    ----------
    vertices : (n, 3) float64
        Finite positions.
    faces : (m, 3) int32
        Triangles; without any, the vertices are drawn as points.
    values : (n,) float64, optional
        Field that is coloured; values that are not finite are grey.
    label, unit : str
        For the colour bar, for example ``"mean curvature"`` and ``"1/length"``.
    signed : bool
        Whether zero is the middle of the colour range.
    limits : (low, high), optional
        Values of the lowest and highest colour; by default those of `color_range`.
    colormap : str
        ``"auto"`` (``"Cool Warm"`` if `signed`, else ``"Viridis"``), ``"Paper"``, ``"Paper Curvature"``, or any colour
        map of matplotlib.
    colors : (n, 3) or (n, 4) array, optional
        Colours instead of `values`: floats in 0..1 or uint8.
    back : (red, green, blue), optional
        Colour of the backs of faces, in 0..1; by default that of their fronts.
    title : str
        Text above the column.
    histogram : bool
        Whether a histogram of the values stands on the colour bar: how many vertices have each colour.
    linear_below : float, optional
        For a symmetric logarithmic scale: size of the values below which it is linear, positive.
    names : sequence of (str, (red, green, blue))
        What `colors`, or those of the lines, in 0..1, stand for: a key below the mesh.
    lines : sequence of ((k, 3) array, (red, green, blue))
        Points of lines, each joined to the next one, which are drawn as tubes.
    line_radius : float, optional
        Of the tubes, a length; by default a 400th of the diagonal of the bounding box.
    file_up : str
        Axis that points up by the convention of the file, see `file_up`; ``"auto"`` if there is none.

    Raises
    ------
    InvalidMeshError
        No vertices, some that are not finite, or faces that are not triangles of them.
    InvalidParameterError
        Not exactly one of `values` and `colors`, a wrong shape, or empty limits.
    """

    vertices: FloatArray
    faces: IntArray
    values: FloatArray | None = None
    label: str = ""
    unit: str = ""
    signed: bool = False
    limits: tuple[float, float] | None = None
    colormap: str = AUTO
    colors: FloatArray | Image | None = None
    back: Color | None = None
    title: str = ""
    histogram: bool = False
    linear_below: float | None = None
    names: Sequence[tuple[str, Color]] = ()
    lines: Sequence[tuple[FloatArray, Color]] = ()
    line_radius: float | None = None
    file_up: str = AUTO_AXIS

    def __post_init__(self) -> None:
        n = len(self.vertices)
        if n == 0:
            raise InvalidMeshError("vertices: got none, expected one or more")
        triangle_mesh(self.vertices, self.faces)
        if (self.values is None) == (self.colors is None):
            raise InvalidParameterError("a panel takes either values or colors")
        if self.values is not None and np.shape(self.values) != (n,):
            raise InvalidParameterError(f"values have the shape {np.shape(self.values)}, expected ({n},)")
        if self.colors is not None and np.shape(self.colors) not in ((n, 3), (n, 4)):
            raise InvalidParameterError(f"colors have the shape {np.shape(self.colors)}, expected ({n}, 3) or ({n}, 4)")
        if self.limits is not None and not -np.inf < self.limits[0] < self.limits[1] < np.inf:
            raise InvalidParameterError(f"limits {self.limits} are not two finite numbers, the lower one first")

    def drawn(self) -> BoolArray:
        """Which vertices are seen, shape (n,): those of faces, or all if there are none."""
        if len(self.faces) == 0:
            return np.ones(len(self.vertices), dtype=np.bool_)
        result = np.zeros(len(self.vertices), dtype=np.bool_)
        result[self.faces] = True
        return result

    def tube_radius(self) -> float:
        """Radius of the tubes that lines are drawn as, a length."""
        if self.line_radius is not None:
            return self.line_radius
        return float(np.linalg.norm(np.ptp(self.vertices, axis=0))) / _LINES_PER_DIAGONAL

    def color_limits(self) -> tuple[float, float]:
        """Values of the first and the last colour."""
        if self.limits is not None or self.values is None:
            return self.limits or (0.0, 1.0)
        return round_limits(*color_range(self.values, signed=self.signed, mask=self.drawn()))

    def norm(self) -> "Normalize":
        """How values become places on the colour bar, from 0 to 1."""
        from matplotlib.colors import Normalize, SymLogNorm

        low, high = self.color_limits()
        return SymLogNorm(self.linear_below, vmin=low, vmax=high) if self.linear_below else Normalize(low, high)


@dataclass(frozen=True)
class View:
    """A direction of sight on a mesh: axes right, up and towards the viewer, the rows of a rotation, and its bounds."""

    axes: FloatArray
    low: FloatArray
    high: FloatArray

    @property
    def extent(self) -> FloatArray:
        """Width, height and depth, shape (3,), in units of length."""
        return self.high - self.low


def orientation(panel: Panel, up: str = AUTO_AXIS, front: str = AUTO_AXIS) -> tuple[str, str]:
    """Axes that point up and towards the viewer in the front view of a panel, where they are not given."""
    if len(panel.faces):
        used, corners = np.unique(panel.faces, return_inverse=True)
        vertices, faces = panel.vertices[used], corners.reshape(-1, 3).astype(np.int32)
    else:
        vertices, faces = panel.vertices, panel.faces
    return choose_orientation(vertices, faces, up, front, convention=panel.file_up)


def view_of(panel: Panel, axes: FloatArray) -> View:
    """View of a panel's mesh and lines along given axes."""
    projected = panel.vertices[panel.drawn()] @ axes.T
    low, high = projected.min(axis=0), projected.max(axis=0)
    if panel.lines:
        points, radius = np.vstack([line for line, _ in panel.lines]) @ axes.T, panel.tube_radius()
        low, high = np.minimum(low, points.min(axis=0) - radius), np.maximum(high, points.max(axis=0) + radius)
    return View(axes, low, high)


def draw(panel: Panel, views: Sequence[View], *, scale: float, background: str) -> list[Image]:
    """Draw a panel from several sides with parallel projection, without title and colour bar.

    The scale is in pixels per unit of length; images are as large as the mesh, plus a margin of `MARGIN_PIXELS`.
    """
    import pyvista

    # Only errors: without a display, VTK warns that it falls back from X to EGL.
    with pyvista.vtk_verbosity("error"):
        plotter: Any = pyvista.Plotter(off_screen=True, lighting="none")
        try:
            add_lights(plotter)
            plotter.set_background(background)
            # In pixels about the origin, because graphics hardware computes in single precision.
            center = 0.5 * (views[0].low + views[0].high) @ views[0].axes
            add_panel(plotter, panel, center, scale)
            return [_photograph(plotter, view, center, scale) for view in views]
        finally:
            plotter.close()


def add_lights(plotter: "pyvista.Plotter") -> None:
    """Light a scene, in all subplots, so that surfaces facing the viewer have just their colour."""
    import pyvista

    # One light at the camera, one above its left shoulder. A surface that faces the camera gets
    # 0.55 + 0.66 cos(angle to the second) = 1 of the diffuse light: just its own colour.
    plotter.add_light(pyvista.Light(light_type="headlight", intensity=0.55))
    plotter.add_light(pyvista.Light(light_type="camera light", position=(-0.6, 0.9, 1.0), intensity=0.66))


def add_panel(plotter: "pyvista.Plotter", panel: Panel, center: FloatArray, scale: float) -> None:
    """Add a panel's mesh and its lines, around a centre (3,) and with so many units for one of length."""
    import pyvista

    points = (panel.vertices - center) * scale
    if panel.lines:
        radius = panel.tube_radius()
        for color in dict.fromkeys(color for _, color in panel.lines):
            lines = [(line - center) * scale for line, other in panel.lines if other == color]
            tubes = _polylines(lines).tube(radius=radius * scale, n_sides=_SIDES, capping=True)
            plotter.add_mesh(tubes, color=color, ambient=_AMBIENT, diffuse=1.0 - _AMBIENT, specular=0.0)
    options: dict[str, Any] = {"show_scalar_bar": False}
    colored: FloatArray | Image | None = panel.values
    if panel.colors is not None:
        colored = panel.colors
        if colored.dtype != np.uint8:
            colored = np.round(255 * np.clip(colored.astype(np.float64), 0.0, 1.0)).astype(np.uint8)
        options |= {"rgb": True}
    else:
        # Values are interpolated within triangles and then coloured, which keeps to the colour map.
        colormap = matplotlib_colormap(panel.colormap, signed=panel.signed)
        options |= {"clim": panel.color_limits(), "cmap": colormap, "interpolate_before_map": True}
        options |= {"nan_color": NAN_COLOR}
        if panel.linear_below and panel.values is not None:
            options["clim"], colored = (0.0, 1.0), np.ma.filled(panel.norm()(panel.values), np.nan)
    if len(panel.faces) == 0:
        size = _SUPERSAMPLING * float(np.clip(400 / np.sqrt(len(points)), 2, 2 * MARGIN_PIXELS))
        plotter.add_points(points, scalars=colored, point_size=size, lighting=False, **options)
        return
    faces: NDArray[Any] = panel.faces
    mesh = pyvista.PolyData.from_regular_faces(points, faces)
    mesh.point_data["colored"] = colored
    mesh = mesh.compute_normals(
        cell_normals=False,
        split_vertices=True,
        feature_angle=_SHARP,
        consistent_normals=False,  # both sides of a face are lit equally
        auto_orient_normals=False,
    )
    light: dict[str, Any] = {"ambient": _AMBIENT, "diffuse": 1.0 - _AMBIENT, "specular": 0.0}
    actor = plotter.add_mesh(mesh, scalars="colored", culling="back" if panel.back else None, **options, **light)
    actor.prop.interpolation = "Phong"
    if panel.back:
        actor = plotter.add_mesh(mesh.copy(deep=False), color=panel.back, culling="front", **light)
        actor.prop.interpolation = "Phong"


def _polylines(lines: Sequence[FloatArray]) -> "pyvista.PolyData":
    """Lines through the points (k, 3) of each."""
    import pyvista

    ends = np.cumsum([len(line) for line in lines])
    cells = [np.r_[len(line), np.arange(end - len(line), end)] for line, end in zip(lines, ends, strict=True)]
    return pyvista.PolyData(np.vstack(lines), lines=np.concatenate(cells))


def _photograph(plotter: Any, view: View, center: FloatArray, scale: float) -> Image:
    width, height = (int(np.ceil(side * scale)) + 2 * MARGIN_PIXELS for side in view.extent[:2])
    depth = view.extent[2] * scale + 1.0
    target = (0.5 * (view.low + view.high) - view.axes @ center) * scale @ view.axes
    camera = plotter.camera
    camera.parallel_projection = True
    camera.focal_point = target
    camera.position = target + depth * view.axes[2]
    camera.up = view.axes[1]
    camera.parallel_scale = 0.5 * height
    camera.clipping_range = (0.1 * depth, 2.0 * depth)
    plotter.window_size = (_SUPERSAMPLING * width, _SUPERSAMPLING * height)
    plotter.render()
    large = plotter.screenshot(None, return_img=True)[..., :3]
    blocks = large.reshape(height, _SUPERSAMPLING, width, _SUPERSAMPLING, 3)
    return np.asarray(np.round(blocks.mean(axis=(1, 3))).astype(np.uint8))


def check_display() -> None:
    """Refuse to open a window where there is no display."""
    if sys.platform in ("win32", "darwin") or os.environ.get("WAYLAND_DISPLAY"):
        return
    display = os.environ.get("DISPLAY")
    if not display:
        raise RenderingUnavailableError(f"there is no display to open a window on; {_REMEDY}")
    library = ctypes.util.find_library("X11")
    if library is None:  # VTK reports it
        return
    x11 = ctypes.CDLL(library)
    x11.XOpenDisplay.restype = ctypes.c_void_p
    x11.XCloseDisplay.argtypes = [ctypes.c_void_p]
    connection = x11.XOpenDisplay(None)
    if not connection:
        raise RenderingUnavailableError(f"cannot open the display {display!r}; {_REMEDY}")
    x11.XCloseDisplay(connection)


def show_panels(
    panels: Sequence[Panel], *, columns: int | None = None, up: str = AUTO_AXIS, front: str = AUTO_AXIS
) -> None:
    """Open a window with the panels side by side, which turn together, until it is closed."""
    require_libraries()
    check_display()
    window(panels, columns=columns, up=up, front=front).show()


def window(
    panels: Sequence[Panel],
    *,
    columns: int | None = None,
    up: str = AUTO_AXIS,
    front: str = AUTO_AXIS,
    off_screen: bool = False,
) -> Any:
    """Plotter of pyvista that `show_panels` shows; off the screen it can be photographed."""
    import pyvista

    columns = columns or len(panels)
    shape = (math.ceil(len(panels) / columns), columns)
    plotter: Any = pyvista.Plotter(shape=shape, lighting="none", border=False, off_screen=off_screen)
    plotter.title = "bezier-filters"
    add_lights(plotter)
    for number, panel in enumerate(panels):
        plotter.subplot(*divmod(number, columns))
        plotter.set_background("white")
        add_panel(plotter, panel, np.zeros(3), 1.0)
        if panel.values is not None:
            unit = f" [{panel.unit}]" if panel.unit else ""
            # pyvista draws bars of one title once; the blanks are not seen.
            bar = plotter.add_scalar_bar(
                title=f"{panel.label}{unit}\n{' ' * number}",
                color="black",
                title_font_size=16,
                label_font_size=14,
                n_labels=3,
                position_x=0.2,
                position_y=0.04,
                width=0.6,
                height=0.1,
                fmt="%.3g",
            )
            bar.SetVerticalTitleSeparation(6)
        if panel.names:
            plotter.add_legend(list(panel.names), bcolor=None, face="rectangle")
        plotter.add_text(panel.title, font_size=10, color="black")
    plotter.link_views()
    axes = view_axes("front", *orientation(panels[0], up, front))
    identity = np.eye(3)
    shown = [view_of(panel, identity) for panel in panels]
    low, high = np.min([view.low for view in shown], axis=0), np.max([view.high for view in shown], axis=0)
    plotter.camera.focal_point = 0.5 * (low + high)
    plotter.camera.position = plotter.camera.focal_point + axes[2]
    plotter.camera.up = axes[1]
    plotter.reset_camera(bounds=np.stack([low, high], axis=1).ravel())
    plotter.camera.zoom(_ZOOM)
    return plotter
