"""A block with sharp edges and corners."""

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.surfaces import sampling
from bezier_filters.surfaces.sampling import check_positive


def block_with_sharp_edges(
    *, size: float = 1.0, resolution: int = 16, jitter: float = 0.0, seed: int = 0
) -> tuple[FloatArray, IntArray]:
    """Cube around the origin without its octant x, y, z > 0: convex and concave sharp edges and corners.

    Normals and curvatures are undefined on the edges, so there is no truth but the shape. The
    edges of the block are exactly edges of the mesh.

    Parameters
    ----------
    size : float
        Side of the cube, a positive length.
    resolution : int
        Mesh edges along the side of the cube, even; the mesh has ``6 resolution^2 + 2`` vertices.
    jitter : float
        Largest displacement of the samples, in random directions, as a fraction of the edge; at
        least 0, below 0.35. Samples stay on their face or edge of the block. Random diagonals if
        it is positive.
    seed : int
        Seed of the displacements and diagonals.

    Returns
    -------
    vertices : (n, 3) float64
        Points of the block's surface.
    faces : (m, 3) int32
        Outward triangles of a closed mesh.

    Raises
    ------
    InvalidParameterError
        If a parameter is out of range.

    Examples
    --------
    >>> vertices, faces = block_with_sharp_edges(resolution=10)
    >>> vertices.shape, faces.shape
    ((602, 3), (1200, 3))
    """
    check_positive(size=size)
    points, faces = sampling.notched_cube(resolution, jitter=jitter, seed=seed)
    return (points / resolution - 0.5) * size, faces
