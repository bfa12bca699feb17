"""Lines of a page: creases, and lines of curvature, torsion or given normal curvature, a layer for each kind."""

from collections.abc import Iterator
from dataclasses import dataclass

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.feature_lines.crease_lines import Creases, edge_mesh
from bezier_filters.feature_lines.polylines import join_polylines
from bezier_filters.pictures.line_panels import LINE_NAMES, UMBILIC_NAMES
from bezier_filters.surface_lines.lines import FIELDS_OF, LINE_COLORS, UMBILIC_COLORS, SurfaceLines
from bezier_filters.surface_lines.umbilics import ring_around

_CREASE_COLORS = {"ridge": (0.8, 0.1, 0.1), "ravine": (0.1, 0.2, 0.8)}


@dataclass(frozen=True)
class LineLayer:
    """Lines of one name and colour."""

    key: str
    name: str
    color: tuple[float, ...]  # red, green, blue from 0 to 1
    points: FloatArray  # (k, 3)
    edges: IntArray  # (e, 2)


def crease_layers(creases: Creases) -> Iterator[LineLayer]:
    """Ridges and ravines."""
    for kind, color in _CREASE_COLORS.items():
        if lines := [line for line in creases.lines if line.kind == kind]:
            yield LineLayer(f"{kind}s", f"{kind}s", color, *edge_mesh(lines)[:2])


def line_layers(found: SurfaceLines) -> Iterator[LineLayer]:
    """Lines of each kind, and rings around the umbilics of each sign."""
    for kind in FIELDS_OF[found.family]:
        if lines := [line.points for line in found.lines if line.kind == kind]:
            yield LineLayer(f"lines_{kind}", LINE_NAMES[kind], LINE_COLORS[kind], *join_polylines(lines)[:2])
    for sign, name in UMBILIC_NAMES.items():
        if rings := [ring_around(one, found.mark_radius) for one in found.umbilics if (one.index > 0.0) == sign]:
            yield LineLayer(
                f"umbilics_{'plus' if sign else 'minus'}", name, UMBILIC_COLORS[sign], *join_polylines(rings)[:2]
            )
