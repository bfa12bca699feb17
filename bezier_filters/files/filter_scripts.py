"""MeshLab's filter scripts (.mlx): steps read from and written to XML files."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree
from xml.parsers import expat
from xml.sax.saxutils import quoteattr

from bezier_filters.arguments import brief_repr, path_of
from bezier_filters.errors import InvalidScriptError
from bezier_filters.runtime.atomic import atomic_write

_MAX_SCRIPT_BYTES = 16 * 2**20  # bytes; scripts have a few thousand


@dataclass(frozen=True)
class ScriptStep:
    """A filter of a script and its parameters.

    Attributes
    ----------
    name : str
        MeshLab's name of the filter, pymeshlab's, or that of a filter of this package.
    parameters : dict of dict of str
        By name, the attributes of each ``<Param>`` as MeshLab writes them: ``type``, ``value`` and others.
    """

    name: str
    parameters: Mapping[str, Mapping[str, str]] = field(default_factory=dict)


def read_filter_script(path: str | os.PathLike[str]) -> list[ScriptStep]:
    """Steps of a filter script.

    Parameters
    ----------
    path : path
        File of MeshLab, pymeshlab (`save_filter_script`) or this package.

    Raises
    ------
    InvalidScriptError
        If the file is not a filter script; the message names the fault. Scripts that declare entities are
        refused.
    OSError
        If it cannot be read.
    """
    data = Path(path_of(path)).read_bytes()
    try:
        return _steps(data)
    except (InvalidScriptError, expat.ExpatError) as error:
        raise InvalidScriptError(f"{path}: is no filter script: {error}") from error


def _steps(data: bytes) -> list[ScriptStep]:
    if len(data) > _MAX_SCRIPT_BYTES:
        raise InvalidScriptError(f"it has {len(data):,} bytes")
    tree, parser = ElementTree.TreeBuilder(), expat.ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler = tree.start, tree.end
    parser.EntityDeclHandler = _refuse_entity
    parser.Parse(data, True)
    root = tree.close()
    if root.tag != "FilterScript":
        raise InvalidScriptError(f"the outermost element is <{root.tag}>, expected <FilterScript>")
    steps = []
    for element in root:
        name, parameters = _element_name("FilterScript", element, "filter", "xmlfilter"), dict[str, dict[str, str]]()
        for child in element:
            parameter = _element_name(element.tag, child, "Param", "xmlparam")
            for below in child:
                _element_name(child.tag, below)
            if parameter in parameters:
                raise InvalidScriptError(f"the filter {name!r} has two parameters {parameter!r}")
            parameters[parameter] = {key: value for key, value in child.attrib.items() if key != "name"}
        steps.append(ScriptStep(name, parameters))
    return steps


def _element_name(parent: str, element: ElementTree.Element, *tags: str) -> str:
    if element.tag not in tags:
        raise InvalidScriptError(f"an element <{element.tag}> within <{parent}>, expected <filter> and <Param>")
    if not element.get("name"):
        raise InvalidScriptError(f"a <{element.tag}> without a name")
    return element.attrib["name"]


def _refuse_entity(name: str, *_: object) -> None:
    raise InvalidScriptError(f"it declares an entity {name!r}, which scripts do not need")


def save_filter_script(path: str | os.PathLike[str], steps: Sequence[ScriptStep]) -> None:
    """Write a filter script atomically.

    MeshLab opens it; it runs the steps that are its own filters. `run_filter_script` runs all of them.

    Parameters
    ----------
    path : path
        File to write or replace, usually ``.mlx``.
    steps : sequence of ScriptStep
        In order, as of `read_filter_script`.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    path_of(path)
    if not (isinstance(steps, Sequence) and all(isinstance(step, ScriptStep) for step in steps)):
        raise InvalidScriptError(f"steps: got {brief_repr(steps)}, expected a list of ScriptStep; see script_step")
    with atomic_write(path) as temporary:
        Path(temporary).write_text(script_text(steps), encoding="utf-8")


def script_text(steps: Sequence[ScriptStep]) -> str:
    """Text of a filter script file."""
    lines = ["<!DOCTYPE FilterScript>", "<FilterScript>"]
    for step in steps:
        lines.append(f" <filter name={quoteattr(step.name)}>")
        for name, attributes in step.parameters.items():
            others = "".join(f" {key}={quoteattr(value)}" for key, value in attributes.items())
            lines.append(f"  <Param name={quoteattr(name)}{others}/>")
        lines.append(" </filter>")
    return "\n".join([*lines, "</FilterScript>", ""])
