"""Mesh files that are not what they promise, or only look odd, with what must come of them; the same for the same seed.

The files are built from a mesh, so that what is in them is known without reading them.
"""

import base64
import json
import struct
from dataclasses import dataclass, replace

import numpy as np

SIDE = 7  # vertices of a sheet along each side
NOT_FINITE = ("nan", "NaN", "-nan", "NAN", "inf", "-inf", "Infinity", "1e999", "-1e400")
NO_NUMBERS = ("abc", "1,5", "1.0D2", "--1", "0x10", "1_0", "1.2.3", "e5", "1e", "+")
BEYOND = (2**31, 2**32, 2**64, 10**30)
NONE = np.empty((0, 3))
WHOLE, REFUSED, NOTICED = "whole", "refused", "noticed"


@dataclass(frozen=True)
class MisleadingFile:
    """A file, and what must come of it: read whole, refused, or not read without a word."""

    suffix: str
    data: bytes
    what: str  # the damage, in words
    outcome: str
    skip: bool  # whether vertices without finite coordinates are to be left out
    vertices: np.ndarray  # that come in, if the file is whole, in their order, but where the reader welds them
    triangles: tuple[int, int]  # at least and at most: of a face that loses a corner a part may stay


@dataclass(frozen=True)
class Rows:
    """Rows of a mesh as they are to be written: words, so that some can be no numbers."""

    vertices: list[list[str]]
    faces: list[list[str]]
    counts: tuple[int, int]


def misleading_file(seed):
    """A file of a random format with at most one kind of damage."""
    rng = np.random.default_rng(seed)
    vertices, faces = _sheet(rng)
    suffix = list(WRITERS)[rng.integers(len(WRITERS))]
    damages = [damage for damage, formats in DAMAGES.items() if suffix in formats]
    damage = damages[rng.integers(len(damages))]
    if suffix in (".stl", ".3ds", ".glb", ".gltf"):
        faces = _triangles(faces)
    elif suffix in POINTS:
        faces = []
    return damage(suffix, vertices, faces, rng)


def _sheet(rng):
    """A wavy sheet of quadrilaterals, some of which are cut in two."""
    x, y = np.meshgrid(np.arange(SIDE), np.arange(SIDE), indexing="ij")
    vertices = np.stack([x, y, np.sin(x) * np.cos(y)], axis=-1).reshape(-1, 3) + rng.uniform(-0.1, 0.1, (SIDE**2, 3))
    corner = np.arange(SIDE**2).reshape(SIDE, SIDE)
    squares = np.stack([corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]], axis=-1).reshape(-1, 4)
    faces = []
    for square in squares.tolist():
        faces += _triangles([square]) if rng.random() < 0.5 else [square]
    # As single precision has them, so that every format holds them as they are.
    return vertices.astype(np.float32), faces


def _triangles(faces):
    return [[face[0], face[k], face[k + 1]] for face in faces for k in range(1, len(face) - 1)]


def _rows(vertices, faces):
    words = [[repr(float(x)) for x in row] for row in vertices]
    return Rows(words, [list(map(str, face)) for face in faces], (len(vertices), len(faces)))


# damages


def nothing(suffix, vertices, faces, rng):
    """Only odd spelling."""
    return _file(suffix, _rows(vertices, faces), rng, "odd, but valid", WHOLE, vertices, faces)


def no_finite_coordinates(suffix, vertices, faces, rng):
    rows, skip = _rows(vertices, faces), bool(rng.integers(2))
    bad = set(rng.choice(len(vertices), rng.integers(1, 4), replace=False).tolist())
    for index in bad:
        # pymeshlab takes some for zeros in files of points: these are refused, as what it reads is no row of the file.
        words = NOT_FINITE[:2] if skip and suffix in POINTS else NOT_FINITE
        rows.vertices[index][rng.integers(3)] = str(rng.choice(words))
    left = [face for face in faces if not bad & set(face)]
    outcome = WHOLE if skip and suffix not in (".glb", ".gltf") else REFUSED
    kept = np.delete(vertices, sorted(bad), axis=0)
    found = _file(suffix, rows, rng, "coordinates that are not finite", outcome, kept, left)
    parts = sum(len(face) - 3 for face in faces if bad & set(face))
    return replace(found, skip=skip, triangles=(found.triangles[0], found.triangles[0] + parts))


def no_numbers(suffix, vertices, faces, rng):
    rows = _rows(vertices, faces)
    index = rng.integers(len(vertices))
    # The first row of an ASC file may name columns.
    row, place = rows.vertices[max(index, 1) if suffix == ".asc" else index], rng.integers(3)
    if rng.random() < 0.2:
        del row[max(place, 1) :]
    else:
        words = [word for word in NO_NUMBERS if "," not in word or suffix != ".asc"]  # where commas are spaces
        row[place] = str(rng.choice(words))
    return _file(suffix, rows, rng, "a coordinate that is no number", REFUSED, NONE, [])


def no_such_vertex(suffix, vertices, faces, rng):
    """A corner beyond the vertices, beyond what 32 or 64 bits hold, or before the first."""
    rows, n = _rows(vertices, faces), len(vertices)
    corner = int(rng.choice([n, n + 1, 10 * n]))
    if suffix not in (".stl", ".3ds", ".glb", ".gltf") and rng.random() < 0.7:
        corner = BEYOND[rng.integers(len(BEYOND))] + int(rng.integers(n))
        corner = -corner if rng.random() < 0.3 else corner
    if suffix == ".off" and rng.random() < 0.2:
        corner = -1
    row = rows.faces[rng.integers(len(faces))]
    row[rng.integers(len(row))] = str(corner)
    if suffix == ".obj" and rng.random() < 0.2:
        row[0] = str(rng.choice(["x", "3.7", "1e1", "zero"]))
    return _file(suffix, rows, rng, "a corner that is no vertex", REFUSED, NONE, [])


def more_than_there_is(suffix, vertices, faces, rng):
    rows = _rows(vertices, faces)
    counts = list(rows.counts)
    which = rng.integers(2) if faces and suffix != ".stl" else len(faces) > 0
    counts[which] += int(rng.choice([1, 2, 1000, 60_000 - counts[which] if suffix == ".3ds" else 10**9]))
    return _file(suffix, replace(rows, counts=tuple(counts)), rng, "more is announced", REFUSED, NONE, [])


def less_than_there_is(suffix, vertices, faces, rng):
    rows = _rows(vertices, faces)
    counts = list(rows.counts)
    which = rng.integers(2) if faces and suffix != ".stl" else len(faces) > 0
    counts[which] -= int(rng.integers(1, 5))
    return _file(suffix, replace(rows, counts=tuple(counts)), rng, "less is announced", NOTICED, NONE, [])


def cut_short(suffix, vertices, faces, rng):
    found = _file(suffix, _rows(vertices, faces), rng, "cut short", REFUSED, NONE, [])
    # Whether the last number lacks digits, nobody can know; the end of a line is no loss.
    reach = len(found.data.rstrip()) - 30
    data = found.data[: rng.integers(reach // 3, reach)]
    # Between two facets of STL as text, the end alone is missing.
    is_between = suffix == ".stl" and b"facet" not in data.lower().rpartition(b"endfacet")[2]
    return replace(found, data=data, outcome=NOTICED if is_between else REFUSED)


# formats


def _file(suffix, rows, rng, what, outcome, vertices, faces):
    data = WRITERS[suffix](rows, rng)
    triangles = sum(len(face) - 2 for face in faces)
    return MisleadingFile(suffix, data, what, outcome, False, vertices, (triangles, triangles))


def _number(word):
    if "_" in word:  # which Python takes for a separator
        raise ValueError(word)
    return float(word)


def _points(rows):
    with np.errstate(over="ignore"):
        return np.array([list(map(_number, row)) for row in rows.vertices]).astype(np.float32)


def _text(lines, rng, *, comments=True, indents=True):
    """Lines in one of the ways in which text is spelt."""
    end, space, indent = rng.choice(["\n", "\r\n"]), rng.choice([" ", "\t", "  "]), rng.choice(["", "", " " * indents])
    tail = rng.choice(["", "", " "])
    spelt = []
    for line in lines:
        if comments and rng.random() < 0.03:
            spelt.append(str(rng.choice(["# a note", "#", "# 1 2 3", ""])))
        spelt.append(indent + str(space).join(line) + tail)
    return (str(end).join(spelt) + str(rng.choice([end, end, ""]))).encode()


def obj(rows, rng):
    style = rng.integers(5)  # plain, with textures, with normals, with both, counted back from here
    n = len(rows.vertices)
    lines = [["v", *row] for row in rows.vertices]
    if rng.random() < 0.2 and all(len(row) == 3 for row in rows.vertices):  # colours
        lines = [[*line, "0.5", "0.25", "1"] for line in lines]
    lines += [["vt", "0.5", "0.5"]] if style in (1, 3) else []
    lines += [["vn", "0", "0", "1"]] if style in (2, 3) else []
    if rng.random() < 0.3:
        lines = [["o", "nan"], ["g", "1,5", "inf"], ["s", "off"], *lines]
    for face in rows.faces:
        words = []
        for word in face:
            if not word.lstrip("-").isdigit():
                words.append(word)
                continue
            k = int(word)
            name = str(k + 1 if k >= 0 else k)
            if style == 4 and 0 <= k < n:
                name = str(k - n)
            words.append(name + ("", "/1", "//1", "/1/1", "")[style])
        lines.append(["f", *words])
    text = _text(lines, rng, indents=False)
    if rng.random() < 0.2:  # a line that goes on in the next
        head, middle, rest = text.partition(b"\nf ")
        end = b"\r\n" if b"\r\n" in text else b"\n"
        text = head + middle + rest.replace(b" ", b" \\" + end, 1)
    return text


def off(rows, rng):
    n, m = rows.counts
    edges = str(rng.choice([0, n + m]))
    head = [["OFF", str(n), str(m), edges]] if rng.random() < 0.2 else [["OFF"], [str(n), str(m), edges]]
    return _text([*head, *rows.vertices, *([str(len(face)), *face] for face in rows.faces)], rng)


def ply(rows, rng):
    n, m = rows.counts
    form = str(rng.choice(["ascii", "ascii", "binary_little_endian", "binary_big_endian"]))
    try:
        wide = bool(rng.integers(2))
        points = np.array([list(map(_number, row)) for row in rows.vertices])
        corners = [np.array([int(k) for k in face], np.int32) for face in rows.faces]
    except (ValueError, OverflowError):
        form = "ascii"
    kind = "double" if wide else "float"
    extra = bool(rng.integers(2))
    head = ["ply", f"format {form} 1.0", "comment a note", f"element vertex {n}"]
    head += [f"property {kind} {axis}" for axis in "xyz"] + ["property uchar flags"] * extra
    if rows.faces or m:
        kinds = {"uchar": "u1", "int": "i4", "uint": "u4", "ushort": "u2", "short": "i2"}
        length, entry = rng.choice(["uchar", "uchar", "int", "uint", "ushort"]), rng.choice(["int", "int", *kinds])
        if form != "ascii" and max((face.max() for face in corners), default=0) > np.iinfo(kinds[entry]).max:
            entry = "int"
        name = rng.choice(["vertex_indices", "vertex_index"])
        head += [f"element face {m}", f"property list {length} {entry} {name}"]
    head = "\n".join([*head, "end_header\n"]).encode()
    if form == "ascii":
        lines = [row + ["7"] * extra for row in rows.vertices]
        return head + _text([*lines, *([str(len(face)), *face] for face in rows.faces)], rng, comments=False)
    order = "<" if "little" in form else ">"
    with np.errstate(over="ignore"):
        table = points.astype(order + ("f8" if wide else "f4"))
    body = b"".join(row.tobytes() + b"\7" * extra for row in table)
    for face in corners:
        body += np.array(len(face), order + kinds[length]).tobytes() + face.astype(order + kinds[entry]).tobytes()
    return head + body


def stl(rows, rng):
    try:
        points = _points(rows)
    except ValueError:
        points = None
    faces = [[int(k) for k in face] for face in rows.faces]
    if points is not None and (rows.counts[1] != len(faces) or rng.random() < 0.5):
        body = b"".join(struct.pack("<12fH", 0, 0, 1, *points[face].ravel(), 0) for face in faces)
        return b"solid of numbers".ljust(80, b"\0") + struct.pack("<I", rows.counts[1]) + body
    lines = [["solid", "a", "b"]]
    for face in faces:
        lines += [["facet", "normal", "0", "0", "1"], ["outer", "loop"]]
        lines += [["vertex", *rows.vertices[k]] for k in face] + [["endloop"], ["endfacet"]]
    return _text([*lines, ["endsolid"]], rng, comments=False)


def points_alone(rows, rng):
    return _text(rows.vertices, rng, comments=False)


def pts(rows, rng):
    return _text([[str(rows.counts[0])], *rows.vertices], rng, comments=False)


def three_ds(rows, rng):
    def chunk(kind, content):
        return struct.pack("<HI", kind, len(content) + 6) + content

    points = _points(rows)
    faces = b"".join(struct.pack("<4H", *(int(k) for k in face), 7) for face in rows.faces)
    n, m = rows.counts
    tables = [chunk(0x4110, struct.pack("<H", n) + points.tobytes()), chunk(0x4120, struct.pack("<H", m) + faces)]
    if rng.random() < 0.3:
        tables.insert(1, chunk(0x4160, bytes(48)))  # a frame
    mesh = chunk(0x4100, b"".join(tables))
    return chunk(0x4D4D, chunk(0x0002, bytes(4)) + chunk(0x3D3D, chunk(0x4000, b"a\0" + mesh)))


def _gltf_content(rows, rng):
    points = _points(rows)
    corners = np.array([[int(k) for k in face] for face in rows.faces], "<u2")
    n, m = rows.counts
    buffer = points.tobytes() + corners.tobytes()
    views = [{"buffer": 0, "byteOffset": 0, "byteLength": points.nbytes}]
    views.append({"buffer": 0, "byteOffset": points.nbytes, "byteLength": corners.nbytes})
    accessors = [{"bufferView": 0, "componentType": 5126, "count": n, "type": "VEC3"}]
    accessors.append({"bufferView": 1, "componentType": 5123, "count": 3 * m, "type": "SCALAR"})
    content = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}]}
    content["meshes"] = [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}]
    content |= {"accessors": accessors, "bufferViews": views, "buffers": [{"byteLength": len(buffer)}]}
    return content, buffer


def gltf(rows, rng):
    content, buffer = _gltf_content(rows, rng)
    uri = "data:application/octet-stream;base64," + base64.b64encode(buffer).decode()
    content["buffers"][0]["uri"] = uri
    return json.dumps(content, indent=rng.choice([1, 2]).item()).encode()


def glb(rows, rng):
    content, buffer = _gltf_content(rows, rng)
    text = json.dumps(content).encode()
    text, buffer = text + b" " * (-len(text) % 4), buffer + bytes(-len(buffer) % 4)
    head = struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(buffer))
    return head + struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(buffer), b"BIN\0") + buffer


POINTS = {".xyz", ".asc", ".pts"}
WRITERS = {
    ".obj": obj,
    ".off": off,
    ".ply": ply,
    ".stl": stl,
    ".xyz": points_alone,
    ".asc": points_alone,
    ".pts": pts,
    ".3ds": three_ds,
    ".gltf": gltf,
    ".glb": glb,
}
_TEXT = {".obj", ".off", ".ply", ".stl", ".xyz", ".asc", ".pts"}
DAMAGES = {
    nothing: set(WRITERS),
    no_finite_coordinates: set(WRITERS),
    no_numbers: _TEXT,
    no_such_vertex: {".obj", ".off", ".ply", ".3ds", ".gltf", ".glb"},
    more_than_there_is: {".off", ".ply", ".stl", ".pts", ".3ds", ".gltf", ".glb"},
    less_than_there_is: {".off", ".ply", ".stl", ".pts", ".3ds"},
    cut_short: {".off", ".ply", ".stl", ".pts", ".3ds", ".gltf", ".glb"},
}
