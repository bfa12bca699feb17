"""MeshLab's filter scripts (.mlx): steps read from and written to XML files."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
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
    reader = _Reader(str(path))
    parser = expat.ParserCreate()
    parser.StartElementHandler = reader.start
    parser.EndElementHandler = reader.end
    parser.EntityDeclHandler = reader.refuse_entity
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        raise InvalidScriptError(f"{path}: is no filter script: {error}") from error
    return reader.steps


@dataclass
class _Reader:
    path: str
    steps: list[ScriptStep] = field(default_factory=list)
    parents: list[str] = field(default_factory=list)

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        if self.parents == []:
            if tag != "FilterScript":
                self._refuse(f"the outermost element is <{tag}>, expected <FilterScript>")
        elif self.parents == ["FilterScript"] and tag in ("filter", "xmlfilter"):
            self.steps.append(ScriptStep(self._name(tag, attributes), {}))
        elif self.parents[1:] in (["filter"], ["xmlfilter"]) and tag in ("Param", "xmlparam"):
            last = self.steps.pop()
            name = self._name(tag, attributes)
            if name in last.parameters:
                self._refuse(f"the filter {last.name!r} has two parameters {name!r}")
            others = {key: value for key, value in attributes.items() if key != "name"}
            self.steps.append(ScriptStep(last.name, {**last.parameters, name: others}))
        else:
            self._refuse(f"an element <{tag}> within <{self.parents[-1]}>, expected <filter> and <Param>")
        self.parents.append(tag)

    def end(self, _tag: str) -> None:
        self.parents.pop()

    def refuse_entity(self, name: str, *_: Any) -> None:
        self._refuse(f"it declares an entity {name!r}, which scripts do not need")

    def _name(self, tag: str, attributes: dict[str, str]) -> str:
        name = attributes.get("name", "")
        if not name:
            self._refuse(f"a <{tag}> without a name")
        return name

    def _refuse(self, reason: str) -> None:
        raise InvalidScriptError(f"{self.path}: is no filter script: {reason}")


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
    lines = ["<!DOCTYPE FilterScript>", "<FilterScript>"]
    for step in steps:
        lines.append(f" <filter name={quoteattr(step.name)}>")
        for name, attributes in step.parameters.items():
            others = "".join(f" {key}={quoteattr(value)}" for key, value in attributes.items())
            lines.append(f"  <Param name={quoteattr(name)}{others}/>")
        lines.append(" </filter>")
    lines.append("</FilterScript>")
    with atomic_write(path) as temporary:
        Path(temporary).write_text("\n".join(lines) + "\n", encoding="utf-8")
