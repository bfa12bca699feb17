"""napari: the filters as functions of a surface layer's data, from which napari makes its widgets."""

from collections.abc import Callable
from inspect import Parameter
from typing import Any, Literal

from bezier_filters_adapters.filters import LABELS, annotated, field_names, run

LayerData = tuple[tuple[Any, ...], dict[str, Any], str]


def _command(name: str) -> Callable[..., LayerData]:
    def command(surface: tuple[Any, ...], **given: object) -> LayerData:
        """Return a layer that shows one of the fields; all of them are in its metadata."""
        shown = given.pop("field", None) or next(iter(field_names(name)), None)
        result = run(name, surface[0], surface[1], given)
        values = () if shown is None else (result.fields[str(shown)],)
        label = LABELS[name] if shown is None else str(shown)
        metadata = result.fields | {"summary": result.summary}
        return (result.vertices, result.faces, *values), {"name": label, "metadata": metadata}, "surface"

    before = [Parameter("surface", Parameter.POSITIONAL_OR_KEYWORD, annotation="napari.types.SurfaceData")]
    if fields := tuple(field_names(name)):
        field = Parameter("field", Parameter.KEYWORD_ONLY, default=fields[0], annotation=Literal[fields])
        before.append(field)
    command.__annotations__["return"] = "napari.types.LayerDataTuple"
    return annotated(command, name, *before)


normals, curvature, torsion, smooth, fill_holes, creases = map(_command, LABELS)
