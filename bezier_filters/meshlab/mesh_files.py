"""Mesh files: load one into a MeshSet, save the current mesh atomically, with one-line errors."""

import locale
import os
import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from bezier_filters.arguments import checks_arguments
from bezier_filters.arrays import BoolArray, FloatArray
from bezier_filters.errors import FieldFileError, MeshFileNote, MeshFileWarning
from bezier_filters.fields import PREFIX
from bezier_filters.files.field_files import read_fields
from bezier_filters.files.host_formats import WRITERS
from bezier_filters.files.lost_rows import find_lost_rows
from bezier_filters.files.mesh_checks import check_mesh_file
from bezier_filters.files.mesh_data import shrink_ply
from bezier_filters.files.ply_text import SUFFIXES as POLYLINE_SUFFIXES
from bezier_filters.meshlab.mesh_attributes import SCALAR, list_attributes
from bezier_filters.meshlab.meshset import (
    BezierFilterError,
    MeshSet,
    PyMeshLabException,
    current_mesh,
    one_at_a_time,
    preserve_filter_script,
    reason_of,
)
from bezier_filters.meshlab.readable_files import open_as_ply, openable, utf8_folder
from bezier_filters.meshlab.save_formats import (
    FIELD_SUFFIX,
    edge_remarks,
    format_of,
    is_polyline,
    rounding_remarks,
    save_polyline,
    write_data,
)
from bezier_filters.runtime.atomic import atomic_write, temporary_folder
from bezier_filters.runtime.file_names import printable_path
from bezier_filters.runtime.supervision import limit_memory, limit_time, note_activity

# processor time after which a reader counts as hanging: seconds for any file, and bytes per additional second
MIN_READER_SECONDS, MIN_READER_RATE = 60.0, 50_000.0
_ATTRIBUTE_NAME = re.compile(f"{PREFIX}[a-z0-9_]+")  # attribute names that all filters of pymeshlab accept
_NORMAL_LENGTH_TOLERANCE = 1e-3  # deviation from unit length of normals that were rounded in files


@checks_arguments
def load_mesh(path: str | os.PathLike[str], *, attributes: bool = True, skip: bool = False) -> MeshSet:
    """Load a mesh or point cloud with its ``bz_*`` columns, which pymeshlab does not read.

    Parameters
    ----------
    path : path
        File of any format that pymeshlab reads; or VTP or VTU (surfaces and points), NPZ (arrays ``vertices`` and
        ``faces``), CSV (points with a header) or LAS.
    attributes : bool
        Whether the columns ``bz_*`` of files, as `save_mesh` writes them, become custom attributes again.
    skip : bool
        Whether to omit vertices with coordinates that are not finite, and their faces. Later vertices move up, and so
        do the columns of PLY files. Otherwise such a file is refused.

    Returns
    -------
    pymeshlab.MeshSet
        With one mesh of at least one vertex; several meshes of a file are merged. Values of columns that are not finite
        become 0.

    Raises
    ------
    BezierFilterError
        If the file cannot be read, or not all of its vertices; the message has one line.

    Warns
    -----
    MeshFileWarning
        If triangles of the file are missing.
    MeshFileNote
        If vertices were skipped, or faces with fewer than three different corners.

    Examples
    --------
    >>> from bezier_filters import compute_torsion_by_bezier_patch_per_vertex
    >>> ms = MeshSet()
    >>> ms.create_sphere(subdiv=3)
    >>> report = compute_torsion_by_bezier_patch_per_vertex(ms)
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     lost = save_mesh(ms, f"{folder}/ball.ply")
    ...     ms = load_mesh(f"{folder}/ball.ply")
    >>> bool(ms.current_mesh().vertex_custom_scalar_attribute_array("bz_geodesic_torsion").any())
    True
    """
    meshset, columns = load_columns(Path(path), skip=skip)
    mesh = meshset.current_mesh()
    for name, values in columns.items() if attributes else ():
        if _ATTRIBUTE_NAME.fullmatch(name):
            mesh.add_vertex_custom_scalar_attribute(np.where(np.isfinite(values), values, 0.0), name)
    return meshset


def load_columns(path: Path, *, skip: bool) -> tuple[MeshSet, dict[str, FloatArray]]:
    """Load a mesh without its columns, and the columns and the quality of its vertices."""
    _check_regular(path)
    with open_as_ply(path) as file:
        meshset, kept = _load_rows(file, skip=skip)
        return meshset, _columns_of(file, kept, meshset.current_mesh().vertex_number())


def _reason_in_words(error: Exception) -> str:
    """Why pymeshlab cannot read a file."""
    reason = reason_of(error)
    if not reason.startswith("Unknown format"):
        return reason
    return (
        "its name ends in no format of meshes or points that is read, such as .ply, .obj, .stl, .off, .glb, .vtp, "
        ".xyz, .pcd or .las; CAD files, volumes and masks need a surface of triangles first"
    )


def _load_rows(path: Path, *, skip: bool) -> tuple[MeshSet, BoolArray | None]:
    """Load a mesh without its columns; also returns a mask of the vertices of the file that it has, None for all."""
    meshset = MeshSet()
    try:
        promised = check_mesh_file(path)
        size = path.stat().st_size
        patience = limit_time(MIN_READER_SECONDS + size / MIN_READER_RATE)
        with (
            openable(path) as opened,
            note_activity(f"reading {printable_path(path)}"),
            limit_memory(size),
            patience,
            _restore_process_state(),
        ):
            # Otherwise pymeshlab triangulates the points as a grid that it guesses.
            options = {"triangulate": False} if path.suffix.lower() == ".asc" else {}
            meshset.load_new_mesh(str(opened), **options)
            _merge_layers(meshset, path.name)
        mesh = meshset.current_mesh() if len(list(meshset)) else None
        if mesh is None or mesh.vertex_number() == 0:
            raise BezierFilterError(f"cannot read {printable_path(path)}: it has no vertices")
        lost = find_lost_rows(path, promised, mesh.vertex_number(), mesh.face_number(), skip=skip)
    except FieldFileError as error:
        raise BezierFilterError(
            f"cannot read {printable_path(path)}: it {str(error).removeprefix(f'{path} ')}"
        ) from error
    except OSError as error:
        raise BezierFilterError(f"cannot read {printable_path(path)}: {error.strerror}") from error
    except MemoryError as error:
        raise BezierFilterError(
            f"cannot read {printable_path(path)}: it asks for more memory than such a file can need"
        ) from error
    except ValueError as error:  # how pymeshlab reports a count beyond the largest one
        raise BezierFilterError(
            f"cannot read {printable_path(path)}: it announces more than any file can hold"
        ) from error
    except BezierFilterError:
        raise
    except (PyMeshLabException, RuntimeError, IndexError) as error:
        raise BezierFilterError(f"cannot read {printable_path(path)}: {_reason_in_words(error)}") from error
    if not np.isfinite(mesh.vertex_matrix()).all():
        raise BezierFilterError(f"cannot read {printable_path(path)}: it has vertices without finite coordinates")
    faces = mesh.face_matrix()
    if len(faces) and not 0 <= faces.min() <= faces.max() < mesh.vertex_number():
        raise BezierFilterError(f"cannot read {printable_path(path)}: it has faces on vertices that are not in it")
    for category, remarks in ((MeshFileWarning, lost.warnings), (MeshFileNote, lost.notes)):
        for remark in remarks:
            warnings.warn(f"{printable_path(path)}: {remark.removeprefix(f'{path} ')}", category, stacklevel=3)
    return meshset, lost.kept


def _columns_of(path: Path, kept: BoolArray | None, vertex_count: int) -> dict[str, FloatArray]:
    """Columns and quality of a PLY file, restricted to a mask; none if the number of vertices differs."""
    if path.suffix.lower() != FIELD_SUFFIX:
        return {}
    try:
        columns = read_fields(path)
    except FieldFileError:  # there are none
        return {}
    rows = {name: values if kept is None else values[kept] for name, values in columns.items()}
    return {name: values for name, values in rows.items() if len(values) == vertex_count}


def _check_regular(path: Path) -> None:
    if not path.is_file():
        kind = "it is a directory" if path.is_dir() else "it is not a regular file" if path.exists() else "no such file"
        raise BezierFilterError(f"cannot read {printable_path(path)}: {kind}")
    if path.stat().st_size == 0:
        raise BezierFilterError(f"cannot read {printable_path(path)}: the file is empty")


def _merge_layers(ms: MeshSet, label: str) -> None:
    """Merge all meshes of a file, with their transform matrices applied."""
    if len(list(ms)) > 1:
        ms.generate_by_merging_visible_meshes(mergevertices=False, alsounreferenced=True)
        ms.current_mesh().set_label(label)
        ms.clear_filter_script()


def contents_of(ms: MeshSet) -> list[str]:
    """Data of the current mesh besides its shape, in words.

    pymeshlab computes normals where a file has none, as sums, and a quality of zeros.
    """
    mesh = current_mesh(ms)
    lengths = np.linalg.norm(mesh.vertex_normal_matrix(), axis=1)
    columns = [name for kind, name in list_attributes(ms) if kind == SCALAR]
    there = {
        "colours of vertices": mesh.has_vertex_color(),
        "colours of faces": mesh.has_face_color(),
        "quality": mesh.has_vertex_scalar() and mesh.vertex_scalar_array().any(),
        "normals": np.abs(lengths - 1.0).max() < _NORMAL_LENGTH_TOLERANCE,
        f"textures {', '.join(mesh.textures())}": mesh.texture_number() > 0,
        ", ".join(columns): bool(columns),
    }
    return [name for name, is_there in there.items() if is_there]


@checks_arguments
def save_mesh(
    ms: MeshSet,
    path: str | os.PathLike[str],
    *,
    binary: bool = True,
    attributes: bool = True,
    compact: bool = False,
) -> tuple[str, ...]:
    """Save the current mesh with everything that the format can hold.

    The file is written atomically. Companion files, such as the MTL of an OBJ, are replaced; images of
    textures are written only where no file of that name exists, because rewriting the input would lose
    quality. The transform matrix of the layer is lost, as always in pymeshlab outside of projects. Layers of edges
    alone, such as lines on a surface, keep them in PLY files, which are text then, in VTP and in OBJ files.

    Parameters
    ----------
    ms : pymeshlab.MeshSet
        Only its vertex normals change, to unit length: where a file has none, pymeshlab computes normals of lengths up
        to 6.28 on reading.
    path : path
        File to write or replace; its suffix determines the format: one that pymeshlab writes; ``.vtp`` or ``.vtu``, for
        ParaView, pyvista and meshio; ``.glb`` with colours and normals; ``.npz`` with arrays; or ``.csv`` with a row
        for each vertex. Vectors are arrays in VTP, VTU and NPZ files, such as ``bz_direction_max``, and codes integers.
    binary : bool
        Whether PLY and STL files are binary. pymeshlab rounds to 6 decimals in ASCII PLY files.
    attributes : bool
        Whether the ``bz_*`` columns are saved where the format has place for them.
    compact : bool
        Whether numbers of vertices in binary PLY files, and in formats that pymeshlab lacks, get the smallest type that
        holds them: codes a byte, estimates and normals single precision (6e-8 of each value, far below their standard
        errors); coordinates, and other numbers, double precision unless single holds them exactly. Commands do so.

    Returns
    -------
    tuple of str
        Remarks on losses: images in formats that pymeshlab does not write, as inside a glTF file, or significant digits
        of the coordinates, or faces, edges and textures in formats without them.

    Raises
    ------
    ImportError
        If pyvista, for VTP and VTU files, or trimesh, for GLB files, is missing.
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
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     remarks = save_mesh(ms, f"{folder}/ball.ply")
    ...     remarks, "bz_geodesic_torsion" in read_fields(f"{folder}/ball.ply")
    ((), True)
    """
    suffix, mesh = format_of(path), current_mesh(ms)
    options: dict[str, Any] = {"binary": binary} if suffix in (".ply", ".stl") else {}
    if suffix == ".off" and mesh.has_vertex_color():
        options["save_vertex_normal"] = False  # with both, readers mistake the colours for normals
    if suffix == FIELD_SUFFIX:
        options["save_vertex_normal"] = True
        if attributes:  # pymeshlab's keys are in lower case, as the names of our columns are
            keys = ms.filter_parameter_values("ply")
            options |= {key: True for key in keys if key.startswith(SCALAR + PREFIX)}
    target = Path(os.path.realpath(path))
    _normalize(ms)
    try:
        if is_polyline(mesh) and suffix in POLYLINE_SUFFIXES:
            return save_polyline(ms, target, attributes=attributes)
        unsaved = edge_remarks(mesh, suffix)
        if suffix in WRITERS:
            with atomic_write(target) as temporary:
                lost = write_data(ms, temporary, attributes=attributes, compact=compact)
            return unsaved + lost + rounding_remarks(mesh, suffix)
        with (
            atomic_write(target) as temporary,
            temporary_folder(target.parent) as folder,
            utf8_folder(folder) as linked,
        ):
            # The name inside the folder is the final one: an OBJ file names its MTL file after itself, on one line.
            staged = linked / "".join(c if c.isprintable() else "_" for c in target.name)
            with note_activity(f"writing {printable_path(path)}"), _restore_process_state():
                remarks = _save(ms, staged, options)
            if not staged.is_file():
                raise BezierFilterError(f"cannot write {printable_path(path)}: pymeshlab wrote no file")
            if compact and binary and suffix == FIELD_SUFFIX:
                shrink_ply(staged)
            os.replace(staged, temporary)
            for companion in folder.iterdir():
                goal = target.parent / companion.name
                if companion.name.startswith(staged.name) or not goal.exists():
                    os.replace(companion, goal)
        return unsaved + remarks + rounding_remarks(mesh, suffix)
    except BezierFilterError:
        raise
    except OSError as error:
        hint = "see whether its folder can be written to and the disk is full"
        reason = f"cannot write {printable_path(path)}: {error.strerror}; {hint}"
        raise BezierFilterError(reason if error.strerror else str(error)) from error
    except (ValueError, IndexError) as error:  # from within the writer, such as COLLADA's without a texture
        raise BezierFilterError(
            f"cannot write {printable_path(path)}: pymeshlab cannot write this mesh as {suffix} ({error}); "
            "write a PLY file"
        ) from error
    except (PyMeshLabException, RuntimeError) as error:
        raise BezierFilterError(
            f"cannot write {printable_path(path)}: {reason_of(error)}; see whether the disk is full"
        ) from error


def _normalize(ms: MeshSet) -> None:
    """Normalise the vertex normals, except zeros."""
    lengths = np.linalg.norm(current_mesh(ms).vertex_normal_matrix(), axis=1)
    if (np.abs(lengths[lengths > 0.0] - 1.0) > _NORMAL_LENGTH_TOLERANCE).any():
        with preserve_filter_script(ms):
            ms.apply_normal_normalization_per_vertex()


def _save(ms: MeshSet, path: Path, options: dict[str, Any]) -> tuple[str, ...]:
    """Save the current mesh; return remarks on losses."""
    try:
        ms.save_current_mesh(str(path), **options)
        return ()
    except PyMeshLabException as error:
        if "plugin to save" not in str(error):  # an image
            raise
    ms.save_current_mesh(str(path), save_textures=False, **options)
    names = ", ".join(current_mesh(ms).textures())
    return (
        f"written without the images of its textures ({names}): pymeshlab saves none without a suffix such as .png",
    )


@contextmanager
def _restore_process_state() -> Iterator[None]:
    """Restore the working directory and the locale after the block.

    pymeshlab changes to the directory of the file and stays there when it fails. Some of its readers and writers leave
    the locale "C" set, in which Python decodes the output of other processes as ASCII.
    """
    with one_at_a_time():  # there is one of each for all threads
        directory, names = os.getcwd(), locale.setlocale(locale.LC_ALL)
        try:
            yield
        finally:
            os.chdir(directory)
            locale.setlocale(locale.LC_ALL, names)
