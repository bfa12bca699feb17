"""Panels of surfaces with lines of curvature, torsion or given normal curvature."""

import numpy as np

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.feature_lines.crease_lines import COLORS as CREASE_COLORS
from bezier_filters.pictures.scene import Color, Panel
from bezier_filters.surface_lines.lines import FIELDS_OF, SurfaceLines
from bezier_filters.surface_lines.umbilics import Umbilic

LINE_COLORS: dict[str, Color] = {
    "max": CREASE_COLORS["ridge"],
    "min": CREASE_COLORS["ravine"],
    "plus": (0.85, 0.45, 0.05),
    "minus": (0.1, 0.5, 0.45),
}
UMBILIC_COLORS: dict[bool, Color] = {
    True: (0.0, 0.0, 0.0),
    False: (0.95, 0.75, 0.0),
}  # by whether the index is positive
_GREY_BELOW = 0.85
_RADIUS_OF_SPACING = 0.07  # of tubes, in spacings
_MARK_RADIUS = 3.5  # of the ring around an umbilic, in radii of the tubes


def line_panel(
    vertices: FloatArray, faces: IntArray, found: SurfaceLines, *, radius: float | None = None, title: str = ""
) -> Panel:
    """A surface (n, 3), (m, 3) with lines in a colour for each kind, to be drawn by `render_panels`.

    Lines of k_max are red, of k_min blue; the others orange and green. Umbilics have rings, black for a positive index
    and yellow for a negative one. The lines are tubes of a radius, by default 7 % of the spacing.
    """
    if radius is None and found.spacing is not None:
        radius = _RADIUS_OF_SPACING * found.spacing
    size = radius or float(np.linalg.norm(np.ptp(vertices, axis=0))) / 400.0
    lines = [(line.points, LINE_COLORS[line.kind]) for line in found.lines]
    lines += [(_ring(umbilic, _MARK_RADIUS * size), UMBILIC_COLORS[umbilic.index > 0.0]) for umbilic in found.umbilics]
    names = [(_NAMES[kind], LINE_COLORS[kind]) for kind in FIELDS_OF[found.family]]
    signs = {umbilic.index > 0.0 for umbilic in found.umbilics}
    names += [(f"umbilics, {'+' if sign else '-'}1/2", UMBILIC_COLORS[sign]) for sign in (True, False) if sign in signs]
    return Panel(
        vertices,
        faces,
        colors=np.full((len(vertices), 3), _GREY_BELOW),
        title=title,
        names=names,
        lines=lines,
        line_radius=size,
    )


_NAMES = {"max": "lines of k_max", "min": "lines of k_min", "plus": "left of k_max", "minus": "right of k_max"}


def _ring(umbilic: Umbilic, radius: float) -> FloatArray:
    """A circle around an umbilic, on its tangent plane."""
    across = np.cross(umbilic.normal, np.eye(3)[np.abs(umbilic.normal).argmin()])
    across /= np.linalg.norm(across)
    angles = np.linspace(0.0, 2.0 * np.pi, 13)[:, np.newaxis]
    other = np.cross(umbilic.normal, across)
    return np.asarray(umbilic.point + radius * (np.cos(angles) * across + np.sin(angles) * other))
