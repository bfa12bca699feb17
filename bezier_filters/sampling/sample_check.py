"""Says in words why a sample of neighbourhoods is not sufficient to estimate a surface model."""

from bezier_filters.sampling.neighbourhood_samples import NORMAL_CHECK_RINGS, NeighbourhoodSample
from bezier_filters.sampling.ring_analysis import MIN_SAMPLES

MIN_USABLE_SHARE = 0.8  # a ring is too wide if a smaller fraction of its interior neighbourhoods is usable


def explain_unusable_sample(sample: NeighbourhoodSample) -> str:
    """Say why the neighbourhoods of two rings in a sample do not determine the noise.

    >>> import numpy as np
    >>> sizes, no = np.full((20, NORMAL_CHECK_RINGS + 1), 3), np.zeros((20, NORMAL_CHECK_RINGS + 1), dtype=np.bool_)
    >>> triangles = NeighbourhoodSample(np.arange(20), np.zeros((20, 9, 3)), sizes, no, no, np.zeros(20))
    >>> explain_unusable_sample(triangles)
    '20 of 20 neighbourhoods reach a border or a sharp edge, and 12 are needed that do not'
    """
    count = len(sample.centers)
    if not count:
        return "no vertex has a normal"
    if count < MIN_SAMPLES:
        return f"{count} vertices are too few, {MIN_SAMPLES} are needed"
    clear, usable = (
        int(sample.is_interior[:, NORMAL_CHECK_RINGS].sum()),
        int(sample.usable[:, NORMAL_CHECK_RINGS].sum()),
    )
    if clear < MIN_SAMPLES:
        return (
            f"{count - clear} of {count} neighbourhoods reach a border or a sharp edge, and {MIN_SAMPLES} are "
            "needed that do not"
        )
    if usable < max(MIN_USABLE_SHARE * clear, MIN_SAMPLES):
        return f"{clear - usable} of {clear} neighbourhoods fold: noise is as large as the edges, or faces are flipped"
    return "neighbourhoods have too few points, or the noise is more than edges are long"
