"""Bit-exact transfer of custom attributes, quality, normals and coordinates from Python to a mesh in a MeshSet.

pymeshlab can add a custom attribute from an array, but neither overwrite nor remove one, and its
expression filters copy one attribute to another place. So new columns are simply added, and to
overwrite a column its values are copied from a temporary attribute: the filter
``compute_selection_point_cloud_outliers`` keeps its intermediate results in the vertex attributes
``sigma`` and ``plof`` and deletes both at its end. With ``propthreshold=1`` it selects nothing, with
``knearest=1`` it takes the least time, and it touches nothing else but an attribute ``outlierScore``,
which stays, filled with 0. docs/decisions/2026-11-21-custom-attributes.md has the costs and the alternatives.

New coordinates come from a point cloud, a temporary layer, to which the mesh is morphed: ``source +
(target - source)``, twice, since the first time rounds. Expressions would leave attributes behind and take
five times as long. pymeshlab sets the normals from the new coordinates at each morph, to sums that are
longer than one; they are computed once more.
"""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np

from bezier_filters.arrays import FloatArray
from bezier_filters.meshlab.meshset import BezierFilterError, Mesh, MeshSet, PyMeshLabException, current_mesh
from bezier_filters.runtime.parallel import single_threaded_openmp

CARRIERS = ("sigma", "plof")  # attributes that the outlier filter deletes
LEFTOVER = "outlierScore"  # attribute that the outlier filter leaves behind
KEPT_LEFTOVER = "outlierScore_kept"  # backup of a user's attribute of that name while the filter overwrites it

# names of custom attributes in pymeshlab's methods, by prefixes of the parameters that save them
ATTRIBUTES = {
    (SCALAR := "__ca_vs__"): ("vertex_custom_scalar_attribute", "array"),
    (_POINT := "__ca_vp__"): ("vertex_custom_point_attribute", "matrix"),
    "__ca_fs__": ("face_custom_scalar_attribute", "array"),
    "__ca_fp__": ("face_custom_point_attribute", "matrix"),
}
_LEGAL_NAME = re.compile(r"(?!_(pi|e)$)[A-Za-z_][A-Za-z0-9_]*")
_VARIABLES = ("q", "nx", "ny", "nz")  # of the expressions below: an attribute of that name hides them
_DROP_ATTRIBUTES = "generate_copy_of_current_mesh makes a copy of the mesh without custom attributes"


def custom_attribute(mesh: Mesh, name: str, kind: str = SCALAR) -> FloatArray | None:
    """Values of a custom attribute, (n,) of scalar ones and (n, 3) of points, or None if there is none."""
    try:
        return np.array(getattr(mesh, "_".join(ATTRIBUTES[kind]))(name), dtype=np.float64)
    except PyMeshLabException:
        return None


def list_attributes(ms: MeshSet) -> list[tuple[str, str]]:
    """Kind and name of every custom attribute as pymeshlab lists them: in lower case, with identifier characters."""
    keys = ms.filter_parameter_values("ply")
    return [(key[: len(SCALAR)], key[len(SCALAR) :]) for key in keys if key[: len(SCALAR)] in ATTRIBUTES]


class Attribute(NamedTuple):
    """A custom attribute of a mesh."""

    kind: str  # a key of `ATTRIBUTES`
    name: str
    values: FloatArray  # (n,) of scalars, (n, 3) of points


def read_attributes(ms: MeshSet) -> tuple[list[Attribute], list[str]]:
    """Custom attributes of the current mesh, and the listed names of the unreadable ones."""
    mesh, found, lost = current_mesh(ms), list[Attribute](), list[str]()
    known = {name.lower(): name for name in (LEFTOVER, KEPT_LEFTOVER)}  # whose true names are not those listed
    for kind, listed in list_attributes(ms):
        for name in dict.fromkeys((listed, known.get(listed, listed))):
            values = custom_attribute(mesh, name, kind)
            if values is not None:
                found.append(Attribute(kind, name, values))
                break
        else:
            lost.append(listed)
    return found, lost


def add_attribute(mesh: Mesh, attribute: Attribute) -> None:
    """Add a custom attribute to a mesh that has none of its name."""
    getattr(mesh, f"add_{ATTRIBUTES[attribute.kind][0]}")(attribute.values, attribute.name)


def read_columns(ms: MeshSet, names: Iterable[str]) -> dict[str, FloatArray]:
    """Values of the named scalar attributes that exist on the current mesh."""
    mesh = current_mesh(ms)
    columns = {name: custom_attribute(mesh, name) for name in names}
    return {name: values for name, values in columns.items() if values is not None}


def check_writable(ms: MeshSet, names: Iterable[str]) -> None:
    """Refuse a mesh on which writing the named columns would fail or crash.

    That is so where a point attribute has one of the names, or some attribute's name breaks pymeshlab's expressions.
    """
    mesh = current_mesh(ms)
    for name in (*names, *CARRIERS, LEFTOVER, KEPT_LEFTOVER):
        if custom_attribute(mesh, name, _POINT) is not None:
            raise BezierFilterError(
                f"the mesh has a point attribute {name!r} where a scalar one is needed; {_DROP_ATTRIBUTES}"
            )
    hidden = [name for name in _VARIABLES if _has_attribute(mesh, name)]
    try:
        # Attributes are declared before the expression is parsed, and nothing is changed if that fails.
        ms.compute_selection_by_condition_per_vertex(condselect="(")
    except PyMeshLabException:
        if not hidden:
            return
        culprits = hidden
    except RuntimeError:  # how pymeshlab reports names that are no identifiers
        culprits = [
            name
            for kind, name in list_attributes(ms)
            if kind in (SCALAR, _POINT)
            and not (_LEGAL_NAME.fullmatch(name) and _has_attribute(mesh, name))  # fit for expressions, and a true name
        ] or ["(not listed)"]
    finally:
        # A filter that failed leaves a reference to its MeshSet behind, and loading a mesh after the end of that
        # MeshSet crashes (SIGSEGV or bad_alloc, every time). Any filter that succeeds avoids that; this one has no
        # effect.
        ms.set_selection_none(allfaces=False, allverts=False)
    raise BezierFilterError(
        f"the mesh has a vertex attribute that stops pymeshlab's expression filters: {', '.join(culprits)} "
        f"(as pymeshlab lists it: in lower case, other characters replaced); {_DROP_ATTRIBUTES}"
    )


def _has_attribute(mesh: Mesh, name: str) -> bool:
    return any(custom_attribute(mesh, name, kind) is not None for kind in (SCALAR, _POINT))


def check_finite(columns: Mapping[str, FloatArray]) -> None:
    """Refuse values that are not finite: pymeshlab's colour filters abort the process on NaN."""
    for name, values in columns.items():
        count = int(np.count_nonzero(~np.isfinite(values)))
        if count:
            raise BezierFilterError(f"{name}: {count} values are not finite; nothing was written")


def write_columns(ms: MeshSet, columns: Mapping[str, FloatArray]) -> None:
    """Write columns of shape (n,) as custom scalar attributes of the current mesh, new or old.

    Call `check_writable` first. Nothing else of the mesh changes, except that overwriting leaves
    the attribute `LEFTOVER`. Columns with identical bits are not written.
    """
    check_finite(columns)
    mesh = current_mesh(ms)
    for name, values in columns.items():
        if values.shape != (mesh.vertex_number(),):
            raise BezierFilterError(f"{name}: got shape {values.shape}, expected ({mesh.vertex_number()},)")
    there = {name: values for name, values in columns.items() if custom_attribute(mesh, name) is not None}
    for name in columns.keys() - there.keys():
        mesh.add_vertex_custom_scalar_attribute(np.ascontiguousarray(columns[name]), name)
    _overwrite_columns(ms, there)


def _overwrite_columns(ms: MeshSet, columns: Mapping[str, FloatArray]) -> None:
    """Write columns that exist, except those with identical bits."""
    mesh = current_mesh(ms)
    names = []
    for name, values in columns.items():
        held = np.ascontiguousarray(mesh.vertex_custom_scalar_attribute_array(name))
        if not np.array_equal(np.ascontiguousarray(values).view(np.int64), held.view(np.int64)):
            names.append(name)
    for k in range(0, len(names), len(CARRIERS)):
        batch = names[k : k + len(CARRIERS)]
        with _carry_values(ms, *(columns[name] for name in batch)) as carriers:
            for name, carrier in zip(batch, carriers, strict=True):
                ms.compute_new_custom_scalar_attribute_per_vertex(name=name, expr=carrier)


@contextmanager
def restore_on_failure(ms: MeshSet, names: Iterable[str]) -> Iterator[None]:
    """Restore coordinates, quality, vertex normals and the named columns if the block fails or is interrupted.

    New columns and a new quality cannot be removed: such columns stay, such a quality becomes 0. Face
    normals, which cannot be set in pymeshlab, follow the coordinates.
    """
    mesh = current_mesh(ms)
    columns = read_columns(ms, names)
    vertices = np.array(mesh.vertex_matrix(), dtype=np.float64, order="C")
    normals = np.array(mesh.vertex_normal_matrix(), dtype=np.float64)
    quality = np.array(mesh.vertex_scalar_array()) if mesh.has_vertex_scalar() else np.zeros(len(normals))
    try:
        yield
    except BaseException:
        if not np.array_equal(current_mesh(ms).vertex_matrix(), vertices, equal_nan=True):
            write_coordinates(ms, vertices)  # changes normals, which are restored next
        _overwrite_columns(ms, columns)
        mesh = current_mesh(ms)
        if not np.array_equal(mesh.vertex_normal_matrix(), normals, equal_nan=True):
            with _carry_values(ms, normals[:, 0], normals[:, 1]) as (x, y):
                ms.compute_normal_by_function_per_vertex(x=x, y=y, z="nz")
            with _carry_values(ms, normals[:, 2]) as (z,):
                ms.compute_normal_by_function_per_vertex(x="nx", y="ny", z=z)
        if mesh.has_vertex_scalar() and not np.array_equal(mesh.vertex_scalar_array(), quality, equal_nan=True):
            with _carry_values(ms, quality) as (carrier,):
                ms.compute_scalar_by_function_per_vertex(q=carrier)
        raise


@contextmanager
def _carry_values(ms: MeshSet, *values: FloatArray) -> Iterator[Sequence[str]]:
    """Add one or two arrays as temporary scalar attributes; yields their names.

    User attributes with these names, or that of the leftover, are saved and restored.
    """
    mesh = current_mesh(ms)
    carriers, aside = CARRIERS[: len(values)], read_columns(ms, CARRIERS)
    leftover = custom_attribute(mesh, LEFTOVER)
    keep = leftover is not None and leftover.any()  # ours is all 0
    if keep:
        ms.compute_new_custom_scalar_attribute_per_vertex(name=KEPT_LEFTOVER, expr=LEFTOVER)
    try:
        if aside:
            _drop_carriers(ms)
        for name, array in zip(carriers, values, strict=True):
            mesh.add_vertex_custom_scalar_attribute(np.ascontiguousarray(array), name)
        yield carriers
    finally:
        _drop_carriers(ms)
        for name, array in aside.items():
            mesh.add_vertex_custom_scalar_attribute(array, name)
        if keep:
            ms.compute_new_custom_scalar_attribute_per_vertex(name=LEFTOVER, expr=KEPT_LEFTOVER)


def _drop_carriers(ms: MeshSet) -> None:
    with single_threaded_openmp():
        ms.compute_selection_point_cloud_outliers(propthreshold=1.0, knearest=1)
    left = read_columns(ms, CARRIERS)
    if left:
        raise BezierFilterError(
            f"this version of pymeshlab does not remove the attributes {', '.join(left)}, so columns of an earlier "
            f"run cannot be overwritten; {_DROP_ATTRIBUTES}"
        )


def write_coordinates(ms: MeshSet, vertices: FloatArray) -> None:
    """Set the coordinates of the current mesh, (n, 3), and its normals to unit normals of the new faces.

    Everything else stays, except that the id of the next layer increases by one. A point cloud keeps its normals.
    """
    mesh = current_mesh(ms)
    if not mesh.face_number():  # which MeshLab does not morph
        with _carry_values(ms, vertices[:, 0], vertices[:, 1]) as (x, y):
            ms.compute_coord_by_function(x=x, y=y, z="z")
        with _carry_values(ms, vertices[:, 2]) as (z,):
            ms.compute_coord_by_function(x="x", y="y", z=z)
        return
    wanted = mesh.id()
    others = {layer.id() for layer in ms}
    ms.add_mesh(Mesh(vertices), "coordinates", set_as_current=False)
    carrier = next(layer.id() for layer in ms if layer.id() not in others)
    try:
        for _ in range(2):
            ms.compute_coord_linear_morphing(targetmesh=carrier, percentmorph=100)
    finally:
        ms.set_current_mesh(carrier)
        ms.delete_current_mesh()
        ms.set_current_mesh(wanted)
    if not np.array_equal(current_mesh(ms).vertex_matrix(), vertices):
        raise BezierFilterError("pymeshlab could not store the new coordinates exactly; their range is too large")
    ms.compute_normal_per_vertex()
