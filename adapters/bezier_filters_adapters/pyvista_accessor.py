"""PyVista: where this module is imported, every `pyvista.PolyData` has the filters in its attribute `bezier`."""

from collections.abc import Callable
from inspect import Parameter
from typing import Any

import pyvista

import bezier_filters as bf
from bezier_filters.display import AUTO, matplotlib_colormap
from bezier_filters.fields import SMOOTH
from bezier_filters_adapters.field_colors import field_colors
from bezier_filters_adapters.filters import FILL_HOLES, LABELS, annotated, run
from bezier_filters_adapters.vtk_fields import choose_scalars, set_fields
from bezier_filters_adapters.vtk_fills import add_fill, triangles_of
from bezier_filters_adapters.vtk_normals import renew_normals


@pyvista.register_dataset_accessor("bezier", pyvista.PolyData)
class BezierAccessor:
    """The filters as methods, each of which returns a new mesh; fields are point data of it.

    >>> mesh = pyvista.Sphere().bezier.curvature()
    >>> "bz_mean_curvature" in mesh.point_data
    True
    """

    def __init__(self, mesh: pyvista.PolyData) -> None:
        self._mesh = mesh

    def plot(self, field: str | None = None, **given: Any) -> Any:
        """Draw the mesh as `pyvista.PolyData.plot` does, with the package's colour map and limits of a field.

        Parameters
        ----------
        field : str, optional
            Point data of numbers (n,), by default the active scalars.
        **given
            Other arguments of `pyvista.PolyData.plot`.

        Returns
        -------
        object
            What `pyvista.PolyData.plot` returns.
        """
        shown = field or self._mesh.point_data.active_scalars_name
        if shown is None:
            return self._mesh.plot(**given)
        colors = field_colors(shown, self._mesh.point_data[shown])
        own: dict[str, Any] = {
            "scalars": shown,
            "cmap": matplotlib_colormap(AUTO, signed=colors.signed),
            "clim": colors.limits,
        }
        return self._mesh.plot(**own | given)


def _method(name: str) -> Callable[..., pyvista.PolyData]:
    def method(self: BezierAccessor, **given: object) -> pyvista.PolyData:
        made = self._mesh.copy()
        if name == FILL_HOLES:
            faces, cells = triangles_of(made)
            result = run(name, made.points, faces, given)
            if result.fill is not None:
                add_fill(made, result.fill, cells)
        else:
            result = run(name, *bf.mesh_arrays(self._mesh), given)
            if name == SMOOTH:
                made.points = result.vertices
                renew_normals(made)
            set_fields(made.GetPointData(), result.fields)
        if (shown := choose_scalars(made.GetPointData(), name, result.fields)) is not None:
            made.set_active_scalars(shown)
        return made

    return annotated(method, name, Parameter("self", Parameter.POSITIONAL_OR_KEYWORD))


for _name in LABELS:
    setattr(BezierAccessor, _name.replace("-", "_"), _method(_name))
