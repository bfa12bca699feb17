"""Columns of the files that are written: which there are, which are wanted, and tables of them."""

from collections.abc import Mapping, Sequence
from functools import cache

import numpy as np

from bezier_filters.arrays import FloatArray
from bezier_filters.errors import InvalidParameterError
from bezier_filters.estimation.vertex_geometry import VertexGeometry, empty_geometry
from bezier_filters.files.fields import (
    CURVATURE_FIELDS,
    PREFIX,
    TORSION_FIELD,
    curvature_columns,
    normal_columns,
    torsion_columns,
)
from bezier_filters.scale.array_file import Values

QUANTITIES = {"curvature": curvature_columns, "normals": normal_columns, "torsion": torsion_columns}
"""What is estimated, and the columns that it is written to by default."""
QUALITIES = {name: field.mesh_attribute for name, field in CURVATURE_FIELDS.items()} | {
    TORSION_FIELD.name: TORSION_FIELD.mesh_attribute
}
"""What the quality may be, and the columns that it is a copy of."""
DEFAULT_QUALITIES = {"curvature": "mean", "normals": None, "torsion": TORSION_FIELD.name, "all": "mean"}
DISPLACEMENT, SHARPNESS = PREFIX + "displacement", PREFIX + "sharpness"
"""How far smoothing moved each vertex, and how sharp it kept edges."""
QUALITY = "quality"
CACHED = 1 << 11
"""Rows that fit into the cache."""


@cache
def names_of_columns() -> dict[str, list[str]]:
    """The columns of every quantity, and "all" of them."""
    found = {quantity: list(find(empty_geometry(0))) for quantity, find in QUANTITIES.items()}
    return found | {"all": list(dict.fromkeys(name for names in found.values() for name in names))}


def chosen_columns(quantity: str, quality: str | None, columns: Sequence[str] | None) -> tuple[str, list[str]]:
    """The column that becomes the quality, "" for none, and those that are written: any of those that there are.

    Raises
    ------
    InvalidParameterError
        If there is no such quantity, quality or column.
    """
    there = names_of_columns()
    if quantity not in there:
        raise InvalidParameterError(f"quantity: got {quantity!r}, expected one of {', '.join(there)}")
    wanted = there[quantity] if columns is None else [PREFIX + name.removeprefix(PREFIX) for name in columns]
    if not set(wanted) <= set(there["all"]) or len(set(wanted)) < len(wanted):
        raise InvalidParameterError(f"columns: got {wanted}, expected some of {there['all']}, each once")
    quality = quality or DEFAULT_QUALITIES[quantity]
    if quality is not None and quality not in QUALITIES:
        raise InvalidParameterError(f"quality: got {quality!r}, expected one of {', '.join(QUALITIES)}")
    return "" if quality is None else QUALITIES[quality], wanted


def columns_of(geometry: VertexGeometry, names: Sequence[str]) -> dict[str, FloatArray]:
    """Some of the columns that there are, and others of the same quantities."""
    for quantity, find in QUANTITIES.items():
        if set(names) <= set(names_of_columns()[quantity]):
            return find(geometry)
    return {name: values for find in QUANTITIES.values() for name, values in find(geometry).items()}


def table_of(
    vertices: FloatArray, columns: Mapping[str, FloatArray], quality: str, names: Sequence[str], coordinates: str
) -> Values:
    """Rows of a PLY file: coordinates of some type, one of the columns as quality, if any, and some columns."""
    fields = [(axis, coordinates) for axis in "xyz"]
    fields += [(QUALITY, "<f8")] * bool(quality) + [(name, "<f8") for name in names]
    rows = np.empty(len(vertices), dtype=fields)
    every = [(axis, vertices[:, k]) for k, axis in enumerate("xyz")]
    every += [(QUALITY, columns[quality])] if quality else []
    every += [(name, columns[name]) for name in names]
    for start in range(0, len(rows), CACHED):  # column after column, as long as the rows are at hand
        stop = start + CACHED
        for name, values in every:
            rows[name][start:stop] = values[start:stop]
    return rows
