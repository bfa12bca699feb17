"""Segments joined to lines."""

import numpy as np

from bezier_filters.arrays import IntArray


def chains(segments: IntArray, ends: IntArray | None = None) -> list[tuple[IntArray, IntArray]]:
    """Join segments (s, 2), given by the numbers of the nodes at their ends, to chains as long as possible.

    Chains end at nodes with one segment, or with three or more, and at further nodes that are named as `ends`. Each is
    its nodes in order, (k + 1,), the last one the first one again if it is closed, and the segments between them, (k,).

    >>> [nodes.tolist() for nodes, _ in chains(np.array([[4, 7], [9, 7], [1, 2], [2, 3], [3, 1]]))]
    [[4, 7, 9], [1, 2, 3, 1]]
    """
    nodes, local = np.unique(segments, return_inverse=True)
    pairs = local.reshape(-1, 2).tolist()
    at_node: list[list[int]] = [[] for _ in nodes]
    for segment, (a, b) in enumerate(pairs):
        at_node[a].append(segment)
        at_node[b].append(segment)
    named = np.isin(nodes, [] if ends is None else ends).tolist()
    is_end = [named[node] or len(here) != 2 for node, here in enumerate(at_node)]
    used = [False] * len(pairs)

    def walk(node: int, segment: int) -> tuple[IntArray, IntArray]:
        path, passed = [node], []
        while not used[segment]:
            used[segment] = True
            passed.append(segment)
            a, b = pairs[segment]
            node = b if a == node else a
            path.append(node)
            here = at_node[node]
            if is_end[node]:
                break
            segment = here[0] if here[1] == segment else here[1]
        return nodes[path], np.array(passed, dtype=np.int32)

    result = [
        walk(node, segment)
        for node, here in enumerate(at_node)
        if is_end[node]
        for segment in here
        if not used[segment]
    ]
    result += [walk(pair[0], segment) for segment, pair in enumerate(pairs) if not used[segment]]
    return result
