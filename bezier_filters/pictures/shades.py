"""What colours standard errors: means around each vertex."""

import numpy as np
from scipy.sparse import coo_array, diags_array

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.fields import Field

# of colours of standard errors: over about 5 edges, as wide as regions of vertices that are fitted on as many rings
SMOOTHING_PASSES = 40


def shades_of(field: Field, values: FloatArray, faces: IntArray) -> FloatArray | None:
    """Means (n,) around each vertex of a standard error; None for other fields, and for points.

    Vertices next to each other are fitted on different rings, so that their errors differ in patches without a fault.
    """
    return mean_around(values, faces) if field.name.endswith("_std") and len(faces) else None


def mean_around(values: FloatArray, faces: IntArray, passes: int = SMOOTHING_PASSES) -> FloatArray:
    """Values (n,) averaged with those of neighbours over faces (m, 3), a number of times.

    >>> import numpy as np
    >>> mean_around(np.array([0.0, 3.0, 6.0]), np.array([[0, 1, 2]]), passes=1).tolist()
    [2.25, 3.0, 3.75]
    """
    n = len(values)
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    edges = np.concatenate([edges, edges[:, ::-1]])
    adjacency = coo_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(n, n)).tocsr()
    adjacency.data[:] = 1.0
    counts = np.maximum(np.asarray(adjacency.sum(axis=1)).ravel(), 1.0)
    has_neighbours = np.asarray(adjacency.sum(axis=1)).ravel() > 0.0
    average = diags_array(1.0 / counts) @ adjacency
    for _ in range(passes):
        values = np.where(has_neighbours, 0.5 * (values + average @ values), values)
    return values
