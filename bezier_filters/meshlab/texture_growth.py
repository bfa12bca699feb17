"""Texture coordinates for new faces, and the way by which they get into a MeshSet.

pymeshlab makes meshes from arrays, but not with the number of the texture that a face shows: its faces would have none.
Only files bring it along, so new faces of textured meshes are written to one and loaded.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.meshlab.meshset import Image, Mesh, MeshSet, current_mesh

_COMMENT = "comment TextureFile "
_COLORS = ("red", "green", "blue", "alpha")


def wedge_coordinates(corners: FloatArray, triangles: FloatArray, coordinates: FloatArray) -> FloatArray:
    """Texture coordinates for the corners of new faces: those of the nearest points on the old faces beside them.

    What is shown on new faces is then what lies on old ones, never a part of the texture that belongs to nothing or to
    something else, and where a new face shares an edge with its old one, both show the same there.

    Parameters
    ----------
    corners : (f, 3, 3) float64
        Of the new faces.
    triangles : (f, 3, 3) float64
        The old face that each one resembles.
    coordinates : (f, 3, 2) float64
        Texture coordinates at its corners.

    Returns
    -------
    (f, 3, 2) float64

    Examples
    --------
    >>> old = np.array([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]])
    >>> new = np.array([[[1.0, 0, 0], [2, 2, 0], [0, 1, 0]]])
    >>> wedge_coordinates(new, old, old[..., :2])[0].tolist()
    [[1.0, 0.0], [0.5, 0.5], [0.0, 1.0]]
    """
    a, b, c = (triangles[:, np.newaxis, k] for k in range(3))
    normal = np.cross(b - a, c - a)
    squared = np.maximum(np.einsum("fkj,fkj->fk", normal, normal), 1e-300)
    weights = [np.einsum("fkj,fkj->fk", np.cross(q - p, corners - p), normal) / squared for p, q in ((b, c), (c, a))]
    barycentric = np.stack([*weights, 1.0 - weights[0] - weights[1]], axis=2)
    barycentric = np.maximum(barycentric, 0.0)  # 0 beyond an edge; the sum is 1 or more
    barycentric /= barycentric.sum(axis=2, keepdims=True)
    return np.asarray(barycentric @ coordinates, dtype=np.float64)


def textures_of(ms: MeshSet) -> tuple[list[str], IntArray]:
    """Names of the textures of the current mesh, and the number of the one that each face shows, (m,).

    Where there are several, pymeshlab tells their order and the numbers only in files.
    """
    mesh = current_mesh(ms)
    if mesh.texture_number() < 2:
        return list(mesh.textures()), np.zeros(mesh.face_number(), dtype=np.int32)
    with TemporaryDirectory(prefix="bezier_filters_") as folder:
        path = Path(folder) / "mesh.ply"
        ms.save_current_mesh(
            str(path), binary=True, save_textures=False, save_face_color=False, save_face_quality=False
        )
        data = path.read_bytes()
    header = data[: data.index(b"end_header")].decode(errors="replace").splitlines()
    names = [line.removeprefix(_COMMENT) for line in header if line.startswith(_COMMENT)]
    # The faces are the last element of the file, their numbers the last of a row.
    row = np.dtype([("corners", "V13"), ("coordinates", "V25"), ("number", "<i4")])
    rows = np.frombuffer(data[len(data) - mesh.face_number() * row.itemsize :], dtype=row)
    return names, rows["number"].astype(np.int32)


def load_patch(
    ms: MeshSet, patch: Mesh, coordinates: FloatArray, numbers: IntArray, textures: Mapping[str, Image]
) -> bool:
    """Add a mesh with texture coordinates (3 f, 2) and texture numbers (f,) as a layer, which becomes the current one.

    Parameters
    ----------
    ms : pymeshlab.MeshSet
    patch : pymeshlab.Mesh
        Its vertices and faces, with their colours and quality.
    coordinates : (3 f, 2) float64
    numbers : (f,) int32
    textures : dict of pymeshlab.Image
        All textures in their order.

    Returns
    -------
    bool
        False, and no layer, if there is a name that pymeshlab's files cannot hold, such as one with spaces.
    """
    vertices = [patch.vertex_matrix().tolist()]
    header = ["ply", "format ascii 1.0", *(f"{_COMMENT}{name}" for name in textures)]
    header += [f"element vertex {patch.vertex_number()}", *(f"property double {axis}" for axis in "xyz")]
    if patch.has_vertex_color():
        header += [f"property uchar {color}" for color in _COLORS]
        vertices.append(_bytes(patch.vertex_color_matrix()))
    if patch.has_vertex_scalar():
        header += ["property double quality"]
        vertices.append(patch.vertex_scalar_array()[:, np.newaxis].tolist())
    if patch.has_vertex_tex_coord():
        header += ["property float texture_u", "property float texture_v"]
        vertices.append(patch.vertex_tex_coord_matrix().tolist())
    corners = np.insert(patch.face_matrix(), 0, 3, axis=1)
    header += [f"element face {len(corners)}", "property list uchar int vertex_indices"]
    header += ["property list uchar float texcoord", "property int texnumber"]
    six = np.full((len(corners), 1), 6, dtype=np.int64).tolist()
    faces = [corners.tolist(), six, coordinates.reshape(-1, 6).tolist(), numbers[:, np.newaxis].tolist()]
    if patch.has_face_color():
        header += [f"property uchar {color}" for color in _COLORS]
        faces.append(_bytes(patch.face_color_matrix()))
    if patch.has_face_scalar():
        header += ["property double quality"]
        faces.append(patch.face_scalar_array()[:, np.newaxis].tolist())
    rows = [_row(parts) for columns in (vertices, faces) for parts in zip(*columns, strict=True)]
    with TemporaryDirectory(prefix="bezier_filters_") as folder:
        path = Path(folder) / "patch.ply"
        path.write_text("\n".join([*header, "end_header", *rows]) + "\n", encoding="utf-8")
        if not all(_save_picture(Path(folder), name, picture) for name, picture in textures.items()):
            return False
        ms.load_new_mesh(str(path))
    if set(current_mesh(ms).textures()) == set(textures):
        return True
    ms.delete_current_mesh()
    return False


def _save_picture(folder: Path, name: str, picture: Image) -> bool:
    """Write a texture to where a file names it; its format is told by its content, whatever the name says."""
    target = (folder / name).resolve()
    if folder.resolve() not in target.parents:
        return False
    target.parent.mkdir(parents=True, exist_ok=True)
    picture.save(str(folder / "picture.png"))
    (folder / "picture.png").replace(target)
    return True


def _bytes(colors: FloatArray) -> list[list[int]]:
    return np.asarray(np.rint(255.0 * colors), dtype=np.int64).tolist()  # type: ignore[no-any-return]


def _row(parts: Sequence[Sequence[float]]) -> str:
    return " ".join(repr(number) for part in parts for number in part)
