"""Laplacians of a mesh, (L x)_i = rate_i (x_i - sum_j weight_ij x_j): differences from a mean of the neighbours."""

from typing import Literal, NamedTuple

import numpy as np

from bezier_filters.arrays import FloatArray, IntArray, SingleArray
from bezier_filters.meshes.prepared_mesh import PreparedMesh
from bezier_filters.meshes.triangles import cotangent_and_area, has_corner
from bezier_filters.runtime.jit import jit
from bezier_filters.runtime.parallel import run_kernel
from bezier_filters.sampling.mesh_parts import MeshPart

# whether border vertices follow their neighbours along the border, stay, or follow all their neighbours
Borders = Literal["curve", "fixed", "free"]

# bounds of the cotangent weights: no negative weights, and slivers do not dominate their vertices
MIN_EDGE_WEIGHT, MAX_EDGE_WEIGHT = 0.05, 3.0
# lower bound of the area of a vertex over the squared mean edge, which bounds the Laplacian
MIN_VERTEX_AREA = 0.2
# Upper bound of the rates, and quantile at which they are clipped: a few larger ones would cost all vertices many
# steps, and a low-pass filter removes such high frequencies in any case.
MAX_RATE, RATE_QUANTILE = 8.0, 0.95


class MeshStars(NamedTuple):
    """A mesh with the faces at every vertex, as compiled functions read them."""

    vertices: FloatArray
    faces: IntArray
    face_ptr: IntArray
    face_indices: IntArray


def mesh_stars(mesh: PreparedMesh) -> MeshStars:
    """The arrays of a mesh and its adjacency."""
    rows = mesh.adjacency.faces
    return MeshStars(mesh.vertices, mesh.faces, rows.indptr, rows.indices)


class Laplacian(NamedTuple):
    """The operator (L x)_i = rate_i (x_i - sum_j weight_ij x_j), whose eigenvalues lie in [0, bound]."""

    # indptr, indices: rows of neighbours
    indptr: IntArray
    indices: IntArray
    weights: SingleArray  # one for each neighbour; those of a row sum to 1, or are all 0
    rates: SingleArray  # (n,): rates of the vertices, 1 on a regular mesh, 0 for fixed vertices
    bound: float = 2.0  # twice the largest rate, or more: no eigenvalue is larger (Gershgorin)


def umbrella_laplacian(part: MeshPart, borders: Borders) -> Laplacian:
    """Differences from the plain mean of the neighbours (the umbrella operator).

    It depends on the connectivity alone, not on coordinates and their noise, and also makes the triangles more regular.
    Vertices at the cut of a part stay.
    """
    return cotangent_laplacian(part, borders, 0.0, 0.0, max_rate=1.0)


def cotangent_laplacian(
    part: MeshPart, borders: Borders, power: float, unit: float, *, max_rate: float | None = None
) -> Laplacian:
    """Differences from the mean with cotangent weights, which vanish on planes: vertices move along the normal.

    The rates are (sum of weights / (4 area))^power. A power of 0 gives equal rates, with edges as the unit of length; 1
    the Laplace-Beltrami operator in units of the mean edge, `unit`. Rates are clipped at `max_rate`, which bounds the
    eigenvalues, by default at their quantile `RATE_QUANTILE`. Vertices at the cut of a part stay. A unit of 0 gives
    plain means.
    """
    rows, n = part.mesh.adjacency.vertices, len(part.ids)
    result = Laplacian(rows.indptr, rows.indices, np.zeros(len(rows.indices), np.float32), np.zeros(n, np.float32))
    options = unit, power, MAX_RATE if max_rate is None else max_rate, {"curve": 1, "fixed": 0, "free": 2}[borders]
    run_kernel(_write_rows, n, mesh_stars(part.mesh), *options, result)
    result.rates[part.cut] = 0.0
    if max_rate is None:
        max_rate = max(float(np.quantile(result.rates, RATE_QUANTILE)), 0.5) if n else 0.5
        np.minimum(result.rates, max_rate, out=result.rates)
    return result._replace(bound=2.0 * max_rate)


@jit()
def _write_rows(
    mesh: MeshStars, unit: float, power: float, max_rate: float, borders: int, result: Laplacian, start: int, stop: int
) -> None:
    """Write the weights and rates of vertices start .. stop-1; plain means if the unit is 0."""
    ptr, weights = result.indptr, result.weights
    for i in range(start, stop):
        first, last = ptr[i], ptr[i + 1]
        on_border = False
        for q in range(first, last):
            met = 0
            for p in range(mesh.face_ptr[i], mesh.face_ptr[i + 1]):
                if has_corner(mesh.faces, mesh.face_indices[p], result.indices[q]):
                    met += 1
            weights[q] = 1.0 if met != 1 else -1.0  # a sign marks the border for a moment
            on_border = on_border or met == 1
        for q in range(first, last):
            if on_border and borders == 1:
                weights[q] = 1.0 if weights[q] < 0.0 else 0.0
            weights[q] = abs(weights[q])
        area = 0.0
        if unit > 0.0 and not on_border:
            area = _write_cotangents(mesh, result, i)
        total = 0.0
        for q in range(first, last):
            total += weights[q]
        for q in range(first, last):
            weights[q] = weights[q] / total if total > 0.0 else 0.0
        result.rates[i] = 1.0
        if unit > 0.0 and not on_border:
            result.rates[i] = min((total / (4.0 * max(area / (unit * unit), MIN_VERTEX_AREA))) ** power, max_rate)
        if total == 0.0 or (on_border and borders == 0):
            result.rates[i] = 0.0


@jit()
def _write_cotangents(mesh: MeshStars, result: Laplacian, i: int) -> float:
    """Replace the weights of vertex i by half cotangent sums within bounds; return a third of the area around it."""
    indices, weights, area = result.indices, result.weights, 0.0
    first, last = result.indptr[i], result.indptr[i + 1]
    weights[first:last] = 0.0
    for p in range(mesh.face_ptr[i], mesh.face_ptr[i + 1]):
        f = mesh.face_indices[p]
        k = 0 if mesh.faces[f, 0] == i else 1 if mesh.faces[f, 1] == i else 2
        a, b = mesh.faces[f, (k + 1) % 3], mesh.faces[f, (k + 2) % 3]
        at_a, whole = cotangent_and_area(mesh.vertices, a, b, i)
        at_b, _ = cotangent_and_area(mesh.vertices, b, i, a)
        area += whole / 3.0
        if whole == 0.0:
            continue
        for q in range(first, last):
            if indices[q] == a:
                weights[q] += 0.5 * at_b  # the angle opposite
            elif indices[q] == b:
                weights[q] += 0.5 * at_a
    for q in range(first, last):
        weights[q] = min(max(weights[q], MIN_EDGE_WEIGHT), MAX_EDGE_WEIGHT)
    return area
