"""Filters that write what patches fitted to the vertices say."""

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray
from bezier_filters.estimation.estimate import estimate_vertex_geometry
from bezier_filters.estimation.fit_options import Automatic
from bezier_filters.estimation.vertex_geometry import VertexGeometry, empty_geometry
from bezier_filters.files.fields import PREFIX
from bezier_filters.meshlab.meshset import CurrentMesh, Length, MeshSet, absolute_length
from bezier_filters.meshlab.vertex_output import Columns, Computed, Output, run_filter
from bezier_filters.patches.smoothness import Smoothness
from bezier_filters.runtime.parallel import Progress
from bezier_filters.status import FitStatus


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


def run_vertex_filter(ms: MeshSet, vertex_filter: VertexFilter, fit: FitOptions, output: Output) -> dict[str, Any]:
    """Run a filter on the current mesh and return its report; see `run_filter`."""

    def work(mesh: CurrentMesh, mask: BoolArray) -> Computed:
        geometry = fitted(mesh, mask, fit)
        return Computed(
            vertex_filter.columns(geometry, mesh.vertex_normals),
            geometry.status <= vertex_filter.worst_status,
            {
                "status": geometry.status_counts(),
                "fit": asdict(geometry.fit) | {"parts": [asdict(part) for part in geometry.fit.parts]},
            },
            normals=_normal_expressions(vertex_filter) if vertex_filter.sets_normals else {},
        )

    return run_filter(ms, vertex_filter.column_names(), work, output)


def _normal_expressions(vertex_filter: VertexFilter) -> dict[str, str]:
    """The new normals where there is an estimate, the old ones elsewhere."""
    estimated = f"{PREFIX}fit_status <= {int(vertex_filter.worst_status)}"
    return {axis: f"({estimated}) ? {PREFIX}normal_{axis} : n{axis}" for axis in "xyz"}


def fitted(mesh: CurrentMesh, mask: BoolArray, fit: FitOptions) -> VertexGeometry:
    """Fit the patches of the vertices in a mask (n,)."""
    return estimate_vertex_geometry(
        mesh.vertices,
        mesh.faces,
        normals=None if len(mesh.faces) else _finite(mesh.vertex_normals),
        rings=fit.rings,
        radius=None if fit.radius is None else absolute_length(fit.radius, mesh.vertices, "radius"),
        alpha=fit.alpha,
        degree=fit.degree,
        smoothness=fit.smoothness,
        robust=fit.robust,
        selected=None if mask.all() else mask,
        threads=fit.threads,
        progress=fit.progress,
    )


def _finite(vectors: FloatArray) -> FloatArray:
    """Vectors with zeros for those that are not finite."""
    return np.where(np.isfinite(vectors).all(axis=1, keepdims=True), vectors, 0.0)
