"""Coordinates that are multiples of a step, and meshes whose faces are stairs because of it.

Boundaries of voxel masks, heights in whole metres and coordinates of low precision are rounded to a step s, which is
noise of standard deviation s / sqrt(12) along that axis (Widrow, Kollar, "Quantization Noise", 2008). If steps are
about as long as edges, the dihedral angles of the stairs look like sharp edges.

Not all coordinates that are multiples of a step are rounded. Two axes on which no two vertices share both coordinates
are a sampling grid, as x and y of a height field. And a body made of bricks has large flat faces on both sides of its
edges, whereas the riser of a stair is one step high.
"""

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray
from bezier_filters.meshes.neighbourhoods import rings_around, search_workspace
from bezier_filters.meshes.prepared_mesh import PreparedMesh

MAX_STEP_SAMPLE = 20_000  # vertices of which the steps are found: a larger sample sees shorter steps
# largest share of distinct values among the coordinates of an axis: steps of a twentieth of an edge and more have fewer
MAX_DISTINCT_SHARE = 0.7
STEP_TOLERANCE = 1e-5  # of a step: coordinates of single precision are multiples of it up to this
MIN_DISTINCT_PAIRS = 0.99  # share of vertices with a pair of coordinates of their own from which on it is a grid
# Noise by rounding over the mean edge from which on the stairs look like sharp edges: below it a step turns the normal
# of a face by less than about 20 degrees. With 0.05 or 0.2 the same of the tested terrains, balls and tori are stairs.
MIN_STAIR_NOISE = 0.1
COVERED_SHARE = 0.9  # of the places, whose noise is at most that by rounding
FLAT_COSINE = 1.0 - 1e-9  # cosine between normals of one plane
FLAT_RINGS, BRICK_RINGS = 2, 4  # rings that are flat around a vertex of a large face, and within which it is looked for
MIN_BRICK_SHARE = 0.5  # share of vertices on sharp edges between two large faces, from which on these are no stairs
BRICK_SAMPLE = 200  # vertices on sharp edges that are examined


def coordinate_steps(vertices: FloatArray) -> FloatArray:
    """Steps of which the coordinates of each axis are multiples, up to an offset, (3,); 0 where there is none.

    >>> heights = np.random.default_rng(0).normal(size=(1000, 3))
    >>> coordinate_steps(np.round(heights / [1.0, 0.5, 1e-9]) * [1.0, 0.5, 1e-9])
    array([1. , 0.5, 0. ])
    """
    stride = max(len(vertices) // MAX_STEP_SAMPLE, 1)
    sample = vertices[::stride]
    return np.array([_step(sample[:, axis]) for axis in range(3)])


def _step(values: FloatArray) -> float:
    """The step of one axis: the smallest difference, if all differences are multiples of it."""
    distinct = np.unique(values)
    scale = max(abs(float(distinct[0])), abs(float(distinct[-1]))) if len(distinct) else 0.0
    if not 2 < len(distinct) <= MAX_DISTINCT_SHARE * len(values):
        return 0.0
    differences = np.diff(distinct)
    differences = differences[differences > 4.0 * np.finfo(np.float32).eps * scale]
    if len(differences) < 2:
        return 0.0
    step = float(differences.min())
    multiples = differences / step
    is_multiple = np.abs(multiples - np.round(multiples)) <= STEP_TOLERANCE * multiples + 4e-7 * scale / step
    return step if is_multiple.all() else 0.0


def rounding_variance(mesh: PreparedMesh, steps: FloatArray) -> float:
    """Variance along the normal of the noise by rounding to steps (3,), a squared length; sampling grids have none.

    It differs from place to place with the normal; nine of ten places do not exceed it.
    """
    has_normal = mesh.planes.normals.any(axis=1)
    points, normals = mesh.vertices[has_normal], mesh.planes.normals[has_normal]
    if not len(points):
        return 0.0
    rounded = steps.copy()
    for first, second in ((0, 1), (1, 2), (2, 0)):
        if steps[first] > 0.0 and steps[second] > 0.0:
            pairs = np.round(points[:, [first, second]] / steps[[first, second]])
            if len(np.unique(pairs, axis=0)) >= MIN_DISTINCT_PAIRS * len(points):
                rounded[[first, second]] = 0.0
    along = np.square(normals * rounded)
    if (rounded > 0.0).all():
        is_half_way = _half_way(points, rounded)
        if np.mean(is_half_way.sum(axis=1) == 1) >= MIN_DISTINCT_PAIRS:
            along = 4.0 * along * is_half_way
    return float(np.quantile(along.sum(axis=1), COVERED_SHARE)) / 12.0


def _half_way(points: FloatArray, steps: FloatArray) -> BoolArray:
    """Which coordinates (k, 3) lie half-way between those of most others, as one of each vertex of a voxel mask does."""
    is_odd = np.round((points - points.min(axis=0)) / steps).astype(np.int64) % 2 == 1
    return np.asarray(is_odd != (is_odd.mean(axis=0) > 0.5))


def stair_variance(mesh: PreparedMesh) -> float:
    """Variance of the noise along the normal, if rounded coordinates have left stairs, a squared length; otherwise 0.

    >>> from bezier_filters.meshes.mesh import triangle_mesh
    >>> from bezier_filters.meshes.prepared_mesh import prepare_mesh
    >>> from bezier_filters.surfaces import block_with_sharp_edges, waves
    >>> hills = waves(resolution=60, amplitude=0.3)
    >>> heights = np.round(hills.vertices * [1.0, 1.0, 30.0]) / [1.0, 1.0, 30.0]
    >>> terrain = np.column_stack([hills.vertices[:, :2], heights[:, 2]])
    >>> bricks = block_with_sharp_edges(resolution=16)
    >>> variances = [stair_variance(prepare_mesh(triangle_mesh(*one))) for one in ((terrain, hills.faces), bricks)]
    >>> [round(float(np.sqrt(12.0 * variance)) * 30.0, 1) for variance in variances]  # in steps of 1 / 30
    [1.0, 0.0]
    """
    steps = coordinate_steps(mesh.vertices)
    if not (steps > 0.0).any() or not mesh.face_count:
        return 0.0
    variance = rounding_variance(mesh, steps)
    is_long = variance > (MIN_STAIR_NOISE * mesh.mean_edge) ** 2
    return variance if is_long and not _is_made_of_bricks(mesh) else 0.0


def _is_made_of_bricks(mesh: PreparedMesh) -> bool:
    """Whether most vertices on sharp edges lie between large flat faces in different directions."""
    edges = np.flatnonzero(mesh.barriers)
    if not len(edges):
        return True  # there is no edge to be doubted
    is_flat = _flat_vertices(mesh)
    edges = edges[:: max(len(edges) // BRICK_SAMPLE, 1)]
    workspace, count = search_workspace(mesh.vertex_count), 0
    for vertex in edges.astype(np.int32):
        around, _ = rings_around(mesh.adjacency.vertices, np.array([vertex], dtype=np.int32), BRICK_RINGS, workspace)
        normals = mesh.planes.normals[around[is_flat[around]]]
        count += bool(len(normals) and (normals @ normals[0] < FLAT_COSINE).any())
    return count >= MIN_BRICK_SHARE * len(edges)


def _flat_vertices(mesh: PreparedMesh) -> BoolArray:
    """Vertices (n,) whose normal is that of all vertices within `FLAT_RINGS` edges."""
    rows, normals = mesh.adjacency.vertices, mesh.planes.normals
    start = np.repeat(np.arange(len(rows)), rows.lengths)
    is_level = np.einsum("ij,ij->i", normals[start], normals[rows.indices]) >= FLAT_COSINE
    result = normals.any(axis=1) & ~mesh.adjacency.on_boundary & (np.bincount(start, ~is_level, len(rows)) == 0.0)
    for _ in range(FLAT_RINGS - 1):
        result &= np.bincount(start, ~result[rows.indices], len(rows)) == 0.0
    return result
