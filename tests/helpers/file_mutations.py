"""Mesh files with random damage, the same for the same seed."""

import io
import zipfile
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pymeshlab

from bezier_filters.meshlab.mesh_files import save_mesh
from bezier_filters.meshlab.save_formats import SAVE_SUFFIXES

MOST_EDITS = 4
NUMBERS = (b"-1", b"0", b"99999999", b"2147483648", b"1000000000000000000", b"1e999", b"nan", b"-inf", b"", b"x")
TEXT_FORMATS = {
    ".xyz": b"".join(b"%d %d %d 0 0 1\n" % (k % 5, k // 5, k % 3) for k in range(30)),
    ".pts": b"30\n" + b"".join(b"%d %d %d 1 255 0 0\n" % (k % 5, k // 5, k % 3) for k in range(30)),
    ".asc": b"".join(b"%d %d %d\n" % (k % 5, k // 5, k % 3) for k in range(30)),
    ".tri": b"".join(b"0 %d 0 1 %d 0 0 %d 1 255 255 255\n" % (k, k, k) for k in range(12)),
}


@cache
def sound_files():
    """A small mesh with quality and colours in every format, as suffix and bytes."""
    ms = pymeshlab.MeshSet()
    ms.create_sphere(subdiv=2)
    ms.compute_scalar_by_function_per_vertex(q="x*y")
    ms.compute_color_from_scalar_per_vertex()
    mesh = ms.current_mesh()
    mesh.add_vertex_custom_scalar_attribute(mesh.vertex_matrix()[:, 0], "bz_k_min")
    files = list(TEXT_FORMATS.items())
    with TemporaryDirectory() as folder:
        for suffix in SAVE_SUFFIXES:
            for binary in (True, False) if suffix in (".ply", ".stl") else (True,):
                path = Path(folder) / f"mesh{suffix}"
                save_mesh(ms, path, binary=binary)
                files.append((suffix, path.read_bytes()))
    archive = io.BytesIO()
    np.savez_compressed(archive, k_min=np.arange(9.0), normals=np.eye(3))
    files.append((".npz", archive.getvalue()))
    return tuple(files)


def change_bytes(data, rng):
    data = bytearray(data)
    for place in rng.integers(0, len(data), rng.integers(1, 20)):
        data[place] = rng.integers(256)
    return bytes(data)


def change_the_beginning(data, rng):
    data = bytearray(data)
    data[rng.integers(min(len(data), 400))] = rng.integers(256)
    return bytes(data)


def cut(data, rng):
    return data[: rng.integers(len(data))]


def drop_a_block(data, rng):
    first = rng.integers(len(data))
    return data[:first] + data[first + rng.integers(1, 200) :]


def repeat_a_block(data, rng):
    first = rng.integers(len(data))
    return data[:first] + data[first : first + rng.integers(1, 200)] * rng.integers(2, 30) + data[first:]


def insert_noise(data, rng):
    place = rng.integers(len(data))
    return data[:place] + rng.bytes(rng.integers(1, 50)) + data[place:]


def replace_a_number(data, rng):
    """Another number in text, mostly in the header, where counts stand."""
    import re

    reach = 500 if rng.random() < 0.7 else len(data)
    places = [match.span() for match in re.finditer(rb"(?<![\w.])-?\d[\d.e+-]*", data[:reach])]
    if not places:
        return data
    first, last = places[rng.integers(len(places))]
    return data[:first] + NUMBERS[rng.integers(len(NUMBERS))] + data[last:]


def replace_an_integer(data, rng):
    """Another 32-bit number in binary data."""
    place = rng.integers(max(1, len(data) - 4))
    value = int(rng.choice([0, 1, 0x7FFFFFFF, 0xFFFFFFFF, 0x80000000, 1_000_000]))
    return data[:place] + value.to_bytes(4, "little") + data[place + 4 :]


def damage_a_member(data, rng):
    """Change an unpacked member of a ZIP archive (3MF, NPZ), else some bytes."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            members = {name: archive.read(name) for name in archive.namelist()}
    except Exception:  # it is none, or damaged before
        return change_bytes(data, rng)
    name = sorted(members)[rng.integers(len(members))]
    edit = (change_bytes, cut, replace_a_number)[rng.integers(3)]
    members[name] = edit(members[name], rng) if members[name] else b"?"
    result = io.BytesIO()
    with zipfile.ZipFile(result, "w", zipfile.ZIP_DEFLATED) as archive:
        for member, content in members.items():
            archive.writestr(member, content)
    return result.getvalue()


EDITS = (
    change_bytes,
    change_the_beginning,
    cut,
    drop_a_block,
    repeat_a_block,
    insert_noise,
    replace_a_number,
    replace_an_integer,
    damage_a_member,
)


def mutated_file(seed):
    """Suffix and content of a file after up to `MOST_EDITS` random edits; one in twenty has the wrong suffix."""
    rng = np.random.default_rng(seed)
    files = sound_files()
    suffix, data = files[rng.integers(len(files))]
    for _ in range(rng.integers(1, MOST_EDITS + 1)):
        if data:
            data = EDITS[rng.integers(len(EDITS))](data, rng)
    if rng.random() < 0.05:
        suffix = files[rng.integers(len(files))][0]
    return suffix, data
