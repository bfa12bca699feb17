"""glTF files that make pymeshlab's reader leave its memory are refused; others are read."""

import base64
import json
import os
import struct

import numpy as np
import pytest

from bezier_filters import mesh_arrays
from bezier_filters.meshlab.mesh_files import load_mesh
from bezier_filters.meshlab.meshset import BezierFilterError

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype="<f4")


def scene_of(indices=(0, 1, 2, 0, 2, 3), kind=5123, **primitive):
    """A square of two triangles, and its buffer."""
    data = np.array(indices, dtype={5121: "u1", 5123: "<u2", 5125: "<u4"}[kind]).tobytes()
    views = [{"buffer": 0, "byteLength": 48}, {"buffer": 0, "byteOffset": 48, "byteLength": len(data)}]
    accessors = [
        {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]},
        {"bufferView": 1, "componentType": kind, "count": len(indices), "type": "SCALAR"},
    ]
    scene = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, **primitive}]}],
        "bufferViews": views, "accessors": accessors, "buffers": [{"byteLength": 48 + len(data)}],
    }  # fmt: skip
    return scene, SQUARE.tobytes() + data


def written(folder, scene, data, how="inside"):
    if how == "binary":
        text = json.dumps(scene).encode()
        text, data = text + b" " * (-len(text) % 4), data + b"\0" * (-len(data) % 4)
        chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(data), 0x004E4942) + data
        path = folder / "square.glb"
        path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
        return path
    if how == "beside":
        (folder / "a square.bin").write_bytes(data)
        scene["buffers"][0]["uri"] = "a%20square.bin"
    else:
        text = base64.b64encode(data).decode()
        scene["buffers"][0]["uri"] = f"data:application/octet-stream;base64,{text}"
    path = folder / "square.gltf"
    path.write_text(json.dumps(scene), encoding="utf-8")
    return path


def refusal(path):
    with pytest.raises(BezierFilterError) as caught:
        load_mesh(path)
    return str(caught.value)


@pytest.mark.parametrize("how", ["inside", "binary"])
@pytest.mark.parametrize("kind", [5121, 5123, 5125])
def test_triangles_are_read(kind, how, tmp_path):
    ms = load_mesh(written(tmp_path, *scene_of(kind=kind), how))
    mesh = ms.current_mesh()
    assert (mesh.vertex_number(), mesh.face_number()) == (4, 2)


@pytest.mark.parametrize(("mode", "name"), [(1, "lines"), (2, "a loop"), (3, "a strip"), (5, "a strip"), (6, "a fan")])
def test_only_points_and_triangles(mode, name, tmp_path):
    assert f"it holds {name}" in refusal(written(tmp_path, *scene_of(mode=mode)))


@pytest.mark.parametrize("how", ["inside", "binary", "beside"])
def test_indices_of_no_vertex(how, tmp_path):
    assert "faces on vertices that are not in it" in refusal(written(tmp_path, *scene_of((0, 1, 4)), how))


def test_corners_that_are_no_triangles(tmp_path):
    assert "5 corners" in refusal(written(tmp_path, *scene_of((0, 1, 2, 0, 2))))


def test_a_buffer_that_ends_early(tmp_path):
    scene, data = scene_of()
    assert "cut short" in refusal(written(tmp_path, scene, data[:-2]))


def test_nodes_inside_themselves(tmp_path):
    scene, data = scene_of()
    scene["nodes"] = [{"children": [1]}, {"mesh": 0, "children": [0]}]
    assert "cycle of nodes" in refusal(written(tmp_path, scene, data))


@pytest.mark.parametrize("name", ["../outside.bin", "/dev/zero", "pipe", "folder"])
@pytest.mark.parametrize("kind", ["buffers", "images"])
def test_only_regular_files_of_the_folder_are_opened(name, kind, tmp_path):
    inside = tmp_path / "inside"
    inside.mkdir()
    scene, data = scene_of()
    (tmp_path / "outside.bin").write_bytes(data)
    (inside / "folder").mkdir()
    os.mkfifo(inside / "pipe")
    path = written(inside, scene, data, "beside")
    if kind == "buffers":
        scene["buffers"][0]["uri"] = name
    else:
        scene["images"] = [{"uri": name}]
    path.write_text(json.dumps(scene), encoding="utf-8")
    assert "outside of its folder" in (said := refusal(path)) or "not a regular file" in said
    assert name in said


def test_a_link_out_of_the_folder_is_not_followed(tmp_path):
    inside = tmp_path / "inside"
    inside.mkdir()
    path = written(inside, *scene_of(), "beside")
    (inside / "a square.bin").rename(tmp_path / "square.bin")
    (inside / "a square.bin").symlink_to(tmp_path / "square.bin")
    assert "outside of its folder" in refusal(path)


def test_a_buffer_that_is_not_there(tmp_path):
    path = written(tmp_path, *scene_of(), "beside")
    (tmp_path / "a square.bin").unlink()
    assert "needs the file a square.bin" in refusal(path)


@pytest.mark.parametrize("change", [{"count": 4000}, {"byteOffset": 40}])
def test_coordinates_beyond_the_buffer(change, tmp_path):
    scene, data = scene_of()
    scene["accessors"][0] |= change
    assert "its buffer ends before" in refusal(written(tmp_path, scene, data))


def test_coordinates_that_are_not_finite(tmp_path):
    scene, data = scene_of()
    assert "1 vertices without finite" in refusal(written(tmp_path, scene, struct.pack("<f", np.nan) + data[4:]))


def test_several_meshes_are_one(tmp_path):
    """pymeshlab has a layer for each, and the current one would be all that is computed."""
    scene, data = scene_of()
    scene["nodes"] = [{"mesh": 0}, {"mesh": 0, "translation": [3, 0, 0]}]
    scene["scenes"][0]["nodes"] = [0, 1]
    vertices, faces = mesh_arrays(written(tmp_path, scene, data))
    assert (len(vertices), len(faces)) == (8, 4)
    assert vertices[:, 0].max() == 4.0


def test_values_that_replace_others_are_refused(tmp_path):
    """pymeshlab's reader ignores sparse accessors: the mesh would be another one."""
    scene, data = scene_of()
    scene["accessors"][0]["sparse"] = {"count": 1, "indices": {}, "values": {}}
    assert "sparse accessors" in refusal(written(tmp_path, scene, data))


@pytest.mark.parametrize("name", ["KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_mesh_quantization"])
def test_required_extensions_of_the_geometry_are_refused(name, tmp_path):
    scene, data = scene_of()
    scene["extensionsRequired"] = [name]
    assert f"requires the extension {name}" in refusal(written(tmp_path, scene, data))
    scene["extensionsRequired"] = ["KHR_materials_unlit"]
    assert len(mesh_arrays(written(tmp_path, scene, data))[1]) == 2


def test_quantized_coordinates_are_refused(tmp_path):
    scene, data = scene_of()
    scene["accessors"][0]["componentType"] = 5122
    assert "quantized coordinates" in refusal(written(tmp_path, scene, data))
