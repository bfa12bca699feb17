"""Columns of the curvature filter for a direction: curvature along it and across it, and plan curvature."""

from dataclasses import dataclass
from typing import TypeAlias

from bezier_filters.arguments import brief_repr
from bezier_filters.arrays import BoolArray, FloatArray, Report
from bezier_filters.differential_geometry import unit_directions
from bezier_filters.errors import InvalidParameterError
from bezier_filters.fields import CURVATURE, PREFIX, qualities
from bezier_filters.fitting.vertex_geometry import VertexGeometry
from bezier_filters.meshlab.meshset import BezierFilterError

Direction: TypeAlias = tuple[float, float, float]

# fields, and their names in terrain analysis
_OF_TERRAIN = {"curvature_along": "profile", "curvature_across": "tangential", "plan_curvature": "plan"}
NEED_DIRECTION = frozenset(word for word, field in qualities(CURVATURE).items() if field.name in _OF_TERRAIN)


@dataclass(frozen=True)
class DirectionColumns:
    """Columns for a direction; none without one."""

    columns: dict[str, FloatArray]  # each (n,)
    known: BoolArray  # (n,): where the quality is known
    report: Report
    remarks: list[str]


def check_direction(direction: Direction | None, quality: str | None) -> Direction | None:
    """A direction of length 1, or None if it is not given and the quality does not need it."""
    if direction is None:
        if quality in NEED_DIRECTION:
            raise BezierFilterError(f"direction: got None, which quality={quality!r} needs; gravity is (0, 0, -1)")
        return None
    try:
        ((x, y, z),) = unit_directions(direction, 1).tolist()
    except InvalidParameterError:
        x = y = z = 0.0
    if not (x or y or z):
        is_listed = isinstance(direction, tuple | list)
        got = f"({', '.join(map(brief_repr, direction))})" if is_listed else brief_repr(direction)
        raise BezierFilterError(f"direction: got {got}, expected three finite numbers, not all 0")
    return x, y, z


def direction_columns(
    geometry: VertexGeometry, direction: Direction | None, known: BoolArray, quality: str | None
) -> DirectionColumns:
    """Columns for a direction, where vertices of a mask (n,) have an estimate."""
    if direction is None:
        return DirectionColumns({}, known, {}, [])
    terrain = geometry.terrain_curvature(direction)
    square, count = int((known & ~terrain.is_defined).sum()), int(known.sum())
    remark = (
        f"direction: it is along the normal at {square:,} of {count:,} vertices, where its curvatures are stored as 0"
    )
    return DirectionColumns(
        {PREFIX + name: getattr(terrain, value) for name, value in _OF_TERRAIN.items()},
        known & terrain.is_defined if quality in NEED_DIRECTION else known,
        {"without_direction": square},
        [remark] if square else [],
    )
