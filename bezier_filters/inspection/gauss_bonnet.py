"""The total Gaussian curvature that a part of a surface has by the theorem of Gauss and Bonnet.

With the Euler characteristic chi and the total geodesic curvature of the border, exterior angles at its corners
included, it is 2 pi chi - turning. The turning is that of a polyline on the surface: the angles between its sides,
projected to the tangent planes at its points.
"""

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.meshes.half_edges import half_edge_twins
from bezier_filters.patch_surface.surface import Surface

SIDES = 16  # of the polyline along each edge of the border; the error falls with their square


def euler_characteristic_and_turning(surface: Surface, inside: BoolArray) -> tuple[int, float]:
    """Euler characteristic of the faces inside (m,), and the turning of their border in radians.

    The mesh is that cut along its sharp edges, so that both sides of a sharp edge are border. A vertex at which parts
    only touch counts once for each of them.
    """
    faces = surface.cut.faces
    twins = half_edge_twins(faces, len(surface.cut.vertices))
    inner = np.repeat(inside, 3)
    has_twin = (twins >= 0) & inner[np.maximum(twins, 0)]
    border = np.flatnonzero(inner & ~has_twin).astype(np.int32)
    starts = faces.ravel()
    following = _follow(border, twins, inner)
    on_border = np.zeros(len(surface.cut.vertices), dtype=np.bool_)
    on_border[starts[border]] = True
    vertices = np.unique(faces[inside])
    edges = (int(inner.sum()) + len(border)) // 2
    characteristic = int((~on_border[vertices]).sum()) + len(border) - edges + int(inside.sum())
    return characteristic, _turning(surface, border, following) if len(border) else 0.0


def _follow(border: IntArray, twins: IntArray, inner: BoolArray) -> IntArray:
    """The next half-edge of the border after each, around the faces inside at its end."""
    found = border - border % 3 + (border + 1) % 3
    while True:
        across = twins[found]
        go_on = (across >= 0) & inner[np.maximum(across, 0)]
        if not go_on.any():
            return found
        found[go_on] = across[go_on] - across[go_on] % 3 + (across[go_on] + 1) % 3


def _turning(surface: Surface, border: IntArray, following: IntArray) -> float:
    """Sum of the exterior angles of a polyline along half-edges of the border, radians."""
    parts = np.arange(SIDES + 1) / SIDES
    corners = np.zeros((len(border), SIDES + 1, 3))
    rows, first = np.arange(len(border)), border % 3
    corners[rows, :, first] = 1.0 - parts
    corners[rows, :, (first + 1) % 3] = parts
    found = surface.evaluate(np.repeat(border // 3, SIDES + 1), corners[:, :, 1:].reshape(-1, 2))
    points, normals = (values.reshape(len(border), SIDES + 1, 3) for values in (found.points, found.normals))
    sides = np.diff(points, axis=1)
    within = _angles(sides[:, :-1], sides[:, 1:], normals[:, 1:-1]).sum()
    place = np.empty(3 * len(surface.cut.faces), dtype=np.int64)
    place[border] = rows
    at_ends = _angles(sides[:, -1], sides[place[following], 0], normals[:, -1]).sum()
    return float(within + at_ends)


def _angles(before: FloatArray, after: FloatArray, normals: FloatArray) -> FloatArray:
    """Angles by which sides turn about the normals."""
    before, after = (
        side - np.einsum("...i,...i->...", side, normals)[..., np.newaxis] * normals for side in (before, after)
    )
    sine = np.einsum("...i,...i->...", np.cross(before, after), normals)
    return np.asarray(np.arctan2(sine, np.einsum("...i,...i->...", before, after)))
