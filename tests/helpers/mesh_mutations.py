"""Valid meshes with random damage, the same for the same seed."""

import numpy as np
from bad_meshes import ball, moebius_strip, ring, stars_of

from bezier_filters.surfaces import block_with_sharp_edges, waves

MOST_EDITS = 6


def open_sheet():
    surface = waves(resolution=8, jitter=0.2)
    return surface.vertices.copy(), surface.faces.copy()


def block():
    vertices, faces = block_with_sharp_edges(resolution=4, jitter=0.2)
    return vertices.copy(), faces.copy()


STARTS = (lambda: ball(4), ring, open_sheet, block, moebius_strip, stars_of(12))


def some(rng, count):
    """A few random numbers below `count`, or many."""
    size = rng.integers(1, max(2, count // rng.choice([2, 10, 50])))
    return rng.integers(0, count, size)


def delete_faces(vertices, faces, rng):
    return vertices, np.delete(faces, some(rng, len(faces)), axis=0)


def delete_around_a_vertex(vertices, faces, rng):
    return vertices, faces[~(faces == rng.choice(faces.ravel())).any(axis=1)]


def duplicate_faces(vertices, faces, rng):
    return vertices, np.vstack([faces, faces[some(rng, len(faces))]])


def turn_faces(vertices, faces, rng):
    rows = some(rng, len(faces))
    faces[rows] = faces[rows][:, ::-1]
    return vertices, faces


def collapse(vertices, faces, rng):
    """Merge pairs of vertices: mostly neighbours, some far apart."""
    for _ in range(rng.integers(1, 8)):
        one = rng.choice(faces.ravel())
        other = (
            rng.choice(faces[(faces == one).any(axis=1)].ravel()) if rng.random() < 0.7 else rng.choice(faces.ravel())
        )
        faces[faces == other] = one
    return vertices, faces


def coincide(vertices, faces, rng):
    rows = some(rng, len(vertices))
    vertices[rows] = vertices[rng.integers(0, len(vertices), len(rows))]
    return vertices, faces


def rewire(vertices, faces, rng):
    rows = some(rng, len(faces))
    faces[rows, rng.integers(0, 3, len(rows))] = rng.integers(0, len(vertices), len(rows))
    return vertices, faces


def perturb(vertices, faces, rng):
    size = 10.0 ** rng.uniform(-8, 1)
    return vertices + size * rng.standard_normal(vertices.shape), faces


def displace(vertices, faces, rng):
    rows = some(rng, len(vertices))
    vertices[rows] += 10.0 ** rng.uniform(-3, 6) * rng.standard_normal((len(rows), 3))
    return vertices, faces


def spoil(vertices, faces, rng):
    vertices[rng.integers(len(vertices)), rng.integers(3)] = rng.choice([np.nan, np.inf, -np.inf, 1e300])
    return vertices, faces


def flatten(vertices, faces, rng):
    vertices[:, rng.integers(3)] *= 10.0 ** rng.uniform(-14, 0)
    return vertices, faces


def rescale(vertices, faces, rng):
    with np.errstate(over="ignore"):
        return vertices * 10.0 ** rng.uniform(-30, 30), faces


def move(vertices, faces, rng):
    return vertices + 10.0 ** rng.uniform(0, 12) * rng.standard_normal(3), faces


def add_lone_vertices(vertices, faces, rng):
    return np.vstack([vertices, rng.standard_normal((rng.integers(1, 20), 3))]), faces


def add_a_sheet(vertices, faces, rng):
    other, triangles = STARTS[rng.integers(len(STARTS))]()
    return np.vstack([vertices, other + rng.standard_normal(3)]), np.vstack([faces, triangles + len(vertices)])


def round_off(vertices, faces, rng):
    with np.errstate(over="ignore"):
        return vertices.astype(np.float32).astype(np.float64), faces


EDITS = (
    delete_faces,
    delete_around_a_vertex,
    duplicate_faces,
    turn_faces,
    collapse,
    coincide,
    rewire,
    perturb,
    displace,
    spoil,
    flatten,
    rescale,
    move,
    add_lone_vertices,
    add_a_sheet,
    round_off,
)


def mutated(seed):
    """Vertices and faces after up to `MOST_EDITS` random edits."""
    rng = np.random.default_rng(seed)
    vertices, faces = STARTS[rng.integers(len(STARTS))]()
    for _ in range(rng.integers(1, MOST_EDITS + 1)):
        if len(faces):
            vertices, faces = EDITS[rng.integers(len(EDITS))](vertices, faces, rng)
    return vertices, faces


def spoil_rows(seed):
    """A mesh with rows that no mesh has, and the array that they are in.

    Coordinates that are not finite; corners beyond the vertices, beyond 32 bits, before the first or no integers.
    """
    rng = np.random.default_rng(seed)
    vertices, faces = STARTS[rng.integers(len(STARTS))]()
    if rng.random() < 0.4:
        rows = some(rng, len(vertices))
        vertices[rows, rng.integers(3, size=len(rows))] = rng.choice([np.nan, np.inf, -np.inf], len(rows))
        return vertices, faces, "vertices"
    kind = (np.int64, np.uint64, np.float64)[rng.integers(3)]
    wide, rows = faces.astype(kind), some(rng, len(faces))
    beyond = [len(vertices), 2**31, 2**32, 2**32 + 1, 2**53, *([] if kind == np.uint64 else [-1, -(2**32)])]
    wide[rows, rng.integers(3, size=len(rows))] = np.array(beyond, kind)[rng.integers(len(beyond), size=len(rows))]
    return vertices, wide, "faces"
