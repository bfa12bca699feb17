"""Fields of a page: in groups, each with what it is for, its values, colours and limits."""

from base64 import b64encode

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray, Report
from bezier_filters.display import PALETTES, TOLERANCE, color_range, palette_places, round_limits
from bezier_filters.fields import FIELDS, GRADE, SMOOTH, Field
from bezier_filters.pictures.page_deviation import NOT_COMPARED, DeviationFields
from bezier_filters.status import FitStatus

# names of fields with what each is for, by groups, in the order in which they can be chosen
GROUPS = {
    "Shape": {
        "mean_curvature": "Shows bulges, dents and noise: positive where the surface bulges outwards.",
        "gaussian_curvature": "Tells caps and cups, positive, from saddles, negative; 0 where it unrolls flat.",
        "k_min": "Finds valleys and grooves: negative where the surface is concave in some direction.",
        "k_max": "Finds ridges and edges: positive where the surface is convex in some direction.",
        "curvedness": "Shows how strongly the surface bends in any way: 0 on planes.",
        "shape_index": "Tells the kind of shape whatever its size: -1 cup, 0 saddle, 1 cap.",
        "geodesic_torsion": "Shows how fast the surface twists between its principal directions.",
    },
    "Deviation": {
        "deviation": "Shows how far the surface is from the reference: positive where there is too much.",
        "regional_deviation": "Finds shallow defects: means over a region around each vertex.",
        "deviation_z": "Tells deviations from noise: those beyond three are not noise.",
    },
    "Noise and smoothing": {
        "noise": "Shows what smoothing removes, outwards: it should look random; a pattern would be shape.",
        "displacement": "Shows how far smoothing moves each vertex.",
    },
    "Certainty": {
        "mean_curvature_std": "Tells which mean curvatures differ: those farther apart than about three of these.",
        "gaussian_curvature_std": "Tells which Gaussian curvatures differ.",
        "normal_std": "Shows how far the normal may be tilted.",
        "residual": "Shows the distance of points from their patch: noise, or detail that the patch misses.",
        "fit_grade": "Shows where the fit fell back to something simpler, as at borders and folds, and to what.",
    },
}
NOISE = Field("noise", "noise, outwards, as smoothing finds it", "length", (SMOOTH,), signed=True)
PRINTED = ("mean_curvature", "mean_curvature_std", "noise", "fit_grade")  # fields with pictures on paper
_ORDER = [name for group in GROUPS.values() for name in group]
_PURPOSES = {name: purpose for group in GROUPS.values() for name, purpose in group.items()}
_CHOSEN = [field for field in (*FIELDS, NOISE) if field.name in _ORDER]
PAGE_FIELDS = sorted(_CHOSEN, key=lambda field: _ORDER.index(field.name))
_PALETTE_COLORS = 256  # as many as the texture of the page has
_SMOOTHED = "Colours are means over some 5 edges: single vertices differ by their rings. The pointer reads values."


def encode_array(array: FloatArray | IntArray, kind: str) -> str:
    """Bytes of an array as text."""
    return b64encode(np.ascontiguousarray(array, dtype=kind).tobytes()).decode("ascii")


def field_record(
    field: Field,
    columns: dict[str, FloatArray],
    rows: IntArray,
    known: BoolArray,
    shades: FloatArray | None,
    deviation: DeviationFields | None = None,
) -> Report:
    """A field for the page; codes have names, other fields colour limits and, if available, standard errors.

    Values (n,) of the vertices are shown at `rows`; limits are those of known ones. Shades (n,) are coloured instead. A
    field of a deviation is grey where nothing is compared.
    """
    values, errors = columns[field.column], columns.get(f"{field.column}_std")
    record = {
        "name": field.name,
        "label": field.label,
        "unit": field.unit,
        "purpose": _PURPOSES[field.name],
        "printed": field.name in PRINTED,
        "signed": field.signed,
        "remark": "" if shades is None else _SMOOTHED,
        "values": encode_array(values[rows], "<f4"),
    }
    if field.column == GRADE:
        return record | {
            "names": {s.grade: {"text": s.words, "count": int((values == s.grade).sum())} for s in FitStatus}
        }
    inside = values[known] if known.any() else values
    low, high = color_range(inside, signed=field.signed)
    if shades is not None:
        low = 0.0
    if deviation is not None:
        record |= _deviation_record(field, values[rows], deviation, deviation.compared[rows])
        if "colors" in record:
            low, high = deviation.limits or (low, high)
    return record | {
        "errors": None if errors is None else encode_array(errors[rows], "<f4"),
        "shades": None if shades is None else encode_array(shades[rows], "<f4"),
        "limits": round_limits(low, high) if high > low and "colors" not in record else (low, high),
        "range": round_limits(*color_range(inside, signed=field.signed, percentile=0.0)),
        "median": float(np.median(np.abs(inside))),
    }


def _deviation_record(field: Field, values: FloatArray, deviation: DeviationFields, compared: BoolArray) -> Report:
    """What the record of a deviation has besides: no values where nothing is compared, and colours of inspection."""
    record: Report = {"values": encode_array(np.where(compared, values, np.nan), "<f4")}
    if not compared.all():
        record["unknown"] = f"{NOT_COMPARED}: {np.count_nonzero(~compared):,}"
    if deviation.limits is not None and field.unit == "length":
        places, colors = palette_places(TOLERANCE), np.array(PALETTES[TOLERANCE])
        shares = np.linspace(0.0, 1.0, _PALETTE_COLORS)
        channels = [np.interp(shares, places, channel) for channel in colors.T]
        record["colors"] = np.rint(255.0 * np.column_stack(channels)).astype(int).tolist()
    return record


def group_members(fields: list[Field]) -> list[tuple[str, list[int]]]:
    """Groups with the places of their fields in a list; groups without any are left out."""
    names = [field.name for field in fields]
    groups = [(title, [names.index(name) for name in group if name in names]) for title, group in GROUPS.items()]
    return [(title, members) for title, members in groups if members]


def field_table(fields: list[Field], columns: dict[str, FloatArray], known: BoolArray) -> Report:
    """Table of the smallest, median and largest value of each field that has no codes."""
    rows = []
    for field in fields:
        values = columns[field.column][known] if known.any() else columns[field.column]
        if field.column != GRADE:
            low, middle, high = (float(value) for value in np.percentile(values, [0.0, 50.0, 100.0]))
            rows.append([field.label, field.unit, low, middle, high])
    return {"title": "Fields", "header": ["field", "unit", "smallest", "median", "largest"], "rows": rows}
