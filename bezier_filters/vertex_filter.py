"""What the filters on a MeshSet have in common: read, fit, write, colour, report.

Everything that can be refused is refused before the first write.
"""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray
from bezier_filters.color_range import color_range
from bezier_filters.errors import InvalidMeshError, InvalidParameterError
from bezier_filters.estimation import Automatic, estimate_vertex_geometry
from bezier_filters.fields import PREFIX, ScalarField
from bezier_filters.mesh_attributes import (
    check_finite,
    check_writable,
    read_columns,
    restored_on_failure,
    write_columns,
)
from bezier_filters.mesh_colors import check_limits, color_by_quality, find_color_map
from bezier_filters.meshset import (
    BezierFilterError,
    CurrentMesh,
    Length,
    MeshSet,
    absolute_length,
    current_mesh,
    preserved_filter_script,
    read_current_mesh,
)
from bezier_filters.parallel import Progress
from bezier_filters.smoothness import Smoothness
from bezier_filters.status import FitStatus
from bezier_filters.vertex_geometry import VertexGeometry, empty_geometry

Columns = dict[str, FloatArray]


@dataclass(frozen=True)
class VertexFilter:
    """What sets one filter apart.

    Attributes
    ----------
    columns : callable
        ``columns(geometry, previous_normals)`` gives the columns by name, each of shape (n,).
    worst_status : FitStatus
        Vertices up to this status have an estimate.
    sets_normals : bool
        Whether the vertex normals become those of the columns ``bz_normal_*``.
    """

    columns: Callable[[VertexGeometry, FloatArray], Columns]
    worst_status: FitStatus
    sets_normals: bool = False

    def column_names(self) -> list[str]:
        """Names of the columns."""
        return list(self.columns(empty_geometry(0), np.empty((0, 3))))


@dataclass(frozen=True)
class FitOptions:
    """Arguments for `estimate_vertex_geometry`."""

    rings: int | Automatic
    radius: Length | None
    alpha: float | Automatic
    degree: int | Automatic
    smoothness: Smoothness
    robust: bool
    threads: int | None
    progress: Progress | None


@dataclass(frozen=True)
class Output:
    """Where results go: the field for the quality, if any, and the colours."""

    quality: ScalarField | None
    onselected: bool
    color: bool
    colormap: str
    percentile: float


@dataclass
class _Stopwatch:
    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def timing(self, name: str) -> Iterator[None]:
        start = time.perf_counter()
        yield
        self.seconds[name] = time.perf_counter() - start


def choose_field(name: str | None, fields: dict[str, ScalarField]) -> ScalarField | None:
    """Field of a name that a user gave as `quality`; None stands for no field.

    Raises
    ------
    BezierFilterError
        If there is no such field; the message lists them.
    """
    if name is None:
        return None
    if not isinstance(name, str) or name not in fields:
        raise BezierFilterError(f"quality: got {name!r}, expected {', '.join(map(repr, fields))} or None")
    return fields[name]


def run_filter(ms: MeshSet, vertex_filter: VertexFilter, fit: FitOptions, output: Output) -> dict[str, Any]:
    """Run a filter on the current mesh and return its report.

    Raises
    ------
    BezierFilterError
        If the mesh or a parameter is refused; the MeshSet is as it was.
    CancelledError
        If the progress callback returned False; the MeshSet is as it was.
    """
    _check_coloring(output)
    watch = _Stopwatch()
    with watch.timing("read"):
        mesh = read_current_mesh(ms)
        mask = mesh.selected_vertices() if output.onselected else np.ones(len(mesh.vertices), dtype=np.bool_)
    with preserved_filter_script(ms):
        check_writable(ms, vertex_filter.column_names())
        with watch.timing("fit"):
            geometry = _estimate(mesh, mask, fit)
        _check_unchanged(ms, mesh)
        new_columns = vertex_filter.columns(geometry, mesh.vertex_normals)
        estimated = geometry.status <= vertex_filter.worst_status
        quality = None if output.quality is None else new_columns[output.quality.mesh_attribute]
        limits = None
        if output.color and output.quality is not None and quality is not None:
            limits = color_range(quality, signed=output.quality.signed, percentile=output.percentile, mask=estimated)
            check_limits(*limits)
        columns = _merge(new_columns, read_columns(ms, new_columns), mask)
        check_finite(columns)
        with restored_on_failure(ms, columns):
            with watch.timing("write"):
                write_columns(ms, columns)
                with _vertices_selected(ms, mesh) if output.onselected else nullcontext():
                    _write_quality_and_normals(ms, vertex_filter, output)
            if limits is not None:
                with watch.timing("color"):
                    color_by_quality(ms, *limits, output.colormap)
    report: dict[str, Any] = {
        "status": geometry.status_counts(),
        "fit": asdict(geometry.fit) | {"parts": [asdict(part) for part in geometry.fit.parts]},
        "attributes": list(columns),
        "quality": None if output.quality is None else output.quality.name,
        "unit": None if output.quality is None else output.quality.unit,
        "statistics": None if quality is None else _statistics(quality[estimated]),
        "seconds": watch.seconds,
    }
    if limits is not None:
        report |= {"color_range": list(limits), "colormap": find_color_map(output.colormap).name}
    return report


def _check_coloring(output: Output) -> None:
    if not output.color:
        return
    find_color_map(output.colormap)
    if output.quality is None:
        raise BezierFilterError("color: got True with quality=None, expected a quality to colour by")
    try:
        color_range(np.empty(0), signed=False, percentile=output.percentile)
    except InvalidParameterError as error:
        raise BezierFilterError(str(error)) from error


def _estimate(mesh: CurrentMesh, mask: BoolArray, fit: FitOptions) -> VertexGeometry:
    try:
        return estimate_vertex_geometry(
            mesh.vertices,
            mesh.faces,
            normals=None if len(mesh.faces) else _finite(mesh.vertex_normals),
            rings=fit.rings,
            radius=None if fit.radius is None else absolute_length(fit.radius, mesh.vertices),
            alpha=fit.alpha,
            degree=fit.degree,
            smoothness=fit.smoothness,
            robust=fit.robust,
            selected=None if mask.all() else mask,
            threads=fit.threads,
            progress=fit.progress,
        )
    except (InvalidMeshError, InvalidParameterError) as error:
        raise BezierFilterError(str(error)) from error


def _finite(vectors: FloatArray) -> FloatArray:
    """Vectors with zeros for those that are not finite."""
    return np.where(np.isfinite(vectors).all(axis=1, keepdims=True), vectors, 0.0)


def _check_unchanged(ms: MeshSet, mesh: CurrentMesh) -> None:
    """Refuse to write to another mesh than the one that was read: callbacks and threads can change it."""
    now = current_mesh(ms)
    if now.id() != mesh.id or now.vertex_number() != len(mesh.vertices):
        raise BezierFilterError("the current mesh was changed while the filter ran; nothing was written")


def _merge(new: Columns, old: Columns, mask: BoolArray) -> Columns:
    """New values where `mask` says so, else old ones.

    Rows that another filter added meanwhile hold whatever was in memory: what is not finite there
    is replaced by the new column's fill value.
    """
    return {
        name: np.where(mask | ~np.isfinite(old[name]), values, old[name]) if name in old else values
        for name, values in new.items()
    }


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


def _write_quality_and_normals(ms: MeshSet, vertex_filter: VertexFilter, output: Output) -> None:
    if output.quality is not None:
        ms.compute_scalar_by_function_per_vertex(
            q=output.quality.mesh_attribute, normalize=False, map=False, onselected=output.onselected
        )
    if vertex_filter.sets_normals:
        estimated = f"{PREFIX}fit_status <= {int(vertex_filter.worst_status)}"
        expressions = {axis: f"({estimated}) ? {PREFIX}normal_{axis} : n{axis}" for axis in "xyz"}
        ms.compute_normal_by_function_per_vertex(**expressions, onselected=output.onselected)


def _statistics(values: FloatArray) -> dict[str, float] | None:
    if not len(values):
        return None
    return {
        "min": float(values.min()),
        "median": float(np.median(values)),
        "max": float(values.max()),
        "mean": float(values.mean()),
    }
