"""Images of coloured meshes as arrays, drawn off screen with pyvista."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.display.palettes import AUTO, matplotlib_colormap
from bezier_filters.errors import InvalidMeshError, InvalidParameterError

MARGIN = 4  # pixels around the mesh

_SUPERSAMPLING = 2  # rendered larger and averaged: smooth edges on every graphics driver
_NAN_COLOR = "lightgray"
_AMBIENT = 0.45  # share of the colour that no shadow takes
_SMOOTH_BUT_FOR_EDGES: dict[str, Any] = {
    "split_vertices": True,
    "feature_angle": 60.0,
    "consistent_normals": False,  # both sides of a face are lit alike
    "auto_orient_normals": False,
}

# Right, up and towards the viewer, each in the coordinates (right, up, towards) of the front view.
_VIEWS = {
    "front": ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    "back": ((-1, 0, 0), (0, 1, 0), (0, 0, -1)),
    "left": ((0, 0, 1), (0, 1, 0), (-1, 0, 0)),
    "right": ((0, 0, -1), (0, 1, 0), (1, 0, 0)),
    "top": ((1, 0, 0), (0, 0, -1), (0, 1, 0)),
    "bottom": ((1, 0, 0), (0, 0, 1), (0, -1, 0)),
}
_ISO_TOWARDS = (1.0, 0.8, 1.6)

# The same for the front view itself, by the axis that points up, in the coordinates of the mesh.
_FRONT = {
    "x": ((0, -1, 0), (1, 0, 0), (0, 0, 1)),
    "y": ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    "z": ((1, 0, 0), (0, 0, 1), (0, -1, 0)),
    "-x": ((0, -1, 0), (-1, 0, 0), (0, 0, -1)),
    "-y": ((1, 0, 0), (0, -1, 0), (0, 0, -1)),
    "-z": ((1, 0, 0), (0, 0, -1), (0, 1, 0)),
}

VIEW_NAMES = (*_VIEWS, "iso")
UP_AXES = tuple(_FRONT)


class RenderingUnavailableError(ImportError):
    """Pyvista or matplotlib, which pictures need, cannot be imported."""


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
        ``"auto"`` (``"Cool Warm"`` if `signed`, else ``"Viridis"``), ``"Paper"``, or any colour map of matplotlib.
    colors : (n, 3) or (n, 4) array, optional
        Colours instead of `values`: floats in 0..1 or uint8.
    title : str
        Text above the column.
    histogram : bool
        Whether a histogram of the values stands on the colour bar: how many vertices have each colour.

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
    colors: NDArray[Any] | None = None
    title: str = ""
    histogram: bool = False

    def __post_init__(self) -> None:
        n = len(self.vertices)
        if np.shape(self.vertices) != (n, 3) or n == 0:
            raise InvalidMeshError(f"vertices have the shape {np.shape(self.vertices)}, expected (n, 3) with n > 0")
        if not np.isfinite(self.vertices).all():
            raise InvalidMeshError("some vertices are not finite")
        if len(self.faces) and np.shape(self.faces)[1:] != (3,):
            raise InvalidMeshError(f"faces have the shape {np.shape(self.faces)}, expected (m, 3)")
        if len(self.faces) and (np.min(self.faces) < 0 or np.max(self.faces) >= n):
            raise InvalidMeshError(f"faces name vertices {np.min(self.faces)} to {np.max(self.faces)} of {n}")
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


@dataclass(frozen=True)
class View:
    """A direction of sight on a mesh.

    Attributes
    ----------
    axes : (3, 3) float64
        Rows: the directions right, up and towards the viewer, orthonormal.
    low, high : (3,) float64
        Bounds of the mesh in these directions.
    """

    axes: FloatArray
    low: FloatArray
    high: FloatArray

    @property
    def extent(self) -> FloatArray:
        """Width, height and depth, shape (3,), in units of length."""
        return self.high - self.low


def up_axis(panels: Sequence[Panel]) -> str:
    """Axis that points up, guessed from the shape so that the front view is never the narrowest.

    It is y, as in MeshLab's first view, which also looks down on height fields z(x, y). Meshes
    that are tall in z stand upright (z), and those that lie flat in x and z are seen from above (-z).
    """
    low = np.min([panel.vertices[panel.drawn()].min(axis=0) for panel in panels], axis=0)
    high = np.max([panel.vertices[panel.drawn()].max(axis=0) for panel in panels], axis=0)
    x, y, z = high - low
    if z > 1.5 * max(x, y):
        return "z"
    return "-z" if min(x, z) > 1.5 * y else "y"


def view_axes(view: str, up: str) -> FloatArray:
    """Directions right, up and towards the viewer of a named view: the rows of a (3, 3) rotation.

    >>> view_axes("top", up="z").tolist()
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    """
    if view == "iso":
        towards = np.array(_ISO_TOWARDS) / np.linalg.norm(_ISO_TOWARDS)
        right = np.cross((0, 1, 0), towards)
        right /= np.linalg.norm(right)
        local = np.array([right, np.cross(towards, right), towards])
    else:
        local = np.array(_VIEWS[view], dtype=np.float64)
    result: FloatArray = local @ np.array(_FRONT[up], dtype=np.float64)
    return result


def view_of(panel: Panel, axes: FloatArray) -> View:
    """View of a panel's mesh along given axes."""
    projected = panel.vertices[panel.drawn()] @ axes.T
    return View(axes, projected.min(axis=0), projected.max(axis=0))


def draw(
    panel: Panel, views: Sequence[View], *, limits: tuple[float, float], scale: float, background: str
) -> list[NDArray[np.uint8]]:
    """Draw a panel from several sides with parallel projection, without title and colour bar.

    Parameters
    ----------
    panel : Panel
        What is drawn.
    views : sequence of View
        From where.
    limits : (low, high)
        Values of the lowest and highest colour; unused if the panel has colours.
    scale : float
        Pixels per unit of length.
    background : str
        Colour behind the mesh.

    Returns
    -------
    list of (height, width, 3) uint8
        One image per view, as large as the mesh and a margin of `MARGIN` pixels.
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
            add_panel(plotter, panel, (panel.vertices - center) * scale, limits)
            return [_photograph(plotter, view, center, scale) for view in views]
        finally:
            plotter.close()


def add_lights(plotter: Any) -> None:
    """Light the scene of a pyvista plotter so that surfaces facing the viewer have just their colour."""
    import pyvista

    # One light at the camera, one above its left shoulder. A surface that faces the camera gets
    # 0.55 + 0.66 cos(angle to the second) = 1 of the diffuse light: just its own colour.
    plotter.add_light(pyvista.Light(light_type="headlight", intensity=0.55))
    plotter.add_light(pyvista.Light(light_type="camera light", position=(-0.6, 0.9, 1.0), intensity=0.66))


def add_panel(plotter: Any, panel: Panel, points: FloatArray, limits: tuple[float, float]) -> None:
    """Add a panel's mesh, with its vertices at these points, to a pyvista plotter."""
    import pyvista

    options: dict[str, Any] = {"show_scalar_bar": False}
    if panel.colors is not None:
        colors = panel.colors if panel.colors.dtype == np.uint8 else np.round(255 * np.clip(panel.colors, 0, 1))
        options |= {"scalars": colors.astype(np.uint8), "rgb": True}
    else:
        # Values are interpolated within triangles and then coloured, which keeps to the colour map.
        options |= {
            "scalars": panel.values,
            "clim": limits,
            "cmap": matplotlib_colormap(panel.colormap, signed=panel.signed),
        }
        options |= {"interpolate_before_map": True, "nan_color": _NAN_COLOR}
    if len(panel.faces) == 0:
        size = _SUPERSAMPLING * float(np.clip(400 / np.sqrt(len(points)), 2, 2 * MARGIN))
        plotter.add_points(points, point_size=size, lighting=False, **options)
        return
    faces: Any = panel.faces
    mesh = pyvista.PolyData.from_regular_faces(points, faces)
    mesh.point_data["colored"] = options.pop("scalars")
    mesh = mesh.compute_normals(cell_normals=False, **_SMOOTH_BUT_FOR_EDGES)
    light = {"ambient": _AMBIENT, "diffuse": 1.0 - _AMBIENT, "specular": 0.0}
    actor = plotter.add_mesh(mesh, scalars="colored", **light, **options)
    actor.prop.interpolation = "Phong"


def _photograph(plotter: Any, view: View, center: FloatArray, scale: float) -> NDArray[np.uint8]:
    width, height = (int(np.ceil(side * scale)) + 2 * MARGIN for side in view.extent[:2])
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
    result: NDArray[np.uint8] = np.round(blocks.mean(axis=(1, 3))).astype(np.uint8)
    return result
