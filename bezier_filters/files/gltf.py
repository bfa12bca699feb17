"""Validation of glTF files, text or binary, before pymeshlab's reader, which trusts them.

That reader accesses memory out of bounds for lines and strips, indices out of range, truncated buffers and cycles of
nodes, and opens any path that a file names.
"""

import base64
import json
import struct
from dataclasses import dataclass
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from bezier_filters.errors import FieldFileError
from bezier_filters.files.companions import companion

_POINT_MODE, _TRIANGLE_MODE = 0, 4  # primitive modes, indices of the next table
_MODES = ("points", "lines", "a loop of lines", "a strip of lines", "triangles", "a strip of triangles", "a fan")
_COMPONENTS = {5120: "i1", 5121: "u1", 5122: "i2", 5123: "u2", 5125: "u4", 5126: "f4"}
_INDEX_COMPONENTS = (5121, 5123, 5125)
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_MAGIC, _GLB_HEADER_BYTES, _GLB_CHUNK_HEADER_BYTES = b"glTF", 12, 8
_DATA_URI = "data:"
_APPEARANCE_EXTENSIONS = (
    "KHR_materials",
    "KHR_texture",
    "KHR_lights",
    "EXT_texture",
)  # extensions that change no geometry


@dataclass(frozen=True)
class _Scene:
    """A scene with the content of its buffers, by their index."""

    path: Path
    content: dict[str, Any]
    buffers: dict[int, bytes]

    def table(self, index: int) -> NDArray[Any]:
        """The numbers of an accessor, (count, width)."""
        accessor = self.content["accessors"][index]
        if "sparse" in accessor:  # the reader ignores the substituted values
            raise FieldFileError(f"{self.path} has sparse accessors, which cannot be read")
        view = self.content["bufferViews"][accessor["bufferView"]]
        data = self.buffers[view["buffer"]]
        kind, width = np.dtype("<" + _COMPONENTS[accessor["componentType"]]), _WIDTHS[accessor["type"]]
        count, row = accessor["count"], width * kind.itemsize
        stride = view.get("byteStride", row)
        inside, first = accessor.get("byteOffset", 0), view.get("byteOffset", 0)
        offset = first + inside
        end = (count - 1) * stride + row if count else 0
        if min(count, inside, first, stride) < 0 or inside + end > view["byteLength"] or offset + end > len(data):
            raise FieldFileError(f"{self.path} is cut short or damaged: its buffer ends before what it announces")
        return np.ndarray((count, width), kind, data, offset, (stride, kind.itemsize))


def check_gltf(path: Path) -> int | None:
    """Number of vertices of the scene; `FieldFileError` for forbidden files and primitives other than triangles.

    None if the file cannot be parsed, which is left to its reader.
    """
    content, chunk = path.read_bytes(), b""
    try:
        if content.startswith(_MAGIC):
            start = _GLB_HEADER_BYTES + _GLB_CHUNK_HEADER_BYTES
            (size,) = struct.unpack_from("<I", content, _GLB_HEADER_BYTES)
            content, chunk = content[start : start + size], content[start + size + _GLB_CHUNK_HEADER_BYTES :]
        scene = _Scene(path, json.loads(content), {})
        for extension in scene.content.get("extensionsRequired", []):
            if not extension.startswith(_APPEARANCE_EXTENSIONS):
                raise FieldFileError(f"{path} requires the extension {extension}, which cannot be read")
        for index, buffer in enumerate(scene.content.get("buffers", [])):
            scene.buffers[index] = _buffer(path, buffer, chunk)
        for image in scene.content.get("images", []):
            if not image.get("uri", _DATA_URI).startswith(_DATA_URI):
                companion(path, unquote(image["uri"]))
        nodes = scene.content.get("nodes", [])
        order = list(TopologicalSorter({k: node.get("children", []) for k, node in enumerate(nodes)}).static_order())
        counts = [
            sum(_count_vertices(scene, primitive) for primitive in mesh["primitives"])
            for mesh in scene.content.get("meshes", [])
        ]
        roots = scene.content["scenes"][scene.content.get("scene", 0)].get("nodes", [])
        return _vertices_below(nodes, order, roots, counts)
    except FieldFileError:
        raise
    except CycleError as error:
        raise FieldFileError(f"{path} has a cycle of nodes") from error
    except (ValueError, KeyError, IndexError, TypeError, AttributeError, struct.error, RecursionError):
        return None


def _buffer(path: Path, buffer: dict[str, Any], chunk: bytes) -> bytes:
    uri = buffer.get("uri")
    if uri is None:
        return chunk
    if uri.startswith(_DATA_URI):
        return base64.b64decode(uri.partition(",")[2])
    neighbour_file = companion(path, unquote(uri))
    if neighbour_file is None:
        raise FieldFileError(f"{path} needs the file {unquote(uri)}, which is missing from its folder")
    with neighbour_file.open("rb") as stream:
        return stream.read(buffer["byteLength"])


def _vertices_below(nodes: list[dict[str, Any]], order: list[int], roots: list[int], counts: list[int]) -> int:
    """Number of vertices of the meshes of all nodes below the roots, with repetitions."""
    below = dict[int, int]()
    for index in order:  # children come first
        node = nodes[index]
        own = counts[node["mesh"]] if "mesh" in node else 0
        below[index] = own + sum(below[child] for child in node.get("children", []))
    return sum(below[root] for root in roots)


def _count_vertices(scene: _Scene, primitive: dict[str, Any]) -> int:
    """Number of vertices of a primitive, which must consist of whole triangles, or of points."""
    mode = primitive.get("mode", _TRIANGLE_MODE)
    if mode not in (_POINT_MODE, _TRIANGLE_MODE):
        raise FieldFileError(f"{scene.path} holds {_MODES[mode]}; only points and separate triangles can be read")
    tables = {name: scene.table(index) for name, index in primitive["attributes"].items()}
    if tables["POSITION"].dtype != np.float32:
        raise FieldFileError(f"{scene.path} has quantized coordinates, which cannot be read; store them as floats")
    vertices = corners = len(tables["POSITION"])
    if any(len(table) < vertices for table in tables.values()):
        raise FieldFileError(f"{scene.path} has fewer normals, colours or texture coordinates than vertices")
    if "indices" in primitive:
        accessor = scene.content["accessors"][primitive["indices"]]
        if accessor["componentType"] not in _INDEX_COMPONENTS:
            raise FieldFileError(f"{scene.path} has indices that are no integers")
        indices = scene.table(primitive["indices"])
        corners = len(indices)
        if corners and indices.max() >= vertices:
            raise FieldFileError(f"{scene.path} has faces on vertices that are not in it")
    if mode == _TRIANGLE_MODE and corners % 3:
        raise FieldFileError(f"{scene.path} has {corners} corners of triangles, which is not a multiple of 3")
    bad = np.flatnonzero(~np.isfinite(tables["POSITION"]).all(axis=1))
    if len(bad):
        raise FieldFileError(f"{scene.path} has {len(bad)} vertices without finite coordinates, the first is {bad[0]}")
    return vertices
