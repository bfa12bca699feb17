"""Files and folders by URL (s3://, gs://, memory://, ...), through `fsspec`, with the methods of `pathlib.Path`.

Tasks read ranges of remote files. Whatever is written comes first into a local file, and is sent as a whole.
"""

import os
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, TypeAlias

from bezier_filters.errors import InvalidParameterError
from bezier_filters.runtime.atomic import atomic_write, temporary_folder
from bezier_filters.runtime.cached_property import cached_property
from bezier_filters.runtime.parallel import thread_count

S3_COMMAND = 'pip install "bezier-filters[s3]"'


@dataclass(frozen=True)
class RemotePath:
    """A file or a folder at a URL."""

    url: str

    def __str__(self) -> str:
        return self.url

    def __truediv__(self, name: str) -> "RemotePath":
        return RemotePath(f"{self.url.rstrip('/')}/{name}")

    def __getstate__(self) -> dict[str, str]:
        return {"url": self.url}  # connections stay in their process

    @cached_property
    def _located(self) -> tuple[Any, str]:
        """The file system, and the path there."""
        found: tuple[Any, str] = import_module("fsspec.core").url_to_fs(self.url)
        return found

    @property
    def name(self) -> str:
        """Last component of the path."""
        return self.url.rstrip("/").rpartition("/")[2]

    @property
    def suffix(self) -> str:
        """Suffix of the name, with its dot."""
        return Path(self.name).suffix

    def exists(self) -> bool:
        """Whether there is a file or a folder; object stores have no empty folders."""
        fs, path = self._located
        return bool(fs.exists(path))

    def is_file(self) -> bool:
        """Whether there is a file."""
        fs, path = self._located
        return bool(fs.isfile(path))

    def is_dir(self) -> bool:
        """Whether there is a folder."""
        fs, path = self._located
        return bool(fs.isdir(path))

    def iterdir(self) -> Iterator["RemotePath"]:
        """Content of a folder."""
        fs, path = self._located
        return (self / found.rstrip("/").rpartition("/")[2] for found in fs.ls(path, detail=False))

    def mkdir(self, *, parents: bool = False, exist_ok: bool = False) -> None:
        """Make a folder, where the file system has such, and those above it."""
        fs, path = self._located
        fs.makedirs(path, exist_ok=parents or exist_ok)

    def size(self) -> int:
        """Bytes of a file."""
        fs, path = self._located
        return int(fs.size(path))

    def open(self, mode: str = "rb") -> Any:
        """Open a file as a stream."""
        fs, path = self._located
        return fs.open(path, mode)

    def read_bytes(self) -> bytes:
        """Content of a file."""
        fs, path = self._located
        return bytes(fs.cat_file(path))

    def read_ranges(self, ranges: Sequence[tuple[int, int]]) -> list[bytes]:
        """Bytes start .. stop-1 of each range, requested together where the file system can."""
        fs, path = self._located
        starts, stops = ([int(pair[k]) for pair in ranges] for k in range(2))
        return list(fs.cat_ranges([path] * len(ranges), starts, stops, on_error="raise"))

    def read_text(self, encoding: str = "utf-8") -> str:
        """Text of a file."""
        return self.read_bytes().decode(encoding)

    def write_text(self, text: str, encoding: str = "utf-8") -> None:
        """Write a file as a whole."""
        fs, path = self._located
        fs.pipe_file(path, text.encode(encoding))

    def touch(self) -> None:
        """Create an empty file."""
        self.write_text("")

    def unlink(self, *, missing_ok: bool = False) -> None:
        """Remove a file."""
        fs, path = self._located
        if not missing_ok or fs.exists(path):
            fs.rm_file(path)

    def send(self, local: Path) -> None:
        """Replace the file by a local one."""
        fs, path = self._located
        fs.put_file(os.fspath(local), path)

    def fetch(self, local: Path) -> None:
        """Copy the file to a local one."""
        fs, path = self._located
        fs.get_file(path, os.fspath(local))

    def remove_folder(self) -> None:
        """Remove a folder with its content."""
        fs, path = self._located
        fs.rm(path, recursive=True)


Location: TypeAlias = Path | RemotePath


def locate(path: str | os.PathLike[str], name: str = "path") -> Location:
    """The local or remote path of a text; InvalidParameterError without the package for its kind of URL."""
    if "://" not in str(path):
        return Path(path)
    try:
        found = RemotePath(str(path))
        found._located  # noqa: B018
    except ImportError as error:
        hint = f"{S3_COMMAND}, or " if str(path).startswith("s3") else ""
        raise InvalidParameterError(f"{name}: {path} needs another package: {hint}{error}") from error
    except ValueError as error:
        raise InvalidParameterError(f"{name}: cannot use {path}: {error}") from error
    return found


@contextmanager
def write_file(path: Location) -> Iterator[Path]:
    """Yield a local path whose file replaces `path` when the block succeeds, see `atomic_write`."""
    if isinstance(path, Path):
        with atomic_write(path) as temporary:
            yield temporary
    else:
        with temporary_folder() as folder:
            yield folder / path.name
            path.send(folder / path.name)


@contextmanager
def write_folder(folder: Location) -> Iterator[Path]:
    """Yield a local folder: the folder itself, or one whose files are sent there when the block succeeds."""
    if isinstance(folder, Path):
        yield folder
    else:
        with temporary_folder() as local:
            yield local
            for path in sorted(local.iterdir()):
                (folder / path.name).send(path)


@contextmanager
def local_files(paths: Sequence[Location]) -> Iterator[list[Path]]:
    """Yield local paths of files: of copies, if they are remote, which are removed after the block."""
    if all(isinstance(path, Path) for path in paths):
        yield [path for path in paths if isinstance(path, Path)]
    else:
        with temporary_folder() as folder, ThreadPoolExecutor(thread_count()) as pool:
            copies = [folder / path.name for path in paths]
            list(pool.map(lambda pair: pair[0].fetch(pair[1]), zip(paths, copies, strict=True)))
            yield copies


def remove_folder(folder: Location) -> None:
    """Remove a folder with its content."""
    if isinstance(folder, Path):
        shutil.rmtree(folder)
    else:
        folder.remove_folder()


def disk_of(path: Location) -> Path:
    """Local folder whose disk must have room for a file or a folder before it is written or sent."""
    return path.resolve() if isinstance(path, Path) else Path(tempfile.gettempdir()).resolve()
