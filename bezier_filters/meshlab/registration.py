"""Optional registration of the filters in pymeshlab: as methods of MeshSet, in lists, and as steps of scripts.

Functions of pymeshlab and of its MeshSet that accept or return filter names are wrapped; other names are passed on.
Steps of this package are stored in the MeshSet's own script, where pymeshlab preserves unknown steps in order. But it
rounds numbers to six digits and drops values without a type, so these steps are stored as text.
"""

import inspect
from collections.abc import Callable, Mapping
from functools import wraps
from typing import Any

from bezier_filters.arrays import Report
from bezier_filters.errors import InvalidScriptError
from bezier_filters.files.filter_scripts import ScriptStep, read_filter_script
from bezier_filters.meshlab.meshset import (
    LIBRARY,
    BezierFilterError,
    MeshSet,
    one_at_a_time,
    read_script_steps,
    write_script_steps,
)
from bezier_filters.meshlab.scripts import (
    OURS,
    describe_type,
    parameters_of,
    run_filter_script,
    script_step,
    snake_case,
)
from bezier_filters.runtime.supervision import hold_interrupts

Original = Callable[..., Any]

_replaced: list[tuple[Any, str, Any]] = []  # owner, name and original of each replacement; None if there was none


def register() -> None:
    """Make the filters part of pymeshlab, as if they were its own.

    They become methods of `pymeshlab.MeshSet`, with their signatures and docstrings, and
    `MeshSet.apply_filter`, `MeshSet.filter_parameter_values`, `filter_list`, `search`, `print_filter_list` and
    `print_filter_parameter_list` know them. Methods and `apply_filter` are recorded in the filter script of the
    MeshSet, in order, between the steps of MeshLab; `save_filter_script` writes it, and `load_filter_script` and
    `apply_filter_script` replay it. The functions of `bezier_filters` do not change the script.

    Calling it again changes nothing; `unregister` undoes it. Names that were imported from pymeshlab before, as by
    ``from pymeshlab import filter_list``, stay those of pymeshlab.

    Raises
    ------
    BezierFilterError
        If `pymeshlab.MeshSet` has another attribute of one of these names; then nothing is added.

    Examples
    --------
    >>> from pymeshlab import MeshSet
    >>> register()
    >>> ms = MeshSet()
    >>> ms.create_sphere(subdiv=3)
    >>> ms.apply_filter("compute_curvature_by_bezier_patch_per_vertex", quality="mean")["status"]
    {'OK': 642}
    >>> ms.compute_torsion_by_bezier_patch_per_vertex()["status"]
    {'OK': 642}
    >>> unregister()
    """
    for name, method in _METHODS.items():
        if getattr(MeshSet, name, method) is not method:
            raise BezierFilterError(
                f"pymeshlab.MeshSet has another attribute {name!r}; call the function of bezier_filters"
            )
    if _replaced:
        return
    for name, method in _METHODS.items():
        _replace(MeshSet, name, method)
    for owner, functions in ((MeshSet, _OF_MESHSETS), (LIBRARY, _OF_THE_LIBRARY)):
        for function in functions:
            name = function.__name__.removeprefix("_")
            _replace(owner, name, _extend(vars(owner)[name], function))


def unregister() -> None:
    """Undo `register`; without a registration, nothing happens.

    Steps of ours that were recorded stay in the scripts of MeshSets, and pymeshlab alone cannot replay them.

    Examples
    --------
    >>> from pymeshlab import MeshSet
    >>> register()
    >>> unregister()
    >>> hasattr(MeshSet, "compute_curvature_by_bezier_patch_per_vertex")
    False
    """
    while _replaced:
        owner, name, original = _replaced.pop()
        if original is None:
            delattr(owner, name)
        else:
            setattr(owner, name, original)


def _replace(owner: Any, name: str, value: Any) -> None:
    _replaced.append((owner, name, vars(owner).get(name)))
    setattr(owner, name, value)


def _extend(original: Original, function: Callable[..., Any]) -> Callable[..., Any]:
    """Wrap a function of pymeshlab, which becomes the first argument of a function of this package."""

    @wraps(original)
    def wrapper(*arguments: Any, **parameters: Any) -> Any:
        return function(original, *arguments, **parameters)

    return wrapper


def _method(function: Callable[..., Report]) -> Callable[..., Report]:
    @wraps(function)
    def method(ms: MeshSet, **parameters: Any) -> Report:
        return dict(ms.apply_filter(function.__name__, **parameters))

    return method


def _apply_filter(original: Original, ms: MeshSet, filter_name: str, **parameters: Any) -> Report:
    if filter_name not in OURS:
        return dict(original(ms, filter_name, **parameters))
    values = _values(filter_name, {name: value for name, value in parameters.items() if name != "progress"})
    values["threads"] = None  # results do not depend on it
    report = OURS[filter_name](ms, **parameters)
    step = script_step(filter_name, **{key: "none" if value is None else value for key, value in values.items()})
    with hold_interrupts(), one_at_a_time():
        write_script_steps(ms, [*read_script_steps(ms), _textual_step(step)])
    return report


def _filter_parameter_values(original: Original, ms: MeshSet, name: str, **parameters: Any) -> dict[str, Any]:
    return _values(name, parameters) if name in OURS else dict(original(ms, name, **parameters))


def _values(name: str, given: Mapping[str, Any]) -> dict[str, Any]:
    """Values of all parameters that scripts can set, of a filter of this package."""
    signature = inspect.signature(OURS[name])
    defaults = {key: signature.parameters[key].default for key in parameters_of(OURS[name])}
    for key in given:
        if key not in defaults:
            raise BezierFilterError(f"Parameter {key} not found for filter {name}. It has {', '.join(defaults)}.")
    return defaults | dict(given)


def _load_filter_script(original: Original, ms: MeshSet, filter_script_name: str) -> None:
    try:
        steps = read_filter_script(filter_script_name)
    except (OSError, InvalidScriptError):
        steps = []
    if any(map(_is_ours, steps)):
        write_script_steps(ms, [_textual_step(step) for step in steps])
    else:
        original(ms, filter_script_name)


def _apply_filter_script(original: Original, ms: MeshSet) -> None:
    steps = read_script_steps(ms)
    if not any(map(_is_ours, steps)):
        original(ms)
        return
    try:
        run_filter_script(ms, steps)
    finally:
        write_script_steps(ms, steps)  # pymeshlab does not record a replay


def _is_ours(step: ScriptStep) -> bool:
    return step.name in OURS or snake_case(step.name) in OURS


def _textual_step(step: ScriptStep) -> ScriptStep:
    """A step with values as text, which a MeshSet stores without loss."""
    kept = {"type": "RichString"} if _is_ours(step) else {}
    least = {"type": "RichString", "min": "0", "max": "0"}  # of lengths, pymeshlab reads those with a range
    return ScriptStep(step.name, {name: least | dict(given) | kept for name, given in step.parameters.items()})


def _filter_list(original: Original) -> list[str]:
    return sorted([*original(), *OURS])


def _search(original: Original, keyword: str) -> None:
    original(keyword)
    for name, function in OURS.items():
        summary = (function.__doc__ or "").partition("\n")[0]
        if all(word in f"{name} {summary}".lower() for word in keyword.lower().split()):
            print(f"{name} : {summary}", flush=True)


def _print_filter_list(original: Original) -> None:
    original()
    print(*(f"\t{name}" for name in OURS), sep="\n", flush=True)


def _print_filter_parameter_list(original: Original, name: str) -> None:
    if name not in OURS:
        original(name)
        return
    print(f"{name} filter - list of parameter names:")
    hints = parameters_of(OURS[name])
    for key, value in _values(name, {}).items():
        print(f"\t{key} : {describe_type(hints[key])} = {value}", flush=True)


_METHODS = {name: _method(function) for name, function in OURS.items()}
_OF_MESHSETS = (_apply_filter, _filter_parameter_values, _load_filter_script, _apply_filter_script)
_OF_THE_LIBRARY = (_filter_list, _search, _print_filter_list, _print_filter_parameter_list)
