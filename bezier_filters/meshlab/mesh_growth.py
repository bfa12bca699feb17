"""New vertices and faces for a mesh inside a MeshSet.

pymeshlab can only merge layers, and welds vertices with equal coordinates when it does. So a copy of the mesh and a
layer with the new faces are merged while each vertex has its number for a coordinate: vertices that lie in
one place, as at the seams of textures, stay apart. The mesh itself is deleted when everything has gone well.

pymeshlab makes meshes from arrays, but without the number of the texture that a face shows, and always with colours and
quality of vertices, which the merged mesh would have, too. So the new faces of meshes with textures, or without colours
or quality, are written to a file and loaded.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.fields import PREFIX
from bezier_filters.files.ply_text import color_columns, coordinate_columns, ply_text
from bezier_filters.holes.polyharmonic_fairing import polyharmonic_continuation
from bezier_filters.holes.texture_continuation import Texture, continue_texture
from bezier_filters.meshlab.mesh_attributes import (
    Attribute,
    add_attribute,
    read_attributes,
    write_coordinates,
)
from bezier_filters.meshlab.meshset import BezierFilterError, Image, Mesh, MeshSet, current_mesh
from bezier_filters.runtime.atomic import temporary_folder

TEXTURE_COMMENT = "TextureFile "
_REMOVED, _SELECTED = "bz_removed", "bz_selected"  # attributes of a copy, for expressions that select


@dataclass(frozen=True)
class StayingRows:
    """Rows of a mesh that stay, ascending; vertices that had no face before are among them."""

    vertices: IntArray  # (n,)
    faces: IntArray  # (m,)


@dataclass(frozen=True)
class MeshGrowth:
    """Vertices and faces to add to a mesh, of which n vertices stay; removed rows do not count."""

    vertices: FloatArray  # (k, 3): new ones, numbered from n on
    faces: IntArray  # (f, 3): new ones
    like_vertex: IntArray  # (k,): old vertex from which each new one has its attributes
    like_face: IntArray  # (f,): old face from which each new one has them
    staying: StayingRows | None = None  # all rows if None


class _PatchTexture(NamedTuple):
    """Texture of new faces."""

    faces: Texture
    pictures: dict[str, Image]  # by name, in the order of their numbers


def grow_mesh(ms: MeshSet, growth: MeshGrowth, *, select: bool) -> tuple[list[str], bool]:
    """Add vertices and faces to the current mesh, which becomes a new layer with a new id, and remove some.

    Old vertices and faces stay the first, in their order. Label, transform, textures, colours, quality, selection and
    custom attributes stay; vertex and face normals are those of the faces. Afterwards what was selected is selected or,
    if `select` says so, exactly the new faces. If anything fails, the MeshSet is as it was but for the id of the next
    new layer.

    Returns the custom attributes that were lost because pymeshlab does not report their exact names, as it lists them;
    and whether the new faces show a texture.
    """
    old = current_mesh(ms)
    wanted, label, transform = old.id(), old.label(), np.array(old.transform_matrix())
    attributes, lost = read_attributes(ms)
    with undo_on_failure(ms):
        ms.generate_copy_of_current_mesh()
        copy = ms.current_mesh_id()
        for layer in list(ms):
            ms.set_mesh_visibility(layer.id(), layer.id() == copy)
        ms.set_matrix(transformmatrix=np.eye(4), freeze=False)
        if growth.staying is not None:
            _remove_others(ms, growth.staying)
        rest = current_mesh(ms)
        face_count, vertices = rest.face_number(), np.vstack([rest.vertex_matrix(), growth.vertices])
        texture = _texture(ms, rest, growth, vertices)
        numbers = np.zeros_like(vertices)
        numbers[:, 0] = np.arange(len(vertices))
        write_coordinates(ms, numbers[: rest.vertex_number()])
        patch = _patch(rest, growth, vertices, numbers)
        textured = texture is not None and _load_patch(ms, rest, patch, texture)
        if not textured and rest.has_vertex_color() and rest.has_vertex_scalar():
            ms.add_mesh(patch, "new faces", set_as_current=False)
        elif not textured:
            _load_patch(ms, rest, patch)
        textured &= rest.texture_number() > 0
        ms.set_current_mesh(copy)
        ms.generate_by_merging_visible_meshes(
            mergevisible=True, deletelayer=True, mergevertices=True, alsounreferenced=True
        )
        grown = current_mesh(ms)
        if not np.array_equal(grown.vertex_matrix(), numbers):
            raise BezierFilterError("pymeshlab merged the new faces with the mesh in another way than expected")
        write_coordinates(ms, vertices)
        for attribute in attributes:
            add_attribute(grown, _grow_attribute(attribute, growth))
        if select:
            ms.set_selection_none(allfaces=True, allverts=True)
            ms.compute_selection_by_condition_per_face(condselect=f"fi >= {face_count}")
        ms.set_matrix(transformmatrix=transform, freeze=False)
        grown.set_label(label)
        merged = grown.id()
        ms.set_current_mesh(wanted)
        ms.delete_current_mesh()
        ms.set_current_mesh(merged)
    return lost, textured


@contextmanager
def undo_on_failure(ms: MeshSet) -> Iterator[None]:
    """Preserve the visibility of layers; if the block fails, also delete its layers and restore the current one."""
    before = {layer.id(): layer.is_visible() for layer in ms}
    current = ms.current_mesh_id()
    try:
        yield
    except BaseException:
        for layer in [layer.id() for layer in ms if layer.id() not in before]:
            ms.set_current_mesh(layer)
            ms.delete_current_mesh()
        ms.set_current_mesh(current)
        raise
    finally:
        for layer in [layer.id() for layer in ms]:
            # A mesh that grew is as visible as it was.
            ms.set_mesh_visibility(layer, before.get(layer, before[current]))


def _remove_others(ms: MeshSet, staying: StayingRows) -> None:
    """Remove all but some rows from the current mesh, a copy without custom attributes; the selection stays."""
    mesh = current_mesh(ms)
    goes = np.ones(mesh.face_number())
    goes[staying.faces] = 0.0
    vertices = mesh.vertex_matrix()[staying.vertices]
    selected_vertices = mesh.vertex_selection_array()[staying.vertices]
    selected_faces = mesh.face_selection_array()[staying.faces]
    mesh.add_face_custom_scalar_attribute(goes, _REMOVED)
    ms.compute_selection_by_condition_per_face(condselect=f"{_REMOVED} > 0")
    ms.meshing_remove_selected_vertices_and_faces()
    ms.meshing_poly_to_tri()  # parts of polygons would crash `polygonal_face_list`
    mesh = current_mesh(ms)
    if not np.array_equal(mesh.vertex_matrix(), vertices) or mesh.face_number() != len(staying.faces):
        raise BezierFilterError("pymeshlab removed other vertices and faces than expected")
    mesh.add_vertex_custom_scalar_attribute(selected_vertices.astype(np.float64), _SELECTED)
    mesh.add_face_custom_scalar_attribute(selected_faces.astype(np.float64), _SELECTED)
    ms.compute_selection_by_condition_per_vertex(condselect=f"{_SELECTED} > 0")
    ms.compute_selection_by_condition_per_face(condselect=f"{_SELECTED} > 0")


def _grow_attribute(attribute: Attribute, growth: MeshGrowth) -> Attribute:
    """A custom attribute with rows for new vertices and faces, without removed ones."""
    kind, name, values = attribute
    is_of_vertices = kind.startswith("__ca_v")
    if growth.staying is not None:
        values = values[growth.staying.vertices if is_of_vertices else growth.staying.faces]
    new = values[growth.like_vertex if is_of_vertices else growth.like_face]
    if name.startswith(PREFIX):  # nothing has been estimated there, which is grade 0
        new[:] = 0.0
    return Attribute(kind, name, np.concatenate([values, new]))


def _texture(ms: MeshSet, old: Mesh, growth: MeshGrowth, vertices: FloatArray) -> _PatchTexture | None:
    """Texture coordinates of the new faces, if old ones have some, and images, if their names are distinct."""
    if not old.has_wedge_tex_coord():
        return None
    names, numbers = textures_of(ms)
    if len(set(names)) < len(names):  # numbers follow the names when layers are merged
        return None
    known = Texture(old.wedge_tex_coord_matrix().reshape(-1, 3, 2), numbers)
    new = continue_texture(vertices, old.face_matrix(), growth.faces, growth.like_face, known)
    return _PatchTexture(new, {name: old.texture(name) for name in names})


def _patch(old: Mesh, growth: MeshGrowth, vertices: FloatArray, numbers: FloatArray) -> Mesh:
    """The new faces as a mesh, with colours, quality and texture coordinates of vertices continued harmonically.

    Attributes of faces are those of the nearest old ones.
    """
    used, local = np.unique(growth.faces, return_inverse=True)
    faces, rim = local.reshape(-1, 3).astype(np.int32), used[used < old.vertex_number()]
    options: dict[str, Any] = {}
    known = dict[str, FloatArray]()
    if old.has_vertex_scalar():
        known["v_scalar_array"] = old.vertex_scalar_array()[:, np.newaxis]
    if old.has_vertex_color():
        known["v_color_matrix"] = old.vertex_color_matrix()
    if old.has_vertex_tex_coord():
        known["v_tex_coords_matrix"] = old.vertex_tex_coord_matrix()
    if known:
        columns = np.hstack(list(known.values()))[rim].astype(np.float64)
        continued = polyharmonic_continuation(vertices[used], faces, columns)
        widths = [values.shape[1] for values in known.values()]
        options |= dict(zip(known, np.split(continued, np.cumsum(widths)[:-1], axis=1), strict=True))
    if old.has_vertex_scalar():
        options["v_scalar_array"] = options["v_scalar_array"][:, 0]
    if old.has_vertex_color():
        half = 0.5 / 255  # pymeshlab rounds down
        options["v_color_matrix"] = np.clip(options["v_color_matrix"] + half, 0.0, 1.0)
    if old.has_face_color():
        options["f_color_matrix"] = old.face_color_matrix()[growth.like_face]
    if old.has_face_scalar():
        options["f_scalar_array"] = old.face_scalar_array()[growth.like_face]
    return Mesh(numbers[used], faces, **options)


def textures_of(ms: MeshSet) -> tuple[list[str], IntArray]:
    """Names of the textures of the current mesh, and the number of the one that each face shows, (m,).

    Where there are several, pymeshlab reports their order and the numbers only in files.
    """
    mesh = current_mesh(ms)
    if mesh.texture_number() < 2:
        return list(mesh.textures()), np.zeros(mesh.face_number(), dtype=np.int32)
    with temporary_folder() as folder:
        path = folder / "mesh.ply"
        ms.save_current_mesh(
            str(path), binary=True, save_textures=False, save_face_color=False, save_face_quality=False
        )
        data = path.read_bytes()
    header = data[: data.index(b"end_header")].decode(errors="replace").splitlines()
    comment = f"comment {TEXTURE_COMMENT}"
    names = [line.removeprefix(comment) for line in header if line.startswith(comment)]
    # The faces are the last element of the file, their numbers the last of a row.
    row = np.dtype([("corners", "V13"), ("coordinates", "V25"), ("number", "<i4")])
    rows = np.frombuffer(data[len(data) - mesh.face_number() * row.itemsize :], dtype=row)
    return names, rows["number"].astype(np.int32)


def _load_patch(ms: MeshSet, old: Mesh, patch: Mesh, texture: _PatchTexture | None = None) -> bool:
    """Add new faces as a layer, which becomes the current one, with the columns that the old mesh has.

    Returns False, without a layer, if the name of a texture cannot be stored in pymeshlab's files, such as one with
    spaces.
    """
    vertices: dict[str, NDArray[Any]] = {**coordinate_columns(patch.vertex_matrix())}
    if old.has_vertex_color():
        vertices |= color_columns(patch.vertex_color_matrix())
    if old.has_vertex_scalar():
        vertices["double quality"] = patch.vertex_scalar_array()
    if old.has_vertex_tex_coord():
        u, v = patch.vertex_tex_coord_matrix().T
        vertices |= {"float texture_u": u, "float texture_v": v}
    faces: dict[str, NDArray[Any]] = {"list uchar int vertex_indices": patch.face_matrix()}
    if texture is not None:
        faces["list uchar float texcoord"] = texture.faces.coordinates.reshape(-1, 6)
        faces["int texnumber"] = texture.faces.images
    if old.has_face_color():
        faces |= color_columns(patch.face_color_matrix())
    if old.has_face_scalar():
        faces["double quality"] = patch.face_scalar_array()
    pictures = {} if texture is None else texture.pictures
    text = ply_text({"vertex": vertices, "face": faces}, [f"{TEXTURE_COMMENT}{name}" for name in pictures])
    with temporary_folder() as folder:
        path = folder / "patch.ply"
        path.write_text(text, encoding="utf-8")
        if not all(save_picture(folder, name, picture) for name, picture in pictures.items()):
            return False
        ms.load_new_mesh(str(path))
    if set(current_mesh(ms).textures()) == set(pictures):
        return True
    ms.delete_current_mesh()
    return False


def save_picture(folder: Path, name: str, picture: Image) -> bool:
    """Write a texture under its name; readers detect the format from the content."""
    target = (folder / name).resolve()
    if folder.resolve() not in target.parents:
        return False
    target.parent.mkdir(parents=True, exist_ok=True)
    picture.save(str(folder / "picture.png"))
    (folder / "picture.png").replace(target)
    return True
