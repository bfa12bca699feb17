"""glTF files: what pymeshlab's reader takes on trust, and then reads or writes beyond its memory.

It takes lines and strips for triangles, follows indices wherever they point, and nodes in circles.
"""

import base64
import json
import struct
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from bezier_filters.errors import FieldFileError

POINTS, TRIANGLES = 0, 4
_MODES = ("points", "lines", "a loop of lines", "a strip of lines", "triangles", "a strip of triangles", "a fan")
_INDEX_TYPES: dict[int, np.dtype[np.unsignedinteger]] = {
    5121: np.dtype(np.uint8),
    5123: np.dtype(np.uint16),
    5125: np.dtype(np.uint32),
}
_GLB, _GLB_HEADER, _CHUNK_HEADER = b"glTF", 12, 8
_DATA_URI = "data:"


def check_gltf(path: Path) -> None:
    """Refuse a glTF file, as text or binary, whose primitives are not whole triangles of its vertices.

    What is not understood passes: its own reader has to judge.
    """
    try:
        scene, chunk = _parts(path.read_bytes())
        _check_nodes(path, scene.get("nodes", []))
        for mesh in scene.get("meshes", []):
            for primitive in mesh["primitives"]:
                _check_primitive(path, scene, chunk, primitive)
    except FieldFileError:
        raise
    except (ValueError, KeyError, IndexError, TypeError, AttributeError, struct.error, OSError):
        pass


def _parts(content: bytes) -> tuple[dict[str, Any], bytes]:
    """The scene, and the bytes that follow it in a binary file."""
    if content[:4] != _GLB:
        return json.loads(content), b""
    start = _GLB_HEADER + _CHUNK_HEADER
    (size,) = struct.unpack_from("<I", content, _GLB_HEADER)
    return json.loads(content[start : start + size]), content[start + size + _CHUNK_HEADER :]


def _check_nodes(path: Path, nodes: list[dict[str, Any]]) -> None:
    try:
        TopologicalSorter({k: node.get("children", []) for k, node in enumerate(nodes)}).prepare()
    except CycleError as error:
        raise FieldFileError(f"{path} has nodes that are inside themselves") from error


def _check_primitive(path: Path, scene: dict[str, Any], chunk: bytes, primitive: dict[str, Any]) -> None:
    mode = primitive.get("mode", TRIANGLES)
    if mode not in (POINTS, TRIANGLES):
        raise FieldFileError(f"{path} holds {_MODES[mode]}; only points and separate triangles can be read")
    vertices = scene["accessors"][primitive["attributes"]["POSITION"]]["count"]
    corners = vertices
    if "indices" in primitive:
        indices = _indices(path, scene, chunk, scene["accessors"][primitive["indices"]])
        corners = len(indices)
        if corners and indices.max() >= vertices:
            raise FieldFileError(f"{path} has faces on vertices that are not in it")
    if mode == TRIANGLES and corners % 3:
        raise FieldFileError(f"{path} has {corners} corners of triangles, which is not a multiple of 3")


def _indices(path: Path, scene: dict[str, Any], chunk: bytes, accessor: dict[str, Any]) -> NDArray[np.unsignedinteger]:
    """The numbers of vertices that an accessor stands for."""
    view = scene["bufferViews"][accessor["bufferView"]]
    uri = scene["buffers"][view["buffer"]].get("uri")
    if uri is None:
        data = chunk
    elif uri.startswith(_DATA_URI):
        data = base64.b64decode(uri.partition(",")[2])
    else:
        data = (path.parent / unquote(uri)).read_bytes()
    kind, offset = _INDEX_TYPES[accessor["componentType"]], view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
    if offset + accessor["count"] * kind.itemsize > len(data):
        raise FieldFileError(f"{path} is cut short or damaged: its buffer ends before its indices")
    return np.frombuffer(data, kind, accessor["count"], offset)
