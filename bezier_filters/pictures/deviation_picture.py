"""The panel of a mesh with its deviations from a reference, with a histogram on the colour bar."""

import numpy as np

from bezier_filters.arrays import Report
from bezier_filters.display import AUTO, TOLERANCE, TOLERANCES_SHOWN
from bezier_filters.fields import DEVIATION, fields_of
from bezier_filters.inspection.deviation_status import DeviationStatus
from bezier_filters.meshlab.mesh_attributes import read_columns
from bezier_filters.meshlab.meshset import MeshSet, read_current_mesh
from bezier_filters.pictures.page_deviation import NOT_COMPARED
from bezier_filters.pictures.scene import NAN_COLOR, Panel


def deviation_panel(ms: MeshSet, report: Report, title: str = "") -> Panel:
    """Panel of the current mesh after the filter; vertices that were not compared are grey.

    The report is that of the filter: with a tolerance, the colours are those of inspection.
    """
    mesh = read_current_mesh(ms)
    fields = fields_of(DEVIATION)
    columns = read_columns(ms, [field.column for field in fields])
    field = next(field for field in fields if field.quality == (report["quality"] or "deviation"))
    values = columns[field.column].copy()
    values[columns["bz_deviation_grade"] < DeviationStatus.ON_FACE.grade] = np.nan
    tolerance, limits = report["tolerance"], report.get("color_range")
    if limits is None and tolerance is not None and field.unit == "length":
        limits = -TOLERANCES_SHOWN * tolerance, TOLERANCES_SHOWN * tolerance
    is_compared = np.isfinite(values)
    in_band = tolerance is not None and field.unit == "length"
    return Panel(
        mesh.vertices,
        mesh.faces,
        values,
        title=title,
        label=field.label,
        unit=field.unit or "no unit",
        signed=field.signed,
        limits=None if limits is None else (float(limits[0]), float(limits[1])),
        colormap=TOLERANCE if in_band else AUTO,
        histogram=True,
        names=() if is_compared.all() else ((NOT_COMPARED, NAN_COLOR),),
    )
