"""Blender: the filters in the menu Object > Bezier filters; they change the mesh, and Undo takes them back."""

from typing import Any

import bmesh
import bpy
import numpy as np

from bezier_filters.fields import SMOOTH
from bezier_filters.parameters import Parameter
from bezier_filters_adapters.filled_fields import NEW, Fill
from bezier_filters_adapters.filters import (
    ERRORS,
    HELP,
    LABELS,
    default_of,
    kind_of,
    parameters_of,
    run,
)

_NEW_FACES = f"{NEW}_face"
_PROPERTIES = {bool: bpy.props.BoolProperty, int: bpy.props.IntProperty, float: bpy.props.FloatProperty}


def _property(parameter: Parameter) -> Any:
    kind = kind_of(parameter)
    told = {"name": parameter.name, "description": parameter.help.rstrip("."), "default": default_of(parameter)}
    if isinstance(kind, tuple):
        return bpy.props.EnumProperty(items=[(word, word, "") for word in kind], **told)
    return _PROPERTIES.get(kind, bpy.props.StringProperty)(**{**told, "default": kind(told["default"])})


def _poll(cls: Any, context: Any) -> bool:
    return context.object is not None and context.object.type == "MESH" and context.object.mode == "OBJECT"


def _execute(self: Any, context: Any) -> set[str]:
    mesh = context.object.data
    mesh.calc_loop_triangles()
    vertices = np.empty((len(mesh.vertices), 3), np.float32)
    faces = np.empty((len(mesh.loop_triangles), 3), np.int32)
    mesh.vertices.foreach_get("co", vertices.ravel())
    mesh.loop_triangles.foreach_get("vertices", faces.ravel())
    given = {parameter.name: getattr(self, parameter.name) for parameter in parameters_of(self.filter_name)}
    try:
        result = run(self.filter_name, vertices, faces, given)
    except ERRORS as error:
        self.report({"ERROR"}, str(error))
        return {"CANCELLED"}
    if result.fill is not None:
        _add(mesh, result.fill)
    if self.filter_name == SMOOTH:
        mesh.vertices.foreach_set("co", result.vertices.astype(np.float32).ravel())
    for column, values in result.fields.items():
        attribute = mesh.attributes.get(column) or mesh.attributes.new(column, "FLOAT", "POINT")
        attribute.data.foreach_set("value", values.astype(np.float32))
    mesh.update()
    self.report({"INFO"}, result.summary)
    if not np.allclose(context.object.matrix_world.to_scale(), 1.0):
        self.report(
            {"WARNING"}, "Lengths are those of the mesh, without the scale of the object; apply it first (Ctrl+A)"
        )
    return {"FINISHED"}


def _add(mesh: Any, fill: Fill) -> None:
    """Add what is new, so that polygons and their data stay; new rows of data are like old ones next to them.

    Numbers of vertices are then continued smoothly. A name has one domain in Blender: `NEW` is a field of vertices,
    that of the faces has a name of its own.
    """
    names = [item.name for item in mesh.attributes if (item.domain, item.data_type) == ("POINT", "FLOAT")]
    fields = {name: np.empty(fill.old_vertices, np.float32) for name in names}
    for name, values in fields.items():
        mesh.attributes[name].data.foreach_get("value", values)
    polygons = np.empty(fill.old_faces, np.int32)
    mesh.loop_triangles.foreach_get("polygon_index", polygons)
    whole = bmesh.new()
    whole.from_mesh(mesh)
    vertices, faces = list(whole.verts), list(whole.faces)
    for place, like in zip(fill.vertices[fill.old_vertices :], fill.like_vertex().tolist(), strict=True):
        vertices.append(whole.verts.new(place, vertices[like]))
    for face, like in zip(fill.new_faces, polygons[fill.like_face()].tolist(), strict=True):
        whole.faces.new([vertices[k] for k in face], faces[like])
    whole.to_mesh(mesh)
    whole.free()
    for name, values in fields.items():
        grown = np.concatenate([values, fill.new_vertex_rows(name, values)])
        mesh.attributes[name].data.foreach_set("value", grown)
    is_new = np.arange(len(mesh.polygons)) >= len(faces)
    marks = mesh.attributes.get(_NEW_FACES) or mesh.attributes.new(_NEW_FACES, "FLOAT", "FACE")
    marks.data.foreach_set("value", is_new.astype(np.float32))


def _operator(name: str) -> Any:
    body = {
        "__doc__": HELP[name],
        "__annotations__": {parameter.name: _property(parameter) for parameter in parameters_of(name)},
        "bl_idname": f"object.bezier_{name.replace('-', '_')}",
        "bl_label": LABELS[name],
        "bl_options": {"REGISTER", "UNDO"},
        "filter_name": name,
        "poll": classmethod(_poll),
        "execute": _execute,
    }
    return type(f"OBJECT_OT_bezier_{name.replace('-', '_')}", (bpy.types.Operator,), body)


def _draw(self: Any, context: Any) -> None:
    for operator in OPERATORS:
        self.layout.operator(operator.bl_idname)


def _draw_entry(self: Any, context: Any) -> None:
    self.layout.menu(MENU.bl_idname)


OPERATORS = [_operator(name) for name in LABELS]
MENU: Any = type(
    "VIEW3D_MT_bezier_filters",
    (bpy.types.Menu,),
    {"bl_idname": "VIEW3D_MT_bezier_filters", "bl_label": "Bezier filters", "draw": _draw},
)


def register() -> None:
    """Add the operators and their menu."""
    for item in (*OPERATORS, MENU):
        bpy.utils.register_class(item)
    bpy.types.VIEW3D_MT_object.append(_draw_entry)


def unregister() -> None:
    """Remove them."""
    bpy.types.VIEW3D_MT_object.remove(_draw_entry)
    for item in (MENU, *reversed(OPERATORS)):
        bpy.utils.unregister_class(item)
