"""Mesh files: load one into a MeshSet, save the current mesh whole or not at all, with one-line errors."""

import locale
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from bezier_filters.errors import FieldFileError
from bezier_filters.fields import PREFIX
from bezier_filters.files.mesh_headers import check_header
from bezier_filters.meshlab.meshset import BezierFilterError, MeshSet, PyMeshLabException, current_mesh, one_at_a_time
from bezier_filters.runtime.atomic import TEMPORARY, atomic_write
from bezier_filters.runtime.supervision import doing, memory_limited, processor_time_limited

# seconds of processor time after which a reader is taken to run in circles, and bytes for each second more
LEAST_PATIENCE, SLOWEST_READER = 60.0, 50_000.0
_ATTRIBUTE_KEY = "__ca_vs__"  # of the parameters with which pymeshlab saves custom vertex attributes


@dataclass(frozen=True)
class FormatSupport:
    """What pymeshlab writes per vertex, besides positions, into files of a format."""

    normals: bool = False  # OFF files get them only if there are no colours
    color: bool = False
    quality: bool = False
    attributes: bool = False  # the ``bz_*`` columns: pymeshlab does not read them back, `read_fields` does


_FORMATS = {
    ".ply": FormatSupport(normals=True, color=True, quality=True, attributes=True),
    **dict.fromkeys((".obj", ".off", ".dae", ".x3d"), FormatSupport(normals=True, color=True)),
    ".wrl": FormatSupport(color=True),
    **dict.fromkeys((".stl", ".3ds", ".3mf", ".ctm", ".dxf"), FormatSupport()),
}
SAVE_SUFFIXES = tuple(_FORMATS)


def format_support(path: str | os.PathLike[str]) -> FormatSupport:
    """What a file of this name can hold; the suffix decides, in any case. Formats that cannot be saved are refused."""
    suffix = Path(path).suffix.lower()
    if suffix not in _FORMATS:
        raise BezierFilterError(
            f"cannot write {path}: unknown format {suffix or 'without a suffix'}; use one of {' '.join(SAVE_SUFFIXES)}"
        )
    return _FORMATS[suffix]


def load_mesh(path: str | os.PathLike[str]) -> MeshSet:
    """Load a file of any format that pymeshlab reads; its mesh has a vertex at least, and may be a point cloud.

    What is wrong with a file, a `BezierFilterError` says in one line.
    """
    path = Path(path)
    if not path.is_file():
        raise BezierFilterError(f"cannot read {path}: {'it is a directory' if path.is_dir() else 'no such file'}")
    if path.stat().st_size == 0:
        raise BezierFilterError(f"cannot read {path}: the file is empty")
    meshset = MeshSet()
    try:
        check_header(path)
        size = path.stat().st_size
        patience = processor_time_limited(LEAST_PATIENCE + size / SLOWEST_READER)
        with doing(f"reading {path}"), memory_limited(size), patience, _process_as_it_was():
            meshset.load_new_mesh(str(path))
    except FieldFileError as error:
        raise BezierFilterError(f"cannot read {path}: it {str(error).removeprefix(f'{path} ')}") from error
    except OSError as error:
        raise BezierFilterError(f"cannot read {path}: {error.strerror}") from error
    except MemoryError as error:
        raise BezierFilterError(f"cannot read {path}: it asks for more memory than such a file can need") from error
    except ValueError as error:  # how pymeshlab reports a count beyond the largest one
        raise BezierFilterError(f"cannot read {path}: it announces more than any file can hold") from error
    except (PyMeshLabException, RuntimeError, IndexError) as error:
        raise BezierFilterError(f"cannot read {path}: {_reason(error)}") from error
    mesh = meshset.current_mesh()
    if mesh.vertex_number() == 0:
        raise BezierFilterError(f"cannot read {path}: there are no vertices in it")
    faces = mesh.face_matrix()
    if len(faces) and not 0 <= faces.min() <= faces.max() < mesh.vertex_number():
        raise BezierFilterError(f"cannot read {path}: it has faces on vertices that are not in it")
    return meshset


def save_mesh(ms: MeshSet, path: str | os.PathLike[str], *, binary: bool = True, attributes: bool = True) -> None:
    """Save the current mesh with everything that the format can hold (see `format_support`).

    The file appears whole or not at all. Files that go with it, such as the MTL of an OBJ, are
    replaced; images of textures are written only where no file of that name exists, because
    writing one's own input again loses quality. The transform matrix of the layer is lost, as always
    in pymeshlab outside of projects.

    Parameters
    ----------
    ms : pymeshlab.MeshSet
        Nothing in it is changed.
    path : path
        File to write or replace; its suffix decides on the format.
    binary : bool
        Whether PLY and STL files are binary. pymeshlab rounds to 6 decimals in ASCII PLY files.
    attributes : bool
        Whether the ``bz_*`` columns are saved where the format has place for them.

    Raises
    ------
    BezierFilterError
        If there is no current mesh, the format is unknown or the file cannot be written; the
        message has one line.

    Examples
    --------
    >>> from pymeshlab import MeshSet
    >>> from bezier_filters import compute_torsion_by_bezier_patch_per_vertex, read_fields
    >>> ms = MeshSet()
    >>> ms.create_sphere(subdiv=3)
    >>> report = compute_torsion_by_bezier_patch_per_vertex(ms)
    >>> with TemporaryDirectory() as folder:
    ...     save_mesh(ms, f"{folder}/ball.ply")
    ...     "bz_geodesic_torsion" in read_fields(f"{folder}/ball.ply")
    True
    """
    support = format_support(path)
    current_mesh(ms)
    target = Path(os.path.realpath(path))
    try:
        with atomic_write(target) as temporary, TemporaryDirectory(prefix=TEMPORARY, dir=target.parent) as folder:
            # The name inside the folder is the final one: an OBJ file names its MTL file after itself.
            staged = Path(folder) / target.name
            with doing(f"writing {path}"), _process_as_it_was():
                ms.save_current_mesh(str(staged), **_save_options(ms, staged, support, binary, attributes))
            if not staged.is_file():
                raise BezierFilterError(f"cannot write {path}: pymeshlab wrote no file")
            _move_companions(staged, target.parent)
            os.replace(staged, temporary)
    except BezierFilterError:
        raise
    except OSError as error:
        reason = f"cannot write {path}: {error.strerror}; see whether its folder can be written to and the disk is full"
        raise BezierFilterError(reason if error.strerror else str(error)) from error
    except (ValueError, IndexError) as error:  # from within the writer, such as COLLADA's without a texture
        raise BezierFilterError(
            f"cannot write {path}: pymeshlab cannot write this mesh as {target.suffix} ({error}); write a PLY file"
        ) from error
    except (PyMeshLabException, RuntimeError) as error:
        raise BezierFilterError(f"cannot write {path}: {_reason(error)}; see whether the disk is full") from error


@contextmanager
def _process_as_it_was() -> Iterator[None]:
    """Undo what pymeshlab does to the process.

    It works in the directory of the file, and stays there when it fails; and some of its readers and writers leave
    the locale "C" behind, in which Python takes the text of other processes for ASCII.
    """
    with one_at_a_time():  # there is one of each for all threads
        directory, names = os.getcwd(), locale.setlocale(locale.LC_ALL)
        try:
            yield
        finally:
            os.chdir(directory)
            locale.setlocale(locale.LC_ALL, names)


def _save_options(ms: MeshSet, path: Path, support: FormatSupport, binary: bool, attributes: bool) -> dict[str, Any]:
    known = ms.filter_parameter_values(path.suffix[1:].lower())
    options: dict[str, Any] = {}
    if support.normals:
        # An OFF file with both has them in the wrong order: readers take the colours for normals.
        both_fail = path.suffix.lower() == ".off" and current_mesh(ms).has_vertex_color()
        options["save_vertex_normal"] = not both_fail
    if "binary" in known:
        options["binary"] = binary
    if support.attributes and attributes:
        # pymeshlab's keys are in lower case, as the names of our columns are.
        options |= {key: True for key in known if key.startswith(_ATTRIBUTE_KEY + PREFIX)}
    return options


def _move_companions(staged: Path, folder: Path) -> None:
    for companion in staged.parent.iterdir():
        ours = companion.name.startswith(staged.name)
        if companion != staged and (ours or not (folder / companion.name).exists()):
            os.replace(companion, folder / companion.name)


def _reason(error: Exception) -> str:
    """The part of pymeshlab's error message that says why: its last line."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return lines[-1].removeprefix("Error details: ") if lines else type(error).__name__
