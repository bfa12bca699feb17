"""Interface to pymeshlab: its types, the current mesh as arrays, and the filter script.

Only this module imports pymeshlab; the others import its names from here.
"""

import os
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import ParamSpec, TypeAlias, TypeVar

import numpy as np
import pymeshlab

from bezier_filters.arguments import checks_arguments
from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.errors import InvalidParameterError
from bezier_filters.fields import VIEWPOINT_COLUMNS
from bezier_filters.files.filter_scripts import ScriptStep, read_filter_script, script_text
from bezier_filters.meshes.half_edges import distinct_edges
from bezier_filters.runtime.atomic import temporary_folder
from bezier_filters.runtime.supervision import hold_interrupts

# pymeshlab has no type information, so these are Any to a type checker.
MeshSet: TypeAlias = pymeshlab.MeshSet
Mesh: TypeAlias = pymeshlab.Mesh
Image: TypeAlias = pymeshlab.Image
BoundingBox = pymeshlab.BoundingBox
PyMeshLabException = pymeshlab.PyMeshLabException
PercentageValue: TypeAlias = pymeshlab.PercentageValue
PureValue: TypeAlias = pymeshlab.PureValue
Color: TypeAlias = pymeshlab.Color
Length: TypeAlias = pymeshlab.PercentageValue | pymeshlab.PureValue | float

Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")

LIBRARY = pymeshlab
MAX_MEASURED_FACES = 20_000  # faces whose edges are measured
# the original functions, before `register` extends them
filter_list, _load_filter_script = pymeshlab.filter_list, pymeshlab.MeshSet.load_filter_script
_lock = threading.RLock()


class BezierFilterError(pymeshlab.PyMeshLabException):  # type: ignore[misc]
    """A filter refused its input; the message says what was got and what is allowed.

    It is a `pymeshlab.PyMeshLabException`, so scripts catch it like the errors of pymeshlab's own filters.
    """


def checks_filter_arguments(function: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
    """Check the arguments of a filter by its annotations; raises `BezierFilterError`."""
    checks = checks_arguments(function)

    @wraps(function)
    def wrapper(*args: Parameters.args, **options: Parameters.kwargs) -> Result:
        try:
            return checks(*args, **options)
        except InvalidParameterError as error:
            raise BezierFilterError(str(error)) from error

    return wrapper


def reason_of(error: Exception) -> str:
    """The reason in an error message of pymeshlab: its last line."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return lines[-1].removeprefix("Error details: ") if lines else type(error).__name__


@dataclass(frozen=True)
class CurrentMesh:
    """Copies of the arrays of the current mesh of a MeshSet."""

    id: int  # of the layer
    vertices: FloatArray  # (n, 3): as stored, without the transform matrix, as in pymeshlab's own filters
    faces: IntArray  # (m, 3): none in a point cloud
    vertex_normals: FloatArray  # (n, 3): as stored, of any length
    vertex_selection: BoolArray  # (n,)
    face_selection: BoolArray  # (m,)
    viewpoints: FloatArray | None = None  # (n, 3): places from which the points of a cloud were seen, if it has them

    def selection_mask(self) -> BoolArray:
        """Mask (n,) of the selected vertices, or of the vertices of the selected faces; refused if it is empty."""
        if self.vertex_selection.any():
            return self.vertex_selection
        if not self.face_selection.any():
            raise BezierFilterError(
                "onselected: cannot apply only on selection: there is no selection. "
                "Select vertices or faces first, or pass onselected=False."
            )
        mask = np.zeros(len(self.vertices), dtype=np.bool_)
        mask[self.faces[self.face_selection]] = True
        return mask

    def mean_edge(self) -> float | None:
        """Mean length of the edges of some 10,000 faces or more, or of all; None for a point cloud."""
        edges, _, _ = distinct_edges(self.faces[:: 1 + len(self.faces) // MAX_MEASURED_FACES], len(self.vertices))
        start, stop = edges[edges[:, 0] < edges[:, 1]].T
        lengths = np.linalg.norm(self.vertices[start] - self.vertices[stop], axis=1)
        return float(lengths.mean()) if len(lengths) else None


def current_mesh(ms: MeshSet) -> Mesh:
    """Return the current mesh of a MeshSet: a live reference, valid until layers change."""
    if not isinstance(ms, pymeshlab.MeshSet):
        raise BezierFilterError(f"ms: got {type(ms).__name__}, expected a pymeshlab.MeshSet")
    try:
        return ms.current_mesh()
    except PyMeshLabException as error:
        raise BezierFilterError("the MeshSet has no current mesh; load one with load_new_mesh first") from error


def read_current_mesh(ms: MeshSet) -> CurrentMesh:
    """Copy the arrays of the current mesh, which may be a point cloud."""
    mesh = current_mesh(ms)
    if not mesh.is_compact():
        mesh.compact()
    if mesh.vertex_number() == 0:
        raise BezierFilterError(f"the current mesh {mesh.label()!r} is empty; load or create one with vertices")
    return CurrentMesh(
        id=mesh.id(),
        vertices=np.array(mesh.vertex_matrix(), dtype=np.float64, order="C"),
        faces=np.array(mesh.face_matrix(), dtype=np.int32, order="C"),
        vertex_normals=np.array(mesh.vertex_normal_matrix(), dtype=np.float64, order="C"),
        vertex_selection=np.array(mesh.vertex_selection_array(), dtype=np.bool_),
        face_selection=np.array(mesh.face_selection_array(), dtype=np.bool_),
        viewpoints=_viewpoints(mesh),
    )


def _viewpoints(mesh: Mesh) -> FloatArray | None:
    """The attributes with the viewpoints of a point cloud, (n, 3)."""
    if mesh.face_number():
        return None
    try:
        columns = [mesh.vertex_custom_scalar_attribute_array(name) for name in VIEWPOINT_COLUMNS]
    except PyMeshLabException:  # there are none
        return None
    return np.ascontiguousarray(np.column_stack(columns), dtype=np.float64)


def check_unchanged(ms: MeshSet, mesh: CurrentMesh) -> None:
    """Refuse to write if the current mesh has changed since it was read, for example by callbacks or threads."""
    now = current_mesh(ms)
    same = (now.id(), now.vertex_number(), now.face_number()) == (mesh.id, len(mesh.vertices), len(mesh.faces))
    # NaN compares as equal: other checks refuse it.
    if not same or not np.array_equal(now.vertex_matrix(), mesh.vertices, equal_nan=True):
        raise BezierFilterError("the current mesh was changed while the filter ran; nothing was written")


def length_of(text: str) -> Length:
    """Parse a length, or a percentage of the diagonal of the bounding box."""
    try:
        if not text.endswith("%"):
            return float(text)
        percentage = float(text.removesuffix("%"))
    except ValueError:
        percentage = -1.0
    if not 0.0 < percentage <= 100.0:
        raise InvalidParameterError(
            f"got {text!r}, expected a length such as 0.5, or a percentage such as 2%, up to 100%"
        )
    return PercentageValue(percentage)


def absolute_length(length: Length | None, vertices: FloatArray, name: str) -> float | None:
    """Convert a length, or a percentage of the diagonal of the bounding box, to a length.

    >>> absolute_length(PercentageValue(10), np.array([[0.0, 0.0, 0.0], [2.0, 3.0, 6.0]]), "radius")
    0.7000000000000001
    >>> absolute_length("10%", np.array([[0.0, 0.0, 0.0], [2.0, 3.0, 6.0]]), "radius")
    0.7000000000000001
    """
    if isinstance(length, str):
        try:
            length = length_of(length)
        except InvalidParameterError as error:
            raise BezierFilterError(f"{name}: {error}") from None
    if isinstance(length, pymeshlab.PercentageValue):
        with np.errstate(over="ignore", invalid="ignore"):  # of coordinates that no filter accepts
            return float(length.value() / 100.0 * np.linalg.norm(np.ptp(vertices, axis=0)))
    return length.value() if isinstance(length, pymeshlab.PureValue) else length


def bunny_path() -> Path:
    """Path of the Stanford bunny in the pymeshlab package: 28,088 vertices, closed."""
    return Path(pymeshlab.__file__).parent / "tests" / "sample_meshes" / "bunny.obj"


def former_filter_names() -> dict[str, str]:
    """Names of pymeshlab's filters before 2022, derived from MeshLab's, and their current names."""
    table = Path(pymeshlab.__file__).parent / "keys.txt"
    pairs = (line.split() for line in table.read_text(encoding="utf-8").splitlines()) if table.is_file() else ()
    return {pair[0]: pair[1] for pair in pairs if len(pair) == 2}


@contextmanager
def one_at_a_time() -> Iterator[None]:
    """Exclude other threads of this package from pymeshlab inside the block.

    Its filters share global state between all MeshSets of a process: filters with expressions in two threads give
    wrong numbers or crash. A script that calls pymeshlab in several threads itself needs its own lock, or processes.
    """
    with _lock:
        yield


def _renew_lock() -> None:
    """Replace the lock in a forked process, where no thread is left to release it."""
    global _lock
    _lock = threading.RLock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_renew_lock)


@contextmanager
def preserve_filter_script(ms: MeshSet) -> Iterator[None]:
    """Run filters inside the block without recording them, and without interrupts or other threads.

    pymeshlab records every filter. Filters called by this package would fail on replay, because their numbers come
    from Python, so the script is restored after the block. Ctrl-C waits for the end of the block, so that a MeshSet
    never stays between two states.
    """
    with hold_interrupts(), one_at_a_time():
        steps = read_script_steps(ms)
        try:
            yield
        finally:
            write_script_steps(ms, steps)


def read_script_steps(ms: MeshSet) -> list[ScriptStep]:
    """Steps of the filter script of a MeshSet; pymeshlab rounds numbers of its own filters to six digits."""
    with one_at_a_time(), temporary_folder() as folder:
        script = str(folder / "script.mlx")
        ms.save_filter_script(script)
        return read_filter_script(script)


def write_script_steps(ms: MeshSet, steps: Sequence[ScriptStep]) -> None:
    """Replace the filter script of a MeshSet, without pymeshlab's output of a line per filter on stderr."""
    with one_at_a_time(), temporary_folder() as folder:
        script = folder / "script.mlx"
        script.write_text(script_text(steps), encoding="utf-8")
        with _silent_stderr():
            _load_filter_script(ms, str(script))


@contextmanager
def _silent_stderr() -> Iterator[None]:
    """Discard output of C++ code to stderr inside the block; for one thread at a time."""
    try:
        if sys.stderr is not None:
            sys.stderr.flush()
        kept = os.dup(2)
    except (OSError, ValueError):  # closed, as under pythonw: nothing to silence
        yield
        return
    sink = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(sink, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(sink)
