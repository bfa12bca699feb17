"""Formats of files to save: what they can hold, and the current mesh in formats that pymeshlab lacks."""

import os
from pathlib import Path

import numpy as np

from bezier_filters.field_arrays import join_vectors
from bezier_filters.fields import PREFIX, QUALITY
from bezier_filters.files.host_formats import WRITERS
from bezier_filters.files.mesh_data import MeshData, shrink_data
from bezier_filters.files.ply_text import save_lines
from bezier_filters.meshlab.mesh_attributes import SCALAR, list_attributes, read_columns
from bezier_filters.meshlab.meshset import BezierFilterError, Mesh, MeshSet, current_mesh, read_current_mesh
from bezier_filters.runtime.file_names import printable_path

FIELD_SUFFIX = ".ply"  # suffix of pymeshlab's format with quality and ``bz_*`` columns, which it does not read
FIELD_SUFFIXES = (FIELD_SUFFIX, ".vtp", ".vtu", ".csv", ".npz")
_SIX_DIGIT_ROUNDING, _SINGLE_ROUNDING = 5e-6, 2.0**-24
# largest error of a coordinate in each format of pymeshlab: relative to the largest coordinate, and as a length
_ROUNDING = {
    **dict.fromkeys((FIELD_SUFFIX, ".obj", ".off"), (0.0, 0.0)),
    **dict.fromkeys((".dae", ".x3d", ".wrl"), (_SIX_DIGIT_ROUNDING, 0.0)),
    **dict.fromkeys((".stl", ".3ds", ".ctm", ".dxf"), (_SINGLE_ROUNDING, 0.0)),
    ".3mf": (_SINGLE_ROUNDING, 5e-7),
}
SAVE_SUFFIXES = tuple(_ROUNDING)
_OF_WRITERS = dict.fromkeys(WRITERS, (0.0, 0.0)) | {".glb": (_SINGLE_ROUNDING, 0.0)}


def format_of(path: str | os.PathLike[str]) -> str:
    """Suffix, in lower case, of a file to save, which determines the format; unknown formats are refused."""
    suffix = Path(os.path.realpath(path)).suffix.lower()
    if suffix not in _ROUNDING and suffix not in WRITERS:
        raise BezierFilterError(
            f"cannot write {printable_path(path)}: unknown format {suffix or 'without a suffix'}; "
            f"use one of {' '.join((*SAVE_SUFFIXES, *WRITERS))}"
        )
    return suffix


def write_data(ms: MeshSet, path: Path, *, attributes: bool, compact: bool) -> tuple[str, ...]:
    """Write the current mesh in a format that pymeshlab lacks; return remarks on losses."""
    mesh = read_current_mesh(ms)
    layer = ms.current_mesh()
    columns = {}
    if attributes:
        names = [name for kind, name in list_attributes(ms) if kind == SCALAR and name.startswith(PREFIX)]
        columns = read_columns(ms, names)
    if layer.has_vertex_scalar() and layer.vertex_scalar_array().any():
        columns[QUALITY] = np.array(layer.vertex_scalar_array(), dtype=np.float64)
    normals = mesh.vertex_normals if mesh.vertex_normals.any() else None
    colors = np.rint(255.0 * layer.vertex_color_matrix()).astype(np.uint8) if layer.has_vertex_color() else None
    data = MeshData(mesh.vertices, mesh.faces, normals, colors, join_vectors(columns))
    WRITERS[path.suffix.lower()](path, shrink_data(data) if compact else data)
    lost = {
        "faces, which CSV files do not have": path.suffix.lower() == ".csv" and len(mesh.faces) > 0,
        "textures": layer.texture_number() > 0,
        "colours of faces": layer.has_face_color(),
    }
    names = [name for name, is_lost in lost.items() if is_lost]
    return (f"written without its {', '.join(names)}",) if names else ()


def is_polyline(mesh: Mesh) -> bool:
    """Whether a layer has edges and no faces."""
    return bool(mesh.edge_number() and not mesh.face_number())


def save_polyline(ms: MeshSet, path: Path, *, attributes: bool) -> tuple[str, ...]:
    """Write the edges of the current mesh, which pymeshlab saves in OBJ files only, and rounds; no remarks."""
    mesh = current_mesh(ms)
    mesh.compact()
    names = [name for kind, name in list_attributes(ms) if kind == SCALAR and name.startswith(PREFIX)]
    columns = read_columns(ms, names) if attributes else {}
    colors = mesh.vertex_color_matrix()[:, :3] if mesh.has_vertex_color() else np.ones((mesh.vertex_number(), 3))
    values = np.array(mesh.vertex_scalar_array()) if mesh.has_vertex_scalar() else np.zeros(mesh.vertex_number())
    save_lines(path, mesh.vertex_matrix(), mesh.edge_matrix().astype(np.int32), values, colors, columns)
    return ()


def edge_remarks(mesh: Mesh, suffix: str) -> tuple[str, ...]:
    """Remark on edges that the format loses."""
    edges = mesh.edge_number()
    if not edges or suffix == ".obj":  # with faces, pymeshlab writes them
        return ()
    return (f"written without its {edges:,} edges, which {suffix} files of meshes do not have",)


def rounding_remarks(mesh: Mesh, suffix: str) -> tuple[str, ...]:
    """Remark on the rounding of coordinates by the format, if it exceeds a thousandth of the edges."""
    if not mesh.is_compact():
        return ()
    vertices, faces = mesh.vertex_matrix(), mesh.face_matrix()
    relative, absolute = (_ROUNDING | _OF_WRITERS)[suffix]
    error = max(relative * float(np.abs(vertices).max(initial=0.0)), absolute)
    edges = np.linalg.norm(vertices[faces[:, 1:]] - vertices[faces[:, :1]], axis=2)
    if not edges.size or error <= 1e-3 * edges.mean():
        return ()
    where = f"{suffix} files round coordinates by up to {error:.1g} here, {error / edges.mean():.1g} mean edges"
    return (f"not exact: {where}; write a PLY or OBJ file, or move the mesh to the origin",)
