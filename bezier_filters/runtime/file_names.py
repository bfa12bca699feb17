"""How messages name files: pipes as such, and what cannot be printed as escapes."""

import os
from pathlib import Path

_pipes: dict[str, str] = {}  # names of pipes by the paths of the temporary files that stand for them


def name_pipe(path: Path, name: str) -> None:
    """Let messages name a temporary file as the pipe that it stands for, such as ``<stdin>``."""
    _pipes[str(path)] = name


def given_path(path: str | os.PathLike[str]) -> str:
    """A path as the user gave it."""
    return _pipes.get(str(path), str(path))


def shown_path(path: str | os.PathLike[str]) -> str:
    r"""A path as it can be printed.

    >>> shown_path("scans/new\nline\udce9.ply")
    'scans/new\\nline\\udce9.ply'
    """
    return printable(given_path(path))


def shown_name(path: str | os.PathLike[str]) -> str:
    """The last part of a path as it can be printed."""
    return printable(_pipes.get(str(path), Path(path).name))


def with_pipes_named(text: str) -> str:
    """A message in which pipes have their names in the place of temporary files."""
    for path, name in _pipes.items():
        text = text.replace(path, name)
    return text


def printable(text: str) -> str:
    """A text whose control characters, and bytes that are no text, are escapes: no terminal obeys them."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text)


def is_utf8(text: str) -> bool:
    """Whether all bytes of a path are text; those of others are surrogates."""
    try:
        text.encode("utf-8")
    except UnicodeEncodeError:
        return False
    return True
