"""Small meshes on disk, and the comparison of results in tiles with those in memory."""

import dataclasses
import json
from functools import cache
from hashlib import sha256

import numpy as np

from bezier_filters import estimate_vertex_geometry, read_fields
from bezier_filters.fields import columns
from bezier_filters.surfaces import bumpy_star, waves


@cache
def _star():
    return bumpy_star(resolution=15, jitter=0.2)


def clean():
    return _star().vertices.copy(), _star().faces.copy()


def noisy():
    """Noise on one half only, so that the parts are fitted differently."""
    vertices, faces = clean()
    edge = np.linalg.norm(vertices[faces[:, 0]] - vertices[faces[:, 1]], axis=1).mean()
    noise = np.random.default_rng(0).normal(scale=0.1 * edge, size=vertices.shape)
    return vertices + noise * (vertices[:, 2:] > 0.0), faces


def shuffled(vertices, faces):
    """The same mesh with vertices and faces in any order."""
    rng = np.random.default_rng(1)
    order = rng.permutation(len(vertices))
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return vertices[order], rank[rng.permutation(faces)].astype(np.int32)


def open_sheet():
    sheet = waves(resolution=45)
    return sheet.vertices, sheet.faces


def broken():
    """Faces that exist twice, join what is far apart, or are none, and vertices without faces."""
    vertices, faces = noisy()
    rng = np.random.default_rng(2)
    faces = np.concatenate([faces, faces[:40][:, ::-1], rng.integers(0, len(vertices), (10, 3)), faces[:5, [0, 0, 1]]])
    return shuffled(np.concatenate([vertices, rng.uniform(-1.0, 1.0, (900, 3))]), faces.astype(np.int32))


def pipe(around, along):
    """A pipe that is open at both ends, with many rings from one to the other."""
    i, j = np.divmod(np.arange(around * along), around)
    angle = 2.0 * np.pi * (j + 0.5 * (i % 2)) / around
    edge = 2.0 * np.sin(np.pi / around)
    vertices = np.column_stack([np.cos(angle), np.sin(angle), 0.866 * edge * i])
    i, j = np.divmod(np.arange(around * (along - 1)), around)
    a, b = i * around + j, i * around + (j + 1) % around
    c, d = a + around, b + around
    odd = (i % 2 == 1)[:, np.newaxis]
    first = np.where(odd, np.column_stack([a, b, d]), np.column_stack([a, b, c]))
    second = np.where(odd, np.column_stack([a, d, c]), np.column_stack([b, d, c]))
    return vertices, np.concatenate([first, second]).astype(np.int32)


MESHES = {"clean": clean, "noisy": noisy, "shuffled": lambda: shuffled(*noisy()), "open": open_sheet, "broken": broken}


def save_arrays(folder, vertices, faces):
    """NPY files of a mesh."""
    paths = folder / "vertices.npy", folder / "faces.npy"
    np.save(paths[0], np.ascontiguousarray(vertices))
    np.save(paths[1], np.ascontiguousarray(faces))
    return paths


IN_MEMORY = {}  # what was estimated, by the mesh and the options


def in_memory(vertices, faces, **options):
    """The estimate of a mesh, which many tests ask for, computed once."""
    data = b"".join(np.ascontiguousarray(part).tobytes() for part in (vertices, faces))
    key = sha256(data).digest(), vertices.dtype, faces.dtype, repr(options)
    if key not in IN_MEMORY:
        IN_MEMORY[key] = estimate_vertex_geometry(vertices, faces, **options)
    return IN_MEMORY[key]


def assert_same_as_in_memory(report, vertices, faces, **options):
    """All columns, to the last bit, and all that is told of the fit."""
    geometry = in_memory(vertices, faces, **options)
    fields = read_fields(report["output"])
    expected = columns("curvature", geometry)
    expected["quality"] = geometry.mean_curvature
    assert fields.keys() == expected.keys()
    for name, values in expected.items():
        assert np.array_equal(fields[name], values), name
    assert report["status"] == geometry.status_counts()
    assert json.dumps(report["fit"]) == json.dumps(dataclasses.asdict(geometry.fit))
