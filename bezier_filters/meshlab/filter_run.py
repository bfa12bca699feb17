"""The common frame of filters on a MeshSet: read, compute, write, colour, report.

All checks precede the first write.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, Report
from bezier_filters.display import AUTO, color_range
from bezier_filters.errors import InvalidMeshError, InvalidParameterError
from bezier_filters.fields import GRADE, Field, column_names, qualities
from bezier_filters.files.stored_grades import are_grades
from bezier_filters.meshlab import mesh_attributes
from bezier_filters.meshlab.mesh_colors import check_limits, color_by_quality, find_color_map
from bezier_filters.meshlab.meshset import (
    BezierFilterError,
    CurrentMesh,
    MeshSet,
    check_unchanged,
    preserve_filter_script,
    read_current_mesh,
)
from bezier_filters.meshlab.topology import repair, repair_copy, topology_of
from bezier_filters.meshlab.verdicts import orientation_remarks
from bezier_filters.runtime.compile_time import clock_without_compilation

STATISTICS = ("min", "median", "max", "mean")  # of the quality, functions of NumPy

Columns = dict[str, FloatArray]


@dataclass(frozen=True)
class Output:
    """Output options: the field for the quality, by the word that users type, the colours and their range."""

    quality: str | None = None
    onselected: bool = False
    color: bool = False
    colormap: str = AUTO
    percentile: float = 2.0
    color_range: tuple[float, float] | None = None
    repair: bool = False  # whether the mesh is repaired first


@dataclass(frozen=True)
class Computed:
    """Results of a filter to be written."""

    columns: Columns  # each (n,), by name
    known: BoolArray  # (n,): vertices whose values count for colours and statistics
    report: Report  # specific to the filter
    # writes other results after the columns, without interrupts in between
    write_more: Callable[[], None] = lambda: None


Work = Callable[[CurrentMesh, BoolArray], Computed]  # ``work(mesh, mask)`` does it for the vertices of a mask (n,)


@contextmanager
def _time_stage(seconds: dict[str, float], name: str) -> Iterator[None]:
    start = clock_without_compilation()
    yield
    seconds[name] = clock_without_compilation() - start


def run_filter(ms: MeshSet, name: str, work: Work, output: Output) -> Report:
    """Run a filter, given the name of its command; it writes its columns on the current mesh. Returns the report.

    After an error or a cancellation the MeshSet is unchanged; so it is after Ctrl-C, unless that comes during the
    writing, which is then completed.
    """
    field, colormap = _quality_and_colormap(output, qualities(name))
    seconds: dict[str, float] = {}
    with _time_stage(seconds, "read"):
        given = mesh = read_current_mesh(ms)
        repaired: Report | None = None
        if output.repair:
            mesh, repaired = repair_copy(ms)
        mask = mesh.selection_mask() if output.onselected else np.ones(len(mesh.vertices), dtype=np.bool_)
    with preserve_filter_script(ms):
        mesh_attributes.check_writable(ms, column_names(name))
    with _time_stage(seconds, "fit"):  # interruptible, as it does not change the MeshSet
        try:
            computed = work(mesh, mask)
        except (InvalidMeshError, InvalidParameterError) as error:
            raise BezierFilterError(str(error)) from error
    with _time_stage(seconds, "topology"):
        topology = topology_of(mesh.vertices, mesh.faces) if len(mesh.faces) else None
        remarks = [] if topology is None else topology.remarks + orientation_remarks(mesh, topology)
        # the explanation of a failure contains the same findings
        reported = " ".join([*computed.report["warnings"], *computed.report["remarks"]])
        new_remarks = [remark for remark in remarks if remark.partition(";")[0] not in reported]
    check_unchanged(ms, given)
    quality = np.empty(0) if field is None else computed.columns[field.column][computed.known]
    limits = output.color_range if output.color else None  # values of the first and the last colour
    if output.color and limits is None:
        signed = field is not None and field.signed
        limits = color_range(quality, signed=signed, percentile=output.percentile)
        check_limits(*limits)
    with preserve_filter_script(ms):
        if output.repair:
            repair(ms)
        columns = _merge(computed.columns, mesh_attributes.read_columns(ms, computed.columns), mask)
        mesh_attributes.check_finite(columns)
        with mesh_attributes.restore_on_failure(ms, columns):
            with _time_stage(seconds, "write"):
                mesh_attributes.write_columns(ms, columns)
                with _vertices_selected(ms, mesh) if output.onselected else nullcontext():
                    if field is not None:
                        ms.compute_scalar_by_function_per_vertex(q=field.column, onselected=output.onselected)
                    computed.write_more()
            if limits is not None:
                with _time_stage(seconds, "color"):
                    color_by_quality(ms, *limits, colormap)
    report: Report = computed.report | {
        "attributes": list(columns),
        "quality": output.quality,
        "unit": None if field is None else field.unit,
        "repaired": repaired,
        "topology": None if topology is None else dict(topology.counts),
        "remarks": computed.report["remarks"] + new_remarks,
        "statistics": {name: float(getattr(np, name)(quality)) for name in STATISTICS} if len(quality) else None,
        "seconds": seconds,
    }
    return report if limits is None else report | {"color_range": list(limits), "colormap": colormap}


def _quality_and_colormap(output: Output, fields: dict[str, Field]) -> tuple[Field | None, str]:
    """Check the options of quality and colours; returns the field for the quality, if any, and the colour map."""
    field, name = None, output.quality
    if name is not None:
        if not isinstance(name, str) or name not in fields:
            raise BezierFilterError(f"quality: got {name!r}, expected {', '.join(map(repr, fields))} or None")
        field = fields[name]
    if not output.color:
        return field, output.colormap
    colormap = find_color_map(output.colormap, signed=field is not None and field.signed)
    if field is None:
        raise BezierFilterError("color: there is no quality to colour by; choose one")
    if output.color_range is not None:
        check_limits(*output.color_range)
    try:
        color_range(np.empty(0), signed=False, percentile=output.percentile)
    except InvalidParameterError as error:
        raise BezierFilterError(str(error)) from error
    return field, colormap


def _merge(new: Columns, old: Columns, mask: BoolArray) -> Columns:
    """New values where `mask` is true, else old ones.

    Rows that another filter has added hold uninitialised memory: values that are not finite, or not grades, are
    replaced by the fill value of the new column.
    """
    return {
        name: np.where(mask | ~_is_legal(name, old[name]), values, old[name]) if name in old else values
        for name, values in new.items()
    }


def _is_legal(name: str, values: FloatArray) -> BoolArray:
    return are_grades(values) if name == GRADE else np.isfinite(values)


@contextmanager
def _vertices_selected(ms: MeshSet, mesh: CurrentMesh) -> Iterator[None]:
    """If only faces are selected, select their vertices inside the block."""
    if mesh.vertex_selection.any():
        yield
        return
    ms.compute_selection_transfer_face_to_vertex(inclusive=False)
    try:
        yield
    finally:
        ms.set_selection_none(allfaces=False, allverts=True)
