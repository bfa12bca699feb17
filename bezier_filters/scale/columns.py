"""Columns of the files that are written: which there are, which are wanted, and tables of them."""

from collections.abc import Mapping, Sequence

import numpy as np

from bezier_filters.arrays import FloatArray
from bezier_filters.errors import InvalidParameterError
from bezier_filters.fields import CURVATURE, ESTIMATES, PREFIX, QUALITY, TORSION, Field, fields_of
from bezier_filters.scale.array_file import Values

ALL = "all"  # every estimate
QUALITIES = {CURVATURE: "mean", TORSION: "torsion", ALL: "mean"}  # what is the quality, if nothing is said
# how far smoothing moved each vertex, and how sharp it kept edges
DISPLACEMENT, SHARPNESS = PREFIX + "displacement", PREFIX + "sharpness"
CACHED = 1 << 11  # rows that fit into the cache


def estimated(quantity: str = ALL) -> dict[str, Field]:
    """Fields that are estimated, by their columns."""
    filters = ESTIMATES if quantity == ALL else (quantity,)
    return {field.column: field for field in fields_of(*filters) if field.attribute is not None}


def chosen_columns(quantity: str, quality: str | None, columns: Sequence[str] | None) -> tuple[str, list[str]]:
    """The column that becomes the quality, "" for none, and those that are written: any of those that there are."""
    every = estimated()
    if quantity not in (*ESTIMATES, ALL):
        raise InvalidParameterError(f"quantity: got {quantity!r}, expected one of {', '.join((*ESTIMATES, ALL))}")
    wanted = list(estimated(quantity)) if columns is None else [PREFIX + name.removeprefix(PREFIX) for name in columns]
    if not set(wanted) <= every.keys() or len(set(wanted)) < len(wanted):
        raise InvalidParameterError(f"columns: got {wanted}, expected some of {list(every)}, each once")
    qualities = {field.quality: column for column, field in every.items() if field.quality}
    quality = quality or QUALITIES.get(quantity)
    if quality is not None and quality not in qualities:
        raise InvalidParameterError(f"quality: got {quality!r}, expected one of {', '.join(qualities)}")
    return "" if quality is None else qualities[quality], wanted


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
