"""Panels of surfaces with lines of curvature, torsion or given normal curvature."""

import numpy as np

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.pictures.scene import Panel
from bezier_filters.surface_lines.lines import FIELDS_OF, LINE_COLORS, UMBILIC_COLORS, SurfaceLines
from bezier_filters.surface_lines.umbilics import ring_around

_GREY_BELOW = 0.85
_RADIUS_OF_SPACING = 0.07  # of tubes, in spacings


def line_panel(
    vertices: FloatArray,
    faces: IntArray,
    found: SurfaceLines,
    *,
    radius: float | None = None,
    title: str = "",
) -> Panel:
    """A surface (n, 3), (m, 3) with lines in a colour for each kind, to be drawn by `render_panels`.

    Lines of k_max are red, of k_min blue; the others orange and green. Umbilics have rings, black for a positive index
    and yellow for a negative one. The lines are tubes of a radius, by default 7 % of the spacing.
    """
    size = radius or _RADIUS_OF_SPACING * (found.spacing or found.default_spacing)
    lines = [(_thin(line.points), LINE_COLORS[line.kind]) for line in found.lines]
    lines += [
        (ring_around(umbilic, found.mark_radius), UMBILIC_COLORS[umbilic.index > 0.0]) for umbilic in found.umbilics
    ]
    names = [(LINE_NAMES[kind], LINE_COLORS[kind]) for kind in FIELDS_OF[found.family]]
    signs = {umbilic.index > 0.0 for umbilic in found.umbilics}
    names += [(UMBILIC_NAMES[sign], UMBILIC_COLORS[sign]) for sign in (True, False) if sign in signs]
    return Panel(
        vertices,
        faces,
        colors=np.full((len(vertices), 3), _GREY_BELOW),
        title=title,
        names=names,
        lines=lines,
        line_radius=size,
    )


def _thin(points: FloatArray) -> FloatArray:
    """Every other point, and the last one: tubes take most of the time of a picture."""
    return np.vstack([points[:-1:2], points[-1:]])


UMBILIC_NAMES = {True: "umbilics of positive index", False: "umbilics of negative index"}
LINE_NAMES = {"max": "lines of k_max", "min": "lines of k_min", "plus": "left of k_max", "minus": "right of k_max"}
