"""Blender: the filters in the menu Object > Bezier filters; they change the mesh, and Undo takes them back."""

from typing import Any

import bmesh
import bpy
import numpy as np

from bezier_filters.fields import NORMAL, NORMALS, PREFIX, SMOOTH
from bezier_filters.parameters import Parameter
from bezier_filters_adapters.filled_fields import NEW, Fill, Values
from bezier_filters_adapters.filters import (
    ERRORS,
    FILL_HOLES,
    HELP,
    LABELS,
    default_of,
    kind_of,
    parameters_of,
    run,
)

from .first_picture import show_field

_NEW_FACES = f"{NEW}_face"
# where attributes of a kind have their values, and the type of those
_SLOTS = {"FLOAT": ("value", np.float32), "INT": ("value", np.int32), "FLOAT_VECTOR": ("vector", np.float32)}
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
    context.window_manager.progress_begin(0, 100)  # at the cursor
    try:
        result = run(
            self.filter_name,
            vertices,
            faces,
            given,
            lambda share: context.window_manager.progress_update(round(100 * share)),
        )
    except ERRORS as error:
        self.report({"ERROR"}, str(error))
        return {"CANCELLED"}
    finally:
        context.window_manager.progress_end()
    if result.fill is not None:
        _add(mesh, result.fill)
    if self.filter_name == SMOOTH:
        mesh.vertices.foreach_set("co", result.vertices.astype(np.float32).ravel())
    for name, values in result.fields.items():
        _set_attribute(mesh, name, "POINT", values)
    if NORMAL in result.fields:
        mesh.normals_split_custom_set_from_vertices(result.fields[NORMAL].tolist())
    is_colored = self.filter_name == FILL_HOLES and len(mesh.color_attributes)  # whose colours new vertices have, too
    if self.filter_name != NORMALS and not is_colored:
        shown = next(iter(result.fields))
        show_field(context, shown, result.fields[shown])
    mesh.update()
    self.report({"INFO"}, result.summary)
    if not np.allclose(context.object.matrix_world.to_scale(), 1.0):
        self.report(
            {"WARNING"}, "Lengths are those of the mesh, without the scale of the object; apply it first (Ctrl+A)"
        )
    return {"FINISHED"}


def _set_attribute(mesh: Any, name: str, domain: str, values: Values) -> None:
    """Set an attribute to numbers (n,), integers or not, or vectors (n, 3)."""
    kind = "INT" if values.dtype.kind in "iu" else "FLOAT" if values.ndim == 1 else "FLOAT_VECTOR"
    attribute = mesh.attributes.get(name)
    if attribute is not None and attribute.data_type != kind:
        mesh.attributes.remove(attribute)
        attribute = None
    if attribute is None:
        attribute = mesh.attributes.new(name, kind, domain)
    slot, dtype = _SLOTS[kind]
    attribute.data.foreach_set(slot, values.astype(dtype).ravel())


def _attributes(mesh: Any, count: int) -> dict[str, Values]:
    """Attributes of the vertices that are numbers, and all of this package."""
    found = {}
    for item in mesh.attributes:
        is_ours = item.name.startswith(PREFIX) and item.data_type in _SLOTS
        if item.domain != "POINT" or not (item.data_type == "FLOAT" or is_ours):
            continue
        slot, dtype = _SLOTS[item.data_type]
        values = np.empty((count, 3) if item.data_type == "FLOAT_VECTOR" else count, dtype)
        item.data.foreach_get(slot, values.ravel())
        found[item.name] = values
    return found


def _add(mesh: Any, fill: Fill) -> None:
    """Add what is new, so that polygons and their data stay; new rows of data are like old ones next to them.

    Numbers of vertices are then continued smoothly. A name has one domain in Blender: `NEW` is a field of vertices,
    that of the faces has a name of its own.
    """
    fields = _attributes(mesh, fill.old_vertices)
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
        _set_attribute(mesh, name, "POINT", np.concatenate([values, fill.new_vertex_rows(name, values)]))
    is_new = np.arange(len(mesh.polygons)) >= len(faces)
    _set_attribute(mesh, _NEW_FACES, "FACE", is_new.astype(np.uint8))


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
