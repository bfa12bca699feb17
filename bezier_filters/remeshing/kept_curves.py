"""Curves that remeshing keeps: sharp edges, borders and given edges of a mesh, as chains between fixed vertices.

A chain is a polyline of old edges. A new vertex on it is given by its arc length there, so that it stays on its curve
however near another one is, and by the surface over the old edge at that place.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray, unique_rows
from bezier_filters.patch_surface.surface import Surface
from bezier_filters.remeshing.surface_places import find_positions

MAX_CURVE_TURN = 60.0  # angle in degrees between edges of a curve above which the vertex between them is a corner


@dataclass(frozen=True)
class Chains:
    """Old edges in order along their chains."""

    ends: IntArray  # (k, 2): vertices of each edge, in the direction of its chain
    begins: FloatArray  # (k + 1,): arc length at the begin of each edge, over all chains one after the other
    first: IntArray  # (c + 1,): first edge of each chain
    is_closed: BoolArray  # (c,)


@dataclass(frozen=True)
class CurveEdges:
    """Edges of the new mesh on curves."""

    ends: IntArray  # (e, 2): vertices, in the direction of the chain
    chain: IntArray  # (e,)
    interval: FloatArray  # (e, 2): arc lengths of the ends, counted on past the end of a closed chain
    frozen: BoolArray  # (e,): whether the edge is not divided


def kept_edges(surface: Surface, extra: IntArray) -> IntArray:
    """Edges (e, 2), the smaller vertex first, that are sharp, at the border, non-manifold, or among the extra ones."""
    faces, neighbours = surface.mesh.faces, surface.arrays.neighbours
    rows, corner = np.nonzero(neighbours < 0)
    ends = np.stack([faces[rows, corner], faces[rows, (corner + 1) % 3]], axis=1)
    return unique_rows(np.sort(np.vstack([ends, extra.reshape(-1, 2)]), axis=1))[0].astype(np.int32)


def find_chains(vertices: FloatArray, edges: IntArray, corners: BoolArray) -> Chains:
    """Chains of edges (e, 2) that end at corners, at branches and at sharp turns; `corners` (n,) gets all these."""
    n = len(vertices)
    order = np.argsort(edges.ravel(), kind="stable")
    edge_of, start = order // 2, np.searchsorted(edges.ravel()[order], np.arange(n + 1))
    degree = np.diff(start)
    two = np.flatnonzero(degree == 2)
    sides = [edges[edge_of[start[two] + k]].sum(axis=1) - two for k in (0, 1)]
    steps = [vertices[side] - vertices[two] for side in sides]
    lengths = np.linalg.norm(steps[0], axis=1) * np.linalg.norm(steps[1], axis=1)
    turns = -np.einsum("kd,kd->k", *steps) < np.cos(np.radians(MAX_CURVE_TURN)) * lengths
    corners |= (degree > 0) & (degree != 2)
    corners[two[turns]] = True
    unused, ends, first, closed = np.ones(len(edges), np.bool_), list[tuple[int, int]](), [0], list[bool]()
    near, far = edges.tolist(), edge_of.tolist()
    for begin in (*np.flatnonzero(corners & (degree > 0)).tolist(), *two.tolist()):
        for slot in range(start[begin], start[begin + 1]):
            edge, vertex = far[slot], begin
            if not unused[edge]:
                continue
            while unused[edge]:
                unused[edge] = False
                other = sum(near[edge]) - vertex
                ends.append((vertex, other))
                vertex = other
                if corners[vertex]:
                    break
                one, two_ = far[start[vertex]], far[start[vertex] + 1]
                edge = two_ if one == edge else one
            first.append(len(ends))
            closed.append(vertex == begin and not corners[begin])
    found = np.array(ends, dtype=np.int32).reshape(-1, 2)
    lengths = np.linalg.norm(vertices[found[:, 0]] - vertices[found[:, 1]], axis=1)
    begins = np.concatenate([[0.0], np.cumsum(lengths)])
    return Chains(found, begins, np.array(first), np.array(closed, dtype=np.bool_))


def initial_edges(chains: Chains, frozen: BoolArray) -> CurveEdges:
    """The old edges themselves."""
    chain = np.repeat(np.arange(len(chains.is_closed)), np.diff(chains.first)).astype(np.int32)
    return CurveEdges(chains.ends, chain, np.column_stack([chains.begins[:-1], chains.begins[1:]]), frozen)


class CurvePoints(NamedTuple):
    """Points on curves."""

    points: FloatArray  # (q, 3)
    faces: IntArray  # (q,): an old face at each
    coordinates: FloatArray  # (q, 2): barycentric ones in it
    curvatures: FloatArray  # (q,): largest absolute one of the surface on all sides


class CurvePlaces:
    """Where the surface is over the curves."""

    def __init__(self, surface: Surface, chains: Chains) -> None:
        self.surface, self.chains = surface, chains
        faces, n = surface.mesh.faces, surface.mesh.vertex_count
        starts, stops = faces.ravel().astype(np.int64), np.roll(faces, -1, axis=1).ravel()
        keys = np.minimum(starts, stops) * n + np.maximum(starts, stops)
        self.half_edges = np.argsort(keys, kind="stable")
        ends = chains.ends.astype(np.int64)
        wanted = ends.min(axis=1, initial=n) * n + ends.max(axis=1, initial=-1)
        self.start, self.stop = (np.searchsorted(keys[self.half_edges], wanted, side) for side in ("left", "right"))

    def find(self, chain: IntArray, place: FloatArray) -> CurvePoints:
        """Where arc lengths of chains (q,) are."""
        chains, faces = self.chains, self.surface.mesh.faces
        low, high = chains.begins[chains.first[chain]], chains.begins[chains.first[chain + 1]]
        place = np.where(chains.is_closed[chain], low + np.mod(place - low, np.maximum(high - low, 1e-300)), place)
        edge = np.clip(
            np.searchsorted(chains.begins, place, "right") - 1, chains.first[chain], chains.first[chain + 1] - 1
        )
        length = np.maximum(chains.begins[edge + 1] - chains.begins[edge], 1e-300)
        part = np.clip((place - chains.begins[edge]) / length, 0.0, 1.0)
        count = self.stop[edge] - self.start[edge]
        owner = np.repeat(np.arange(len(edge), dtype=np.int32), count)
        offset = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
        half = self.half_edges[self.start[edge][owner] + offset]
        rows, corner = half // 3, half % 3
        along = np.where(faces[rows, corner] == chains.ends[edge[owner], 0], part[owner], 1.0 - part[owner])
        weights = np.zeros((len(owner), 3))
        weights[np.arange(len(owner)), corner] = 1.0 - along
        weights[np.arange(len(owner)), (corner + 1) % 3] = along
        found = find_positions(self.surface, owner, rows, weights[:, 1:], len(edge))
        a_row = np.cumsum(count) - count
        return CurvePoints(found.points, rows[a_row].astype(np.int32), weights[a_row, 1:], found.curvatures)


def divide(curves: CurveEdges, chosen: BoolArray, middle: IntArray) -> CurveEdges:
    """Divide the chosen edges at new vertices `middle`, one for each of them."""
    a, b = curves.ends[chosen].T
    low, high = curves.interval[chosen].T
    center = 0.5 * (low + high)
    return CurveEdges(
        np.vstack([curves.ends[~chosen], np.column_stack([a, middle]), np.column_stack([middle, b])]).astype(np.int32),
        np.concatenate([curves.chain[~chosen], curves.chain[chosen], curves.chain[chosen]]),
        np.vstack([curves.interval[~chosen], np.column_stack([low, center]), np.column_stack([center, high])]),
        np.concatenate([curves.frozen[~chosen], *[np.zeros(int(chosen.sum()), np.bool_)] * 2]),
    )


def merge_ends(curves: CurveEdges, target: IntArray, n: int) -> CurveEdges:
    """Collapse edges of curves: vertex i becomes `target[i]`, the other end of one of its edges, or stays."""
    ends = target[curves.ends]
    gone = ends[:, 0] == ends[:, 1]
    interval = curves.interval.copy()
    # the neighbour of a collapsed edge reaches to the vertex that stays
    shift = np.zeros(n)
    for k, sign in ((0, 1.0), (1, -1.0)):
        moved = gone & (target[curves.ends[:, k]] != curves.ends[:, k])
        length = curves.interval[moved, 1] - curves.interval[moved, 0]
        shift[curves.ends[moved, k]] = sign * length
    interval += shift[curves.ends]
    return CurveEdges(ends[~gone].astype(np.int32), curves.chain[~gone], interval[~gone], curves.frozen[~gone])


def relax_along(curves: CurveEdges, free: BoolArray, part: float) -> CurveEdges:
    """Move the vertices that are free (n,) on their curves towards the middle of their neighbours, by a part of it."""
    lengths = curves.interval[:, 1] - curves.interval[:, 0]
    n = len(free)
    move = np.bincount(curves.ends[:, 0], lengths, n) - np.bincount(curves.ends[:, 1], lengths, n)
    step = 0.5 * part * free * move
    return replace(curves, interval=curves.interval + step[curves.ends])
