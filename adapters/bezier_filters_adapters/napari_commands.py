"""napari: the filters as functions of a surface layer, from which napari makes its widgets.

They compute in the coordinates of the world, where lengths are what the scale of the layer says.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from inspect import Parameter
from typing import Any, Literal

import numpy as np

from bezier_filters.arrays import FloatArray
from bezier_filters.field_arrays import split_vectors
from bezier_filters.meshes.mesh import triangle_mesh
from bezier_filters.meshes.mesh_objects import Placement, placement_of_layer
from bezier_filters_adapters.field_colors import field_colors
from bezier_filters_adapters.filled_fields import Fill, Values
from bezier_filters_adapters.filters import LABELS, annotated, column_names, run

LayerData = tuple[tuple[Any, ...], dict[str, Any], str]
# what says where a layer is shown, and in which units
_HANDED_ON = ("scale", "translate", "rotate", "shear", "affine", "units", "axis_labels")
_COLORS = ("colormap", "contrast_limits", "gamma")  # what says how its values are shown


def _command(name: str) -> Callable[..., LayerData]:
    def command(surface: Any, **given: object) -> LayerData:
        """Return a layer in the place of the surface that shows one of the fields; all of them are in its metadata.

        The surface is a layer of napari, or its data: vertices, faces, and perhaps values.
        """
        shown = str(given.pop("field", None) or column_names(name)[0])
        is_layer = hasattr(surface, "data_to_world")
        data = surface.data if is_layer else surface
        mesh = triangle_mesh(data[0], data[1])
        placement = placement_of_layer(surface) if is_layer else Placement(np.eye(3), np.zeros(3))
        world = placement.world_coordinates(mesh.vertices)
        with _progress_bar(LABELS[name], is_shown=is_layer) as show_share:
            result = run(name, world, placement.orient(mesh.faces), given, show_share)
        vertices = _in_data(placement, mesh.vertices, world, result.vertices)
        handed_on = surface.as_layer_data_tuple()[1] if is_layer else {}
        fields, values = result.fields, split_vectors(result.fields)[shown].astype(np.float64)
        colors: dict[str, Any] = {}
        if result.fill is not None:
            fields = _grown_metadata(result.fill, handed_on.get("metadata", {})) | fields
            if len(data) > len(("vertices", "faces")) and np.ptp(data[2]):  # else they say nothing
                values, shown = _grown(result.fill, data[2]), LABELS[name]
                colors = {key: handed_on[key] for key in _COLORS if key in handed_on}
        state = {key: handed_on[key] for key in _HANDED_ON if key in handed_on} | (colors or _colors(shown, values))
        state |= {"name": shown, "metadata": fields | {"summary": result.summary}, "shading": "smooth"}
        return (vertices, placement.orient(result.faces), values), state, "surface"

    before = [Parameter("surface", Parameter.POSITIONAL_OR_KEYWORD, annotation="napari.layers.Surface")]
    if len(fields := tuple(column_names(name))) > 1:
        field = Parameter("field", Parameter.KEYWORD_ONLY, default=fields[0], annotation=Literal[fields])
        before.append(field)
    command.__annotations__["return"] = "napari.types.LayerDataTuple"
    return annotated(command, name, *before)


def _colors(column: str, values: Values) -> dict[str, Any]:
    """The colours of new values as a layer takes them; Viridis is one of napari's own colour maps."""
    colors = field_colors(column, values)
    colormap = {"name": colors.name, "colors": colors.palette} if colors.signed else "viridis"
    return {"colormap": colormap, "contrast_limits": colors.limits}


@contextmanager
def _progress_bar(label: str, *, is_shown: bool) -> Iterator[Callable[[float], object] | None]:
    """A bar in the window of napari, as a function that takes the share that is done."""
    if not is_shown:
        yield None
        return
    from napari.utils import progress

    with progress(total=100, desc=f"Bezier filters: {label.lower()}") as bar:
        yield lambda share: bar.update(round(100 * share) - bar.n)


def _grown_metadata(fill: Fill, metadata: dict[str, Any]) -> dict[str, Values]:
    """Fields of the vertices among the metadata of a layer, with rows for new vertices."""
    fields = {key: values for key, values in metadata.items() if isinstance(values, np.ndarray) and values.ndim}
    return {
        key: np.concatenate([values, fill.new_vertex_rows(key, values)])
        for key, values in fields.items()
        if len(values) == fill.old_vertices
    }


def _grown(fill: Fill, values: Values) -> Values:
    """Values of a surface (..., n), with those of new vertices."""
    columns = np.moveaxis(np.asarray(values), -1, 0)
    return np.moveaxis(np.concatenate([columns, fill.new_vertex_rows("", columns)]), 0, -1)


def _in_data(placement: Placement, before: FloatArray, world: FloatArray, result: FloatArray) -> FloatArray:
    """Vertices of a result in the coordinates of the layer; where they did not move, the very ones from before."""
    vertices = placement.layer_coordinates(result)
    stay = np.flatnonzero((result[: len(world)] == world).all(axis=1))
    vertices[stay] = before[stay]
    return vertices


normals, curvature, torsion, smooth, fill_holes, creases = map(_command, LABELS)
