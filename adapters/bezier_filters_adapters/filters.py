"""What all adapters share: the filters on arrays, with the parameters of the one table of the package.

Only functions of arrays are called. They do not load pymeshlab, whose Qt does not go with that of other programs.
"""

import ast
import inspect
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

import bezier_filters as bf
from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.errors import InvalidParameterError
from bezier_filters.feature_lines.crease_lines import crease_columns
from bezier_filters.field_arrays import join_vectors, result_arrays
from bezier_filters.fields import CREASES, CURVATURE, ESTIMATES, NORMALS, SMOOTH, TORSION, Field, fields_of
from bezier_filters.parameters import LENGTH_TYPE, PARAMETERS, RUN, Parameter
from bezier_filters.runtime.parallel import Progress
from bezier_filters_adapters.filled_fields import NEW, Fill, Values

FILL_HOLES = "fill-holes"
TRIM = "trim"  # would remove rows, whose fields adapters keep
LABELS = {
    NORMALS: "Normals",
    CURVATURE: "Curvature",
    TORSION: "Torsion",
    SMOOTH: "Smooth",
    FILL_HOLES: "Fill holes",
    CREASES: "Creases",
}
HELP = {
    NORMALS: "Normals of the Bezier patch at every vertex.",
    CURVATURE: "Mean, Gaussian and principal curvatures and directions at every vertex.",
    TORSION: "Principal geodesic torsion and its directions at every vertex.",
    SMOOTH: "Remove the noise of a mesh and keep its shape, its volume and its edges.",
    FILL_HOLES: "Fill the holes of a mesh: smooth where the surface is smooth, sharp where it is sharp.",
    CREASES: "Sharp edges, ridges and ravines, as a code and a strength at every vertex.",
}
ERRORS = (bf.InvalidMeshError, InvalidParameterError)  # whose message is for the user
_FUNCTIONS: dict[str, tuple[Callable[..., Any], ...]] = {
    **dict.fromkeys(ESTIMATES, (bf.estimate_vertex_geometry,)),
    SMOOTH: (bf.smooth,),
    FILL_HOLES: (bf.fill_holes,),
    CREASES: (bf.estimate_vertex_geometry, bf.find_creases),
}
DEFAULT = "default"  # the word of those that are left out and take no other text
_RENAMED = {"maxholesize": "max_edges"}  # parameters that functions of arrays call otherwise


@dataclass(frozen=True)
class Result:
    """What a filter made: the mesh, the fields of its vertices, numbers (n,) or vectors (n, 3), and a line to show.

    Of filled holes also where new rows begin, with which programs continue the fields that they have.
    """

    vertices: FloatArray
    faces: IntArray
    fields: dict[str, Values]
    summary: str
    fill: Fill | None = None


def run(
    name: str,
    vertices: ArrayLike,
    faces: ArrayLike,
    given: Mapping[str, object],
    show_share: Callable[[float], object] | None = None,
) -> Result:
    """Run the filter of a command's name; texts are read, and what is None, empty or "default" is left out.

    `show_share` is called with the share that is done, from 0 to 1, now and then from this thread.
    """
    progress = None if show_share is None else _progress(show_share)
    vertices, faces = np.array(vertices, np.float64), np.array(faces, np.int32).reshape(-1, 3)
    known = {parameter.name: parameter for parameter in parameters_of(name)}
    for key in given:
        if key not in known:
            raise InvalidParameterError(f"got the parameter {key!r}, expected one of {', '.join(known)}")
    left_out = (None, "", DEFAULT)
    values = {key: _value(known[key], value, vertices) for key, value in given.items() if value not in left_out}
    if name == SMOOTH:
        smoothed = bf.smooth(vertices, faces, progress=progress, **_arguments(bf.smooth, values))
        return Result(smoothed.vertices, faces, result_arrays(smoothed, SMOOTH), repr(smoothed))
    if name == FILL_HOLES:
        filled = bf.fill_holes(vertices, faces, progress=progress, **_arguments(bf.fill_holes, values))
        fill = Fill(filled.vertices, filled.faces, len(vertices), len(faces))
        return Result(filled.vertices, filled.faces, fill.marks(), repr(filled), fill)
    options = _arguments(bf.estimate_vertex_geometry, values)
    geometry = bf.estimate_vertex_geometry(vertices, faces, progress=progress, **options)
    if name == CREASES:
        creases = bf.find_creases(vertices, faces, geometry, **_arguments(bf.find_creases, values))
        return Result(vertices, faces, join_vectors(crease_columns(creases)), repr(creases))
    return Result(vertices, faces, result_arrays(geometry, name), str(geometry.status_counts()))


def _progress(show_share: Callable[[float], object]) -> Progress:
    """A callback of the functions, which never cancels; shares do not fall where a second pass begins."""
    shown = 0.0

    def progress(done: int, total: int) -> None:
        nonlocal shown
        shown = max(shown, min(done / max(total, 1), 1.0))
        show_share(shown)

    return progress


def parameters_of(name: str) -> list[Parameter]:
    """Parameters of a filter that functions of arrays have, but for threads and progress."""
    known = {key for function in _FUNCTIONS[name] for key in _names(function)}
    known.discard(TRIM)
    return [parameter for parameter in PARAMETERS[name] if parameter.name in known and parameter not in RUN]


def field_names(name: str) -> list[str]:
    """Arrays that `run` gives."""
    return [NEW] if name == FILL_HOLES else list(dict.fromkeys(field.array for field in _fields(name)))


def column_names(name: str) -> list[str]:
    """The same where vectors are split into three columns."""
    return [NEW] if name == FILL_HOLES else [field.column for field in _fields(name)]


def _fields(name: str) -> list[Field]:
    return [field for field in fields_of(name) if field.attribute is not None or name == CREASES]


def kind_of(parameter: Parameter) -> type | tuple[str, ...]:
    """How a user gives a parameter: bool, int, float, one of some words, or text, which is empty if it is left out.

    >>> kinds = {parameter.name: kind_of(parameter) for parameter in parameters_of("smooth")}
    >>> kinds["iterations"], kinds["borders"], kinds["keepvolume"], kinds["noise"]
    (<class 'int'>, ('curve', 'fixed'), ('default', 'True', 'False'), <class 'str'>)
    """
    if parameter.kind.startswith("{"):
        return tuple(re.findall(r'"(\w+)"', parameter.kind))
    if parameter.default is None:
        return (DEFAULT, "True", "False") if parameter.kind == "bool" else str
    return {"bool": bool, "int": int, "float": float}.get(parameter.kind, str)


def default_of(parameter: Parameter) -> Any:
    """Its default value as a user gives it."""
    if parameter.default is None:
        return DEFAULT if isinstance(kind_of(parameter), tuple) else ""
    return parameter.default


def annotated(function: Callable[..., Any], name: str, *before: inspect.Parameter) -> Callable[..., Any]:
    """A function of keywords with the filter's name, help, and parameters, after some others, for menus and editors."""
    own = [
        inspect.Parameter(
            parameter.name, inspect.Parameter.KEYWORD_ONLY, default=default_of(parameter), annotation=_hint(parameter)
        )
        for parameter in parameters_of(name)
    ]
    lines = [f"{parameter.name} : {parameter.kind}\n    {parameter.help}" for parameter in parameters_of(name)]
    function.__name__ = function.__qualname__ = name.replace("-", "_")
    function.__doc__ = "\n".join([HELP[name], "", "Parameters", "----------", *lines])
    taken = [*before, *own]
    returned = function.__annotations__.get("return")
    function.__annotations__ = {item.name: item.annotation for item in taken} | {"return": returned}
    function.__signature__ = inspect.Signature(taken, return_annotation=returned)  # type: ignore[attr-defined]
    return function


def _hint(parameter: Parameter) -> Any:
    kind = kind_of(parameter)
    return Literal[kind] if isinstance(kind, tuple) else kind


def _value(parameter: Parameter, given: object, vertices: FloatArray) -> object:
    if not isinstance(given, str):
        return given
    text = given.strip()
    try:
        if parameter.kind == LENGTH_TYPE and text.endswith("%"):
            return float(text[:-1]) / 100 * float(np.linalg.norm(np.ptp(vertices, axis=0)))
        return ast.literal_eval(text)
    except (SyntaxError, ValueError):  # a word
        return text


def _names(function: Callable[..., Any]) -> dict[str, str]:
    """The table's names of the parameters of a function, and its own."""
    own = {name.replace("_", ""): name for name in inspect.signature(function).parameters}
    return own | {name: other for name, other in _RENAMED.items() if other in own.values()}


def _arguments(function: Callable[..., Any], values: Mapping[str, Any]) -> dict[str, Any]:
    names = _names(function)
    return {names[key]: value for key, value in values.items() if key in names}
