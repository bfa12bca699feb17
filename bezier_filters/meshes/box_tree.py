"""A tree of bounding boxes over boxes in Morton order."""

from typing import NamedTuple

import numpy as np

from bezier_filters.arrays import FloatArray, IntArray

BOXES_PER_LEAF = 8  # most boxes in a leaf of the tree


class BoxTree(NamedTuple):
    """Boxes in Morton order, and a binary tree of bounding boxes over leaves of consecutive ones."""

    low: FloatArray  # (b, 3)
    high: FloatArray
    row: IntArray  # (b,): original index of each
    node_low: FloatArray  # (2 l, 3): node k has the children 2 k and 2 k + 1; the l leaves come last
    node_high: FloatArray


def box_tree(low: FloatArray, high: FloatArray) -> BoxTree:
    """Sort boxes with lowest and highest corners (b, 3) and bound them."""
    order = morton_order(0.5 * low + 0.5 * high)
    low, high = low[order], high[order]
    first = np.arange(0, len(low), BOXES_PER_LEAF)
    leaves = 1 << (len(first) - 1).bit_length()
    node_low, node_high = np.full((2 * leaves, 3), np.inf), np.full((2 * leaves, 3), -np.inf)
    node_low[leaves : leaves + len(first)] = np.minimum.reduceat(low, first)
    node_high[leaves : leaves + len(first)] = np.maximum.reduceat(high, first)
    while leaves > 1:
        below, leaves = slice(leaves, 2 * leaves), leaves // 2
        node_low[leaves : 2 * leaves] = node_low[below].reshape(-1, 2, 3).min(axis=1)
        node_high[leaves : 2 * leaves] = node_high[below].reshape(-1, 2, 3).max(axis=1)
    return BoxTree(low, high, order, node_low, node_high)


def morton_order(points: FloatArray) -> IntArray:
    """Order of points (n, 3) along the Morton curve, (n,); the identity for few points."""
    if len(points) <= BOXES_PER_LEAF:
        return np.arange(len(points), dtype=np.int32)
    low = points.min(axis=0)
    cells = ((points - low) * (1023.0 / max(float(np.ptp(points, axis=0).max()), 1e-300))).astype(np.int64)
    for shift, mask in ((16, 0x30000FF), (8, 0x300F00F), (4, 0x30C30C3), (2, 0x9249249)):
        cells = (cells | cells << shift) & mask
    return np.argsort(cells @ [4, 2, 1], kind="stable").astype(np.int32)
