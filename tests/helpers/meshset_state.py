"""Everything observable of a MeshSet, to show what an operation changed and what it left alone."""

from pathlib import Path
from tempfile import TemporaryDirectory
from xml.etree.ElementTree import canonicalize

import numpy as np

# pymeshlab lists attributes in lower case and without spaces; these are the names that differ.
TRUE_NAMES = {"face_value": "face value", "outlierscore": "outlierScore", "outlierscore_kept": "outlierScore_kept"}
ATTRIBUTE_GETTERS = {
    "__ca_vs__": "vertex_custom_scalar_attribute_array",
    "__ca_vp__": "vertex_custom_point_attribute_matrix",
    "__ca_fs__": "face_custom_scalar_attribute_array",
    "__ca_fp__": "face_custom_point_attribute_matrix",
}
ARRAYS = (
    "vertex_matrix",
    "face_matrix",
    "edge_matrix",
    "vertex_normal_matrix",
    "face_normal_matrix",
    "vertex_selection_array",
    "face_selection_array",
    "transform_matrix",
)
OPTIONAL_ARRAYS = {
    "vertex_color_matrix": "has_vertex_color",
    "face_color_matrix": "has_face_color",
    "vertex_scalar_array": "has_vertex_scalar",
    "face_scalar_array": "has_face_scalar",
    "vertex_tex_coord_matrix": "has_vertex_tex_coord",
    "wedge_tex_coord_matrix": "has_wedge_tex_coord",
}
FLAGS = (*OPTIONAL_ARRAYS.values(), "is_visible", "is_compact", "label")


def mesh_state(ms):
    """Dict of everything observable; arrays as shape and bytes, so that equal means equal bits."""
    state = {"current": ms.current_mesh_id(), "script": filter_script(ms)}
    for mesh in ms:
        for key, value in layer_state(mesh).items():
            state[f"{mesh.id()}: {key}"] = value
    layer = state["current"]
    for key, values in attributes(ms).items():
        state[f"{layer}: {key}"] = frozen(values)
    return state


def layer_state(mesh):
    state = {name: frozen(getattr(mesh, name)()) for name in ARRAYS}
    state |= {name: getattr(mesh, name)() for name in FLAGS}
    state |= {name: frozen(getattr(mesh, name)()) for name, has in OPTIONAL_ARRAYS.items() if getattr(mesh, has)()}
    box = mesh.bounding_box()
    state["bounding_box"] = frozen(np.concatenate([box.min(), box.max()]))
    state["textures"] = textures(mesh)
    return state


def attributes(ms):
    """Custom attributes of the current mesh by name, with what they belong to."""
    found = {}
    for key in ms.filter_parameter_values("ply"):
        for prefix, getter in ATTRIBUTE_GETTERS.items():
            if key.startswith(prefix):
                listed = key[len(prefix) :]
                name = TRUE_NAMES.get(listed, listed)
                found[name] = getattr(ms.current_mesh(), getter)(name)
    return found


def changed(before, after):
    """Keys whose values differ or that are in one state only."""
    return {key for key in before.keys() | after.keys() if before.get(key) != after.get(key)}


def filter_script(ms):
    """The recorded filters; Qt writes the attributes of an element in an order that changes from process to process."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "script.mlx"
        ms.save_filter_script(str(path))
        return canonicalize(from_file=str(path))


def textures(mesh):
    """Name and pixels of each texture."""
    with TemporaryDirectory() as folder:
        pixels = {}
        for name, image in mesh.textures().items():
            path = Path(folder) / "texture.png"
            image.save(str(path))
            pixels[name] = path.read_bytes()
        return pixels


def frozen(values):
    values = np.ascontiguousarray(values)
    return values.dtype.str, values.shape, values.tobytes()
