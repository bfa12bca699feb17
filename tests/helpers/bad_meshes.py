"""Meshes as they should not be, for every function to survive."""

from functools import cache

import numpy as np

from bezier_filters.surfaces import sphere, torus

TRIANGLE = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]])


@cache
def surface(make, resolution):
    return make(resolution=resolution, jitter=0.2)


def ball(resolution=4):
    found = surface(sphere, resolution)
    return found.vertices.copy(), found.faces.copy()


def ring():
    found = surface(torus, 10)
    return found.vertices.copy(), found.faces.copy()


def duplicate_faces():
    vertices, faces = ball()
    return vertices, np.vstack([faces, faces[:40]])


def faces_without_area():
    vertices, faces = ball()
    return vertices, np.vstack([faces, np.repeat(faces[:10, :1], 3, axis=1), faces[:10][:, [0, 0, 1]]])


def coincident_vertices():
    vertices, faces = ball()
    vertices[faces[:5, 1]] = vertices[faces[:5, 0]]
    return vertices, faces


def all_vertices_in_one_place():
    _, faces = ball()
    return np.zeros((faces.max() + 1, 3)), faces


def speck_and_a_far_vertex():
    """Neighbourhoods so small beside the mesh that powers of their size cannot be distinguished from 0."""
    vertices, faces = ball()
    vertices = 1e-27 * vertices
    vertices[0] = 2000.0, 1000.0, 500.0
    return vertices, faces


def dust_and_a_far_vertex():
    """The same where squares of curvatures, or curvatures themselves, are beyond what a number holds."""
    vertices, faces = ball()
    n = len(vertices)
    vertices = np.vstack([1e-52 * vertices, 1e-70 * vertices, 1e-170 * vertices, [[2.0, 1.0, 0.5]]])
    return vertices, np.vstack([faces, faces + n, faces + 2 * n, [[0, 1, 3 * n]]])


def unreferenced_vertices():
    vertices, faces = ball()
    return np.vstack([[[9.0, 9, 9]], vertices, np.full((5, 3), 7.0)]), faces + 1


def fins():
    """Edges of three and more faces."""
    vertices, faces = ball()
    n = len(vertices)
    fin = np.array([[faces[k, 0], faces[k, 1], n + k] for k in range(8)])
    return np.vstack([vertices, 1.3 * vertices[faces[:8, 0]]]), np.vstack([faces, fin, fin[:2]])


def bow_tie():
    """Two balls that share one vertex."""
    vertices, faces = ball()
    n = len(vertices)
    other = np.where(faces == 0, 0, faces + n)
    return np.vstack([vertices, vertices + 2.0 * vertices[0]]), np.vstack([faces, other])


def turned_faces():
    vertices, faces = ball()
    faces[::3] = faces[::3, ::-1]
    return vertices, faces


def moebius_strip():
    n, m = 30, 5
    u, v = np.meshgrid(np.arange(n) * 2 * np.pi / n, np.linspace(-0.3, 0.3, m), indexing="ij")
    x = (1 + v * np.cos(u / 2)) * np.cos(u)
    y = (1 + v * np.cos(u / 2)) * np.sin(u)
    vertices = np.stack([x, y, v * np.sin(u / 2)], axis=-1).reshape(-1, 3)
    faces = []
    for i in range(n):
        for j in range(m - 1):
            a, b = i * m + j, i * m + j + 1
            c, d = ((i + 1) * m + j, (i + 1) * m + j + 1) if i + 1 < n else (m - 1 - j, m - 2 - j)
            faces += [[a, c, b], [b, c, d]]
    return vertices, np.array(faces)


def crossing_sheets():
    vertices, faces = ball()
    n = len(vertices)
    return np.vstack([vertices, vertices * [1.0, 0.4, 1.7]]), np.vstack([faces, faces + n])


def slivers():
    vertices, faces = ball()
    vertices[:, 2] *= 1e-12
    return vertices, faces


def needle():
    vertices, faces = ring()
    return vertices * [1e6, 1.0, 1.0], faces


def tiny():
    vertices, faces = ring()
    return vertices * 1e-30, faces


def huge():
    vertices, faces = ring()
    return vertices * 1e30, faces


def far_away():
    vertices, faces = ring()
    return vertices + 1e9, faces


def single_precision():
    vertices, faces = ring()
    return (vertices + 100.0).astype(np.float32), faces


def many_neighbours():
    """A cone whose tip has 500 neighbours."""
    angles = np.arange(500) * 2 * np.pi / 500
    rim = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(500)])
    fan = np.column_stack([np.zeros(500), 1 + np.arange(500), 1 + (np.arange(500) + 1) % 500])
    return np.vstack([[[0, 0, 0.3]], rim]), fan.astype(int)


def tetrahedron():
    """Every vertex has three neighbours."""
    vertices = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    return vertices, np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]])


def stars_of(n):
    """A fan of n vertices."""

    def make():
        angles = np.linspace(0, 1.5 * np.pi, n - 1)
        rim = np.column_stack([np.cos(angles), np.sin(angles), 0.1 * np.cos(2 * angles)])
        fan = np.column_stack([np.zeros(n - 2), 1 + np.arange(n - 2), 2 + np.arange(n - 2)])
        return np.vstack([[[0.0, 0, 0]], rim]), fan.astype(int)

    return make


def soup():
    """Triangles that share nothing."""
    vertices, faces = ball()
    return vertices[faces].reshape(-1, 3), np.arange(faces.size).reshape(-1, 3)


def random_faces():
    rng = np.random.default_rng(0)
    return rng.standard_normal((30, 3)), rng.integers(0, 30, (80, 3))


def spikes():
    vertices, faces = ball()
    vertices[::20] *= 40.0
    return vertices, faces


MAKERS = {
    maker.__name__: maker
    for maker in (
        ball,
        ring,
        duplicate_faces,
        faces_without_area,
        coincident_vertices,
        all_vertices_in_one_place,
        speck_and_a_far_vertex,
        dust_and_a_far_vertex,
        unreferenced_vertices,
        fins,
        bow_tie,
        turned_faces,
        moebius_strip,
        crossing_sheets,
        slivers,
        needle,
        tiny,
        huge,
        far_away,
        single_precision,
        many_neighbours,
        tetrahedron,
        soup,
        random_faces,
        spikes,
    )
}
MAKERS |= {f"fan_of_{n}": stars_of(n) for n in (3, 4, 5, 8, 13, 20)}
MAKERS |= {
    "one_triangle": lambda: TRIANGLE,
    "no_faces": lambda: (ball()[0], np.zeros((0, 3), dtype=int)),
    "no_vertices": lambda: (np.zeros((0, 3)), np.zeros((0, 3), dtype=int)),
    "one_vertex": lambda: (np.zeros((1, 3)), np.zeros((0, 3), dtype=int)),
    "two_vertices": lambda: (np.eye(3)[:2], np.zeros((0, 3), dtype=int)),
}
