"""An independent implementation of the fit: dense, three coordinates, one vertex at a time.

It shares no code with the package. It follows the paper: S from its stencil, the whole stacked
system solved by lstsq for x, y and z, and E, F, G, L, M, N of the parametric patch.
"""

from math import comb

import numpy as np

PAPER_TRIPLES = ["00 01 02", "01 02 03", "00 10 20", "10 20 30", "30 31 32", "31 32 33", "03 13 23", "13 23 33"]


BIQUADRATIC_EDGES = ["00 01 02", "20 21 22", "00 10 20", "02 12 22"]
BIQUADRATIC_TWISTS = ["00 10 01 11", "01 11 02 12", "10 20 11 21", "11 21 12 22"]


def paper_rows():
    rows = np.zeros((8, 16))
    for row, triple in zip(rows, PAPER_TRIPLES, strict=True):
        for name, value in zip(triple.split(), (1, -2, 1), strict=True):
            row[4 * int(name[0]) + int(name[1])] = value
    return rows


def biquadratic_rows(shape):
    names, stencil = {"edges": (BIQUADRATIC_EDGES, (1, -2, 1)), "twists": (BIQUADRATIC_TWISTS, (1, -1, -1, 1))}[shape]
    rows = np.zeros((4, 9))
    for row, points in zip(rows, names, strict=True):
        for name, value in zip(points.split(), stencil, strict=True):
            row[3 * int(name[0]) + int(name[1])] = value
    return rows


def bernstein(t, order=0, degree=3):
    if order:
        lower = bernstein(t, order - 1, degree - 1)
        padded = np.pad(lower, ((0, 0), (1, 1)))
        return degree * (padded[:, :-1] - padded[:, 1:])
    return np.stack([comb(degree, i) * t**i * (1 - t) ** (degree - i) for i in range(degree + 1)], axis=1)


def design(u, v, du=0, dv=0, degree=3):
    return np.einsum("ki,kj->kij", bernstein(u, du, degree), bernstein(v, dv, degree)).reshape(len(u), -1)


def one_ring(faces, vertex):
    touching = faces[(faces == vertex).any(axis=1)]
    return set(touching.ravel().tolist()) - {vertex}


def farthest_axes(edges, neighbourhood, normal):
    """Directions of the edges that project farthest; of equals, those with the largest moments."""
    projected = edges - np.outer(edges @ normal, normal)
    lengths = np.linalg.norm(projected, axis=1)
    axes = projected[lengths > lengths.max() * (1 - 5e-7)] / lengths.max()

    def moments(axis):
        a, h = neighbourhood @ axis / lengths.max(), neighbourhood @ normal / lengths.max()
        return np.mean(a**3 + a**4), np.mean(a**2 * h**2)

    best = [axes[0]]
    for axis in axes[1:]:
        (a, h), (best_a, best_h) = moments(axis), moments(best[0])
        if a > best_a + 1e-6 or (a > best_a - 1e-6 and h > best_h * (1 + 1e-6)):
            best = [axis]
        elif a > best_a - 1e-6 and h > best_h * (1 - 1e-6):
            best.append(axis)
    return best


def paper_fit(vertices, faces, vertex, close_to, alpha=0.8):
    """Normal, H and K (MeshLab's sign) at one vertex, its 2-ring fitted as the paper says.

    On symmetric neighbourhoods several x axes are as good, and what comes out may be mirrored:
    of these the fit whose normal is closest to the one given.
    """
    return tensor_fit(vertices, faces, vertex, close_to, alpha, 3, paper_rows())


def tensor_fit(vertices, faces, vertex, close_to, alpha, degree, rows):
    """The same for a patch of any degree with the rows S given."""
    touching = faces[(faces == vertex).any(axis=1)]
    a, b, c = vertices[touching].transpose(1, 0, 2)
    face_normals = np.cross(b - a, c - a)
    face_normals /= np.linalg.norm(face_normals, axis=1, keepdims=True)
    normal = face_normals.sum(axis=0)
    normal /= np.linalg.norm(normal)

    ring = sorted(one_ring(faces, vertex))
    members = [vertex, *sorted(set().union(*(one_ring(faces, j) for j in ring), ring) - {vertex})]
    neighbourhood = vertices[members] - vertices[vertex]
    x_axes = farthest_axes(vertices[ring] - vertices[vertex], neighbourhood, normal)
    fits = [
        fit_in_frame(neighbourhood, np.array([x, np.cross(normal, x), normal]), alpha, degree, rows) for x in x_axes
    ]
    return min(fits, key=lambda fit: np.linalg.norm(fit[0] - close_to))


def fit_in_frame(neighbourhood, frame, alpha, degree, rows):
    """Normal, H and K of the fit in a frame with rows x, y and z."""
    local = neighbourhood @ frame.T
    low, high = local[:, :2].min(axis=0), local[:, :2].max(axis=0)
    u, v = ((local[:, :2] - low) / (high - low)).T
    system = np.vstack([alpha * design(u, v, degree=degree), (1 - alpha) * rows])
    target = np.vstack([alpha * local, np.zeros((len(rows), 3))])
    net, _, rank, _ = np.linalg.lstsq(system, target, rcond=None)
    assert rank == (degree + 1) ** 2

    def derivative(du, dv):
        return (design(u[:1], v[:1], du, dv, degree) @ net)[0]

    bu, bv, buu, buv, bvv = (derivative(*o) for o in [(1, 0), (0, 1), (2, 0), (1, 1), (0, 2)])
    n = np.cross(bu, bv)
    n /= np.linalg.norm(n)
    E, F, G = bu @ bu, bu @ bv, bv @ bv
    L, M, N = buu @ n, buv @ n, bvv @ n
    mean = -(N * E - 2 * M * F + L * G) / (2 * (E * G - F * F))
    gaussian = (L * N - M * M) / (E * G - F * F)
    return n @ frame, mean, gaussian
