"""The lattice on which the vertices of a mesh lie, however it is turned, and its axes.

Boundaries of voxel masks that were moved into the frame of a patient, and terrains in whole metres that were turned,
are rounded along axes of their own. All edges of such a mesh are integer combinations of three of them.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.meshes.mesh import TriangleMesh

# Half and twice a constant decide alike on 39 turned masks, terrains, tubes, bricks and scans, but for half of
# `MAX_COEFFICIENT`, with which masks count as rounded along other axes, with half of their noise.

MAX_EDGE_SAMPLE = 3_000  # edges looked at
# largest share of distinct vectors among the edges: those of a lattice recur; tubes pass, but have no lattice
MAX_DISTINCT_EDGES = 0.5
SINGLE_ERROR = 4.0 * float(np.finfo(np.float32).eps)  # bound of the rounding of differences in single precision
MIN_PRECISION = 50.0  # shortest lattice vector over the error of an edge: shorter ones are not distinct from rounding
MAX_COEFFICIENT = 2  # of reduced basis vectors in the axes: edges of voxels are sums of two diagonals
MAX_COSINE = 1e-3  # of the angle between orthogonal vectors, whose directions have errors
MAX_REFINEMENTS = 30  # of the basis, each of which divides the volume of its cell by two or more


@dataclass(frozen=True)
class Lattice:
    """A lattice on which vertices lie."""

    basis: FloatArray  # (3, 3): rows are short vectors of which all others are integer combinations
    places: FloatArray  # (n, 3): integer coefficients of the vertices, from one of them


@dataclass(frozen=True)
class LatticeFrame:
    """Three orthogonal vectors of a lattice."""

    coefficients: IntArray  # (3, 3): of each vector in the basis
    lengths: FloatArray  # (3,)
    axes: FloatArray  # (3, 3): unit vectors, one in each row

    def coordinates(self, places: FloatArray) -> FloatArray:
        """Coordinates along the axes of places in the lattice (n, 3), free of the rounding of the vertices, (n, 3)."""
        return places @ np.linalg.inv(self.coefficients) * self.lengths


def find_lattice(mesh: TriangleMesh) -> Lattice | None:
    """The lattice on which all vertices lie; None if there is none.

    >>> from bezier_filters.meshes.mesh import triangle_mesh
    >>> from bezier_filters.surfaces import waves
    >>> hills = waves(resolution=40, amplitude=0.3)
    >>> heights = np.round(hills.vertices * [1.0, 1.0, 30.0]) / [1.0, 1.0, 30.0]
    >>> turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    >>> terrain = np.column_stack([hills.vertices[:, :2], heights[:, 2]]) @ turn.T
    >>> lattice = find_lattice(triangle_mesh(terrain, hills.faces))
    >>> bool(np.allclose(np.sort(np.abs(orthogonal_frames(lattice)[0].axes @ turn).max(axis=1)), 1.0))
    True
    """
    vectors, error = _distinct_edges(mesh)
    short = _lattice_basis(vectors, error) if len(vectors) else None
    if short is None:
        return None
    basis = _least_squares(vectors @ np.linalg.inv(short), vectors)
    offsets = mesh.vertices - mesh.vertices[mesh.faces[0, 0]]
    used = np.unique(mesh.faces)
    for _ in range(2):  # from the edges first: over long distances errors of the basis would add up
        places = np.round(offsets @ np.linalg.pinv(basis))
        basis = _least_squares(places[used], offsets[used])
    is_on = np.abs(offsets - places @ basis)[used].max() <= 4.0 * error
    return Lattice(basis, places) if is_on else None


def orthogonal_frames(lattice: Lattice) -> list[LatticeFrame]:
    """Triples of orthogonal vectors of a lattice with small coefficients, by ascending volume of their cells."""
    coefficients = np.array(list(product(range(-MAX_COEFFICIENT, MAX_COEFFICIENT + 1), repeat=3)))
    coefficients = coefficients[len(coefficients) // 2 + 1 :]  # one of each pair of opposite vectors
    coefficients = coefficients[np.gcd.reduce(coefficients, axis=1) == 1]
    vectors = coefficients @ lattice.basis
    lengths = np.linalg.norm(vectors, axis=1)
    axes = vectors / lengths[:, np.newaxis]
    is_orthogonal = np.abs(axes @ axes.T) < MAX_COSINE
    triples = [
        [i, j, k]
        for i in range(len(axes))
        for j in np.flatnonzero(is_orthogonal[i, i:]) + i
        for k in np.flatnonzero(is_orthogonal[i, j:] & is_orthogonal[j, j:]) + j
    ]
    triples.sort(key=lambda rows: float(lengths[rows].prod()))
    return [LatticeFrame(coefficients[rows], lengths[rows], axes[rows]) for rows in triples]


def _distinct_edges(mesh: TriangleMesh) -> tuple[FloatArray, float]:
    """Distinct vectors along edges (k, 3), without sign, and the error of their coordinates; none if nearly all are."""
    faces = mesh.faces[:: max(3 * len(mesh.faces) // MAX_EDGE_SAMPLE, 1)]
    vectors = np.concatenate([mesh.vertices[faces[:, k]] - mesh.vertices[faces[:, k - 1]] for k in range(3)])
    error = SINGLE_ERROR * float(np.abs(mesh.vertices[mesh.faces]).max(initial=0.0))
    cells = np.round(vectors / max(4.0 * error, np.finfo(np.float64).tiny))
    first = cells[np.arange(len(cells)), (cells != 0.0).argmax(axis=1)]
    _, rows = np.unique(cells * np.where(first < 0.0, -1.0, 1.0)[:, np.newaxis], axis=0, return_index=True)
    return vectors[rows] if len(rows) <= MAX_DISTINCT_EDGES * len(vectors) else vectors[:0], error


def _lattice_basis(vectors: FloatArray, error: float) -> FloatArray | None:
    """Three short vectors (3, 3) of which all are integer combinations; None if there are none.

    If a vector is none, its remainder is shorter and belongs to the lattice as well.
    """
    known = vectors[np.argsort(np.square(vectors).sum(axis=1), kind="stable")]
    for _ in range(MAX_REFINEMENTS):
        basis = _reduce(_first_independent(known, error))
        if len(basis) < 3 or np.linalg.norm(basis, axis=1).min() < MIN_PRECISION * error:
            return None
        combination = vectors @ np.linalg.inv(basis)
        remainders = (combination - np.round(combination)) @ basis
        sizes = np.linalg.norm(remainders, axis=1)
        # errors add up over the basis vectors
        allowed = 2.0 * error * (1.0 + np.abs(combination).sum(axis=1))
        if (sizes <= allowed).all():
            return basis
        known = np.concatenate([remainders[[sizes.argmax()]], basis])
        known = known[np.argsort(np.square(known).sum(axis=1), kind="stable")]
    return None


def _least_squares(places: FloatArray, vectors: FloatArray) -> FloatArray:
    """The basis (3, 3) of which the vectors (k, 3) have coefficients nearest to integers, those of `places` (k, 3)."""
    return np.asarray(np.linalg.lstsq(np.round(places), vectors, rcond=None)[0], dtype=np.float64)


def _first_independent(vectors: FloatArray, error: float) -> FloatArray:
    """The first vectors, three at most, of which none is near the span of those before it."""
    chosen: list[FloatArray] = []
    frame = np.zeros((0, 3))
    for vector in vectors:
        across = vector - (frame @ vector) @ frame
        size = float(np.linalg.norm(across))
        if size > MIN_PRECISION * error:
            chosen.append(vector)
            frame = np.concatenate([frame, across[np.newaxis] / size])
            if len(chosen) == 3:
                break
    return np.array(chosen).reshape(-1, 3)


def _reduce(basis: FloatArray) -> FloatArray:
    """A basis of the same lattice whose vectors cannot be shortened by adding multiples of one to another."""
    basis, is_shorter = basis.copy(), True
    while is_shorter:
        is_shorter = False
        for i, j in product(range(len(basis)), repeat=2):
            times = 0.0 if i == j else np.round(basis[i] @ basis[j] / (basis[j] @ basis[j]))
            shorter = basis[i] - times * basis[j]
            if shorter @ shorter < (1.0 - 1e-6) * (basis[i] @ basis[i]):
                basis[i], is_shorter = shorter, True
    return basis
