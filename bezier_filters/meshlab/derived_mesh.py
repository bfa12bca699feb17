"""The exchange of a mesh inside a MeshSet for one that was derived from it, with its attributes.

The new mesh is written to a file and loaded, since pymeshlab makes meshes from arrays without textures, and always with
colours and quality. The old one is deleted when everything has gone well.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.fields import PREFIX
from bezier_filters.files.ply_binary import ply_binary
from bezier_filters.files.ply_text import color_columns, coordinate_columns
from bezier_filters.holes.texture_continuation import SEAM_TOLERANCE, wedge_coordinates
from bezier_filters.meshlab.mesh_attributes import Attribute, add_attribute, read_attributes
from bezier_filters.meshlab.mesh_growth import TEXTURE_COMMENT, save_picture, textures_of, undo_on_failure
from bezier_filters.meshlab.meshset import BezierFilterError, CurrentMesh, Mesh, MeshSet, current_mesh
from bezier_filters.remeshing.edge_splitting import face_edges
from bezier_filters.remeshing.remeshing import RemeshingResult
from bezier_filters.remeshing.subdivision import SubdivisionResult
from bezier_filters.runtime.atomic import temporary_folder

SELECTED = 32  # bit of the flags in PLY files
# Columns that do not blend: codes, and directions without a sign. New vertices have those of the nearest old corner.
_UNMIXED = tuple(f"{PREFIX}{name}" for name in ("fit_grade", "rings_used", "crease", "direction", "torsion_direction"))


@dataclass(frozen=True)
class DerivedMesh:
    """A mesh each of whose vertices has a place on a face of the old mesh, and each face an old one below it."""

    vertices: FloatArray  # (n, 3)
    faces: IntArray  # (m, 3)
    corners: IntArray  # (n, 3): old vertices around the place of each vertex
    weights: FloatArray  # (n, 3): barycentric coordinates there
    old_faces: IntArray  # (m,)
    coordinates: FloatArray  # (m, 3, 2): barycentric ones of the corners in the old face, of its second and third one


def derive_by_subdivision(mesh: CurrentMesh, result: SubdivisionResult) -> DerivedMesh:
    """The derived mesh that `subdivide` made."""
    n, count, corner = len(result.vertices), len(mesh.vertices), result.faces.ravel()
    corners, weights = np.tile(np.arange(n, dtype=np.int32)[:, np.newaxis], (1, 3)), np.zeros((n, 3))
    weights[:, 0] = 1.0
    is_new = corner >= count
    place = result.coordinates.reshape(-1, 2)[is_new]
    corners[corner[is_new]] = mesh.faces[np.repeat(result.old_faces, 3)[is_new]]
    weights[corner[is_new]] = np.column_stack([1.0 - place.sum(axis=1), place])
    return DerivedMesh(result.vertices, result.faces, corners, weights, result.old_faces, result.coordinates)


def derive_by_remeshing(mesh: CurrentMesh, result: RemeshingResult) -> DerivedMesh:
    """The derived mesh that `remesh` made; corners of faces are at the nearest points of the plane of the old face."""
    place = result.vertex_coordinates
    weights = np.column_stack([1.0 - place.sum(axis=1), place])
    corners = mesh.faces[result.vertex_faces]
    old = result.old_vertices >= 0
    corners[old], weights[old] = result.old_vertices[old, np.newaxis], [1.0, 0.0, 0.0]
    identity = np.tile(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]), (len(result.faces), 1, 1))
    below = mesh.vertices[mesh.faces[result.old_faces]]
    coordinates = wedge_coordinates(result.vertices[result.faces], below, identity)
    return DerivedMesh(result.vertices, result.faces, corners, weights, result.old_faces, coordinates)


def seam_edges(ms: MeshSet, mesh: CurrentMesh) -> IntArray:
    """Edges (e, 2) at which texture coordinates of faces differ, or the selection ends."""
    layer, faces = current_mesh(ms), mesh.faces
    edges = face_edges(faces, len(mesh.vertices))
    columns = [np.tile(mesh.face_selection[:, np.newaxis, np.newaxis], (1, 3, 1)).astype(np.float64)]
    if layer.has_wedge_tex_coord():
        columns.append(layer.wedge_tex_coord_matrix().reshape(-1, 3, 2))
    corners = np.dstack(columns)
    following, swapped = np.roll(corners, -1, axis=1), (faces > np.roll(faces, -1, axis=1))[..., np.newaxis]
    ends = np.dstack([np.where(swapped, following, corners), np.where(swapped, corners, following)])
    owner, flat = edges.of_face.ravel(), ends.reshape(3 * len(faces), -1)
    low = np.full((len(edges.ends), flat.shape[1]), np.inf)
    high = -low
    np.minimum.at(low, owner, flat)
    np.maximum.at(high, owner, flat)
    differ = (high - low > SEAM_TOLERANCE * np.maximum(1.0, np.abs(low))).any(axis=1)
    return np.asarray(edges.ends[differ])


def exchange_mesh(ms: MeshSet, derived: DerivedMesh) -> tuple[list[str], bool]:
    """Exchange the current mesh for a derived one, a new layer with a new id.

    Colours, quality, texture coordinates and custom attributes of vertices are interpolated, those of faces are those
    of the old face below. New faces are selected where the old ones are, and new vertices between selected ones. Label
    and transform stay. If anything fails, the MeshSet is as it was but for the id of the next new layer.

    Returns the custom attributes that were lost because pymeshlab does not report their exact names, as it lists them;
    and whether the new mesh shows a texture.
    """
    old = current_mesh(ms)
    wanted, label, transform = old.id(), old.label(), np.array(old.transform_matrix())
    attributes, lost = read_attributes(ms)
    names, numbers = textures_of(ms)
    textured = old.has_wedge_tex_coord() and len(set(names)) == len(names)
    elements = {"vertex": _vertex_columns(old, derived), "face": _face_columns(old, derived)}
    if textured:
        coordinates = old.wedge_tex_coord_matrix().reshape(-1, 3, 2)[derived.old_faces]
        weights = np.dstack([1.0 - derived.coordinates.sum(axis=2), derived.coordinates])
        elements["face"]["list uchar float texcoord"] = (weights @ coordinates).reshape(-1, 6)
        elements["face"]["int texnumber"] = numbers[derived.old_faces]
    with undo_on_failure(ms):
        with temporary_folder() as folder:
            textured = textured and all(save_picture(folder, name, old.texture(name)) for name in names)
            path = folder / "mesh.ply"
            path.write_bytes(ply_binary(elements, [f"{TEXTURE_COMMENT}{name}" for name in names if textured]))
            ms.load_new_mesh(str(path))
        new = current_mesh(ms)
        if not (
            np.array_equal(new.vertex_matrix(), derived.vertices) and np.array_equal(new.face_matrix(), derived.faces)
        ):
            raise BezierFilterError("pymeshlab read the new mesh in another way than expected")
        ms.compute_normal_per_vertex()  # those of a file that was read are not unit vectors
        for attribute in attributes:
            add_attribute(new, _derive_attribute(attribute, derived))
        ms.set_matrix(transformmatrix=transform, freeze=False)
        new.set_label(label)
        made = new.id()
        ms.set_current_mesh(wanted)
        ms.delete_current_mesh()
        ms.set_current_mesh(made)
    return lost, textured and bool(names)


def _interpolate(values: FloatArray, derived: DerivedMesh) -> FloatArray:
    """Values (n, ...) at new vertices from those at old ones; exact where a vertex is an old one."""
    mixed = np.einsum("nk,nk...->n...", derived.weights, np.asarray(values, dtype=np.float64)[derived.corners])
    return np.asarray(mixed, dtype=np.float64)


def _vertex_columns(old: Mesh, derived: DerivedMesh) -> dict[str, NDArray[Any]]:
    selected = np.asarray(old.vertex_selection_array(), dtype=np.bool_)[derived.corners]
    flags = np.where((selected | (derived.weights == 0.0)).all(axis=1), SELECTED, 0)
    columns: dict[str, NDArray[Any]] = {**coordinate_columns(derived.vertices), "int flags": flags}
    if old.has_vertex_color():
        columns |= color_columns(np.clip(_interpolate(old.vertex_color_matrix(), derived), 0.0, 1.0))
    if old.has_vertex_scalar():
        columns["double quality"] = _interpolate(old.vertex_scalar_array(), derived)
    if old.has_vertex_tex_coord():
        u, v = _interpolate(old.vertex_tex_coord_matrix(), derived).T
        columns |= {"float texture_u": u, "float texture_v": v}
    return columns


def _face_columns(old: Mesh, derived: DerivedMesh) -> dict[str, NDArray[Any]]:
    like = derived.old_faces
    flags = np.where(np.asarray(old.face_selection_array(), dtype=np.bool_)[like], SELECTED, 0)
    columns: dict[str, NDArray[Any]] = {"list uchar int vertex_indices": derived.faces, "int flags": flags}
    if old.has_face_color():
        columns |= color_columns(old.face_color_matrix()[like])
    if old.has_face_scalar():
        columns["double quality"] = old.face_scalar_array()[like]
    return columns


def _derive_attribute(attribute: Attribute, derived: DerivedMesh) -> Attribute:
    kind, name, values = attribute
    if not kind.startswith("__ca_v"):
        return Attribute(kind, name, values[derived.old_faces])
    if name.startswith(_UNMIXED):
        nearest = derived.weights.argmax(axis=1)
        return Attribute(kind, name, values[derived.corners[np.arange(len(nearest)), nearest]])
    return Attribute(kind, name, _interpolate(values, derived))
