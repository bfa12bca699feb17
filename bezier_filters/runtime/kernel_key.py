"""Key of the kernel cache: a hash of all sources and versions that determine the machine code."""

import re
from functools import cache
from hashlib import sha256
from pathlib import Path

import llvmlite
import numba

from bezier_filters._version import __version__

PACKAGE = Path(__file__).parents[1]
KEY_DIGITS = 16  # digits of the key in the name of a folder
# at the beginning of a line: imports inside functions do not reach compiled code
_IMPORT = re.compile(rb"^from bezier_filters\.([\w.]+) import", re.MULTILINE)
_COMPILES = b"jit("  # occurs in modules with compiled functions


@cache
def kernel_key() -> str:
    """Key of all compiled functions of this installation, the same on every machine and in every folder.

    A function may call any other one, and contains the constants of modules that it imports. So all share one key: a
    hash of the sources of all modules with compiled functions and of the modules that they import, and of the versions
    of this package and of the compiler. Without sources, as in an archive, it is empty.
    """
    sources = kernel_sources(PACKAGE)
    return sources_key(sources, __version__, numba.__version__, llvmlite.__version__) if sources else ""


def sources_key(sources: dict[str, bytes], *versions: str) -> str:
    """Hash of versions and of named sources.

    >>> sources_key({"a.py": b"1", "b.py": b"2"}) == sources_key({"b.py": b"2", "a.py": b"1"})
    True
    """
    digest = sha256(repr(versions).encode())
    for name in sorted(sources):
        digest.update(f"\n{name} {len(sources[name])}\n".encode() + sources[name])
    return digest.hexdigest()


def kernel_sources(package: Path) -> dict[str, bytes]:
    """Sources of modules with compiled functions, and of the modules that they import, by path."""
    sources = {path.relative_to(package).as_posix(): path.read_bytes() for path in package.rglob("*.py")}
    found = dict[str, bytes]()
    waiting = [name for name, source in sources.items() if _COMPILES in source]
    while waiting:
        name = waiting.pop()
        if name in sources and name not in found:
            found[name] = sources[name]
            for module in _IMPORT.findall(found[name]):
                path = module.decode().replace(".", "/")
                waiting += [f"{path}.py", f"{path}/__init__.py"]
    return found
