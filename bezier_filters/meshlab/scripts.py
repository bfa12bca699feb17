"""Runs filter scripts that mix MeshLab's filters with filters of this package."""

import difflib
import inspect
import json
import keyword
import re
import types
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np

from bezier_filters.arrays import Report
from bezier_filters.errors import InvalidScriptError
from bezier_filters.files.filter_scripts import ScriptStep
from bezier_filters.meshlab.bridge_filter import meshing_bridge_holes_by_bezier_patch
from bezier_filters.meshlab.crease_filter import compute_selection_by_bezier_crease_per_edge
from bezier_filters.meshlab.deviation_filter import compute_deviation_by_bezier_patch_per_vertex
from bezier_filters.meshlab.hole_filter import meshing_close_holes_by_bezier_patch
from bezier_filters.meshlab.line_filter import generate_polyline_by_bezier_patch_direction
from bezier_filters.meshlab.measure_filter import get_surface_measures_by_bezier_patch
from bezier_filters.meshlab.meshset import (
    BezierFilterError,
    BoundingBox,
    Color,
    MeshSet,
    PercentageValue,
    PureValue,
    PyMeshLabException,
    filter_list,
    former_filter_names,
)
from bezier_filters.meshlab.remeshing_filter import meshing_remeshing_by_bezier_patch
from bezier_filters.meshlab.replacement_filter import meshing_replace_selection_by_bezier_patch
from bezier_filters.meshlab.subdivision_filter import meshing_surface_subdivision_by_bezier_patch
from bezier_filters.meshlab.texture_filter import compute_texmap_by_bezier_patch
from bezier_filters.meshlab.vertex_filters import (
    apply_coord_bezier_patch_smoothing,
    compute_curvature_by_bezier_patch_per_vertex,
    compute_normal_by_bezier_patch_per_vertex,
    compute_torsion_by_bezier_patch_per_vertex,
)
from bezier_filters.runtime.compile_time import clock_without_compilation
from bezier_filters.runtime.parallel import Progress

FILTERS: tuple[Callable[..., Report], ...] = (
    apply_coord_bezier_patch_smoothing,
    meshing_close_holes_by_bezier_patch,
    compute_normal_by_bezier_patch_per_vertex,
    compute_curvature_by_bezier_patch_per_vertex,
    compute_torsion_by_bezier_patch_per_vertex,
    compute_selection_by_bezier_crease_per_edge,
    generate_polyline_by_bezier_patch_direction,
    meshing_replace_selection_by_bezier_patch,
    meshing_bridge_holes_by_bezier_patch,
    compute_texmap_by_bezier_patch,
    meshing_surface_subdivision_by_bezier_patch,
    meshing_remeshing_by_bezier_patch,
    compute_deviation_by_bezier_patch_per_vertex,
    get_surface_measures_by_bezier_patch,
)
OURS = {function.__name__: function for function in FILTERS}

# MeshLab's names of filters that are younger than pymeshlab's table of former names.
_NEWER_NAMES = {
    "alpha_wrap": "generate_alpha_wrap",
    "colorize_by_approximated_geodesic_distance_from_the_selected_points": (
        "compute_scalar_by_heat_geodesic_distance_from_selection_per_vertex"
    ),
    "compute_ambient_occlusion": "compute_scalar_ambient_occlusion",
    "compute_obscurance": "compute_scalar_by_volumetric_obscurance",
    "compute_shape_diameter_function": "compute_scalar_by_shape_diameter_function_per_vertex",
    "cubic_stylization": "apply_coord_cubic_stylization",
    "dodecahedron_symmetric": "create_dodecahedron_sym",
    "make_mesh_developable": "apply_coord_developability_of_mesh",
    "per_face_normal_function": "compute_normal_by_function_per_face",
    "re_orient_all_faces_coherently": "meshing_re_orient_faces_coherently",
    "reorient_face_normals_by_geometry": "meshing_re_orient_faces_by_geometry",
    "subdivision_surfaces_doo_sabin": "meshing_surface_subdivision_doo_sabin",
}


@dataclass(frozen=True)
class StepReport:
    """Result of a step of a script.

    Attributes
    ----------
    filter : str
        Name of the filter in Python.
    by : {"bezier_filters", "MeshLab"}
        Whose filter it is.
    seconds : float
        How long it took.
    report : dict
        What the filter returned; arrays as lists.
    """

    filter: str
    by: str
    seconds: float
    report: Report


def run_filter_script(
    ms: MeshSet, steps: Sequence[ScriptStep], *, progress: Progress | None = None
) -> list[StepReport]:
    """Run the steps of a filter script on a MeshSet, one after the other.

    Names are MeshLab's (``"Laplacian Smooth"``), pymeshlab's (``"apply_coord_laplacian_smoothing"``) or of this
    package. Names of filters, and parameters of this package's filters, are checked before the first step runs.

    Parameters
    ----------
    ms : pymeshlab.MeshSet
        What the filters change.
    steps : sequence of ScriptStep
        As of `read_filter_script`.
    progress : callable, optional
        ``progress(done, total)`` is called by our filters now and then; if it returns False, they stop.

    Returns
    -------
    list of StepReport
        One for each step.

    Raises
    ------
    InvalidScriptError
        If a filter is unknown (the message has the nearest names), or a parameter is unknown or of another type.
    BezierFilterError
        If a filter refuses the mesh or a parameter; the steps before it have been done.

    Examples
    --------
    >>> from pymeshlab import MeshSet
    >>> from bezier_filters import script_step
    >>> ms = MeshSet()
    >>> steps = [script_step("Sphere", subdiv=4), script_step("compute_curvature_by_bezier_patch_per_vertex")]
    >>> [step.by for step in run_filter_script(ms, steps)]
    ['MeshLab', 'bezier_filters']
    """
    names = check_steps(steps)
    reports = []
    for number, (name, step) in enumerate(zip(names, steps, strict=True), start=1):
        start = clock_without_compilation()
        with _errors_of(f"step {number}, {step.name!r}"):
            if name in OURS:
                function = getattr(MeshSet, name, OURS[name])  # the method, if there is one, is recorded
                report = function(ms, **_our_values(name, step), progress=progress)
            else:
                report = _run_meshlab(ms, name, step)
        whose = "bezier_filters" if name in OURS else "MeshLab"
        plain = json.loads(json.dumps(report, default=_plain))
        reports.append(StepReport(name, whose, clock_without_compilation() - start, plain))
    return reports


def check_steps(steps: Sequence[ScriptStep]) -> list[str]:
    """Names in Python of the filters of a script."""
    theirs = filter_list()
    former = {old: now for old, now in (former_filter_names() | _NEWER_NAMES).items() if now in theirs}
    known = former | {name: name for name in (*theirs, *OURS)}
    names = []
    for number, step in enumerate(steps, start=1):
        with _errors_of(f"step {number}, {step.name!r}"):
            sought = snake_case(step.name)
            name = known.get(step.name) or known.get(sought)
            if name is None:
                close = dict.fromkeys(known[match] for match in difflib.get_close_matches(sought, known, cutoff=0.5))
                lists = "pymeshlab.print_filter_list() lists MeshLab's"
                hint = f"did you mean {' or '.join(close)}?" if close else lists
                raise InvalidScriptError(f"unknown filter; {hint}")
            if name in OURS:
                _our_values(name, step)
        names.append(name)
    return names


@contextmanager
def _errors_of(part: str) -> Iterator[None]:
    """Name the part of a script in errors."""
    try:
        yield
    except InvalidScriptError as error:
        raise InvalidScriptError(f"{part}: {error}") from error
    except PyMeshLabException as error:
        raise BezierFilterError(f"{part}: {error}") from error


def snake_case(name: str) -> str:
    """MeshLab's name of a filter in pymeshlab's former spelling.

    >>> snake_case("Remeshing: Isotropic Explicit Remeshing")
    'remeshing_isotropic_explicit_remeshing'
    """
    return re.sub("[^0-9a-z]+", "_", name.lower()).strip("_")


def _our_values(name: str, step: ScriptStep) -> dict[str, Any]:
    hints = parameters_of(OURS[name])
    return _convert_parameters(step, hints, lambda key, attributes: value_of_type(hints[key], attributes))


def _convert_parameters(
    step: ScriptStep, known: Mapping[str, Any], convert: Callable[[str, Mapping[str, str]], Any]
) -> dict[str, Any]:
    values = {}
    for given, attributes in step.parameters.items():
        key = given.lower().replace(" ", "_")
        key = f"{key}_" if keyword.iskeyword(key) else key
        if key not in known:
            close = difflib.get_close_matches(key, known, n=1)
            hint = f"did you mean {close[0]}?" if close else f"it has {', '.join(known) or 'none'}"
            raise InvalidScriptError(f"unknown parameter {given!r}; {hint}")
        with _errors_of(f"parameter {given!r}"):
            values[key] = convert(key, attributes)
    return values


def _run_meshlab(ms: MeshSet, name: str, step: ScriptStep) -> Report:
    defaults = ms.filter_parameter_values(name)  # some depend on the mesh
    values = _convert_parameters(step, defaults, lambda key, attributes: value_like(defaults[key], attributes))
    while True:
        try:
            return dict(ms.apply_filter(name, **values) or {})
        except PyMeshLabException as error:
            # Of lengths without a type in the script, only pymeshlab itself knows that they are lengths.
            length = re.match(r"Parameter (\w+): must be a pymeshlab.Percentage", str(error))
            if length is None or not isinstance(values.get(length[1]), float):
                raise
            values[length[1]] = PureValue(values[length[1]])
        except Exception as error:  # pymeshlab's exceptions have no base of their own
            raise BezierFilterError(str(error).partition(" (#define")[0]) from error


def _plain(value: Any) -> Any:
    """Convert a value for JSON."""
    if isinstance(value, BoundingBox):
        return {"min": value.min(), "max": value.max()}
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else str(value)


_NOT_IN_SCRIPTS = ("ms", "progress")
_TYPES = {int: "RichInt", float: "RichFloat"}  # MeshLab's names; anything else is text


def script_step(name: str, **parameters: Any) -> ScriptStep:
    """Step of a script, with parameters given as Python values; None is omitted.

    Parameters
    ----------
    name : str
        Name of a filter of this package or of pymeshlab.
    **parameters
        Numbers, text, booleans, `pymeshlab.PercentageValue` or `pymeshlab.PureValue`.

    Examples
    --------
    >>> script_step("apply_coord_bezier_patch_smoothing", iterations=2).parameters["iterations"]
    {'type': 'RichInt', 'value': '2'}
    """
    given = {key: value for key, value in parameters.items() if value is not None}
    return ScriptStep(name, {key: _attributes(value) for key, value in given.items()})


def _attributes(value: Any) -> dict[str, str]:
    if isinstance(value, bool):
        return {"type": "RichBool", "value": str(value).lower()}
    if type(value) is PercentageValue:
        return {"type": "RichString", "value": f"{value.value()!r}%"}
    if type(value) is PureValue:
        return {"type": "RichAbsPerc", "value": repr(value.value())}
    if isinstance(value, tuple | list | np.ndarray):
        return {"type": "RichString", "value": " ".join(map(str, value))}
    return {"type": _TYPES.get(type(value), "RichString"), "value": str(value)}


def parameters_of(function: Callable[..., Any]) -> dict[str, Any]:
    """Parameters of a filter of this package that a script can set, and their types."""
    hints = get_type_hints(function)
    return {name: hints[name] for name in inspect.signature(function).parameters if name not in _NOT_IN_SCRIPTS}


def value_of_type(hint: Any, attributes: Mapping[str, str]) -> Any:
    """Value of a parameter of a filter of this package.

    >>> value_of_type(int | Literal["auto"], {"value": "3"})
    3
    """
    text = _value(attributes)
    for option in sorted(_options(hint), key=lambda option: option is not type(None)):  # "none" may be any text
        try:
            return _read(option, text)
        except (ValueError, KeyError):
            continue
    raise InvalidScriptError(f"got {text!r}, expected {describe_type(hint)}")


def describe_type(hint: Any) -> str:
    """Values that a parameter accepts, in words.

    >>> describe_type(int | Literal["auto"])
    "an integer or 'auto'"
    """
    return " or ".join(dict.fromkeys(map(_describe_option, _options(hint))))


def _options(hint: Any) -> list[Any]:
    if get_origin(hint) in (Union, types.UnionType):
        return [option for part in get_args(hint) for option in _options(part)]
    return list(get_args(hint)) if get_origin(hint) is Literal else [hint]


def _percentage(text: str) -> PercentageValue:
    if not text.endswith("%"):
        raise ValueError
    return PercentageValue(float(text.removesuffix("%")))


_FLAGS, _NOTHING = {"true": True, "1": True, "false": False, "0": False}, {"": None, "none": None}
# parsers of text by type, which raise ValueError or KeyError, and the names of the types in messages
_READERS: dict[object, tuple[Callable[[str], object], str]] = {
    bool: (lambda text: _FLAGS[text.lower()], "true or false"),
    int: (int, "an integer"),
    float: (float, "a number"),
    str: (str, "text"),
    PureValue: (float, "a number"),  # float instead, as PureValue has single precision
    PercentageValue: (_percentage, "a percentage such as 2%"),
    type(None): (lambda text: _NOTHING[text.lower()], "nothing"),
}


def _read(option: Any, text: str) -> Any:
    if option in _READERS:
        return _READERS[option][0](text)
    if get_origin(option) is tuple:
        return tuple(_read(kind, part) for kind, part in zip(get_args(option), text.split(), strict=True))
    if text != option:  # one of the words of a Literal
        raise ValueError
    return option


def _describe_option(option: Any) -> str:
    if get_origin(option) is tuple:
        return f"{len(get_args(option))} numbers"
    return _READERS[option][1] if option in _READERS else repr(option)


def value_like(default: Any, attributes: Mapping[str, str]) -> Any:
    """Value of a parameter of a filter of MeshLab, whose default in pymeshlab is known."""
    if isinstance(default, np.ndarray):
        return _array(default.shape, attributes)
    if type(default) is Color:
        return Color(*(int(_value(attributes, channel)) for channel in "rgba"))
    if type(default) is float and attributes.get("type") == "RichAbsPerc" and not _value(attributes).endswith("%"):
        return PureValue(value_of_type(float, attributes))
    # an integer may stand for a word of an enumeration, a float for a length
    hints = {bool: bool, int: int | str, float: PercentageValue | float}
    return value_of_type(hints.get(type(default), str), attributes)


def _array(shape: tuple[int, ...], attributes: Mapping[str, str]) -> Any:
    """A point or direction (x, y, z) or a matrix (val0 to val15), or numbers in one text."""
    size = int(np.prod(shape))
    keys = ("x", "y", "z") if size == 3 else tuple(f"val{k}" for k in range(size))
    try:
        texts = [attributes[key] for key in keys] if keys[0] in attributes else _value(attributes).split()
        return np.array([float(text) for text in texts]).reshape(shape)
    except (KeyError, ValueError) as error:
        raise InvalidScriptError(f"got {dict(attributes)}, expected {size} numbers {', '.join(keys)}") from error


def _value(attributes: Mapping[str, str], key: str = "value") -> str:
    if key not in attributes:
        raise InvalidScriptError(f"has no attribute {key}=")
    return attributes[key].strip()
