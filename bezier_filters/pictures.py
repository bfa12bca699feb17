"""Panels of the fields that a mesh file carries."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from bezier_filters.color_range import color_range
from bezier_filters.errors import FieldFileError, InvalidParameterError
from bezier_filters.field_files import read_fields
from bezier_filters.fields import CURVATURE_FIELDS, PREFIX, TORSION_FIELD
from bezier_filters.meshset import MeshSet, current_mesh
from bezier_filters.render import Panel

_KNOWN = {field.mesh_attribute: field for field in (*CURVATURE_FIELDS.values(), TORSION_FIELD)}


def field_panels(ms: MeshSet, path: Path, names: Sequence[str], colormap: str, percentile: float) -> list[Panel]:
    """One panel per name: ``quality``, ``color`` or a ``bz_*`` column of the file.

    Raises
    ------
    InvalidParameterError
        If the mesh has no such field; the message lists those that it has.
    """
    mesh = current_mesh(ms)
    vertices = np.array(mesh.vertex_matrix(), dtype=np.float64)
    faces = np.array(mesh.face_matrix(), dtype=np.int32)
    columns = _columns(path)
    if mesh.has_vertex_scalar():
        columns["quality"] = np.array(mesh.vertex_scalar_array(), dtype=np.float64)
    panels = []
    for name in names:
        if name == "color" and mesh.has_vertex_color():
            panels.append(Panel(vertices, faces, colors=np.array(mesh.vertex_color_matrix()), title=path.name))
            continue
        if name not in columns or len(columns[name]) != len(vertices):
            have = [*columns, *(["color"] if mesh.has_vertex_color() else [])]
            raise InvalidParameterError(
                f"field: {path} has no {name!r}; it has {', '.join(have) or 'no fields: compute a curvature first'}"
            )
        values = columns[name]
        known = _KNOWN.get(name)
        signed = known.signed if known else bool(values.min() < 0 < values.max())
        panels.append(
            Panel(
                vertices,
                faces,
                values=values,
                label=known.label if known else name.removeprefix(PREFIX).replace("_", " "),
                unit=known.unit if known else "",
                signed=signed,
                limits=color_range(values, signed=signed, percentile=percentile),
                colormap=colormap,
                title=path.name,
            )
        )
    return panels


def _columns(path: Path) -> dict[str, np.ndarray[tuple[int, ...], np.dtype[np.float64]]]:
    try:
        return read_fields(path)
    except FieldFileError:
        return {}
