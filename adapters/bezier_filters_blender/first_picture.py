"""What Blender shows of a field at once: a colour attribute, in views, and in renders of new materials."""

from typing import Any

import bpy
import numpy as np

from bezier_filters.fields import PREFIX
from bezier_filters_adapters.field_colors import field_colors
from bezier_filters_adapters.filled_fields import Values

COLOR = PREFIX + "color"  # the colour attribute
_MATERIAL = "Bezier filters"


def show_field(context: Any, column: str, values: Values) -> None:
    """Show a field (n,) of the active object: in its colour attribute, in 3D views, and in renders.

    The attribute becomes the active one and that of renders. Only an object without materials gets one that uses it,
    and only views that show the colours of materials, as new ones do, show attributes instead.
    """
    mesh = context.object.data
    _set_colors(mesh, field_colors(column, values).rgb(values))
    if not context.object.material_slots:
        mesh.materials.append(_material())
    for area in context.screen.areas if context.screen else ():
        if area.type == "VIEW_3D" and area.spaces.active.shading.color_type == "MATERIAL":
            area.spaces.active.shading.color_type = "VERTEX"


def _set_colors(mesh: Any, rgb: Values) -> None:
    attribute = mesh.attributes.get(COLOR)
    if attribute is not None and (attribute.data_type, attribute.domain) != ("BYTE_COLOR", "POINT"):
        mesh.attributes.remove(attribute)
        attribute = None
    if attribute is None:
        attribute = mesh.color_attributes.new(COLOR, "BYTE_COLOR", "POINT")
    opaque = np.insert(rgb, 3, 1.0, axis=1).astype(np.float32)
    attribute.data.foreach_set("color_srgb", opaque.ravel())
    mesh.color_attributes.active_color_name = mesh.color_attributes.default_color_name = COLOR


def _material() -> Any:
    """The material whose colour is the attribute."""
    found = bpy.data.materials.get(_MATERIAL)
    if found is None:
        found = bpy.data.materials.new(_MATERIAL)
        nodes, links = found.node_tree.nodes, found.node_tree.links
        color = nodes.new("ShaderNodeVertexColor")
        color.layer_name = COLOR
        (shader,) = (node for node in nodes if node.type == "BSDF_PRINCIPLED")
        links.new(color.outputs["Color"], shader.inputs["Base Color"])
    return found
