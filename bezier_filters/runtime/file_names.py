"""File names in messages: names of pipes instead of temporary files, and escapes for unprintable characters."""

import os
from pathlib import Path

_pipes: dict[str, str] = {}  # names of pipes by the paths of their temporary files


def name_pipe(path: Path, name: str) -> None:
    """Register the name of a pipe, such as ``<stdin>``, for the temporary file that replaces it."""
    _pipes[str(path)] = name


def user_path(path: str | os.PathLike[str]) -> str:
    """Path as the user gave it: the name of the pipe for a temporary file."""
    return _pipes.get(str(path), str(path))


def printable_path(path: str | os.PathLike[str]) -> str:
    r"""Path with escapes for unprintable characters.

    >>> printable_path("scans/new\nline\udce9.ply")
    'scans/new\\nline\\udce9.ply'
    """
    return escape_unprintable(user_path(path))


def printable_name(path: str | os.PathLike[str]) -> str:
    """Last component of a path with escapes for unprintable characters."""
    return escape_unprintable(_pipes.get(str(path), Path(path).name))


def replace_pipe_paths(text: str) -> str:
    """Replace the paths of temporary files in a message by the names of their pipes."""
    for path, name in _pipes.items():
        text = text.replace(path, name)
    return text


def escape_unprintable(text: str) -> str:
    """Escape control characters and undecodable bytes of a text, so that no terminal interprets them."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text)


def is_utf8(text: str) -> bool:
    """Whether a path is valid UTF-8; invalid bytes are surrogates."""
    try:
        text.encode("utf-8")
    except UnicodeEncodeError:
        return False
    return True
