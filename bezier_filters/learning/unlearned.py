"""Why nothing can be learned of a surface, in words."""

from bezier_filters.learning.neighbourhood_samples import NORMAL_CHECK_RINGS, NeighbourhoodSample
from bezier_filters.learning.ring_analysis import MIN_SAMPLES

MIN_USABLE_SHARE = 0.8  # a ring that folds at more than the rest of the sampled vertices is too wide


def reason_unlearned(sample: NeighbourhoodSample) -> str:
    """Why neighbourhoods of two edges, which a sample holds, do not show the noise.

    >>> import numpy as np
    >>> sizes, no = np.full((20, NORMAL_CHECK_RINGS + 1), 3), np.zeros((20, NORMAL_CHECK_RINGS + 1), dtype=np.bool_)
    >>> triangles = NeighbourhoodSample(np.arange(20), np.zeros((20, 9, 3)), sizes, no, no, np.zeros(20))
    >>> reason_unlearned(triangles)
    '20 of 20 neighbourhoods reach a border or a sharp edge, and 12 are needed that do not'
    """
    count = len(sample.centers)
    if not count:
        return "no vertex has a normal"
    if count < MIN_SAMPLES:
        return f"{count} vertices are too few, {MIN_SAMPLES} are needed"
    clear, usable = int(sample.clear[:, NORMAL_CHECK_RINGS].sum()), int(sample.usable[:, NORMAL_CHECK_RINGS].sum())
    if clear < MIN_SAMPLES:
        return (
            f"{count - clear} of {count} neighbourhoods reach a border or a sharp edge, and {MIN_SAMPLES} are "
            "needed that do not"
        )
    if usable < max(MIN_USABLE_SHARE * clear, MIN_SAMPLES):
        return f"{clear - usable} of {clear} neighbourhoods fold: noise is as large as the edges, or faces are flipped"
    return "neighbourhoods have too few points, or the noise is more than edges are long"
