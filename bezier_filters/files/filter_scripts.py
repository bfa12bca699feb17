"""MeshLab's filter scripts (.mlx): steps read from and written to XML files."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from xml.etree import ElementTree
from xml.parsers import expat
from xml.sax.saxutils import quoteattr

from bezier_filters.errors import InvalidScriptError
from bezier_filters.runtime.atomic import atomic_write

_LARGEST = 16 * 2**20  # bytes; scripts have a few thousand


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
        If the file is no filter script; the message says where it goes wrong. Scripts that declare entities are
        refused.
    OSError
        If it cannot be read.
    """
    data = Path(path).read_bytes()
    if len(data) > _LARGEST:
        raise InvalidScriptError(f"{path}: is no filter script: it has {len(data):,} bytes")
    parser = expat.ParserCreate()
    parser.EntityDeclHandler = partial(_refuse_entity, path)
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        raise _refusal(path, str(error)) from error
    root = ElementTree.fromstring(data)
    if root.tag != "FilterScript":
        raise _refusal(path, f"the outermost element is <{root.tag}>, expected <FilterScript>")
    return [_step(path, element) for element in root]


def _step(path: str | os.PathLike[str], element: ElementTree.Element) -> ScriptStep:
    name = _checked_name(path, "FilterScript", element, ("filter", "xmlfilter"))
    parameters: dict[str, Mapping[str, str]] = {}
    for child in element:
        parameter = _checked_name(path, element.tag, child, ("Param", "xmlparam"))
        for below in child:
            _checked_name(path, child.tag, below, ())
        if parameter in parameters:
            raise _refusal(path, f"the filter {name!r} has two parameters {parameter!r}")
        parameters[parameter] = {key: value for key, value in child.attrib.items() if key != "name"}
    return ScriptStep(name, parameters)


def _checked_name(path: str | os.PathLike[str], parent: str, element: ElementTree.Element, tags: Sequence[str]) -> str:
    if element.tag not in tags:
        raise _refusal(path, f"an element <{element.tag}> within <{parent}>, expected <filter> and <Param>")
    if not element.get("name"):
        raise _refusal(path, f"a <{element.tag}> without a name")
    return element.attrib["name"]


def _refuse_entity(path: str | os.PathLike[str], name: str, *_: object) -> None:
    raise _refusal(path, f"it declares an entity {name!r}, which scripts do not need")


def _refusal(path: str | os.PathLike[str], reason: str) -> InvalidScriptError:
    return InvalidScriptError(f"{path}: is no filter script: {reason}")


def save_filter_script(path: str | os.PathLike[str], steps: Sequence[ScriptStep]) -> None:
    """Write a filter script, whole or not at all.

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
    with atomic_write(path) as temporary:
        Path(temporary).write_text(script_text(steps), encoding="utf-8")


def script_text(steps: Sequence[ScriptStep]) -> str:
    """What a file of a filter script says."""
    lines = ["<!DOCTYPE FilterScript>", "<FilterScript>"]
    for step in steps:
        lines.append(f" <filter name={quoteattr(step.name)}>")
        for name, attributes in step.parameters.items():
            others = "".join(f" {key}={quoteattr(value)}" for key, value in attributes.items())
            lines.append(f"  <Param name={quoteattr(name)}{others}/>")
        lines.append(" </filter>")
    return "\n".join([*lines, "</FilterScript>", ""])
