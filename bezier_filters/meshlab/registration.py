"""The filters as methods of `pymeshlab.MeshSet`, for those who ask for it."""

from collections.abc import Callable

from bezier_filters.arrays import Report
from bezier_filters.meshlab.crease_filter import compute_selection_by_bezier_crease_per_edge
from bezier_filters.meshlab.hole_filter import meshing_close_holes_by_bezier_patch
from bezier_filters.meshlab.meshset import BezierFilterError, MeshSet
from bezier_filters.meshlab.smoothing_filter import apply_coord_bezier_patch_smoothing
from bezier_filters.meshlab.vertex_filters import (
    compute_curvature_by_bezier_patch_per_vertex,
    compute_normal_by_bezier_patch_per_vertex,
    compute_torsion_by_bezier_patch_per_vertex,
)

FILTERS: tuple[Callable[..., Report], ...] = (
    apply_coord_bezier_patch_smoothing,
    meshing_close_holes_by_bezier_patch,
    compute_normal_by_bezier_patch_per_vertex,
    compute_curvature_by_bezier_patch_per_vertex,
    compute_torsion_by_bezier_patch_per_vertex,
    compute_selection_by_bezier_crease_per_edge,
)


def register() -> None:
    """Add the filters to `pymeshlab.MeshSet` as methods, with their signatures and docstrings.

    Calling it again changes nothing. pymeshlab's ``filter_list``, ``apply_filter`` and filter scripts do
    not know these methods.

    Raises
    ------
    BezierFilterError
        If `pymeshlab.MeshSet` has something else of such a name; then nothing is added.

    Examples
    --------
    >>> from pymeshlab import MeshSet
    >>> register()
    >>> ms = MeshSet()
    >>> ms.create_sphere(subdiv=3)
    >>> ms.compute_curvature_by_bezier_patch_per_vertex(quality="mean")["status"]
    {'OK': 642}
    """
    for function in FILTERS:
        existing = getattr(MeshSet, function.__name__, function)
        if existing is not function:
            raise BezierFilterError(
                f"pymeshlab.MeshSet has another attribute {function.__name__!r}; call the function of bezier_filters"
            )
    for function in FILTERS:
        setattr(MeshSet, function.__name__, function)  # a function in a class is a method, signature and all
